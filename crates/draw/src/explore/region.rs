//! Regions: which particles are meant, by place, by values and by family. What a user draws, types or saves in a scene.

use super::error::ExploreError;
use super::lasso::Lasso;
use crate::model::{Bounds, FamilyName};
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Which particles are meant: those inside every shape, with values in every range, of one of the families. Without shapes,
/// ranges or families nothing is left out by place, value or family, so the default region is the whole data.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Region {
    /// Shapes that a particle must be inside of, all of them.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub shapes: Vec<Shape>,
    /// Ranges that its values must be in, all of them. A particle of a family without that field is outside.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub ranges: Vec<ValueRange>,
    /// The families it may be of; all where none is named.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub families: Vec<FamilyName>,
}

/// A part of space. Its surface belongs to it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum Shape {
    /// A ball. In a periodic box it goes on at the opposite face.
    Sphere {
        /// Its centre, world units.
        center: DVec3,
        /// Its radius, world units; positive.
        radius: f64,
    },
    /// An axis-aligned box. In a periodic box it goes on at the opposite face.
    Box {
        /// Smallest coordinates, world units.
        min: DVec3,
        /// Largest coordinates.
        max: DVec3,
    },
    /// Everything that is seen inside a polygon that was drawn on a picture.
    Lasso(Lasso),
}

/// A range of values of one field, ends included.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ValueRange {
    /// The field's name: `mass`, `density`, `smoothing-length` or an attribute; of a source also any other scalar field, `speed`,
    /// `velocity-x` and so on.
    pub field: String,
    /// Smallest value; none: no limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub min: Option<f64>,
    /// Largest value; none: no limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max: Option<f64>,
}

impl Region {
    /// All particles.
    pub fn whole() -> Region {
        Region::default()
    }

    /// A ball.
    pub fn sphere(center: DVec3, radius: f64) -> Region {
        Region::of(Shape::Sphere { center, radius })
    }

    /// An axis-aligned box.
    pub fn cuboid(min: DVec3, max: DVec3) -> Region {
        Region::of(Shape::Box { min, max })
    }

    /// What is seen inside a polygon.
    pub fn lasso(lasso: Lasso) -> Region {
        Region::of(Shape::Lasso(lasso))
    }

    /// Everything inside one shape.
    pub fn of(shape: Shape) -> Region {
        Region { shapes: vec![shape], ..Region::default() }
    }

    /// The same region, only where `field` is within `min..=max`.
    #[must_use]
    pub fn with_range(mut self, field: impl Into<String>, min: Option<f64>, max: Option<f64>) -> Region {
        self.ranges.push(ValueRange { field: field.into(), min, max });
        self
    }

    /// The same region, only of this family (and others that were named before).
    #[must_use]
    pub fn with_family(mut self, family: FamilyName) -> Region {
        self.families.push(family);
        self
    }

    /// Whether nothing is left out.
    pub fn is_whole(&self) -> bool {
        self.shapes.is_empty() && self.ranges.is_empty() && self.families.is_empty()
    }

    /// Whether the region leaves out particles of this family altogether.
    pub fn leaves_out(&self, family: FamilyName) -> bool {
        !self.families.is_empty() && !self.families.contains(&family)
    }

    /// The first sphere among the shapes: centre and radius.
    pub fn first_sphere(&self) -> Option<(DVec3, f64)> {
        self.shapes.iter().find_map(|shape| match shape {
            Shape::Sphere { center, radius } => Some((*center, *radius)),
            _ => None,
        })
    }

    /// The box around what spheres and boxes let through, for flights to the region; [`Bounds::EVERYTHING`] where there is
    /// neither.
    pub fn bounds(&self) -> Bounds {
        self.shapes.iter().fold(Bounds::EVERYTHING, |bounds, shape| {
            let own = match shape {
                Shape::Sphere { center, radius } => Bounds { min: *center - *radius, max: *center + *radius },
                Shape::Box { min, max } => Bounds { min: *min, max: *max },
                Shape::Lasso(_) => Bounds::EVERYTHING,
            };
            Bounds { min: bounds.min.max(own.min), max: bounds.max.min(own.max) }
        })
    }

    /// Looks whether every value makes sense.
    ///
    /// # Errors
    /// [`ExploreError::Value`] with the path of the field, its value and what it may be.
    pub fn check(&self) -> Result<(), ExploreError> {
        for (i, shape) in self.shapes.iter().enumerate() {
            shape.check(&format!("shapes[{i}]"))?;
        }
        for (i, range) in self.ranges.iter().enumerate() {
            let here = |name: &str| format!("ranges[{i}].{name}");
            if range.field.trim().is_empty() {
                return Err(ExploreError::value(here("field"), format!("{:?}", range.field), "the name of a field"));
            }
            let ends = [("min", range.min), ("max", range.max)];
            if let Some((name, Some(end))) = ends.into_iter().find(|(_, end)| end.is_some_and(|end| !end.is_finite())) {
                return Err(ExploreError::value(here(name), end, "a number, or nothing for no limit"));
            }
            if let (Some(min), Some(max)) = (range.min, range.max)
                && min > max
            {
                return Err(ExploreError::value(here("min"), min, format!("at most max, which is {max}")));
            }
        }
        Ok(())
    }
}

impl Shape {
    fn check(&self, place: &str) -> Result<(), ExploreError> {
        let finite = |name: &str, point: DVec3| {
            let wrong = || ExploreError::value(format!("{place}.{name}"), point, "three finite numbers");
            if point.is_finite() { Ok(()) } else { Err(wrong()) }
        };
        match self {
            Shape::Sphere { center, radius } => {
                finite("center", *center)?;
                if !(*radius > 0.0 && radius.is_finite()) {
                    return Err(ExploreError::value(format!("{place}.radius"), radius, "a positive length"));
                }
                Ok(())
            }
            Shape::Box { min, max } => {
                finite("min", *min)?;
                finite("max", *max)?;
                if min.cmpgt(*max).any() {
                    return Err(ExploreError::value(
                        format!("{place}.min"),
                        min,
                        format!("at most max, which is {max}"),
                    ));
                }
                Ok(())
            }
            Shape::Lasso(lasso) => lasso.check(place),
        }
    }
}

impl ValueRange {
    /// Whether a value is in the range; a value that is not a number is not.
    pub fn contains(&self, value: f64) -> bool {
        !value.is_nan() && self.min.is_none_or(|min| value >= min) && self.max.is_none_or(|max| value <= max)
    }
}

impl std::str::FromStr for ValueRange {
    type Err = String;

    /// `field:min..max`, either end may be left out.
    fn from_str(text: &str) -> Result<ValueRange, String> {
        let wrong = || "expected FIELD:MIN..MAX such as temperature:1e4..1e6 or density:10..".to_owned();
        let (field, range) = text.rsplit_once(':').ok_or_else(wrong)?;
        let (min, max) = range.split_once("..").ok_or_else(wrong)?;
        let end = |text: &str| match text.trim() {
            "" => Ok(None),
            text => text.parse().ok().filter(|value: &f64| value.is_finite()).map(Some).ok_or_else(wrong),
        };
        let range = ValueRange { field: field.trim().to_owned(), min: end(min)?, max: end(max)? };
        let sound = !range.field.is_empty() && !matches!((range.min, range.max), (Some(min), Some(max)) if min > max);
        if sound { Ok(range) } else { Err(wrong()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::ron_file;

    #[test]
    fn regions_are_read_and_written_as_ron() {
        let region = Region::sphere(DVec3::new(1.0, 2.0, 3.0), 4.5)
            .with_range("temperature", Some(1e4), None)
            .with_family(FamilyName::BlackHoles);
        let text = ron::to_string(&region).unwrap();
        assert_eq!(ron_file::parse::<Region>("r", &text).unwrap(), region);
        let short: Region =
            ron_file::parse("r", "(shapes: [Box(min: (0, 0, 0), max: (1, 2, 3))], families: [gas])").unwrap();
        assert_eq!(short, Region::cuboid(DVec3::ZERO, DVec3::new(1.0, 2.0, 3.0)).with_family(FamilyName::Gas));
        assert_eq!(ron_file::parse::<Region>("r", "()").unwrap(), Region::whole());
        for (wrong, name) in [
            ("(shape: [])", "shape"),
            ("(shapes: [Sphere(center: (0, 0, 0), radios: 1)])", "radios"),
            ("(ranges: [(field: \"mass\", mini: 1)])", "mini"),
            ("(families: [Gaz])", "Gaz"),
        ] {
            let message = ron_file::parse::<Region>("r", wrong).unwrap_err().to_string();
            assert!(message.contains(name), "{message}");
        }
    }

    #[test]
    fn values_that_make_no_sense_are_named() {
        for (region, field) in [
            (Region::sphere(DVec3::ZERO, 0.0), "shapes[0].radius"),
            (Region::sphere(DVec3::NAN, 1.0), "shapes[0].center"),
            (Region::cuboid(DVec3::ONE, DVec3::ZERO), "shapes[0].min"),
            (Region::whole().with_range("mass", Some(2.0), Some(1.0)), "ranges[0].min"),
            (Region::whole().with_range("", None, None), "ranges[0].field"),
            (Region::whole().with_range("mass", None, Some(f64::INFINITY)), "ranges[0].max"),
        ] {
            let message = region.check().unwrap_err().to_string();
            assert!(message.starts_with(field), "{message}");
        }
        assert!(Region::sphere(DVec3::ONE, 2.0).with_range("mass", Some(1.0), Some(1.0)).check().is_ok());
    }

    #[test]
    fn ranges_are_read_from_the_command_line() {
        let range: ValueRange = "temperature: 1e4 .. 1e6".parse().unwrap();
        assert_eq!(range, ValueRange { field: "temperature".into(), min: Some(1e4), max: Some(1e6) });
        assert!(range.contains(1e4) && range.contains(1e6) && !range.contains(2e6) && !range.contains(f64::NAN));
        let open: ValueRange = "density:10..".parse().unwrap();
        assert_eq!((open.min, open.max), (Some(10.0), None));
        for wrong in ["", "density", "density:1", ":1..2", "density:2..1", "density:a..b", "density:nan.."] {
            assert!(wrong.parse::<ValueRange>().is_err(), "{wrong}");
        }
    }
}
