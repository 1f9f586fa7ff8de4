//! The particle octree of F12 4.7: 256^3 merging grids, built bottom-up, one tree for each family.
//!
//! What differs from the paper, and why:
//!
//! - **Leaves.** The paper refines all 10 levels everywhere and averages 75 particles in its finest nodes. Here a cell with
//!   at most [`OctreeOptions::leaf_capacity`] particles is a leaf that holds them unmerged with 21 bits a coordinate, which
//!   replaces up to 13 levels below it.
//! - **Relays.** Where smoothing lengths exceed the cells (`sprites`), an inner node can merge next to nothing and would
//!   repeat its children's particles at 5 or 6 bytes each. A node that would draw more than
//!   [`OctreeOptions::relay_fraction`] of what its children draw holds no particles itself and is always refined
//!   ([`Encoding::Relay`]); so a view draws at most `1 / relay_fraction` times as many particles as it could.
//! - **Positions.** A merged particle is stored at its centroid, with two more bits a coordinate than its cell, and a node
//!   records the *measured* maximum distance of its source particles from what is drawn for them (F12 4.7.2 bounds it by
//!   half a cell's diagonal, which is wrong once particles of a cell are merged more than once).
//! - **Order.** F12 4.9.2 shuffles a node's particles against contention in blending. Here they are in Morton order: the
//!   CPU renderer and the compute path accumulate in tiles, where neighbours in memory that are neighbours on the screen
//!   share cache lines.
//!
//! The result depends on the input and the options, not on the number of threads: all sums are taken over runs whose
//! lengths are fixed.

mod block;
mod leaf_books;
mod level;
mod level_info;
mod merge;
mod sorted;
mod thin;
mod topology;

pub use level_info::LevelInfo;

use super::{AttributeInfo, NodeKey, RootCell};
use crate::codec::quantize::MAX_ATTRIBUTES;
use crate::codec::{AttributeMerge, Codebook, CodebookScope, ColumnScaling, Scaling, VqBits, quantize};
use crate::model::progress::Progress;
use crate::model::{Bounds, Family, FamilyName, Unit};
use leaf_books::LeafBooks;
use rayon::prelude::*;
use sorted::Sorted;
use std::ops::Range;

/// How a tree is built.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OctreeOptions {
    /// Bits of a codebook index.
    pub vq_bits: VqBits,
    /// Largest number of particles in a leaf that is not at the maximum depth.
    pub leaf_capacity: usize,
    /// Largest difference of smoothing lengths, in cells, of sprites that are merged (F12 4.7.3, `epsilon`).
    pub fusion: f64,
    /// Share of a node's mass and of its `sum m rho` that presence thinning may leave out.
    pub thinning_budget: f64,
    /// An inner node that would draw more than this share of what its children draw is a relay.
    pub relay_fraction: f64,
}

impl Default for OctreeOptions {
    fn default() -> OctreeOptions {
        OctreeOptions {
            vq_bits: VqBits::Eight,
            leaf_capacity: 16384,
            fusion: 0.25,
            thinning_budget: 5e-4,
            relay_fraction: 0.75,
        }
    }
}

/// A family that cannot be built into a tree.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{family}: {field}: expected {expected}")]
pub struct OctreeError {
    /// The family.
    pub family: FamilyName,
    /// The field that is wrong.
    pub field: String,
    /// What it should be.
    pub expected: String,
}

impl OctreeError {
    fn new(family: FamilyName, field: impl Into<String>, expected: impl Into<String>) -> OctreeError {
        OctreeError { family, field: field.into(), expected: expected.into() }
    }
}

/// How a node holds its particles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Encoding {
    /// It holds none and must be refined: drawing its children costs next to nothing more than it would have. Its
    /// `delta` is infinite, so that error-driven selection refines it at any distance. A root is never a relay.
    Relay,
    /// Merged particles, one `u32` each ([`crate::codec::coordinates::unpack_grid`]).
    Grid,
    /// Source particles, one `u64` each ([`crate::codec::coordinates::unpack_leaf`]).
    Leaf,
}

/// A node of a finished tree, with its particles. [`crate::store::Node`] shares most fields and is a type of its own on purpose:
/// that one is what a reader knows of a node (children by page, particles elsewhere in the page, a count of sources), this
/// one is what a build has of it before there are pages (children by index, the packed particles, the range of the sorted
/// source). The hierarchy knows nothing of pages, and a reader must not depend on how trees are built; `store::paging` is
/// the one place that turns this into that.
#[derive(Clone, Debug)]
pub struct TreeNode {
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
    /// Measured maximum distance between a source particle and the particle drawn for it.
    pub delta: f64,
    /// Box around the source and drawn positions in the subtree.
    pub bounds: Bounds,
    /// Largest source or decoded smoothing length in the subtree.
    pub smoothing_length_max: f32,
    /// Mass of the source particles.
    pub mass: f64,
    /// Their `sum m rho`.
    pub mass_density: f64,
    /// `mass` over the decoded mass.
    pub mass_scale: f32,
    /// `mass_density` over the decoded one.
    pub mass_density_scale: f32,
    /// Indices of the children in the next depth's nodes.
    pub children: [Option<usize>; 8],
    /// Packed positions of a grid node.
    pub words: Vec<u32>,
    /// Codes of its particles.
    pub codes: Vec<u16>,
    sources: Range<usize>,
}

impl TreeNode {
    /// Number of source particles that the node stands for.
    pub fn source_particles(&self) -> u64 {
        self.sources.len() as u64
    }

    fn set_codes(&mut self, codes: Vec<u16>, codebook: u16, book: &Codebook) {
        let (mut mass, mut mass_density) = (0.0, 0.0);
        for &code in &codes {
            let code = usize::from(code);
            let m = f64::from(book.mass[code]);
            mass += m;
            mass_density += m * f64::from(book.density[code]);
            self.smoothing_length_max = self.smoothing_length_max.max(book.smoothing_length[code]);
        }
        self.codes = codes;
        self.codebook = codebook;
        self.mass_scale = scale(self.mass, mass);
        self.mass_density_scale = scale(self.mass_density, mass_density);
    }
}

/// The factor that turns `decoded` into `real`; 1 where rounding leaves nothing to scale.
fn scale(real: f64, decoded: f64) -> f32 {
    let factor = (real / decoded) as f32;
    if factor.is_finite() && factor > 0.0 { factor } else { 1.0 }
}

/// A family's finished tree.
#[derive(Debug)]
pub struct Octree {
    /// The family.
    pub name: FamilyName,
    /// Source particles.
    pub count: u64,
    /// Their mass.
    pub mass: f64,
    /// Their `sum m rho`.
    pub mass_density: f64,
    /// The box around them.
    pub bounds: Bounds,
    /// The cell of depth 0.
    pub root: RootCell,
    /// Mass, density, smoothing length.
    pub quantities: [AttributeInfo; 3],
    /// The attributes.
    pub attributes: Vec<AttributeInfo>,
    /// One for each depth; `bytes` are left to whoever stores the nodes.
    pub levels: Vec<LevelInfo>,
    /// The codebooks: those of the leaves first (leaves of similar density share one), then one for each depth that has grid nodes, the deepest first.
    pub codebooks: Vec<Codebook>,
    /// The nodes of each depth, in Morton order.
    pub nodes: Vec<Vec<TreeNode>>,
    sorted: Sorted,
}

impl Octree {
    /// Builds the tree of a family, which must not be empty and whose masses, densities and smoothing lengths must be
    /// positive and finite. Attributes that are not finite are replaced by the column's mean.
    pub fn build(mut family: Family, options: &OctreeOptions, progress: &dyn Progress) -> Result<Octree, OctreeError> {
        let (quantities, attributes) = describe(&mut family)?;
        let name = family.name;
        let count = family.len();
        let bounds = bounds_of(&family);
        let root = RootCell::around(bounds, 2.0 * quantities[2].max);
        let scaling = scaling(&family, &attributes);
        let rules: Vec<AttributeMerge> = attributes.iter().map(|attribute| attribute.merge).collect();
        progress.begin(&format!("sorting {name}"), 0);
        let sorted = Sorted::new(family, root)?;
        let shapes = topology::split(&sorted.keys, options.leaf_capacity.max(1));

        progress.begin(&format!("coding {name}"), 0);
        let mut leaf_books = LeafBooks::of(&sorted, &shapes, &scaling, options.vq_bits);
        let mut codebooks = std::mem::take(&mut leaf_books.codebooks);
        progress.begin(&format!("merging {name}"), shapes.len() as u64);
        let context = level::Context { sorted: &sorted, root, options, rules: &rules };
        let mut nodes = Vec::with_capacity(shapes.len());
        let mut levels = Vec::with_capacity(shapes.len());
        let mut below: Vec<level::Work> = Vec::new();
        for (depth, shapes) in shapes.iter().enumerate().rev() {
            let mut works = level::build(&context, shapes, &below);
            works.par_iter_mut().filter(|work| work.node.encoding == Encoding::Leaf).for_each(|work| {
                let (codes, book) = leaf_books.leaf(work.node.sources.clone());
                work.node.set_codes(codes, book, &codebooks[usize::from(book)]);
            });
            let drawn = level::drawn_quantities(&works);
            if !drawn.is_empty() {
                let (book, codes) = quantize(&drawn, &scaling, options.vq_bits, CodebookScope::Depth(depth as u8), 1);
                drop(drawn);
                level::set_codes(&mut works, codes, codebooks.len() as u16, &book);
                codebooks.push(book);
            }
            levels.push(level::count(depth as u8, &works));
            nodes.push(below.into_iter().map(level::Work::finish).collect::<Vec<_>>());
            below = works;
            progress.advance(1);
        }
        nodes.push(below.into_iter().map(level::Work::finish).collect());
        nodes.reverse();
        // The list that came before the deepest level is empty.
        nodes.truncate(shapes.len());
        levels.reverse();
        let top = &nodes[0][0];
        let (mass, mass_density) = (top.mass, top.mass_density);
        Ok(Octree {
            name,
            count: count as u64,
            mass,
            mass_density,
            bounds,
            root,
            quantities,
            attributes,
            levels,
            codebooks,
            nodes,
            sorted,
        })
    }

    /// The packed positions of a leaf of this tree.
    pub fn leaf_words(&self, node: &TreeNode) -> Vec<u64> {
        level::leaf_words(&self.sorted, self.root, node)
    }
}

/// Checks the columns, replaces missing attribute values, and describes everything.
fn describe(family: &mut Family) -> Result<([AttributeInfo; 3], Vec<AttributeInfo>), OctreeError> {
    let (name, count) = (family.name, family.positions.len());
    let error = |field: &str, expected: &str| OctreeError::new(name, field, expected);
    if count == 0 {
        return Err(error("count", "at least one particle"));
    }
    if family.attributes.len() > MAX_ATTRIBUTES {
        return Err(error("attributes", &format!("at most {MAX_ATTRIBUTES}")));
    }
    let unit = Unit::default();
    let column = |field: &str, values: &[f32]| {
        let sound = values.len() == count && values.par_iter().all(|&v| v > 0.0 && v.is_finite());
        sound
            .then(|| AttributeInfo::of(field, &unit, values))
            .ok_or_else(|| error(field, "a positive value for each particle"))
    };
    let quantities = [
        column("mass", &family.mass)?,
        column("density", &family.density)?,
        column("smoothing-length", &family.smoothing_length)?,
    ];
    let mut attributes = Vec::with_capacity(family.attributes.len());
    for attribute in &mut family.attributes {
        if attribute.values.len() != count {
            return Err(error(&attribute.name, "a value for each particle"));
        }
        let info = AttributeInfo::of(&attribute.name, &attribute.unit, &attribute.values);
        if info.missing > 0 {
            let mean = info.mean as f32;
            attribute.values.par_iter_mut().filter(|value| !value.is_finite()).for_each(|value| *value = mean);
        }
        attributes.push(info);
    }
    if !family.positions.par_iter().flatten().all(|v| v.is_finite() && v.abs() < 1e150) {
        return Err(error("position", "coordinates between -1e150 and 1e150"));
    }
    Ok((quantities, attributes))
}

fn bounds_of(family: &Family) -> Bounds {
    family
        .positions
        .par_chunks(1 << 16)
        .map(|run| Bounds::of(run.iter().copied()))
        .reduce(|| Bounds::EMPTY, Bounds::union)
}

/// How much an error counts to the quantiser, in octaves. A splat's brightness is `m rho / h^2`, so that an error of `h`
/// counts twice; the first attribute is the one that is shown by default, as hue, and its weight was tuned to the mean
/// colour error of F12 4.10.2 on one dark-matter box, where equal weights miss the bound. The other attributes are seen
/// only when asked for.
const WEIGHTS: [f32; 3] = [1.0, 1.0, 2.0];
const FIRST_ATTRIBUTE_WEIGHT: f32 = 2.0;
const ATTRIBUTE_WEIGHT: f32 = 0.5;

fn scaling(family: &Family, attributes: &[AttributeInfo]) -> Scaling {
    let mut quantities =
        [&family.mass, &family.density, &family.smoothing_length].map(|values| ColumnScaling::positive(values));
    quantities.iter_mut().zip(WEIGHTS).for_each(|(scaling, weight)| *scaling = scaling.weighted(weight));
    let weights = std::iter::once(FIRST_ATTRIBUTE_WEIGHT).chain(std::iter::repeat(ATTRIBUTE_WEIGHT));
    Scaling {
        quantities,
        attributes: family
            .attributes
            .iter()
            .zip(attributes)
            .zip(weights)
            .map(|((attribute, info), weight)| {
                // Magnitudes are logarithms, and in `points` they are the brightness.
                let is_magnitude = info.merge == AttributeMerge::Magnitude;
                let scaling = ColumnScaling::attribute(&attribute.values, is_magnitude);
                (scaling.weighted(if is_magnitude { 1.0 } else { weight }), info.merge)
            })
            .collect(),
    }
}
