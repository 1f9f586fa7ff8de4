//! Data sets of any number of axes, as images and volumes are stored.

use super::file::{Attributes, H5, H5Group, MOST_EXPANSION, guard};
use super::records::Records;
use crate::import::ImportError;
use crate::model::SampleType;
use hdf5_reader::{Dataset, Datatype, SliceInfo, SliceInfoElem, StringSize};
use std::ops::Range;
use std::path::PathBuf;

/// How much is read at once, bytes, where rows of chunks are not more.
const SLAB: u64 = 16 << 20;

/// The most that is read at once, bytes; wider rows of chunks are read in parts, and chunks more than once.
const MOST_SLAB: u64 = 256 << 20;

/// The most groups and data sets of a file that are looked at, and how deep.
const MOST_MEMBERS: usize = 10_000;
const DEEPEST: usize = 20;

/// The most values of a coordinate.
const MOST_COORDINATES: u64 = 1 << 24;

/// A data set.
pub(in crate::import) struct Array<'a> {
    file: &'a H5,
    /// Path inside the file, without a leading slash.
    pub label: String,
    /// Length of each axis, the fastest last.
    pub shape: Vec<u64>,
    /// How its numbers are stored; `None` where they are none, or of a type that grids do not have.
    pub sample_type: Option<SampleType>,
    dataset: Dataset,
}

impl H5 {
    /// All data sets, those of a group before those of the groups in it; of a file with a great many the first ones.
    ///
    /// # Errors
    /// When a group cannot be read. What of the data sets is damaged is left out.
    pub(in crate::import) fn arrays(&self) -> Result<Vec<Array<'_>>, ImportError> {
        let mut found = Vec::new();
        let mut addresses = Vec::new();
        let mut waiting = vec![(self.root()?, 0)];
        let mut members = 0;
        while let Some((group, depth)) = waiting.pop() {
            // Links may lead back to a group above.
            if addresses.contains(&group.group.address()) {
                continue;
            }
            addresses.push(group.group.address());
            let (groups, datasets) = group.members()?;
            members += groups.len() + datasets.len();
            if members > MOST_MEMBERS {
                break;
            }
            found.extend(datasets.iter().filter_map(|name| group.array(name).ok()));
            if depth < DEEPEST {
                let inner = groups.iter().rev().filter_map(|name| group.group(name).ok());
                waiting.extend(inner.map(|group| (group, depth + 1)));
            }
        }
        Ok(found)
    }

    /// The data set at a path inside the file; `None` where there is none.
    ///
    /// # Errors
    /// When it, or a group on the way to it, is damaged.
    pub(in crate::import) fn array(&self, path: &str) -> Result<Option<Array<'_>>, ImportError> {
        let path = path.trim_matches('/');
        let (groups, name) = path.rsplit_once('/').unwrap_or(("", path));
        let Some(group) = self.group_at(groups)? else { return Ok(None) };
        if group.members()?.1.iter().any(|other| other == name) { group.array(name).map(Some) } else { Ok(None) }
    }

    /// The group at a path inside the file.
    pub(super) fn group_at(&self, path: &str) -> Result<Option<H5Group<'_>>, ImportError> {
        let mut group = self.root()?;
        for name in path.split('/').filter(|name| !name.is_empty()) {
            if !group.members()?.0.iter().any(|other| other == name) {
                return Ok(None);
            }
            group = group.group(name)?;
        }
        Ok(Some(group))
    }
}

impl<'a> H5Group<'a> {
    /// The data set `name` in this group, which must exist.
    fn array(&self, name: &str) -> Result<Array<'a>, ImportError> {
        let label = self.child(name);
        let dataset = guard(&self.file.path, &label, "a readable data set", || self.group.dataset(name))?;
        let sample_type = match *dataset.dtype() {
            Datatype::FloatingPoint { size, .. } => SampleType::float(size.into()),
            Datatype::FixedPoint { size, signed, .. } => SampleType::whole(size.into(), signed),
            _ => None,
        };
        Ok(Array { file: self.file, label, shape: dataset.shape().to_vec(), sample_type, dataset })
    }
}

impl<'a> Array<'a> {
    /// What its numbers are, in words.
    pub(in crate::import) fn type_in_words(&self) -> String {
        match (self.sample_type, self.dataset.dtype()) {
            (Some(kind), _) => kind.to_string(),
            (_, Datatype::FloatingPoint { size, .. }) => format!("floats of {} bits", 8 * u32::from(*size)),
            (_, Datatype::FixedPoint { size, .. }) => format!("whole numbers of {} bits", 8 * u32::from(*size)),
            (_, Datatype::Enum { .. }) => "names for numbers".into(),
            (_, Datatype::Compound { .. }) => "structures".into(),
            (_, Datatype::String { .. } | Datatype::VarLen { .. }) => "text or lists".into(),
            _ => "no numbers".into(),
        }
    }

    /// Its attributes.
    pub(in crate::import) fn attributes(&self) -> Result<Attributes, ImportError> {
        let path: PathBuf = self.file.path.clone();
        let list = guard(&path, &self.label, "readable attributes", || Ok(self.dataset.attributes()))?;
        Ok(Attributes { path, label: self.label.clone(), list })
    }

    /// The most bytes of values that the file can hold of it.
    pub(in crate::import) fn most_bytes(&self) -> Result<u64, ImportError> {
        Ok(self.file.bytes.saturating_mul(if self.chunks()?.is_some() { MOST_EXPANSION } else { 1 }))
    }

    fn chunks(&self) -> Result<Option<Vec<u32>>, ImportError> {
        guard(&self.file.path, &self.label, "a readable layout", || Ok(self.dataset.chunks()))
    }

    /// Gives all values to `take`, in their order and this machine's byte order, some at a time. Whether the file can hold as many as
    /// the shape says is the caller's to check.
    ///
    /// # Errors
    /// When they cannot be read, are no numbers, or `take` fails.
    pub(in crate::import) fn each(
        &self,
        take: &mut dyn FnMut(&[u8]) -> Result<(), ImportError>,
    ) -> Result<(), ImportError> {
        let rows = self.chunks()?.and_then(|chunks| chunks.first().copied()).unwrap_or(1);
        let mut buffer = Vec::new();
        self.part(&mut Vec::new(), rows.into(), &mut |ranges| {
            buffer.clear();
            self.read(ranges, &mut buffer)?;
            take(&buffer)
        })
    }

    /// Calls `visit` with boxes of which each is in one piece and not too large, below the places that `fixed` has of the first axes.
    /// Along the first of the others as many as a chunk has are taken together, at least.
    fn part(
        &self,
        fixed: &mut Vec<Range<u64>>,
        rows: u64,
        visit: &mut dyn FnMut(&[Range<u64>]) -> Result<(), ImportError>,
    ) -> Result<(), ImportError> {
        let Some(&count) = self.shape.get(fixed.len()) else { return visit(fixed) };
        let size = self.sample_type.map_or(8, SampleType::size) as u64;
        let behind = self.shape.iter().skip(fixed.len() + 1);
        let row = behind.fold(size, |bytes, &count| bytes.saturating_mul(count)).max(1);
        let (is_too_wide, step) = match rows.max(1) {
            rows if rows.saturating_mul(row) <= SLAB => (false, SLAB / row / rows * rows),
            rows if rows.saturating_mul(row) <= MOST_SLAB => (false, rows),
            _ => (row > MOST_SLAB, (SLAB / row).max(1)),
        };
        let (mut start, step) = (0, if is_too_wide { 1 } else { step });
        while start < count {
            let end = count.min(start.saturating_add(step));
            let depth = fixed.len();
            fixed.push(start..end);
            if is_too_wide {
                self.part(fixed, 1, visit)?;
            } else {
                fixed.extend(self.shape.iter().skip(depth + 1).map(|&count| 0..count));
                visit(fixed)?;
            }
            fixed.truncate(depth);
            start = end;
        }
        Ok(())
    }

    /// Appends the values of a box.
    fn read(&self, ranges: &[Range<u64>], out: &mut Vec<u8>) -> Result<(), ImportError> {
        let selections =
            ranges.iter().map(|range| SliceInfoElem::Slice { start: range.start, end: range.end, step: 1 }).collect();
        let slice = SliceInfo { selections };
        macro_rules! read {
            ($number:ty) => {
                guard(&self.file.path, &self.label, "readable values", || {
                    let array = self.dataset.read_slice::<$number>(&slice)?;
                    array.iter().for_each(|value| out.extend_from_slice(&value.to_ne_bytes()));
                    Ok(array.len() as u64)
                })
            };
        }
        let read = match self.sample_type {
            Some(SampleType::I8) => read!(i8),
            Some(SampleType::U8) => read!(u8),
            Some(SampleType::I16) => read!(i16),
            Some(SampleType::U16) => read!(u16),
            Some(SampleType::I32) => read!(i32),
            Some(SampleType::U32) => read!(u32),
            Some(SampleType::I64) => read!(i64),
            Some(SampleType::U64) => read!(u64),
            Some(SampleType::F32) => read!(f32),
            Some(SampleType::F64) => read!(f64),
            None => Ok(0),
        }?;
        let wanted: u64 = ranges.iter().map(|range| range.end - range.start).product();
        if read == wanted {
            Ok(())
        } else {
            let found = format!("{read} values");
            Err(ImportError::malformed(&self.file.path, &*self.label, found, format!("{wanted} values")))
        }
    }

    /// Its records, where it holds a list of them.
    ///
    /// # Errors
    /// When there are more than the file can hold, or members reach beyond their record.
    pub(in crate::import) fn records(&self) -> Result<Option<Records>, ImportError> {
        Records::of(self.file, &self.label, &self.dataset)
    }

    /// The texts of a list of such of fixed length; `None` where it is none, or has more than `most` bytes.
    ///
    /// # Errors
    /// When they cannot be read, or the file cannot hold as many.
    pub(in crate::import) fn texts(&self, most: u64) -> Result<Option<Vec<String>>, ImportError> {
        let (Datatype::String { size: StringSize::Fixed(size), .. }, &[count]) =
            (self.dataset.dtype(), &self.shape[..])
        else {
            return Ok(None);
        };
        let most = most.min(self.most_bytes()?);
        if count.checked_mul(u64::from(*size)).is_none_or(|bytes| bytes > most) {
            return Ok(None);
        }
        guard(&self.file.path, &self.label, "readable texts", || self.dataset.read_strings()).map(Some)
    }

    /// All values of a coordinate of one axis; `None` where it is none, or cannot be read.
    pub(in crate::import) fn coordinates(&self) -> Option<Vec<f64>> {
        let (&[count], Some(kind)) = (&self.shape[..], self.sample_type) else { return None };
        let bytes = count.checked_mul(kind.size() as u64)?;
        if count > MOST_COORDINATES || bytes > self.most_bytes().ok()? {
            return None;
        }
        let mut values = Vec::new();
        self.each(&mut |bytes| {
            kind.decode(bytes, 1, &mut values);
            Ok(())
        })
        .ok()?;
        Some(values)
    }

    /// For each axis the data set of one axis that is attached to it as its scale, where there is one.
    pub(in crate::import) fn scales(&self) -> Vec<Option<Array<'a>>> {
        (0..self.shape.len()).map(|axis| self.scale(axis).ok().flatten()).collect()
    }

    fn scale(&self, axis: usize) -> Result<Option<Array<'a>>, ImportError> {
        let attributes = self.attributes()?;
        let Some(list) = attributes.find("DIMENSION_LIST") else { return Ok(None) };
        let size = self.dataset.vlen_reference_size();
        let Some(reference) = list.raw_data.chunks_exact(size).nth(axis) else { return Ok(None) };
        let resolve = || self.dataset.resolve_vlen_reference_bytes(reference, 8);
        let object = guard(&self.file.path, &self.label, "readable scales", resolve)?;
        let Some(address) = object.first_chunk().map(|address| u64::from_le_bytes(*address)) else { return Ok(None) };
        // Scales are in the same group, or in one above it.
        let mut path = &*self.label;
        while !path.is_empty() {
            path = path.rsplit_once('/').map_or("", |(above, _)| above);
            let Some(group) = self.file.group_at(path)? else { continue };
            let name =
                guard(&self.file.path, &self.label, "readable scales", || group.group.child_name_by_address(address))?;
            if let Some(name) = name {
                return group.array(&name).map(Some);
            }
        }
        Ok(None)
    }
}
