//! How a camera was held: EXIF's entry in a JPEG file.

use std::io::Read;
use std::path::Path;

/// The bytes of a file that are looked at: the entry is in one of the first segments, which have up to 64 KiB each.
const LOOKED_AT: u64 = 1 << 18;
/// The entry.
const ORIENTATION: u16 = 0x112;

/// How stored pixels become an upright picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Orientation {
    /// Rows of the picture are stored columns; then they, and columns, are turned round.
    pub is_transposed: bool,
    /// Whether its rows, and its columns, are from the last to the first.
    pub is_turned: [bool; 2],
}

impl Orientation {
    /// Of EXIF's number; what is none is upright.
    fn of(number: u16) -> Orientation {
        Orientation {
            is_transposed: (5..=8).contains(&number),
            is_turned: [matches!(number, 3 | 4 | 7 | 8), matches!(number, 2 | 3 | 6 | 7)],
        }
    }

    /// Of the file at `path`; upright where it is no JPEG or says nothing that can be read.
    pub(super) fn of_file(path: &Path) -> Orientation {
        let mut bytes = Vec::new();
        let read = std::fs::File::open(path).and_then(|file| file.take(LOOKED_AT).read_to_end(&mut bytes));
        read.ok().and_then(|_| in_jpeg(&bytes)).map_or_else(Orientation::default, Orientation::of)
    }
}

/// The number in the segments before the first scan.
fn in_jpeg(bytes: &[u8]) -> Option<u16> {
    let mut rest = bytes.strip_prefix(b"\xff\xd8")?;
    loop {
        let (&[mark, kind, high, low], _) = rest.split_first_chunk::<4>()?;
        // A scan, or the end.
        if mark != 0xff || matches!(kind, 0xda | 0xd9) {
            return None;
        }
        let length = usize::from(u16::from_be_bytes([high, low]));
        let segment = rest.get(4..2 + length)?;
        if let (0xe1, Some(exif)) = (kind, segment.strip_prefix(b"Exif\0\0")) {
            return in_exif(exif);
        }
        rest = rest.get(2 + length..)?;
    }
}

/// The number in a TIFF structure's first directory.
fn in_exif(bytes: &[u8]) -> Option<u16> {
    let is_big = match bytes.get(..4)? {
        b"II*\0" => false,
        b"MM\0*" => true,
        _ => return None,
    };
    let short = |at: usize| {
        let own = *bytes.get(at..)?.first_chunk::<2>()?;
        Some(if is_big { u16::from_be_bytes(own) } else { u16::from_le_bytes(own) })
    };
    let own = *bytes.get(4..)?.first_chunk::<4>()?;
    let first = if is_big { u32::from_be_bytes(own) } else { u32::from_le_bytes(own) };
    let first = usize::try_from(first).ok()?;
    let entries = bytes.get(first..)?.get(2..)?;
    let count = usize::from(short(first)?).min(entries.len() / 12);
    let at = (0..count).map(|entry| first + 2 + 12 * entry).find(|at| short(*at) == Some(ORIENTATION))?;
    // A whole number of two bytes.
    (short(at + 2)? == 3).then(|| short(at + 8)).flatten()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The head of a JPEG file with a number.
    pub(in super::super) fn head(number: u16, is_big: bool) -> Vec<u8> {
        let (two, four) = match is_big {
            true => (u16::to_be_bytes as fn(u16) -> [u8; 2], u32::to_be_bytes as fn(u32) -> [u8; 4]),
            false => (u16::to_le_bytes as fn(u16) -> [u8; 2], u32::to_le_bytes as fn(u32) -> [u8; 4]),
        };
        let mut tiff = if is_big { b"MM\0*".to_vec() } else { b"II*\0".to_vec() };
        tiff.extend(four(8));
        tiff.extend(two(2));
        for (tag, value) in [(0x10f, 7), (ORIENTATION, number)] {
            tiff.extend(two(tag));
            tiff.extend(two(3));
            tiff.extend(four(1));
            tiff.extend(two(value));
            tiff.extend([0; 2]);
        }
        let mut file = b"\xff\xd8\xff\xe0\x00\x06JFIF".to_vec();
        file.extend(b"\xff\xe1");
        file.extend((8 + tiff.len() as u16).to_be_bytes());
        file.extend(b"Exif\0\0");
        file.extend(tiff);
        file
    }

    #[test]
    fn the_number_is_found_in_either_order() {
        for is_big in [false, true] {
            assert_eq!(
                (1..=8).map(|number| in_jpeg(&head(number, is_big))).collect::<Option<Vec<u16>>>(),
                Some((1..=8).collect())
            );
        }
        assert_eq!(in_jpeg(b"\xff\xd8\xff\xda\x00\x02"), None);
        // Held so that the right side is at the top of what is stored.
        assert_eq!(Orientation::of(6), Orientation { is_transposed: true, is_turned: [false, true] });
        assert_eq!(Orientation::of(0), Orientation::default());
    }

    proptest! {
        /// Whatever is in the file.
        #[test]
        fn no_bytes_are_trusted(cut in 0..70_usize, place in 0..70_usize, value in any::<u8>(), is_big in any::<bool>()) {
            let mut file = head(6, is_big);
            if let Some(byte) = file.get_mut(place) {
                *byte = value;
            }
            let _ = in_jpeg(&file);
            file.truncate(cut);
            let _ = in_jpeg(&file);
        }
    }
}
