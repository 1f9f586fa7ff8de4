//! Values of colour planes, 8 bits as pictures have them, as linear light and back (IEC 61966-2-1).

use std::sync::LazyLock;

/// Full light.
pub const FULL: u32 = 65535;

/// The value that stands where a surface is and no photo: half of full light.
pub const NO_PHOTO: u8 = 188;

/// Light of each of the 256 values.
static LINEAR: LazyLock<[u32; 256]> =
    LazyLock::new(|| std::array::from_fn(|value| (linear(value as f64 / 255.0) * f64::from(FULL)).round() as u32));

/// Values of light: the number of those whose light is at most this, and the next one's is nearer, begins at each entry.
static BOUNDS: LazyLock<[f64; 255]> =
    LazyLock::new(|| std::array::from_fn(|value| linear((value as f64 + 0.5) / 255.0) * f64::from(FULL)));

fn linear(value: f64) -> f64 {
    if value <= 0.04045 { value / 12.92 } else { libm::pow((value + 0.055) / 1.055, 2.4) }
}

/// The table of light, from 0 to [`FULL`].
pub fn table() -> &'static [u32; 256] {
    &LINEAR
}

/// The value that looks nearest to this much light.
pub fn value(light: f64) -> u8 {
    BOUNDS.partition_point(|bound| *bound < light) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_come_back() {
        assert!((0..=255_u8).all(|byte| value(f64::from(table()[usize::from(byte)])) == byte));
        assert_eq!((table()[0], table()[255]), (0, FULL));
    }
}
