//! Fitting a form to the measured samples by least squares: of heights for planes and polynomials, of distances from the surface for spheres
//! and cylinders.

use super::bands::map_bands;
use super::form::{Form, FormKind, Local, Polynomial, Round, Shape, legendre, terms};
use super::ray::height_ratio;
use super::solve::{Dual, Normal};
use crate::model::{HeightError, Heights, units};

/// Why there is no form.
#[derive(Debug, thiserror::Error)]
pub enum FormError {
    /// The field.
    #[error(transparent)]
    Heights(#[from] HeightError),
    /// Too few samples, or all of them on one line.
    #[error("--form {kind}: found {valid} measured samples, expected enough of them, not in line, to determine it")]
    Undetermined {
        /// What was to be fitted.
        kind: FormKind,
        /// Measured samples.
        valid: u64,
    },
    /// A form with a radius over places that are no lengths.
    #[error(
        "--form {kind}: found x and y in degrees, expected lengths; plane, quadric and polynomial-N are fitted to heights alone"
    )]
    Degrees {
        /// What was to be fitted.
        kind: FormKind,
    },
}

/// Fits a form to all measured samples of a field. Samples are read twice for polynomials, some ten times for spheres and cylinders.
///
/// # Errors
/// Where the field cannot be read, or its samples do not determine the form.
pub fn fit(heights: &dyn Heights, kind: FormKind) -> Result<Form, FormError> {
    let shape = match kind.degree() {
        Some(degree) => Shape::Polynomial(polynomial(heights, kind, degree)?),
        None if units::is_degrees(&heights.grid().xy_unit) => return Err(FormError::Degrees { kind }),
        None => Shape::Round(round(heights, kind)?),
    };
    Ok(Form { kind, shape })
}

/// A polynomial, and the same again for what is left, which takes off what the first solution's rounding left.
fn polynomial(heights: &dyn Heights, kind: FormKind, degree: usize) -> Result<Polynomial, FormError> {
    let local = Local::of(heights.grid());
    let mut found = Polynomial { degree, local, sums: vec![0.0; terms(degree).len()] };
    for _ in 0..2 {
        let form = Form { kind, shape: Shape::Polynomial(found.clone()) };
        let normal = polynomial_sums(&super::Residual::new(heights, form), degree, local)?;
        let Some(more) = normal.solve(0.0) else { return Err(FormError::Undetermined { kind, valid: normal.count }) };
        found.sums.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
    }
    Ok(found)
}

/// Sums over rows of products of polynomials of x alone; products with those of y go on top, once a row.
fn polynomial_sums(heights: &dyn Heights, degree: usize, local: Local) -> Result<Normal, HeightError> {
    let grid = heights.grid();
    let (all, count) = (terms(degree), degree + 1);
    // The polynomials' values in every column are those of every row.
    let mut columns = vec![0.0; grid.columns as usize * count];
    for (column, values) in columns.chunks_exact_mut(count).enumerate() {
        let x = grid.place(0.0, column as f64)[0];
        legendre(local.place([x, local.middle[1]])[0], values);
    }
    let bands = map_bands(heights, 0, |band| {
        let mut normal = Normal::new(all.len());
        let (mut products, mut rights, mut along) = (vec![0.0; count * count], vec![0.0; count], vec![0.0; count]);
        for (row, line) in band.rows() {
            products.fill(0.0);
            rights.fill(0.0);
            for (values, &height) in columns.chunks_exact(count).zip(line).filter(|(_, height)| !height.is_nan()) {
                for (i, a) in values.iter().enumerate() {
                    products[i * count..=i * count + i].iter_mut().zip(values).for_each(|(sum, b)| *sum += a * b);
                    rights[i] += a * height;
                }
                normal.count += 1;
            }
            legendre(local.place([local.middle[0], grid.place(row as f64, 0.0)[1]])[1], &mut along);
            for (i, [x, y]) in all.iter().enumerate() {
                for (j, [other_x, other_y]) in all[..=i].iter().enumerate() {
                    let product = products[x.max(other_x) * count + x.min(other_x)];
                    normal.add_product(i, j, product * along[*y] * along[*other_y]);
                }
                normal.add_right(i, rights[*x] * along[*y]);
            }
        }
        normal
    })?;
    Ok(bands.iter().fold(Normal::new(all.len()), Normal::join))
}

/// At most so many passes.
const PASSES: usize = 60;

/// Steps that change nothing by more than this, in parts of the field's size, are the last.
const SETTLED: f64 = 1e-13;

/// Steps below this that make nothing better are rounding.
const STILL: f64 = 1e-9;

/// What a sphere or a cylinder is fitted by, in parts of half of the field's larger extent: height over the middle, the normal's x and y,
/// curvature, and the direction of the axis.
type Parameters = [f64; 5];

/// A sphere or a cylinder by Levenberg's and Marquardt's method, beginning with the curvatures of the quadric.
fn round(heights: &dyn Heights, kind: FormKind) -> Result<Round, FormError> {
    let grid = heights.grid();
    let (ratio, local) = (height_ratio(grid), Local::of(grid));
    let size = local.half[0].max(local.half[1]);
    let start = polynomial(heights, kind, 2)?;
    let powers = start.powers(local.middle);
    let unit = ratio / size;
    let [c, bx, by, xx, xy, yy] = std::array::from_fn(|k| powers[k] * unit * size.powi([0, 1, 1, 2, 2, 2][k]));
    let steep = (1.0 + bx * bx + by * by).sqrt();
    let normal = [-bx / steep, -by / steep];
    let is_cylinder = kind == FormKind::Cylinder;
    // Curvatures along both principal directions, as if the middle were level.
    let (mean, apart) = (xx + yy, ((xx - yy).powi(2) + xy * xy).sqrt());
    let (one, other) = (mean + apart, mean - apart);
    let bent = if is_cylinder { if one.abs() > other.abs() { one } else { other } } else { mean };
    let across =
        0.5 * libm::atan2(xy, xx - yy) + if one.abs() > other.abs() { 0.0 } else { std::f64::consts::FRAC_PI_2 };
    let mut at: Parameters = [c, normal[0], normal[1], -bent / steep.powi(3), across + std::f64::consts::FRAC_PI_2];
    let count = if is_cylinder { 5 } else { 4 };
    let sums = |at: &Parameters| distances(heights, local, size, ratio, at, count);
    let mut here = sums(&at)?;
    let valid = here.count;
    let undetermined = || FormError::Undetermined { kind, valid };
    if valid <= count as u64 {
        return Err(undetermined());
    }
    let mut damping = 0.0;
    for _ in 0..PASSES {
        let step = here.solve(damping).ok_or_else(undetermined)?;
        let mut next = at;
        next.iter_mut().zip(&step).for_each(|(value, step)| *value -= step);
        let there = sums(&next)?;
        let largest = step.iter().fold(0.0_f64, |largest, step| largest.max(step.abs()));
        if there.count == valid && there.squares <= here.squares {
            (at, here, damping) = (next, there, damping * 0.1);
        } else if largest > STILL && damping < 1e9 {
            damping = (damping * 10.0).max(1e-4);
            continue;
        } else {
            break;
        }
        if largest <= SETTLED {
            break;
        }
    }
    let (normal, axis) = directions(&at.map(Dual::new), is_cylinder);
    let (normal, axis) = (normal.map(|part| part.value), axis.map(|part| part.value));
    if at[3] == 0.0 {
        return Err(undetermined());
    }
    Ok(Round { middle: local.middle, height: at[0] * size, ratio, normal, axis, bend: at[3] / size })
}

/// The normal and the axis of parameters.
fn directions(at: &[Dual; 5], is_cylinder: bool) -> ([Dual; 3], [Dual; 3]) {
    let (nx, ny) = (at[1], at[2]);
    let nz = (Dual::new(1.0) - nx * nx - ny * ny).sqrt();
    let none = Dual::new(0.0);
    if !is_cylinder {
        return ([nx, ny, nz], [none; 3]);
    }
    let (sin, cos) = at[4].sin_cos();
    let az = (none - cos * nx - sin * ny) / nz;
    let length = (Dual::new(1.0) + az * az).sqrt();
    ([nx, ny, nz], [cos / length, sin / length, az / length])
}

/// Sums of squares of the samples' distances from the surface, and of their derivatives.
fn distances(
    heights: &dyn Heights,
    local: Local,
    size: f64,
    ratio: f64,
    at: &Parameters,
    count: usize,
) -> Result<Normal, HeightError> {
    let grid = heights.grid();
    let variables: [Dual; 5] =
        std::array::from_fn(|k| if k < count { Dual::variable(at[k], k) } else { Dual::new(at[k]) });
    let (normal, axis) = directions(&variables, count == 5);
    let (height, bend) = (variables[0], variables[3]);
    let bands = map_bands(heights, 0, |band| {
        let mut sums = Normal::new(count);
        for (row, line) in band.rows() {
            let mut row_sums = Normal::new(count);
            for (column, sample) in line.iter().enumerate().filter(|(_, sample)| !sample.is_nan()) {
                let [x, y] = grid.place(row as f64, column as f64);
                let q = [
                    Dual::new((x - local.middle[0]) / size),
                    Dual::new((y - local.middle[1]) / size),
                    Dual::new(sample * ratio / size) - height,
                ];
                let dot = |a: &[Dual; 3], b: &[Dual; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
                let along = dot(&q, &axis);
                let (out, square) = (dot(&q, &normal), dot(&q, &q) - along * along);
                let twice = Dual::new(2.0) * out + bend * square;
                // (sqrt(1 + k twice) - 1) / k, without cancellation.
                let distance = twice / (Dual::new(1.0) + (Dual::new(1.0) + bend * twice).sqrt());
                if distance.value.is_finite() {
                    row_sums.add(&distance.by[..count], distance.value);
                }
            }
            sums = sums.join(&row_sums);
        }
        sums
    })?;
    Ok(bands.iter().fold(Normal::new(count), Normal::join))
}
