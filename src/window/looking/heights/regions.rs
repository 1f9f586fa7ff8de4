//! Regions that are drawn over a field, and their numbers.

use super::{Spot, on_surface};
use crate::heights::measure::{Disc, FormKind, FormNumbers, Part, Residual, Roughness, fit, roughness_on};
use crate::heights::model::{Heights, Lengths};
use crate::heights::store::HeightFile;

/// Points of an outline that lies on the surface.
const OUTLINE: usize = 160;
/// Regions of more samples are left to the command line.
const MOST_SAMPLES: u64 = 1 << 28;

/// A region in plan.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Area {
    /// Between two corners.
    Rectangle([[f64; 2]; 2]),
    /// About a middle.
    Disc(Disc),
}

/// Numbers of a region.
#[derive(Clone, Debug)]
pub struct Numbers {
    /// Which of the datasets its field is.
    pub field: usize,
    /// Those of ISO 25178-2, and how much was measured.
    pub roughness: Roughness,
    /// What was taken off before.
    pub form: Option<FormNumbers>,
    /// Its edge on the surface; none where that was not measured.
    pub outline: Vec<Option<Spot>>,
}

/// The numbers of a region of a field.
pub(super) fn numbers_of(
    file: &HeightFile,
    field: usize,
    radius: f64,
    area: Area,
    form: Option<FormKind>,
) -> Result<Numbers, String> {
    let few = || "the region has fewer than 2 x 2 samples".to_owned();
    let region = match area {
        Area::Rectangle(corners) => Part::of_rectangle(file, corners),
        Area::Disc(disc) => Part::of_disc(file, disc),
    };
    let region = region.ok_or_else(few)?;
    if region.grid().samples() > MOST_SAMPLES {
        let found = region.grid().samples();
        return Err(format!(
            "a region of {found} samples takes a while: deepfield probe FILE --rectangle ... asks for it"
        ));
    }
    let told = |error: &dyn std::fmt::Display| error.to_string();
    let form = form.map(|kind| fit(&region, kind).map_err(|error| told(&error))).transpose()?;
    let taken = form.as_ref().map(|form| form.numbers());
    let rest = form.map(|form| Residual::new(&region, form));
    let measured = rest.as_ref().map_or(&region as &dyn Heights, |rest| rest);
    let roughness = roughness_on(measured, &Lengths::on(region.grid(), radius));
    let outline = on_surface(file, &edge(area))?;
    Ok(Numbers { field, roughness: roughness.map_err(|error| told(&error))?, form: taken, outline })
}

/// Places along a region's edge, the first one again at the end.
fn edge(area: Area) -> Vec<[f64; 2]> {
    (0..=OUTLINE)
        .map(|step| {
            let turn = step as f64 / OUTLINE as f64;
            match area {
                Area::Disc(Disc { center, radius }) => {
                    let (sin, cos) = (std::f64::consts::TAU * turn).sin_cos();
                    [center[0] + radius * cos, center[1] + radius * sin]
                }
                Area::Rectangle([a, b]) => {
                    let corners = [a, [b[0], a[1]], b, [a[0], b[1]], a];
                    let side = ((4.0 * turn) as usize).min(3);
                    let along = 4.0 * turn - side as f64;
                    [0, 1].map(|axis| corners[side][axis] + along * (corners[side + 1][axis] - corners[side][axis]))
                }
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_are_closed_and_pass_all_corners() {
        let corners = [[1.0, 2.0], [5.0, -3.0]];
        let edge = edge(Area::Rectangle(corners));
        assert_eq!((edge.first(), edge.last()), (Some(&corners[0]), Some(&corners[0])));
        for corner in [[1.0, 2.0], [5.0, 2.0], [5.0, -3.0], [1.0, -3.0]] {
            assert!(edge.contains(&corner), "{corner:?}");
        }
        let round = super::edge(Area::Disc(Disc { center: [1.0, 1.0], radius: 2.0 }));
        assert!(round.iter().all(|[x, y]| ((x - 1.0).hypot(y - 1.0) - 2.0).abs() < 1e-12));
    }
}
