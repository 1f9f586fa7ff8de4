//! Data sets of records (compound types), as columns of their members. Records are read some at a time, those of chunks that are asked for, and
//! the last few are kept: whoever reads one member of them reads others next.

use super::file::{H5, H5Group, MOST_EXPANSION, guard};
use crate::import::ImportError;
use crate::import::bytes::Order;
use crate::import::typed_columns::{Column, decode, whole};
use crate::model::SampleType;
use hdf5_reader::error::Result as Decoded;
use hdf5_reader::{
    ByteOrder, CompoundField, Dataset, Datatype, EnumMember, H5Type, SliceInfo, SliceInfoElem, dtype_element_size,
};
use std::collections::VecDeque;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// How much is read at once, bytes, where a record is not more; in tests little, so that small files have several such slabs.
const SLAB: usize = if cfg!(test) { 1 << 9 } else { 1 << 20 };

/// The most numbers of a record that one member has, where all of it is held.
const MOST_COMPONENTS: usize = 64;

/// A data set of records, one a row.
pub(in crate::import) struct Records {
    path: PathBuf,
    /// Path inside the file, without a leading slash.
    pub label: String,
    /// How many records.
    pub rows: u64,
    /// Members of numbers.
    pub members: Vec<Member>,
    /// Names of the others.
    pub left_out: Vec<String>,
    dataset: Dataset,
    /// Bytes of a record.
    size: usize,
    /// The slabs that were read last, by the row of their first record, the latest at the end.
    last: Mutex<VecDeque<(u64, Record)>>,
}

/// Numbers of each record.
pub(in crate::import) struct Member {
    /// The name in the file.
    pub name: String,
    /// How many they are, at least 1.
    pub components: usize,
    /// Where the first is in a record, and how all are stored.
    first: Column,
}

impl Member {
    /// Whether they are stored as whole numbers.
    pub(in crate::import) fn is_whole(&self) -> bool {
        !self.first.number.is_float()
    }

    fn component(&self, component: usize) -> Column {
        let offset = self.first.offset + (component * self.first.number.size()) as u64;
        Column { offset, ..self.first }
    }
}

/// A record, as one of those that the library reads together.
#[derive(Clone)]
struct Record {
    /// The bytes of all of them.
    block: Arc<[u8]>,
    /// Which of them it is.
    at: usize,
}

impl H5Type for Record {
    fn hdf5_type() -> Datatype {
        Datatype::Opaque { size: 0, tag: String::new() }
    }

    fn from_bytes(bytes: &[u8], _dtype: &Datatype) -> Decoded<Record> {
        Ok(Record { block: bytes.into(), at: 0 })
    }

    fn element_size(dtype: &Datatype) -> usize {
        dtype_element_size(dtype).unwrap_or(0)
    }

    fn decode_vec(raw: &[u8], _dtype: &Datatype, count: usize) -> Option<Decoded<Vec<Record>>> {
        let block: Arc<[u8]> = raw.into();
        Some(Ok((0..count).map(|at| Record { block: Arc::clone(&block), at }).collect()))
    }
}

impl Records {
    /// The records of a data set of a file; `None` where it has none, or more than one axis of them.
    ///
    /// # Errors
    /// When there are more than the file can hold, or members reach beyond their record.
    pub(super) fn of(file: &H5, label: &str, dataset: &Dataset) -> Result<Option<Records>, ImportError> {
        let (Datatype::Compound { size, fields }, &[rows]) = (dataset.dtype(), dataset.shape()) else {
            return Ok(None);
        };
        let (path, size) = (&file.path, *size as usize);
        let chunked = guard(path, label, "a readable layout", || Ok(dataset.chunks().is_some()))?;
        let most = file.bytes.saturating_mul(if chunked { MOST_EXPANSION } else { 1 });
        if size == 0 || rows.checked_mul(size as u64).is_none_or(|wanted| wanted > most) {
            let found = format!("{rows} records of {size} bytes");
            let expected = format!("no more than a file of {} bytes can hold", file.bytes);
            return Err(ImportError::malformed(path, label, found, expected));
        }
        let (mut members, mut left_out) = (Vec::new(), Vec::new());
        for CompoundField { name, byte_offset, datatype } in fields {
            let Some((number, order, components)) = numbers(datatype) else {
                left_out.push(name.clone());
                continue;
            };
            let begin = *byte_offset as usize;
            let end = components.checked_mul(number.size()).and_then(|bytes| bytes.checked_add(begin));
            if end.is_none_or(|end| end > size) {
                let found = format!("{components} x {number} from byte {begin} on");
                let expected = format!("a place in the {size} of a record");
                return Err(ImportError::malformed(path, format!("{label}: {name}"), found, expected));
            }
            let first = Column { storage: 0, offset: begin as u64, stride: size as u64, number, order };
            members.push(Member { name: name.clone(), components, first });
        }
        let (label, dataset) = (label.to_owned(), dataset.clone());
        let last = Mutex::default();
        Ok(Some(Records { path: path.clone(), label, rows, members, left_out, dataset, size, last }))
    }

    /// The rows of the slab that a record is in, which are read together.
    pub(in crate::import) fn slab(&self, row: u64) -> Range<u64> {
        let step = (SLAB / self.size.max(1)).max(1) as u64;
        let start = row / step * step;
        start..self.rows.min(start.saturating_add(step))
    }

    /// Calls `take` with the bytes of the records `rows`, some at a time, and where these begin among them.
    fn each(&self, rows: Range<u64>, mut take: impl FnMut(usize, &[u8])) -> Result<(), ImportError> {
        let mut at = rows.start;
        while at < rows.end {
            let slab = self.slab(at);
            if at >= slab.end {
                let found = format!("records to {}", rows.end);
                return Err(ImportError::malformed(&self.path, &*self.label, found, self.rows.to_string()));
            }
            let (first, end) = (self.first_of(slab.clone())?, rows.end.min(slab.end));
            // They follow each other in one block, which was found to have all of the slab.
            let [from, until] = [at, end].map(|row| (first.at + (row - slab.start) as usize) * self.size);
            take((at - rows.start) as usize, first.block.get(from..until).unwrap_or_default());
            at = end;
        }
        Ok(())
    }

    /// The first record of a slab, with the block that has all of it.
    fn first_of(&self, slab: Range<u64>) -> Result<Record, ImportError> {
        let kept = kept(&mut self.last(), slab.start);
        if let Some(first) = kept {
            return Ok(first);
        }
        let Range { start, end } = slab;
        let count = (end - start) as usize;
        let slice = SliceInfo { selections: vec![SliceInfoElem::Slice { start, end, step: 1 }] };
        let (found, first) = guard(&self.path, &self.label, "readable records", || {
            let records = self.dataset.read_slice::<Record>(&slice)?;
            Ok((records.len(), records.iter().next().cloned()))
        })?;
        let is_whole = |first: &Record| found == count && first.block.len() >= (first.at + count) * self.size;
        let Some(first) = first.filter(is_whole) else {
            let (found, expected) = (format!("{found} records"), format!("{count} records"));
            return Err(ImportError::malformed(&self.path, &*self.label, found, expected));
        };
        let mut last = self.last();
        last.push_back((start, first.clone()));
        // One for each thread, and one more for those who begin another.
        if last.len() > rayon::current_num_threads() + 1 {
            last.pop_front();
        }
        Ok(first)
    }

    /// The slabs that were read last, which are whole whatever a thread that held them did.
    fn last(&self) -> MutexGuard<'_, VecDeque<(u64, Record)>> {
        self.last.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Reads the components `components` of a member, record by record, of the records `rows` into `out`.
    ///
    /// # Errors
    /// When the file cannot be read there.
    pub(in crate::import) fn read(
        &self,
        member: usize,
        components: Range<usize>,
        rows: Range<u64>,
        out: &mut [f64],
    ) -> Result<(), ImportError> {
        let (member, width) = (&self.members[member], components.len().max(1));
        self.each(rows, |row, bytes| {
            for (place, column) in components.clone().map(|component| member.component(component)).enumerate() {
                let bytes = bytes.get(column.offset as usize..).unwrap_or_default();
                decode(&column, bytes, out.iter_mut().skip(row * width + place).step_by(width), |number| number);
            }
        })
    }

    /// Reads one component of whole numbers exactly. Negative ones become what their bits mean without a sign.
    ///
    /// # Errors
    /// As [`Records::read`].
    pub(in crate::import) fn read_whole(
        &self,
        member: usize,
        component: usize,
        rows: Range<u64>,
        out: &mut [u64],
    ) -> Result<(), ImportError> {
        let column = self.members[member].component(component);
        self.each(rows, |row, bytes| {
            let bytes = bytes.get(column.offset as usize..).unwrap_or_default();
            whole(&column, bytes, out.iter_mut().skip(row));
        })
    }
}

/// The first record of the slab that begins at a row, where it is one of those that were read last, of which it is the latest from now on.
fn kept(last: &mut VecDeque<(u64, Record)>, start: u64) -> Option<Record> {
    let at = last.iter().position(|(other, _)| *other == start)?;
    let (_, first) = last.remove(at)?;
    last.push_back((start, first.clone()));
    Some(first)
}

/// Numbers of a record and all records' values, row by row.
pub(super) type Values = (usize, Vec<f64>);

impl H5Group<'_> {
    /// Whether a data set of this group, which must exist, holds records.
    pub(super) fn holds_records(&self, name: &str) -> bool {
        let dataset = guard(&self.file.path, name, "a readable data set", || self.group.dataset(name));
        dataset.is_ok_and(|dataset| matches!(dataset.dtype(), Datatype::Compound { .. }))
    }

    /// The names of the members of the records of the data set `name` that [`H5Group::members_of_records`] reads; none of one without records.
    pub(super) fn names_of_members(&self, name: &str) -> Result<Vec<String>, ImportError> {
        let (path, label) = (&self.file.path, self.child(name));
        let dataset = guard(path, &label, "a readable data set", || self.group.dataset(name))?;
        let records = Records::of(self.file, &label, &dataset)?;
        let members = records.into_iter().flat_map(|records| records.members);
        Ok(members.filter(|member| member.components <= MOST_COMPONENTS).map(|member| member.name).collect())
    }

    /// Members of the records of the data set `name`, in the order of `members`: `None` for one that it does not have, or that is no number.
    /// `None` altogether of a data set without records.
    pub(super) fn members_of_records(
        &self,
        name: &str,
        members: &[&str],
        most: u64,
    ) -> Result<Option<Vec<Option<Values>>>, ImportError> {
        let (path, label) = (&self.file.path, self.child(name));
        let dataset = guard(path, &label, "a readable data set", || self.group.dataset(name))?;
        let Some(records) = Records::of(self.file, &label, &dataset)? else { return Ok(None) };
        if records.rows > most {
            let found = format!("{} records", records.rows);
            return Err(ImportError::malformed(path, label, found, format!("at most {most}")));
        }
        let values = |name: &&str| -> Result<Option<Values>, ImportError> {
            let is_meant = |member: &Member| member.name == **name && member.components <= MOST_COMPONENTS;
            let Some(place) = records.members.iter().position(is_meant) else { return Ok(None) };
            let components = records.members[place].components;
            let mut values = vec![0.0; records.rows as usize * components];
            records.read(place, 0..components, 0..records.rows, &mut values)?;
            Ok(Some((components, values)))
        };
        members.iter().map(values).collect::<Result<Vec<_>, ImportError>>().map(Some)
    }
}

/// How the numbers of a member are stored, in which order of bytes, and how many they are; `None` where they are none.
fn numbers(datatype: &Datatype) -> Option<(SampleType, Order, usize)> {
    match datatype {
        Datatype::Array { base, dims } => {
            let (number, order, own) = numbers(base)?;
            let count = dims.iter().try_fold(own, |count, size| count.checked_mul(usize::try_from(*size).ok()?))?;
            (count > 0).then_some((number, order, count))
        }
        Datatype::FloatingPoint { size, byte_order } => {
            Some((SampleType::float((*size).into())?, order(*byte_order), 1))
        }
        Datatype::FixedPoint { size, signed, byte_order } => {
            Some((SampleType::whole((*size).into(), *signed)?, order(*byte_order), 1))
        }
        // Truth values, as PyTables has them, and as h5py.
        Datatype::Bitfield { size: 1, .. } => Some((SampleType::U8, Order::NATIVE, 1)),
        Datatype::Enum { base, members } if are_truth(members) => numbers(base),
        _ => None,
    }
}

fn order(order: ByteOrder) -> Order {
    match order {
        ByteOrder::LittleEndian => Order::Little,
        ByteOrder::BigEndian => Order::Big,
    }
}

/// Whether names for numbers are those of 0 and 1 as truth values.
fn are_truth(members: &[EnumMember]) -> bool {
    let names: Vec<&str> = members.iter().map(|member| &*member.name).collect();
    names == ["FALSE", "TRUE"]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::ReadMethod;
    use std::path::Path;

    #[test]
    fn any_range_of_any_member_is_what_the_file_has_there() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/others");
        // Without chunks, and in chunks of 7.
        for (name, label) in [("h5py-records.hdf5", "a group/stars"), ("tables.h5", "particles")] {
            let file = H5::open(&folder.join(name), ReadMethod::default()).unwrap();
            let array = file.array(label).unwrap().unwrap();
            let records = array.records().unwrap().unwrap();
            assert!(records.slab(0).end < records.rows && records.slab(records.rows - 1).end == records.rows, "{name}");
            let bytes = records.dataset.read_raw_bytes().unwrap();
            for (place, member) in records.members.iter().enumerate() {
                let mut all = vec![0.0; records.rows as usize * member.components];
                for component in 0..member.components {
                    let column = member.component(component);
                    let out = all.iter_mut().skip(component).step_by(member.components);
                    decode(&column, &bytes[column.offset as usize..], out, |number| number);
                }
                for start in 0..records.rows {
                    for end in start..=records.rows {
                        let expected = &all[start as usize * member.components..end as usize * member.components];
                        let mut some = vec![-1.0; expected.len()];
                        records.read(place, 0..member.components, start..end, &mut some).unwrap();
                        assert_eq!(some, expected, "{name}: {} {start}..{end}", member.name);
                    }
                }
            }
            let told = records.read(0, 0..1, 23..25, &mut [0.0; 2]).unwrap_err().to_string();
            assert!(told.contains("found records to 25, expected 24"), "{told}");
        }
    }
}
