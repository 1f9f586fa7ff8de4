//! The compact protocol of Apache Thrift (<https://github.com/apache/thrift/blob/master/doc/specs/thrift-compact-protocol.md>), as far as
//! lengths have to be known before the library makes room for them: the tree of a schema, and the headers of pages.

/// The deepest tree of columns, and nesting of what is passed over.
const DEEPEST: usize = 64;

/// Kinds of values.
const LIST: u8 = 9;
const STRUCT: u8 = 12;

/// Bytes that are read from the front.
struct Compact<'a> {
    left: &'a [u8],
}

impl Compact<'_> {
    fn byte(&mut self) -> Option<u8> {
        let (first, left) = self.left.split_first()?;
        self.left = left;
        Some(*first)
    }

    fn pass(&mut self, bytes: u64) -> Option<()> {
        self.left = self.left.get(usize::try_from(bytes).ok()?..)?;
        Some(())
    }

    /// Seven bits a byte, the lowest first.
    fn varint(&mut self) -> Option<u64> {
        let mut value = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.byte()?;
            value |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                return Some(value);
            }
        }
        None
    }

    /// A whole number, whose lowest bit is its sign.
    fn whole(&mut self) -> Option<i64> {
        let value = self.varint()?;
        Some((value >> 1) as i64 ^ -((value & 1) as i64))
    }

    /// Calls `take` with number and kind of each field of a structure; it reads the field to its end.
    fn fields(&mut self, mut take: impl FnMut(&mut Self, i64, u8) -> Option<()>) -> Option<()> {
        let mut number = 0_i64;
        loop {
            let byte = self.byte()?;
            let (step, kind) = (byte >> 4, byte & 15);
            if kind == 0 {
                return Some(());
            }
            number = if step == 0 { self.whole()? } else { number.checked_add(i64::from(step))? };
            take(self, number, kind)?;
        }
    }

    /// The number and the kind of the items of a list.
    fn list(&mut self) -> Option<(u64, u8)> {
        let byte = self.byte()?;
        let count = if byte >> 4 == 15 { self.varint()? } else { u64::from(byte >> 4) };
        // Every item has a byte at least.
        (count <= self.left.len() as u64).then_some((count, byte & 15))
    }

    /// Passes over a value; `depth` is how deep it lies.
    fn skip(&mut self, kind: u8, depth: usize) -> Option<()> {
        if depth > DEEPEST {
            return None;
        }
        match kind {
            // Truth values of fields are kinds of their own.
            1 | 2 => Some(()),
            3 => self.pass(1),
            4..=6 => self.varint().map(drop),
            7 => self.pass(8),
            8 => {
                let length = self.varint()?;
                self.pass(length)
            }
            LIST | 10 => {
                let (count, kind) = self.list()?;
                (0..count).try_for_each(|_| self.item(kind, depth))
            }
            11 => {
                let count = self.varint()?;
                if count == 0 {
                    return Some(());
                }
                let kinds = self.byte()?;
                (0..count).try_for_each(|_| {
                    self.item(kinds >> 4, depth)?;
                    self.item(kinds & 15, depth)
                })
            }
            STRUCT => self.fields(|inner, _, kind| inner.skip(kind, depth + 1)),
            13 => self.pass(16),
            _ => None,
        }
    }

    /// Passes over an item of a list, where truth values are a byte.
    fn item(&mut self, kind: u8, depth: usize) -> Option<()> {
        if matches!(kind, 1 | 2) { self.pass(1) } else { self.skip(kind, depth + 1) }
    }
}

/// Whether the schema in a file's footer is a tree, no deeper than what can be read.
pub(super) fn has_sound_schema(footer: &[u8]) -> bool {
    let mut is_sound = true;
    let read = Compact { left: footer }.fields(|footer, number, kind| {
        if (number, kind) != (2, LIST) {
            return footer.skip(kind, 0);
        }
        let (count, kind) = footer.list()?;
        if kind != STRUCT {
            return None;
        }
        let mut children = Vec::new();
        for _ in 0..count {
            let mut own = 0;
            footer.fields(|element, number, kind| {
                if (number, kind) == (5, 5) {
                    own = element.whole()?;
                    return Some(());
                }
                element.skip(kind, 0)
            })?;
            children.push(own);
        }
        is_sound &= is_tree(&children);
        Some(())
    });
    is_sound && read.is_some()
}

/// Whether nodes, each before its so many children, are one tree.
fn is_tree(children: &[i64]) -> bool {
    // How many children are still to come of the nodes above; the root is the only one of nothing.
    let mut missing = vec![1];
    for (at, own) in children.iter().enumerate() {
        while missing.last() == Some(&0) {
            missing.pop();
        }
        let Some(above) = missing.last_mut() else { return false };
        *above -= 1;
        if !(0..(children.len() - at) as i64).contains(own) {
            return false;
        }
        if *own > 0 {
            missing.push(*own);
            if missing.len() > DEEPEST {
                return false;
            }
        }
    }
    missing.iter().all(|left| *left == 0)
}

/// Kinds of pages.
pub(super) const DATA: i64 = 0;
pub(super) const DICTIONARY: i64 = 2;
pub(super) const DATA_2: i64 = 3;

/// What the header of a page says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct PageHeader {
    /// Bytes of the header.
    pub bytes: u64,
    /// The kind of page.
    pub kind: i64,
    /// Bytes of the page when it is unpacked.
    pub plain: i64,
    /// Bytes of the page in the file.
    pub stored: i64,
    /// How many values it has, those that are missing among them.
    pub values: i64,
}

/// The header that bytes begin with; `None` where they end before it or are none.
pub(super) fn page_header(bytes: &[u8]) -> Option<PageHeader> {
    let mut header = PageHeader { kind: -1, ..PageHeader::default() };
    let mut compact = Compact { left: bytes };
    compact.fields(|fields, number, kind| {
        match (number, kind) {
            (1, 5) => header.kind = fields.whole()?,
            (2, 5) => header.plain = fields.whole()?,
            (3, 5) => header.stored = fields.whole()?,
            // The header of a page of data, of a dictionary, and of a page of data of the second version.
            (5 | 7 | 8, STRUCT) => fields.fields(|inner, number, kind| {
                if (number, kind) == (1, 5) {
                    // Of several such headers the library takes one of its own choice.
                    header.values = header.values.max(inner.whole()?);
                    return Some(());
                }
                inner.skip(kind, 1)
            })?,
            _ => fields.skip(kind, 0)?,
        }
        Some(())
    })?;
    header.bytes = (bytes.len() - compact.left.len()) as u64;
    Some(header)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_of_pages_are_read_as_specified() {
        // A page of data: kind 0, 300 bytes, 20 in the file, 150 values of encoding 3 with levels of encoding 3, and statistics.
        let header = [
            &[0x15, 0, 0x15, 0xd8, 0x04, 0x15, 0x28, 0x2c, 0x15, 0xac, 0x02, 0x15, 6, 0x15, 6, 0x15, 6][..],
            &[0x1c, 0x18, 2, b'a', b'b', 0, 0, 0],
        ]
        .concat();
        let expected = PageHeader { bytes: header.len() as u64, kind: DATA, plain: 300, stored: 20, values: 150 };
        assert_eq!(page_header(&[&header[..], b"data"].concat()), Some(expected));
        assert!((0..header.len()).all(|length| page_header(&header[..length]).is_none()));
    }

    #[test]
    fn only_trees_are_schemas() {
        let cases: [(&[i64], bool); 8] = [
            (&[2, 0, 0], true),
            (&[2, 1, 0, 0], true),
            (&[0], true),
            (&[1, 1, 1, 0], true),
            (&[3, 0, 0], false),
            (&[1, 0, 0], false),
            (&[i64::from(i32::MAX), 0], false),
            (&[-1, 0], false),
        ];
        for (children, expected) in cases {
            assert_eq!(is_tree(children), expected, "{children:?}");
        }
        let chain: Vec<i64> = (0..1000).map(|at| i64::from(at < 999)).collect();
        assert!(!is_tree(&chain));
    }
}
