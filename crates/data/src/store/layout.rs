//! The page file's fixed structures: header, page-table entries, page headers and node records, byte by byte.
//!
//! `docs/page-file.md` holds the same tables; a test compares them with the constants here.

use super::error::Damage;
use super::page::{Encoding, NodeRef, PageId};
use crate::hierarchy::NodeKey;
use crate::model::Bounds;
use crate::model::portable::portable;
use glam::DVec3;
use std::ops::RangeInclusive;

/// First bytes of a file of particles. The high bit and the CR LF, SUB, LF sequence break visibly when the file is sent as text.
pub const MAGIC: [u8; 8] = *b"\x89DFP\r\n\x1a\n";
/// First bytes of a file of a grid.
pub const GRID_MAGIC: [u8; 8] = *b"\x89DFG\r\n\x1a\n";
/// Version of files without levels for volumes.
pub const VERSION: u32 = 2;
/// Version of files with levels for volumes.
pub const VERSION_VOLUME: u32 = 3;
/// Version of files with families that are none of Gadget's, or with clusters.
pub const VERSION_NAMED: u32 = 4;
/// Version of files whose codes of leaves are refined.
pub const VERSION_REFINED: u32 = 5;
/// Version of files with nodes deeper than [`DEPTH_BEFORE`].
pub const VERSION_DEEP: u32 = 6;
/// Version of files whose page table lies before the footer, in index pages.
pub const VERSION_INDEXED: u32 = 7;
/// The deepest node of files before [`VERSION_DEEP`].
pub const DEPTH_BEFORE: u8 = 14;
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
pub const PAGE_ENTRY_LEN: usize = 28;
/// Bytes of an index record.
pub const INDEX_RECORD_LEN: usize = 32;
/// Entries of an index page at most.
pub const MOST_INDEX_ENTRIES: u32 = 1 << 16;
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
    /// [`MAGIC`] or [`GRID_MAGIC`].
    pub magic: [u8; 8],
    /// Of particles [`VERSION`], [`VERSION_VOLUME`], [`VERSION_NAMED`], [`VERSION_REFINED`], [`VERSION_DEEP`] or [`VERSION_INDEXED`].
    pub version: u32,
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
    /// Whether the page table lies before the footer, in index pages.
    pub fn is_indexed(&self) -> bool {
        self.magic == MAGIC && self.version >= VERSION_INDEXED
    }

    /// The header's bytes, without the zeros that fill its block.
    pub fn encode(&self) -> [u8; HEADER_LEN] {
        let mut out = [0; HEADER_LEN];
        out[0..8].copy_from_slice(&self.magic);
        out[8..12].copy_from_slice(&self.version.to_le_bytes());
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

    /// Whether a header's bytes have their checksum.
    pub(super) fn is_sound(bytes: &[u8]) -> bool {
        bytes.len() >= HEADER_LEN && crc32c::crc32c(&bytes[..60]) == u32_at(bytes, 60)
    }

    /// Reads a header of a file that begins like this and has one of these versions, and checks it against the file's real length.
    pub(super) fn decode(
        bytes: &[u8],
        real_len: u64,
        magic: [u8; 8],
        versions: RangeInclusive<u32>,
    ) -> Result<Header, HeaderError> {
        let bytes: &[u8; HEADER_LEN] = bytes
            .get(..HEADER_LEN)
            .and_then(|bytes| bytes.try_into().ok())
            .ok_or(HeaderError::NotAPageFile("a header of 64 bytes"))?;
        if bytes[..8] != magic {
            return Err(HeaderError::NotAPageFile("its first eight bytes"));
        }
        let version = u32_at(bytes, 8);
        if !versions.contains(&version) {
            return Err(HeaderError::Version(version));
        }
        let damaged = |expected: &str| HeaderError::Damaged(Damage::new("header", expected));
        if !Header::is_sound(bytes) {
            return Err(damaged("its checksum"));
        }
        let header = Header {
            magic,
            version,
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
    /// Bytes that its particles take in memory: [`particles_memory`] of each node.
    pub memory: u32,
}

portable!(PageEntry { offset, len, nodes, family, crc, memory });

/// Bytes that the particles of a node take in memory: a word and a code for each; of clusters mass, size, rank and the code of a shape, too.
pub fn particles_memory(encoding: Encoding, particles: u32) -> u64 {
    let word = match encoding {
        Encoding::Leaf => size_of::<u64>(),
        Encoding::Relay | Encoding::Grid => size_of::<u32>(),
        Encoding::Clusters | Encoding::LeafClusters => size_of::<u64>() + 3 + size_of::<u16>(),
    };
    u64::from(particles) * (word + size_of::<u16>()) as u64
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
        out[24..28].copy_from_slice(&self.memory.to_le_bytes());
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
            memory: u32_at(bytes, 24),
        }
    }
}

/// What the footer tells of an index page: a part of the page table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct IndexRecord {
    /// First byte of the first of its pages.
    pub start: u64,
    /// Sum of [`PageEntry::memory`] of its pages.
    pub memory: u64,
    /// Sum of [`PageEntry::nodes`].
    pub nodes: u64,
    /// The largest [`PageEntry::len`].
    pub longest: u32,
    /// CRC-32C of its entries.
    pub crc: u32,
}

impl IndexRecord {
    /// What is to be told of these entries, whose bytes have this checksum.
    pub fn of(entries: &[PageEntry], crc: u32) -> IndexRecord {
        IndexRecord {
            start: entries.first().map_or(0, |entry| entry.offset),
            memory: entries.iter().map(|entry| u64::from(entry.memory)).sum(),
            nodes: entries.iter().map(|entry| u64::from(entry.nodes)).sum(),
            longest: entries.iter().map(|entry| entry.len).max().unwrap_or(0),
            crc,
        }
    }

    /// The record's bytes.
    pub fn encode(&self) -> [u8; INDEX_RECORD_LEN] {
        let mut out = [0; INDEX_RECORD_LEN];
        out[0..8].copy_from_slice(&self.start.to_le_bytes());
        out[8..16].copy_from_slice(&self.memory.to_le_bytes());
        out[16..24].copy_from_slice(&self.nodes.to_le_bytes());
        out[24..28].copy_from_slice(&self.longest.to_le_bytes());
        out[28..32].copy_from_slice(&self.crc.to_le_bytes());
        out
    }

    /// Reads a record; its values are not checked yet.
    pub fn decode(bytes: &[u8; INDEX_RECORD_LEN]) -> IndexRecord {
        IndexRecord {
            start: u64_at(bytes, 0),
            memory: u64_at(bytes, 8),
            nodes: u64_at(bytes, 16),
            longest: u32_at(bytes, 24),
            crc: u32_at(bytes, 28),
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

/// One node of a family's octree as a file holds it; [`super::Node`] says what its fields mean.
#[derive(Clone, Debug, PartialEq)]
pub struct StoredNode {
    /// Its cell.
    pub key: NodeKey,
    /// How its particles are held.
    pub encoding: Encoding,
    /// Index of its codebook.
    pub codebook: u16,
    /// Number of particles that it holds.
    pub particles: u32,
    /// How many of them are points.
    pub points: u32,
    /// Number of source particles that it stands for.
    pub source_particles: u64,
    /// Largest displacement, world units; infinite for relays.
    pub delta: f64,
    /// Tight box around the node and everything below it.
    pub bounds: Bounds,
    /// Largest smoothing length in the node and below.
    pub smoothing_length_max: f32,
    /// Sum of the source particles' masses.
    pub mass: f64,
    /// Sum of the source particles' `m rho`.
    pub mass_density: f64,
    /// Factor on weights `m`.
    pub mass_scale: f32,
    /// Factor on weights `m rho`.
    pub mass_density_scale: f32,
    /// Its children by octant (bit 0: upper half in x, bit 1: y, bit 2: z); all `None` for a leaf.
    pub children: [Option<NodeRef>; 8],
}

portable!(StoredNode {
    key,
    encoding,
    codebook,
    particles,
    points,
    source_particles,
    delta,
    bounds,
    smoothing_length_max,
    mass,
    mass_density,
    mass_scale,
    mass_density_scale,
    children,
});

/// A node record: the node, and where in its page the sections of its particles start.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeRecord {
    /// The node.
    pub node: StoredNode,
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
            Encoding::Clusters => 3,
            Encoding::LeafClusters => 4,
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

    /// Reads a record; checks only what a `StoredNode` cannot express.
    pub(super) fn decode(bytes: &[u8; NODE_RECORD_LEN], place: impl Fn() -> String) -> Result<NodeRecord, Damage> {
        let encoding = match bytes[1] {
            0 => Encoding::Relay,
            1 => Encoding::Grid,
            2 => Encoding::Leaf,
            3 => Encoding::Clusters,
            4 => Encoding::LeafClusters,
            other => return Err(Damage::new(place(), format!("an encoding from 0 to 4, found {other}"))),
        };
        if bytes[124..128] != [0; 4] {
            return Err(Damage::new(place(), "zeros in the reserved bytes"));
        }
        let vec_at = |at| DVec3::new(f64_at(bytes, at), f64_at(bytes, at + 8), f64_at(bytes, at + 16));
        let node = StoredNode {
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

/// The pages that the children of a page's nodes are in, again and again where it has several of one page; the bytes need not be sound.
pub(super) fn child_pages(page: &[u8]) -> impl Iterator<Item = PageId> {
    let nodes = if page.len() < PAGE_HEADER_LEN { 0 } else { u32_at(page, 12) };
    let records = page.get(PAGE_HEADER_LEN..).unwrap_or_default().chunks_exact(NODE_RECORD_LEN).take(nodes as usize);
    let children = records.flat_map(|record| record[128..].chunks_exact(8).map(|child| PageId(u32_at(child, 0))));
    children.filter(|page| page.0 != NO_PAGE)
}

/// A little-endian `u32`; the callers' offsets are constants inside arrays of fixed length.
pub(super) fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

pub(super) fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from(u32_at(bytes, at)) | u64::from(u32_at(bytes, at + 4)) << 32
}

fn f64_at(bytes: &[u8], at: usize) -> f64 {
    f64::from_bits(u64_at(bytes, at))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::specification;

    const SPECIFICATION: &str = include_str!("../../../../docs/page-file.md");

    fn fields<'a>(heading: &str, bytes: &'a [u8]) -> impl Fn(&str) -> &'a [u8] {
        specification::fields(SPECIFICATION, heading, bytes)
    }

    #[test]
    fn header_and_page_table_are_as_specified() {
        let header = Header {
            magic: MAGIC,
            version: VERSION_VOLUME,
            file_len: 11 << 40,
            footer_offset: 22 << 40,
            footer_len: 33 << 40,
            footer_crc: 44,
            pages: 55,
        };
        let bytes = header.encode();
        let field = fields("Header", &bytes);
        assert_eq!(field("magic"), MAGIC);
        assert_eq!(field("version"), VERSION_VOLUME.to_le_bytes());
        assert_eq!(field("alignment"), (ALIGNMENT as u32).to_le_bytes());
        assert_eq!(field("file_len"), (11_u64 << 40).to_le_bytes());
        assert_eq!(field("footer_offset"), (22_u64 << 40).to_le_bytes());
        assert_eq!(field("footer_len"), (33_u64 << 40).to_le_bytes());
        assert_eq!(field("footer_crc"), 44_u32.to_le_bytes());
        assert_eq!(field("pages"), 55_u32.to_le_bytes());
        assert_eq!(field("header_crc"), crc32c::crc32c(&bytes[..60]).to_le_bytes());

        let entry = PageEntry { offset: 1 << 50, len: 2, nodes: 3, family: 4, crc: 5, memory: 6 };
        let bytes = entry.encode();
        assert_eq!(PageEntry::decode(&bytes), entry);
        let field = fields("Page table", &bytes);
        assert_eq!(field("offset"), (1_u64 << 50).to_le_bytes());
        for (name, value) in [("len", 2_u32), ("nodes", 3), ("family", 4), ("crc", 5), ("memory", 6)] {
            assert_eq!(field(name), value.to_le_bytes());
        }

        let record = IndexRecord { start: 1 << 50, memory: 2 << 40, nodes: 3 << 40, longest: 4, crc: 5 };
        let bytes = record.encode();
        assert_eq!(IndexRecord::decode(&bytes), record);
        let field = fields("Index record", &bytes);
        for (name, value) in [("start", 1_u64 << 50), ("memory", 2 << 40), ("nodes", 3 << 40)] {
            assert_eq!(field(name), value.to_le_bytes());
        }
        assert_eq!([field("longest"), field("crc")].concat(), [4_u32, 5].map(u32::to_le_bytes).concat());

        let bytes = encode_page_header(PageId(6), 7, 8, 9);
        let field = fields("Page header", &bytes);
        assert_eq!(field("magic"), PAGE_MAGIC);
        for (name, value) in [("page", 6_u32), ("family", 7), ("nodes", 8), ("len", 9)] {
            assert_eq!(field(name), value.to_le_bytes());
        }
    }

    #[test]
    fn node_records_are_as_specified() {
        let child = NodeRef { page: PageId(77), node: 88 };
        let node = StoredNode {
            key: NodeKey { depth: 3, x: 4, y: 5, z: 6 },
            encoding: Encoding::Leaf,
            codebook: 513,
            particles: 7,
            points: 8,
            source_particles: 9 << 40,
            delta: 0.5,
            bounds: Bounds { min: DVec3::new(1.0, 2.0, 3.0), max: DVec3::new(4.0, 5.0, 6.0) },
            smoothing_length_max: 7.5,
            mass: 8.5,
            mass_density: 9.5,
            mass_scale: 10.5,
            mass_density_scale: 11.5,
            children: [None, Some(child), None, None, None, None, None, None],
        };
        let record = NodeRecord { node, positions: 12, codes: 13 };
        let bytes = record.encode();
        assert_eq!(NodeRecord::decode(&bytes, || "here".into()), Ok(record));
        let field = fields("Node record", &bytes);
        assert_eq!((field("depth"), field("encoding"), field("codebook")), (&[3][..], &[2][..], &[1, 2][..]));
        assert_eq!(field("cell"), [4_u32, 5, 6].map(u32::to_le_bytes).concat());
        for (name, value) in [("particles", 7_u32), ("points", 8), ("positions", 12), ("codes", 13)] {
            assert_eq!(field(name), value.to_le_bytes());
        }
        assert_eq!(field("source_particles"), (9_u64 << 40).to_le_bytes());
        for (name, value) in [("delta", 0.5_f64), ("mass", 8.5), ("mass_density", 9.5)] {
            assert_eq!(field(name), value.to_le_bytes());
        }
        assert_eq!(field("bounds_min"), [1.0_f64, 2.0, 3.0].map(f64::to_le_bytes).concat());
        assert_eq!(field("bounds_max"), [4.0_f64, 5.0, 6.0].map(f64::to_le_bytes).concat());
        for (name, value) in [("smoothing_length_max", 7.5_f32), ("mass_scale", 10.5), ("mass_density_scale", 11.5)] {
            assert_eq!(field(name), value.to_le_bytes());
        }
        assert_eq!(field("children")[8..16], [77_u32, 88].map(u32::to_le_bytes).concat());
        assert_eq!(field("children")[..4], NO_PAGE.to_le_bytes());
    }
}
