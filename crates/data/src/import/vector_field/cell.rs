//! One cell of a field over one interval of time: what is between its eight nodes and the two times.

/// Powers of time.
pub(super) const ORDERS: usize = 4;

/// The field in a cell: trilinear in space, a polynomial in time. Places are in cells from the cell's beginning; the polynomial goes on
/// beyond its faces, so that a step may look there.
pub(super) struct Cell {
    /// Of each power of time, of each node (x fastest), cells per unit of time.
    pub coefficients: [[[f64; 3]; 8]; ORDERS],
    /// How many powers count.
    pub orders: usize,
    /// When the interval begins.
    pub start: f64,
    /// How long it is.
    pub length: f64,
    /// How long the cell is along each axis.
    pub widths: [f64; 3],
}

impl Cell {
    /// Velocity, in cells per unit of time.
    pub(super) fn rate(&self, [x, y, z]: [f64; 3], time: f64) -> [f64; 3] {
        let share = (time - self.start) / self.length;
        let (planes, rows) = ([1.0 - z, z], [1.0 - y, y]);
        let weights: [f64; 8] = std::array::from_fn(|node| {
            planes[node >> 2] * rows[node >> 1 & 1] * if node & 1 == 0 { 1.0 - x } else { x }
        });
        self.powers(share, &weights)
    }

    /// Velocity, length units per unit of time.
    pub(super) fn velocity(&self, place: [f64; 3], time: f64) -> [f64; 3] {
        let rate = self.rate(place, time);
        std::array::from_fn(|axis| rate[axis] * self.widths[axis])
    }

    /// The length of the curl of the velocity, one over the unit of time.
    pub(super) fn vorticity(&self, place: [f64; 3], time: f64) -> f64 {
        let share = (time - self.start) / self.length;
        // Of the velocity along each axis, how it changes along each.
        let slopes: [[f64; 3]; 3] = std::array::from_fn(|along| {
            let weights: [f64; 8] = std::array::from_fn(|node| {
                let axes = 0..3;
                axes.map(|axis| match (node >> axis & 1, axis == along) {
                    (0, true) => -1.0,
                    (_, true) => 1.0,
                    (0, false) => 1.0 - place[axis],
                    (_, false) => place[axis],
                })
                .product()
            });
            let rate = self.powers(share, &weights);
            std::array::from_fn(|axis| rate[axis] * self.widths[axis] / self.widths[along])
        });
        let curl = [slopes[1][2] - slopes[2][1], slopes[2][0] - slopes[0][2], slopes[0][1] - slopes[1][0]];
        curl.iter().map(|part| part * part).sum::<f64>().sqrt()
    }

    /// The weighted sum of all nodes at a share of the interval.
    fn powers(&self, share: f64, weights: &[f64; 8]) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for nodes in self.coefficients.iter().take(self.orders).rev() {
            sum = sum.map(|part| part * share);
            for (node, weight) in nodes.iter().zip(weights) {
                for (sum, value) in sum.iter_mut().zip(node) {
                    *sum += weight * value;
                }
            }
        }
        sum
    }
}

/// The powers of a share of the interval between the times of `values[1]` and `values[2]` of which what goes through these two, with the
/// slopes of parabolas through the values before and after where there are some, consists.
pub(super) fn hermite(values: [Option<f64>; 4], times: [f64; 4]) -> Option<[f64; ORDERS]> {
    let [before, from, to, after] = values;
    let (from, to) = (from?, to?);
    let length = times[2] - times[1];
    let slope = (to - from) / length;
    let (earlier, later) = (
        before.map(|before| (times[1] - times[0], (from - before) / (times[1] - times[0]))),
        after.map(|after| (times[3] - times[2], (after - to) / (times[3] - times[2]))),
    );
    let between =
        |other: Option<(f64, f64)>| other.map(|(own, own_slope)| (slope * own + own_slope * length) / (own + length));
    // At an end of all times, that of the parabola at the other end says which it is.
    let (begin, end) = match (between(earlier), between(later)) {
        (Some(begin), Some(end)) => (begin, end),
        (Some(begin), None) => (begin, 2.0 * slope - begin),
        (None, Some(end)) => (2.0 * slope - end, end),
        (None, None) => (slope, slope),
    };
    let (begin, end, rise) = (begin * length, end * length, to - from);
    Some([from, begin, 3.0 * rise - 2.0 * begin - end, begin + end - 2.0 * rise])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Parabolas in time are what they are, at uneven times and at both ends of them.
        #[test]
        fn parabolas_are_exact(
            steps in prop::array::uniform3(0.1..3.0f64), powers in prop::array::uniform3(-2.0..2.0f64),
            has_before: bool, has_after: bool, share in 0.0..1.0f64,
        ) {
            let mut times = [-1.0; 4];
            (0..3).for_each(|k| times[k + 1] = times[k] + steps[k]);
            let value = |time: f64| powers[0] + time * (powers[1] + time * powers[2]);
            let all = times.map(|time| Some(value(time)));
            let some = [all[0].filter(|_| has_before), all[1], all[2], all[3].filter(|_| has_after)];
            let found = hermite(some, times).unwrap();
            let at = found.iter().rev().fold(0.0, |sum, power| sum * share + power);
            let straight = all[1].unwrap() * (1.0 - share) + all[2].unwrap() * share;
            let truth = if has_before || has_after { value(times[1] + share * steps[1]) } else { straight };
            prop_assert!((at - truth).abs() < 1e-9, "{} {}", at, truth);
            prop_assert_eq!(hermite([all[0], None, all[2], all[3]], times), None);
        }
    }

    #[test]
    fn a_turning_cell_has_the_vorticity_of_its_turn() {
        // u = (-y, 2 x, 0) with cells of 2 x 3 x 1.
        let widths = [2.0, 3.0, 1.0];
        let mut cell = Cell { coefficients: [[[0.0; 3]; 8]; ORDERS], orders: 1, start: 0.0, length: 1.0, widths };
        for node in 0..8 {
            let [x, y] = [0, 1].map(|axis| (node >> axis & 1) as f64 * widths[axis]);
            cell.coefficients[0][node] = [-y / widths[0], 2.0 * x / widths[1], 0.0];
        }
        assert!((cell.vorticity([0.3, 0.6, 0.5], 0.0) - 3.0).abs() < 1e-12);
        let velocity = cell.velocity([0.25, 0.5, 0.1], 0.0);
        assert!((velocity[0] + 1.5).abs() < 1e-12 && (velocity[1] - 1.0).abs() < 1e-12, "{velocity:?}");
    }
}
