//! A family's clusters (HE03): bottom-up from the leaves of its octree, then coded.

use super::coding::{self, Batch};
use super::spill::{Blob, Spill};
use super::tree::{CodedTree, Grown};
use crate::codec::clusters::{Ladder, PackedClusters, StoredStep, class_of};
use crate::codec::shapes::{self, COORDINATES, Shape, ShapeCoder};
use crate::codec::{BatchInfo, CodeBits, CodebookScope, Quantities, Scaling, VqBits};
use crate::hierarchy::octree::{Context, TreeNode};
use crate::hierarchy::pca::{Members, SplitRule, Step, bright, members::trace, split, steps, take_over};
use crate::hierarchy::{ClusterOptions, Encoding};
use crate::model::progress::Progress;
use crate::model::{Bounds, Kernel};
use crate::store::layout::StoredNode;
use crate::store::paging::{PlannedNode, Sections};
use crate::store::{ClusterBook, ClusterLevel};
use glam::DVec3;
use rayon::prelude::*;
use std::io;
use std::sync::OnceLock;

/// The clusters of a node before codes are trained.
#[derive(Debug)]
struct Made {
    count: u32,
    /// [`PackedClusters`] without shapes.
    packed: Blob,
    /// Coordinates of each shape.
    shapes: Blob,
    values: Batch,
    /// Largest distance of a source particle from its cluster as it is drawn, root fractions.
    delta: f64,
    /// Around the clusters as they are drawn, root fractions.
    drawn: Bounds,
    /// The largest standard deviation of a cluster, root fractions.
    deviation: f64,
    /// Sums of the sizes, root fractions, and of masses times misfit.
    sizes: f64,
    misfit: f64,
    /// Sum of the decoded masses.
    mass: f64,
}

/// [`Made`] without the values, which are coded apart.
struct Own {
    count: u32,
    packed: Blob,
    shapes: Blob,
    delta: f64,
    drawn: Bounds,
    deviation: f64,
    sizes: f64,
    misfit: f64,
    mass: f64,
}

/// The clusters of a family before codes are trained: a node for each of the octree's, leaves included; `None` of relays and small leaves.
pub(super) struct Clusters {
    nodes: Vec<Vec<OnceLock<Option<Made>>>>,
}

/// Coded clusters.
pub(super) struct CodedClusters {
    /// The nodes, without the places of their children.
    pub nodes: Vec<Vec<PlannedNode>>,
    sections: Vec<Vec<Option<(Blob, Blob)>>>,
    /// One for each depth, without bytes.
    pub levels: Vec<ClusterLevel>,
    /// What codes stand for.
    pub book: ClusterBook,
}

/// What a node, or what is drawn in its place, hands up: its clusters, and what parts of them are worth.
type Drawn = (Members, Vec<Vec<Step>>);

/// What making clusters needs to know beside a tree.
pub(super) struct Maker<'a> {
    pub context: &'a Context<'a>,
    pub options: ClusterOptions,
    pub kernel: Kernel,
    pub spill: &'a Spill,
    pub progress: &'a dyn Progress,
}

impl Maker<'_> {
    /// Makes the clusters of all nodes of an octree, children before parents.
    ///
    /// # Errors
    /// When something cannot be put away or read back.
    pub fn make(&self, tree: &Grown) -> io::Result<Clusters> {
        let nodes = tree.nodes.iter().map(|level| level.iter().map(|_| OnceLock::new()).collect()).collect();
        let clusters = Clusters { nodes };
        self.progress.begin("clustering", tree.nodes.iter().map(|level| level.len() as u64).sum());
        self.visit(tree, &clusters, 0, 0)?;
        Ok(clusters)
    }

    /// Makes the clusters of a node and of all below it.
    fn visit(&self, tree: &Grown, out: &Clusters, depth: usize, index: usize) -> io::Result<Drawn> {
        let node = &tree.nodes[depth][index];
        let (members, below) = match node.encoding {
            Encoding::Leaf => {
                let particles = self.particles(node)?;
                let whole = Step { clusters: particles.len() as u32, ..Step::default() };
                (particles, vec![vec![whole]])
            }
            _ => {
                let children: Vec<usize> = node.children.iter().flatten().copied().collect();
                let below: Vec<Drawn> = children
                    .into_par_iter()
                    .map(|child| self.visit(tree, out, depth + 1, child))
                    .collect::<io::Result<_>>()?;
                let (mut all, mut steps) = (Members::default(), Vec::new());
                for (members, own) in below {
                    all.append(members);
                    steps.extend(own);
                }
                (all, steps)
            }
        };
        let most = match node.encoding {
            Encoding::Leaf if depth > 0 => self.options.of_leaf(members.len()),
            Encoding::Leaf => self.options.of_leaf(members.len()).or(Some(1)),
            _ if depth > 0 => self.options.of_node(members.len()),
            _ => Some(self.options.of_root(members.len())),
        };
        let Some(most) = most else {
            // Every node is visited once.
            let _ = out.nodes[depth][index].set(None);
            self.progress.advance(1);
            return Ok((members, below));
        };
        let splitting = split(&members, self.options.rule, most);
        let clusters = members.merged(&splitting, self.context.rules);
        let mut steps = steps(&clusters, &splitting);
        let priority = if node.encoding == Encoding::Leaf { 0.0 } else { take_over(&steps, &below) };
        if let Some(last) = steps.last_mut() {
            last.priority = last.priority.max(priority);
        }
        let cell = node.key.cell();
        let cells = f64::from(cell.depth).exp2();
        let corner = [cell.x, cell.y, cell.z].map(f64::from);
        // Priorities are told in the data's unit of length, which all families have in common.
        let bright = match self.options.rule {
            SplitRule::Relative => bright(1.0, self.context.root.size.powi(2)),
            SplitRule::Distortion => 1.0,
        };
        let mut packed = PackedClusters {
            ranks: splitting.ranks.iter().map(|&rank| class_of(rank)).collect(),
            steps: steps
                .iter()
                .map(|step| StoredStep {
                    priority: finite(step.priority * bright),
                    scale: finite(step.scale * cells * cells),
                    misfit: finite(step.misfit),
                    largest: finite(step.largest * cells * cells),
                })
                .collect(),
            ..PackedClusters::default()
        };
        let analysed: Vec<(f64, Shape)> = clusters.moments.iter().map(shapes::analyse).collect();
        let ladder = Ladder::over(clusters.mass.iter().copied());
        packed.masses = (ladder, clusters.mass.iter().map(|&mass| ladder.step_of(mass)).collect());
        let ladder = Ladder::over(analysed.iter().map(|(size, _)| size * cells));
        packed.sizes = (ladder, analysed.iter().map(|(size, _)| ladder.step_of(size * cells)).collect());
        let fraction = |place: &[f64; 3]| -> [f64; 3] { std::array::from_fn(|k| place[k] * cells - corner[k]) };
        let places: Vec<[f64; 3]> = clusters.places.iter().map(fraction).collect();
        let sizes: Vec<f64> = analysed.iter().map(|(size, _)| size * cells).collect();
        packed.set_places(&places, &sizes);
        if self.options.rule == SplitRule::Distortion {
            let ladder = Ladder::over(clusters.diameters.iter().map(|size| size * cells));
            let steps = clusters.diameters.iter().map(|size| ladder.step_of(size * cells));
            packed.published = Some((ladder, steps.collect()));
        }
        let (mut mass, mut decoded, mut true_sum, mut true_mass) = (0.0, [0.0; 3], [0.0; 3], 0.0);
        for (i, own) in places.iter().enumerate() {
            let m = packed.masses.0.value(packed.masses.1[i]);
            let at = packed.place(i);
            mass += m;
            true_mass += clusters.mass[i];
            for k in 0..3 {
                decoded[k] += m * at[k];
                true_sum[k] += clusters.mass[i] * own[k];
            }
        }
        packed.shift = std::array::from_fn(|k| finite(true_sum[k] / true_mass - decoded[k] / mass));
        let (mut delta, mut drawn) = (0.0_f64, Bounds::EMPTY);
        for (i, group) in splitting.groups().enumerate() {
            let at = packed.place(i);
            let place = std::array::from_fn(|k| (corner[k] + at[k]) / cells);
            delta = delta.max(members.reach_from(place, group.iter().copied()));
            drawn = drawn.with(DVec3::from_array(place));
        }
        let mut bytes = Vec::new();
        packed.encode(0, &mut bytes);
        let coordinates: Vec<f32> = analysed.iter().flat_map(|(_, shape)| *shape).collect();
        let ones = vec![1.0_f32; clusters.len()];
        let quantities = Quantities {
            mass: &ones,
            density: &clusters.density,
            smoothing_length: &ones,
            attributes: clusters.attributes.iter().map(Vec::as_slice).collect(),
        };
        let columns = [quantities.mass, quantities.density, quantities.smoothing_length];
        let columns = columns.into_iter().chain(quantities.attributes.iter().copied());
        let columns: Vec<&[u8]> = columns.map(bytemuck::cast_slice).collect();
        let made = Made {
            count: clusters.len() as u32,
            packed: self.spill.put(&[&bytes])?,
            shapes: self.spill.put(&[bytemuck::cast_slice(&coordinates)])?,
            values: Batch {
                density: 0.0,
                quantities: self.spill.put(&columns)?,
                info: BatchInfo::of(&quantities),
                group: first_group(tree, depth, index),
            },
            delta,
            drawn,
            deviation: clusters.moments.iter().map(|own| trace(own).sqrt()).fold(0.0, f64::max),
            sizes: analysed.iter().map(|(size, _)| size).sum(),
            misfit: steps.last().map_or(0.0, |step| step.misfit),
            mass,
        };
        let _ = out.nodes[depth][index].set(Some(made));
        self.progress.advance(1);
        Ok((clusters, vec![steps]))
    }

    /// The particles of a leaf, where they are drawn.
    fn particles(&self, node: &TreeNode<Option<super::tree::Kept>>) -> io::Result<Members> {
        let mut members =
            Members { attributes: self.context.rules.iter().map(|_| Vec::new()).collect(), ..Members::default() };
        let cell = node.key.cell();
        let cells = f64::from(cell.depth).exp2();
        let corner = [cell.x, cell.y, cell.z].map(f64::from);
        // A kernel is at least as wide as the places are told.
        let least = (f64::from(1_u32 << 21) * cells).recip();
        for kept in node.data.iter().flatten() {
            kept.leaf(node, self.spill, |fractions, quantities| {
                for (i, fraction) in fractions.enumerate() {
                    let place = std::array::from_fn(|k| (corner[k] + f64::from(fraction[k])) / cells);
                    let h = (f64::from(quantities.smoothing_length[i]) / self.context.root.size).max(least);
                    let mass = f64::from(quantities.mass[i]);
                    let kernel = (h, self.kernel.variance() * h * h);
                    members.push_particle(place, mass, quantities.density[i], kernel);
                }
                for (own, values) in members.attributes.iter_mut().zip(&quantities.attributes) {
                    own.extend_from_slice(values);
                }
            })?;
        }
        Ok(members)
    }
}

/// The group of the first bucket that a node has particles of.
fn first_group(tree: &Grown, depth: usize, index: usize) -> u32 {
    let node = &tree.nodes[depth][index];
    let own = node.data.iter().flatten().next().map(super::tree::Kept::group);
    own.or_else(|| Some(first_group(tree, depth + 1, *node.children.iter().flatten().next()?))).unwrap_or(0)
}

/// The nearest finite single.
fn finite(value: f64) -> f32 {
    (value as f32).clamp(f32::MIN, f32::MAX)
}

impl Clusters {
    /// Codes the clusters of the nodes of a coded octree.
    ///
    /// # Errors
    /// When something cannot be put away or read back.
    pub fn code(
        self,
        maker: &Maker<'_>,
        octree: &CodedTree,
        scaling: &Scaling,
        vq_bits: VqBits,
    ) -> io::Result<CodedClusters> {
        let spill = maker.spill;
        let made: Vec<Vec<Option<Made>>> =
            self.nodes.into_iter().map(|level| level.into_iter().filter_map(OnceLock::into_inner).collect()).collect();
        let total: u64 = made.iter().flatten().flatten().map(|node| u64::from(node.count)).sum();
        let (bits, is_published) = (maker.options.shape_bits, maker.options.rule == SplitRule::Distortion);
        let coder = match bits {
            0 => None,
            _ => Some(ShapeCoder::train(&sample(&made, total, spill)?, total, bits)),
        };
        // All nodes share one codebook of densities and attributes.
        let flat = |node: &PlannedNode| TreeNode {
            key: node.node.key,
            encoding: Encoding::Clusters,
            particles: 0,
            points: 0,
            source_particles: 0,
            delta: 0.0,
            bounds: node.node.bounds,
            smoothing_length_max: 0.0,
            mass: 0.0,
            mass_density: 0.0,
            children: [None; 8],
            data: Vec::<()>::new(),
        };
        let with_own = octree.nodes.iter().flatten().zip(made.iter().flatten()).filter(|(_, made)| made.is_some());
        let drafts: Vec<TreeNode<()>> = with_own.map(|(node, _)| flat(node)).collect();
        let (mut rest, mut batches) = (Vec::with_capacity(made.len()), Vec::with_capacity(drafts.len()));
        for level in made {
            let mut own = Vec::with_capacity(level.len());
            for made in level {
                own.push(made.map(|made| {
                    let Made { count, packed, shapes, values, delta, drawn, deviation, sizes, misfit, mass } = made;
                    batches.push(vec![values]);
                    Own { count, packed, shapes, delta, drawn, deviation, sizes, misfit, mass }
                }));
            }
            rest.push(own);
        }
        let scope = |_| CodebookScope::Clusters;
        let plain = CodeBits::plain(vq_bits);
        let mut coded = coding::code(&[drafts], vec![batches], scaling, spill, plain, scope, None, maker.progress)?;
        let (Some(values), Some(numbers)) = (coded.codebooks.pop(), coded.numbers.pop()) else {
            return Err(io::Error::other("no clusters"));
        };
        let book = ClusterBook::new(coder.as_ref().map(ShapeCoder::book).unwrap_or_default(), values);
        let mut codes = coded.nodes.into_iter().flatten();
        let root = maker.context.root;
        let (mut nodes, mut sections, mut levels) = (Vec::new(), Vec::new(), Vec::new());
        for (depth, (level, own)) in octree.nodes.iter().zip(rest).enumerate() {
            let with_codes: Vec<_> = level
                .iter()
                .zip(own)
                .map(|(node, own)| (node, own.and_then(|own| Some((own, codes.next()?)))))
                .collect();
            let mut about = ClusterLevel { depth: depth as u8, ..ClusterLevel::default() };
            let (mut misfits, mut masses) = (0.0, 0.0);
            for (node, own) in &with_codes {
                let is_leaf = node.node.encoding == Encoding::Leaf;
                about.nodes += u64::from(!(is_leaf && own.is_none()));
                let Some((Own { count, sizes, misfit, .. }, _)) = own else { continue };
                about.clusters += u64::from(*count);
                about.finest += if node.node.encoding == Encoding::Leaf { u64::from(*count) } else { 0 };
                about.size += sizes * root.size;
                misfits += misfit;
                masses += node.node.mass;
            }
            about.size /= (about.clusters as f64).max(1.0);
            about.misfit = if masses > 0.0 { misfits / masses } else { 0.0 };
            levels.push(about);
            let done: Vec<(PlannedNode, Option<(Blob, Blob)>)> = with_codes
                .into_par_iter()
                .map(|(node, own)| {
                    let Some((Own { count, packed, shapes, delta, drawn, deviation, mass, .. }, coded)) = own else {
                        return Ok((without_clusters(node), None));
                    };
                    let (mut packed_clusters, _) =
                        PackedClusters::decode(&spill.get(&packed)?, count as usize, 0, is_published)
                            .map_err(io::Error::other)?;
                    spill.forget(packed);
                    if let Some(coder) = &coder {
                        let bytes = spill.get(&shapes)?;
                        let coordinates: &[f32] = bytemuck::cast_slice(&bytes);
                        let shape = |five: &[f32]| std::array::from_fn(|k| five[k]);
                        let own: Vec<Shape> = coordinates.chunks_exact(COORDINATES).map(shape).collect();
                        packed_clusters.shapes = coder.codes(&own);
                    }
                    spill.forget(shapes);
                    let mut entries: Vec<u16> = Vec::with_capacity(count as usize);
                    for (blob, count) in coded.codes {
                        vq_bits.unpack(&spill.get(&blob)?, count, &mut entries);
                        spill.forget(blob);
                    }
                    entries.iter_mut().for_each(|code| *code = numbers[usize::from(*code)]);
                    let presence: f64 = entries
                        .iter()
                        .zip(&packed_clusters.masses.1)
                        .map(|(code, mass)| {
                            packed_clusters.masses.0.value(*mass) * f64::from(book.values.density[usize::from(*code)])
                        })
                        .sum();
                    let (mut section, mut packed_codes) = (Vec::new(), Vec::new());
                    packed_clusters.encode(bits, &mut section);
                    vq_bits.pack(&entries, &mut packed_codes);
                    let world = |at: DVec3| root.min + at * root.size;
                    let drawn = Bounds { min: world(drawn.min), max: world(drawn.max) };
                    let own = &node.node;
                    let is_leaf = own.encoding == Encoding::Leaf;
                    let reach = (deviation * root.size / maker.kernel.variance().sqrt()) as f32;
                    let planned = PlannedNode {
                        sections: (section.len(), packed_codes.len()),
                        children: if is_leaf { [None; 8] } else { node.children },
                        node: StoredNode {
                            key: own.key,
                            encoding: if is_leaf { Encoding::LeafClusters } else { Encoding::Clusters },
                            codebook: 0,
                            particles: count,
                            points: 0,
                            source_particles: own.source_particles,
                            // Rounded up by what rounding moves places, and by what leaves are displaced by themselves.
                            delta: delta * root.size * (1.0 + 1e-9) + if is_leaf { own.delta } else { 0.0 },
                            bounds: own.bounds.union(drawn),
                            smoothing_length_max: own.smoothing_length_max.max(reach),
                            mass: own.mass,
                            mass_density: own.mass_density,
                            mass_scale: super::tree::scale(own.mass, mass),
                            mass_density_scale: super::tree::scale(own.mass_density, presence),
                            children: [None; 8],
                        },
                    };
                    Ok((planned, Some((spill.put(&[&section])?, spill.put(&[&packed_codes])?))))
                })
                .collect::<io::Result<_>>()?;
            let (own_nodes, own_sections): (Vec<_>, Vec<_>) = done.into_iter().unzip();
            nodes.push(own_nodes);
            sections.push(own_sections);
        }
        Ok(CodedClusters { nodes, sections, levels, book })
    }
}

impl CodedClusters {
    /// The sections of a node, as they are stored.
    ///
    /// # Errors
    /// When they cannot be read back.
    pub fn sections(&self, spill: &Spill, depth: usize, index: usize) -> io::Result<Sections> {
        let Some((positions, codes)) = &self.sections[depth][index] else { return Ok(Sections::default()) };
        Ok(Sections { positions: spill.get(positions)?.to_vec(), codes: spill.get(codes)?.to_vec() })
    }
}

/// A node that has no clusters: a leaf that is drawn itself, or a relay.
fn without_clusters(node: &PlannedNode) -> PlannedNode {
    let own = &node.node;
    if own.encoding == Encoding::Leaf {
        return node.clone();
    }
    let relay = StoredNode {
        encoding: Encoding::Relay,
        codebook: 0,
        particles: 0,
        points: 0,
        delta: f64::INFINITY,
        mass_scale: 1.0,
        mass_density_scale: 1.0,
        ..own.clone()
    };
    PlannedNode { node: relay, children: node.children, sections: (0, 0) }
}

/// Evenly spread shapes, the same for any number of threads.
fn sample(made: &[Vec<Option<Made>>], total: u64, spill: &Spill) -> io::Result<Vec<Shape>> {
    let stride = total.div_ceil(shapes::SAMPLE as u64).max(1) as usize;
    let mut sample = Vec::new();
    let mut next = 0;
    for node in made.iter().flatten().flatten() {
        let bytes = spill.get(&node.shapes)?;
        let coordinates: &[f32] = bytemuck::cast_slice(&bytes);
        let count = node.count as usize;
        while next < count {
            sample.push(std::array::from_fn(|k| coordinates[COORDINATES * next + k]));
            next += stride;
        }
        next -= count;
    }
    Ok(sample)
}
