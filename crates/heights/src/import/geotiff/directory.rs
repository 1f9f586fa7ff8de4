//! The first directory of a TIFF file: entries are looked up when they are asked for, and read once the file is known
//! to hold their values.

use super::tag;
use crate::import::content::{Content, latin1, word};
use deepfield_data::import::{ByteOrder, ImportError};

/// The most entries of a directory; one has some twenty.
const MOST_ENTRIES: u64 = 4096;

/// One entry.
#[derive(Clone, Copy, Debug)]
struct Entry {
    tag: u16,
    kind: u16,
    count: u64,
    /// The byte where its values are.
    at: u64,
}

/// A directory of a file.
pub(super) struct Directory<'c> {
    /// The file.
    pub content: &'c Content,
    /// The order of bytes in all of it.
    pub order: ByteOrder,
    is_big: bool,
    entries: Vec<Entry>,
    /// The byte where the next directory is; 0 for none.
    next: u64,
}

/// A whole number of 2 to 8 bytes.
fn whole<const N: usize>(order: ByteOrder, bytes: &[u8], at: usize) -> u64 {
    let mut own: [u8; N] = word(bytes, at);
    if order == ByteOrder::Big {
        own.reverse();
    }
    let mut all = [0; 8];
    all[..N].copy_from_slice(&own);
    u64::from_le_bytes(all)
}

/// Bytes of a value of a type; 0 of those that are not known.
fn size_of(kind: u16) -> u64 {
    match kind {
        1 | 2 | 6 | 7 => 1,
        3 | 8 => 2,
        4 | 9 | 11 | 13 => 4,
        5 | 10 | 12 | 16..=18 => 8,
        _ => 0,
    }
}

impl<'c> Directory<'c> {
    /// The first one of a file.
    ///
    /// # Errors
    /// Where there is none, or it does not fit in the file.
    pub(super) fn first(content: &'c Content) -> Result<Directory<'c>, ImportError> {
        let head = &content.head;
        let order = if head.starts_with(b"MM") { ByteOrder::Big } else { ByteOrder::Little };
        let is_big = whole::<2>(order, head, 2) == 43;
        let header = if is_big { 16 } else { 8 };
        if head.len() < header {
            return Err(content.malformed("header", format!("{} bytes", head.len()), format!("{header}")));
        }
        if is_big && (whole::<2>(order, head, 4), whole::<2>(order, head, 6)) != (8, 0) {
            let found = format!("offsets of {} bytes", whole::<2>(order, head, 4));
            return Err(content.malformed("header", found, "offsets of 8 bytes in a BigTIFF"));
        }
        let start = if is_big { whole::<8>(order, head, 8) } else { whole::<4>(order, head, 4) };
        Directory::at(content, order, is_big, start)
    }

    fn at(content: &'c Content, order: ByteOrder, is_big: bool, start: u64) -> Result<Directory<'c>, ImportError> {
        let field = "directory";
        let (head, size, link) = if is_big { (8, 20, 8) } else { (2, 12, 4) };
        let bytes = content.bytes(field, start, head)?;
        let count = if is_big { whole::<8>(order, &bytes, 0) } else { whole::<2>(order, &bytes, 0) };
        if count == 0 || count > MOST_ENTRIES {
            return Err(content.malformed(field, format!("{count} entries"), format!("1 to {MOST_ENTRIES}")));
        }
        let first = start + head;
        let bytes = content.bytes(field, first, count * size)?;
        let entries = bytes.chunks_exact(size as usize).enumerate().map(|(number, bytes)| {
            let (tag, kind) = (whole::<2>(order, bytes, 0) as u16, whole::<2>(order, bytes, 2) as u16);
            let (count, place, room) =
                if is_big { (whole::<8>(order, bytes, 4), 12, 8) } else { (whole::<4>(order, bytes, 4), 8, 4) };
            // Values that fit stand in the entry itself.
            let is_inside = count.saturating_mul(size_of(kind)) <= room;
            let at = match (is_inside, is_big) {
                (true, _) => first + number as u64 * size + place as u64,
                (false, true) => whole::<8>(order, bytes, place),
                (false, false) => whole::<4>(order, bytes, place),
            };
            Entry { tag, kind, count, at }
        });
        let entries = entries.collect();
        // Where the file ends behind the entries, there is no other directory.
        let mut next = vec![0; link as usize];
        let is_there = content.read(field, first + count * size, &mut next).is_ok();
        let next = match (is_there, is_big) {
            (false, _) => 0,
            (true, true) => whole::<8>(order, &next, 0),
            (true, false) => whole::<4>(order, &next, 0),
        };
        Ok(Directory { content, order, is_big, entries, next })
    }

    fn entry(&self, tag: u16) -> Option<&Entry> {
        self.entries.iter().find(|entry| entry.tag == tag)
    }

    /// Whether there is an entry of this number.
    pub(super) fn has(&self, tag: u16) -> bool {
        self.entry(tag).is_some()
    }

    /// The bytes of an entry's first values, `most` at most, and how long each is.
    fn values(&self, entry: &Entry, most: u64) -> Result<(Vec<u8>, usize), ImportError> {
        let size = size_of(entry.kind);
        let field = format!("entry {}", entry.tag);
        if size == 0 {
            return Err(self.content.malformed(&field, format!("values of type {}", entry.kind), "a type of TIFF's"));
        }
        let bytes = entry.count.min(most).checked_mul(size);
        let bytes = bytes.ok_or_else(|| self.content.malformed(&field, format!("{} values", entry.count), "fewer"))?;
        Ok((self.content.bytes(&field, entry.at, bytes)?, size as usize))
    }

    /// Whole numbers of an entry, the first `most` of them; `None` where there is no such entry.
    ///
    /// # Errors
    /// Where they are none, or not in the file.
    pub(super) fn numbers(&self, tag: u16, most: u64) -> Result<Option<Vec<u64>>, ImportError> {
        let Some(entry) = self.entry(tag) else { return Ok(None) };
        let order = self.order;
        let (bytes, size) = self.values(entry, most)?;
        let of: fn(ByteOrder, &[u8]) -> u64 = match entry.kind {
            1 | 7 => |_, bytes| whole::<1>(ByteOrder::Little, bytes, 0),
            3 => |order, bytes| whole::<2>(order, bytes, 0),
            4 | 13 => |order, bytes| whole::<4>(order, bytes, 0),
            16 | 18 => |order, bytes| whole::<8>(order, bytes, 0),
            other => {
                let field = format!("entry {tag}");
                return Err(self.content.malformed(&field, format!("values of type {other}"), "whole numbers"));
            }
        };
        Ok(Some(bytes.chunks_exact(size).map(|bytes| of(order, bytes)).collect()))
    }

    /// The first whole number of an entry; `None` where there is no such entry, or nothing in it.
    ///
    /// # Errors
    /// As [`Directory::numbers`].
    pub(super) fn number(&self, tag: u16) -> Result<Option<u64>, ImportError> {
        Ok(self.numbers(tag, 1)?.and_then(|numbers| numbers.first().copied()))
    }

    /// The same, which has to be there.
    ///
    /// # Errors
    /// As [`Directory::numbers`], and where there is none.
    pub(super) fn needed(&self, tag: u16, name: &str) -> Result<u64, ImportError> {
        self.number(tag)?.ok_or_else(|| self.content.missing(name, &format!("entry {tag} of the directory")))
    }

    /// Floats of an entry, a thousand at most; `None` where there is no such entry.
    ///
    /// # Errors
    /// Where they are none, or not in the file.
    pub(super) fn floats(&self, tag: u16) -> Result<Option<Vec<f64>>, ImportError> {
        let Some(entry) = self.entry(tag) else { return Ok(None) };
        let (bytes, size) = self.values(entry, 1000)?;
        let of = |bytes: &[u8]| match entry.kind {
            11 => Some(f64::from(f32::from_bits(whole::<4>(self.order, bytes, 0) as u32))),
            12 => Some(f64::from_bits(whole::<8>(self.order, bytes, 0))),
            _ => None,
        };
        let floats: Option<Vec<f64>> = bytes.chunks_exact(size).map(of).collect();
        let field = format!("entry {tag}");
        let wrong = || self.content.malformed(&field, format!("values of type {}", entry.kind), "floats");
        floats.map(Some).ok_or_else(wrong)
    }

    /// The text of an entry, 64 KiB at most; `None` where there is no such entry.
    ///
    /// # Errors
    /// Where it is not in the file.
    pub(super) fn text(&self, tag: u16) -> Result<Option<String>, ImportError> {
        let Some(entry) = self.entry(tag) else { return Ok(None) };
        let (bytes, _) = self.values(entry, 1 << 16)?;
        Ok(Some(latin1(&bytes)))
    }

    /// Whether another image follows that is no smaller copy and no mask of this one.
    pub(super) fn has_another_image(&self) -> bool {
        let next = (self.next != 0).then(|| Directory::at(self.content, self.order, self.is_big, self.next));
        let kind = |next: Directory| next.number(tag::SUBFILE).ok().flatten().unwrap_or(0);
        next.and_then(Result::ok).is_some_and(|next| kind(next) & 0b101 == 0)
    }
}
