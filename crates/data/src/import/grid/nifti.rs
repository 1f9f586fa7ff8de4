//! NIfTI-1 and NIfTI-2 (<https://nifti.nimh.nih.gov/nifti-1>, <https://nifti.nimh.nih.gov/nifti-2>), in one file or as a pair. The
//! world is RAS: x to the right, y to the front, z upwards.

use super::content::Content;
use super::layout::{Layout, PLANAR};
use super::source::checked;
use super::{GridDescription, GridFormat, GridSource};
use crate::import::ImportError;
use crate::import::bytes::Order;
use crate::model::{Channel, Grid, ReadMethod, SampleType, Scale, Unit};
use glam::{DAffine3, DMat3, DVec3};
use std::path::{Path, PathBuf};

/// NIfTI of both versions.
pub(super) const NIFTI: GridFormat = GridFormat {
    name: "nifti",
    extensions: &["nii", "hdr", "img"],
    has_parts: false,
    detect: |content| Version::of(&content.head).is_some() || header_of(content).is_some(),
    open,
};

/// Where the fields of a header are.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Version {
    is_second: bool,
    order: Order,
}

impl Version {
    /// The version of a header that begins so: its own size stands first, and a magic word in it.
    fn of(head: &[u8]) -> Option<Version> {
        let is = |at: usize, words: [&[u8]; 2]| words.iter().any(|word| head.get(at..at + 3) == Some(*word));
        Order::BOTH.into_iter().find_map(|order| match order.u32(head, 0) {
            348 if is(344, [b"n+1", b"ni1"]) => Some(Version { is_second: false, order }),
            540 if is(4, [b"n+2", b"ni2"]) => Some(Version { is_second: true, order }),
            _ => None,
        })
    }

    /// Whether the samples are in a file of their own.
    fn is_pair(self, head: &[u8]) -> bool {
        let magic = if self.is_second { head.get(4..7) } else { head.get(344..347) };
        magic.is_some_and(|magic| magic.starts_with(b"ni"))
    }

    fn size(self) -> usize {
        if self.is_second { 540 } else { 348 }
    }

    fn short(self, head: &[u8], at: usize) -> i16 {
        let bytes = head.get(at..at + 2).and_then(|bytes| bytes.try_into().ok()).unwrap_or_default();
        if self.order == Order::Little { i16::from_le_bytes(bytes) } else { i16::from_be_bytes(bytes) }
    }

    /// A whole number of `dim`.
    fn dim(self, head: &[u8], index: usize) -> i64 {
        if self.is_second {
            self.order.f64(head, 16 + 8 * index).to_bits() as i64
        } else {
            self.short(head, 40 + 2 * index).into()
        }
    }

    fn datatype(self, head: &[u8]) -> i16 {
        self.short(head, if self.is_second { 12 } else { 70 })
    }

    /// Floats that follow each other.
    fn floats<const N: usize>(self, head: &[u8], first: usize, second: usize) -> [f64; N] {
        std::array::from_fn(|index| match self.is_second {
            false => f32::from_bits(self.order.u32(head, first + 4 * index)).into(),
            true => self.order.f64(head, second + 8 * index),
        })
    }

    /// The byte at which samples begin.
    fn offset(self, head: &[u8]) -> f64 {
        match self.is_second {
            false => f32::from_bits(self.order.u32(head, 108)).into(),
            true => self.order.f64(head, 168).to_bits() as i64 as f64,
        }
    }

    /// A whole number of two bytes in the first version, of four in the second.
    fn code(self, head: &[u8], first: usize, second: usize) -> i32 {
        if self.is_second { self.order.u32(head, second) as i32 } else { self.short(head, first).into() }
    }
}

/// The header that belongs to a file of samples.
fn header_of(content: &Content) -> Option<PathBuf> {
    let name = content.path.file_name()?.to_str()?;
    let base = name.strip_suffix(".gz").unwrap_or(name).strip_suffix(".img")?;
    let candidates = ["hdr", "hdr.gz"].map(|end| content.path.with_file_name(format!("{base}.{end}")));
    candidates.into_iter().find(|path| {
        path.is_file()
            && Content::open(path, ReadMethod::Positioned).is_ok_and(|header| Version::of(&header.head).is_some())
    })
}

/// The file of samples that belongs to a header.
fn samples_of(header: &Path) -> Option<PathBuf> {
    let name = header.file_name()?.to_str()?;
    let base = name.strip_suffix(".gz").unwrap_or(name);
    let base = base.strip_suffix(".hdr").unwrap_or(base);
    let candidates = ["img", "img.gz"].map(|end| header.with_file_name(format!("{base}.{end}")));
    candidates.into_iter().find(|path| path.is_file())
}

fn open(content: &Content) -> Result<GridSource, ImportError> {
    if Version::of(&content.head).is_none()
        && let Some(header) = header_of(content)
    {
        return open(&Content::open(&header, content.method())?);
    }
    let (path, head) = (&*content.path, &content.head[..]);
    let version = Version::of(head).ok_or_else(|| ImportError::missing(path, "magic", "n+1, ni1, n+2 or ni2"))?;
    if head.len() < version.size() {
        let found = format!("{} bytes", head.len());
        return Err(ImportError::malformed(path, "header", found, format!("{}", version.size())));
    }
    let kind = sample_type(path, version.datatype(head))?;
    let (grid, notes) = grid(path, head, version, kind)?;
    let bytes = checked(path, &grid, "dim", "sform, qform or pixdim")?;
    let stated = version.offset(head);
    let offset = Some(stated).filter(|stated| stated.fract() == 0.0 && (0.0..9e15).contains(stated));
    let offset = offset.ok_or_else(|| ImportError::malformed(path, "vox_offset", stated, "a number of bytes"))? as u64;
    let mut about = GridDescription::new(path, NIFTI.name, content.length, grid);
    about.notes = notes;
    let (storage, is_packed) = if version.is_pair(head) {
        let missing = || ImportError::missing(path, "samples", "a file .img beside the header");
        let data = Content::open(&samples_of(path).ok_or_else(missing)?, content.method())?;
        about.files = 2;
        about.bytes += data.length;
        (data.samples(offset, bytes, &about.grid)?, data.is_packed)
    } else {
        (content.samples(offset.max(version.size() as u64), bytes, &about.grid)?, content.is_packed)
    };
    let offset = match (is_packed, version.is_pair(head)) {
        (true, _) => 0,
        (false, true) => offset,
        (false, false) => offset.max(version.size() as u64),
    };
    let layout = Layout::packed(&about.grid, PLANAR, offset, version.order);
    Ok(GridSource::new(about, storage, layout))
}

/// The type of samples of a code.
fn sample_type(path: &Path, code: i16) -> Result<SampleType, ImportError> {
    let name = match code {
        2 => return Ok(SampleType::U8),
        4 => return Ok(SampleType::I16),
        8 => return Ok(SampleType::I32),
        16 => return Ok(SampleType::F32),
        64 => return Ok(SampleType::F64),
        256 => return Ok(SampleType::I8),
        512 => return Ok(SampleType::U16),
        768 => return Ok(SampleType::U32),
        1024 => return Ok(SampleType::I64),
        1280 => return Ok(SampleType::U64),
        1 => " (single bits)",
        32 | 1792 | 2048 => " (complex numbers)",
        128 => " (RGB24 volumes)",
        1536 => " (floats of 128 bits)",
        2304 => " (RGBA32 volumes)",
        _ => "",
    };
    Err(ImportError::malformed(path, "datatype", format!("{code}{name}"), "a scalar type"))
}

/// The grid of a header, and what was assumed.
fn grid(path: &Path, head: &[u8], version: Version, kind: SampleType) -> Result<(Grid, Vec<String>), ImportError> {
    let count = version.dim(head, 0);
    let sizes: Vec<i64> = (1..=count.clamp(0, 7) as usize).map(|axis| version.dim(head, axis)).collect();
    let wrong = || {
        let sizes = sizes.iter().map(i64::to_string).collect::<Vec<_>>().join(" x ");
        ImportError::malformed(path, "dim", format!("{count} axes {sizes}"), "2 to 7 axes of at least 1 sample")
    };
    if !(2..=7).contains(&count) || sizes.iter().any(|size| *size < 1) {
        return Err(wrong());
    }
    let size = |axis: usize| sizes.get(axis).map_or(1, |&size| size as u64);
    // Times, echoes and components are values of one place.
    let values = (3..7).map(size).try_fold(1_u64, u64::checked_mul).filter(|values| *values <= 4096);
    let values = values.ok_or_else(|| ImportError::malformed(path, "dim", count, "at most 4096 values at a place"))?;
    let mut channels = Channel::numbered(values);
    let [slope, intercept] = version.floats(head, 112, 176);
    if slope.is_finite() && intercept.is_finite() && slope != 0.0 {
        channels.iter_mut().for_each(|channel| channel.scale = Scale { slope, intercept });
    }
    let mut grid = Grid::volume([size(0), size(1), size(2)], kind, channels);
    let mut notes = Vec::new();
    if values > 1 {
        notes.push(format!("{values} values at each place: the axes behind the third"));
    }
    let unit = version.code(head, if version.is_second { 0 } else { 123 }, 500);
    // In the first version these are single bytes.
    let unit = if version.is_second { unit } else { head.get(123).map_or(0, |&byte| i32::from(byte)) };
    grid.length_unit = Unit::new(match unit & 7 {
        1 => "m",
        2 => "mm",
        3 => "um",
        _ => "",
    });
    let sform = version.code(head, 254, 348);
    let qform = version.code(head, 252, 344);
    grid.to_world = if sform > 0 {
        let rows: [f64; 12] = version.floats(head, 280, 400);
        let row = |at: usize| DVec3::new(rows[at], rows[at + 1], rows[at + 2]);
        let matrix = DMat3::from_cols(row(0), row(4), row(8)).transpose();
        DAffine3::from_mat3_translation(matrix, DVec3::new(rows[3], rows[7], rows[11]))
    } else {
        let steps: [f64; 4] = version.floats(head, 76, 104);
        if qform > 0 {
            turned(version.floats(head, 256, 352), steps)
        } else {
            notes.push("neither sform nor qform: axes are x, y and z".into());
            DAffine3::from_scale(DVec3::new(
                steps[1],
                steps[2],
                if size(2) == 1 && steps[3] == 0.0 { 1.0 } else { steps[3] },
            ))
        }
    };
    Ok((grid, notes))
}

/// The map of a quaternion `b, c, d`, an offset, and `pixdim`, whose first number is the handedness.
fn turned([b, c, d, x, y, z]: [f64; 6], [handed, dx, dy, dz]: [f64; 4]) -> DAffine3 {
    let a = (1.0 - b * b - c * c - d * d).max(0.0).sqrt();
    let matrix = DMat3::from_cols(
        DVec3::new(a * a + b * b - c * c - d * d, 2.0 * (b * c + a * d), 2.0 * (b * d - a * c)) * dx,
        DVec3::new(2.0 * (b * c - a * d), a * a + c * c - b * b - d * d, 2.0 * (c * d + a * b)) * dy,
        DVec3::new(2.0 * (b * d + a * c), 2.0 * (c * d - a * b), a * a + d * d - b * b - c * c)
            * if handed < 0.0 { -dz } else { dz },
    );
    DAffine3::from_mat3_translation(matrix, DVec3::new(x, y, z))
}
