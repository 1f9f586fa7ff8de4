//! The form of a surface: what is taken off it before its roughness is measured.

use crate::model::{HeightError, HeightGrid, Heights, Window};
use deepfield_data::model::{SampleType, Scale};
use serde::Serialize;

/// A kind of form.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FormKind {
    /// A plane.
    Plane,
    /// A polynomial of degree 2.
    Quadric,
    /// A polynomial of a degree, in all terms up to it; 1 to [`FormKind::LARGEST_DEGREE`].
    Polynomial(u32),
    /// A sphere.
    Sphere,
    /// A cylinder that lies, more or less.
    Cylinder,
}

impl FormKind {
    /// Polynomials go up to this degree.
    pub const LARGEST_DEGREE: u32 = 12;

    /// A kind by its name: `plane`, `quadric`, `sphere`, `cylinder`, `polynomial-5`.
    pub fn named(name: &str) -> Option<FormKind> {
        match name {
            "plane" => Some(FormKind::Plane),
            "quadric" => Some(FormKind::Quadric),
            "sphere" => Some(FormKind::Sphere),
            "cylinder" => Some(FormKind::Cylinder),
            _ => {
                let degree = name.strip_prefix("polynomial-")?.parse().ok()?;
                (1..=FormKind::LARGEST_DEGREE).contains(&degree).then_some(FormKind::Polynomial(degree))
            }
        }
    }

    /// The degree of a polynomial.
    pub(super) fn degree(self) -> Option<usize> {
        match self {
            FormKind::Plane => Some(1),
            FormKind::Quadric => Some(2),
            FormKind::Polynomial(degree) => Some(degree.clamp(1, FormKind::LARGEST_DEGREE) as usize),
            FormKind::Sphere | FormKind::Cylinder => None,
        }
    }
}

impl std::fmt::Display for FormKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            FormKind::Plane => f.write_str("plane"),
            FormKind::Quadric => f.write_str("quadric"),
            FormKind::Polynomial(degree) => write!(f, "polynomial-{degree}"),
            FormKind::Sphere => f.write_str("sphere"),
            FormKind::Cylinder => f.write_str("cylinder"),
        }
    }
}

/// Places in parts of a length from a middle: what makes sums of powers well behaved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Local {
    /// The middle of the field.
    pub middle: [f64; 2],
    /// Half of its extents.
    pub half: [f64; 2],
}

impl Local {
    pub(super) fn of(grid: &HeightGrid) -> Local {
        let (last_row, last_column) = ((grid.rows - 1) as f64, (grid.columns - 1) as f64);
        let half = [0.5 * last_column * grid.step[0].abs(), 0.5 * last_row * grid.step[1].abs()];
        Local { middle: grid.place(0.5 * last_row, 0.5 * last_column), half }
    }

    pub(super) fn place(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [(x - self.middle[0]) / self.half[0], (y - self.middle[1]) / self.half[1]]
    }
}

/// Values of Legendre's polynomials from degree 0 on.
pub(super) fn legendre(x: f64, out: &mut [f64]) {
    for degree in 0..out.len() {
        out[degree] = match degree {
            0 => 1.0,
            1 => x,
            _ => {
                let k = degree as f64;
                ((2.0 * k - 1.0) * x * out[degree - 1] - (k - 1.0) * out[degree - 2]) / k
            }
        };
    }
}

/// The terms of a polynomial of two variables: powers of x and y, by falling powers of x within a degree (1, x, y, x^2, x y, y^2, ...).
pub(super) fn terms(degree: usize) -> Vec<[usize; 2]> {
    (0..=degree).flat_map(|total| (0..=total).map(move |y| [total - y, y])).collect()
}

/// A polynomial as a sum of products of Legendre's polynomials over the field.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Polynomial {
    pub degree: usize,
    pub local: Local,
    /// Of the products of [`terms`].
    pub sums: Vec<f64>,
}

impl Polynomial {
    /// The polynomial along a row of places as a sum of Legendre's polynomials of x alone.
    fn of_row(&self, y: f64) -> Vec<f64> {
        let mut values = vec![0.0; self.degree + 1];
        legendre(self.local.place([self.local.middle[0], y])[1], &mut values);
        let mut row = vec![0.0; self.degree + 1];
        for ([x, y], sum) in terms(self.degree).into_iter().zip(&self.sums) {
            row[x] += sum * values[y];
        }
        row
    }

    /// The polynomial at a place.
    fn at(&self, place: [f64; 2]) -> f64 {
        let mut values = [[0.0; FormKind::LARGEST_DEGREE as usize + 1]; 2];
        let count = self.degree + 1;
        for (values, at) in values.iter_mut().zip(self.local.place(place)) {
            legendre(at, &mut values[..count]);
        }
        let mut sums = self.sums.iter();
        let (mut sum, [across, along]) = (0.0, values);
        // In the order of terms().
        for total in 0..count {
            for (y, factor) in (0..=total).zip(&mut sums) {
                sum += factor * across[total - y] * along[y];
            }
        }
        sum
    }

    fn in_row(&self, row: &[f64], x: f64) -> f64 {
        let x = (x - self.local.middle[0]) / self.local.half[0];
        // The recursion of legendre(), without keeping the values.
        let (mut before, mut here, mut sum) = (0.0, 1.0, 0.0);
        for (degree, factor) in row.iter().enumerate() {
            sum += factor * here;
            let k = degree as f64 + 1.0;
            (before, here) = (here, ((2.0 * k - 1.0) * x * here - (k - 1.0) * before) / k);
        }
        sum
    }

    /// Factors of powers of x and y about a place.
    pub(super) fn powers(&self, about: [f64; 2]) -> Vec<f64> {
        // Powers of the local coordinates, then of those in units of length, then about the place: one variable after the other.
        let count = self.degree + 1;
        let single: Vec<Vec<f64>> = (0..count).map(legendre_powers).collect();
        let mut grid = vec![vec![0.0; count]; count];
        for ([x, y], sum) in terms(self.degree).into_iter().zip(&self.sums) {
            for (i, a) in single[x].iter().enumerate() {
                for (j, b) in single[y].iter().enumerate() {
                    grid[i][j] += sum * a * b;
                }
            }
        }
        let shift = [0, 1].map(|axis| (about[axis] - self.local.middle[axis]) / self.local.half[axis]);
        for row in &mut grid {
            moved(row, shift[1]);
        }
        for j in 0..count {
            let mut column: Vec<f64> = grid.iter().map(|row| row[j]).collect();
            moved(&mut column, shift[0]);
            grid.iter_mut().zip(column).for_each(|(row, value)| row[j] = value);
        }
        let [across, along] = self.local.half;
        terms(self.degree).into_iter().map(|[x, y]| grid[x][y] / across.powi(x as i32) / along.powi(y as i32)).collect()
    }
}

/// Factors of the powers of x in Legendre's polynomial of a degree.
fn legendre_powers(degree: usize) -> Vec<f64> {
    let (mut before, mut here) = (Vec::new(), vec![1.0]);
    for k in 1..=degree {
        let n = k as f64;
        let mut next = vec![0.0; k + 1];
        here.iter().enumerate().for_each(|(power, factor)| next[power + 1] += (2.0 * n - 1.0) / n * factor);
        before.iter().enumerate().for_each(|(power, factor): (usize, &f64)| next[power] -= (n - 1.0) / n * factor);
        (before, here) = (here, next);
    }
    here
}

/// Factors of powers of x become those of powers of x - shift (Horner's scheme).
fn moved(factors: &mut [f64], shift: f64) {
    for first in 0..factors.len() {
        for power in (first..factors.len() - 1).rev() {
            factors[power] += shift * factors[power + 1];
        }
    }
}

/// A sphere or a cylinder near its point over the middle of the field: the surface is where `2 q.n + k (q.q - (q.a)^2) = 0`, with q from that
/// point. This holds for planes (k = 0) as well, so that hardly bent surfaces are as exact as others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Round {
    pub middle: [f64; 2],
    /// Height of the point over the middle, in the unit of x and y.
    pub height: f64,
    /// From the unit of heights to that of x and y.
    pub ratio: f64,
    /// The upward normal there.
    pub normal: [f64; 3],
    /// The axis' direction, of a cylinder; else 0.
    pub axis: [f64; 3],
    /// 1 / radius; above 0 where the middle is a summit.
    pub bend: f64,
}

impl Round {
    /// The height over a place in the unit of heights; NaN beside the sphere or the cylinder.
    fn at(&self, [x, y]: [f64; 2]) -> f64 {
        let ([x, y], [nx, ny, nz], [ax, ay, az], k) =
            ([x - self.middle[0], y - self.middle[1]], self.normal, self.axis, self.bend);
        let along = ax * x + ay * y;
        let (a, b) = (k * (1.0 - az * az), nz - k * az * along);
        let c = 2.0 * (nx * x + ny * y) + k * (x * x + y * y - along * along);
        let root = (b * b - a * c).sqrt();
        (self.height - c / (b + root)) / self.ratio
    }

    /// The sphere's middle, or a point of the cylinder's axis: x, y, and height in the unit of heights.
    fn center(&self) -> [f64; 3] {
        let [nx, ny, nz] = self.normal.map(|part| part / self.bend);
        [self.middle[0] - nx, self.middle[1] - ny, (self.height - nz) / self.ratio]
    }
}

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Shape {
    Polynomial(Polynomial),
    Round(Round),
}

/// A form that was fitted, or is given.
#[derive(Clone, Debug, PartialEq)]
pub struct Form {
    pub(super) kind: FormKind,
    pub(super) shape: Shape,
}

/// What is told of a form.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FormNumbers {
    /// `plane`, `quadric`, `polynomial-5`, `sphere` or `cylinder`.
    pub kind: String,
    /// Of polynomials: factors of 1, x, y, x^2, x y, y^2, ... in units of heights and of x and y.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub coefficients: Option<Vec<f64>>,
    /// Of polynomials of more than degree 2: the place from which x and y count there.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub about: Option<[f64; 2]>,
    /// Of a sphere its middle, of a cylinder a point of its axis: x, y, and height in the unit of heights.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub center: Option<[f64; 3]>,
    /// Radius in the unit of x and y.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub radius: Option<f64>,
    /// Of a cylinder: the direction of its axis, of length 1, with heights in the unit of x and y.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub axis: Option<[f64; 3]>,
}

impl FormNumbers {
    /// Of each coefficient of a polynomial what it is a factor of (`1`, `x`, `y`, `x^2`, `x y`, ...), and its unit in a field of this grid: `um`, `um/mm`, `um/mm^2`;
    /// empty where that is not known.
    pub fn terms(&self, grid: &HeightGrid) -> Vec<(String, String)> {
        let count = self.coefficients.as_ref().map_or(0, Vec::len);
        let (heights, places) = (&grid.height_unit, &grid.xy_unit);
        let unit = |degree: usize| match degree {
            0 => heights.0.clone(),
            _ if heights.is_unknown() || places.is_unknown() => String::new(),
            1 => format!("{heights}/{places}"),
            _ => format!("{heights}/{places}^{degree}"),
        };
        terms(FormKind::LARGEST_DEGREE as usize)
            .into_iter()
            .take(count)
            .map(|[x, y]| {
                let factors = [power("x", x), power("y", y)];
                let named: Vec<String> = factors.into_iter().flatten().collect();
                (if named.is_empty() { "1".to_owned() } else { named.join(" ") }, unit(x + y))
            })
            .collect()
    }
}

/// A power of a variable in words; `None` of the power 0.
fn power(name: &str, exponent: usize) -> Option<String> {
    match exponent {
        0 => None,
        1 => Some(name.to_owned()),
        _ => Some(format!("{name}^{exponent}")),
    }
}

impl Form {
    /// The plane `c + a x + b y`, for a field.
    pub fn plane(grid: &HeightGrid, [c, a, b]: [f64; 3]) -> Form {
        let local = Local::of(grid);
        let [x, y] = local.middle;
        let sums = vec![c + a * x + b * y, a * local.half[0], b * local.half[1]];
        Form { kind: FormKind::Plane, shape: Shape::Polynomial(Polynomial { degree: 1, local, sums }) }
    }

    /// Its kind.
    pub fn kind(&self) -> FormKind {
        self.kind
    }

    /// Its height at a place, in the unit of heights; NaN beside a sphere or a cylinder.
    pub fn height(&self, place: [f64; 2]) -> f64 {
        match &self.shape {
            Shape::Polynomial(polynomial) => polynomial.at(place),
            Shape::Round(round) => round.at(place),
        }
    }

    /// Its numbers.
    pub fn numbers(&self) -> FormNumbers {
        let kind = self.kind.to_string();
        let none = FormNumbers { kind, coefficients: None, about: None, center: None, radius: None, axis: None };
        match &self.shape {
            Shape::Polynomial(polynomial) => {
                let about = (polynomial.degree > 2).then_some(polynomial.local.middle);
                FormNumbers { coefficients: Some(polynomial.powers(about.unwrap_or([0.0; 2]))), about, ..none }
            }
            Shape::Round(round) => {
                let axis = (self.kind == FormKind::Cylinder).then_some(round.axis);
                FormNumbers { center: Some(round.center()), radius: Some(1.0 / round.bend.abs()), axis, ..none }
            }
        }
    }
}

/// A field without its form.
pub struct Residual<'a> {
    heights: &'a dyn Heights,
    grid: HeightGrid,
    form: Form,
}

impl<'a> Residual<'a> {
    /// Takes a form off a field.
    pub fn new(heights: &'a dyn Heights, form: Form) -> Residual<'a> {
        let grid = HeightGrid { sample_type: SampleType::F64, scale: Scale::NONE, ..heights.grid().clone() };
        Residual { heights, grid, form }
    }

    /// The form.
    pub fn form(&self) -> &Form {
        &self.form
    }
}

impl Heights for Residual<'_> {
    fn grid(&self) -> &HeightGrid {
        &self.grid
    }

    fn stored(&self, window: Window, out: &mut [f64]) -> Result<(), HeightError> {
        self.heights.heights(window, out)?;
        for (number, row) in out.chunks_exact_mut(window.columns as usize).enumerate() {
            let row_number = (window.row + number as u64) as f64;
            let y = self.grid.place(row_number, 0.0)[1];
            let factors = match &self.form.shape {
                Shape::Polynomial(polynomial) => polynomial.of_row(y),
                Shape::Round(_) => Vec::new(),
            };
            for (column, height) in row.iter_mut().enumerate().filter(|(_, height)| !height.is_nan()) {
                let place = self.grid.place(row_number, (window.column + column as u64) as f64);
                *height -= match &self.form.shape {
                    Shape::Polynomial(polynomial) => polynomial.in_row(&factors, place[0]),
                    Shape::Round(round) => round.at(place),
                };
            }
        }
        Ok(())
    }

    fn plane(&self, plane: usize, window: Window, out: &mut [u8]) -> Result<(), HeightError> {
        self.heights.plane(plane, window, out)
    }
}
