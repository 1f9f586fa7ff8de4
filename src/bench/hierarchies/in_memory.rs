//! Simplifications of particles that no page file holds, for comparison: octree cells, and the paper's own clusters (HE03).

use crate::hierarchy::pca::{Members, SplitRule, members::trace, split};
use crate::model::{Covariance, Kernel};
use crate::store::Metadata;
use crate::stream::SceneNode;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// A round splat.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Splat {
    /// Where it is.
    pub place: [f64; 3],
    /// Its mass.
    pub mass: f64,
    /// Smoothing length `h`, the support radius.
    pub smoothing_length: f64,
}

/// The particles of leaves.
pub fn splats(nodes: &[SceneNode], metadata: &Metadata) -> Vec<Splat> {
    let mut splats = Vec::new();
    for drawn in nodes {
        let index = drawn.node.node as usize;
        let (Some(node), Some(family)) =
            (drawn.page.nodes.get(index), metadata.families.get(drawn.page.family as usize))
        else {
            continue;
        };
        let Some(book) = family.codebooks.get(usize::from(node.codebook)) else { continue };
        let particles = drawn.page.particles(index);
        splats.extend((0..particles.len()).map(|i| {
            let code = usize::from(particles.codes[i]);
            Splat {
                place: node.frame.position(particles.fraction(i)).to_array(),
                mass: f64::from(node.mass_scale * book.mass[code]),
                smoothing_length: f64::from(book.smoothing_length[code]),
            }
        }));
    }
    splats
}

/// A cell of an octree over some of the particles.
struct Cell {
    members: Vec<u32>,
    middle: [f64; 3],
    half: f64,
    priority: f64,
}

impl PartialEq for Cell {
    fn eq(&self, other: &Cell) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Cell {}

impl PartialOrd for Cell {
    fn partial_cmp(&self, other: &Cell) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Cell {
    fn cmp(&self, other: &Cell) -> Ordering {
        let place = |cell: &Cell| cell.members.first().copied();
        self.priority.total_cmp(&other.priority).then(place(other).cmp(&place(self)))
    }
}

fn members_of(splats: &[Splat], kernel_variance: f64) -> Members {
    let mut members = Members::default();
    for splat in splats {
        let h = splat.smoothing_length;
        members.push_particle(splat.place, splat.mass, 1.0, (h, kernel_variance * h * h));
    }
    members
}

/// At most `most` octree cells, those split first whose members' spread shows most, each as a round splat of equal spread.
pub fn in_cells(splats: &[Splat], most: usize) -> Vec<Splat> {
    // Kernels are alike in this but for a factor that cancels out.
    let members = members_of(splats, 1.0);
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for splat in splats {
        for k in 0..3 {
            low[k] = low[k].min(splat.place[k]);
            high[k] = high[k].max(splat.place[k]);
        }
    }
    let half = (0..3).map(|k| 0.5 * (high[k] - low[k])).fold(0.0, f64::max) * (1.0 + 1e-9);
    let cell = |own: Vec<u32>, middle: [f64; 3], half: f64, members: &Members| {
        let sum = members.sum(own.iter().copied());
        let kernels: f64 =
            own.iter().map(|&i| members.mass[i as usize] * trace(&members.moments[i as usize])).sum::<f64>() / sum.mass;
        // `Sum` has kernels of `h^2` for their variance; this is what is spread between them.
        let spread = (trace(&sum.moments) - kernels).max(0.0);
        let priority = if own.len() > 1 { sum.mass * spread / (VARIANCE * kernels + spread) } else { 0.0 };
        Cell { members: own, middle, half, priority }
    };
    let middle = std::array::from_fn(|k| 0.5 * (low[k] + high[k]));
    let mut cells = BinaryHeap::new();
    if !splats.is_empty() {
        cells.push(cell((0..splats.len() as u32).collect(), middle, half, &members));
    }
    let mut done = Vec::new();
    while let Some(top) = cells.pop() {
        if top.priority <= 0.0 {
            done.push(top);
            continue;
        }
        let mut octants: [Vec<u32>; 8] = Default::default();
        for &i in &top.members {
            let at = splats[i as usize].place;
            let octant: usize = (0..3).map(|k| usize::from(at[k] >= top.middle[k]) << k).sum();
            octants[octant].push(i);
        }
        let more = octants.iter().filter(|own| !own.is_empty()).count() - 1;
        if cells.len() + done.len() + 1 + more > most {
            done.push(top);
            break;
        }
        for (octant, own) in octants.into_iter().enumerate().filter(|(_, own)| !own.is_empty()) {
            let half = 0.5 * top.half;
            let middle = std::array::from_fn(|k| top.middle[k] + if octant >> k & 1 == 1 { half } else { -half });
            cells.push(cell(own, middle, half, &members));
        }
    }
    let one = |cell: &Cell| {
        let sum = members.sum(cell.members.iter().copied());
        let kernels: f64 =
            cell.members.iter().map(|&i| members.mass[i as usize] * trace(&members.moments[i as usize])).sum::<f64>()
                / sum.mass;
        let spread = (trace(&sum.moments) - kernels).max(0.0);
        // The smoothing length of equal spread: `h^2 v = (kernels v + spread) / 3`, with kernels of three times `h^2`.
        let h = ((kernels + spread / VARIANCE) / 3.0).sqrt();
        Splat { place: sum.place, mass: sum.mass, smoothing_length: h }
    };
    done.iter().chain(&cells).map(one).collect()
}

/// Variance of the cubic spline with `h` = 1 along an axis, which the comparison takes for any kernel.
const VARIANCE: f64 = 0.075;

/// The paper's own clusters: splits by distortion, centroids, and sizes by its equation 2.
pub fn published(splats: &[Splat], most: usize, kernel: Kernel) -> Vec<Splat> {
    let members = members_of(splats, kernel.variance());
    let splitting = split(&members, SplitRule::Distortion, most);
    let clusters = members.merged(&splitting, &[]);
    let one = |i: usize| Splat {
        place: clusters.places[i],
        mass: clusters.mass[i],
        smoothing_length: 0.5 * clusters.diameters[i],
    };
    (0..clusters.len()).map(one).collect()
}

/// Clusters of a tree that no octree cuts: splits of all particles by what shows most, each cluster an ellipsoid with its second moments.
pub fn free(splats: &[Splat], most: usize, kernel: Kernel) -> (Vec<Splat>, Vec<Covariance>) {
    let members = members_of(splats, kernel.variance());
    let splitting = split(&members, SplitRule::Relative, most);
    let clusters = members.merged(&splitting, &[]);
    let one = |i: usize| {
        let h = (trace(&clusters.moments[i]) / 3.0 / kernel.variance()).sqrt();
        let splat = Splat { place: clusters.places[i], mass: clusters.mass[i], smoothing_length: h };
        (splat, Covariance(clusters.moments[i].map(|moment| moment as f32)))
    };
    (0..clusters.len()).map(one).unzip()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn some(count: usize) -> Vec<Splat> {
        let at = |i: usize, k: usize| ((i * (2 * k + 3)) as f64 * 0.618_033_988_7).fract();
        (0..count)
            .map(|i| Splat {
                place: [at(i, 0), at(i, 1), at(i, 2)],
                mass: 1.0 + (i % 3) as f64,
                smoothing_length: 0.02,
            })
            .collect()
    }

    #[test]
    fn simplifications_keep_mass_and_numbers() {
        let splats = some(2000);
        let mass: f64 = splats.iter().map(|splat| splat.mass).sum();
        let kernel = Kernel::CubicSpline;
        for few in [in_cells(&splats, 100), published(&splats, 100, kernel), free(&splats, 100, kernel).0] {
            assert!(few.len() <= 100 && few.len() > 80, "{}", few.len());
            assert!((few.iter().map(|splat| splat.mass).sum::<f64>() / mass - 1.0).abs() < 1e-12);
            assert!(few.iter().all(|splat| splat.smoothing_length >= 0.02));
        }
        for all in [in_cells(&splats, 4000), published(&splats, 4000, kernel), free(&splats, 4000, kernel).0] {
            assert_eq!(all.len(), splats.len());
            assert!(all.iter().all(|splat| (splat.smoothing_length / 0.02 - 1.0).abs() < 1e-9));
        }
    }
}
