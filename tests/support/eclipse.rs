//! Data of which a part hides another.

use super::Random;
use deepfield::model::{Dataset, Family, FamilyName, Kernel, Provenance, Unit};

/// A dense ball in front of a wide cloud.
pub fn eclipse() -> Dataset {
    let mut random = Random(77);
    let mut next = || random.next() - 0.5;
    let mut family = Family {
        name: FamilyName::Gas,
        positions: Vec::new(),
        mass: Vec::new(),
        smoothing_length: Vec::new(),
        density: Vec::new(),
        attributes: Vec::new(),
    };
    for i in 0..60_000 {
        let at = [next(), next(), next()];
        let is_ball = i % 3 == 0;
        let (scale, z, h) = if is_ball { (0.5, 1.0, 0.05) } else { (1.0, -1.5, 0.03) };
        family.positions.push([scale * at[0], scale * at[1], scale * at[2] + z]);
        family.smoothing_length.push(h);
        family.mass.push(if is_ball { 1.0 } else { 0.05 });
        family.density.push(1.0);
    }
    Dataset {
        families: vec![family],
        length_unit: Unit::default(),
        mass_unit: Unit::default(),
        kernel: Kernel::CubicSpline,
        skipped: Vec::new(),
        provenance: Provenance::default(),
    }
}
