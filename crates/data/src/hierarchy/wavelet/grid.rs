//! Samples on a regular grid, as the hierarchy takes them: planes of numbers and how much each counts.

use rayon::prelude::*;

/// Numbers of samples, nodes or places, x first; z is 1 (places: 0) in 2D.
pub type Shape = [usize; 3];

/// Samples of an image or volume: one plane a channel, x fastest.
#[derive(Clone, Debug)]
pub struct Samples<'a> {
    /// Number of dimensions, 2 or 3.
    pub dimensions: usize,
    /// Number of samples along each axis.
    pub shape: Shape,
    /// The channels' values. NaN is transparent.
    pub channels: Vec<&'a [f32]>,
}

impl Samples<'_> {
    /// Number of samples of a channel.
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0 || self.channels.is_empty()
    }
}

/// Number of places in a shape.
pub(super) fn volume(shape: Shape) -> usize {
    shape.iter().product()
}

/// How many children a node has along each axis.
pub(super) fn factors(dimensions: usize) -> Shape {
    if dimensions == 2 { [2, 2, 1] } else { [2, 2, 2] }
}

/// The place of an index.
#[inline]
pub(super) fn place(shape: Shape, index: usize) -> Shape {
    [index % shape[0], index / shape[0] % shape[1], index / (shape[0] * shape[1])]
}

/// The index of a place.
#[inline]
pub(super) fn index(shape: Shape, at: Shape) -> usize {
    (at[2] * shape[1] + at[1]) * shape[0] + at[0]
}

/// The children of a node that exist, by their places at the finer level.
#[inline]
pub(super) fn children_in(dimensions: usize, finer: Shape, at: Shape) -> impl Iterator<Item = Shape> {
    let by = factors(dimensions);
    let first: Shape = std::array::from_fn(|k| at[k] * by[k]);
    let end: Shape = std::array::from_fn(|k| (first[k] + by[k]).min(finer[k]));
    (first[2]..end[2])
        .flat_map(move |z| (first[1]..end[1]).flat_map(move |y| (first[0]..end[0]).map(move |x| [x, y, z])))
}

/// The same by their indices.
#[inline]
pub(super) fn children(dimensions: usize, finer: Shape, at: Shape) -> impl Iterator<Item = usize> {
    children_in(dimensions, finer, at).map(move |child| index(finer, child))
}

/// Computes something for every place, in order, rows in parallel.
pub(super) fn for_each_place<T: Send>(shape: Shape, compute: impl Fn(Shape) -> T + Sync) -> Vec<T> {
    for_each_place_with(shape, || (), |(), at| compute(at))
}

/// The same with something that is made once for many places.
pub(super) fn for_each_place_with<T: Send, W>(
    shape: Shape,
    make: impl Fn() -> W + Sync,
    compute: impl Fn(&mut W, Shape) -> T + Sync,
) -> Vec<T> {
    let row = shape[0].max(1);
    let rows = shape[1] * shape[2];
    // Short rows together: the result is the same.
    let together = (2048 / row).max(1);
    let parts: Vec<Vec<T>> = (0..rows.div_ceil(together))
        .into_par_iter()
        .map(|part| {
            let rows = part * together..((part + 1) * together).min(rows);
            let mut values = Vec::with_capacity(rows.len() * row);
            let mut with = make();
            for r in rows {
                values.extend((0..shape[0]).map(|x| compute(&mut with, [x, r % shape[1], r / shape[1]])));
            }
            values
        })
        .collect();
    let mut all = Vec::with_capacity(volume(shape));
    parts.into_iter().for_each(|part| all.extend(part));
    all
}
