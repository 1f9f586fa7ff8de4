//! How much of a picture may stay undrawn, found from a small picture of a few of its particles.
//!
//! Thinning (see [`crate::mode::lod_budget`]) keeps particle `i` with probability `p_i` and counts it `1/p_i` times. Tossed one by
//! one, that gives a pixel the variance
//!
//! `V = sum_i (w_i F_i)^2 (1/p_i - 1)`
//!
//! around its right value `P = sum_i w_i F_i`, with `F_i` the mean of the particle's kernel over the pixel; a sample that is
//! stratified has less. `P` moves by `sqrt(V)`, its place in the transfer function's range by as much as its scale says,
//! and the colour by the length of the table's curve between the two. The mean of that over the picture is what the budget
//! limits.
//!
//! The pilot draws some [`PARTICLES`] particles, evenly sampled, at [`SIDE`] pixels: `P`, and in the attribute's channel `V`,
//! with `F_i^2` spread as `F_i` is. A few tries find the `c` whose predicted error is the budget. The cost does not depend on
//! how many particles the picture has.

use super::decode::{DecodedNode, cut, decode_some};
use super::level_report::has_clusters;
use super::subject::Subject;
use crate::color::Accumulation;
use crate::color::composite::color_distance;
use crate::color::transfer::{Levels, Scale, TransferFunction};
use crate::cpu::volume::VolumeError;
use crate::mode::CodeTable;
use crate::mode::lod_budget::{LodBudget, Plan, can_thin, magnification};
use crate::mode::sample::Sample;
use crate::model::Kernel;
use crate::stream::SceneNode;
use crate::view::View;

/// Particles that the pilot draws, about.
const PARTICLES: f64 = 60_000.0;
/// Longest side of the pilot's picture, pixels.
const SIDE: u32 = 256;
/// Tries for the factor.
const TRIES: usize = 7;
/// Mean of `|x|` for a normal distribution of unit variance. That samples are stratified is left as a reserve.
const ERROR_OF_SIGMA: f64 = 0.8;

/// What `lod_budget` comes to for the picture of `nodes` in `view`, coloured by `transfer` with the ranges `levels`; where
/// they are `None`, with those that the transfer function finds in the pilot's picture.
///
/// # Errors
/// [`VolumeError`] as the CPU renderer.
pub(super) fn plan(
    subject: &Subject<'_>,
    view: &View,
    nodes: &[SceneNode],
    lod_budget: &LodBudget,
    levels: Option<Levels>,
) -> Result<Plan, VolumeError> {
    let mut plan = Plan { culling: lod_budget.culling, ..Plan::default() };
    // Clusters were chosen as few as they may be.
    if has_clusters(nodes) {
        return Ok(plan);
    }
    let thins = lod_budget.thinning > 0.0 && can_thin(subject.depiction);
    if !lod_budget.needs_levels() || (!thins && levels.is_some_and(|_| lod_budget.presence <= 0.0)) {
        return Ok(plan);
    }
    if !thins && let Some(levels) = levels {
        plan.faintest = faintest(lod_budget, &levels);
        return Ok(plan);
    }
    let particles = nodes.iter().map(|node| u64::from(node.page.nodes[node.node.node as usize].particles)).sum();
    let mut pilot = Estimate::new(subject, view, particles);
    pilot.add(nodes);
    pilot.plan(lod_budget, levels)
}

fn faintest(lod_budget: &LodBudget, levels: &Levels) -> f32 {
    if lod_budget.presence > 0.0 { (levels.p[0] / lod_budget.presence).max(0.0) as f32 } else { 0.0 }
}

/// Some particles of a picture, and what their absence would do.
pub(super) struct Estimate<'a> {
    subject: Subject<'a>,
    /// The picture's view, and the pilot's.
    whole: View,
    view: View,
    /// The share of the particles that the pilot draws.
    share: f32,
    nodes: Vec<DecodedNode<'static>>,
    /// For each particle `w min(integral of F^2, 1/pixel)`, and its probability for `c = 1`.
    columns: Vec<(Vec<f32>, Vec<f32>)>,
}

impl<'a> Estimate<'a> {
    /// Of a picture of nodes with so many particles.
    pub fn new(subject: &Subject<'a>, view: &View, particles: u64) -> Estimate<'a> {
        let share = (PARTICLES / particles.max(1) as f64).min(1.0) as f32;
        let shrink = (f64::from(SIDE) / f64::from(view.width.max(view.height))).min(1.0);
        let side = |pixels: u32| ((f64::from(pixels) * shrink).round() as u32).max(1);
        let pilot = view.resized(side(view.width), side(view.height));
        Estimate { subject: *subject, whole: *view, view: pilot, share, nodes: Vec::new(), columns: Vec::new() }
    }

    /// Adds nodes of the picture, one after the other.
    pub fn add(&mut self, nodes: &[SceneNode]) {
        let Subject { metadata, depiction, .. } = self.subject;
        let (view, share) = (&self.whole, self.share);
        let square = mean_square(metadata.kernel);
        // Each is as likely to be drawn as any other, and has its importance as attribute.
        let even = |table: CodeTable| CodeTable { attribute: Some(table.importance.clone()), ..table };
        let sample = |drawn: &SceneNode, _: f32| {
            let seed = drawn.page.nodes[drawn.node.node as usize].seed;
            // Their kernels stay as they are: what their absence would do is what is measured.
            if share < 1.0 { Sample { growth: 1.0, ..Sample::even(seed, share) } } else { Sample::ALL }
        };
        let decoded = cut(view, decode_some(depiction, metadata, nodes, even, Some(sample)));
        for (drawn, node) in nodes.iter().zip(decoded) {
            let family = &metadata.families[drawn.page.family as usize];
            let cell = drawn.page.nodes[drawn.node.node as usize].frame.bounds();
            let magnification = magnification(&view.of_image(drawn.offset), cell);
            let mean = family.mass / family.count.max(1) as f64;
            let factor = (magnification.powf(0.75) / mean) as f32;
            let pairs = || node.weight().iter().zip(node.smoothing_length());
            let variance = pairs().map(|(&w, &h)| {
                // A kept particle stands for 1/share of them, but each of those has its own weight.
                let own = f64::from(w) * f64::from(share);
                (own * (square / f64::from(h).powi(2)).min(magnification * magnification)) as f32
            });
            let probability = node.attribute().iter().map(|importance| factor * importance);
            self.columns.push((variance.collect(), probability.collect()));
            self.nodes.push(node.into_owned());
        }
    }

    /// What `lod_budget` comes to, as [`plan`] says.
    ///
    /// # Errors
    /// [`VolumeError`] as the CPU renderer.
    pub fn plan(mut self, lod_budget: &LodBudget, levels: Option<Levels>) -> Result<Plan, VolumeError> {
        let Subject { depiction, transfer, .. } = self.subject;
        let picture = self.draw(1.0)?;
        let levels = levels.unwrap_or_else(|| transfer.levels(&Accumulation { ps: Vec::new(), ..picture }));
        let mut plan = Plan { culling: lod_budget.culling, faintest: faintest(lod_budget, &levels), ..Plan::default() };
        if lod_budget.thinning > 0.0 && can_thin(depiction) {
            let curve = Curve::new(transfer, levels, depiction.attribute.is_some());
            plan.keep = self.solve(lod_budget.thinning, &curve)?;
        }
        Ok(plan)
    }

    /// `P`, and in the attribute's channel `V` for thinning by `c`.
    fn draw(&mut self, c: f32) -> Result<Accumulation, VolumeError> {
        for (node, (variance, probability)) in self.nodes.iter_mut().zip(&self.columns) {
            let lost = |(&v, &p): (&f32, &f32)| if c * p >= 1.0 { 0.0 } else { v * (1.0 / (c * p).max(1e-12) - 1.0) };
            node.set_attribute(variance.iter().zip(probability).map(lost).collect());
        }
        let drawn = self.subject.draw(&self.view, &self.nodes, &Plan::default())?;
        Ok(drawn.sums(self.subject.depiction.mode)?.0)
    }

    /// The `c` whose predicted error is `budget`; infinite where no thinning is within it.
    fn solve(&mut self, budget: f64, curve: &Curve) -> Result<f32, VolumeError> {
        // Bisection of the logarithm: the error falls as c grows.
        let (mut low, mut high) = (-14.0_f32, 8.0_f32);
        for _ in 0..TRIES {
            let middle = 0.5 * (low + high);
            let picture = self.draw(middle.exp2())?;
            if curve.error(&picture) > budget { low = middle } else { high = middle }
        }
        Ok(if high >= 8.0 { f32::INFINITY } else { high.exp2() })
    }
}

/// The integral of the squared kernel over the plane, for `h = 1`.
fn mean_square(kernel: Kernel) -> f64 {
    let steps = 512;
    let ring = |i: i32| (f64::from(i) + 0.5) / f64::from(steps);
    (0..steps).map(ring).map(|q| std::f64::consts::TAU * q * kernel.projected(q).powi(2) / f64::from(steps)).sum()
}

/// The way that colours go as `P` grows.
struct Curve {
    scale: Scale,
    range: [f64; 2],
    /// Length of the way to evenly spaced brightnesses, of 255.
    lengths: Vec<f64>,
    /// Length of the way from the lowest hue to the highest at those brightnesses; empty without hue.
    hues: Vec<f64>,
}

/// Standard deviation of the attribute among the particles along a line of sight, of the range of hues, as it is assumed.
const HUE_SPREAD: f64 = 0.1;

impl Curve {
    /// Pieces of the table that are taken as straight: long enough that its rounding to bytes does not add to them.
    const PIECES: usize = 32;

    fn new(transfer: &TransferFunction, levels: Levels, attribute: bool) -> Curve {
        let lut = transfer.bake_lut();
        let row = (lut.height / 2 * lut.width) as usize;
        let color = |i: usize| lut.rgba[row + i * (lut.width as usize - 1) / Curve::PIECES];
        let mut lengths = vec![0.0];
        for i in 0..Curve::PIECES {
            lengths.push(lengths[i] + color_distance(color(i), color(i + 1)));
        }
        let mut hues = Vec::new();
        if attribute && lut.height > 1 {
            hues.extend((0..=Curve::PIECES).map(|i| {
                let column = i * (lut.width as usize - 1) / Curve::PIECES;
                let color = |row: usize| lut.rgba[row * lut.width as usize + column];
                let rows = lut.height as usize - 1;
                (0..8).map(|k| color_distance(color(k * rows / 8), color((k + 1) * rows / 8))).sum::<f64>()
            }));
        }
        Curve { scale: transfer.scale, range: levels.p, lengths, hues }
    }

    fn at(&self, p: f64, of: &[f64]) -> f64 {
        let place = f64::from(self.scale.place(p as f32, self.range)) * Curve::PIECES as f64;
        let index = (place as usize).min(Curve::PIECES - 1);
        of[index] + (place - index as f64) * (of[index + 1] - of[index])
    }

    /// The mean colour error that the variance in a picture's attribute channel stands for.
    fn error(&self, picture: &Accumulation) -> f64 {
        let error = |(&p, &v): (&f32, &f32)| {
            let (p, sigma) = (f64::from(p), f64::from(v.max(0.0)).sqrt());
            let brightness = 0.5 * (self.at(p + sigma, &self.lengths) - self.at(p - sigma, &self.lengths));
            if self.hues.is_empty() || p <= 0.0 {
                return brightness;
            }
            // S is a mean over the particles that P is the sum of.
            brightness.hypot(HUE_SPREAD * self.at(p, &self.hues) * (sigma / p).min(1.0))
        };
        let sum: f64 = picture.p.iter().zip(&picture.ps).map(error).sum();
        ERROR_OF_SIGMA * sum / picture.p.len().max(1) as f64
    }
}
