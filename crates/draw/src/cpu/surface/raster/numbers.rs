//! What is seen, as the numbers of triangles and points: found by somebody else, such as an adapter's passes.

use super::{Shown, Visibility};
use crate::cpu::surface::stitch::Scene;
use rayon::prelude::*;
use std::sync::atomic::AtomicU64;

/// The number of nothing.
pub const NO_NUMBER: u32 = u32::MAX;

impl Shown {
    /// Whether a scene has such a triangle's cell, or such a sample.
    fn is_of(self, scene: &Scene) -> bool {
        // A cell lies between a row and the next one, and so between columns.
        let next = usize::from(self.slot.is_some());
        scene
            .meshes
            .get(self.node)
            .is_some_and(|mesh| self.at[0] + next < mesh.samples.rows && self.at[1] + next < mesh.samples.columns)
    }
}

impl Visibility {
    /// Of a number for each pixel of a picture, row by row; what is not in the scene is nothing. `None` where there are not as many.
    pub fn of_numbers([width, height]: [u32; 2], numbers: &[u32], scene: &Scene) -> Option<Visibility> {
        let (width, height) = (width as usize, height as usize);
        let cell = |number: &u32| {
            let is_there = *number != NO_NUMBER && Shown::unpack(*number).is_of(scene);
            AtomicU64::new(if is_there { u64::from(*number) } else { u64::MAX })
        };
        let is_whole = Some(numbers.len()) == width.checked_mul(height);
        is_whole.then(|| Visibility { width, height, cells: numbers.par_iter().map(cell).collect() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu::surface::channels::channels;
    use crate::cpu::surface::memory::MemorySurface;
    use crate::cpu::surface::picture::{self, SurfaceOptions, visible};
    use crate::cpu::surface::sight::Sight;
    use crate::cpu::surface::tests::{Random, camera_over, hills, placed};

    /// What was seen is seen again, and numbers that a scene does not have are nothing.
    #[test]
    fn numbers_tell_what_is_seen() {
        let mut random = Random::new(9);
        let field = hills(300, 280, 0.05, 4);
        let source = MemorySurface::new(&field, 1.0).unwrap();
        let size = [120, 90];
        let sight = Sight::Flat(camera_over(&field, &mut random, size));
        let options = SurfaceOptions::default();
        let scene = picture::scene(&source, &placed(&field), &sight, &options);
        let (seen, _) = visible(&scene, &sight, &options, 1);
        let number = |index: usize| seen.at(index).map_or(NO_NUMBER, Shown::pack);
        let numbers: Vec<u32> = (0..seen.width * seen.height).map(number).collect();
        let again = Visibility::of_numbers(size, &numbers, &scene).unwrap();
        assert!((0..numbers.len()).all(|index| again.at(index) == seen.at(index)));
        assert!(numbers.iter().any(|number| *number != NO_NUMBER));
        assert!(Visibility::of_numbers([size[0], size[1] + 1], &numbers, &scene).is_none());
        // Whatever numbers come, places are looked for in the scene alone.
        let any: Vec<u32> = numbers.iter().map(|_| random.between(0.0, 2_f64.powi(32)) as u32 >> 9).collect();
        let found = Visibility::of_numbers(size, &any, &scene).unwrap();
        assert!(
            (0..any.len()).any(|index| found.is_shown(index)) && !(0..any.len()).all(|index| found.is_shown(index))
        );
        assert_eq!(channels(&scene, &sight, &found).len(), any.len());
    }
}
