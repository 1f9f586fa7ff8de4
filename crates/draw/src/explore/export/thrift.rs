//! The compact protocol of Apache Thrift, as far as Parquet's headers need it: structures of numbers, texts, lists and structures.
//! <https://github.com/apache/thrift/blob/master/doc/specs/thrift-compact-protocol.md>

/// Bytes of a structure that is being written. Fields are written in ascending order of their numbers.
#[derive(Default)]
pub(super) struct Struct {
    bytes: Vec<u8>,
    last: i16,
}

/// Types of fields and of items of lists.
const I32: u8 = 5;
const I64: u8 = 6;
const BINARY: u8 = 8;
const LIST: u8 = 9;
const STRUCT: u8 = 12;

impl Struct {
    fn field(&mut self, number: i16, kind: u8) {
        // Numbers ascend by at most 15 here, which is the short form.
        let step = (number - self.last).clamp(1, 15) as u8;
        self.bytes.push(step << 4 | kind);
        self.last = number;
    }

    pub(super) fn i32(mut self, number: i16, value: i32) -> Struct {
        self.field(number, I32);
        varint(&mut self.bytes, zigzag(i64::from(value)));
        self
    }

    pub(super) fn i64(mut self, number: i16, value: i64) -> Struct {
        self.field(number, I64);
        varint(&mut self.bytes, zigzag(value));
        self
    }

    pub(super) fn text(mut self, number: i16, text: &str) -> Struct {
        self.field(number, BINARY);
        binary(&mut self.bytes, text);
        self
    }

    pub(super) fn inner(mut self, number: i16, inner: Struct) -> Struct {
        self.field(number, STRUCT);
        self.bytes.extend(inner.finish());
        self
    }

    pub(super) fn structs(mut self, number: i16, items: impl ExactSizeIterator<Item = Struct>) -> Struct {
        self.field(number, LIST);
        list(&mut self.bytes, STRUCT, items.len());
        items.for_each(|item| self.bytes.extend(item.finish()));
        self
    }

    pub(super) fn texts(mut self, number: i16, items: &[&str]) -> Struct {
        self.field(number, LIST);
        list(&mut self.bytes, BINARY, items.len());
        items.iter().for_each(|item| binary(&mut self.bytes, item));
        self
    }

    pub(super) fn i32s(mut self, number: i16, items: &[i32]) -> Struct {
        self.field(number, LIST);
        list(&mut self.bytes, I32, items.len());
        items.iter().for_each(|item| varint(&mut self.bytes, zigzag(i64::from(*item))));
        self
    }

    /// The bytes, with the mark of the end.
    pub(super) fn finish(mut self) -> Vec<u8> {
        self.bytes.push(0);
        self.bytes
    }
}

fn list(bytes: &mut Vec<u8>, kind: u8, len: usize) {
    if len < 15 {
        bytes.push((len as u8) << 4 | kind);
    } else {
        bytes.push(0xf0 | kind);
        varint(bytes, len as u64);
    }
}

fn binary(bytes: &mut Vec<u8>, text: &str) {
    varint(bytes, text.len() as u64);
    bytes.extend_from_slice(text.as_bytes());
}

fn zigzag(value: i64) -> u64 {
    (value << 1 ^ value >> 63) as u64
}

/// Seven bits a byte, the lowest first.
pub(super) fn varint(bytes: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        bytes.push(value as u8 | 0x80);
        value >>= 7;
    }
    bytes.push(value as u8);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn structures_are_written_as_specified() {
        let inner = Struct::default().i32(1, -1).text(4, "ab");
        let outer = Struct::default().i64(2, 150).inner(3, inner).i32s(5, &[0, 1, -2]).texts(6, &["x"]);
        let expected: Vec<u8> = [
            &[0x26, 0xac, 0x02][..],
            &[0x1c, 0x15, 0x01, 0x38, 2, b'a', b'b', 0],
            &[0x29, 0x35, 0, 2, 3],
            &[0x19, 0x18, 1, b'x'],
            &[0],
        ]
        .concat();
        assert_eq!(outer.finish(), expected);
        let many = Struct::default().i32s(1, &[0; 20]).finish();
        assert_eq!(many[..3], [0x19, 0xf5, 20]);
    }
}
