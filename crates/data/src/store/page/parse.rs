//! A page from its bytes: everything that they say is checked.

use super::super::FamilyMetadata;
use super::super::clusters::NodeClusters;
use super::super::content::Content;
use super::super::error::Damage;
use super::super::layout::{
    NODE_RECORD_LEN, NodeRecord, PAGE_HEADER_LEN, PAGE_MAGIC, SECTION_ALIGNMENT, StoredNode, particles_memory, u32_at,
};
use super::super::metadata::{AttributeMerge, Metadata};
use super::super::page_table::PageTable;
use super::{Encoding, Frame, Node, Page, PageId};
use crate::codec::clusters::PackedClusters;
use crate::codec::positions::{decode_grid, decode_leaf};
use crate::hierarchy::cell::MAX_DEPTH;
use crate::model::{Bounds, Placement};
use std::sync::Arc;

impl Page {
    /// Reads and checks the bytes of a page, whose checksum has been found right; `table` tells the
    /// number of nodes of it and of its children's pages. Frames are where `placement` puts them, all else is as the file says.
    pub(in crate::store) fn parse(
        id: PageId,
        bytes: &[u8],
        metadata: &Metadata,
        table: &PageTable,
        placement: &Placement,
    ) -> Result<Page, Damage> {
        let here = || format!("page {}", id.0);
        let entry = table.get(id.0 as usize).ok_or_else(|| Damage::new(here(), "to exist"))?;
        let header_matches = bytes.len() >= PAGE_HEADER_LEN
            && bytes[..4] == PAGE_MAGIC
            && [4, 8, 12, 16].map(|at| u32_at(bytes, at)) == [id.0, entry.family, entry.nodes, entry.len]
            && bytes[20..PAGE_HEADER_LEN].iter().all(|&byte| byte == 0);
        if !header_matches {
            return Err(Damage::new(here(), "a page header that agrees with the page table"));
        }
        let Some(family) = metadata.families.get(entry.family as usize) else {
            return Err(Damage::new(here(), format!("a family below {}", metadata.families.len())));
        };
        let records_end = (entry.nodes as usize)
            .checked_mul(NODE_RECORD_LEN)
            .and_then(|len| len.checked_add(PAGE_HEADER_LEN))
            .filter(|&end| end <= bytes.len())
            .ok_or_else(|| Damage::new(here(), "room for its node records"))?;

        let root = family.root.placed(placement);
        // A particle takes at least a byte of the page, for its code, and at most ten in memory.
        let memory = entry.memory as usize;
        if memory / 10 > bytes.len() {
            return Err(Damage::new(here(), "room for the particles that the page table tells"));
        }
        let mut page = Page {
            id,
            family: entry.family,
            nodes: Vec::with_capacity(entry.nodes as usize),
            children: Vec::new(),
            child_bounds: Vec::new(),
            cells: Vec::with_capacity(entry.nodes as usize),
            child_cells: Vec::new(),
            words: Vec::with_capacity(memory / 8 + entry.nodes as usize),
            positions: Vec::with_capacity(entry.nodes as usize),
            codes: Vec::with_capacity(memory / 6),
            code_ranges: Vec::with_capacity(entry.nodes as usize),
            sizes: Vec::with_capacity(entry.nodes as usize),
            contents: Vec::new(),
        };
        let rules: Arc<[AttributeMerge]> = family.attributes.iter().map(|attribute| attribute.merge).collect();
        // Sections follow the records in order, each aligned, without gaps but the alignment's zeros.
        let mut at = records_end;
        for (i, record) in bytes[PAGE_HEADER_LEN..records_end].chunks_exact(NODE_RECORD_LEN).enumerate() {
            let here = || format!("page {}, node {i}", id.0);
            let Ok(record) = record.try_into() else { continue };
            let NodeRecord { node, positions, codes } = NodeRecord::decode(record, here)?;
            let count = node.particles as usize;
            let start = at;
            // A code takes at least a byte, so that the page's length bounds what its particles take in memory.
            let packing = metadata.bits.of(node.encoding == Encoding::Leaf);
            let packed = packing.packed_len(count).filter(|&len| len <= bytes.len());
            let (Some(packed), true) = (packed, node.points <= node.particles && positions as usize == at) else {
                let expected = "positions after the section before, room for its codes, and at most as many points";
                return Err(Damage::new(here(), expected));
            };
            let first_word = page.words.len();
            let held = match node.encoding {
                Encoding::Leaf => count,
                Encoding::Grid | Encoding::Relay => count.div_ceil(2),
                Encoding::Clusters | Encoding::LeafClusters => 0,
            };
            page.words.resize(first_word + held, 0);
            let mut clusters = None;
            let words = &mut page.words[first_word..];
            let from = bytes.get(positions as usize..).unwrap_or_default();
            let points = node.points as usize;
            let len = match node.encoding {
                Encoding::Leaf => decode_leaf(from, points, words),
                // An odd number of grid words leaves half of the last 64-bit word over.
                Encoding::Grid | Encoding::Relay => {
                    decode_grid(from, points, &mut bytemuck::cast_slice_mut(words)[..count])
                }
                Encoding::Clusters | Encoding::LeafClusters => match &family.clusters {
                    None => Err("no clusters, of which the footer tells nothing"),
                    Some(tree) => {
                        PackedClusters::decode(from, count, tree.shape_bits, tree.is_published).map(|(packed, len)| {
                            clusters = Some((packed, tree));
                            len
                        })
                    }
                },
            }
            .map_err(|expected| Damage::new(here(), expected))?;
            section(bytes, &mut at, positions, len)
                .ok_or_else(|| Damage::new(here(), "positions inside the page, after the section before"))?;
            let codes_end = section(bytes, &mut at, codes, packed)
                .ok_or_else(|| Damage::new(here(), "codes inside the page, after its positions"))?;
            let first_code = page.codes.len();
            packing.unpack(&bytes[codes as usize..codes_end], count, &mut page.codes);
            page.sizes.push((NODE_RECORD_LEN + at - start) as u64);
            check_node(&node, (entry.family, family), &page.codes[first_code..], (id, i as u32), table)
                .map_err(|expected| Damage::new(here(), expected))?;
            let content: Option<Arc<dyn Content>> = match clusters {
                None => None,
                Some((packed, tree)) => {
                    let codes = page.codes.split_off(first_code);
                    let frame = Frame { min: node.key.min(root), size: node.key.size(root) };
                    let about = (&tree.book, Arc::clone(&rules), metadata.kernel);
                    let own = NodeClusters::new(frame, packed, codes, about, placement)
                        .map_err(|expected| Damage::new(here(), expected))?;
                    Some(Arc::new(own))
                }
            };
            page.contents.push(content);
            page.positions.push(first_word..page.words.len());
            page.code_ranges.push(first_code..page.codes.len());
            let first_child = page.children.len() as u32;
            for (octant, child) in (0..).zip(node.children) {
                let Some(child) = child else { continue };
                let cell = match node.encoding {
                    Encoding::LeafClusters => node.key,
                    _ => node.key.child(octant),
                };
                page.children.push(child);
                page.child_bounds.push(around(cell.bounds(root)));
                page.child_cells.push(cell);
            }
            page.cells.push(node.key);
            page.nodes.push(Node::of(node, root, first_child..page.children.len() as u32));
        }
        if at != bytes.len() {
            return Err(Damage::new(here(), "an end right after the last section"));
        }
        let memory = |node: &Node| particles_memory(node.encoding, node.particles);
        if page.nodes.iter().map(memory).sum::<u64>() != u64::from(entry.memory) {
            return Err(Damage::new(here(), "particles that take the memory that the page table tells"));
        }
        check_family_links(&page).map_err(|(i, expected)| Damage::new(format!("page {}, node {i}", id.0), expected))?;
        Ok(page)
    }
}

/// Advances over a section of `len` bytes that must start at `offset`, the aligned place `at`; returns its end. The
/// zeros that align the next section belong to it.
fn section(bytes: &[u8], at: &mut usize, offset: u32, len: usize) -> Option<usize> {
    let end = at.checked_add(len)?;
    let aligned = end.checked_next_multiple_of(SECTION_ALIGNMENT)?;
    let in_place = offset as usize == *at && aligned <= bytes.len();
    if !in_place || bytes[end..aligned].iter().any(|&byte| byte != 0) {
        return None;
    }
    *at = aligned;
    Some(end)
}

/// Checks what a node says against its file; the error is what was expected.
fn check_node(
    node: &StoredNode,
    (number, family): (u32, &FamilyMetadata),
    codes: &[u16],
    own: (PageId, u32),
    table: &PageTable,
) -> Result<(), String> {
    if !node.key.is_valid() {
        return Err(format!("a depth of at most {MAX_DEPTH} and a cell inside the root"));
    }
    if node.points > node.particles || u64::from(node.particles) > node.source_particles {
        return Err("at most as many points as particles, and particles as source particles".into());
    }
    let entries = match &family.clusters {
        Some(clusters) if node.encoding.is_clusters() => clusters.book.values.len(),
        _ => family.codebooks.get(usize::from(node.codebook)).map_or(0, |book| book.len()),
    };
    if let Some(code) = codes.iter().find(|&&code| usize::from(code) >= entries) {
        return Err(format!("codes below {entries}, found {code}"));
    }
    let finite = [node.mass, node.mass_density].iter().all(|v| v.is_finite())
        && [node.smoothing_length_max, node.mass_scale, node.mass_density_scale].iter().all(|v| v.is_finite())
        && node.bounds.min.is_finite()
        && node.bounds.max.is_finite();
    if !finite || node.bounds.is_empty() || node.smoothing_length_max < 0.0 {
        return Err("finite bounds, masses and scales".into());
    }
    let childless = node.children.iter().all(Option::is_none);
    let consistent = match node.encoding {
        Encoding::Leaf => {
            childless
                && u64::from(node.particles) == node.source_particles
                && (0.0..f64::INFINITY).contains(&node.delta)
        }
        Encoding::Grid => !childless && node.particles > 0 && (0.0..f64::INFINITY).contains(&node.delta),
        Encoding::Clusters | Encoding::LeafClusters => {
            let only_first = node.children[0].is_some() && node.children[1..].iter().all(Option::is_none);
            !childless
                && node.particles > 0
                && node.points == 0
                && (0.0..f64::INFINITY).contains(&node.delta)
                && (only_first || node.encoding == Encoding::Clusters)
        }
        Encoding::Relay => !childless && node.particles == 0 && node.delta == f64::INFINITY && own.1 != u32::MAX,
    };
    if !consistent {
        return Err("children, particles and delta that suit its encoding".into());
    }
    for child in node.children.iter().flatten() {
        // Children come after their parent, so that no walk down the tree can go round in a circle.
        let entry = table.get(child.page.0 as usize);
        let exists = entry.is_some_and(|entry| child.node < entry.nodes && entry.family == number);
        if !exists || (child.page, child.node) <= own {
            return Err(format!("a later node of this family as a child, found {child:?}"));
        }
    }
    Ok(())
}

/// Children in the same page must have the cells that their parents give them.
fn check_family_links(page: &Page) -> Result<(), (usize, String)> {
    for i in 0..page.nodes.len() {
        for (child, cell) in page.children(i).iter().zip(page.child_cells(i)) {
            if child.page == page.id && page.cells[child.node as usize] != *cell {
                return Err((i, format!("node {} to be in the octant that it is the child of", child.node)));
            }
        }
    }
    Ok(())
}

/// A box a hair larger: particles lie in their cells up to rounding.
fn around(bounds: Bounds) -> Bounds {
    let hair = 1e-9 * (bounds.max - bounds.min) + 1e-14 * bounds.min.abs().max(bounds.max.abs());
    Bounds { min: bounds.min - hair, max: bounds.max + hair }
}
