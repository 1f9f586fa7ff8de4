//! Selections with a name and a colour, as the window shows and scene files keep them.

use super::error::ExploreError;
use super::ids::IdSet;
use super::region::Region;
use crate::model::When;
use serde::{Deserialize, Serialize};

/// A named, coloured selection.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SelectionSet {
    /// What the user calls it.
    pub name: String,
    /// Its colour, `#rrggbb`.
    #[serde(default = "first_color")]
    pub color: String,
    /// Which particles belong to it.
    pub members: Members,
    /// How it is shown.
    #[serde(default)]
    pub show: Show,
    /// Whether the window's camera follows its centre of mass; of one set at most.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub follow: bool,
}

/// Which particles belong to a selection.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub enum Members {
    /// Those in a region, wherever they come from.
    Region(Region),
    /// Those with these ids, wherever they go.
    Ids(IdSet),
    /// Those that are in a region of a run at a time, wherever they are at others.
    Tracked {
        /// The time.
        at: When,
        /// The region.
        region: Region,
    },
}

impl Members {
    /// The ids, where it is given by ids.
    pub fn ids(&self) -> Option<&IdSet> {
        match self {
            Members::Ids(ids) => Some(ids),
            Members::Region(_) | Members::Tracked { .. } => None,
        }
    }

    /// The region that they are in, now or at their time.
    pub fn region(&self) -> Option<&Region> {
        match self {
            Members::Region(region) | Members::Tracked { region, .. } => Some(region),
            Members::Ids(_) => None,
        }
    }

    /// Whether they are the same particles at all times.
    pub fn stay(&self) -> bool {
        !matches!(self, Members::Region(_))
    }

    /// Whether only version 2 of files can say them.
    pub fn are_timed(&self) -> bool {
        matches!(self, Members::Tracked { .. })
    }
}

/// How a selection is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Show {
    /// Like everything else.
    Hidden,
    /// In its colour.
    #[default]
    Highlighted,
    /// In its colour, and nothing that is in no set shown alone.
    Alone,
}

/// Colours of new sets, told apart by people with any colour vision (Okabe and Ito's palette, without black).
pub const COLORS: [&str; 7] = ["#56b4e9", "#009e73", "#f0e442", "#e69f00", "#cc79a7", "#0072b2", "#d55e00"];

fn first_color() -> String {
    COLORS[0].to_owned()
}

impl SelectionSet {
    /// A highlighted set of the particles in a region, in the colour of the set number `number`.
    pub fn new(name: impl Into<String>, region: Region, number: usize) -> SelectionSet {
        let color = COLORS[number % COLORS.len()].to_owned();
        SelectionSet {
            name: name.into(),
            color,
            members: Members::Region(region),
            show: Show::Highlighted,
            follow: false,
        }
    }

    /// Its colour, sRGB; `None` if it is not written as `#rrggbb`.
    pub fn rgb(&self) -> Option<[u8; 3]> {
        let digits = self.color.strip_prefix('#').filter(|digits| digits.len() == 6 && digits.is_ascii())?;
        let part = |at: usize| u8::from_str_radix(digits.get(at..at + 2)?, 16).ok();
        Some([part(0)?, part(2)?, part(4)?])
    }

    /// Looks whether every value makes sense.
    ///
    /// # Errors
    /// [`ExploreError::Value`] with the field, its value and what it may be.
    pub fn check(&self) -> Result<(), ExploreError> {
        if self.name.trim().is_empty() {
            return Err(ExploreError::value("name", format!("{:?}", self.name), "a name"));
        }
        if self.rgb().is_none() {
            return Err(ExploreError::value("color", &self.color, "a colour such as #e69f00"));
        }
        match &self.members {
            Members::Region(region) | Members::Tracked { region, .. } => region.check(),
            Members::Ids(_) => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::ron_file;
    use glam::DVec3;

    #[test]
    fn the_examples_of_the_documentation_are_read() {
        let text = include_str!("../../../../docs/regions.md");
        let mut blocks = text.split("```ron\n").skip(1).map(|block| block.split("```").next().unwrap());
        let region: Region = ron_file::parse("regions.md", blocks.next().unwrap()).unwrap();
        region.check().unwrap();
        assert_eq!((region.shapes.len(), region.ranges.len(), region.families.len()), (3, 2, 1));
        let sets: Vec<SelectionSet> =
            blocks.next().unwrap().lines().map(|line| ron_file::parse("regions.md", line).unwrap()).collect();
        sets.iter().for_each(|set| set.check().unwrap());
        assert!(matches!(&sets[1].members, Members::Ids(ids) if ids.contains(2099) && ids.contains(1 << 60)));
        assert!(
            matches!(&sets[2].members, Members::Tracked { at: When::Time(9.6), region } if region.shapes.len() == 1)
        );
        assert_eq!(blocks.next(), None);
    }

    #[test]
    fn sets_are_read_and_written_as_ron() {
        let set = SelectionSet::new("halo", Region::sphere(DVec3::ONE, 2.0), 7);
        assert_eq!((set.rgb(), set.color.as_str()), (Some([0x56, 0xb4, 0xe9]), "#56b4e9"));
        let ids = SelectionSet { members: Members::Ids(IdSet::new(vec![3, 4, 5, 9, u64::MAX])), ..set.clone() };
        let all = [When::Time(-0.5), When::Step(3), When::Redshift(0.1), When::ScaleFactor(0.4), When::Last];
        let tracked = all.map(|at| {
            let members = Members::Tracked { at, region: Region::sphere(DVec3::X, 0.1) };
            SelectionSet { members, ..set.clone() }
        });
        for set in [set, SelectionSet { show: Show::Alone, ..ids }].into_iter().chain(tracked) {
            let text = ron::ser::to_string_pretty(&set, ron::ser::PrettyConfig::default()).unwrap();
            assert_eq!(ron_file::parse::<SelectionSet>("s", &text).unwrap(), set, "{text}");
            set.check().unwrap();
        }
        let short: SelectionSet = ron_file::parse("s", "(name: \"a\", members: Region(()))").unwrap();
        assert_eq!(short, SelectionSet::new("a", Region::whole(), 0));
        for (wrong, name) in [
            ("(name: \"a\", members: Region(()), colour: \"#000000\")", "colour"),
            ("(name: \"a\", members: Ids(\"5-3\"))", "5-3"),
            ("(name: \"a\", members: Tracked(at: soon, region: ()))", "soon"),
            ("(name: \"a\", members: Tracked(region: ()))", "at"),
            ("(name: \"a\", members: Tracked(at: last, region: (), until: 3.0))", "until"),
        ] {
            let message = ron_file::parse::<SelectionSet>("s", wrong).unwrap_err().to_string();
            assert!(message.contains(name), "{message}");
        }
        for color in ["e69f00", "#e69f0", "#e69f0g", "#é9f00", ""] {
            let set = SelectionSet { color: color.into(), ..short.clone() };
            assert!(set.check().unwrap_err().to_string().starts_with("color"), "{color}");
        }
    }
}
