//! The nodes of a grid along one axis, and the cells between them.

use crate::import::ImportError;
use std::path::Path;

/// Nodes along an axis in ascending order. A cell lies between each and the next, of a periodic axis also between the last and the
/// first of the next period. Numbers of cells go on through all periods; an axis of one node has one cell without end.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Axis {
    nodes: Vec<f64>,
    period: Option<f64>,
    /// Whether the source has its nodes in descending order.
    is_reversed: bool,
}

impl Axis {
    /// An axis of these nodes; `name` is what messages call them.
    ///
    /// # Errors
    /// Where they are not finite, or neither ascend nor descend.
    pub(super) fn new(path: &Path, name: &str, mut nodes: Vec<f64>) -> Result<Axis, ImportError> {
        let is_reversed = nodes.first() > nodes.last();
        if is_reversed {
            nodes.reverse();
        }
        let ascend = nodes.windows(2).all(|pair| pair[0] < pair[1]);
        let span = nodes.last().zip(nodes.first()).map(|(last, first)| last - first);
        if !ascend || !span.is_some_and(f64::is_finite) {
            let expected = "finite numbers, each above the one before or each below";
            return Err(ImportError::malformed(path, name, "others", expected));
        }
        Ok(Axis { nodes, period: None, is_reversed })
    }

    /// So many nodes from one place to another, in the order of the source.
    pub(super) fn even(first: f64, step: f64, count: u64) -> Vec<f64> {
        (0..count).map(|node| first + step * node as f64).collect()
    }

    /// The same nodes, stretched to between `from` and `to`, which is one mean distance behind the last node of a periodic axis and the
    /// last node of any other; of an axis of several nodes.
    pub(super) fn within(&mut self, from: f64, to: f64, is_periodic: bool) {
        let (count, first, span) = (self.nodes.len() as f64, self.first(), self.last() - self.first());
        let whole = if is_periodic { span * count / (count - 1.0) } else { span };
        for node in &mut self.nodes {
            *node = from + (*node - first) / whole * (to - from);
        }
        if is_periodic {
            self.period = Some(to - from);
        } else if let Some(last) = self.nodes.last_mut() {
            *last = to;
        }
    }

    /// Makes it go on at its other end, one mean distance of nodes behind the last.
    pub(super) fn repeat(&mut self) {
        if self.period.is_none() && !self.is_flat() {
            let (count, span) = (self.nodes.len() as f64, self.last() - self.first());
            self.period = Some(span * count / (count - 1.0));
        }
    }

    /// Whether it has one node, so that nothing depends on it.
    pub(super) fn is_flat(&self) -> bool {
        self.nodes.len() == 1
    }

    /// Whether it goes on at its other end.
    pub(super) fn is_periodic(&self) -> bool {
        self.period.is_some()
    }

    /// Whether the source has its nodes in descending order.
    pub(super) fn is_reversed(&self) -> bool {
        self.is_reversed
    }

    /// Number of nodes, at least 1.
    pub(super) fn len(&self) -> usize {
        self.nodes.len()
    }

    fn first(&self) -> f64 {
        self.nodes.first().copied().unwrap_or(0.0)
    }

    fn last(&self) -> f64 {
        self.nodes.last().copied().unwrap_or(0.0)
    }

    /// Where it begins.
    pub(super) fn start(&self) -> f64 {
        self.first()
    }

    /// Where it ends: at its last node, or one period behind the first.
    pub(super) fn end(&self) -> f64 {
        self.period.map_or(self.last(), |period| self.first() + period)
    }

    /// The cell that a place is in, and how far from its beginning, in cells; `None` outside.
    pub(super) fn locate(&self, place: f64) -> Option<(i64, f64)> {
        if self.is_flat() {
            return Some((0, 0.0));
        }
        let (mut lap, mut place) = (0, place);
        if let Some(period) = self.period {
            let laps = ((place - self.first()) / period).floor();
            // Beyond that there is no room for a place within a period.
            lap = Some(laps).filter(|laps| laps.abs() < 1e9)? as i64;
            place -= laps * period;
        }
        if !(self.start()..=self.end()).contains(&place) {
            return None;
        }
        let above = self.nodes.partition_point(|node| *node <= place);
        let cell = above.saturating_sub(1).min(self.cells() - 1);
        let share = (place - self.nodes[cell]) / self.width(cell as i64);
        Some((lap * self.cells() as i64 + cell as i64, share))
    }

    /// Cells of a period, or in all.
    fn cells(&self) -> usize {
        if self.period.is_some() || self.is_flat() { self.len() } else { self.len() - 1 }
    }

    /// Whether there is a cell of that number.
    pub(super) fn has(&self, cell: i64) -> bool {
        self.is_periodic() || self.is_flat() || (0..self.cells() as i64).contains(&cell)
    }

    /// The nodes at the ends of a cell.
    pub(super) fn ends(&self, cell: i64) -> [usize; 2] {
        let count = self.len() as i64;
        [cell.rem_euclid(count) as usize, (cell + 1).rem_euclid(count) as usize]
    }

    /// How long a cell is; 1 of an axis of one node.
    pub(super) fn width(&self, cell: i64) -> f64 {
        if self.is_flat() {
            return 1.0;
        }
        let [from, to] = self.ends(cell);
        match self.period.filter(|_| to == 0) {
            Some(period) => self.nodes[0] + period - self.nodes[from],
            None => self.nodes[to] - self.nodes[from],
        }
    }

    /// The place that is `share` of a cell behind its beginning.
    pub(super) fn place(&self, cell: i64, share: f64) -> f64 {
        if self.is_flat() {
            return self.start();
        }
        let laps = cell.div_euclid(self.cells() as i64) as f64;
        let start = self.nodes[self.ends(cell)[0]] + self.period.map_or(0.0, |period| laps * period);
        start + share * self.width(cell)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn axis(nodes: &[f64]) -> Axis {
        Axis::new(Path::new("a.npy"), "x", nodes.to_vec()).unwrap()
    }

    #[test]
    fn nodes_ascend_or_descend() {
        assert!(axis(&[3.0, 1.0, 0.0]).is_reversed());
        assert_eq!(axis(&[3.0, 1.0, 0.0]).place(1, 0.5), 2.0);
        for wrong in [&[0.0, 0.0][..], &[0.0, f64::NAN], &[f64::NEG_INFINITY, 0.0], &[0.0, 2.0, 1.0], &[]] {
            let told = Axis::new(Path::new("a.npy"), "x", wrong.to_vec()).unwrap_err().to_string();
            assert!(told.starts_with("a.npy: x: found others, expected finite"), "{told}");
        }
        let flat = axis(&[7.0]);
        assert_eq!(
            (flat.locate(1e9), flat.place(5, 0.3), flat.width(2), flat.ends(9)),
            (Some((0, 0.0)), 7.0, 1.0, [0, 0])
        );
    }

    #[test]
    fn boxes_stretch_nodes() {
        let mut depth = axis(&[0.0, -1.0, -4.0]);
        depth.within(-8.0, 0.0, false);
        assert_eq!([depth.place(0, 0.0), depth.place(1, 0.0), depth.end()], [-8.0, -2.0, 0.0]);
        let mut around = axis(&[0.0, 1.0, 2.0, 3.0]);
        around.within(2.0, 3.0, true);
        assert_eq!([around.start(), around.place(3, 0.0), around.end(), around.place(5, 0.5)], [2.0, 2.75, 3.0, 3.375]);
    }

    proptest! {
        /// A place is in the cell that it is found in, through all periods.
        #[test]
        fn places_are_found_again(
            steps in prop::collection::vec(0.01..10.0f64, 1..12), place in -200.0..200.0f64, is_periodic: bool,
        ) {
            let mut nodes = vec![-3.0];
            for step in steps {
                nodes.push(nodes[nodes.len() - 1] + step);
            }
            let mut axis = axis(&nodes);
            if is_periodic {
                axis.repeat();
            }
            match axis.locate(place) {
                Some((cell, share)) => {
                    prop_assert!(axis.has(cell) && (-1e-9..=1.0 + 1e-9).contains(&share), "{} {}", cell, share);
                    prop_assert!((axis.place(cell, share) - place).abs() < 1e-9);
                    prop_assert!((axis.place(cell, 1.0) - axis.place(cell + 1, 0.0)).abs() < 1e-9 || !axis.has(cell + 1));
                }
                None => prop_assert!(!is_periodic && (place < axis.start() || place > axis.end())),
            }
        }
    }
}
