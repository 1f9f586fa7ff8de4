//! Where the samples of a hierarchy come from: boxes of them, as often as they are needed.

use super::bricks::Part;
use super::grid::{Samples, Shape};
use std::convert::Infallible;

/// Samples that are read in boxes by several threads.
pub trait Feed: Sync {
    /// Why they cannot be read.
    type Error: Send;

    /// Number of dimensions, 2 or 3.
    fn dimensions(&self) -> usize;

    /// Number of samples along each axis.
    fn shape(&self) -> Shape;

    /// Number of channels.
    fn channels(&self) -> usize;

    /// Whether samples may be no numbers.
    fn may_have_holes(&self) -> bool {
        true
    }

    /// The channels' values in a box of the grid, x fastest.
    ///
    /// # Errors
    /// Where they cannot be read.
    fn read(&self, part: &Part) -> Result<Vec<Vec<f32>>, Self::Error>;
}

impl Feed for Samples<'_> {
    type Error = Infallible;

    fn dimensions(&self) -> usize {
        self.dimensions
    }

    fn shape(&self) -> Shape {
        self.shape
    }

    fn channels(&self) -> usize {
        self.channels.len()
    }

    fn read(&self, part: &Part) -> Result<Vec<Vec<f32>>, Infallible> {
        let end = part.end();
        let of = |channel: &&[f32]| {
            let mut values = Vec::with_capacity(part.len());
            for z in part.min[2]..end[2] {
                for y in part.min[1]..end[1] {
                    let row = super::grid::index(self.shape, [0, y, z]);
                    values.extend_from_slice(&channel[row + part.min[0]..row + end[0]]);
                }
            }
            values
        };
        Ok(self.channels.iter().map(of).collect())
    }
}
