//! Filters of chunks that the reader library leaves to others: LZF, which h5py brings along, and LZ4 and Zstandard of the plug-ins that HDF5's
//! authors register (<https://github.com/HDFGroup/hdf5_plugins>).

use hdf5_reader::FilterRegistry;
use hdf5_reader::error::{Error, Result};
use std::io::Read;

/// The numbers under which the filters are registered.
const LZF: u16 = 32000;
const LZ4: u16 = 32004;
const ZSTANDARD: u16 = 32015;

/// Filters that are often used and not read.
const OTHERS: [(u16, &str); 8] = [
    (307, "bzip2"),
    (32001, "Blosc"),
    (32008, "bitshuffle"),
    (32013, "ZFP"),
    (32017, "SZ"),
    (32018, "FCIDECOMP"),
    (32024, "SZ3"),
    (32026, "Blosc2"),
];

/// The library's own filters and these; a chunk of more than `most` bytes is an error.
pub(super) fn registry(most: usize) -> FilterRegistry {
    let mut registry = FilterRegistry::new();
    registry.register(LZF, Box::new(move |_, packed, _| unpacked("LZF", lzf(packed, most))));
    registry.register(LZ4, Box::new(move |_, packed, _| unpacked("LZ4", lz4(packed, most))));
    registry.register(ZSTANDARD, Box::new(move |_, packed, _| unpacked("Zstandard", zstandard(packed, most))));
    for (number, name) in OTHERS {
        let told = format!("{name}, number {number}; a copy that is read is made by h5repack -f GZIP=4 FILE COPY");
        registry.register(number, Box::new(move |_, _, _| Err(Error::UnsupportedFilter(told.clone()))));
    }
    registry
}

fn unpacked(name: &str, bytes: Option<Vec<u8>>) -> Result<Vec<u8>> {
    bytes.ok_or_else(|| Error::DecompressionError(format!("a damaged chunk of {name}")))
}

/// A control byte below 32 has one byte more than it says behind it, which are copied. In any other the upper three bits, where they are 7 with
/// a further byte, say how many but two are repeated, and the lower five and the next byte from how far back, less one.
fn lzf(packed: &[u8], most: usize) -> Option<Vec<u8>> {
    let mut out = Vec::new();
    let mut rest = packed;
    while let Some((&control, behind)) = rest.split_first() {
        rest = behind;
        if control < 32 {
            let (copied, behind) = rest.split_at_checked(usize::from(control) + 1)?;
            out.extend_from_slice(copied);
            rest = behind;
        } else {
            let mut length = usize::from(control >> 5) + 2;
            if length == 9 {
                length += usize::from(*rest.split_off_first()?);
            }
            let back = (usize::from(control & 31) << 8 | usize::from(*rest.split_off_first()?)) + 1;
            let start = out.len().checked_sub(back)?;
            // What is repeated may overlap what it makes.
            for at in start..start + length {
                out.push(*out.get(at)?);
            }
        }
        if out.len() > most {
            return None;
        }
    }
    Some(out)
}

/// The length of all in 8 bytes and that of a block in 4, then the blocks, each behind its length as it is stored: the most significant byte
/// comes first. A block that is stored as it is has its full length.
fn lz4(packed: &[u8], most: usize) -> Option<Vec<u8>> {
    let (&length, rest) = packed.split_first_chunk()?;
    let (&block, mut rest) = rest.split_first_chunk()?;
    let length = usize::try_from(u64::from_be_bytes(length)).ok().filter(|length| *length <= most)?;
    let block = usize::try_from(u32::from_be_bytes(block)).ok().filter(|block| *block > 0)?;
    let mut out = vec![0; length];
    for out in out.chunks_mut(block) {
        let (&stored, behind) = rest.split_first_chunk()?;
        let (stored, behind) = behind.split_at_checked(usize::try_from(u32::from_be_bytes(stored)).ok()?)?;
        if stored.len() == out.len() {
            out.copy_from_slice(stored);
        } else if lz4_flex::block::decompress_into(stored, out).ok()? != out.len() {
            return None;
        }
        rest = behind;
    }
    Some(out)
}

fn zstandard(packed: &[u8], most: usize) -> Option<Vec<u8>> {
    let mut out = Vec::new();
    let decoder = zstd::stream::read::Decoder::new(packed).ok()?;
    decoder.take(most as u64 + 1).read_to_end(&mut out).ok()?;
    (out.len() <= most).then_some(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_are_unpacked_within_their_bound() {
        // One byte, and it 9 times more, which overlap; then two bytes as they are and the first three again.
        let packed = [0, b'a', 0xe0, 0, 0, 1, b'b', b'c', 0x20, 11];
        let expected = b"aaaaaaaaaabcaaa";
        assert_eq!(lzf(&packed, 15).as_deref(), Some(&expected[..]));
        assert_eq!(lzf(&packed, 14), None);
        for end in [1, 3, 4, 7, 9] {
            assert_eq!(lzf(&packed[..end], 100), None, "{end}");
        }
        assert_eq!(lzf(&[0x20, 0], 100), None, "nothing to repeat");

        let content: Vec<u8> = (0..1000_u32).flat_map(|number| (number / 7).to_le_bytes()).chain(*b"xyz").collect();
        let mut framed = [&(content.len() as u64).to_be_bytes()[..], &1024_u32.to_be_bytes()].concat();
        for (number, block) in content.chunks(1024).enumerate() {
            let stored = if number == 1 { block.to_vec() } else { lz4_flex::block::compress(block) };
            framed.extend((stored.len() as u32).to_be_bytes());
            framed.extend(stored);
        }
        assert_eq!(lz4(&framed, content.len()).as_ref(), Some(&content));
        assert_eq!(lz4(&framed, content.len() - 1), None);
        for end in [0, 7, 11, 15, 40, framed.len() - 1] {
            assert_eq!(lz4(&framed[..end], content.len()), None, "{end}");
        }

        let frame = zstd::bulk::compress(&content, 3).unwrap();
        assert_eq!(zstandard(&frame, content.len()).as_ref(), Some(&content));
        assert_eq!(zstandard(&frame, content.len() - 1), None);
        assert_eq!(zstandard(&frame[..frame.len() - 1], content.len()), None);
    }
}
