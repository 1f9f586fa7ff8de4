//! The first directory of a TIFF file, looked at before the library is: it makes room for as many values as an entry says it has.

use crate::import::bytes::Order;
use std::io::{Read, Seek, SeekFrom};

/// The most entries of a directory that are looked at; one has some twenty.
const MOST_ENTRIES: u64 = 4096;

/// What an entry claims that no file of `most` bytes can hold; `None` where all is well, or the library will find out.
pub(super) fn excess(reader: &mut (impl Read + Seek), most: u64) -> Option<String> {
    let mut head = [0; 16];
    reader.seek(SeekFrom::Start(0)).ok()?;
    reader.read_exact(&mut head[..8]).ok()?;
    let order = if head.starts_with(b"II") { Order::Little } else { Order::Big };
    let is_big = head[2..4].contains(&43);
    if is_big {
        reader.read_exact(&mut head[8..]).ok()?;
    }
    let long = |bytes: &[u8], at: usize| order.f64(bytes, at).to_bits();
    let start = if is_big { long(&head, 8) } else { order.u32(&head, 4).into() };
    reader.seek(SeekFrom::Start(start)).ok()?;
    let mut count = [0; 8];
    reader.read_exact(&mut count[..if is_big { 8 } else { 2 }]).ok()?;
    let entries = match (is_big, order) {
        (true, _) => long(&count, 0),
        (false, Order::Little) => u16::from_le_bytes([count[0], count[1]]).into(),
        (false, Order::Big) => u16::from_be_bytes([count[0], count[1]]).into(),
    };
    let mut entry = [0; 20];
    let entry = &mut entry[..if is_big { 20 } else { 12 }];
    for _ in 0..entries.min(MOST_ENTRIES) {
        reader.read_exact(entry).ok()?;
        let [tag, kind] = [0, 2].map(|at| match order {
            Order::Little => u16::from_le_bytes([entry[at], entry[at + 1]]),
            Order::Big => u16::from_be_bytes([entry[at], entry[at + 1]]),
        });
        let values = if is_big { long(entry, 4) } else { order.u32(entry, 4).into() };
        let size = match kind {
            3 | 8 => 2,
            4 | 9 | 11 | 13 => 4,
            5 | 10 | 12 | 16..=18 => 8,
            _ => 1,
        };
        if values.saturating_mul(size) > most {
            return Some(format!("{values} values of entry {tag}"));
        }
    }
    None
}
