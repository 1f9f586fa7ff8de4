//! Which layers of bricks are filled from the same level of a field.

use crate::cpu::field::{Field, bricks};
use crate::cpu::volume::bricks::BRICK as PROCESSOR_BRICK;
use crate::gpu::volume::constants::BRICK;
use crate::view::PerspectiveGrid;
use std::ops::Range;

/// Layers that follow each other and have the same level.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Run {
    /// The level.
    pub level: usize,
    /// The layers.
    pub layers: Range<u32>,
}

/// The level of each layer of bricks: that of the processor's layer which it is a part of.
pub fn levels(field: &Field, grid: &PerspectiveGrid) -> Vec<usize> {
    let of = |layer: u32| bricks::level_of_layer(field, grid, (layer * BRICK) as usize / PROCESSOR_BRICK);
    (0..grid.size[2].div_ceil(BRICK)).map(of).collect()
}

/// The runs of some layers, of all of which the levels are given.
pub fn runs(levels: &[usize], layers: Range<u32>) -> Vec<Run> {
    let mut runs: Vec<Run> = Vec::new();
    for layer in layers {
        let level = levels[layer as usize];
        match runs.last_mut() {
            Some(run) if run.level == level => run.layers.end = layer + 1,
            _ => runs.push(Run { level, layers: layer..layer + 1 }),
        }
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_of_a_level_are_taken_together() {
        let run = |level, layers| Run { level, layers };
        assert_eq!(runs(&[0, 0, 0, 1, 1, 3], 1..6), [run(0, 1..3), run(1, 3..5), run(3, 5..6)]);
        assert!(runs(&[0, 1], 1..1).is_empty());
    }
}
