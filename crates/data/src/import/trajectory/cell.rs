//! The cell of a frame: where it begins, its edges, and along which of them it repeats.

/// Edges that differ by no more than this share are the same, as in runs.
const SAME: f64 = 1e-6;

/// A cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Cell {
    /// Its corner.
    pub corner: [f64; 3],
    /// Its edges as vectors.
    pub edges: [[f64; 3]; 3],
    /// Along which of them it repeats.
    pub periodic: [bool; 3],
}

impl Cell {
    /// The place with these coordinates along the edges, in their lengths.
    pub(super) fn place(&self, scaled: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|axis| {
            let along = |edge: usize| scaled[edge] * self.edges[edge][axis];
            self.corner[axis] + along(0) + along(1) + along(2)
        })
    }

    /// The image of a place so many cells on.
    pub(super) fn image(&self, place: [f64; 3], cells: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|axis| {
            let along = |edge: usize| cells[edge] * self.edges[edge][axis];
            place[axis] + along(0) + along(1) + along(2)
        })
    }

    /// Whether all of it is finite.
    pub(super) fn is_finite(&self) -> bool {
        self.corner.iter().chain(self.edges.as_flattened()).all(|x| x.is_finite())
    }

    /// The edge of a cube along the axes that repeats along all of them.
    pub(super) fn cube(&self) -> Option<f64> {
        let edge = self.edges[0][0];
        let is_cube = (0..3).all(|row| {
            (0..3).all(|axis| {
                let expected = if row == axis { edge } else { 0.0 };
                (self.edges[row][axis] - expected).abs() <= SAME * edge
            })
        });
        (is_cube && edge > 0.0 && edge.is_finite() && self.periodic == [true; 3]).then_some(edge)
    }

    /// Whether it repeats at all.
    pub(super) fn repeats(&self) -> bool {
        self.periodic.contains(&true)
    }
}

/// What the cells of all frames of a file say together.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) enum Cells {
    /// None repeats, or there are none.
    #[default]
    Open,
    /// All are one cube that repeats: its edge and its corner.
    Cube(f64, [f64; 3]),
    /// They repeat, but are no cubes, or not all the same: why.
    Other(&'static str),
}

impl Cells {
    /// What to tell of them; `follows`: whether particles are put to where they went through the faces.
    pub(super) fn note(self, follows: bool) -> Option<String> {
        match self {
            Cells::Open | Cells::Cube(_, [0.0, 0.0, 0.0]) => None,
            Cells::Cube(_, [x, y, z]) => {
                Some(format!("the periodic box begins at {x}, {y}, {z}, which is taken from positions"))
            }
            Cells::Other(why) => {
                let what = if follows { "image flags put particles to where they left it" } else { "nothing repeats" };
                Some(format!("the periodic cell is {why}: {what}"))
            }
        }
    }

    /// The first frame's, or with another frame's.
    pub(super) fn with(self, is_first: bool, cell: Option<&Cell>) -> Cells {
        let own = match cell {
            Some(cell) if cell.repeats() => cell
                .cube()
                .map_or(Cells::Other("no cube that repeats along all axes"), |edge| Cells::Cube(edge, cell.corner)),
            _ => Cells::Open,
        };
        match (self, own) {
            _ if is_first => own,
            (Cells::Cube(edge, corner), Cells::Cube(other, other_corner)) => {
                let is_near = |a: f64, b: f64| (a - b).abs() <= SAME * edge;
                let is_same = is_near(edge, other) && (0..3).all(|axis| is_near(corner[axis], other_corner[axis]));
                if is_same { self } else { Cells::Other("not the same in all frames") }
            }
            (Cells::Open, Cells::Open) => Cells::Open,
            (Cells::Other(why), _) | (_, Cells::Other(why)) => Cells::Other(why),
            _ => Cells::Other("not there in all frames"),
        }
    }
}
