//! The second pass of a build: the points of a brick's nodes, and in the end of those above all bricks.

use super::analyse::Found;
use super::bricks::{Bricks, Part};
use super::cells::{Cells, cell_levels};
use super::cut::{Event, prices};
use super::error::{Metric, Types};
use super::feed::Feed;
use super::fields::Shelf;
use super::fit::tents;
use super::grid::{Shape, children};
use super::level::{MARGIN, Nodes, all_numbers};
use super::planes::Planes;
use super::pyramid::{Means, means};
use super::survey::{AROUND, FIRST, Fault, FaultOf, Survey};
use super::tree::{Hierarchy, Level};
use rayon::prelude::*;

/// What is left of a brick when its nodes are written: what the nodes above all bricks need.
#[derive(Clone, Debug, Default)]
pub struct Root {
    /// Samples that are numbers.
    samples: u32,
    /// How its best cut changes with the price of a point.
    events: Vec<Event>,
    /// The largest coefficient of its nodes, where there are coefficients.
    largest: f32,
    /// Points of its cut at half a step of 8 bits.
    within: usize,
}

/// What a build ends with.
#[derive(Clone, Debug, Default)]
pub struct Top {
    /// The nodes above all bricks: `levels[0]` has those whose children are the bricks' coarsest ones.
    pub nodes: Hierarchy,
    /// Whether nothing is spared at half a step of 8 bits.
    pub is_noise: bool,
}

/// What is known of the nodes of a level around a brick.
struct Known {
    part: Part,
    planes: Vec<Means>,
}

impl<F: Feed, S: Shelf> Survey<'_, F, S> {
    /// How the grid is cut into bricks.
    pub fn bricks(&self) -> Bricks {
        self.bricks
    }

    /// Each plane's range.
    pub fn ranges(&self) -> &[(f32, f32)] {
        &self.ranges
    }

    /// Whether some samples are no numbers, or count as air.
    pub fn has_holes(&self) -> bool {
        self.rules.filling.is_some()
    }

    /// A hierarchy of no levels over a part of the grid.
    fn over(&self, shape: Shape) -> Hierarchy {
        let planes = Planes { weights: self.weights.clone(), colours: self.rules.colours, ..Planes::default() };
        let (dimensions, types) = (self.bricks.dimensions, self.options.types);
        Hierarchy { dimensions, shape, planes, levels: Vec::new(), types, ranges: self.ranges.clone() }
    }

    /// Builds the nodes of a brick: a hierarchy over its samples alone, whose points know of what is around.
    ///
    /// # Errors
    /// [`Fault`] where samples or what is known of them cannot be read.
    pub fn brick(&self, brick: usize) -> Result<(Hierarchy, Root), FaultOf<F, S>> {
        let Bricks { dimensions: d, shape: samples } = self.bricks;
        let own = self.bricks.part(brick, 0);
        let last = self.bricks.levels().min(self.bricks.all_levels());
        let around = own.wider(AROUND, d, samples);
        let (values, holes) = self.rules.read(self.feed, &around).map_err(Fault::Feed)?;
        let planes: Vec<Means> = values.into_iter().map(|mean| Means { mean, ..Means::default() }).collect();
        let mut known = vec![Known { part: around, planes }];
        if last > 0 {
            known.push(self.first_level(brick, &known[0]));
        }
        let mut nodes = self.over(own.shape);
        let mut numbers: Vec<u32> = Vec::new();
        if !holes.is_empty() {
            numbers = (0..own.len()).map(|i| u32::from(!holes[around.index(own.place(i))])).collect();
        }
        let (mut variation, mut coefficients) = (Vec::new(), Vec::new());
        for level in 1..=last {
            let part = self.bricks.part(brick, level);
            if level >= FIRST {
                let part = part.wider(MARGIN, d, self.bricks.level_shape(level));
                known.push(Known { planes: self.read(level, &part)?, part });
            }
            let cells = &known[level - cell_levels(level)];
            let found = self.coefficients_of(level, &part)?;
            let mut made = self.level(level, &part, &known[level], cells, found.as_deref());
            coefficients.extend(found);
            if holes.is_empty() {
                made.samples = all_numbers(d, samples, level, &part);
            } else {
                let finer = if level == 1 { own.shape } else { self.bricks.part(brick, level - 1).shape };
                numbers = sums(d, finer, &numbers, part.shape);
                made.samples.clone_from(&numbers);
            }
            variation.extend(self.variation(&part, &known[level]));
            nodes.levels.push(made);
        }
        let (events, largest) = self.price(&mut nodes, &variation, &coefficients, (Vec::new(), Vec::new()));
        let single = if numbers.is_empty() { 1 } else { numbers[0] };
        let root = Root {
            samples: nodes.levels.last().map_or(single, |level| level.samples[0]),
            events,
            largest,
            within: nodes.points_within(nodes.good_enough(), None).pop().unwrap_or(1),
        };
        Ok((nodes, root))
    }

    /// Builds the nodes above all bricks, of which these are what is left, in order.
    ///
    /// # Errors
    /// [`Fault`] where what is known of nodes cannot be read.
    pub fn top(&self, roots: Vec<Root>) -> Result<Top, FaultOf<F, S>> {
        let Bricks { dimensions: d, shape: samples } = self.bricks;
        let mut nodes = self.over(self.bricks.counts());
        let mut numbers: Vec<u32> = roots.iter().map(|root| root.samples).collect();
        let total: f64 = numbers.iter().map(|n| f64::from(*n)).sum();
        let within: Vec<usize> = roots.iter().map(|root| root.within).collect();
        let (mut variation, mut coefficients) = (Vec::new(), Vec::new());
        let mut finer = nodes.shape;
        for level in self.bricks.levels() + 1..=self.bricks.all_levels() {
            let part = Part::whole(self.bricks.level_shape(level));
            let known = Known { part, planes: self.read(level, &part)? };
            let below = level - cell_levels(level);
            let cells_part = Part::whole(self.bricks.level_shape(below));
            let cells = Known { part: cells_part, planes: self.read(below, &cells_part)? };
            let found = self.coefficients_of(level, &part)?;
            let mut made = self.level(level, &part, &known, &cells, found.as_deref());
            coefficients.extend(found);
            if self.has_holes() {
                numbers = sums(d, finer, &numbers, part.shape);
                made.samples.clone_from(&numbers);
            } else {
                made.samples = all_numbers(d, samples, level, &part);
            }
            variation.extend(self.variation(&part, &known));
            nodes.levels.push(made);
            finer = part.shape;
        }
        if !nodes.levels.is_empty() {
            let largest = roots.iter().map(|root| root.largest).collect();
            let events = roots.into_iter().map(|root| root.events).collect();
            self.price(&mut nodes, &variation, &coefficients, (events, largest));
        }
        let points = nodes.points_within(nodes.good_enough(), Some(within)).pop().unwrap_or(0);
        let is_noise = total > 1.0 && (total - points as f64) < super::kinds::SPARES * total;
        Ok(Top { nodes, is_noise })
    }

    /// What is known of the nodes of level 1 around a brick, from the samples around it.
    fn first_level(&self, brick: usize, samples: &Known) -> Known {
        let Bricks { dimensions: d, shape } = self.bricks;
        let of = self.bricks.level_shape(1);
        let part = self.bricks.part(brick, 1).wider(MARGIN, d, of);
        let plane = |below: &Means| {
            let tent = tents(d, (&below.mean, &samples.part, shape), (&part, of), 2);
            Means { tent, ..means(d, shape, (0, shape), (below, &samples.part), &part) }
        };
        Known { planes: samples.planes.iter().map(plane).collect(), part }
    }

    /// What the coefficients of a level's nodes are, where there are any.
    fn coefficients_of(&self, level: usize, part: &Part) -> Result<Option<Vec<Found>>, FaultOf<F, S>> {
        self.coefficients.as_ref().map(|own| self.found(own, level, part)).transpose()
    }

    /// Finds the prices of nodes; events and the largest coefficient of the last one, from those of the nodes below, if any.
    fn price(
        &self,
        nodes: &mut Hierarchy,
        variation: &[Vec<f32>],
        coefficients: &[Vec<Found>],
        (events, largest): (Vec<Vec<Event>>, Vec<f32>),
    ) -> (Vec<Event>, f32) {
        if self.options.metric == Metric::Gabor {
            return (Vec::new(), prices_of_coefficients(nodes, coefficients, largest).pop().unwrap_or(0.0));
        }
        (prices(nodes, variation, events).pop().unwrap_or_default(), 0.0)
    }

    fn level(&self, level: usize, part: &Part, own: &Known, cells: &Known, found: Option<&[Found]>) -> Level {
        let proposed: Option<Vec<u8>> = match (self.options.types, found) {
            (Types::Gabor, Some(found)) => Some(found.iter().map(|found| found.set).collect()),
            _ => None,
        };
        let d = self.bricks.dimensions;
        let of = |level: usize| self.bricks.level_shape(level);
        let steps = cell_levels(level);
        let below = level - steps;
        let nodes = Nodes {
            dimensions: d,
            level,
            shapes: [self.bricks.shape, of(level - 1), of(level)],
            part: *part,
            own: (&own.planes, own.part),
            cells: Cells {
                dimensions: d,
                side: 1 << steps,
                of: of(below),
                part: cells.part,
                samples: (1_u64 << (below * d).min(60)) as f32,
                planes: &cells.planes,
                are_samples: below == 0,
            },
            weights: &self.weights,
            ranges: &self.ranges,
            types: self.options.types,
            proposed: proposed.as_deref(),
            table: &self.tables[steps - 1],
        };
        nodes.build()
    }

    /// The variation of a level's nodes, weighted over planes, where errors are that.
    fn variation(&self, part: &Part, known: &Known) -> Option<Vec<f32>> {
        if self.options.metric != Metric::Rms {
            return None;
        }
        let of = |i: usize| {
            let node = known.part.index(part.place(i));
            known.planes.iter().zip(&self.weights).map(|(means, w)| w * means.variation[node]).sum::<f32>()
        };
        Some((0..part.len()).into_par_iter().map(of).collect())
    }
}

/// The sums over children.
fn sums(dimensions: usize, finer: Shape, below: &[u32], shape: Shape) -> Vec<u32> {
    super::grid::for_each_place(shape, |at| {
        children(dimensions, finer, at).map(|child| below[child]).fold(0, u32::saturating_add)
    })
}

/// Prices by coefficients of directed filters (WM03 section 4.4): a price is the largest one that is not drawn. As printed, smooth nodes are
/// refined to their samples; here a node is drawn as soon as nothing below it is larger. Its large point shows no frequency of its own
/// octave, its directed set those of its direction and of the neighbours of that. The largest of the last level's nodes and below them.
fn prices_of_coefficients(hierarchy: &mut Hierarchy, found: &[Vec<Found>], mut below: Vec<f32>) -> Vec<f32> {
    let d = hierarchy.dimensions;
    let mut finer = hierarchy.shape;
    for (level, found) in hierarchy.levels.iter_mut().zip(found) {
        let all = super::grid::for_each_place(level.shape, |at| {
            let node = super::grid::index(level.shape, at);
            let Found { largest, other, .. } = found[node];
            let under = match below.is_empty() {
                true => 0.0,
                false => children(d, finer, at).map(|child| below[child]).fold(0.0, f32::max),
            };
            let all = largest.max(under);
            match (level.samples[node], level.set[node]) {
                (0, _) => (-1.0, -1.0, all),
                (1, _) => (0.0, 0.0, all),
                (_, super::sets::NONE) => (all, all, all),
                _ => (other.max(under), all, all),
            }
        });
        level.refine = all.iter().map(|prices| prices.0).collect();
        level.direct = all.iter().map(|prices| prices.1).collect();
        below = all.into_iter().map(|prices| prices.2).collect();
        finer = level.shape;
    }
    below
}
