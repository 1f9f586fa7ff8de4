//! What a build keeps of every node of the levels above the finest, until the bricks that need it are built: on a shelf, in memory or in
//! a file. Which of the two changes nothing.

use super::bricks::{Bricks, Part};
use super::grid::{Shape, index, volume};
use std::convert::Infallible;
use std::sync::atomic::{AtomicU32, Ordering};

/// A place for a fixed number of singles, written and read by several threads.
pub trait Shelf: Sync {
    /// Why it cannot be written or read.
    type Error: Send;

    /// Fills `out` from the number `at` on.
    ///
    /// # Errors
    /// Where they cannot be read.
    fn read(&self, at: u64, out: &mut [f32]) -> Result<(), Self::Error>;

    /// Puts `values` from the number `at` on.
    ///
    /// # Errors
    /// Where they cannot be written.
    fn write(&self, at: u64, values: &[f32]) -> Result<(), Self::Error>;
}

/// A shelf in memory.
#[derive(Debug, Default)]
pub struct InMemory(Vec<AtomicU32>);

impl InMemory {
    /// One of so many zeros.
    pub fn new(count: u64) -> InMemory {
        InMemory((0..count).map(|_| AtomicU32::new(0)).collect())
    }
}

impl Shelf for InMemory {
    type Error = Infallible;

    fn read(&self, at: u64, out: &mut [f32]) -> Result<(), Infallible> {
        let from = self.0.get(at as usize..).unwrap_or_default();
        out.iter_mut().zip(from).for_each(|(out, v)| *out = f32::from_bits(v.load(Ordering::Relaxed)));
        Ok(())
    }

    fn write(&self, at: u64, values: &[f32]) -> Result<(), Infallible> {
        let to = self.0.get(at as usize..).unwrap_or_default();
        to.iter().zip(values).for_each(|(to, v)| to.store(v.to_bits(), Ordering::Relaxed));
        Ok(())
    }
}

/// Some numbers of every node of the levels from one on.
#[derive(Clone, Debug)]
pub(super) struct Fields {
    /// Of each level from 0 on: its shape, and where its numbers begin.
    levels: Vec<(Shape, u64)>,
    /// Numbers of a node.
    pub width: usize,
    /// The number after the last.
    pub end: u64,
}

impl Fields {
    /// So many numbers of every node of the levels from `first` on, from the place `start` of a shelf on.
    pub fn new(bricks: Bricks, first: usize, width: usize, start: u64) -> Fields {
        let mut end = start;
        let levels = (0..=bricks.all_levels())
            .map(|level| {
                let (of, own) = (bricks.level_shape(level), end);
                if level >= first {
                    end += volume(of) as u64 * width as u64;
                }
                (of, own)
            })
            .collect();
        Fields { levels, width, end }
    }

    /// The rows of a box: of each where it begins on the shelf.
    fn rows(&self, level: usize, part: &Part) -> impl Iterator<Item = u64> {
        let (of, start) = self.levels[level];
        let (part, width, end) = (*part, self.width as u64, part.end());
        (part.min[2]..end[2]).flat_map(move |z| {
            (part.min[1]..end[1]).map(move |y| start + index(of, [part.min[0], y, z]) as u64 * width)
        })
    }

    /// The numbers of the nodes in a box, those of a node side by side.
    pub fn read<S: Shelf>(&self, shelf: &S, level: usize, part: &Part) -> Result<Vec<f32>, S::Error> {
        let row = part.shape[0] * self.width;
        let mut values = vec![0.0; part.len() * self.width];
        for (row, at) in values.chunks_mut(row.max(1)).zip(self.rows(level, part)) {
            shelf.read(at, row)?;
        }
        Ok(values)
    }

    /// Puts the numbers of the nodes in a box.
    pub fn write<S: Shelf>(&self, shelf: &S, level: usize, part: &Part, values: &[f32]) -> Result<(), S::Error> {
        let row = part.shape[0] * self.width;
        for (row, at) in values.chunks(row.max(1)).zip(self.rows(level, part)) {
            shelf.write(at, row)?;
        }
        Ok(())
    }
}
