//! Values as little-endian bytes, for what one process of this program hands to another by way of a file. Whoever reads has checked that the
//! bytes are those that were written; what is not one of a type all the same is `None`, and nothing is allocated for what is not there.
//! Numbers that are to be used as indices, lengths or summands are checked by whoever knows what they can be ([`expect`], [`expect_within`]).

use super::{Bounds, FamilyName, Unit};
use glam::DVec3;
use std::fmt::Display;
use std::ops::{Range, RangeInclusive};

/// A value that can be written as bytes and read back, to the last bit.
pub trait Portable: Sized {
    /// Appends its bytes.
    fn put(&self, to: &mut Vec<u8>);

    /// Takes one off the front of some bytes; `None` where they do not begin with one.
    fn take(from: &mut &[u8]) -> Option<Self>;

    /// Its bytes.
    fn bytes(&self) -> Vec<u8> {
        let mut bytes = Vec::new();
        self.put(&mut bytes);
        bytes
    }

    /// The value that these bytes are, all of them.
    fn of_bytes(mut bytes: &[u8]) -> Option<Self> {
        let value = Self::take(&mut bytes)?;
        bytes.is_empty().then_some(value)
    }
}

/// A structure is portable, field by field.
macro_rules! portable {
    ($type:ty $(where $parameter:ident)? { $($field:ident),* $(,)? }) => {
        impl$(<$parameter: $crate::model::portable::Portable>)? $crate::model::portable::Portable for $type {
            fn put(&self, to: &mut Vec<u8>) {
                $($crate::model::portable::Portable::put(&self.$field, to);)*
            }

            fn take(from: &mut &[u8]) -> Option<Self> {
                Some(Self { $($field: $crate::model::portable::Portable::take(from)?),* })
            }
        }
    };
}

/// An enumeration without fields is portable, by these numbers of its variants.
macro_rules! portable_variants {
    ($type:ty { $($variant:ident = $number:literal),* $(,)? }) => {
        impl $crate::model::portable::Portable for $type {
            fn put(&self, to: &mut Vec<u8>) {
                to.push(match self { $(Self::$variant => $number),* });
            }

            fn take(from: &mut &[u8]) -> Option<Self> {
                match <u8 as $crate::model::portable::Portable>::take(from)? {
                    $($number => Some(Self::$variant),)*
                    _ => None,
                }
            }
        }
    };
}

pub(crate) use {portable, portable_variants};

macro_rules! portable_numbers {
    ($($number:ty),*) => {
        $(impl Portable for $number {
            fn put(&self, to: &mut Vec<u8>) {
                to.extend_from_slice(&self.to_le_bytes());
            }

            fn take(from: &mut &[u8]) -> Option<Self> {
                let (bytes, rest) = from.split_first_chunk()?;
                *from = rest;
                Some(Self::from_le_bytes(*bytes))
            }
        })*
    };
}

portable_numbers!(u8, u16, u32, u64, f32, f64);

impl Portable for usize {
    fn put(&self, to: &mut Vec<u8>) {
        (*self as u64).put(to);
    }

    fn take(from: &mut &[u8]) -> Option<usize> {
        u64::take(from)?.try_into().ok()
    }
}

impl Portable for bool {
    fn put(&self, to: &mut Vec<u8>) {
        to.push(u8::from(*self));
    }

    fn take(from: &mut &[u8]) -> Option<bool> {
        match u8::take(from)? {
            0 => Some(false),
            1 => Some(true),
            _ => None,
        }
    }
}

impl Portable for () {
    fn put(&self, _: &mut Vec<u8>) {}

    fn take(_: &mut &[u8]) -> Option<()> {
        Some(())
    }
}

impl Portable for String {
    fn put(&self, to: &mut Vec<u8>) {
        self.len().put(to);
        to.extend_from_slice(self.as_bytes());
    }

    fn take(from: &mut &[u8]) -> Option<String> {
        let len = usize::take(from)?;
        let (text, rest) = from.split_at_checked(len)?;
        *from = rest;
        String::from_utf8(text.to_vec()).ok()
    }
}

impl<T: Portable> Portable for Option<T> {
    fn put(&self, to: &mut Vec<u8>) {
        self.is_some().put(to);
        self.iter().for_each(|value| value.put(to));
    }

    fn take(from: &mut &[u8]) -> Option<Option<T>> {
        if bool::take(from)? { T::take(from).map(Some) } else { Some(None) }
    }
}

impl<T: Portable> Portable for Vec<T> {
    fn put(&self, to: &mut Vec<u8>) {
        self.len().put(to);
        self.iter().for_each(|value| value.put(to));
    }

    fn take(from: &mut &[u8]) -> Option<Vec<T>> {
        // What takes no bytes is not written in lists; and whatever is, is collected as it comes.
        let len = usize::take(from).filter(|len| *len <= from.len())?;
        (0..len).map(|_| T::take(from)).collect()
    }
}

impl<T: Portable + Copy, const N: usize> Portable for [T; N] {
    fn put(&self, to: &mut Vec<u8>) {
        self.iter().for_each(|value| value.put(to));
    }

    fn take(from: &mut &[u8]) -> Option<[T; N]> {
        let mut values = [T::take(from)?; N];
        for value in values.iter_mut().skip(1) {
            *value = T::take(from)?;
        }
        Some(values)
    }
}

impl<A: Portable, B: Portable> Portable for (A, B) {
    fn put(&self, to: &mut Vec<u8>) {
        self.0.put(to);
        self.1.put(to);
    }

    fn take(from: &mut &[u8]) -> Option<(A, B)> {
        Some((A::take(from)?, B::take(from)?))
    }
}

impl Portable for Range<usize> {
    fn put(&self, to: &mut Vec<u8>) {
        (self.start, self.end).put(to);
    }

    fn take(from: &mut &[u8]) -> Option<Range<usize>> {
        let (start, end) = Portable::take(from)?;
        (start <= end).then_some(start..end)
    }
}

impl Portable for DVec3 {
    fn put(&self, to: &mut Vec<u8>) {
        self.to_array().put(to);
    }

    fn take(from: &mut &[u8]) -> Option<DVec3> {
        Portable::take(from).map(DVec3::from_array)
    }
}

portable!(Bounds { min, max });

impl Portable for Unit {
    fn put(&self, to: &mut Vec<u8>) {
        self.0.put(to);
    }

    fn take(from: &mut &[u8]) -> Option<Unit> {
        String::take(from).map(Unit)
    }
}

impl Portable for FamilyName {
    fn put(&self, to: &mut Vec<u8>) {
        self.as_str().to_owned().put(to);
    }

    fn take(from: &mut &[u8]) -> Option<FamilyName> {
        FamilyName::parse(&String::take(from)?)
    }
}

/// Whether a field is what it must be; else what was found and expected.
pub fn expect<T: PartialEq + Display>(field: &str, found: T, expected: T) -> Result<(), String> {
    if found == expected { Ok(()) } else { Err(format!("{field}: found {found}, expected {expected}")) }
}

/// Whether a number is within some range; else what was found and expected.
pub fn expect_within(field: &str, found: u64, range: RangeInclusive<u64>) -> Result<(), String> {
    match range.contains(&found) {
        true => Ok(()),
        false => Err(format!("{field}: found {found}, expected {} to {}", range.start(), range.end())),
    }
}

/// Whether something holds of a field; else what was expected.
pub fn expect_that(holds: bool, field: &str, expected: &str) -> Result<(), String> {
    if holds { Ok(()) } else { Err(format!("{field}: found something else, expected {expected}")) }
}

/// The sum of numbers that may be forged, which ends at the largest one.
pub fn total(numbers: impl IntoIterator<Item = u64>) -> u64 {
    numbers.into_iter().fold(0, u64::saturating_add)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    type All = (Vec<(Option<f64>, String)>, ([u16; 3], (Vec<f32>, bool)));

    proptest! {
        #[test]
        fn values_come_back_to_the_last_bit_and_nothing_else_is_one(
            pairs in prop::collection::vec((prop::option::of(any::<u64>()), "[a-zäß]{0,5}"), 0..5),
            rest: ([u16; 3], (Vec<u32>, bool)),
            cut: prop::sample::Index,
        ) {
            let pairs = pairs.into_iter().map(|(bits, text)| (bits.map(f64::from_bits), text)).collect();
            let (numbers, (bits, flag)) = rest;
            let all: All = (pairs, (numbers, (bits.into_iter().map(f32::from_bits).collect(), flag)));
            let bytes = all.bytes();
            let back = All::of_bytes(&bytes).unwrap();
            // Bits, since not every number is equal to itself.
            prop_assert_eq!(back.bytes(), &bytes[..]);
            prop_assert!(All::of_bytes(&bytes[..cut.index(bytes.len())]).is_none());
            prop_assert!(All::of_bytes(&[&bytes[..], &[0]].concat()).is_none());
        }
    }

    #[test]
    fn lengths_reserve_nothing() {
        assert_eq!(Vec::<u64>::of_bytes(&[255; 8]), None);
        assert_eq!(String::of_bytes(&[255; 8]), None);
        assert_eq!(Range::<usize>::of_bytes(&(2_u64, 1_u64).bytes()), None);
    }
}
