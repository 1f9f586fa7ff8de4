//! Reading the nodes of a file of a grid, brick by brick or all.

use super::super::error::StoreError;
use super::super::page::PageId;
use super::columns::{Columns, value_code};
use super::{GridAbout, GridFile};
use crate::hierarchy::wavelet::{Bricks, Hierarchy, Level, Part, Planes, Samples};
use rayon::prelude::*;

/// Nodes of a level, and where in the level they are.
pub(super) struct Nodes {
    /// 1: nodes of 2^D samples.
    pub level: usize,
    pub part: Part,
    pub nodes: Level,
}

impl GridFile {
    /// The hierarchy over its samples, which are these planes.
    ///
    /// # Errors
    /// [`StoreError`] where a page is damaged.
    pub fn hierarchy(&self, planes: &[Vec<f32>]) -> Result<Hierarchy, StoreError> {
        let (bricks, about) = (self.bricks, &self.about);
        let channels = planes.iter().map(Vec::as_slice).collect();
        let samples = Samples { dimensions: bricks.dimensions, shape: bricks.shape, channels };
        let level = |level| Level::empty(bricks.level_shape(level), planes.len());
        let mut hierarchy = Hierarchy {
            dimensions: bricks.dimensions,
            shape: bricks.shape,
            planes: Planes::new(&samples, &about.options),
            levels: (1..=bricks.all_levels()).map(level).collect(),
            types: about.options.types,
            ranges: about.ranges.clone(),
        };
        let pages: Vec<usize> = (0..self.pages_of_nodes()).collect();
        // So many bricks at a time that what is read twice stays small.
        for some in pages.chunks(4 * rayon::current_num_threads().max(1)) {
            let read: Result<Vec<_>, StoreError> = some.par_iter().map(|number| self.nodes(*number)).collect();
            for Nodes { level, part, nodes } in read?.into_iter().flatten() {
                if let Some(own) = hierarchy.levels.get_mut(level - 1) {
                    own.put(&nodes, &part.indices(own.shape));
                }
            }
        }
        Ok(hierarchy)
    }

    /// Number of pages of nodes: of each brick one, and one of those above all bricks where there are any.
    pub(super) fn pages_of_nodes(&self) -> usize {
        self.bricks.len() + usize::from(self.bricks.all_levels() > self.bricks.levels())
    }

    /// The nodes of a page: those of a brick, or those above all of them.
    pub(super) fn nodes(&self, number: usize) -> Result<Vec<Nodes>, StoreError> {
        let brick = (number < self.bricks.len()).then_some(number);
        let page = PageId(2 * number as u32);
        let bytes = self.page(page)?;
        let low: Vec<f32> = self.about.ranges.iter().map(|(low, _)| *low).collect();
        let columns = columns_of(&self.about, &low);
        let mut at = 0;
        let mut all = Vec::new();
        for (level, part) in parts(self.bricks, brick) {
            let mut nodes = unknown(self.bricks, level, &part, low.len());
            let own: Vec<usize> = (0..part.len()).collect();
            let rest = bytes.get(at..).unwrap_or_default();
            let taken = columns.decode(rest, &own, part.shape, &mut nodes);
            at += taken.ok_or_else(|| self.damaged(page, &format!("nodes of level {level}")))?;
            all.push(Nodes { level, part, nodes });
        }
        self.check_end(page, &bytes, at)?;
        Ok(all)
    }
}

/// The levels that a page of nodes has, the coarsest first, and which nodes of each.
fn parts(bricks: Bricks, brick: Option<usize>) -> impl Iterator<Item = (usize, Part)> {
    let all = bricks.all_levels();
    let levels = match brick {
        Some(_) => 1..=bricks.levels().min(all),
        None => bricks.levels() + 1..=all,
    };
    levels.rev().map(move |level| match brick {
        Some(brick) => (level, bricks.part(brick, level)),
        None => (level, Part::whole(bricks.level_shape(level))),
    })
}

fn columns_of<'a>(about: &GridAbout, low: &'a [f32]) -> Columns<'a> {
    let sample_type = about.grid.sample_type;
    Columns {
        dimensions: about.grid.dimensions,
        values: value_code(sample_type.size(), sample_type.is_float()),
        low,
        has_holes: about.has_holes,
    }
}

/// Nodes that nothing is known of, with as many samples as each has place for.
fn unknown(bricks: Bricks, level: usize, part: &Part, planes: usize) -> Level {
    let samples = |node: usize| -> u32 {
        let at = part.place(node);
        let side = |axis: usize| match axis < bricks.dimensions {
            true => (bricks.shape[axis] - (at[axis] << level)).min(1 << level) as u32,
            false => 1,
        };
        (0..3).map(side).fold(1u32, u32::saturating_mul)
    };
    Level { samples: (0..part.len()).map(samples).collect(), ..Level::empty(part.shape, planes) }
}
