//! How long the steps of a grid are: of places in degrees, metres on a sphere.

use super::{HeightGrid, units};
use deepfield_data::model::Unit;

/// Mean radius of the Earth, metres (IUGG).
pub const EARTH: f64 = 6_371_008.8;

/// Cosines of latitudes are not below this: next to a pole a degree of longitude has no length.
const NARROWEST: f64 = 1e-6;

/// Places in [-1, 1] and weights of Gauss's rule with five places.
const GAUSS: [[f64; 2]; 5] = [
    [-0.906_179_845_938_664, 0.236_926_885_056_189_08],
    [-0.538_469_310_105_683_1, 0.478_628_670_499_366_47],
    [0.0, 0.568_888_888_888_888_9],
    [0.538_469_310_105_683_1, 0.478_628_670_499_366_47],
    [0.906_179_845_938_664, 0.236_926_885_056_189_08],
];

/// Lengths of a grid's steps in one unit for places and heights. Places in degrees are on a sphere, and lengths are metres; heights are metres,
/// too, where their unit is not known. Elsewhere lengths are in the unit of x and y, and so are heights where both are known lengths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lengths {
    /// The first row's y, and from a row to the next.
    y: [f64; 2],
    /// From a column and from a row to the next: lengths, or degrees on a sphere of this radius.
    step: [f64; 2],
    radius: Option<f64>,
    /// A unit of height as a length.
    pub lift: f64,
}

impl Lengths {
    /// Of a grid; degrees are those of the Earth.
    pub fn of(grid: &HeightGrid) -> Lengths {
        Lengths::on(grid, EARTH)
    }

    /// Of a grid whose degrees are those of a sphere with this radius in metres.
    pub fn on(grid: &HeightGrid, radius: f64) -> Lengths {
        let is_degrees = units::is_degrees(&grid.xy_unit);
        let lift = match (units::metres(&grid.height_unit), units::metres(&grid.xy_unit)) {
            (Some(height), Some(place)) => height / place,
            (Some(height), None) if is_degrees => height,
            _ => 1.0,
        };
        Lengths { y: [grid.origin[1], grid.step[1]], step: grid.step, radius: is_degrees.then_some(radius), lift }
    }

    /// The unit that lengths are in.
    pub fn unit(grid: &HeightGrid) -> Unit {
        if units::is_degrees(&grid.xy_unit) { Unit::new("m") } else { grid.xy_unit.clone() }
    }

    /// From a column and from a row to the next where a row, with its fraction, is; negative where x and y decrease.
    pub fn steps(&self, row: f64) -> [f64; 2] {
        let Some(radius) = self.radius else { return self.step };
        let latitude = row.mul_add(self.y[1], self.y[0]).to_radians();
        let [across, along] = self.step.map(|degrees| degrees.to_radians() * radius);
        [across * libm::cos(latitude).abs().max(NARROWEST), along]
    }

    /// The length of the line between two places that is straight in x and y: of degrees on the sphere, where it is no shortest way.
    pub fn along(&self, from: [f64; 2], to: [f64; 2]) -> f64 {
        let apart = [to[0] - from[0], to[1] - from[1]];
        if self.radius.is_none() {
            return apart[0].hypot(apart[1]);
        }
        // Gauss's rule in pieces of a degree of latitude: what is left out is less than rounding.
        let pieces = apart[1].abs().ceil().clamp(1.0, 1e4);
        let speed = |part: f64| {
            let row = (part.mul_add(apart[1], from[1]) - self.y[0]) / self.y[1];
            let steps = self.steps(row);
            (steps[0] / self.step[0] * apart[0]).hypot(steps[1] / self.step[1] * apart[1])
        };
        let piece = |number: f64| -> f64 {
            GAUSS.iter().map(|[place, weight]| weight * speed((number + 0.5 + 0.5 * place) / pieces)).sum()
        };
        (0..pieces as u32).map(|number| piece(f64::from(number))).sum::<f64>() * 0.5 / pieces
    }

    /// What makes slopes of differences of heights along columns and along rows, in the middle between a row and the next.
    pub fn slopes(&self, row: u64) -> [f64; 2] {
        self.steps(row as f64 + 0.5).map(|step| self.lift / step)
    }

    /// The area of a cell between a row and the next: on a sphere of a part of its zone.
    pub fn cell(&self, row: u64) -> f64 {
        let [across, along] = self.steps(row as f64 + 0.5);
        // Of a zone between latitudes f - d and f + d it is the cosine of f times the sine of d.
        let half = if self.radius.is_some() { 0.5 * self.step[1].to_radians() } else { 0.0 };
        let narrower = if half == 0.0 { 1.0 } else { libm::sin(half) / half };
        (across * along * narrower).abs()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use deepfield_data::model::SampleType;

    fn grid(unit: &str, height: &str, origin: [f64; 2], step: [f64; 2], size: [u64; 2]) -> HeightGrid {
        let plain = HeightGrid::new(size[0], size[1], SampleType::F32);
        HeightGrid { origin, step, xy_unit: Unit::new(unit), height_unit: Unit::new(height), ..plain }
    }

    #[test]
    fn degrees_are_lengths_on_a_sphere() {
        // From south to north and back, the whole globe.
        for (first, step) in [(-90.0, 0.5), (90.0, -0.5)] {
            let grid = grid("deg", "km", [0.0, first], [0.25, step], [1441, 361]);
            let lengths = Lengths::on(&grid, 1000.0);
            let area: f64 = (0..360).map(|row| 1440.0 * lengths.cell(row)).sum();
            assert!((area / (4.0 * std::f64::consts::PI * 1e6) - 1.0).abs() < 1e-12, "{area}");
            let [across, along] = lengths.steps(180.0);
            let degree = 1000.0 * std::f64::consts::PI / 180.0;
            assert!((across - 0.25 * degree).abs() < 1e-9 && (along - step * degree).abs() < 1e-9);
            // At 60 degrees one of longitude is half as long.
            let [across, _] = lengths.steps(if step > 0.0 { 300.0 } else { 60.0 });
            assert!((across - 0.125 * degree).abs() < 1e-9);
            assert_eq!((lengths.lift, Lengths::unit(&grid).0.as_str()), (1000.0, "m"));
            assert!(lengths.slopes(0).iter().all(|slope| slope.is_finite()));
        }
    }

    #[test]
    fn lines_have_their_length_on_the_sphere() {
        let grid = grid("deg", "m", [-10.0, 80.0], [0.5, -0.25], [100, 600]);
        let lengths = Lengths::on(&grid, 1000.0);
        let degree = 1000.0 * std::f64::consts::PI / 180.0;
        let near = |found: f64, expected: f64| assert!((found / expected - 1.0).abs() < 1e-12, "{found} {expected}");
        near(lengths.along([0.0, -50.0], [0.0, 70.0]), 120.0 * degree);
        near(lengths.along([5.0, 60.0], [35.0, 60.0]), 15.0 * degree);
        // Many short ones, each level at its middle.
        let (from, to) = ([-10.0, 75.0], [30.0, -40.0]);
        let at = |part: f64| [0, 1].map(|axis| from[axis] + part * (to[axis] - from[axis]));
        let count = 200_000;
        let sum: f64 = (0..count)
            .map(|number| {
                let narrow = libm::cos(at((f64::from(number) + 0.5) / f64::from(count))[1].to_radians());
                (narrow * (to[0] - from[0])).hypot(to[1] - from[1]) * degree / f64::from(count)
            })
            .sum();
        assert!((lengths.along(from, to) / sum - 1.0).abs() < 1e-9);
        near(lengths.along(from, at(0.3)) + lengths.along(at(0.3), to), lengths.along(from, to));
    }

    #[test]
    fn lengths_stay_as_they_are() {
        for (places, heights, lift) in [("mm", "um", 1e-3), ("m", "", 1.0), ("", "m", 1.0), ("km", "m", 1e-3)] {
            let grid = grid(places, heights, [5.0, 1e6], [0.5, -0.25], [10, 10]);
            let lengths = Lengths::of(&grid);
            assert_eq!((lengths.steps(3.5), lengths.cell(7), lengths.lift), ([0.5, -0.25], 0.125, lift));
            assert_eq!(lengths.slopes(2), [lift / 0.5, lift / -0.25]);
            assert_eq!(lengths.along([1.0, 2.0], [4.0, -2.0]), 5.0);
            assert_eq!(Lengths::unit(&grid), grid.xy_unit);
        }
    }
}
