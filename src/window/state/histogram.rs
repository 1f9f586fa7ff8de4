//! How often values occur in the picture, over an axis that is linear or logarithmic.

/// How often values occur, over an axis that is linear or logarithmic.
#[derive(Clone, Debug, PartialEq)]
pub struct AxisHistogram {
    /// Counts of equally wide bins along the axis.
    pub counts: Vec<f64>,
    /// The axis' ends, in values.
    pub span: [f64; 2],
    /// Whether the axis is logarithmic; both ends are positive then.
    pub log: bool,
}

impl AxisHistogram {
    /// Position of a value along the axis: 0 at the left end, 1 at the right one.
    pub fn position(&self, value: f64) -> f64 {
        let [a, b] = self.span.map(|end| self.scale(end));
        let x = self.scale(value);
        if b > a { (x - a) / (b - a) } else { 0.5 }
    }

    /// The value at a position along the axis.
    pub fn value(&self, position: f64) -> f64 {
        let [a, b] = self.span.map(|end| self.scale(end));
        let x = a + (b - a) * position;
        if self.log { 10f64.powf(x) } else { x }
    }

    /// This histogram's axis with the counts of `other`, which covers a part of it.
    pub fn spread_from(mut self, other: &AxisHistogram) -> AxisHistogram {
        let bins = self.counts.len() as f64;
        let mut counts = vec![0.0; self.counts.len()];
        for (i, count) in other.counts.iter().enumerate() {
            let middle = other.value((i as f64 + 0.5) / other.counts.len() as f64);
            let bin = (self.position(middle) * bins) as usize;
            if let Some(total) = counts.get_mut(bin) {
                *total += count;
            }
        }
        self.counts = counts;
        self
    }

    fn scale(&self, value: f64) -> f64 {
        if self.log { value.max(f64::MIN_POSITIVE).log10() } else { value }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_and_values_are_inverse() {
        for log in [false, true] {
            let histogram = AxisHistogram { counts: vec![1.0; 8], span: [1e-3, 1e5], log };
            for position in [0.0, 0.3, 0.77, 1.0] {
                let value = histogram.value(position);
                assert!((histogram.position(value) - position).abs() < 1e-9, "{log} {position}");
            }
        }
    }

    #[test]
    fn a_wider_axis_keeps_the_counts() {
        let narrow = AxisHistogram { counts: vec![1.0, 2.0, 3.0, 4.0], span: [1.0, 100.0], log: true };
        let wide = AxisHistogram { span: [0.01, 1e4], ..narrow.clone() }.spread_from(&narrow);
        assert_eq!(wide.counts.iter().sum::<f64>(), 10.0);
        assert_eq!(wide.counts[0], 0.0);
    }
}
