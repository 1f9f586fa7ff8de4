//! Sums over cells of T that the samples of coarser levels are made of. All are whole numbers, so that no order of adding matters.

/// Length of a unit normal in [`Sum::normal`].
pub const UNIT: i32 = 8191;
/// Weight of half a cell of T among colours; a sample that is in no triangle has weight 1.
pub const HALF_CELL: u64 = 4096;

/// Sums over cells, in part of a field of at most 2^16 cells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sum {
    /// Area of T, in halves of cells.
    pub area: u32,
    /// Samples that are in no triangle.
    pub lone: u32,
    /// Normals of triangles, [`UNIT`] long, pointing up.
    pub normal: [i32; 3],
}

/// The same for any part of a field.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WideSum {
    /// As in [`Sum`].
    pub area: u64,
    /// As in [`Sum`].
    pub lone: u64,
    /// As in [`Sum`].
    pub normal: [i64; 3],
}

/// Light of a plane: the sum over samples, by their area, and that of the squares, both weighted.
pub type Light = [u64; 2];
/// The same for any part of a field.
pub type WideLight = [u128; 2];

impl Sum {
    #[inline]
    fn add(&mut self, other: &Sum) {
        self.area += other.area;
        self.lone += other.lone;
        self.normal.iter_mut().zip(other.normal).for_each(|(own, other)| *own += other);
    }
}

impl From<Sum> for WideSum {
    fn from(sum: Sum) -> WideSum {
        WideSum { area: sum.area.into(), lone: sum.lone.into(), normal: sum.normal.map(i64::from) }
    }
}

impl WideSum {
    /// Adds another one.
    pub fn add(&mut self, other: &WideSum) {
        self.area += other.area;
        self.lone += other.lone;
        self.normal.iter_mut().zip(other.normal).for_each(|(own, other)| *own += other);
    }

    /// Weight of its light.
    pub fn weight(&self) -> u64 {
        HALF_CELL * self.area + self.lone
    }
}

/// A grid of sums, with those of `planes` colour planes for each.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Sums {
    /// Sums of a row.
    pub columns: usize,
    /// How many planes.
    pub planes: usize,
    /// The sums, row by row.
    pub sums: Vec<Sum>,
    /// Light of each sum's planes.
    pub light: Vec<Light>,
}

impl Sums {
    /// So many sums of nothing.
    pub fn new(rows: usize, columns: usize, planes: usize) -> Sums {
        let len = rows * columns;
        Sums { columns, planes, sums: vec![Sum::default(); len], light: vec![[0; 2]; len * planes] }
    }

    /// Rows.
    pub fn rows(&self) -> usize {
        self.sums.len() / self.columns.max(1)
    }

    /// Sums over blocks of 2 x 2.
    pub fn halved(&self) -> Sums {
        self.gathered(0, [self.rows().div_ceil(2), self.columns.div_ceil(2)])
    }

    /// What samples of the next level stand for: blocks of 2 x 2 about the corners of [`Sums::halved`]'s.
    pub fn about_samples(&self, rows: usize, columns: usize) -> Sums {
        self.gathered(1, [rows, columns])
    }

    /// Adds sum (r, c) to ((r + shift) / 2, (c + shift) / 2); `shift` is 0 or 1.
    fn gathered(&self, shift: usize, [rows, columns]: [usize; 2]) -> Sums {
        let mut out = Sums::new(rows, columns, self.planes);
        // Rows first, side by side, and then what is beside each other in half as many.
        let mut both = vec![Sum::default(); self.columns];
        for (row, sums) in out.sums.chunks_exact_mut(columns.max(1)).enumerate() {
            let own = |at: usize| self.sums.get(at * self.columns..(at + 1) * self.columns);
            let mut sources = [2 * row, 2 * row + 1].into_iter().filter_map(|at| own(at.checked_sub(shift)?));
            match sources.next() {
                Some(one) => both.copy_from_slice(one),
                None => continue,
            }
            sources.for_each(|other| add_row(&mut both, other));
            let (alone, pairs) = both.split_at(shift.min(both.len()));
            sums.iter_mut().zip(alone).for_each(|(sum, alone)| *sum = *alone);
            for (sum, pair) in sums[shift..].iter_mut().zip(pairs.chunks(2)) {
                pair.iter().for_each(|one| sum.add(one));
            }
        }
        if self.planes > 0 {
            for (row, lights) in self.light.chunks_exact(self.columns.max(1) * self.planes).enumerate() {
                let first = (row + shift) / 2 * columns;
                for (column, light) in lights.chunks_exact(self.planes).enumerate() {
                    let at = (first + (column + shift) / 2) * self.planes;
                    add_light(&mut out.light[at..at + self.planes], light);
                }
            }
        }
        out
    }
}

/// Adds light.
pub fn add_light(own: &mut [Light], other: &[Light]) {
    own.iter_mut().zip(other).for_each(|(own, other)| {
        own[0] += other[0];
        own[1] += other[1];
    });
}

/// Adds a row of sums to another one.
pub fn add_row(own: &mut [Sum], other: &[Sum]) {
    own.iter_mut().zip(other).for_each(|(own, other)| own.add(other));
}
