//! What is under a pixel: a triangle of T, a place that was not measured, or nothing of the field.

use super::ray::{Hit, MinMax, Ray, Rise, cast};
use crate::model::Cell;

/// Most steps from the middle height of a field to a hole.
const STEPS: u32 = 8;

/// What a ray finds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pick {
    /// It passes beside the field.
    Beside,
    /// It passes over the field, through a hole or above it: a place in that hole where one is found, else where it has the middle height of the
    /// field, or comes nearest to that.
    NotMeasured {
        /// Row, with fraction.
        row: f64,
        /// Column, with fraction.
        column: f64,
        /// Place.
        x: f64,
        /// Place.
        y: f64,
    },
    /// It meets T.
    Hit(Hit),
}

/// What a ray finds. A ray that meets no triangle still looks at the field where it passes the box about all heights: from above this is
/// every place between the field's borders, and none beside.
///
/// # Errors
/// Where the field cannot be read.
pub fn pick<M: MinMax>(field: &mut M, rise: Rise, ray: &Ray) -> Result<Pick, M::Error> {
    if let Some(hit) = cast(field, rise, ray)? {
        return Ok(Pick::Hit(hit));
    }
    let (top, finest) = (field.top(), field.finest());
    // A field of one cell has no levels, and one of lone samples no range.
    let range = if top >= finest.max(1) { field.range(top, 0, 0)? } else { None };
    let grid = field.grid();
    let (last_row, last_column) = ((grid.rows - 1) as f64, (grid.columns - 1) as f64);
    let [row, column] = grid.row_column([ray.origin[0], ray.origin[1]]);
    let (down, right) = (ray.direction[1] / grid.step[1], ray.direction[0] / grid.step[0]);
    let [along, across] = [slab(row, down, [0.0, last_row]), slab(column, right, [0.0, last_column])];
    let mut part = [ray.part[0].max(along[0]).max(across[0]), ray.part[1].min(along[1]).min(across[1])];
    let mut middle = None;
    if let Some(range) = range {
        let ends = range.map(|height| rise.world(height));
        let upright = slab(ray.origin[2], ray.direction[2], [ends[0].min(ends[1]), ends[0].max(ends[1])]);
        part = [part[0].max(upright[0]), part[1].min(upright[1])];
        middle = Some((0.5 * (ends[0] + ends[1]) - ray.origin[2]) / ray.direction[2]).filter(|t| t.is_finite());
    }
    if !(part[0] <= part[1] && part[0] < f64::INFINITY) {
        return Ok(Pick::Beside);
    }
    let t = middle.unwrap_or(part[0]).clamp(part[0], part[1]);
    let place = |t: f64| {
        let moved = |from: f64, way: f64| if way == 0.0 { from } else { from + t * way };
        [moved(row, down).clamp(0.0, last_row), moved(column, right).clamp(0.0, last_column)]
    };
    let as_high = |height: f64| {
        let t = ((rise.world(height) - ray.origin[2]) / ray.direction[2]).clamp(part[0], part[1]);
        t.is_finite().then(|| place(t))
    };
    let cell = |row, column| field.cell(row, column);
    let [row, column] = in_hole(place(t), [last_row, last_column], cell, as_high)?;
    let [x, y] = field.grid().place(row, column);
    Ok(Pick::NotMeasured { row, column, x, y })
}

/// The row and column of the hole that a ray goes through which is as high as the middle of a field of `last` row and column at `found`. Where
/// the field slopes that may be beside the hole, and where the ray is `as_high` as what was measured there is nearer to it.
pub(super) fn in_hole<E>(
    found: [f64; 2],
    last: [f64; 2],
    mut cell: impl FnMut(u64, u64) -> Result<Cell, E>,
    as_high: impl Fn(f64) -> Option<[f64; 2]>,
) -> Result<[f64; 2], E> {
    let mut next = found;
    for _ in 0..STEPS {
        let [row, column] = next;
        let first = [row.min(last[0] - 1.0), column.min(last[1] - 1.0)].map(|at| at as u64);
        let height = cell(first[0], first[1])?.height(column - first[1] as f64, row - first[0] as f64);
        if height.is_nan() {
            return Ok(next);
        }
        let Some(nearer) = as_high(height) else { break };
        next = nearer;
    }
    Ok(found)
}

/// Where a coordinate that starts somewhere and changes at a rate is in a range.
fn slab(from: f64, way: f64, [low, high]: [f64; 2]) -> [f64; 2] {
    if way == 0.0 {
        let all = [f64::NEG_INFINITY, f64::INFINITY];
        return if (low..=high).contains(&from) { all } else { [all[1], all[0]] };
    }
    let (one, other) = ((low - from) / way, (high - from) / way);
    [one.min(other), one.max(other)]
}
