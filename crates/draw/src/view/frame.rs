//! What the first picture of a dataset shows: all of it, unless a few far outliers would make the rest tiny, and kernels that are
//! wider than what they are around.

use crate::model::Bounds;
use glam::DVec3;

/// Share of the weight that may lie outside the frame at each end of each axis.
const TAIL: f64 = 0.02;
/// The whole box is framed while it is at most this many times as large as the box between the quantiles. A ball, a
/// box and a bell-shaped cloud stay below 3.
const STRETCH: f64 = 6.0;
/// The frame goes beyond the quantiles by this share of their distance at each end.
const MARGIN: f64 = 0.1;

/// The box to look at: `full`, or where that is stretched by outliers, the box between the weighted 2 % and 98 %
/// quantiles of `samples` (position, weight) along each axis with a margin, inside `full`.
pub fn frame(full: Bounds, samples: &[(DVec3, f64)]) -> Bounds {
    let mut core = full;
    for axis in 0..3 {
        let Some([low, high]) = quantiles(samples.iter().map(|(position, weight)| (position[axis], *weight))) else {
            return full;
        };
        let margin = MARGIN * (high - low);
        core.min[axis] = (low - margin).max(full.min[axis]);
        core.max[axis] = (high + margin).min(full.max[axis]);
    }
    let (core_extent, full_extent) = (core.size().max_element(), full.size().max_element());
    // Where all but a few particles coincide there is nothing to look at between the quantiles.
    let stretched = full_extent > STRETCH * core_extent && core_extent > 1e-9 * full_extent;
    if stretched { core } else { full }
}

/// A framed box that is narrower than every kernel in it, as that of a single particle is, grown by the widest: a camera at the
/// distance that fits the box alone would stand inside of them all. `reach` is the least and the largest smoothing length.
pub fn with_kernels(framed: Bounds, reach: [f64; 2]) -> Bounds {
    let [least, most] = reach;
    if framed.is_empty() || most <= 0.0 || framed.size().max_element() >= least {
        return framed;
    }
    Bounds { min: framed.min - most, max: framed.max + most }
}

/// The weighted quantiles `TAIL` and `1 - TAIL`; `None` without weight.
fn quantiles(values: impl Iterator<Item = (f64, f64)>) -> Option<[f64; 2]> {
    let mut values: Vec<(f64, f64)> = values.filter(|(value, weight)| value.is_finite() && *weight > 0.0).collect();
    values.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = values.iter().map(|value| value.1).sum();
    let (mut below, mut low) = (0.0, None);
    for &(value, weight) in &values {
        below += weight;
        if low.is_none() && below > TAIL * total {
            low = Some(value);
        }
        if below >= (1.0 - TAIL) * total {
            return Some([low?, value]);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A lattice of 20^3 points in the unit cube.
    fn lattice() -> Vec<(DVec3, f64)> {
        let at = |i: u32| f64::from(i) / 19.0;
        (0..8000).map(|i| (DVec3::new(at(i % 20), at(i / 20 % 20), at(i / 400)), 1.0)).collect()
    }

    fn box_of(samples: &[(DVec3, f64)]) -> Bounds {
        Bounds::of(samples.iter().map(|(position, _)| position.to_array()))
    }

    #[test]
    fn without_outliers_the_whole_box_is_framed() {
        let mut samples = lattice();
        assert_eq!(frame(box_of(&samples), &samples), box_of(&samples));
        // Long tails belong to the data.
        samples.push((DVec3::splat(4.0), 1.0));
        assert_eq!(frame(box_of(&samples), &samples), box_of(&samples));
    }

    #[test]
    fn outliers_are_left_out() {
        let mut samples = lattice();
        let clean = box_of(&samples);
        for far in [1e3, -4e5, 7e4] {
            samples.push((DVec3::new(far, 0.5, -far), 1.0));
        }
        let framed = frame(box_of(&samples), &samples);
        assert!((framed.min - clean.min).abs().max_element() < 0.2, "{framed:?}");
        assert!((framed.max - clean.max).abs().max_element() < 0.2, "{framed:?}");
        // A merged particle counts as many times as it has sources.
        samples.iter_mut().rev().take(3).for_each(|sample| sample.1 = 200.0);
        assert_eq!(frame(box_of(&samples), &samples), box_of(&samples));
    }

    #[test]
    fn nothing_and_coinciding_points_keep_their_box() {
        let point = Bounds { min: DVec3::ONE, max: DVec3::ONE };
        assert_eq!(frame(point, &[]), point);
        assert_eq!(frame(point, &[(DVec3::ONE, 1.0)]), point);
        let mut samples = vec![(DVec3::ONE, 1.0); 1000];
        samples.push((DVec3::splat(9.0), 1.0));
        assert_eq!(frame(box_of(&samples), &samples), box_of(&samples));
    }
    #[test]
    fn a_box_inside_of_every_kernel_is_grown_to_them() {
        let point = Bounds { min: DVec3::ONE, max: DVec3::ONE };
        let grown = with_kernels(point, [0.2, 0.5]);
        assert_eq!((grown.min, grown.max), (DVec3::splat(0.5), DVec3::splat(1.5)));
        let cube = Bounds { min: DVec3::ZERO, max: DVec3::ONE };
        for unchanged in [[0.2, 30.0], [f64::INFINITY, 0.0]] {
            assert_eq!(with_kernels(cube, unchanged), cube);
        }
        assert_eq!(with_kernels(Bounds::EMPTY, [1.0, 1.0]), Bounds::EMPTY);
    }
}
