//! Small systems of linear equations as least squares give them.

/// A symmetric matrix and a right side, summed up.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Normal {
    size: usize,
    /// The lower triangle, row by row.
    matrix: Vec<f64>,
    right: Vec<f64>,
    /// The sum of squares of what is to be explained.
    pub squares: f64,
    /// How many equations.
    pub count: u64,
}

/// Pivots below this part of the largest diagonal element stand for what the samples do not determine.
const SINGULAR: f64 = 1e-13;

impl Normal {
    pub(super) fn new(size: usize) -> Normal {
        Normal { size, matrix: vec![0.0; size * (size + 1) / 2], right: vec![0.0; size], squares: 0.0, count: 0 }
    }

    /// Adds an equation: a row of factors and what they are to give.
    pub(super) fn add(&mut self, row: &[f64], value: f64) {
        let mut at = 0;
        for (i, a) in row.iter().enumerate() {
            for b in &row[..=i] {
                self.matrix[at] += a * b;
                at += 1;
            }
            self.right[i] += a * value;
        }
        self.squares += value * value;
        self.count += 1;
    }

    /// Adds to an element of the lower triangle.
    pub(super) fn add_product(&mut self, row: usize, column: usize, value: f64) {
        let (row, column) = (row.max(column), row.min(column));
        self.matrix[row * (row + 1) / 2 + column] += value;
    }

    /// Adds to the right side.
    pub(super) fn add_right(&mut self, row: usize, value: f64) {
        self.right[row] += value;
    }

    /// Adds another's sums.
    pub(super) fn join(mut self, other: &Normal) -> Normal {
        self.matrix.iter_mut().zip(&other.matrix).for_each(|(sum, part)| *sum += part);
        self.right.iter_mut().zip(&other.right).for_each(|(sum, part)| *sum += part);
        self.squares += other.squares;
        self.count += other.count;
        self
    }

    /// The solution by Cholesky's method, with every diagonal element made larger by a part of it (Marquardt's damping); `None` where it is
    /// not determined.
    pub(super) fn solve(&self, damping: f64) -> Option<Vec<f64>> {
        let at = |row: usize, column: usize| row * (row + 1) / 2 + column;
        let size = self.size;
        // Unknowns of different sizes are brought to one.
        let scale: Vec<f64> = (0..size).map(|i| self.matrix[at(i, i)].sqrt()).collect();
        if !scale.iter().all(|scale| scale.is_finite() && *scale > 0.0) {
            return None;
        }
        let mut lower = self.matrix.clone();
        for i in 0..size {
            for j in 0..=i {
                lower[at(i, j)] /= scale[i] * scale[j];
            }
            lower[at(i, i)] += damping;
        }
        for i in 0..size {
            for j in 0..=i {
                let sum: f64 = (0..j).map(|k| lower[at(i, k)] * lower[at(j, k)]).sum();
                let rest = lower[at(i, j)] - sum;
                lower[at(i, j)] = if i > j {
                    rest / lower[at(j, j)]
                } else if rest > SINGULAR {
                    rest.sqrt()
                } else {
                    return None;
                };
            }
        }
        let mut found = vec![0.0; size];
        for i in 0..size {
            let sum: f64 = (0..i).map(|k| lower[at(i, k)] * found[k]).sum();
            found[i] = (self.right[i] / scale[i] - sum) / lower[at(i, i)];
        }
        for i in (0..size).rev() {
            let sum: f64 = (i + 1..size).map(|k| lower[at(k, i)] * found[k]).sum();
            found[i] = (found[i] - sum) / lower[at(i, i)];
        }
        found.iter_mut().zip(&scale).for_each(|(found, scale)| *found /= scale);
        found.iter().all(|value| value.is_finite()).then_some(found)
    }
}

/// A number with its derivatives by up to five others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Dual {
    pub value: f64,
    pub by: [f64; 5],
}

impl Dual {
    /// A constant.
    pub(super) fn new(value: f64) -> Dual {
        Dual { value, by: [0.0; 5] }
    }

    /// One of the numbers by which is derived.
    pub(super) fn variable(value: f64, number: usize) -> Dual {
        let mut dual = Dual::new(value);
        dual.by[number] = 1.0;
        dual
    }

    /// A function's value from those of two numbers, with its derivatives by each.
    fn of_two(value: f64, (one, by_one): (Dual, f64), (other, by_other): (Dual, f64)) -> Dual {
        Dual { value, by: std::array::from_fn(|k| one.by[k] * by_one + other.by[k] * by_other) }
    }

    pub(super) fn sqrt(self) -> Dual {
        let root = self.value.sqrt();
        Dual { value: root, by: self.by.map(|by| 0.5 * by / root) }
    }

    pub(super) fn sin_cos(self) -> (Dual, Dual) {
        let (sin, cos) = libm::sincos(self.value);
        (Dual { value: sin, by: self.by.map(|by| cos * by) }, Dual { value: cos, by: self.by.map(|by| -sin * by) })
    }
}

impl std::ops::Add for Dual {
    type Output = Dual;
    fn add(self, other: Dual) -> Dual {
        Dual { value: self.value + other.value, by: std::array::from_fn(|k| self.by[k] + other.by[k]) }
    }
}

impl std::ops::Sub for Dual {
    type Output = Dual;
    fn sub(self, other: Dual) -> Dual {
        Dual { value: self.value - other.value, by: std::array::from_fn(|k| self.by[k] - other.by[k]) }
    }
}

impl std::ops::Mul for Dual {
    type Output = Dual;
    fn mul(self, other: Dual) -> Dual {
        Dual::of_two(self.value * other.value, (self, other.value), (other, self.value))
    }
}

impl std::ops::Div for Dual {
    type Output = Dual;
    fn div(self, other: Dual) -> Dual {
        let value = self.value / other.value;
        Dual::of_two(value, (self, 1.0 / other.value), (other, -value / other.value))
    }
}
