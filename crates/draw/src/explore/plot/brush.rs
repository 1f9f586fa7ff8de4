//! From a part of a plot to the particles whose values are in it, and back.

use super::Plot;
use crate::explore::region::{Region, Shape, ValueRange};
use glam::DVec3;

/// A part of a plot, in values along its axes; ascending, both ends belong to it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// From where to where to the right.
    pub across: [f64; 2],
    /// From where to where upwards; `None` in plots of one axis.
    pub up: Option<[f64; 2]>,
}

impl Plot {
    /// The fields of whose values parts are made; none of a profile, whose parts are balls.
    fn brushed_fields(&self) -> Vec<&str> {
        match self {
            Plot::Binned(found) => found.axes.iter().map(|axis| axis.field.as_str()).collect(),
            Plot::Scatter { fields, .. } => fields.iter().map(|axis| axis.field.as_str()).collect(),
            Plot::Radial(_) => Vec::new(),
        }
    }

    /// Whether parts have two ends upwards, too.
    pub fn has_flat_parts(&self) -> bool {
        self.brushed_fields().len() > 1
    }

    /// The particles of a region whose values are in a part of the plot. In a profile those within the larger radius: regions have no holes.
    pub fn brushed(&self, of: &Region, part: &Part) -> Region {
        let mut region = of.clone();
        if let Plot::Radial(found) = self {
            let sphere = Shape::Sphere { center: DVec3::from(found.center), radius: part.across[1] };
            region.shapes.insert(0, sphere);
        }
        for (field, [low, high]) in
            self.brushed_fields().into_iter().zip([Some(part.across), part.up].into_iter().flatten())
        {
            region = region.with_range(field, Some(low), Some(high));
        }
        region
    }

    /// The part of the plot that a region of [`Plot::brushed`] is of; `None` where it is of none.
    pub fn part_of(&self, brushed: &Region) -> Option<Part> {
        if let Plot::Radial(found) = self {
            let (center, radius) = brushed.first_sphere()?;
            return (center == DVec3::from(found.center)).then_some(Part { across: [0.0, radius], up: None });
        }
        let fields = self.brushed_fields();
        let last = brushed.ranges.get(brushed.ranges.len().checked_sub(fields.len())?..)?;
        let ends =
            |(field, range): (&str, &ValueRange)| Some([range.min?, range.max?]).filter(|_| range.field == field);
        let ends: Vec<[f64; 2]> = fields.into_iter().zip(last).map(ends).collect::<Option<_>>()?;
        Some(Part { across: *ends.first()?, up: ends.get(1).copied() })
    }
}

#[cfg(test)]
mod tests {
    use super::super::ScatterAxis;
    use super::*;
    use crate::explore::binned::{Binned, Weight};
    use crate::explore::histogram::Axis;
    use crate::explore::radial::Radial;
    use crate::model::{FamilyName, Unit};
    use proptest::prelude::*;

    fn histogram(fields: &[&str]) -> Plot {
        let axis = |field: &&str| Axis {
            field: (*field).to_owned(),
            unit: Unit::default(),
            logarithmic: false,
            min: -1.0,
            max: 1.0,
            bins: 1,
        };
        Plot::Binned(Binned {
            axes: fields.iter().map(axis).collect(),
            weight: Weight::Mass,
            weight_unit: Unit::default(),
            weights: vec![1.0],
            counts: vec![1],
            total: 1.0,
            count: 1,
            not_positive: 0,
            outside: 0,
            missing: 0,
            exact: true,
            error: None,
            estimate: None,
        })
    }

    fn scatter() -> Plot {
        let fields = ["a", "b"].map(|field| ScatterAxis { field: field.to_owned(), unit: Unit::default() });
        Plot::Scatter { fields, x: vec![0.0], y: vec![0.0], of: 1, exact: true, estimate: None }
    }

    fn profile() -> Plot {
        Plot::Radial(Radial {
            center: [1.0, 2.0, 3.0],
            length_unit: Unit::default(),
            mass_unit: Unit::default(),
            field: None,
            field_unit: Unit::default(),
            shells: Vec::new(),
            count: 0,
            mass: 0.0,
            exact: true,
            error: None,
            estimate: None,
        })
    }

    proptest! {
        #[test]
        fn what_is_brushed_has_values_in_the_part_and_tells_the_part(
            ends in prop::array::uniform4(-2.0..2.0f64), values in prop::array::uniform2(-2.0..2.0f64),
            earlier in prop::option::of(-2.0..0.0f64),
        ) {
            let [a, b, c, d] = ends;
            let pair = |a: f64, b: f64| [a.min(b), a.max(b)];
            let of = Region::whole().with_family(FamilyName::Gas);
            let of = match earlier {
                Some(low) => of.with_range("a", Some(low), None),
                None => of,
            };
            let is_in = |region: &Region| region.ranges.iter().all(|range| {
                range.contains(values[usize::from(range.field == "b")])
            });
            let holds = |ends: [f64; 2], value: f64| ends[0] <= value && value <= ends[1];
            let was_in = earlier.is_none_or(|low| low <= values[0]);
            for plot in [histogram(&["a"]), histogram(&["a", "b"]), scatter()] {
                let part = Part { across: pair(a, b), up: plot.has_flat_parts().then_some(pair(c, d)) };
                let region = plot.brushed(&of, &part);
                prop_assert!(region.check().is_ok() && region.families == of.families);
                let expected = was_in && holds(part.across, values[0]) && part.up.is_none_or(|up| holds(up, values[1]));
                prop_assert_eq!(is_in(&region), expected);
                prop_assert_eq!(plot.part_of(&region), Some(part));
            }
        }

        #[test]
        fn a_part_of_a_profile_is_a_ball(radius in 1e-3..1e3f64) {
            let part = Part { across: [0.0, radius], up: None };
            let region = profile().brushed(&Region::sphere(DVec3::ZERO, 1e4), &part);
            prop_assert_eq!((region.shapes.len(), region.first_sphere()), (2, Some((DVec3::new(1.0, 2.0, 3.0), radius))));
            prop_assert_eq!(profile().part_of(&region), Some(part));
        }
    }

    #[test]
    fn regions_of_other_plots_are_no_parts() {
        let of = Region::whole();
        let part = Part { across: [0.0, 0.5], up: None };
        let brushed = histogram(&["c"]).brushed(&of, &part);
        assert_eq!(histogram(&["a"]).part_of(&brushed), None);
        assert_eq!(histogram(&["a", "c"]).part_of(&brushed), None, "of two ranges one is there");
        assert_eq!(profile().part_of(&brushed), None);
        assert_eq!(histogram(&["a"]).part_of(&of.with_range("a", Some(0.0), None)), None, "an end is open");
    }
}
