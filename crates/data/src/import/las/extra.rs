//! Attributes of points beyond those of their format ("Extra Bytes" of LAS 1.4 R15), which a record before the points describes.

use crate::import::bytes::Order;
use crate::import::typed_columns::Meaning;
use crate::model::SampleType;

/// The user and the number of the record.
pub(super) const USER: &str = "LASF_Spec";
pub(super) const NUMBER: u16 = 4;

/// Bytes that describe an attribute.
const DESCRIPTION: usize = 192;

/// Types of numbers by their code, from 1 on. Those of pairs begin at 11, those of triples at 21.
const TYPES: [SampleType; 10] = [
    SampleType::U8,
    SampleType::I8,
    SampleType::U16,
    SampleType::I16,
    SampleType::U32,
    SampleType::I32,
    SampleType::U64,
    SampleType::I64,
    SampleType::F32,
    SampleType::F64,
];

/// Bits of what is said of the numbers: a value that stands for none, a factor, and an offset.
const NONE: u8 = 1;
const FACTOR: u8 = 8;
const OFFSET: u8 = 16;

/// An attribute.
#[derive(Debug, PartialEq)]
pub(super) struct Extra {
    pub name: String,
    /// Its first byte in a point.
    pub at: u64,
    pub number: SampleType,
    /// What becomes of each of its numbers.
    pub meanings: Vec<Meaning>,
}

impl Extra {
    /// Bytes in a point.
    pub(super) fn bytes(&self) -> u64 {
        self.number.size() as u64 * self.meanings.len() as u64
    }
}

/// The attributes that a record describes, from byte `start` to byte `end` of a point. Bytes without a type are left out.
pub(super) fn described(record: &[u8], start: u64, end: u64) -> Vec<Extra> {
    let (mut found, mut at) = (Vec::new(), start);
    for (index, about) in record.chunks_exact(DESCRIPTION).enumerate() {
        let (kind, options) = (about[2], about[3]);
        let bytes = match kind.checked_sub(1).map(usize::from) {
            None => u64::from(options),
            Some(kind @ 0..30) => {
                let number = TYPES[kind % TYPES.len()];
                let meanings = (0..=kind / TYPES.len()).map(|axis| meaning(about, number, axis)).collect();
                let extra = Extra { name: name(&about[4..36], index), at, number, meanings };
                let bytes = extra.bytes();
                if at + bytes <= end {
                    found.push(extra);
                }
                bytes
            }
            // Where the next one begins is not known.
            Some(_) => break,
        };
        at += bytes;
    }
    found
}

/// A name that ends at its first 0, in one line.
fn name(bytes: &[u8], index: usize) -> String {
    let text = bytes.split(|letter| *letter == 0).next().unwrap_or_default();
    let text: String = String::from_utf8_lossy(text).chars().filter(|letter| !letter.is_control()).collect();
    if text.trim().is_empty() { format!("extra-{}", index + 1) } else { text.trim().to_owned() }
}

/// What becomes of the stored number of an axis.
fn meaning(about: &[u8], number: SampleType, axis: usize) -> Meaning {
    let says = |bit: u8| about[3] & bit != 0;
    let value = |at: usize| Order::Little.f64(about, at + 8 * axis);
    let factor = if says(FACTOR) { value(112) } else { 1.0 };
    // A factor that makes all numbers one is none.
    let factor = if factor.is_finite() && factor != 0.0 { factor } else { 1.0 };
    let first = if says(OFFSET) { value(136) } else { 0.0 };
    let none = value(40).to_bits();
    let none = match number {
        SampleType::F32 | SampleType::F64 => f64::from_bits(none),
        SampleType::I8 | SampleType::I16 | SampleType::I32 | SampleType::I64 => none as i64 as f64,
        _ => none as f64,
    };
    match (says(NONE), factor == 1.0 && first == 0.0) {
        (true, _) => Meaning::LinearUnless { factor, first, none },
        (false, true) => Meaning::AsStored,
        (false, false) => Meaning::Linear { factor, first },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The description of an attribute with a name of three letters.
    fn about(kind: u8, options: u8, none: u64, factor: f64, first: f64) -> Vec<u8> {
        let mut about = vec![0; DESCRIPTION];
        let mut put = |at: usize, bytes: &[u8]| about[at..at + bytes.len()].copy_from_slice(bytes);
        put(2, &[kind, options]);
        put(4, b"abc\0def");
        put(40, &none.to_le_bytes());
        put(112, &factor.to_le_bytes());
        put(136, &first.to_le_bytes());
        about
    }

    #[test]
    fn attributes_are_where_and_what_their_descriptions_say() {
        let record = [
            about(4, FACTOR | OFFSET, 0, 0.5, 10.0),
            about(0, 3, 0, 0.0, 0.0),
            about(29, 0, 0, 0.5, 10.0),
            about(2, NONE, (-1_i64).cast_unsigned(), 0.0, 0.0),
            about(10, FACTOR, 0, f64::NAN, 0.0),
            about(1, 0, 0, 0.0, 0.0),
        ]
        .concat();
        let found = described(&record, 30, 57);
        let expected = [
            (30, SampleType::I16, vec![Meaning::Linear { factor: 0.5, first: 10.0 }]),
            (35, SampleType::F32, vec![Meaning::AsStored; 3]),
            (47, SampleType::I8, vec![Meaning::LinearUnless { factor: 1.0, first: 0.0, none: -1.0 }]),
            (48, SampleType::F64, vec![Meaning::AsStored]),
            (56, SampleType::U8, vec![Meaning::AsStored]),
        ]
        .map(|(at, number, meanings)| Extra { name: "abc".into(), at, number, meanings });
        assert_eq!(found, expected);
        // What goes on behind the point, and what comes after a type that is not known, is nothing.
        assert_eq!(described(&record, 30, 56), expected[..4]);
        let unknown = [about(31, 0, 0, 0.0, 0.0), about(1, 0, 0, 0.0, 0.0)].concat();
        assert!(described(&unknown, 20, 90).is_empty());
        assert_eq!(name(&[0; 32], 2), "extra-3");
    }
}
