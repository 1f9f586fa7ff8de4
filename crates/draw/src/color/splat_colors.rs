//! What a single splat looks like where splats lie over each other: its colour and how much of what is behind it it hides.
//!
//! - **Colour.** That of the transfer function at the splat's attribute, if there is one, and at its own column ([`OwnColumn`]). The
//!   column of its own mass would say nothing: the same matter as fewer, heavier splats would have another colour.
//! - **Opacity.** A column `P` has the optical depth `k P`, so that it does not matter into how many splats it is divided. `k` is such
//!   that a column at the top of the range is as opaque as the opacity curve says there, though never more than [`MOST_OPAQUE`].

use super::colors::to_linear;
use super::transfer::{Hue, Levels, Scale, TransferFunction};
use std::f64::consts::TAU;

/// The opacity of a column at the top of the range, at most: optical depths are finite.
pub const MOST_OPAQUE: f32 = 0.99;

/// The look of splats by a transfer function with numbers for its ranges.
#[derive(Clone, Debug)]
pub struct SplatColors {
    levels: Levels,
    scale: Scale,
    hue: Option<Hue>,
    /// Linear light, by rows of equal hue.
    table: Vec<[f32; 3]>,
    size: [usize; 2],
    /// Optical depth of a column of 1.
    depth: f64,
}

impl SplatColors {
    /// For a transfer function whose automatic ranges are these.
    pub fn new(transfer: &TransferFunction, levels: Levels) -> SplatColors {
        let lut = transfer.bake_colors();
        let light = |[r, g, b, _]: &[u8; 4]| [r, g, b].map(|c| to_linear(f32::from(*c) / 255.0));
        let opacity = f64::from(transfer.opacity_at(1.0).min(MOST_OPAQUE));
        let top = levels.p[1];
        SplatColors {
            levels,
            scale: transfer.scale,
            hue: transfer.hue.clone(),
            table: lut.rgba.iter().map(light).collect(),
            size: [lut.width as usize, lut.height as usize],
            depth: if top > 0.0 { -(1.0 - opacity).ln() / top } else { 0.0 },
        }
    }

    /// The ranges in use.
    pub fn levels(&self) -> Levels {
        self.levels
    }

    /// Optical depth of a column of 1, in the inverse of its unit.
    pub fn depth(&self) -> f64 {
        self.depth
    }

    /// Colours in linear light, by rows of equal hue; and how many there are in a row, and rows. Between them [`SplatColors::light`] is linear.
    pub fn table(&self) -> (&[[f32; 3]], [usize; 2]) {
        (&self.table, self.size)
    }

    /// How columns are placed along the table's rows.
    pub fn column_scale(&self) -> (Scale, [f64; 2]) {
        (self.scale, self.levels.p)
    }

    /// How attributes are placed from row to row, where hues follow one.
    pub fn hue_scale(&self) -> Option<(Scale, [f64; 2])> {
        self.hue.as_ref().map(|hue| (hue.scale, self.levels.s))
    }

    /// The colour, linear light, of a splat with its own column ([`OwnColumn`]) and its attribute. What has no attribute, where others
    /// have one, is in the middle of the hues.
    pub fn light(&self, column: f64, attribute: Option<f32>) -> [f32; 3] {
        let along = self.scale.place(column as f32, self.levels.p);
        let hue = self.hue.as_ref().zip(attribute.filter(|value| value.is_finite()));
        let across = hue.map_or(0.5, |(hue, value)| hue.scale.place(value, self.levels.s));
        let [width, height] = self.size;
        let (column, right) = locate(along, width);
        let (row, down) = locate(across, height);
        let texel = |row: usize, column: usize| self.table[row.min(height - 1) * width + column.min(width - 1)];
        let between = |row: usize| mix(texel(row, column), texel(row, column + 1), right);
        mix(between(row), between(row + 1), down)
    }
}

/// The texel before a place within [0, 1], and how far it lies from there to the next one.
fn locate(place: f32, count: usize) -> (usize, f32) {
    let at = place.clamp(0.0, 1.0) * (count - 1) as f32;
    (at as usize, at.fract())
}

fn mix(a: [f32; 3], b: [f32; 3], share: f32) -> [f32; 3] {
    std::array::from_fn(|k| a[k] + (b[k] - a[k]) * share)
}

/// By what the column is found that a splat's colour stands for, in the unit of `P`: that of matter of its density, as deep as a particle of
/// mean mass is there. It depends on the density alone, so that it does not change when splats that are alike become one, however far apart
/// they are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OwnColumn {
    /// Matter of density `rho` has the weight `rho^power` a volume; `None` where weights have nothing to do with densities.
    pub power: Option<i32>,
    /// Mean mass of a particle.
    pub particle: f64,
    /// Variance of the kernel in units of `h^2`.
    pub variance: f64,
    /// Factor that turns the splats' densities into mass a volume.
    pub density_scale: f64,
}

/// `rho h^3 / m` of a particle with some forty others within its support.
const USUAL: f64 = 10.0;

impl OwnColumn {
    /// The column of the density 1, and the power of the density by which it changes, where densities tell it.
    pub fn by_density(&self) -> Option<[f64; 2]> {
        let OwnColumn { power, particle, variance, density_scale } = *self;
        let depth = (TAU * variance).sqrt() * (USUAL * particle / density_scale).cbrt();
        power.map(|power| [density_scale * depth, f64::from(power) - 1.0 / 3.0])
    }

    /// That of a splat of a weight, a density and a geometric mean of standard deviations; without density, the column through its middle.
    pub fn of(&self, weight: f64, density: Option<f32>, sigma: f64) -> f64 {
        let by_density = self.power.zip(density).map(|(power, density)| {
            let density = f64::from(density);
            let volume = USUAL * self.particle / (self.density_scale * density);
            self.density_scale * density.powi(power) * (TAU * self.variance).sqrt() * volume.cbrt()
        });
        by_density.filter(|column| *column > 0.0 && column.is_finite()).unwrap_or(weight / (TAU * sigma * sigma))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn columns_are_as_opaque_as_the_curve_says_at_the_top(opacity in 0.0..1.0f32, top in 1e-6..1e6f64) {
            let text = format!("(range: fixed({}, {top}), opacity: [(0.0, 0.0), (1.0, {opacity})])", 1e-3 * top);
            let transfer = TransferFunction::parse(&text, "t").unwrap();
            let colors = SplatColors::new(&transfer, transfer.numbers().unwrap());
            let found = 1.0 - (-colors.depth() * top).exp();
            prop_assert!((found - f64::from(opacity.min(MOST_OPAQUE))).abs() < 1e-6);
        }

        #[test]
        fn colours_are_those_of_the_transfer_function(place in 0.0..1.0f32, across in 0.0..1.0f32, tinted: bool) {
            let hue = if tinted { ", hue: (scale: linear, range: fixed(0.0, 1.0))" } else { "" };
            let text = format!("(scale: linear, range: fixed(0.0, 1.0){hue})");
            let transfer = TransferFunction::parse(&text, "t").unwrap();
            let colors = SplatColors::new(&transfer, transfer.numbers().unwrap());
            let (row, column) = ((across * 63.0).round() / 63.0, (place * 511.0).round() / 511.0);
            let expected = transfer.appearance(column, row).color.map(to_linear);
            let found = colors.light(f64::from(column), Some(row));
            prop_assert!((0..3).all(|k| (found[k] - expected[k]).abs() < 0.02), "{found:?} {expected:?}");
        }
    }

    #[test]
    fn own_columns_are_those_of_particles_wherever_they_lie() {
        let own = OwnColumn { power: Some(1), particle: 2.0, variance: 0.075, density_scale: 1.0 };
        // In matter of density 5 a particle of mass 2 has a kernel in which the column of that density is this.
        let h = (USUAL * 2.0 / 5.0).cbrt();
        let expected = 5.0 * (TAU * 0.075).sqrt() * h;
        assert!((own.of(2.0, Some(5.0), 0.3) / expected - 1.0).abs() < 1e-12);
        assert_eq!(own.of(2.0, Some(5.0), 0.3), own.of(200.0, Some(5.0), 3.0));
        // Of densities in another unit.
        let scaled = OwnColumn { density_scale: 10.0, ..own };
        assert!((scaled.of(2.0, Some(0.5), 0.3) / expected - 1.0).abs() < 1e-6);
        let [factor, power] = scaled.by_density().unwrap();
        assert!((factor * 0.5f64.powf(power) / expected - 1.0).abs() < 1e-12);
        let square = OwnColumn { power: Some(2), ..own };
        assert!((square.of(2.0, Some(5.0), 0.3) / (5.0 * expected) - 1.0).abs() < 1e-12);
        for none in [None, Some(0.0), Some(f32::NAN), Some(f32::INFINITY)] {
            assert_eq!(own.of(3.0, none, 0.5), 3.0 / (TAU * 0.25));
        }
        assert_eq!(OwnColumn { power: None, ..own }.of(3.0, Some(5.0), 0.5), 3.0 / (TAU * 0.25));
    }
}
