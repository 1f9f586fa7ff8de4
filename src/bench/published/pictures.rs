//! Pictures of HE03's structure: points are looked up, decoded and drawn, added up or over each other.

use super::relative::Relative;
use super::traversal::{Depth, Sink, traverse};
use crate::bench::splat::Failure;
use crate::color::splat_colors::SplatColors;
use crate::color::{Accumulation, Colors};
use crate::cpu::over::{Order, Over, draw as draw_over};
use crate::cpu::{Extent, Positions, SplatOptions, Splats, draw};
use crate::mode::Conserved;
use crate::mode::over::own_column;
use crate::model::Kernel;
use crate::view::View;
use glam::DVec3;

/// Some decoded points.
#[derive(Clone, Debug, Default)]
struct Batch {
    /// From the structure's origin, world units.
    offsets: Vec<[f32; 3]>,
    /// Half of the diameters.
    radii: Vec<f32>,
    weights: Vec<f32>,
}

/// What a traversal has chosen.
pub struct Chosen {
    origin: DVec3,
    batches: Vec<Batch>,
    /// Points that are drawn of each level, the coarsest first.
    pub points: Vec<u64>,
}

struct Decoder<'a> {
    structure: &'a Relative,
    batch: Batch,
    points: Vec<u64>,
}

impl Sink for Decoder<'_> {
    fn draw(&mut self, level: usize, index: usize) {
        let (node, run) = (self.structure.node(level, index), self.structure.run(level, index));
        let finer = level + self.structure.delta();
        self.points[finer - 1] += run.len() as u64;
        let points = &self.structure.points(finer)[run];
        self.batch.offsets.extend(points.iter().map(|point| node.place(point)));
        self.batch.radii.extend(points.iter().map(|point| 0.5 * node.diameter_of(point)));
        self.batch.weights.extend(points.iter().map(|point| point.mass));
    }
}

/// Decodes what a view shows.
pub fn choose(structure: &Relative, view: &View, depth: Depth) -> Chosen {
    let blank = || vec![0; structure.finest()];
    let decoder = || Decoder { structure, batch: Batch::default(), points: blank() };
    let mut chosen = Chosen { origin: structure.origin(), batches: Vec::new(), points: blank() };
    for part in traverse(structure, view, depth, decoder) {
        chosen.points.iter_mut().zip(part.points).for_each(|(sum, own)| *sum += own);
        chosen.batches.push(part.batch);
    }
    chosen
}

impl Chosen {
    fn splats(&self) -> Result<Vec<Splats<'_>>, Failure> {
        let batches = self.batches.iter().filter(|batch| !batch.weights.is_empty());
        let splats = batches.map(|batch| {
            let positions = Positions::Relative { origin: self.origin, scale: 1.0, offsets: &batch.offsets };
            Ok(Splats::new(positions, Extent::World(&batch.radii), &batch.weights, None)?)
        });
        splats.collect()
    }

    /// Adds them up.
    ///
    /// # Errors
    /// Never, since columns have the same lengths.
    pub fn sums(&self, view: &View, kernel: Kernel) -> Result<Accumulation, Failure> {
        Ok(draw(view, &self.splats()?, &SplatOptions { kernel, ..SplatOptions::default() }))
    }

    /// Blends them over each other, where a particle has this mass on average.
    ///
    /// # Errors
    /// Never, since columns have the same lengths.
    pub fn over(&self, view: &View, kernel: Kernel, look: &Look<'_>) -> Result<Colors, Failure> {
        let Look { order, colors, particle } = *look;
        let column = own_column(Conserved::Mass, kernel, (particle, 1.0));
        Ok(draw_over(view, &self.splats()?, &Over { order, kernel, colors, column, around: None }).0)
    }
}

/// How points lie over each other.
#[derive(Clone, Copy, Debug)]
pub struct Look<'a> {
    /// In which order.
    pub order: Order,
    /// With which colours.
    pub colors: &'a SplatColors,
    /// Mean mass of a particle.
    pub particle: f64,
}
