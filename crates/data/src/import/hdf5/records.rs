//! Data sets of records (compound types), as columns of their members.

use super::file::{H5Group, MOST_EXPANSION, guard};
use crate::import::ImportError;
use hdf5_reader::Datatype;

/// The most numbers of a record that one member has.
const MOST_COMPONENTS: u64 = 64;

/// Numbers of each record, and how many.
pub(super) struct Member {
    pub components: usize,
    pub values: Vec<f64>,
}

impl H5Group<'_> {
    /// Members of the records of the data set `name`, in the order of `members`: `None` for one that it does not have, or that is no number.
    /// `None` altogether of a data set without records.
    pub(super) fn members_of_records(
        &self,
        name: &str,
        members: &[&str],
        most: u64,
    ) -> Result<Option<Vec<Option<Member>>>, ImportError> {
        let path = &self.file.path;
        let label = self.child(name);
        let dataset = guard(path, &label, "a readable data set", || self.group.dataset(name))?;
        let Datatype::Compound { size, fields } = dataset.dtype() else { return Ok(None) };
        let [rows] = *dataset.shape() else { return Ok(None) };
        let size = *size as usize;
        let chunked = guard(path, &label, "a readable layout", || Ok(dataset.chunks().is_some()))?;
        let most_bytes = self.file.bytes.saturating_mul(if chunked { MOST_EXPANSION } else { 1 });
        let wanted = rows.checked_mul(size as u64).filter(|wanted| *wanted <= most_bytes && rows <= most);
        let malformed = |found: String, expected: &str| ImportError::malformed(path, label.clone(), found, expected);
        let Some(wanted) = wanted.filter(|_| size > 0) else {
            let found = format!("{rows} records of {size} bytes");
            return Err(malformed(found, &format!("at most {most}, and no more than the file can hold")));
        };
        let bytes = guard(path, &label, "readable records", || dataset.read_native_bytes())?;
        if bytes.len() as u64 != wanted {
            return Err(malformed(format!("{} bytes", bytes.len()), &wanted.to_string()));
        }
        let member = |name: &&str| {
            let field = fields.iter().find(|field| field.name == **name)?;
            let (number, components) = match &field.datatype {
                Datatype::Array { base, dims } => (&**base, product(dims)?),
                number => (number, 1),
            };
            let width = width(number)?;
            let begin = field.byte_offset as usize;
            // Also tells members that reach beyond their record.
            let of_record = |record: &[u8]| -> Option<Vec<f64>> {
                let own = record.get(begin..begin.checked_add(width * components)?)?;
                own.chunks_exact(width).map(|bytes| value(number, bytes)).collect()
            };
            let mut values = Vec::with_capacity(rows as usize * components);
            for record in bytes.chunks_exact(size) {
                values.extend(of_record(record)?);
            }
            Some(Member { components, values })
        };
        Ok(Some(members.iter().map(member).collect()))
    }
}

/// How many numbers an array has, where they are few.
fn product(sizes: &[u64]) -> Option<usize> {
    let product = sizes.iter().try_fold(1_u64, |product, size| product.checked_mul(*size))?;
    (1..=MOST_COMPONENTS).contains(&product).then_some(product as usize)
}

/// Bytes of a number; `None` of what is none.
fn width(number: &Datatype) -> Option<usize> {
    match number {
        Datatype::FloatingPoint { size: size @ (4 | 8), .. } => Some(usize::from(*size)),
        Datatype::FixedPoint { size: size @ (1 | 2 | 4 | 8), .. } => Some(usize::from(*size)),
        _ => None,
    }
}

/// The number that bytes in this machine's order stand for.
fn value(number: &Datatype, bytes: &[u8]) -> Option<f64> {
    macro_rules! read {
        ($number:ty) => {
            Some(<$number>::from_ne_bytes(bytes.try_into().ok()?) as f64)
        };
    }
    match number {
        Datatype::FloatingPoint { size: 4, .. } => read!(f32),
        Datatype::FloatingPoint { .. } => read!(f64),
        Datatype::FixedPoint { size: 1, signed: true, .. } => read!(i8),
        Datatype::FixedPoint { size: 1, .. } => read!(u8),
        Datatype::FixedPoint { size: 2, signed: true, .. } => read!(i16),
        Datatype::FixedPoint { size: 2, .. } => read!(u16),
        Datatype::FixedPoint { size: 4, signed: true, .. } => read!(i32),
        Datatype::FixedPoint { size: 4, .. } => read!(u32),
        Datatype::FixedPoint { signed: true, .. } => read!(i64),
        Datatype::FixedPoint { .. } => read!(u64),
        _ => None,
    }
}
