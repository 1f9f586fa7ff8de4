//! A few of a field's samples as particles: what a window is framed by before all voxels are there.

use super::opened::OpenField;
use crate::import::voxels::{AIR, SUPPORT};
use crate::model::{Attribute, Dataset, Family, FamilyName, Kernel, Provenance, Unit};
use glam::DVec3;

impl OpenField {
    /// About `most` of its voxels or pixels as particles, spread evenly, each as large as what it stands for. The first and the last sample of
    /// the grid are among them, whatever their values, so that they fill the same box.
    pub fn sketch(&self, most: usize) -> Dataset {
        let whole = self.grid();
        let count = |every: u64| whole.thinned(every).shape.iter().map(|&side| side as f64).product::<f64>();
        let every = (1..u64::from(u32::MAX)).find(|&every| count(every) <= most as f64).unwrap_or(1);
        let (grid, values) = (whole.thinned(every), self.shown_values());
        let [low, high] = self.statistics().range();
        let air = if grid.dimensions == 3 { low + AIR * (high - low) } else { f64::NEG_INFINITY };
        let lifted = if low < 0.0 { -low } else { 0.0 };
        let least = 1e-6 * (high - low).max(1e-30);
        let volume = grid.to_world.matrix3.determinant().abs();
        let support = (SUPPORT * grid.spacing().into_iter().fold(0.0, f64::max)) as f32;
        let [width, height, depth] = whole.shape;
        let (mut positions, mut density, mut shown) = (Vec::new(), Vec::new(), Vec::new());
        let mut add = |at: [u64; 3], is_end: bool| {
            let value = f64::from(values[((at[2] * height + at[1]) * width + at[0]) as usize]);
            if !(is_end || value.is_finite() && value > air) {
                return;
            }
            let place = DVec3::from_array(at.map(|index| index as f64));
            positions.push(whole.to_world.transform_point3(place).to_array());
            density.push((if value.is_finite() { value + lifted } else { 0.0 }).max(least) as f32);
            shown.push(value as f32);
        };
        let ends = [[0; 3], [width - 1, height - 1, depth - 1]];
        for z in (0..depth).step_by(every as usize) {
            for y in (0..height).step_by(every as usize) {
                (0..width)
                    .step_by(every as usize)
                    .map(|x| [x, y, z])
                    .filter(|at| !ends.contains(at))
                    .for_each(|at| add(at, false));
            }
        }
        ends.into_iter().for_each(|end| add(end, true));
        let (name, unit) = self.about(0);
        let family = Family {
            name: FamilyName::Gas,
            mass: density.iter().map(|density| (f64::from(*density) * volume).max(1e-30) as f32).collect(),
            smoothing_length: vec![support; positions.len()],
            positions,
            density,
            attributes: vec![Attribute { name, unit, values: shown }],
        };
        Dataset {
            families: vec![family],
            length_unit: grid.length_unit.clone(),
            mass_unit: Unit::default(),
            kernel: Kernel::default(),
            skipped: Vec::new(),
            provenance: Provenance { path: self.path().into(), format: "voxels".into(), ..Provenance::default() },
        }
    }
}
