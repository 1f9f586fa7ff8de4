//! What a single splat looks like where splats lie over each other: its colour and how much of what is behind it it hides.
//!
//! - **Colour.** That of the transfer function at the splat's attribute, if there is one, and at its own column: its density times its
//!   depth. The column of its own mass alone would say nothing: the same matter as fewer, heavier splats would have another colour.
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

    /// The colour, linear light, of a splat with its own column ([`own_column`]) and its attribute. What has no attribute, where others
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

/// The column that a splat's colour stands for, in the unit of `P`: of its own density (weight a volume) as deep as it is, with `sigma` the
/// geometric mean of its standard deviations. It does not change when splats that are at one place, and alike, become one. Where a splat
/// has no density, the column through its middle.
pub fn own_column(weight: f64, density: Option<f64>, sigma: f64) -> f64 {
    match density.filter(|density| *density > 0.0 && density.is_finite()) {
        Some(density) => density * TAU.sqrt() * sigma,
        None => weight / (TAU * sigma * sigma),
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
    fn own_columns_are_the_same_for_one_splat_instead_of_two() {
        // Two of weight 1 at one place, in matter of density 5, and one of weight 2 in their place.
        assert_eq!(own_column(1.0, Some(5.0), 0.3), own_column(2.0, Some(5.0), 0.3));
        for none in [None, Some(0.0), Some(f64::NAN)] {
            assert_eq!(own_column(3.0, none, 0.5), 3.0 / (TAU * 0.25));
        }
    }
}
