//! A family's trees, from its buckets to coded nodes: one for each kind of levels that is asked for. They share the leaves,
//! which belong to the first.

use super::BuildError;
use super::clusters::{CodedClusters, Maker};
use super::coding::{self, Batch, Measured};
use super::column_error::Picture;
use super::partition::Partition;
use super::spill::{Blob, Spill};
use crate::codec::coordinates::unpack_leaf;
use crate::codec::positions::{decode_leaf, encode_grid, encode_leaf};
use crate::codec::{BatchInfo, CodeBits, Codebook, CodebookScope, Quantities, Refinement, Scaling};
use crate::hierarchy::octree::{Bucket, Columns, Context, Open, Piece, Plan, Tree, TreeNode, Words, assemble, join};
use crate::hierarchy::{ClusterOptions, Encoding, LevelInfo, Purpose};
use crate::model::progress::Progress;
use crate::model::{FamilyName, Kernel};
use crate::store::layout::StoredNode;
use crate::store::paging::{PlannedNode, Sections};
use rayon::prelude::*;

/// The particles of a piece, put away.
#[derive(Debug)]
pub(super) struct Kept {
    positions: Positions,
    batch: Batch,
}

#[derive(Debug)]
enum Positions {
    /// A section as it will be stored.
    Encoded(Blob),
    /// Grid words of a part of a node.
    Words(Blob),
}

/// A tree before it is coded; leaves of other levels than the first have no data.
pub(super) type Grown = Tree<Option<Kept>>;

/// Coded trees that only have to be written.
pub(super) struct CodedTrees {
    spill: Spill,
    /// The levels for splats.
    pub splats: CodedTree,
    /// Those for volumes.
    pub volume: Option<CodedTree>,
    /// Clusters.
    pub clusters: Option<CodedClusters>,
    /// What codes stand for.
    pub books: Books,
}

/// The codebooks of all trees, those of the first before those of the second.
#[derive(Default)]
pub(super) struct Books {
    /// The codebooks.
    pub codebooks: Vec<Codebook>,
    /// How the lines of those of the leaves run, where codes are refined.
    pub refinements: Vec<Refinement>,
    /// What the codes of the leaves do to a picture of column density, where that was asked for.
    pub column_error: Option<f64>,
    /// Entry of each code, for each codebook.
    numbers: Vec<Vec<u16>>,
}

/// A coded tree.
pub(super) struct CodedTree {
    /// The nodes, without the places of their children.
    pub nodes: Vec<Vec<PlannedNode>>,
    sections: Vec<Vec<NodeSections>>,
    /// One for each depth, without bytes; what the tree shares with another is not counted.
    pub levels: Vec<LevelInfo>,
}

/// Where the sections of a node are.
#[derive(Debug, Default)]
struct NodeSections {
    positions: Option<Blob>,
    codes: Vec<(Blob, usize)>,
}

/// What was built of some buckets: for each kind of levels its pieces, and what is left open.
type Built = Vec<(Vec<Piece<Option<Kept>>>, Option<Open>)>;

/// Builds the pieces of all buckets, at most `workers` at a time, and puts them together, to a tree for each kind of levels.
///
/// # Errors
/// When something cannot be put away or read back.
pub(super) fn grow(
    context: &Context,
    family: FamilyName,
    plan: &Plan,
    partition: Partition,
    spill: &Spill,
    workers: usize,
    progress: &dyn Progress,
) -> Result<Vec<Grown>, BuildError> {
    progress.begin(&format!("merging {family}"), plan.len() as u64);
    let keep = |piece: Piece<Words>, bucket: usize| {
        progress.go_on();
        piece.map(|words| {
            let kept = Kept::put(words, plan.group(bucket), spill);
            kept.map(Some).map_err(|error| BuildError::temporary(spill, error))
        })
    };
    let kinds = context.options.levels();
    let one = |number: usize| -> Result<Built, BuildError> {
        progress.go_on();
        let (places, columns) = partition.read(number)?;
        let bucket = Bucket::new(context, plan, number, places, columns);
        let of = |levels: &Purpose| {
            let mut pieces = Vec::new();
            let open = bucket.build(*levels, &mut |piece| {
                pieces.push(keep(piece, number)?);
                Ok::<_, BuildError>(())
            })?;
            Ok((pieces, open))
        };
        let built = kinds.iter().map(of).collect();
        progress.advance(1);
        built
    };
    let all = || (0..plan.len()).into_par_iter().with_max_len(1).map(one).collect::<Result<Vec<_>, _>>();
    let built = if workers < rayon::current_num_threads() { super::pool(workers)?.install(all) } else { all() }?;
    drop(partition);
    let mut gathered: Vec<(Vec<Piece<Option<Kept>>>, Vec<Open>)> = kinds.iter().map(|_| Default::default()).collect();
    for bucket in built {
        for ((pieces, open), (more, left)) in gathered.iter_mut().zip(bucket) {
            pieces.extend(more);
            open.extend(left);
        }
    }
    let mut trees = Vec::with_capacity(kinds.len());
    let mut leaves: Vec<Piece<Option<Kept>>> = Vec::new();
    for (&levels, (mut pieces, open)) in kinds.iter().zip(gathered) {
        join(context, levels, open, &mut |piece| {
            let bucket = plan.bucket(piece.first);
            pieces.push(keep(piece, bucket)?);
            Ok::<_, BuildError>(())
        })?;
        if levels == Purpose::Splats && kinds.len() > 1 {
            leaves =
                pieces.iter().filter(|piece| piece.encoding == Encoding::Leaf).map(|leaf| leaf.with(None)).collect();
        } else {
            pieces.append(&mut leaves);
        }
        // A stream without particles was refused before.
        let tree = assemble(pieces, levels, context.root, context.options)
            .ok_or_else(|| super::survey::column_error(family, "count", "at least one particle"))?;
        trees.push(tree);
    }
    Ok(trees)
}

/// Codes the trees of a family: that for splats, that for volumes if there is one, and clusters if `clustering` says how. What the codes do
/// to `picture` is measured.
///
/// # Errors
/// When something cannot be put away or read back.
pub(super) fn code(
    family: FamilyName,
    trees: Vec<Grown>,
    clustering: Option<(&Context, ClusterOptions, Kernel)>,
    scaling: &Scaling,
    picture: Option<Picture>,
    spill: Spill,
    bits: CodeBits,
    progress: &dyn Progress,
) -> Result<CodedTrees, BuildError> {
    let temporary = |error| BuildError::temporary(&spill, error);
    let maker =
        clustering.map(|(context, options, kernel)| Maker { context, options, kernel, spill: &spill, progress });
    // Leaves are read before they are coded.
    let clusters =
        maker.as_ref().zip(trees.first()).map(|(maker, tree)| maker.make(tree)).transpose().map_err(temporary)?;
    let steps = trees.iter().map(|tree| tree.nodes.len() as u64 + 1).sum();
    progress.begin(&format!("coding {family}"), steps);
    let mut books = Books::default();
    let mut trees = trees.into_iter();
    let mut next = |levels: Purpose, splats: Option<&CodedTree>| -> Result<Option<CodedTree>, BuildError> {
        let Some(tree) = trees.next() else { return Ok(None) };
        let coder = Coder { scaling, spill: &spill, bits, levels, picture: picture.as_ref(), progress };
        let coded = coder.code(tree, splats, &mut books);
        coded.map(Some).map_err(|error| BuildError::temporary(&spill, error))
    };
    let splats = next(Purpose::Splats, None)?
        .ok_or_else(|| super::survey::column_error(family, "count", "at least one particle"))?;
    let volume = next(Purpose::Samples, Some(&splats))?;
    let clusters = maker.as_ref().zip(clusters);
    let clusters = clusters.map(|(maker, clusters)| clusters.code(maker, &splats, scaling, bits.entries)).transpose();
    let clusters = clusters.map_err(temporary)?;
    Ok(CodedTrees { spill, splats, volume, clusters, books })
}

/// What coding a tree needs beside the tree.
struct Coder<'a> {
    scaling: &'a Scaling,
    spill: &'a Spill,
    bits: CodeBits,
    levels: Purpose,
    picture: Option<&'a Picture>,
    progress: &'a dyn Progress,
}

impl Coder<'_> {
    /// Codes a tree whose leaves are those of `shared`, if that is there, and appends its codebooks.
    fn code(&self, tree: Grown, shared: Option<&CodedTree>, books: &mut Books) -> std::io::Result<CodedTree> {
        let Coder { spill, bits, .. } = *self;
        let Tree { nodes, mut levels } = tree;
        // Positions become sections; batches are listed by what shares a codebook.
        let mut sections: Vec<Vec<NodeSections>> = Vec::with_capacity(nodes.len());
        let mut batches: Vec<Vec<Vec<Batch>>> = Vec::with_capacity(nodes.len());
        let mut drafts: Vec<Vec<TreeNode<()>>> = Vec::with_capacity(nodes.len());
        for level in nodes {
            let one = |node| {
                self.progress.go_on();
                split(node, spill)
            };
            let level: Vec<_> = level.into_par_iter().map(one).collect::<Result<_, _>>()?;
            let (mut own_drafts, mut own_sections, mut own_batches) = (Vec::new(), Vec::new(), Vec::new());
            for (draft, positions, batches) in level {
                own_drafts.push(draft);
                own_sections.push(NodeSections { positions, codes: Vec::new() });
                own_batches.push(batches);
            }
            drafts.push(own_drafts);
            sections.push(own_sections);
            batches.push(own_batches);
        }
        let scope = match self.levels {
            Purpose::Splats => CodebookScope::Depth,
            Purpose::Samples | Purpose::Clusters => CodebookScope::VolumeDepth,
        };
        let before = books.codebooks.len() as u16;
        let positions = |depth: usize, index: usize| sections[depth][index].positions.as_ref();
        // Leaves that are shared were measured with the tree that has them.
        let picture = self.picture.filter(|_| shared.is_none());
        let measured = picture.map(|picture| Measured { picture, positions: &positions });
        let mut coded = coding::code(&drafts, batches, self.scaling, spill, bits, scope, measured, self.progress)?;
        books.codebooks.append(&mut coded.codebooks);
        books.refinements.append(&mut coded.refinements);
        books.numbers.append(&mut coded.numbers);
        books.column_error = books.column_error.or(coded.column_error);
        let mut planned: Vec<Vec<PlannedNode>> = Vec::with_capacity(drafts.len());
        for (depth, (level, coded)) in drafts.into_iter().zip(coded.nodes).enumerate().rev() {
            let mut own = Vec::with_capacity(level.len());
            for (index, (draft, coded)) in level.into_iter().zip(coded).enumerate() {
                if let Some(shared) = shared.filter(|_| draft.encoding == Encoding::Leaf) {
                    // Both trees have the same cells, in the same order.
                    own.push(shared.nodes[depth][index].clone());
                    levels[depth].leaf_nodes -= 1;
                    levels[depth].leaf_particles -= draft.particles;
                    continue;
                }
                let below = planned.last().map_or(&[][..], |level: &Vec<PlannedNode>| level);
                let children = draft.children.iter().flatten().filter_map(|&child| below.get(child));
                let smoothing_length_max = children
                    .map(|child| child.node.smoothing_length_max)
                    .fold(draft.smoothing_length_max.max(coded.smoothing_length_max), f32::max);
                let positions = sections[depth][index].positions.as_ref().map_or(0, Blob::len);
                let packing = bits.of(draft.encoding == Encoding::Leaf);
                let codes = packing.packed_len(draft.particles as usize).unwrap_or(0);
                // Particles that were enlarged have lost density: only what coding has changed is made up for.
                let mass_density = match self.levels {
                    Purpose::Splats => draft.mass_density,
                    Purpose::Samples | Purpose::Clusters => coded.true_mass_density,
                };
                own.push(PlannedNode {
                    sections: (positions, codes),
                    children: draft.children,
                    node: StoredNode {
                        key: draft.key,
                        encoding: draft.encoding,
                        codebook: before + coded.codebook,
                        // Nodes with more are relays, and leaves with more were refused.
                        particles: draft.particles as u32,
                        points: draft.points as u32,
                        source_particles: draft.source_particles,
                        delta: draft.delta,
                        bounds: draft.bounds,
                        smoothing_length_max,
                        mass: draft.mass,
                        mass_density: draft.mass_density,
                        mass_scale: scale(draft.mass, coded.mass),
                        mass_density_scale: scale(mass_density, coded.mass_density),
                        children: [None; 8],
                    },
                });
                sections[depth][index].codes = coded.codes;
            }
            planned.push(own);
        }
        planned.reverse();
        Ok(CodedTree { nodes: planned, sections, levels })
    }
}

/// The factor that turns `decoded` into `real`; 1 where rounding leaves nothing to scale.
pub(super) fn scale(real: f64, decoded: f64) -> f32 {
    let factor = (real / decoded) as f32;
    if factor.is_finite() && factor > 0.0 { factor } else { 1.0 }
}

/// A node without its particles, its section of positions, and its batches.
fn split(node: TreeNode<Option<Kept>>, spill: &Spill) -> std::io::Result<(TreeNode<()>, Option<Blob>, Vec<Batch>)> {
    let TreeNode { key, encoding, particles, points, source_particles, delta, bounds, .. } = node;
    let TreeNode { smoothing_length_max, mass, mass_density, children, data, .. } = node;
    let mut positions = None;
    let mut words: Vec<u32> = Vec::new();
    let mut batches = Vec::with_capacity(data.len());
    for kept in data.into_iter().flatten() {
        match kept.positions {
            Positions::Encoded(blob) => positions = Some(blob),
            Positions::Words(blob) => {
                words.extend_from_slice(bytemuck::cast_slice(&spill.get(&blob)?));
                spill.forget(blob);
            }
        }
        batches.push(kept.batch);
    }
    if !words.is_empty() {
        let mut section = Vec::with_capacity(3 * words.len());
        encode_grid(&words, &mut section);
        positions = Some(spill.put(&[&section])?);
    }
    let draft = TreeNode {
        key,
        encoding,
        particles,
        points,
        source_particles,
        delta,
        bounds,
        smoothing_length_max,
        mass,
        mass_density,
        children,
        data: Vec::new(),
    };
    Ok((draft, positions, batches))
}

impl Kept {
    fn put(words: Words, group: u32, spill: &Spill) -> std::io::Result<Kept> {
        let mut section = Vec::new();
        let (positions, columns, whole) = match &words {
            Words::Leaf(words, columns) => {
                encode_leaf(words, &mut section);
                (&section[..], columns, true)
            }
            Words::Grid(words, columns, true) => {
                encode_grid(words, &mut section);
                (&section[..], columns, true)
            }
            Words::Grid(words, columns, false) => (bytemuck::cast_slice(words), columns, false),
        };
        let blob = spill.put(&[positions])?;
        let positions = if whole { Positions::Encoded(blob) } else { Positions::Words(blob) };
        let quantities: Vec<&[u8]> = columns.iter().map(|column| bytemuck::cast_slice::<f32, u8>(column)).collect();
        let info = BatchInfo::of(&borrowed(columns));
        Ok(Kept { positions, batch: Batch { quantities: spill.put(&quantities)?, info, group } })
    }
}

impl Kept {
    /// The group of the bucket that it comes from.
    pub fn group(&self) -> u32 {
        self.batch.group
    }

    /// Hands out what a leaf holds: places as fractions of its cell, and quantities.
    pub fn leaf<R>(
        &self,
        node: &TreeNode<Option<Kept>>,
        spill: &Spill,
        read: impl FnOnce(&mut dyn Iterator<Item = [f32; 3]>, &Quantities) -> R,
    ) -> std::io::Result<R> {
        let (Positions::Encoded(blob) | Positions::Words(blob)) = &self.positions;
        let mut words = vec![0_u64; node.particles as usize];
        decode_leaf(&spill.get(blob)?, node.points as usize, &mut words).map_err(std::io::Error::other)?;
        self.batch.with(spill, |quantities| read(&mut words.iter().map(|&word| unpack_leaf(word)), quantities))
    }
}

/// Columns as the quantiser takes them.
fn borrowed(columns: &Columns) -> Quantities<'_> {
    Quantities {
        mass: &columns.mass,
        density: &columns.density,
        smoothing_length: &columns.smoothing_length,
        attributes: columns.attributes.iter().map(Vec::as_slice).collect(),
    }
}

impl CodedTrees {
    /// A tree.
    fn tree(&self, levels: Purpose) -> &CodedTree {
        match (&self.volume, levels) {
            (Some(volume), Purpose::Samples) => volume,
            _ => &self.splats,
        }
    }

    /// The sections of a node, as they are stored.
    ///
    /// # Errors
    /// When they cannot be read back.
    pub fn sections(&self, levels: Purpose, depth: usize, index: usize, bits: CodeBits) -> std::io::Result<Sections> {
        if let (Some(clusters), Purpose::Clusters) = (&self.clusters, levels) {
            return clusters.sections(&self.spill, depth, index);
        }
        let tree = self.tree(levels);
        let NodeSections { positions, codes } = &tree.sections[depth][index];
        let node = &tree.nodes[depth][index].node;
        let positions = positions.as_ref().map(|blob| self.spill.get(blob)).transpose()?;
        let bits = bits.of(node.encoding == Encoding::Leaf);
        let mut own = Vec::with_capacity(node.particles as usize);
        for (blob, count) in codes {
            bits.unpack(&self.spill.get(blob)?, *count, &mut own);
        }
        if node.encoding != Encoding::Relay {
            let numbers = &self.books.numbers[usize::from(node.codebook)];
            own.iter_mut().for_each(|code| *code = numbers[usize::from(*code)]);
        }
        let mut packed = Vec::with_capacity(bits.packed_len(own.len()).unwrap_or(0));
        bits.pack(&own, &mut packed);
        Ok(Sections { positions: positions.map_or_else(Vec::new, |bytes| bytes.to_vec()), codes: packed })
    }

    /// What could not be read or put away.
    pub fn failed(&self, error: std::io::Error) -> BuildError {
        BuildError::temporary(&self.spill, error)
    }

    /// Bytes in the temporary file.
    pub fn on_disk(&self) -> u64 {
        self.spill.on_disk()
    }
}
