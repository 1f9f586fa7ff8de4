//! The structure of HDF5 files with groups of contiguous data sets, after the format's specification, version 3
//! (<https://support.hdfgroup.org/documentation/hdf5/latest/_f_m_t3.html>): superblock 0, object headers 1, links as messages. What reads
//! HDF5 since 1.8 reads it.

/// Bytes of the superblock, which a file begins with.
pub(super) const SUPERBLOCK: usize = 96;

/// An address that there is not.
const NOWHERE: u64 = u64::MAX;

/// Kinds of messages in object headers.
const DATASPACE: u16 = 1;
const LINK_INFO: u16 = 2;
const DATATYPE: u16 = 3;
const LINK: u16 = 6;
const LAYOUT: u16 = 8;
const ATTRIBUTE: u16 = 12;

/// The longest name of a data set, and the longest text of an attribute, bytes: a link's name has a length of one byte, a message one of two.
const LONGEST_NAME: usize = 255;
const LONGEST_TEXT: usize = 1 << 12;

/// The numbers of a data set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Number {
    U64,
    F64,
}

/// What an attribute holds; one number is a scalar.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Value {
    Flag(i32),
    Counts(Vec<u64>),
    Numbers(Vec<f64>),
    Text(String),
}

/// Names and contents of the attributes of an object.
pub(super) type Attributes = Vec<(&'static str, Value)>;

/// A data set, whose numbers are in the file already, least significant byte first.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Dataset {
    pub name: String,
    pub number: Number,
    /// Rows and columns; one number a row has no second dimension.
    pub rows: u64,
    pub columns: usize,
    /// Its first byte.
    pub at: u64,
    pub attributes: Attributes,
}

/// A group of the root.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Group {
    pub name: String,
    pub attributes: Attributes,
    pub datasets: Vec<Dataset>,
}

/// What stands behind the numbers of all data sets, from byte `at` on, and the superblock.
pub(super) fn structure(groups: &[Group], at: u64) -> (Vec<u8>, Vec<u8>) {
    let mut objects = Objects { at, bytes: Vec::new() };
    let mut links = Vec::new();
    for group in groups {
        let mut messages = vec![link_info()];
        for dataset in &group.datasets {
            let address = objects.add(&dataset.messages());
            messages.push(link(&dataset.name, address));
        }
        messages.extend(group.attributes.iter().map(attribute));
        links.push(link(&group.name, objects.add(&messages)));
    }
    let messages: Vec<Message> = std::iter::once(link_info()).chain(links).collect();
    let root = objects.add(&messages);
    let end = at + objects.bytes.len() as u64;
    // Versions, sizes of addresses and lengths, and numbers of entries in nodes that there are none of.
    let head = [&b"\x89HDF\r\n\x1a\n"[..], &[0, 0, 0, 0, 0, 8, 8, 0, 4, 0, 16, 0, 0, 0, 0, 0]].concat();
    let addresses = [0, NOWHERE, end, NOWHERE, 0, root].into_iter().flat_map(u64::to_le_bytes);
    let mut superblock: Vec<u8> = head.into_iter().chain(addresses).collect();
    superblock.resize(SUPERBLOCK, 0);
    (objects.bytes, superblock)
}

type Message = (u16, Vec<u8>);

/// Headers of objects, one behind the other.
struct Objects {
    at: u64,
    bytes: Vec<u8>,
}

impl Objects {
    /// Appends the header of an object, and gives its address.
    fn add(&mut self, messages: &[Message]) -> u64 {
        let mut all = Vec::new();
        for (kind, content) in messages {
            let size = content.len().next_multiple_of(8);
            all.extend(kind.to_le_bytes());
            all.extend((size as u16).to_le_bytes());
            all.extend([0; 4]);
            all.extend(content);
            all.resize(all.len() + size - content.len(), 0);
        }
        let address = self.at + self.bytes.len() as u64;
        self.bytes.extend([1, 0]);
        self.bytes.extend((messages.len() as u16).to_le_bytes());
        self.bytes.extend(1u32.to_le_bytes());
        self.bytes.extend((all.len() as u32).to_le_bytes());
        self.bytes.extend([0; 4]);
        self.bytes.extend(all);
        address
    }
}

impl Dataset {
    fn messages(&self) -> Vec<Message> {
        let shape = if self.columns == 1 { vec![self.rows] } else { vec![self.rows, self.columns as u64] };
        let bytes = 8 * self.rows * self.columns as u64;
        let layout = [&[3, 1][..], &self.at.to_le_bytes(), &bytes.to_le_bytes()].concat();
        let datatype = match self.number {
            Number::U64 => whole(8, 0),
            Number::F64 => double(),
        };
        let own = [(DATASPACE, dataspace(&shape)), (DATATYPE, datatype), (LAYOUT, layout)];
        own.into_iter().chain(self.attributes.iter().map(attribute)).collect()
    }
}

/// A whole number of so many bytes; `sign`: 8 for one with a sign.
fn whole(size: u8, sign: u8) -> Vec<u8> {
    vec![0x10, sign, 0, 0, size, 0, 0, 0, 0, 0, size * 8, 0]
}

/// A number of IEEE 754 in double precision.
fn double() -> Vec<u8> {
    vec![0x11, 0x20, 63, 0, 8, 0, 0, 0, 0, 0, 64, 0, 52, 11, 0, 52, 0xff, 3, 0, 0]
}

fn dataspace(shape: &[u64]) -> Vec<u8> {
    let head = [1, shape.len() as u8, 0, 0, 0, 0, 0, 0];
    head.into_iter().chain(shape.iter().flat_map(|size| size.to_le_bytes())).collect()
}

/// That links are messages, in no order.
fn link_info() -> Message {
    (LINK_INFO, [&[0, 0][..], &NOWHERE.to_le_bytes(), &NOWHERE.to_le_bytes()].concat())
}

fn link(name: &str, address: u64) -> Message {
    let name = cut(name, LONGEST_NAME);
    (LINK, [&[1, 0, name.len() as u8][..], name.as_bytes(), &address.to_le_bytes()].concat())
}

fn attribute((name, value): &(&'static str, Value)) -> Message {
    let (datatype, count, content): (Vec<u8>, usize, Vec<u8>) = match value {
        Value::Flag(flag) => (whole(4, 8), 1, flag.to_le_bytes().to_vec()),
        Value::Counts(counts) => {
            (whole(8, 0), counts.len(), counts.iter().flat_map(|count| count.to_le_bytes()).collect())
        }
        Value::Numbers(numbers) => {
            (double(), numbers.len(), numbers.iter().flat_map(|number| number.to_le_bytes()).collect())
        }
        Value::Text(text) => {
            // UTF-8, with a 0 at the end.
            let text = [cut(text, LONGEST_TEXT).as_bytes(), &[0]].concat();
            ([&[0x13, 0x10, 0, 0][..], &(text.len() as u32).to_le_bytes()].concat(), 1, text)
        }
    };
    let shape = if count == 1 { vec![] } else { vec![count as u64] };
    let parts = [[name.as_bytes(), &[0]].concat(), datatype, dataspace(&shape)];
    let sizes = parts.iter().flat_map(|part| (part.len() as u16).to_le_bytes());
    let mut out: Vec<u8> = [1, 0].into_iter().chain(sizes).collect();
    for part in parts {
        out.extend(part);
        out.resize(out.len().next_multiple_of(8), 0);
    }
    out.extend(content);
    (ATTRIBUTE, out)
}

/// The beginning of a text, of at most so many bytes.
fn cut(text: &str, most: usize) -> &str {
    let end = (0..=most.min(text.len())).rev().find(|end| text.is_char_boundary(*end)).unwrap_or(0);
    &text[..end]
}
