//! The page file's fixed structures: header, page-table entries, page headers and node records, byte by byte.
//!
//! `docs/page-file.md` holds the same tables; a test compares them with the constants here.

use super::error::Damage;
use super::page::{Encoding, Node, NodeRef, PageId};
use crate::hierarchy::NodeKey;
use crate::model::Bounds;
use glam::DVec3;

/// First bytes of the file. The high bit and the CR LF, SUB, LF sequence break visibly when the file is sent as text.
pub const MAGIC: [u8; 8] = *b"\x89DFP\r\n\x1a\n";
/// Version of the format that this program writes and reads.
pub const VERSION: u32 = 1;
/// Pages and the footer start at multiples of this; the header takes one such block.
pub const ALIGNMENT: u64 = 4096;
/// Bytes of the header that hold something; the rest of its block is zero.
pub const HEADER_LEN: usize = 64;
/// First four bytes of each page.
pub const PAGE_MAGIC: [u8; 4] = *b"DFpg";
/// Bytes of a page header.
pub const PAGE_HEADER_LEN: usize = 32;
/// Bytes of a node record.
pub const NODE_RECORD_LEN: usize = 192;
/// Bytes of an entry of the page table.
pub const PAGE_ENTRY_LEN: usize = 24;
/// Page number that means "no child".
pub const NO_PAGE: u32 = u32::MAX;
/// Position and code sections start at multiples of this inside a page.
pub const SECTION_ALIGNMENT: usize = 8;

/// The next multiple of `alignment`; `None` where that overflows.
pub fn align_up(value: u64, alignment: u64) -> Option<u64> {
    value.checked_next_multiple_of(alignment)
}

/// The fixed header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// Length of the whole file, bytes.
    pub file_len: u64,
    /// Where the footer starts.
    pub footer_offset: u64,
    /// Length of the footer, bytes.
    pub footer_len: u64,
    /// CRC-32C of the footer.
    pub footer_crc: u32,
    /// Number of pages.
    pub pages: u32,
}

/// Why a header was refused.
pub(super) enum HeaderError {
    NotAPageFile(&'static str),
    Version(u32),
    Damaged(Damage),
}

impl Header {
    /// The header's bytes, without the zeros that fill its block.
    pub fn encode(&self) -> [u8; HEADER_LEN] {
        let mut out = [0; HEADER_LEN];
        out[0..8].copy_from_slice(&MAGIC);
        out[8..12].copy_from_slice(&VERSION.to_le_bytes());
        out[12..16].copy_from_slice(&(ALIGNMENT as u32).to_le_bytes());
        out[16..24].copy_from_slice(&self.file_len.to_le_bytes());
        out[24..32].copy_from_slice(&self.footer_offset.to_le_bytes());
        out[32..40].copy_from_slice(&self.footer_len.to_le_bytes());
        out[40..44].copy_from_slice(&self.footer_crc.to_le_bytes());
        out[44..48].copy_from_slice(&self.pages.to_le_bytes());
        let crc = crc32c::crc32c(&out[..60]);
        out[60..64].copy_from_slice(&crc.to_le_bytes());
        out
    }

    /// Reads a header and checks it against the file's real length.
    pub(super) fn decode(bytes: &[u8], real_len: u64) -> Result<Header, HeaderError> {
        let bytes: &[u8; HEADER_LEN] = bytes
            .get(..HEADER_LEN)
            .and_then(|bytes| bytes.try_into().ok())
            .ok_or(HeaderError::NotAPageFile("a header of 64 bytes"))?;
        if bytes[..8] != MAGIC {
            return Err(HeaderError::NotAPageFile("its first eight bytes"));
        }
        let version = u32_at(bytes, 8);
        if version != VERSION {
            return Err(HeaderError::Version(version));
        }
        let damaged = |expected: &str| HeaderError::Damaged(Damage::new("header", expected));
        if crc32c::crc32c(&bytes[..60]) != u32_at(bytes, 60) {
            return Err(damaged("its checksum"));
        }
        let header = Header {
            file_len: u64_at(bytes, 16),
            footer_offset: u64_at(bytes, 24),
            footer_len: u64_at(bytes, 32),
            footer_crc: u32_at(bytes, 40),
            pages: u32_at(bytes, 44),
        };
        if u64::from(u32_at(bytes, 12)) != ALIGNMENT || bytes[48..60].iter().any(|&byte| byte != 0) {
            return Err(damaged("an alignment of 4096 and zeros in the reserved bytes"));
        }
        if header.file_len != real_len {
            let expected = format!("a file of {} bytes, found {real_len}: truncated or extended", header.file_len);
            return Err(HeaderError::Damaged(Damage::new("header", expected)));
        }
        let fits = header.footer_offset.checked_add(header.footer_len) == Some(header.file_len);
        if !fits || !header.footer_offset.is_multiple_of(ALIGNMENT) || header.footer_offset < ALIGNMENT {
            return Err(damaged("a footer that ends the file and starts at a multiple of 4096"));
        }
        Ok(header)
    }
}

/// Where a page lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PageEntry {
    /// First byte, a multiple of [`ALIGNMENT`].
    pub offset: u64,
    /// Bytes without the zeros up to the next page; a multiple of 8.
    pub len: u32,
    /// Number of node records.
    pub nodes: u32,
    /// Index of the family it belongs to.
    pub family: u32,
    /// CRC-32C of all its bytes.
    pub crc: u32,
}

impl PageEntry {
    /// The entry's bytes.
    pub fn encode(&self) -> [u8; PAGE_ENTRY_LEN] {
        let mut out = [0; PAGE_ENTRY_LEN];
        out[0..8].copy_from_slice(&self.offset.to_le_bytes());
        out[8..12].copy_from_slice(&self.len.to_le_bytes());
        out[12..16].copy_from_slice(&self.nodes.to_le_bytes());
        out[16..20].copy_from_slice(&self.family.to_le_bytes());
        out[20..24].copy_from_slice(&self.crc.to_le_bytes());
        out
    }

    /// Reads an entry; its values are not checked yet.
    pub fn decode(bytes: &[u8; PAGE_ENTRY_LEN]) -> PageEntry {
        PageEntry {
            offset: u64_at(bytes, 0),
            len: u32_at(bytes, 8),
            nodes: u32_at(bytes, 12),
            family: u32_at(bytes, 16),
            crc: u32_at(bytes, 20),
        }
    }
}

/// The header of a page: magic, page number, family, number of nodes, length, 12 zero bytes.
pub fn encode_page_header(page: PageId, family: u32, nodes: u32, len: u32) -> [u8; PAGE_HEADER_LEN] {
    let mut out = [0; PAGE_HEADER_LEN];
    out[0..4].copy_from_slice(&PAGE_MAGIC);
    out[4..8].copy_from_slice(&page.0.to_le_bytes());
    out[8..12].copy_from_slice(&family.to_le_bytes());
    out[12..16].copy_from_slice(&nodes.to_le_bytes());
    out[16..20].copy_from_slice(&len.to_le_bytes());
    out
}

/// A node record: the node, and where in its page the sections of its particles start.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeRecord {
    /// The node.
    pub node: Node,
    /// First byte of the positions, counted from the page's start.
    pub positions: u32,
    /// First byte of the codes.
    pub codes: u32,
}

impl NodeRecord {
    /// The record's bytes.
    pub fn encode(&self) -> [u8; NODE_RECORD_LEN] {
        let node = &self.node;
        let mut out = [0; NODE_RECORD_LEN];
        out[0] = node.key.depth;
        out[1] = match node.encoding {
            Encoding::Relay => 0,
            Encoding::Grid => 1,
            Encoding::Leaf => 2,
        };
        out[2..4].copy_from_slice(&node.codebook.to_le_bytes());
        let words = [node.key.x, node.key.y, node.key.z, node.particles, node.points, self.positions, self.codes];
        for (i, word) in words.into_iter().enumerate() {
            out[4 + 4 * i..8 + 4 * i].copy_from_slice(&word.to_le_bytes());
        }
        out[32..40].copy_from_slice(&node.source_particles.to_le_bytes());
        let (min, max) = (node.bounds.min, node.bounds.max);
        let doubles = [node.delta, min.x, min.y, min.z, max.x, max.y, max.z, node.mass, node.mass_density];
        for (i, double) in doubles.into_iter().enumerate() {
            out[40 + 8 * i..48 + 8 * i].copy_from_slice(&double.to_le_bytes());
        }
        let singles = [node.smoothing_length_max, node.mass_scale, node.mass_density_scale];
        for (i, single) in singles.into_iter().enumerate() {
            out[112 + 4 * i..116 + 4 * i].copy_from_slice(&single.to_le_bytes());
        }
        for (i, child) in node.children.iter().enumerate() {
            let (page, index) = child.map_or((NO_PAGE, 0), |child| (child.page.0, child.node));
            out[128 + 8 * i..132 + 8 * i].copy_from_slice(&page.to_le_bytes());
            out[132 + 8 * i..136 + 8 * i].copy_from_slice(&index.to_le_bytes());
        }
        out
    }

    /// Reads a record; checks only what a `Node` cannot express.
    pub(super) fn decode(bytes: &[u8; NODE_RECORD_LEN], place: impl Fn() -> String) -> Result<NodeRecord, Damage> {
        let encoding = match bytes[1] {
            0 => Encoding::Relay,
            1 => Encoding::Grid,
            2 => Encoding::Leaf,
            other => return Err(Damage::new(place(), format!("an encoding of 0, 1 or 2, found {other}"))),
        };
        if bytes[124..128] != [0; 4] {
            return Err(Damage::new(place(), "zeros in the reserved bytes"));
        }
        let vec_at = |at| DVec3::new(f64_at(bytes, at), f64_at(bytes, at + 8), f64_at(bytes, at + 16));
        let node = Node {
            key: NodeKey { depth: bytes[0], x: u32_at(bytes, 4), y: u32_at(bytes, 8), z: u32_at(bytes, 12) },
            encoding,
            codebook: u16::from_le_bytes([bytes[2], bytes[3]]),
            particles: u32_at(bytes, 16),
            points: u32_at(bytes, 20),
            source_particles: u64_at(bytes, 32),
            delta: f64_at(bytes, 40),
            bounds: Bounds { min: vec_at(48), max: vec_at(72) },
            mass: f64_at(bytes, 96),
            mass_density: f64_at(bytes, 104),
            smoothing_length_max: f32::from_bits(u32_at(bytes, 112)),
            mass_scale: f32::from_bits(u32_at(bytes, 116)),
            mass_density_scale: f32::from_bits(u32_at(bytes, 120)),
            children: std::array::from_fn(|i| {
                let (page, node) = (u32_at(bytes, 128 + 8 * i), u32_at(bytes, 132 + 8 * i));
                (page != NO_PAGE).then_some(NodeRef { page: PageId(page), node })
            }),
        };
        Ok(NodeRecord { node, positions: u32_at(bytes, 24), codes: u32_at(bytes, 28) })
    }
}

/// A little-endian `u32`; the callers' offsets are constants inside arrays of fixed length.
pub(super) fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from(u32_at(bytes, at)) | u64::from(u32_at(bytes, at + 4)) << 32
}

fn f64_at(bytes: &[u8], at: usize) -> f64 {
    f64::from_bits(u64_at(bytes, at))
}
