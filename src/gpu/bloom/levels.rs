//! The levels that bloom's passes take light through, as their shaders read them.

use crate::color::bloom::{Axis, Bloom};
use crate::color::composite::MOST_LIGHT;
use bytemuck::{Pod, Zeroable};

/// WGSL `Bloom`: a level, the picture for the first, and the next coarser one.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct LevelUniform {
    /// Size of the level, pixels.
    pub fine: [u32; 2],
    /// Size of the next coarser one.
    pub coarse: [u32; 2],
    /// Where the coarser level's columns and rows begin among [`Levels::givers`].
    pub givers: [u32; 2],
    /// Where the level's columns and rows begin among [`Levels::takers`].
    pub takers: [u32; 2],
    /// Where the level's pixels begin among the planes.
    pub fine_start: u32,
    /// Where the coarser level's do.
    pub coarse_start: u32,
    /// 1: the level is the picture itself, which is no plane.
    pub is_picture: u32,
    /// Share of the level's own light in what spreads.
    pub own: f32,
    /// The same of the coarser level's.
    pub coarser: f32,
    /// [`Bloom::strength`].
    pub strength: f32,
    /// [`Bloom::threshold`].
    pub threshold: f32,
    /// [`MOST_LIGHT`].
    pub most_light: f32,
}

/// WGSL `Givers`: finer columns or rows that give light to a coarser one.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Givers {
    /// Which.
    pub pixels: [u32; 4],
    /// What part of the coarser one's light is theirs.
    pub weights: [f32; 4],
}

/// WGSL `Takers`: coarser columns or rows that a finer one takes light from.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Takers {
    /// Which.
    pub pixels: [u32; 2],
    /// Their weights.
    pub weights: [f32; 2],
}

/// All levels of a picture.
#[derive(Debug, Default)]
pub struct Levels {
    /// Each level that is not the coarsest, from the picture on; one at least.
    pub uniforms: Vec<LevelUniform>,
    /// For the columns and rows of each level but the picture.
    pub givers: Vec<Givers>,
    /// For the columns and rows of each level but the coarsest.
    pub takers: Vec<Takers>,
    /// Pixels of all levels but the picture.
    pub pixels: u32,
}

impl Levels {
    /// Those of a flat picture of this width and height, pixels.
    pub fn new(size: [u32; 2], bloom: &Bloom) -> Levels {
        let pyramid = bloom.pyramid(size.map(|pixels| pixels as usize), false);
        let mut levels = Levels::default();
        let mut fine = size;
        let mut fine_start = 0;
        for (index, axes) in pyramid.axes.iter().enumerate() {
            let coarse = axes.each_ref().map(|axis| axis.sizes.len() as u32);
            let coarse_start = levels.pixels;
            levels.uniforms.push(LevelUniform {
                fine,
                coarse,
                givers: axes.each_ref().map(|axis| added(&mut levels.givers, givers(axis))),
                takers: axes.each_ref().map(|axis| added(&mut levels.takers, takers(axis))),
                fine_start,
                coarse_start,
                is_picture: u32::from(index == 0),
                own: if index > 0 { pyramid.shares[index - 1] } else { 0.0 },
                // Others have been weighed on the way back when it comes to them.
                coarser: if index + 1 == pyramid.axes.len() { pyramid.shares[index] } else { 1.0 },
                strength: bloom.strength as f32,
                threshold: bloom.threshold as f32,
                most_light: MOST_LIGHT,
            });
            levels.pixels += coarse[0] * coarse[1];
            (fine, fine_start) = (coarse, coarse_start);
        }
        levels
    }
}

/// Adds to a list, and says where what was added begins.
fn added<T>(list: &mut Vec<T>, more: impl Iterator<Item = T>) -> u32 {
    let start = list.len() as u32;
    list.extend(more);
    start
}

/// What gives light to each coarse pixel along an axis.
fn givers(axis: &Axis) -> impl Iterator<Item = Givers> {
    axis.from.iter().zip(&axis.sizes).map(|(from, size)| {
        // What is not there weighs nothing.
        let at = |index: usize| from.get(index).map_or((from[0].0, 0.0), |(pixel, weight)| (*pixel, weight / size));
        let all: [(usize, f32); 4] = std::array::from_fn(at);
        Givers { pixels: all.map(|(pixel, _)| pixel as u32), weights: all.map(|(_, weight)| weight) }
    })
}

/// What each fine pixel along an axis takes light from.
fn takers(axis: &Axis) -> impl Iterator<Item = Takers> {
    let taker = |around: &[(usize, f32); 2]| Takers {
        pixels: around.map(|(pixel, _)| pixel as u32),
        weights: around.map(|(_, weight)| weight),
    };
    axis.around.iter().map(taker)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_level_gives_all_of_its_light_and_takes_all_back() {
        let bloom = Bloom { radius: 1.0, ..Bloom::default() };
        for size in [[1, 1], [61, 37], [2, 50], [640, 3]] {
            let levels = Levels::new(size, &bloom);
            assert!(levels.givers.iter().all(|from| (from.weights.iter().sum::<f32>() - 1.0).abs() < 1e-5));
            assert!(levels.takers.iter().all(|around| around.weights.iter().sum::<f32>() == 1.0));
            let mut next = 0;
            for (index, level) in levels.uniforms.iter().enumerate() {
                assert_eq!((level.coarse_start, level.is_picture), (next, u32::from(index == 0)));
                next += level.coarse[0] * level.coarse[1];
                for axis in [0, 1] {
                    let givers = &levels.givers[level.givers[axis] as usize..][..level.coarse[axis] as usize];
                    assert!(givers.iter().flat_map(|from| from.pixels).all(|pixel| pixel < level.fine[axis]));
                    let takers = &levels.takers[level.takers[axis] as usize..][..level.fine[axis] as usize];
                    assert!(takers.iter().flat_map(|around| around.pixels).all(|pixel| pixel < level.coarse[axis]));
                }
            }
            assert_eq!(levels.pixels, next);
        }
    }
}
