//! LERC, Esri's limited error raster compression, of versions 3 to 6 of its second format (<https://github.com/Esri/lerc>).
//!
//! A blob is a header with a checksum, a mask of what was measured, and blocks of samples: each is one number, as many as it has, or whole
//! numbers of few bits that count steps of twice the largest error from the block's least number on. Numbers of 8 bits by Huffman's code, and
//! floats by version 6's lossless one, are not read.

use deepfield_data::model::SampleType;

/// What a blob begins with, and the bytes in front of those that its checksum is of.
const MAGIC: &[u8] = b"Lerc2 ";
const UNCHECKED: usize = 14;

/// Bytes of the shortest header.
pub(super) const SHORTEST: u64 = 62;

/// What ends a mask.
const END: i16 = i16::MIN;

/// Types by their number.
const TYPES: [SampleType; 8] = [
    SampleType::I8,
    SampleType::U8,
    SampleType::I16,
    SampleType::U16,
    SampleType::I32,
    SampleType::U32,
    SampleType::F32,
    SampleType::F64,
];

/// What is read of a blob, front to back.
struct Reader<'b> {
    bytes: &'b [u8],
}

/// What is wrong, in words.
type Read<T> = Result<T, String>;

impl<'b> Reader<'b> {
    fn take(&mut self, count: usize) -> Read<&'b [u8]> {
        let (taken, rest) = self.bytes.split_at_checked(count).ok_or("an end of the LERC blob before its samples'")?;
        self.bytes = rest;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Read<[u8; N]> {
        Ok(self.take(N)?.first_chunk().copied().unwrap_or([0; N]))
    }

    fn byte(&mut self) -> Read<u8> {
        Ok(self.array::<1>()?[0])
    }

    fn int(&mut self) -> Read<i32> {
        self.array().map(i32::from_le_bytes)
    }

    fn double(&mut self) -> Read<f64> {
        self.array().map(f64::from_le_bytes)
    }

    /// A number of a type.
    fn number(&mut self, kind: SampleType) -> Read<f64> {
        Ok(match kind {
            SampleType::I8 => f64::from(self.byte()? as i8),
            SampleType::U8 => f64::from(self.byte()?),
            SampleType::I16 => f64::from(i16::from_le_bytes(self.array()?)),
            SampleType::U16 => f64::from(u16::from_le_bytes(self.array()?)),
            SampleType::I32 => f64::from(self.int()?),
            SampleType::U32 => f64::from(u32::from_le_bytes(self.array()?)),
            SampleType::F32 => f64::from(f32::from_le_bytes(self.array()?)),
            _ => self.double()?,
        })
    }
}

/// What a header says.
struct Header {
    version: i32,
    /// Rows and columns.
    size: [usize; 2],
    valid: usize,
    block: usize,
    kind: SampleType,
    step: f64,
    range: [f64; 2],
}

impl Header {
    /// Reads it, and holds the checksum against the rest.
    fn read(reader: &mut Reader<'_>) -> Read<Header> {
        let blob = reader.bytes;
        if reader.take(MAGIC.len())? != MAGIC {
            return Err("no LERC blob of the second format".into());
        }
        let version = reader.int()?;
        if !(3..=6).contains(&version) {
            return Err(format!("LERC of version {version}, of which 3 to 6 are read"));
        }
        let checksum = reader.int()? as u32;
        let [rows, columns] = [reader.int()?, reader.int()?];
        let depth = if version >= 4 { reader.int()? } else { 1 };
        let [valid, block, length, kind] = [reader.int()?, reader.int()?, reader.int()?, reader.int()?];
        if version >= 6 {
            reader.take(8)?;
        }
        let [error, low, high] = [reader.double()?, reader.double()?, reader.double()?];
        if version >= 6 {
            reader.take(16)?;
        }
        let samples = i64::from(rows) * i64::from(columns);
        let is_sound = rows > 0 && columns > 0 && block > 0 && (0..=samples).contains(&i64::from(valid));
        let kind = usize::try_from(kind).ok().and_then(|kind| TYPES.get(kind));
        let (Some(kind), true) = (kind, is_sound && error >= 0.0) else {
            return Err(format!(
                "a LERC blob of {columns} x {rows} samples, {valid} of them measured, in blocks of {block}"
            ));
        };
        if depth != 1 {
            return Err(format!("a LERC blob with {depth} values a sample"));
        }
        let checked = usize::try_from(length).ok().and_then(|length| blob.get(UNCHECKED..length));
        let checked = checked.ok_or_else(|| format!("{} bytes of a LERC blob of {length}", blob.len()))?;
        if fletcher(checked) != checksum {
            return Err("a LERC blob with another checksum than it states".into());
        }
        Ok(Header {
            version,
            size: [rows as usize, columns as usize],
            valid: valid as usize,
            block: block as usize,
            kind: *kind,
            step: 2.0 * error,
            range: [low, high],
        })
    }
}

/// Fletcher's checksum of 32 bits.
fn fletcher(bytes: &[u8]) -> u32 {
    let (mut one, mut two) = (0xffff_u32, 0xffff_u32);
    let folded = |sum: u32| (sum & 0xffff) + (sum >> 16);
    let (words, rest) = bytes.as_chunks::<2>();
    for part in words.chunks(359) {
        for word in part {
            one += u32::from(u16::from_be_bytes(*word));
            two += one;
        }
        (one, two) = (folded(one), folded(two));
    }
    if let [last] = rest {
        one += u32::from(*last) << 8;
        two += one;
    }
    folded(two) << 16 | folded(one)
}

/// The samples of a blob, which has so many columns and rows of a type, the least significant byte first. What was not measured is NaN, of whole
/// numbers 0.
///
/// # Errors
/// What was found instead.
pub(super) fn unpack(blob: &[u8], [columns, rows]: [u64; 2], kind: SampleType) -> Read<Vec<u8>> {
    let mut reader = Reader { bytes: blob };
    let header = Header::read(&mut reader)?;
    if header.size != [rows as usize, columns as usize] || header.kind != kind {
        let [own_rows, own_columns] = header.size;
        return Err(format!("a LERC blob of {own_columns} x {own_rows} of {}", header.kind));
    }
    let samples = header.size[0] * header.size[1];
    let mask = mask(&mut reader, &header, samples)?;
    let mut out = Samples { bytes: vec![0; samples * kind.size()], kind };
    if mask.is_some() && kind.is_float() {
        (0..samples).for_each(|at| out.put(at, f64::NAN));
    }
    let is_valid = |at: usize| mask.as_ref().is_none_or(|mask| mask[at / 8] & 0x80 >> (at % 8) != 0);
    if header.valid == 0 {
        return Ok(out.bytes);
    }
    let [low, mut high] = header.range;
    let mut is_level = low == high;
    if header.version >= 4 && !is_level {
        let own = [reader.number(kind)?, reader.number(kind)?];
        (is_level, high) = (own[0] == own[1], own[1]);
    }
    if is_level {
        (0..samples).filter(|at| is_valid(*at)).for_each(|at| out.put(at, high));
        return Ok(out.bytes);
    }
    // One behind the other, as they are.
    if reader.byte()? != 0 {
        for at in (0..samples).filter(|at| is_valid(*at)) {
            out.put(at, reader.number(kind)?);
        }
        return Ok(out.bytes);
    }
    let is_small = kind.size() == 1 && header.step == 1.0;
    let is_lossless_float = header.version >= 6 && kind.is_float() && header.step == 0.0;
    if (is_small || is_lossless_float) && reader.byte()? != 0 {
        return Err("a LERC blob by Huffman's code, which is not read".into());
    }
    let mut counts = Vec::new();
    let mut places = Vec::new();
    for top in (0..header.size[0]).step_by(header.block) {
        for left in (0..header.size[1]).step_by(header.block) {
            let [bottom, right] = [(top, header.size[0]), (left, header.size[1])]
                .map(|(first, end)| first.saturating_add(header.block).min(end));
            places.clear();
            let all = (top..bottom).flat_map(|row| (left..right).map(move |column| (row, column)));
            places.extend(all.map(|(row, column)| row * header.size[1] + column).filter(|at| is_valid(*at)));
            let area = (bottom - top) * (right - left);
            block(&mut reader, &header, (left, area, high), &places, &mut counts, &mut out)?;
        }
    }
    Ok(out.bytes)
}

/// A bit for each sample, the first one of a byte the most significant; `None` where all were measured.
fn mask(reader: &mut Reader<'_>, header: &Header, samples: usize) -> Read<Option<Vec<u8>>> {
    let length = reader.int()?;
    let packed = reader.take(usize::try_from(length).map_err(|_| "a LERC mask of less than nothing")?)?;
    if header.valid == samples {
        return Ok(None);
    }
    let wanted = samples.div_ceil(8);
    let mut mask = Vec::new();
    if header.valid > 0 {
        let mut reader = Reader { bytes: packed };
        loop {
            let count = i16::from_le_bytes(reader.array()?);
            match count {
                END => break,
                0.. => mask.extend_from_slice(reader.take(count as usize)?),
                _ => mask.resize(mask.len() + usize::from(count.unsigned_abs()), reader.byte()?),
            }
            if mask.len() > wanted {
                break;
            }
        }
        if mask.len() != wanted {
            return Err(format!("a LERC mask of another size than {wanted} bytes"));
        }
    }
    mask.resize(wanted, 0);
    Ok(Some(mask))
}

/// Samples as bytes.
struct Samples {
    bytes: Vec<u8>,
    kind: SampleType,
}

impl Samples {
    fn put(&mut self, at: usize, value: f64) {
        let size = self.kind.size();
        let out = &mut self.bytes[at * size..][..size];
        match self.kind {
            SampleType::I8 => out.copy_from_slice(&(value as i8).to_le_bytes()),
            SampleType::U8 => out.copy_from_slice(&(value as u8).to_le_bytes()),
            SampleType::I16 => out.copy_from_slice(&(value as i16).to_le_bytes()),
            SampleType::U16 => out.copy_from_slice(&(value as u16).to_le_bytes()),
            SampleType::I32 => out.copy_from_slice(&(value as i32).to_le_bytes()),
            SampleType::U32 => out.copy_from_slice(&(value as u32).to_le_bytes()),
            SampleType::F32 => out.copy_from_slice(&(value as f32).to_le_bytes()),
            _ => out.copy_from_slice(&value.to_le_bytes()),
        }
    }
}

/// Reads the samples of a block, which begins at column `left` and has an area, to `places`; none is above `high`.
fn block(
    reader: &mut Reader<'_>,
    header: &Header,
    (left, area, high): (usize, usize, f64),
    places: &[usize],
    counts: &mut Vec<u32>,
    out: &mut Samples,
) -> Read<()> {
    let head = reader.byte()?;
    // Some bits of the column, so that damage shows.
    let bits = if header.version >= 5 { 14 } else { 15 };
    if head >> 2 & bits != (left >> 3) as u8 & bits {
        return Err("a LERC block of another column".into());
    }
    if header.version >= 5 && head & 4 != 0 {
        return Err("a LERC block that counts from another value of its samples".into());
    }
    match head & 3 {
        0 => {
            for at in places {
                out.put(*at, reader.number(header.kind)?);
            }
        }
        2 => places.iter().for_each(|at| out.put(*at, 0.0)),
        how => {
            let offset = reader.number(reduced(header.kind, head >> 6)?)?;
            if how == 3 {
                places.iter().for_each(|at| out.put(*at, offset));
                return Ok(());
            }
            stuffed(reader, area, counts)?;
            if counts.len() < places.len() {
                return Err(format!("{} numbers of a LERC block of {} samples", counts.len(), places.len()));
            }
            for (at, count) in places.iter().zip(counts.iter()) {
                out.put(*at, (offset + f64::from(*count) * header.step).min(high));
            }
        }
    }
    Ok(())
}

/// The type that a block's offset is stored in, which may be a smaller one.
fn reduced(kind: SampleType, by: u8) -> Read<SampleType> {
    let number = TYPES.iter().position(|known| *known == kind).unwrap_or(0);
    let by = usize::from(by);
    let found = match (kind, by) {
        (_, 0) | (SampleType::I8 | SampleType::U8, _) => Some(number),
        (SampleType::I16 | SampleType::I32, _) => number.checked_sub(by),
        (SampleType::U16 | SampleType::U32, _) => number.checked_sub(2 * by),
        (SampleType::F32, 1) => Some(2),
        (SampleType::F32, _) => Some(1),
        _ => (number + 1).checked_sub(2 * by),
    };
    found.and_then(|number| TYPES.get(number)).copied().ok_or_else(|| "a LERC block with an unknown type".into())
}

/// Whole numbers of few bits, `most` at most; or numbers of a table of such.
fn stuffed(reader: &mut Reader<'_>, most: usize, out: &mut Vec<u32>) -> Read<()> {
    let head = reader.byte()?;
    let (has_table, bits) = (head & 0x20 != 0, u32::from(head & 0x1f));
    let count = match head >> 6 {
        0 => u32::from_le_bytes(reader.array()?),
        1 => u16::from_le_bytes(reader.array()?).into(),
        2 => reader.byte()?.into(),
        _ => return Err("a LERC block without a count".into()),
    } as usize;
    if count > most {
        return Err(format!("{count} numbers of a LERC block of {most} samples"));
    }
    if !has_table {
        return words(reader, count, bits, out);
    }
    // The first entry is 0, and is left out.
    let entries = usize::from(reader.byte()?.saturating_sub(1));
    let mut table = Vec::new();
    words(reader, entries, bits, &mut table)?;
    table.insert(0, 0);
    words(reader, count, usize::BITS - entries.leading_zeros(), out)?;
    for number in out {
        *number = *table.get(*number as usize).ok_or("a number beyond the table of a LERC block")?;
    }
    Ok(())
}

/// So many numbers of so many bits, the least significant bit first.
fn words(reader: &mut Reader<'_>, count: usize, bits: u32, out: &mut Vec<u32>) -> Read<()> {
    let packed = reader.take((count * bits as usize).div_ceil(8))?;
    out.clear();
    if bits == 0 {
        out.resize(count, 0);
        return Ok(());
    }
    let (mut held, mut known) = (0_u64, 0);
    for byte in packed {
        held |= u64::from(*byte) << known;
        known += 8;
        while known >= bits && out.len() < count {
            out.push((held & ((1 << bits) - 1)) as u32);
            held >>= bits;
            known -= bits;
        }
    }
    Ok(())
}

#[cfg(test)]
pub(super) mod tests;
