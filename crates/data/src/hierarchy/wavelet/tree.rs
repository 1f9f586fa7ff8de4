//! The hierarchy: for each node above the samples its large point, its directed set, and their errors.

use super::bricks::Bricks;
use super::error::{Options, Types};
use super::fields::InMemory;
use super::grid::{Samples, Shape};
use super::planes::Planes;
use super::sets::MOST;
use super::survey::{Fault, FaultOf, Survey, shelf_len};
use rayon::prelude::*;

/// A level of nodes; `levels[0]` has those of 2^D samples.
#[derive(Clone, Debug, Default)]
pub struct Level {
    /// Number of nodes.
    pub shape: Shape,
    /// Of each plane: the large point's value.
    pub large: Vec<Vec<f32>>,
    /// Whether the large point blends with its neighbours; else it ends at the node's border.
    pub soft: Vec<bool>,
    /// Whether the directed set lies on what blended large points show, its own among them: then its points' values are theirs without
    /// the large point's. Else it ends at the node's border by itself.
    pub laid: Vec<bool>,
    /// The directed set, a byte of [`super::sets::Set`].
    pub set: Vec<u8>,
    /// The published direction nearest to the set's, as values around the node have it; see [`super::kinds`]. Files do not have it.
    pub toward: Vec<u8>,
    /// Of each plane: the values of its points.
    pub points: Vec<Vec<[f32; MOST]>>,
    /// Sum of squared differences, weighted over planes, of the large point.
    pub large_error: Vec<f32>,
    /// The same of the directed set; infinite where there is none.
    pub set_error: Vec<f32>,
    /// Largest difference in any plane, of the large point.
    pub large_max: Vec<f32>,
    /// The same of the directed set.
    pub set_max: Vec<f32>,
    /// Samples that are numbers and do not count as air.
    pub samples: Vec<u32>,
    /// The error that a point more must spare so that the node is refined; see [`super::cut`].
    pub refine: Vec<f32>,
    /// The same so that the directed set is drawn in place of the large point.
    pub direct: Vec<f32>,
}

/// A hierarchy of points over samples.
#[derive(Clone, Debug, Default)]
pub struct Hierarchy {
    /// 2 or 3.
    pub dimensions: usize,
    /// Number of samples.
    pub shape: Shape,
    /// What it was built of.
    pub planes: Planes,
    /// Nodes, the finest first; none for a single sample.
    pub levels: Vec<Level>,
    /// By what sets were chosen.
    pub types: Types,
    /// Each plane's range.
    pub ranges: Vec<(f32, f32)>,
}

impl Level {
    /// As many nodes as a level of this shape has, of which nothing is known.
    pub fn empty(shape: Shape, planes: usize) -> Level {
        let nodes: usize = shape.iter().product();
        Level {
            shape,
            large: vec![vec![0.0; nodes]; planes],
            soft: vec![false; nodes],
            laid: vec![false; nodes],
            set: vec![0; nodes],
            toward: vec![0; nodes],
            points: vec![vec![[0.0; MOST]; nodes]; planes],
            large_error: vec![0.0; nodes],
            set_error: vec![f32::INFINITY; nodes],
            large_max: vec![0.0; nodes],
            set_max: vec![f32::INFINITY; nodes],
            samples: vec![0; nodes],
            refine: vec![0.0; nodes],
            direct: vec![0.0; nodes],
        }
    }

    /// Puts the nodes of a part in their places, which `indices` tells.
    pub fn put(&mut self, part: &Level, indices: &[usize]) {
        fn scatter<T: Copy>(to: &mut [T], from: &[T], indices: &[usize]) {
            indices.iter().zip(from).for_each(|(&i, v)| to[i] = *v);
        }
        self.large.iter_mut().zip(&part.large).for_each(|(to, from)| scatter(to, from, indices));
        self.points.iter_mut().zip(&part.points).for_each(|(to, from)| scatter(to, from, indices));
        scatter(&mut self.soft, &part.soft, indices);
        scatter(&mut self.laid, &part.laid, indices);
        scatter(&mut self.set, &part.set, indices);
        scatter(&mut self.toward, &part.toward, indices);
        scatter(&mut self.large_error, &part.large_error, indices);
        scatter(&mut self.set_error, &part.set_error, indices);
        scatter(&mut self.large_max, &part.large_max, indices);
        scatter(&mut self.set_max, &part.set_max, indices);
        scatter(&mut self.samples, &part.samples, indices);
        scatter(&mut self.refine, &part.refine, indices);
        scatter(&mut self.direct, &part.direct, indices);
    }
}

impl Hierarchy {
    /// Builds the hierarchy of samples in memory: brick by brick, as files are built.
    pub fn build(samples: &Samples, options: &Options) -> Hierarchy {
        let bricks = Bricks { dimensions: samples.dimensions, shape: samples.shape };
        let shelf = InMemory::new(shelf_len(bricks, samples.channels.len(), options));
        match Hierarchy::assembled(samples, &shelf, options) {
            Ok(hierarchy) => hierarchy,
            Err(Fault::Feed(never) | Fault::Shelf(never)) => match never {},
        }
    }

    fn assembled(
        samples: &Samples,
        shelf: &InMemory,
        options: &Options,
    ) -> Result<Hierarchy, FaultOf<Samples<'static>, InMemory>> {
        let at_once = 2 * rayon::current_num_threads().max(1);
        let survey = Survey::new(samples, shelf, options, at_once)?;
        let bricks = survey.bricks();
        let planes = samples.channels.len();
        let mut hierarchy = Hierarchy {
            dimensions: samples.dimensions,
            shape: samples.shape,
            planes: Planes::new(samples, options),
            levels: (1..=bricks.all_levels()).map(|level| Level::empty(bricks.level_shape(level), planes)).collect(),
            types: options.types,
            ranges: survey.ranges().to_vec(),
        };
        let all: Vec<usize> = (0..bricks.len()).collect();
        let mut roots = Vec::with_capacity(all.len());
        for some in all.chunks(at_once) {
            let made: Result<Vec<_>, _> = some.par_iter().map(|brick| survey.brick(*brick)).collect();
            for (&brick, (part, root)) in some.iter().zip(made?) {
                for (at, (own, part)) in hierarchy.levels.iter_mut().zip(&part.levels).enumerate() {
                    own.put(part, &bricks.part(brick, at + 1).indices(own.shape));
                }
                roots.push(root);
            }
        }
        let top = survey.top(roots)?;
        let above = hierarchy.levels.iter_mut().skip(bricks.levels());
        above.zip(top.nodes.levels).for_each(|(own, level)| *own = level);
        Ok(hierarchy)
    }
}
