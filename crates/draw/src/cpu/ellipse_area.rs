//! Exact means of an ellipse over pixels: of any size, however thin, in double precision.
//!
//! A pixel's share of the flux is the difference of what lies left of its two sides within its row. What lies left of a side
//! at `x` is an integral over heights of a function that is the kernel's marginal where the row of the ellipse ends before
//! `x`, nothing where it begins after it, and between these heights, a window as narrow as the ellipse is thin, the kernel's
//! cumulative integral along x. The first is a difference of the marginal's own integral, so that shares add up to 1; the window
//! is integrated by Gauss-Legendre quadrature with panels that follow its width.

use super::ellipse::Ellipse;
use super::exact::{Band, cells};
use super::footprint::Footprint;
use super::table::CumulativeTable;

/// Gauss-Legendre with four nodes on [0, 1].
const GAUSS: [(f64, f64); 4] = [
    (0.069_431_844_202_973_71, 0.173_927_422_568_726_93),
    (0.330_009_478_207_571_9, 0.326_072_577_431_273_07),
    (0.669_990_521_792_428_1, 0.326_072_577_431_273_07),
    (0.930_568_155_797_026_3, 0.173_927_422_568_726_93),
];
/// Panels for each unit (half the width, or half the height) of a window.
const PANELS: f64 = 4.0;

/// Adds the exact integral of an ellipse over each pixel of a band.
pub fn add(table: &CumulativeTable, splat: &Footprint, ellipse: &Ellipse, band: &mut Band<'_>) {
    let area = ellipse.area();
    for j in cells(splat.min[1], splat.max[1], band.first as i64, band.rows()) {
        let top = (band.first + j) as f64;
        let [left, right] = ellipse.between([top, top + 1.0]);
        if left > right {
            continue;
        }
        let columns = cells(left, right, 0, band.stride);
        let mut before = left_of(table, ellipse, columns.start as f64, top);
        for i in columns {
            let after = left_of(table, ellipse, (i + 1) as f64, top);
            band.add(j, i, splat, area * (after - before));
            before = after;
        }
    }
}

/// The share of the flux left of `x` in the row of pixels from `top` on.
fn left_of(table: &CumulativeTable, ellipse: &Ellipse, x: f64, top: f64) -> f64 {
    let Ellipse { center, shear, half } = *ellipse;
    let height = |y: f64| ((y - center[1]) / half[1]).clamp(-1.0, 1.0);
    let (mut from, mut to) = (height(top), height(top + 1.0));
    // In units of the half width, `x` is at `place - slant eta`. What leans to the left is mirrored.
    let (place, mut slant) = ((x - center[0]) / half[0], shear * half[1] / half[0]);
    if slant < 0.0 {
        slant = -slant;
        (from, to) = (-to, -from);
    }
    let end = |side: f64| match slant > 0.0 {
        true => (place + side) / slant,
        false if place + side > 0.0 => f64::INFINITY,
        false => f64::NEG_INFINITY,
    };
    // All of the row lies left of `x` up to the first height, none of it from the second on.
    let (first, second) = (end(-1.0).clamp(from, to), end(1.0).clamp(from, to));
    let whole = 2.0 * (table.at(1.0, first) - table.at(1.0, from));
    let panels = (PANELS * (second - first) * slant.max(1.0)).ceil();
    let step = (second - first) / panels.max(1.0);
    let window: f64 = (0..panels as u32)
        .flat_map(|panel| GAUSS.iter().map(move |&(node, weight)| (f64::from(panel) + node, weight)))
        .map(|(at, weight)| {
            let eta = first + at * step;
            weight * (table.along(1.0, eta) + table.along(place - slant * eta, eta))
        })
        .sum();
    whole + window * step
}
