//! What is under a pixel of a globe: the first place where a ray meets T as it stands on the body.

use super::course::{Course, Courses, Spread};
use super::pick::{Pick, in_hole};
use super::ray::{Hit, MinMax, Ray};
use super::tiles::{height_in, samples_of};
use crate::model::Cell;

/// A hair by which cells are wider than they are.
const HAIR: f64 = 1e-9;
/// Of the blocks along the seam nothing is known.
const ANY: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

/// A field and, where the first column follows a spacing after the last one, the cells between these.
struct Round<'a, M> {
    field: &'a mut M,
    /// Columns and rows of cells, those between the last and the first column included.
    cells: [u64; 2],
    top: u32,
    /// Whether there is a column of cells that the field itself does not have.
    is_closed: bool,
}

impl<'a, M: MinMax> Round<'a, M> {
    fn new(field: &'a mut M, spread: &Spread) -> Round<'a, M> {
        let grid = field.grid();
        let is_closed = spread.last[0] == grid.columns as f64;
        let cells = [grid.columns - 1 + u64::from(is_closed), grid.rows - 1];
        let top = cells[0].max(cells[1]).next_power_of_two().trailing_zeros().max(field.top());
        Round { field, cells, top, is_closed }
    }

    /// The range of a block; `None` where there is no triangle.
    fn range(&mut self, level: u32, row: u64, column: u64) -> Result<Option<[f64; 2]>, M::Error> {
        let reaches = (column + 1) << level >= self.cells[0];
        if self.is_closed && reaches || level > self.field.top() || level < self.field.finest() || level == 0 {
            return Ok(Some(ANY));
        }
        self.field.range(level, row, column)
    }

    fn cell(&mut self, row: u64, column: u64) -> Result<Cell, M::Error> {
        if !self.is_closed || column + 1 < self.cells[0] {
            return self.field.cell(row, column);
        }
        // The last column is the second one of the cell before; a field has two columns at least.
        let [before, first] = [self.field.cell(row, column - 1)?, self.field.cell(row, 0)?];
        Ok(Cell([before.0[1], first.0[0], before.0[3], first.0[2]]))
    }
}

/// What a ray looks for in a part of itself.
struct Search<'a> {
    spread: &'a Spread,
    course: &'a Course<'a>,
    /// Columns of the field itself.
    columns: u64,
    best: Option<Hit>,
}

impl Search<'_> {
    fn block<M: MinMax>(
        &mut self,
        field: &mut Round<'_, M>,
        level: u32,
        [row, column]: [u64; 2],
        span: [f64; 2],
    ) -> Result<(), M::Error> {
        let first = [row << level, column << level];
        if first[0] >= field.cells[1] || first[1] >= field.cells[0] {
            return Ok(());
        }
        let ends = [0, 1].map(|axis: usize| {
            [first[axis], (first[axis] + (1 << level)).min(field.cells[1 - axis])].map(|place| place as f64)
        });
        let to = self.best.map_or(span[1], |best| span[1].min(best.t));
        // Rows and columns cost less than a look into the file.
        let over = (span[0] <= to).then(|| self.course.within(ends[0], ends[1], ANY, [span[0], to])).flatten();
        let Some(span) = over else { return Ok(()) };
        if level == 0 {
            let cell = field.cell(row, column)?;
            self.cell(&cell, [row, column], span);
            return Ok(());
        }
        let Some(range) = field.range(level, row, column)? else { return Ok(()) };
        let Some(span) = self.course.within(ends[0], ends[1], self.spread.lifted(range), span) else { return Ok(()) };
        for (down, right) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            self.block(field, level - 1, [2 * row + down, 2 * column + right], span)?;
        }
        Ok(())
    }

    fn cell(&mut self, cell: &Cell, [row, column]: [u64; 2], span: [f64; 2]) {
        let [zero, lift] = self.spread.lift;
        let first = [row, column].map(|place| place as f64);
        for triangle in cell.triangles() {
            let [p, q, s] = triangle.at;
            let plane = [lift.mul_add(p, zero), lift * q, lift * s];
            for crossing in self.course.meets(first, [1.0; 2], plane, span).into_iter().flatten() {
                let [u, v] = [crossing.column - first[1], crossing.row - first[0]];
                let [k, m, n] = triangle.edge;
                let is_in = u.min(v) >= -HAIR && u.max(v) <= 1.0 + HAIR && k + m * u + n * v >= -HAIR;
                if !is_in || self.best.is_some_and(|best| best.t <= crossing.t) {
                    continue;
                }
                let [u, v] = [u, v].map(|part| part.clamp(0.0, 1.0));
                let Spread { origin, step, .. } = self.spread;
                let mut samples = samples_of(row, column, cell, &triangle);
                // Behind the seam comes the first column.
                samples.iter_mut().filter(|sample| sample.1 >= self.columns).for_each(|sample| sample.1 = 0);
                self.best = Some(Hit {
                    t: crossing.t,
                    row: first[0] + v,
                    column: first[1] + u,
                    x: origin[0] + (first[1] + u) * step[0],
                    y: origin[1] + (first[0] + v) * step[1],
                    height: height_in(cell, &triangle, u, v),
                    samples,
                });
            }
        }
    }
}

/// What a ray finds on a globe. A ray that meets no triangle looks at the hole through which it goes into the body, and at none where it does not.
///
/// # Errors
/// Where the field cannot be read.
pub fn pick_on_globe<M: MinMax>(field: &mut M, spread: &Spread, ray: &Ray) -> Result<Pick, M::Error> {
    let finest = field.finest();
    let range = if field.top() >= finest.max(1) { field.range(field.top(), 0, 0)? } else { None };
    let mut round = Round::new(field, spread);
    // Samples beside the field's own triangles may make some along the seam.
    let top = if round.is_closed { None } else { range };
    let top = top.map_or(spread.globe.reach(), |range| spread.lifted(range)[1]);
    let courses = spread.courses(ray.origin, ray.direction, ray.part, top);
    let columns = round.field.grid().columns;
    let mut best: Option<Hit> = None;
    for course in courses.iter() {
        let mut search = Search { spread, course, columns, best };
        let (top, span) = (round.top, course.span);
        search.block(&mut round, top, [0, 0], span)?;
        best = search.best;
    }
    if let Some(hit) = best {
        return Ok(Pick::Hit(hit));
    }
    beside(&mut round, &courses, spread, range)
}

/// A place in the hole that a ray goes through which meets nothing, else where it first has the middle height of the field.
fn beside<M: MinMax>(
    field: &mut Round<'_, M>,
    courses: &Courses<'_>,
    spread: &Spread,
    range: Option<[f64; 2]>,
) -> Result<Pick, M::Error> {
    let [columns, rows] = spread.last;
    let place = |height: f64| {
        courses.iter().find_map(|course| {
            let span = course.within([0.0, rows], [0.0, columns], [height, height], course.span)?;
            let [row, column, _] = course.place(span[0]);
            Some([row.clamp(0.0, rows), column.clamp(0.0, columns)])
        })
    };
    let middle = range.map_or(0.0, |range| spread.lifted(range).iter().sum::<f64>() * 0.5);
    let Some(found) = place(middle) else { return Ok(Pick::Beside) };
    let cell = |row, column| field.cell(row, column);
    let [row, column] = in_hole(found, [rows, columns], cell, |height| place(spread.lifted([height; 2])[0]))?;
    let Spread { origin, step, .. } = spread;
    Ok(Pick::NotMeasured { row, column, x: origin[0] + column * step[0], y: origin[1] + row * step[1] })
}
