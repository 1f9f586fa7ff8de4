//! Isosurfaces along a ray: where it crosses them, which way they face, and how they are lit.

use super::block::{Block, Numbers, Place, SIDE};
use super::bricks::BrickGrid;

/// One isosurface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// The density on it, or the value of another field as a number.
    pub value: f32,
    /// Its colour, linear light; `None` follows the attribute.
    pub color: Option<[f32; 3]>,
    /// Its opacity, within [0, 1].
    pub opacity: f32,
}

/// A lamp at the eye, with the reflection model of Blinn and Phong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Share of the colour that is there without light.
    pub ambient: f32,
    /// Strength of the highlight.
    pub specular: f32,
    /// Its exponent.
    pub shininess: f32,
}

impl Light {
    /// A colour as it is seen where the ray meets the surface at this cosine. Surfaces are lit on both sides.
    pub fn shade(&self, color: [f32; 3], cosine: f32) -> [f32; 3] {
        let cosine = cosine.abs().min(1.0);
        // The lamp being at the eye, the half-way vector points to the eye too.
        let highlight = self.specular * cosine.powf(self.shininess);
        color.map(|c| c * (self.ambient + (1.0 - self.ambient) * cosine) + highlight)
    }
}

/// Where a ray crosses a surface within a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Share of the step.
    pub at: f32,
    /// Which surface.
    pub surface: usize,
}

/// Most surfaces at once.
pub const MOST_SURFACES: usize = 8;

/// The crossings of one step, in order.
#[derive(Clone, Copy, Debug)]
pub struct Crossings {
    found: [Crossing; MOST_SURFACES],
    count: usize,
}

impl Crossings {
    /// Where the step from the second to the third of four successive samples crosses `surfaces`: one crossing at most for each,
    /// where the field between the samples goes through its value. Refined on the cubic through the four samples' tangents.
    pub fn find(samples: [f32; 4], surfaces: &[Surface]) -> Crossings {
        let [_, from, to, _] = samples;
        let mut crossings = Crossings { found: [Crossing { at: 0.0, surface: 0 }; MOST_SURFACES], count: 0 };
        for (index, surface) in surfaces.iter().take(MOST_SURFACES).enumerate() {
            if (from < surface.value) != (to < surface.value) {
                crossings.found[crossings.count] = Crossing { at: refine(samples, surface.value), surface: index };
                crossings.count += 1;
            }
        }
        crossings.found[..crossings.count].sort_by(|a, b| a.at.total_cmp(&b.at));
        crossings
    }

    /// The crossings, the nearest first.
    pub fn iter(&self) -> impl Iterator<Item = &Crossing> {
        self.found[..self.count].iter()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }
}

/// Where the cubic with the samples' central differences as tangents has a value between the second and third sample; the
/// field goes through it there.
fn refine([before, from, to, after]: [f32; 4], value: f32) -> f32 {
    let (start, end) = (0.5 * (to - before), 0.5 * (after - from));
    let cubic = |t: f32| {
        let [t2, t3] = [t * t, t * t * t];
        (2.0 * t3 - 3.0 * t2 + 1.0) * from + (t3 - 2.0 * t2 + t) * start + (3.0 * t2 - 2.0 * t3) * to + (t3 - t2) * end
            - value
    };
    let (mut low, mut high) = (0.0, 1.0);
    let (mut at_low, mut at_high) = (from - value, to - value);
    // False position, with the bisection's guarantee: the sign changes between the ends.
    for round in 0..6 {
        let middle = match round % 3 {
            2 => 0.5 * (low + high),
            _ => (low + (high - low) * at_low / (at_low - at_high)).clamp(low, high),
        };
        let at_middle = cubic(middle);
        if (at_middle < 0.0) == (at_low < 0.0) {
            (low, at_low) = (middle, at_middle);
        } else {
            (high, at_high) = (middle, at_middle);
        }
    }
    let at = low + (high - low) * at_low / (at_low - at_high);
    if at.is_finite() { at.clamp(0.0, 1.0) } else { 0.5 * (low + high) }
}

/// The gradient of the density, or of other numbers, in camera axes, at a share `at` of the step into slice `slice` of the grid, which is slice `z`
/// of the block (F12 5.6). `middle` is the distance of the ray from the middle line of sight, in cells.
///
/// Differences are taken between neighbours in the grid and brought to camera space by the chain rule, with
/// `x' = x / (sigma z)` and `z' = s_z^-1(z)`: `df/dx = f_x' / (sigma z)` and `df/dz = f_z' / s_z' - (x' f_x' + y' f_y') / z`.
/// To second order that is the difference between the points `(x, y, z +- delta)` of F12, and stays inside the neighbouring
/// cells at any field of view. Where there is nothing on one side, the difference is that to the other.
pub fn gradient(
    (block, of): (&Block, Numbers),
    brick_grid: &BrickGrid,
    place: &Place,
    middle: [f32; 2],
    slice: usize,
    z: usize,
    at: f32,
) -> [f32; 3] {
    let here = |place: &Place| {
        let [from, to] = [block.known(of, place, z - 1)?, block.known(of, place, z)?];
        Some(from + at * (to - from))
    };
    let moved = |dx: usize, dy: usize| Place { x: place.x + dx - 1, y: place.y + dy - 1, ..*place };
    let across = |low: Place, high: Place| match (here(&low), here(&high)) {
        (Some(low), Some(high)) => 0.5 * (high - low),
        (Some(low), None) => here(place).map_or(0.0, |middle| middle - low),
        (None, Some(high)) => here(place).map_or(0.0, |middle| high - middle),
        (None, None) => 0.0,
    };
    let along_x = across(moved(0, 1), moved(2, 1));
    let along_y = across(moved(1, 0), moved(1, 2));
    let [before, from, to] = [2, 1, 0].map(|back| block.known(of, place, z - back));
    let after = block.known(of, place, (z + 1).min(SIDE - 1));
    let last = brick_grid.slices - 1;
    let depth = |slice: usize| brick_grid.depth[slice.min(last)];
    // Differences at both ends of the step, weighted by where the crossing is.
    let differ = |low: f32, high: f32, from: usize, to: usize| match depth(to) - depth(from) {
        distance if distance > 0.0 => (high - low) / distance,
        _ => 0.0,
    };
    let within = || match (from, to) {
        (Some(from), Some(to)) => differ(from, to, slice.saturating_sub(1), slice),
        _ => 0.0,
    };
    let start = match (before, to) {
        (Some(before), Some(to)) => differ(before, to, slice.saturating_sub(2), slice),
        _ => within(),
    };
    let end = match (from, after) {
        (Some(from), Some(after)) => differ(from, after, slice.saturating_sub(1), slice + 1),
        _ => within(),
    };
    let along_z = start + at * (end - start);
    let z_here = depth(slice.saturating_sub(1)) + at * (depth(slice) - depth(slice.saturating_sub(1)));
    let spacing = {
        let [a, b] = [slice.saturating_sub(1), slice].map(|slice| brick_grid.spacing[slice.min(last)]);
        a + at * (b - a)
    };
    let shear = if brick_grid.perspective { (middle[0] * along_x + middle[1] * along_y) / z_here } else { 0.0 };
    // Rows go down, `y` goes up.
    [along_x / spacing, -along_y / spacing, along_z - shear]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crossings_are_refined_and_in_order() {
        let surface = |value| Surface { value, color: None, opacity: 1.0 };
        // A parabola: the straight line between samples would be off by up to an eighth.
        let field = |x: f32| (x + 2.0) * (x + 2.0);
        let samples = [-1.0, 0.0, 1.0, 2.0].map(field);
        let surfaces = [surface(8.0), surface(5.0), surface(20.0)];
        let crossings = Crossings::find(samples, &surfaces);
        let found: Vec<(usize, f32)> = crossings.iter().map(|crossing| (crossing.surface, crossing.at)).collect();
        assert_eq!(found.iter().map(|crossing| crossing.0).collect::<Vec<_>>(), [1, 0]);
        for (index, at) in found {
            let expected = surfaces[index].value.sqrt() - 2.0;
            assert!((at - expected).abs() < 1e-4, "{at} {expected}");
        }
        assert!(Crossings::find([1.0; 4], &surfaces).is_empty());
        let steep = Crossings::find([0.0, 0.0, 1e30, 1e30], &[surface(1.0)]);
        assert!(steep.iter().all(|crossing| (0.0..=1.0).contains(&crossing.at)));
    }

    #[test]
    fn light_comes_from_the_eye_and_reaches_both_sides() {
        let light = Light { ambient: 0.2, specular: 0.0, shininess: 10.0 };
        assert_eq!(light.shade([1.0, 0.5, 0.0], -1.0), light.shade([1.0, 0.5, 0.0], 1.0));
        let grazing = light.shade([1.0, 0.5, 0.0], 0.0);
        assert!((grazing[0] - 0.2).abs() < 1e-6 && (grazing[1] - 0.1).abs() < 1e-6);
    }
}
