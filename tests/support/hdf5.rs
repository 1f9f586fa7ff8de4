//! A writer of small HDF5 files: groups, in each other where their names say so, with attributes and contiguous data sets, as the format's specification has them
//! (superblock 0, object headers 1, links as messages).

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Numbers of one type, a text, or records.
#[derive(Clone, Debug)]
pub enum Values {
    U32(Vec<u32>),
    U64(Vec<u64>),
    I32(Vec<i32>),
    F64(Vec<f64>),
    Text(&'static str),
    /// So many, each with members of these names, of so many numbers each, which are here member by member.
    Records(usize, Vec<(&'static str, usize, Values)>),
}

/// An address that there is not.
const NOWHERE: u64 = u64::MAX;

/// Kinds of messages.
const DATASPACE: u16 = 1;
const LINK_INFO: u16 = 2;
const DATATYPE: u16 = 3;
const LINK: u16 = 6;
const LAYOUT: u16 = 8;
const ATTRIBUTE: u16 = 12;

/// A file to be written.
#[derive(Clone, Debug, Default)]
pub struct Hdf5 {
    groups: BTreeMap<String, Group>,
}

/// What is in a group.
#[derive(Clone, Debug, Default)]
struct Group {
    attributes: Vec<(String, Values)>,
    /// With the length of each axis.
    datasets: Vec<(String, Vec<usize>, Values)>,
}

impl Hdf5 {
    /// Adds an attribute to a group, to the root with an empty name, or to a data set that has this name with its group's.
    pub fn attribute(&mut self, group: &str, name: &str, values: Values) {
        self.groups.entry(group.into()).or_default().attributes.push((name.into(), values));
    }

    /// Adds a data set of so many columns to a group.
    pub fn dataset(&mut self, group: &str, name: &str, columns: usize, values: Values) {
        let (rows, axes) = (values.len() / columns, if columns == 1 { 1 } else { 2 });
        self.array(group, name, &[rows, columns][..axes], values);
    }

    /// Adds a data set of these axes to a group.
    pub fn array(&mut self, group: &str, name: &str, shape: &[usize], values: Values) {
        self.groups.entry(group.into()).or_default().datasets.push((name.into(), shape.into(), values));
    }

    /// Writes the file.
    pub fn write(&self, path: &Path) {
        let mut bytes = vec![0; 96];
        let root = self.group("", &mut bytes);
        let end = bytes.len() as u64;
        let head = [&b"\x89HDF\r\n\x1a\n"[..], &[0, 0, 0, 0, 0, 8, 8, 0, 4, 0, 16, 0, 0, 0, 0, 0]].concat();
        let addresses = [0, NOWHERE, end, NOWHERE, 0, root].into_iter().flat_map(u64::to_le_bytes);
        let superblock: Vec<u8> = head.into_iter().chain(addresses).collect();
        bytes[..superblock.len()].copy_from_slice(&superblock);
        std::fs::write(path, bytes).unwrap();
    }

    /// Appends a group with all that is in it, and gives its address.
    fn group(&self, path: &str, bytes: &mut Vec<u8>) -> u64 {
        let inside = |name: &str| if path.is_empty() { name.to_owned() } else { format!("{path}/{name}") };
        let none = Group::default();
        let group = self.groups.get(path).unwrap_or(&none);
        let mut messages = vec![link_info()];
        for (name, shape, values) in &group.datasets {
            let at = bytes.len() as u64;
            let content = values.bytes();
            bytes.extend(&content);
            bytes.resize(bytes.len().next_multiple_of(8), 0);
            let layout = [&[3, 1][..], &at.to_le_bytes(), &(content.len() as u64).to_le_bytes()].concat();
            let mut own = vec![(DATASPACE, dataspace(shape)), (DATATYPE, values.datatype()), (LAYOUT, layout)];
            own.extend(self.groups.get(&inside(name)).unwrap_or(&none).messages());
            messages.push((LINK, link(name, object(bytes, &own))));
        }
        let prefix = inside("");
        let is_group = |name: &&str| !name.is_empty() && group.datasets.iter().all(|(other, ..)| other != name);
        let below = self.groups.keys().filter_map(|key| key.strip_prefix(&*prefix)?.split('/').next());
        let names: BTreeSet<&str> = below.filter(is_group).collect();
        for name in names {
            messages.push((LINK, link(name, self.group(&inside(name), bytes))));
        }
        messages.extend(group.messages());
        object(bytes, &messages)
    }
}

impl Group {
    /// Its attributes.
    fn messages(&self) -> impl Iterator<Item = (u16, Vec<u8>)> {
        self.attributes.iter().map(|(name, values)| (ATTRIBUTE, attribute(name, values)))
    }
}

impl Values {
    fn len(&self) -> usize {
        match self {
            Values::U32(values) => values.len(),
            Values::U64(values) => values.len(),
            Values::I32(values) => values.len(),
            Values::F64(values) => values.len(),
            Values::Text(_) => 1,
            Values::Records(rows, _) => *rows,
        }
    }

    fn bytes(&self) -> Vec<u8> {
        match self {
            Values::U32(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            Values::U64(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            Values::I32(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            Values::F64(values) => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            Values::Text(text) => text.as_bytes().to_vec(),
            Values::Records(rows, members) => {
                let members: Vec<Vec<u8>> = members.iter().map(|(.., values)| values.bytes()).collect();
                let part = |member: &Vec<u8>, row: usize| {
                    let size = member.len() / rows;
                    member[row * size..][..size].to_vec()
                };
                (0..*rows).flat_map(|row| members.iter().flat_map(move |member| part(member, row))).collect()
            }
        }
    }

    fn datatype(&self) -> Vec<u8> {
        let whole = |size: u8, sign: u8| vec![0x10, sign, 0, 0, size, 0, 0, 0, 0, 0, size * 8, 0];
        match self {
            Values::U32(_) => whole(4, 0),
            Values::U64(_) => whole(8, 0),
            Values::I32(_) => whole(4, 8),
            Values::Text(text) => [&[0x13, 0, 0, 0][..], &(text.len() as u32).to_le_bytes()].concat(),
            Values::F64(_) => vec![0x11, 0x20, 63, 0, 8, 0, 0, 0, 0, 0, 64, 0, 52, 11, 0, 52, 0xff, 3, 0, 0],
            Values::Records(rows, members) => {
                let mut out = Vec::new();
                let mut at = 0;
                for (name, components, values) in members {
                    let size = values.bytes().len() / rows;
                    out.extend([name.as_bytes(), &[0, at as u8]].concat());
                    if *components > 1 {
                        out.extend([&[0x3a, 0, 0, 0][..], &(size as u32).to_le_bytes(), &[1]].concat());
                        out.extend((*components as u32).to_le_bytes());
                    }
                    out.extend(values.datatype());
                    at += size;
                }
                assert!(at < 256, "places of members take a byte");
                [&[0x36, members.len() as u8, 0, 0][..], &(at as u32).to_le_bytes(), &out[..]].concat()
            }
        }
    }
}

fn dataspace(shape: &[usize]) -> Vec<u8> {
    let head = [1, shape.len() as u8, 0, 0, 0, 0, 0, 0];
    head.into_iter().chain(shape.iter().flat_map(|size| (*size as u64).to_le_bytes())).collect()
}

fn link_info() -> (u16, Vec<u8>) {
    (LINK_INFO, [&[0, 0][..], &NOWHERE.to_le_bytes(), &NOWHERE.to_le_bytes()].concat())
}

fn link(name: &str, address: u64) -> Vec<u8> {
    [&[1, 0, name.len() as u8][..], name.as_bytes(), &address.to_le_bytes()].concat()
}

fn attribute(name: &str, values: &Values) -> Vec<u8> {
    // One number is a scalar.
    let shape = if values.len() == 1 { vec![] } else { vec![values.len()] };
    let parts = [[name.as_bytes(), &[0]].concat(), values.datatype(), dataspace(&shape)];
    let sizes = parts.iter().flat_map(|part| (part.len() as u16).to_le_bytes());
    let mut out: Vec<u8> = [1, 0].into_iter().chain(sizes).collect();
    for part in parts {
        out.extend(part);
        out.resize(out.len().next_multiple_of(8), 0);
    }
    out.extend(values.bytes());
    out
}

/// Appends an object's header, and gives its address.
fn object(bytes: &mut Vec<u8>, messages: &[(u16, Vec<u8>)]) -> u64 {
    let mut all = Vec::new();
    for (kind, content) in messages {
        let size = content.len().next_multiple_of(8);
        all.extend(kind.to_le_bytes());
        all.extend((size as u16).to_le_bytes());
        all.extend([0; 4]);
        all.extend(content);
        all.resize(all.len() + size - content.len(), 0);
    }
    let at = bytes.len() as u64;
    bytes.extend([1, 0]);
    bytes.extend((messages.len() as u16).to_le_bytes());
    bytes.extend(1u32.to_le_bytes());
    bytes.extend((all.len() as u32).to_le_bytes());
    bytes.extend([0; 4]);
    bytes.extend(all);
    at
}
