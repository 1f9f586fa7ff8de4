//! Where the values of a virtual data set lie: in other files, which its layout names. The reader library refuses such layouts, and with them every
//! list of what is in their group, so that they are looked up in the structures that it does read.

use super::file::{H5Group, guard};
use crate::import::ImportError;
use hdf5_reader::btree_v1::collect_btree_v1_leaves_storage;
use hdf5_reader::btree_v2::{BTreeV2Header, BTreeV2Record, collect_btree_v2_records_storage};
use hdf5_reader::checksum::jenkins_lookup3;
use hdf5_reader::error::{Error, Result};
use hdf5_reader::fractal_heap::FractalHeap;
use hdf5_reader::global_heap::GlobalHeapCollection;
use hdf5_reader::io::Cursor;
use hdf5_reader::local_heap::LocalHeap;
use hdf5_reader::messages::link::{LinkMessage, LinkTarget};
use hdf5_reader::messages::link_info::LinkInfoMessage;
use hdf5_reader::messages::symbol_table_msg::SymbolTableMessage;
use hdf5_reader::messages::{HdfMessage, MSG_CONTINUATION, MSG_DATA_LAYOUT, continuation, link};
use hdf5_reader::object_header::ObjectHeader;
use hdf5_reader::storage::Storage;
use hdf5_reader::symbol_table::SymbolTableNode;
use std::path::{Path, PathBuf};

/// The most bytes of a header, and of the names in a group.
const MOST_HEADER: usize = 1 << 26;

/// The most pieces that the header of a data set is in.
const MOST_PIECES: usize = 64;

/// The class of virtual layouts.
const VIRTUAL: u8 = 3;

/// The file that has the first values of the data set `name` of a group, as its layout calls it; `None` where there is no such data set, or it
/// has its values itself.
///
/// # Errors
/// When the file is damaged on the way there.
pub(super) fn source_file(group: &H5Group, name: &str) -> std::result::Result<Option<String>, ImportError> {
    guard(&group.file.path, &group.child(name), "a readable virtual layout", || {
        let (offset, length) = (group.group.offset_size(), group.group.length_size());
        let objects = Objects { storage: group.group.storage(), offset, length };
        let Some(address) = objects.address(group.group.address(), name)? else { return Ok(None) };
        let Some(layout) = objects.layout(address)? else { return Ok(None) };
        objects.first_source(&layout)
    })
}

/// The places at which a file is looked for that a virtual file names, the way HDF5 does: as it is where the name is a whole path, else below the
/// folder of the virtual file, then of the file that a link leads to. A file may have been moved with the virtual one, which comes last. Of
/// files with a number in their names (`%b`) it is the first.
pub(super) fn places(path: &Path, named: &str) -> impl Iterator<Item = PathBuf> {
    let named = PathBuf::from(named.replace("%b", "0").replace("%%", "%"));
    let linked = std::fs::canonicalize(path).ok();
    let last = named.file_name().map(|last| path.with_file_name(last));
    let folders = [Some(path), linked.as_deref()].into_iter().flatten().filter_map(Path::parent);
    let beside: Vec<PathBuf> = folders.map(|folder| folder.join(&named)).collect();
    beside.into_iter().chain(last)
}

/// The objects of a file, by the addresses of their headers.
struct Objects<'f> {
    storage: &'f dyn Storage,
    /// Bytes of an address.
    offset: u8,
    /// Bytes of a length.
    length: u8,
}

impl Objects<'_> {
    /// The address of the object `name` in the group at another.
    fn address(&self, group: u64, name: &str) -> Result<Option<u64>> {
        let header =
            ObjectHeader::parse_at_storage_with_limit(self.storage, group, self.offset, self.length, MOST_HEADER)?;
        let mut dense = None;
        for message in &header.messages {
            match message {
                HdfMessage::SymbolTable(table) => return self.in_table(table, name),
                HdfMessage::Link(link) if link.name == name => return Ok(hard(link)),
                HdfMessage::LinkInfo(info) => dense = Some(info),
                _ => {}
            }
        }
        let dense = dense.filter(|info| !Cursor::is_undefined_offset(info.fractal_heap_address, self.offset));
        dense.map_or(Ok(None), |info| self.in_heap(info, name))
    }

    /// Looks it up in a group of the older kind, whose names are in a heap of their own.
    fn in_table(&self, table: &SymbolTableMessage, name: &str) -> Result<Option<u64>> {
        let (storage, offset, length) = (self.storage, self.offset, self.length);
        let heap = LocalHeap::parse_at_storage(storage, table.heap_address, offset, length)?;
        let names = storage.read_range(heap.data_segment_address, in_header(heap.data_segment_size)?)?;
        let is_it = |from: u64| {
            let behind = names.get(from as usize..).and_then(|stored| stored.strip_prefix(name.as_bytes()));
            behind.is_some_and(|rest| rest.first() == Some(&0))
        };
        let leaves = collect_btree_v1_leaves_storage(storage, table.btree_address, offset, length, None, &[], None)?;
        for (_, leaf) in leaves {
            let head = storage.read_range(leaf, 8)?;
            let entries = usize::from(u16::from_le_bytes([head[6], head[7]]));
            let node = storage.read_range(leaf, 8 + entries * (2 * usize::from(offset) + 24))?;
            let node = SymbolTableNode::parse(&mut Cursor::new(&node), offset, length)?;
            // Links to names have no address.
            let found = node.entries.iter().find(|entry| entry.cache_type != 2 && is_it(entry.link_name_offset));
            if let Some(entry) = found {
                return Ok(Some(entry.object_header_address));
            }
        }
        Ok(None)
    }

    /// Looks it up in a group whose links are too many for its header.
    fn in_heap(&self, info: &LinkInfoMessage, name: &str) -> Result<Option<u64>> {
        let (storage, offset, length) = (self.storage, self.offset, self.length);
        let heap = FractalHeap::parse_at_storage(storage, info.fractal_heap_address, offset, length)?;
        let index = BTreeV2Header::parse_at_storage(storage, info.btree_name_index_address, offset, length)?;
        let records = collect_btree_v2_records_storage(storage, &index, offset, length, None, &[], None)?;
        let hash_of_name = jenkins_lookup3(name.as_bytes());
        for record in &records {
            if let BTreeV2Record::LinkNameHash { hash, heap_id } = record
                && *hash == hash_of_name
            {
                let bytes = heap.get_object_storage(heap_id, storage, offset, length)?;
                let link = link::parse(&mut Cursor::new(&bytes), offset, length, bytes.len())?;
                if link.name == name {
                    return Ok(hard(&link));
                }
            }
        }
        Ok(None)
    }

    /// The message in an object's header that says how its values are laid out.
    fn layout(&self, address: u64) -> Result<Option<Vec<u8>>> {
        let head = self.storage.read_range(address, 12)?;
        let is_new = head.starts_with(b"OHDR");
        // Where messages begin, how many bytes they take, and how many stand before each.
        let (before, size, envelope) = if is_new {
            let flags = head[5];
            let times = if flags & 0x20 == 0 { 0 } else { 16 };
            let before = 6 + times + if flags & 0x10 == 0 { 0 } else { 4 };
            let width = 1usize << (flags & 3);
            let size = self.storage.read_range(address.saturating_add(before), width)?;
            let size = Cursor::new(&size).read_uvar(width)?;
            (before + width as u64, size, if flags & 4 == 0 { 4 } else { 6 })
        } else {
            (16, u64::from(u32::from_le_bytes([head[8], head[9], head[10], head[11]])), 8)
        };
        let mut pieces = vec![(address.saturating_add(before), size)];
        let mut taken = 0;
        while let Some(&(start, size)) = pieces.get(taken).filter(|_| taken < MOST_PIECES) {
            taken += 1;
            let bytes = self.storage.read_range(start, in_header(size)?)?;
            let mut rest: &[u8] = &bytes;
            while let Some((head, behind)) = rest.split_at_checked(envelope) {
                let (kind, size) = match is_new {
                    true => (u16::from(head[0]), u16::from_le_bytes([head[1], head[2]])),
                    false => (u16::from_le_bytes([head[0], head[1]]), u16::from_le_bytes([head[2], head[3]])),
                };
                let Some((body, behind)) = behind.split_at_checked(size.into()) else { break };
                match kind {
                    MSG_DATA_LAYOUT => return Ok(Some(body.to_vec())),
                    MSG_CONTINUATION => {
                        let next = continuation::parse(&mut Cursor::new(body), self.offset, self.length, body.len())?;
                        // The newer kind has a signature before it and a checksum behind.
                        let (before, around) = if is_new { (4, 8) } else { (0, 0) };
                        pieces.push((next.offset.saturating_add(before), next.length.saturating_sub(around)));
                    }
                    _ => {}
                }
                rest = behind;
            }
        }
        Ok(None)
    }

    /// The file that the first part of a virtual layout is in; `None` where it is another layout, is empty, or has its values in its own file.
    fn first_source(&self, layout: &[u8]) -> Result<Option<String>> {
        let mut layout = Cursor::new(layout);
        let (version, class) = (layout.read_u8()?, layout.read_u8()?);
        if version < 4 || class != VIRTUAL {
            return Ok(None);
        }
        let (heap, index) = (layout.read_offset(self.offset)?, layout.read_u32_le()?);
        if Cursor::is_undefined_offset(heap, self.offset) {
            return Ok(None);
        }
        let heap = GlobalHeapCollection::parse_at_storage(self.storage, heap, self.offset, self.length)?;
        let list = u16::try_from(index).ok().and_then(|index| heap.get_object(index));
        let Some(list) = list else { return Ok(None) };
        let mut list = Cursor::new(&list.data);
        let (version, parts) = (list.read_u8()?, list.read_length(self.length)?);
        // From version 1 on each part says first what it has in common with others, or with the file itself.
        if parts == 0 || version > 1 || (version == 1 && list.read_u8()? != 0) {
            return Ok(None);
        }
        Ok(Some(list.read_null_terminated_string()?).filter(|file| file != "."))
    }
}

/// A number of bytes that are read at once.
///
/// # Errors
/// When no header has as many.
fn in_header(bytes: u64) -> Result<usize> {
    let wrong = || Error::InvalidData(format!("found {bytes} bytes, expected at most {MOST_HEADER}"));
    usize::try_from(bytes).ok().filter(|bytes| *bytes <= MOST_HEADER).ok_or_else(wrong)
}

/// The address that a link leads to, where it is one to an object of the file itself.
fn hard(link: &LinkMessage) -> Option<u64> {
    match link.target {
        LinkTarget::Hard { address } => Some(address),
        LinkTarget::Soft { .. } | LinkTarget::External { .. } => None,
    }
}
