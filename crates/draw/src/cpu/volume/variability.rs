//! By how much what a transfer function shows differs between two values (WM03 section 4.5): where that is little over all the values below a
//! node, one point shows them all.

use super::classify::{Classifier, VALUES};
use crate::cpu::field::ValueAxis;

/// Classes of values.
const CLASSES: usize = 256;

/// The variability of a transfer function over every range of values.
#[derive(Clone, Debug, PartialEq)]
pub struct Variability {
    axis: ValueAxis,
    /// For each class of lowest values, each class of highest ones: a square, the lower half of which is empty.
    table: Vec<f32>,
}

impl Variability {
    /// Of a classifier of values on an axis. Colours that follow an attribute as well vary without bound.
    pub fn new(classifier: &Classifier, axis: ValueAxis) -> Variability {
        let tables = classifier.tables();
        let unit = classifier.levels().unit_length as f32;
        let seen = |entry: &[f32; 4]| {
            let opacity = 1.0 - (-entry[0] * unit).exp();
            [opacity, opacity * entry[1], opacity * entry[2], opacity * entry[3]]
        };
        let wide = VALUES / CLASSES;
        let ends = |class: usize| {
            // Between two entries what is seen lies between what they show.
            let entries = tables.densities.iter().skip(class * wide).take(wide + 1).map(seen);
            entries.fold([[f32::INFINITY; 4], [f32::NEG_INFINITY; 4]], |[low, high], seen| {
                [std::array::from_fn(|k| low[k].min(seen[k])), std::array::from_fn(|k| high[k].max(seen[k]))]
            })
        };
        let classes: Vec<[[f32; 4]; 2]> = (0..CLASSES).map(ends).collect();
        let mut table = vec![f32::INFINITY; CLASSES * CLASSES];
        for first in (0..CLASSES).filter(|_| !classifier.has_hues()) {
            let [mut low, mut high] = classes[first];
            for last in first..CLASSES {
                for k in 0..4 {
                    low[k] = low[k].min(classes[last][0][k]);
                    high[k] = high[k].max(classes[last][1][k]);
                }
                table[first * CLASSES + last] = 255.0 * (0..4).map(|k| high[k] - low[k]).fold(0.0, f32::max);
            }
        }
        Variability { axis, table }
    }

    /// By how much opacities of a unit length, and light by them, differ at most between values of a range, of 255.
    #[inline]
    pub fn over(&self, [low, high]: [f32; 2]) -> f32 {
        let class = |value: f32| (((self.axis.place(value) - 1.0) * CLASSES as f32) as usize).min(CLASSES - 1);
        self.table[class(low) * CLASSES + class(high)]
    }
}

#[cfg(test)]
mod tests {
    use super::super::VolumeLevels;
    use super::*;
    use crate::color::transfer::{Scale, TransferFunction};

    #[test]
    fn what_is_flat_does_not_vary_and_what_is_steep_does() {
        let text = "(scale: linear, color_map: [(0.0, \"#204080\"), (0.46, \"#204080\"), (0.48, \"#ffa020\"), (1.0, \"#ffa020\")], \
                    opacity: [(0.0, 0.1), (1.0, 0.1)], brightness: [(0.0, 1.0), (1.0, 1.0)])";
        let transfer = TransferFunction::parse(text, "t").unwrap();
        let levels = VolumeLevels { density: [-100.0, 155.0], attribute: [0.0, 1.0], unit_length: 1.0 };
        let axis = ValueAxis::new(Scale::Linear, [-100.0, 155.0]);
        let variability = Variability::new(&Classifier::of_values(&transfer, levels, false, &axis), axis);
        assert!(variability.over([-90.0, 10.0]) < 0.01 && variability.over([30.0, 150.0]) < 0.01);
        // An opacity of 0.1 times the difference of the two colours' red light.
        assert!((variability.over([0.0, 40.0]) - 25.1).abs() < 0.5, "{}", variability.over([0.0, 40.0]));
    }
}
