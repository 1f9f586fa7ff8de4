//! Where samples are, by the arrays beside them: places along each axis, or corners and steps.

use crate::import::content::Content;
use crate::model::HeightGrid;
use deepfield_data::import::ImportError;
use deepfield_data::model::Unit;

/// Names that arrays of places have, of x and of y.
const PLACES: [[&str; 8]; 2] = [
    ["x", "xs", "lon", "lons", "long", "longitude", "longitudes", "easting"],
    ["y", "ys", "lat", "lats", "latt", "latitude", "latitudes", "northing"],
];

/// Names of single numbers: a step, and two corners, of x and of y.
const CORNERS: [[&str; 3]; 2] = [["dx", "xmin", "xmax"], ["dy", "ymin", "ymax"]];

/// Whether an array is of places by its name.
pub(super) fn is_axis(name: &str) -> bool {
    let name = name.to_lowercase();
    PLACES.as_flattened().contains(&&*name)
}

/// Which axis the places of that name are of.
fn axis_of(name: &str) -> Option<usize> {
    let name = name.to_lowercase();
    PLACES.iter().position(|names| names.contains(&&*name))
}

/// What the arrays say, x first.
#[derive(Debug, Default)]
pub(super) struct Axes {
    /// Name and places.
    places: [Option<(String, Vec<f64>)>; 2],
    /// Step, least and largest.
    corners: [[Option<f64>; 3]; 2],
}

impl Axes {
    /// Whether an array of this shape says where samples are, of which there are so many columns and rows.
    pub(super) fn wants(&self, name: &str, sizes: &[u64], size: [u64; 2]) -> bool {
        match sizes {
            [] | [1] => CORNERS.as_flattened().contains(&&*name.to_lowercase()),
            [count] => axis_of(name).is_some_and(|axis| size[axis] == *count && self.places[axis].is_none()),
            _ => false,
        }
    }

    /// Its numbers, where it is wanted.
    pub(super) fn put(&mut self, name: &str, numbers: Vec<f64>) {
        let lower = name.to_lowercase();
        if let [number] = numbers[..] {
            for (axis, names) in CORNERS.iter().enumerate() {
                if let Some(which) = names.iter().position(|own| *own == lower) {
                    self.corners[axis][which] = Some(number);
                }
            }
        } else if let Some(axis) = axis_of(name) {
            self.places[axis] = Some((name.to_owned(), numbers));
        }
    }

    /// Puts samples in their places; whether all steps are stated.
    ///
    /// # Errors
    /// Where a step is 0, or no number.
    pub(super) fn apply(
        &self,
        content: &Content,
        grid: &mut HeightGrid,
        notes: &mut Vec<String>,
    ) -> Result<bool, ImportError> {
        let mut stated = 0;
        for axis in 0..2 {
            let count = [grid.columns, grid.rows][axis];
            let found = match &self.places[axis] {
                Some((name, places)) => Some(along(content, name, places, notes)?),
                None => self.between(content, axis, count, notes)?,
            };
            if let Some([origin, step]) = found {
                (grid.origin[axis], grid.step[axis]) = (origin, step);
                stated += 1;
            }
        }
        let is_angle = |(name, _): &(String, Vec<f64>)| name.to_lowercase().starts_with('l');
        let angles = self.places.iter().flatten().filter(|places| is_angle(places)).count();
        if angles > 0 {
            grid.xy_unit = Unit::new("deg");
        }
        if stated == 1 {
            notes.push("places are stated along one axis only".into());
        }
        Ok(stated == 2)
    }

    /// First place and step by corners; the rows or columns may be cells between them, or samples from one to the
    /// other.
    fn between(
        &self,
        content: &Content,
        axis: usize,
        count: u64,
        notes: &mut Vec<String>,
    ) -> Result<Option<[f64; 2]>, ImportError> {
        let [name, from, to] = CORNERS[axis];
        let [step, first, last] = self.corners[axis];
        if let Some(wrong) = step.filter(|step| !(step.is_finite() && *step > 0.0)) {
            return Err(content.malformed(name, wrong, "a number above 0"));
        }
        for (name, corner) in [(from, first), (to, last)] {
            if let Some(wrong) = corner.filter(|corner| !corner.is_finite()) {
                return Err(content.malformed(name, wrong, "a finite number"));
            }
        }
        let (cells, samples) = (count as f64, (count - 1) as f64);
        match (step, first, last) {
            (None, Some(first), Some(last)) => {
                // As between the first and the last place.
                let step = (last - first) / samples;
                if step == 0.0 {
                    return Err(content.malformed(to, last, format!("another number than {from}")));
                }
                Ok(Some([first, step]))
            }
            (Some(step), Some(first), Some(last)) => {
                let side = (last - first).abs();
                let is_near = |count: f64| (side / step - count).abs() < 0.25;
                // Rows count from what is called the least on, whichever it is: it is where the first row is.
                let signed = if last < first { -step } else { step };
                if last < first {
                    let lines = ["columns", "rows"][axis];
                    notes.push(format!("{from} {first} is above {to} {last}: {lines} count from {from} on, downwards"));
                }
                let half = if is_near(cells) {
                    notes.push(format!("{from} and {to} are the outer sides of cells of {step}"));
                    0.5
                } else {
                    if !is_near(samples) {
                        notes.push(format!(
                            "{from} to {to} is {side}, which is not {count} times {name} {step}: {name} counts"
                        ));
                    }
                    0.0
                };
                Ok(Some([first + half * signed, signed]))
            }
            (Some(step), first, None) => Ok(Some([first.unwrap_or(0.0), step])),
            (Some(step), None, Some(last)) => Ok(Some([last - step * samples, step])),
            (None, ..) => Ok(None),
        }
    }
}

/// First place and mean step.
fn along(content: &Content, name: &str, places: &[f64], notes: &mut Vec<String>) -> Result<[f64; 2], ImportError> {
    let (first, last) = match places {
        [first, .., last] => (*first, *last),
        _ => (0.0, 0.0),
    };
    let step = (last - first) / (places.len() as f64 - 1.0);
    if !(step.is_finite() && step != 0.0 && first.is_finite()) {
        return Err(content.malformed(name, format!("{first} to {last}"), "places that go from one number to another"));
    }
    let off = |(number, place): (usize, &f64)| ((place - first) / step - number as f64).abs();
    let worst = places
        .iter()
        .enumerate()
        .map(off)
        .fold(0.0, |worst: f64, off| if off > worst || off.is_nan() { off } else { worst });
    if worst.is_nan() {
        return Err(content.malformed(name, "places that are no numbers", "finite numbers"));
    }
    // What is stored in single precision is off by its rounding.
    if worst > 0.05 {
        notes.push(format!(
            "{name} is not evenly spaced: its mean step {step} puts samples up to {worst:.2} steps off their places"
        ));
    }
    Ok([first, step])
}
