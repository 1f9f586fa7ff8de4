//! Arrays that are compressed by tiles, each as a row of a table (section 10 of the standard): Rice and gzip.

use super::super::content::{MOST_EXPANSION, in_one_line, too_few};
use super::super::layout::{Layout, NATIVE, PLANAR};
use super::super::scratch::Scratch;
use super::super::source::checked;
use super::super::{GridDescription, GridSource};
use super::columns::Column;
use super::dither::Dither;
use super::{FITS, Header, described, rice};
use crate::import::ImportError;
use crate::import::bytes::RangeFile;
use crate::model::{Grid, SampleType};
use flate2::read::MultiGzDecoder;
use std::io::Read;

/// The most bytes of a row of the table.
const MOST_ROW: u64 = 1 << 16;

/// How tiles are compressed.
#[derive(Clone, Copy, PartialEq)]
enum Coding {
    Rice,
    Gzip,
    /// The first bytes of all numbers come first, then the second ones.
    ShuffledGzip,
}

/// A table of tiles.
struct Tiles<'a> {
    header: &'a Header<'a>,
    file: RangeFile,
    /// Samples along each axis, of the array and of a tile.
    shape: [u64; 3],
    tile: [u64; 3],
    coding: Coding,
    /// Bytes of a coded number and numbers of a block, of Rice.
    rice: (usize, usize),
    kind: SampleType,
    row: u64,
    data: Column,
    /// What is stored where the coding is none for a tile: gzip of floats, and bytes as they are.
    gzip: Option<Column>,
    plain: Option<Column>,
    scale: Option<(Column, Column)>,
    blank: Option<i32>,
    dither: Option<Dither>,
    heap: u64,
    heap_bytes: u64,
}

/// Opens the array of a header that says it is one of tiles; `axes` are its own.
///
/// # Errors
/// What is wrong with the table or a tile.
pub(super) fn open(header: &Header, axes: &[u64]) -> Result<GridSource, ImportError> {
    let content = header.content;
    let path = &*content.path;
    let grid = described(header, "ZBITPIX", axes)?;
    let bytes = checked(path, &grid, "ZNAXIS", "ZNAXIS")?;
    let most = content.length.saturating_mul(MOST_EXPANSION);
    if bytes > most {
        return Err(too_few(path, &format!("at most {most} bytes"), bytes, &grid));
    }
    let tiles = Tiles::read(header, &grid)?;
    let mut scratch = Scratch::new(path);
    tiles.each(&mut |samples| scratch.write(samples))?;
    let layout = Layout::packed(&grid, PLANAR, 0, NATIVE);
    let mut about = GridDescription::new(path, FITS.name, content.length, grid);
    if tiles.scale.is_some() {
        about.notes.push("floats were rounded to steps when they were compressed".into());
    }
    Ok(GridSource::new(about, scratch.into_storage()?, layout))
}

impl<'a> Tiles<'a> {
    fn read(header: &'a Header<'a>, grid: &Grid) -> Result<Tiles<'a>, ImportError> {
        let path = &*header.content.path;
        let coding = header.needed("ZCMPTYPE", "RICE_1, GZIP_1 or GZIP_2")?;
        let coding = match coding.text {
            "RICE_1" | "RICE_ONE" => Coding::Rice,
            "GZIP_1" => Coding::Gzip,
            "GZIP_2" => Coding::ShuffledGzip,
            _ => return Err(coding.wrong("RICE_1, GZIP_1 or GZIP_2")),
        };
        let kind = grid.sample_type;
        // By default a tile is a row.
        let mut tile = [grid.shape[0], 1, 1];
        for (axis, side) in tile.iter_mut().enumerate() {
            let name = format!("ZTILE{}", axis + 1);
            let stated = header.entry(&name).map(|entry| entry.value::<u64>("a number of samples")).transpose()?;
            let wrong = || ImportError::malformed(path, &*name, stated.unwrap_or_default(), "at least 1");
            *side = Some(stated.unwrap_or(*side)).filter(|side| *side > 0).ok_or_else(wrong)?.min(grid.shape[axis]);
        }
        let size = if kind.is_float() { 4 } else { kind.size() };
        let mut rice = (size, 32);
        for number in 1..=9 {
            let names = [format!("ZNAME{number}"), format!("ZVAL{number}")];
            let value = || header.needed(&names[1], "a number")?.value::<usize>("a number");
            match header.entry(&names[0]).map(|entry| entry.text) {
                Some("BLOCKSIZE") => rice.1 = value()?,
                Some("BYTEPIX") => rice.0 = value()?,
                _ => {}
            }
        }
        if coding == Coding::Rice && !([1, 2, 4].contains(&rice.0) && (1..=1 << 16).contains(&rice.1)) {
            let found = format!("{} bytes in blocks of {}", rice.0, rice.1);
            return Err(ImportError::malformed(path, "ZVAL", found, "1, 2 or 4 bytes in blocks of 1 to 65536"));
        }
        let row = u64::try_from(header.whole("NAXIS1", 0)?).unwrap_or_default();
        let rows = u64::try_from(header.whole("NAXIS2", 0)?).unwrap_or_default();
        let counts = [0, 1, 2].map(|axis| grid.shape[axis].div_ceil(tile[axis]));
        let count = counts.iter().try_fold(1_u64, |all, count| all.checked_mul(*count));
        if count != Some(rows) || row > MOST_ROW {
            let expected =
                format!("{} x {} x {} tiles in rows of at most {MOST_ROW} bytes", counts[0], counts[1], counts[2]);
            return Err(ImportError::malformed(path, "NAXIS2", format!("{rows} rows of {row} bytes"), expected));
        }
        let column = |name: &str| Column::of(header, name, row);
        let data = column("COMPRESSED_DATA")?;
        let data = data.ok_or_else(|| ImportError::missing(path, "COMPRESSED_DATA", "a column of this name"))?;
        let scale = column("ZSCALE")?.zip(column("ZZERO")?).filter(|_| kind.is_float());
        let whole = |name: &str| header.entry(name).map(|entry| entry.value("a whole number")).transpose();
        let file = RangeFile::of(path, header.content.file()?, header.content.method())?;
        let gap = header.whole("THEAP", i64::try_from(row.saturating_mul(rows)).unwrap_or(i64::MAX))?;
        let heap = u64::try_from(gap).ok().and_then(|gap| gap.checked_add(header.end));
        let heap = heap.ok_or_else(|| ImportError::malformed(path, "THEAP", gap, "a number of bytes"))?;
        Ok(Tiles {
            header,
            heap_bytes: file.length.saturating_sub(heap),
            file,
            shape: grid.shape,
            tile,
            coding,
            rice,
            kind,
            row,
            data,
            gzip: column("GZIP_COMPRESSED_DATA")?,
            plain: column("UNCOMPRESSED_DATA")?,
            scale,
            blank: if kind.is_float() { whole("ZBLANK")? } else { None },
            dither: scale.and_then(|_| Dither::of(header.entry("ZQUANTIZ")?.text, header.whole("ZDITHER0", 1).ok()?)),
            heap,
        })
    }

    /// Gives all samples to `take`, in their order and this machine's byte order, some at a time.
    fn each(&self, take: &mut dyn FnMut(&[u8]) -> Result<(), ImportError>) -> Result<(), ImportError> {
        let [width, height, depth] = self.shape;
        let size = self.kind.size() as u64;
        let counts = [0, 1, 2].map(|axis| self.shape[axis].div_ceil(self.tile[axis]));
        // Slices at a time, where tiles have several; else as many rows as they have.
        let rows = if self.tile[2] == 1 { self.tile[1] } else { height };
        let mut band = Vec::new();
        for tile_z in 0..counts[2] {
            let slices = self.tile[2].min(depth - tile_z * self.tile[2]);
            for first in (0..height).step_by(usize::try_from(rows).unwrap_or(usize::MAX)) {
                let rows = rows.min(height - first);
                band.clear();
                band.resize(usize::try_from(width * rows * slices * size).unwrap_or(usize::MAX), 0);
                for tile_y in first / self.tile[1]..(first + rows).div_ceil(self.tile[1]) {
                    for tile_x in 0..counts[0] {
                        let number = tile_x + counts[0] * (tile_y + counts[1] * tile_z);
                        let start = [tile_x * self.tile[0], tile_y * self.tile[1]];
                        let extent = [self.tile[0].min(width - start[0]), self.tile[1].min(height - start[1]), slices];
                        let samples = self.tile(number, extent)?;
                        let lines = samples.chunks_exact((extent[0] * size) as usize);
                        for (line, samples) in (0..).zip(lines) {
                            let (y, z) = (line % extent[1] + start[1] - first, line / extent[1]);
                            let at = ((start[0] + width * (y + rows * z)) * size) as usize;
                            if let Some(place) = band.get_mut(at..at + samples.len()) {
                                place.copy_from_slice(samples);
                            }
                        }
                    }
                }
                take(&band)?;
            }
        }
        Ok(())
    }

    /// The samples of a tile, in this machine's byte order.
    fn tile(&self, number: u64, extent: [u64; 3]) -> Result<Vec<u8>, ImportError> {
        let field = format!("tile {}", number + 1);
        let count = usize::try_from(extent.iter().product::<u64>()).unwrap_or(usize::MAX);
        let size = self.kind.size();
        let mut row = vec![0; self.row as usize];
        self.file.read(self.header.end + number * self.row, &mut row, &field)?;
        let wrong = |found: String, expected: String| ImportError::malformed(&self.file.path, &*field, found, expected);
        let few = |found: usize| wrong(format!("{found} bytes"), format!("{}", count * size));
        let code = self.bytes(&row, self.data, &field)?;
        // A tile that the coding does not suit is in another column.
        let stored = |column: Option<Column>| match column {
            Some(column) if code.is_empty() => self.bytes(&row, column, &field),
            _ => Ok(Vec::new()),
        };
        let plain = stored(self.plain)?;
        if !plain.is_empty() {
            let found = plain.len();
            return native(plain, size, false).filter(|plain| plain.len() == count * size).ok_or_else(|| few(found));
        }
        let gzip = stored(self.gzip)?;
        if !gzip.is_empty() {
            return native(unpacked(&gzip, count * size).map_err(|text| wrong(text, "gzip".into()))?, size, false)
                .filter(|samples| samples.len() == count * size)
                .ok_or_else(|| few(0));
        }
        let is_rounded = self.scale.is_some();
        if self.coding != Coding::Rice {
            let size = if is_rounded { 4 } else { size };
            let samples = unpacked(&code, count * size).map_err(|text| wrong(text, "gzip".into()))?;
            let found = samples.len();
            let samples = native(samples, size, self.coding == Coding::ShuffledGzip);
            let samples = samples.filter(|samples| samples.len() == count * size).ok_or_else(|| few(found))?;
            if !is_rounded {
                return Ok(samples);
            }
            let steps = samples.as_chunks().0.iter().map(|bytes| i32::from_ne_bytes(*bytes)).collect::<Vec<i32>>();
            return self.floats(&row, &steps, number);
        }
        let (width, block) = self.rice;
        let steps = rice::decoded(&code, width, block, count);
        let steps =
            steps.ok_or_else(|| wrong(format!("{} bytes", code.len()), format!("a Rice code of {count} numbers")))?;
        if is_rounded {
            return self.floats(&row, &steps, number);
        }
        let put = |step: &i32| match size {
            1 => (*step as u8).to_ne_bytes().to_vec(),
            2 => (*step as i16).to_ne_bytes().to_vec(),
            4 if !self.kind.is_float() => step.to_ne_bytes().to_vec(),
            _ => Vec::new(),
        };
        let samples: Vec<u8> = steps.iter().flat_map(put).collect();
        if samples.len() == count * size {
            Ok(samples)
        } else {
            Err(wrong(format!("Rice codes of {}", self.kind), "whole numbers of 8 to 32 bits".into()))
        }
    }

    /// What a column of lists holds for a row.
    fn bytes(&self, row: &[u8], column: Column, field: &str) -> Result<Vec<u8>, ImportError> {
        let word = |at: usize, size: usize| -> u64 {
            row.get(at..at + size).unwrap_or_default().iter().fold(0, |number, byte| number << 8 | u64::from(*byte))
        };
        let size = if column.letter == b'Q' { 8 } else { 4 };
        let (count, start) = (word(column.at, size), word(column.at + size, size));
        let end = start.checked_add(count).filter(|end| *end <= self.heap_bytes);
        if end.is_none() {
            let found = format!("{count} bytes from byte {start} on");
            let expected = format!("a part of the heap of {} bytes", self.heap_bytes);
            return Err(ImportError::malformed(&self.file.path, field, found, expected));
        }
        let mut bytes = vec![0; count as usize];
        self.file.read(self.heap + start, &mut bytes, field)?;
        Ok(bytes)
    }

    /// Floats of the steps that they were rounded to.
    fn floats(&self, row: &[u8], steps: &[i32], number: u64) -> Result<Vec<u8>, ImportError> {
        let float = |column: Column| -> f64 {
            let bytes = row.get(column.at..column.at + 8).and_then(|bytes| bytes.try_into().ok());
            f64::from_be_bytes(bytes.unwrap_or_default())
        };
        let Some((scale, zero)) = self.scale.map(|(scale, zero)| (float(scale), float(zero))) else {
            return Ok(Vec::new());
        };
        let mut noise = self.dither.as_ref().map(|dither| dither.of_tile(number));
        let mut samples = Vec::with_capacity(steps.len() * self.kind.size());
        for step in steps {
            let moved = noise.as_mut().map_or(0.0, |noise| 0.5 - noise.next());
            let value = match self.dither.as_ref() {
                _ if self.blank == Some(*step) => f64::NAN,
                Some(dither) if dither.is_zero(*step) => 0.0,
                _ => (f64::from(*step) + moved) * scale + zero,
            };
            match self.kind {
                SampleType::F32 => samples.extend_from_slice(&(value as f32).to_ne_bytes()),
                _ => samples.extend_from_slice(&value.to_ne_bytes()),
            }
        }
        Ok(samples)
    }
}

/// Unpacks at most `most` bytes and one more.
fn unpacked(code: &[u8], most: usize) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    let read = MultiGzDecoder::new(code).take(most as u64 + 1).read_to_end(&mut bytes);
    read.map(|_| bytes).map_err(|error| in_one_line(&error))
}

/// Big-endian numbers in this machine's byte order; `None` where there is a part of one.
fn native(bytes: Vec<u8>, size: usize, is_shuffled: bool) -> Option<Vec<u8>> {
    let count = bytes.len() / size.max(1);
    if count * size != bytes.len() {
        return None;
    }
    let mut ordered = if is_shuffled {
        (0..count).flat_map(|index| bytes.iter().skip(index).step_by(count).copied()).collect()
    } else {
        bytes
    };
    if cfg!(target_endian = "little") {
        ordered.chunks_exact_mut(size).for_each(<[u8]>::reverse);
    }
    Some(ordered)
}
