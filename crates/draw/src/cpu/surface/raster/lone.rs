//! Samples that are in no triangle, as points of any picture.

use super::super::placed::Vantage;
use super::super::sight::Sight;
use super::super::stitch::{Mesh, Scene};
use super::visibility::parts_of;
use super::{Shown, Visibility};
use rayon::prelude::*;

/// Draws the measured samples that are in no triangle as points of `side` pixels, into any picture: rays miss them.
pub fn draw_lone(scene: &Scene, sight: &Sight, picture: &Visibility, side: u32) -> u64 {
    let vantage = Vantage::new(&scene.placed, sight.eye());
    let count = |(number, mesh): (usize, &Mesh)| {
        let mut count = 0;
        for row in 0..mesh.samples.rows {
            for column in 0..mesh.samples.columns {
                if !mesh.is_lone(row, column) {
                    continue;
                }
                count += 1;
                let height = mesh.height(row * mesh.samples.columns + column);
                let relative = vantage.relative(mesh.rows[row], mesh.columns[column], height);
                if let Some((place, depth)) = sight.project(relative)
                    && sight.cut().keeps(relative + sight.eye())
                {
                    let shown = Shown { node: number, at: [row, column], slot: None };
                    picture.put_square(parts_of(place), side, depth, shown.pack());
                }
            }
        }
        count
    };
    scene.meshes.par_iter().enumerate().filter(|(_, mesh)| !mesh.samples.coverage.is_empty()).map(count).sum()
}
