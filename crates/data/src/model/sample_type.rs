//! The types that the samples of a grid are stored in.

use serde::{Serialize, Serializer};
use std::str::FromStr;

/// How one sample of a grid is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[allow(missing_docs, reason = "the names say it: whole numbers with and without sign, floats, and their bits")]
pub enum SampleType {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

impl SampleType {
    /// Every type.
    pub const ALL: [SampleType; 10] = [
        SampleType::I8,
        SampleType::U8,
        SampleType::I16,
        SampleType::U16,
        SampleType::I32,
        SampleType::U32,
        SampleType::I64,
        SampleType::U64,
        SampleType::F32,
        SampleType::F64,
    ];

    /// Its name as NumPy has it: `int8`, `uint16`, `float64`.
    pub fn name(self) -> &'static str {
        match self {
            SampleType::I8 => "int8",
            SampleType::U8 => "uint8",
            SampleType::I16 => "int16",
            SampleType::U16 => "uint16",
            SampleType::I32 => "int32",
            SampleType::U32 => "uint32",
            SampleType::I64 => "int64",
            SampleType::U64 => "uint64",
            SampleType::F32 => "float32",
            SampleType::F64 => "float64",
        }
    }

    /// Its size, bytes.
    pub fn size(self) -> usize {
        match self {
            SampleType::I8 | SampleType::U8 => 1,
            SampleType::I16 | SampleType::U16 => 2,
            SampleType::I32 | SampleType::U32 | SampleType::F32 => 4,
            SampleType::I64 | SampleType::U64 | SampleType::F64 => 8,
        }
    }

    /// Whether samples are floats.
    pub fn is_float(self) -> bool {
        matches!(self, SampleType::F32 | SampleType::F64)
    }

    /// The type of whole numbers of so many bytes, with a sign or without; `None` where there is none.
    pub fn whole(bytes: usize, is_signed: bool) -> Option<SampleType> {
        SampleType::ALL
            .into_iter()
            .find(|kind| !kind.is_float() && kind.size() == bytes && kind.name().starts_with('i') == is_signed)
    }

    /// The type of floats of so many bytes; `None` where there is none.
    pub fn float(bytes: usize) -> Option<SampleType> {
        SampleType::ALL.into_iter().find(|kind| kind.is_float() && kind.size() == bytes)
    }

    /// Appends the samples in `bytes`, which are in this machine's byte order, to `values`: the first of every `stride` samples.
    /// Whole numbers above 2^53 are rounded.
    pub fn decode(self, bytes: &[u8], stride: usize, values: &mut Vec<f64>) {
        /// The numbers of `N` bytes in their places.
        fn each<const N: usize>(bytes: &[u8], stride: usize, values: &mut Vec<f64>, of: impl Fn([u8; N]) -> f64) {
            values.extend(bytes.as_chunks::<N>().0.iter().step_by(stride.max(1)).map(|sample| of(*sample)));
        }
        match self {
            SampleType::I8 => each(bytes, stride, values, |b| i8::from_ne_bytes(b).into()),
            SampleType::U8 => each(bytes, stride, values, |b| u8::from_ne_bytes(b).into()),
            SampleType::I16 => each(bytes, stride, values, |b| i16::from_ne_bytes(b).into()),
            SampleType::U16 => each(bytes, stride, values, |b| u16::from_ne_bytes(b).into()),
            SampleType::I32 => each(bytes, stride, values, |b| i32::from_ne_bytes(b).into()),
            SampleType::U32 => each(bytes, stride, values, |b| u32::from_ne_bytes(b).into()),
            SampleType::I64 => each(bytes, stride, values, |b| i64::from_ne_bytes(b) as f64),
            SampleType::U64 => each(bytes, stride, values, |b| u64::from_ne_bytes(b) as f64),
            SampleType::F32 => each(bytes, stride, values, |b| f32::from_ne_bytes(b).into()),
            SampleType::F64 => each(bytes, stride, values, f64::from_ne_bytes),
        }
    }

    /// Appends the number that `text` is to `bytes`, in this machine's byte order. False where it is none of this type; then
    /// nothing is appended.
    pub fn parse_into(self, text: &str, bytes: &mut Vec<u8>) -> bool {
        /// A number, or a whole one that is written as a float.
        fn whole<T: FromStr + TryFrom<i64>>(text: &str) -> Option<T> {
            text.parse().ok().or_else(|| {
                let value: f64 = text.parse().ok()?;
                let is_exact = value.fract() == 0.0 && value.abs() <= 9_007_199_254_740_992.0;
                if is_exact { T::try_from(value as i64).ok() } else { None }
            })
        }
        let mut put = |sample: Option<&[u8]>| {
            bytes.extend_from_slice(sample.unwrap_or_default());
            sample.is_some()
        };
        match self {
            SampleType::I8 => put(whole::<i8>(text).map(i8::to_ne_bytes).as_ref().map(<[u8; 1]>::as_slice)),
            SampleType::U8 => put(whole::<u8>(text).map(u8::to_ne_bytes).as_ref().map(<[u8; 1]>::as_slice)),
            SampleType::I16 => put(whole::<i16>(text).map(i16::to_ne_bytes).as_ref().map(<[u8; 2]>::as_slice)),
            SampleType::U16 => put(whole::<u16>(text).map(u16::to_ne_bytes).as_ref().map(<[u8; 2]>::as_slice)),
            SampleType::I32 => put(whole::<i32>(text).map(i32::to_ne_bytes).as_ref().map(<[u8; 4]>::as_slice)),
            SampleType::U32 => put(whole::<u32>(text).map(u32::to_ne_bytes).as_ref().map(<[u8; 4]>::as_slice)),
            SampleType::I64 => put(whole::<i64>(text).map(i64::to_ne_bytes).as_ref().map(<[u8; 8]>::as_slice)),
            SampleType::U64 => put(whole::<u64>(text).map(u64::to_ne_bytes).as_ref().map(<[u8; 8]>::as_slice)),
            SampleType::F32 => put(text.parse().ok().map(f32::to_ne_bytes).as_ref().map(<[u8; 4]>::as_slice)),
            SampleType::F64 => put(text.parse().ok().map(f64::to_ne_bytes).as_ref().map(<[u8; 8]>::as_slice)),
        }
    }
}

impl std::fmt::Display for SampleType {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

impl Serialize for SampleType {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

impl FromStr for SampleType {
    type Err = String;

    /// NumPy's names, and Rust's: `uint16` or `u16`.
    fn from_str(text: &str) -> Result<SampleType, String> {
        let short = text.replace("uint", "u").replace("int", "i").replace("float", "f");
        let bits = |kind: &SampleType| kind.size() * 8;
        let letter = |kind: &SampleType| kind.name().chars().next().unwrap_or_default();
        let found = SampleType::ALL.into_iter().find(|kind| format!("{}{}", letter(kind), bits(kind)) == short);
        found.ok_or_else(|| "expected i8, u8, i16, u16, i32, u32, i64, u64, f32 or f64".into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn types_are_named_parsed_and_found_by_size() {
        for kind in SampleType::ALL {
            assert_eq!(kind.name().parse(), Ok(kind));
            let found = if kind.is_float() {
                SampleType::float(kind.size())
            } else {
                SampleType::whole(kind.size(), kind.name().starts_with('i'))
            };
            assert_eq!(found, Some(kind));
            let mut bytes = Vec::new();
            assert!(kind.parse_into("7", &mut bytes) && kind.parse_into("100.0", &mut bytes));
            assert!(!kind.parse_into("x", &mut bytes));
            let mut values = Vec::new();
            kind.decode(&bytes, 1, &mut values);
            assert_eq!(values, [7.0, 100.0]);
            values.clear();
            kind.decode(&bytes[kind.size()..], 2, &mut values);
            assert_eq!(values, [100.0]);
        }
        assert_eq!("u16".parse(), Ok(SampleType::U16));
        assert!("u7".parse::<SampleType>().is_err() && "".parse::<SampleType>().is_err());
        let mut bytes = Vec::new();
        assert!(!SampleType::U8.parse_into("256", &mut bytes) && !SampleType::U8.parse_into("0.5", &mut bytes));
        assert!(SampleType::U64.parse_into("18446744073709551615", &mut bytes));
        assert_eq!(bytes, [255; 8]);
    }
}
