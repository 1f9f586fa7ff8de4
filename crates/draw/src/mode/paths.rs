//! Settings of pathlines, which are a layer of every mode: described once, as those of modes are, for RON, the panel and the manual.

pub use crate::cpu::paths::PathShape;

use super::Mode;
use super::setting::{Setting, SettingError, SettingKind, SettingValue, parse_color};
use glam::DVec3;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// How much before the present time is drawn.
pub static TAIL: Setting = Setting {
    name: "tail",
    unit: "steps",
    kind: SettingKind::Number { min: 0.0, max: 10_000.0, default: 2.0 },
    help: "how much before the present time is drawn, fading; also a time of the run's clock such as \"2.5tau\"",
};
/// How much after it.
pub static LEAD: Setting = Setting {
    name: "lead",
    unit: "steps",
    kind: SettingKind::Number { min: 0.0, max: 10_000.0, default: 0.0 },
    help: "how much after the present time is drawn, fading; also a time of the run's clock such as \"2.5tau\"",
};
/// Which flow level is drawn.
pub static SPACING: Setting = Setting {
    name: "spacing",
    unit: "px",
    kind: SettingKind::Number { min: 0.25, max: 1000.0, default: 12.0 },
    help: "how far in the picture a particle may be from the path that stands for it: chooses the flow level, path by path",
};
/// A fixed flow level.
pub static LEVEL: Setting = Setting {
    name: "level",
    unit: "",
    kind: SettingKind::Number { min: 0.0, max: 64.0, default: 0.0 },
    help: "draws this flow level whatever the spacing, 0: the particles' own paths",
};
/// What a path looks like.
pub static SHAPE: Setting = Setting {
    name: "shape",
    unit: "",
    kind: SettingKind::Choice { options: &["comet", "line", "tube", "arrow"] },
    help: "comet: a ball with a tail; line; tube: lit; arrow: a line with a head",
};
/// How wide it is.
pub static WIDTH: Setting = Setting {
    name: "width",
    unit: "px",
    kind: SettingKind::Number { min: 0.05, max: 200.0, default: 3.0 },
    help: "width of a path of mean mass: its square grows with the mass; below a pixel paths become fainter instead",
};
/// The largest width.
pub static WIDEST: Setting = Setting {
    name: "widest",
    unit: "% of the height",
    kind: SettingKind::Number { min: 0.01, max: 100.0, default: 2.0 },
    help: "no path is wider than this share of the picture's height",
};
/// The least cluster.
pub static LEAST: Setting = Setting {
    name: "least",
    unit: "particles",
    kind: SettingKind::Number { min: 1.0, max: 1e15, default: 1.0 },
    help: "paths of fewer particles are left out",
};
/// How opaque paths are.
pub static OPACITY: Setting = Setting {
    name: "opacity",
    unit: "",
    kind: SettingKind::Number { min: 0.0, max: 1.0, default: 1.0 },
    help: "opacity of a path where it does not fade",
};
/// The dark rim.
pub static HALO: Setting = Setting {
    name: "halo",
    unit: "px",
    kind: SettingKind::Number { min: 0.0, max: 20.0, default: 1.0 },
    help: "width of the dark rim on both sides, which tells paths apart that cross",
};
/// Whether paths leave a periodic box.
pub static UNWRAPPED: Setting = Setting {
    name: "unwrapped",
    unit: "",
    kind: SettingKind::Flag { default: false },
    help: "in a periodic box each interval's path is drawn in one piece, beyond its faces, instead of cut there",
};
/// Highlights that run along.
pub static RUN: Setting = Setting {
    name: "run",
    unit: "intervals/s",
    kind: SettingKind::Number { min: -1000.0, max: 1000.0, default: 0.0 },
    help: "highlights run along paths, so many intervals in a second of a tour; 0: none",
};
/// Where highlights are.
pub static PHASE: Setting = Setting {
    name: "phase",
    unit: "intervals",
    kind: SettingKind::Number { min: -1e9, max: 1e9, default: 0.0 },
    help: "where the highlights are: so far behind each step of the run",
};

/// The settings that have a range or a list of names; `of`, `focus` and `color` are words of their own.
pub static SETTINGS: [&Setting; 13] =
    [&TAIL, &LEAD, &SPACING, &LEVEL, &SHAPE, &WIDTH, &WIDEST, &LEAST, &OPACITY, &HALO, &UNWRAPPED, &RUN, &PHASE];

/// What `of`, `focus` and `color` take, for the manual.
pub const WORDS: [(&str, &str); 3] = [
    ("of", "whose paths are drawn: all, none, or names of selections (default none; in the mode paths all)"),
    ("focus", "ball(center: (x, y, z), radius: r) or selection(\"name\"): in there spacing is 2 px (default none)"),
    ("color", "speed, direction, mass, time, an attribute, or a colour like \"#ff8000\" (default speed)"),
];

/// Whose paths are drawn.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum PathsOf {
    /// Nobody's.
    #[default]
    None,
    /// Those of all particles.
    All,
    /// Those of the particles in selections of the look, by name.
    Selections(Vec<String>),
}

impl std::str::FromStr for PathsOf {
    type Err = String;

    /// As on the command line: `all`, `none` or the name of a selection.
    fn from_str(text: &str) -> Result<PathsOf, String> {
        match text.trim() {
            "" => Err("expected all, none or the name of a selection".into()),
            "all" => Ok(PathsOf::All),
            "none" => Ok(PathsOf::None),
            name => Ok(PathsOf::Selections(vec![name.to_owned()])),
        }
    }
}

impl Serialize for PathsOf {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            PathsOf::None => serializer.serialize_unit_variant("PathsOf", 0, "none"),
            PathsOf::All => serializer.serialize_unit_variant("PathsOf", 1, "all"),
            PathsOf::Selections(names) => names.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for PathsOf {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<PathsOf, D::Error> {
        // A word or texts: RON tells them apart only by their text.
        let raw = <&ron::value::RawValue>::deserialize(deserializer)?;
        let text = raw.get_ron().trim();
        match text {
            "all" => return Ok(PathsOf::All),
            "none" => return Ok(PathsOf::None),
            _ => {}
        }
        let names = ron::from_str::<Vec<String>>(text);
        match names {
            Ok(names) if names.iter().all(|name| !name.trim().is_empty()) => Ok(PathsOf::Selections(names)),
            _ => {
                let found = serde::de::Unexpected::Other(text);
                Err(serde::de::Error::invalid_value(found, &"all, none, or names of selections such as [\"halo\"]"))
            }
        }
    }
}

/// A part of a run's time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "SettingValue", into = "SettingValue")]
pub enum Span {
    /// Intervals between steps.
    Steps(f64),
    /// In the unit of the run's clock.
    Clock(f64),
}

impl TryFrom<SettingValue> for Span {
    type Error = String;

    fn try_from(value: SettingValue) -> Result<Span, String> {
        let number = match &value {
            SettingValue::Number(steps) => Some(Span::Steps(*steps)),
            SettingValue::Name(text) => {
                text.trim().strip_suffix("tau").and_then(|number| number.trim().parse().ok()).map(Span::Clock)
            }
            _ => None,
        };
        let found = number.filter(|span| span.number().is_finite() && span.number() >= 0.0);
        found.ok_or_else(|| format!("found {value}, expected a number of steps, or a time such as \"2.5tau\""))
    }
}

impl From<Span> for SettingValue {
    fn from(span: Span) -> SettingValue {
        match span {
            Span::Steps(steps) => SettingValue::Number(steps),
            Span::Clock(time) => SettingValue::Name(format!("{time}tau")),
        }
    }
}

impl Span {
    /// How many, of whatever.
    pub fn number(self) -> f64 {
        match self {
            Span::Steps(number) | Span::Clock(number) => number,
        }
    }
}

/// Where paths are drawn more finely than elsewhere.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Focus {
    /// A ball.
    Ball {
        /// Its centre, world units.
        center: DVec3,
        /// Its radius.
        radius: f64,
    },
    /// The ball around a selection by its name: the first sphere of its region, or around where its particles are.
    Selection(String),
}

/// What the colour of a path follows.
#[derive(Clone, Debug, PartialEq)]
pub enum PathColor {
    /// How fast it goes.
    Speed,
    /// Where it goes.
    Direction,
    /// Its mass.
    Mass,
    /// When it is there.
    Time,
    /// An attribute by its name.
    Attribute(String),
    /// One colour, gamma-encoded sRGB.
    Plain([f32; 3]),
}

/// Pathlines, as a layer of a picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PathSettings {
    /// Whose; the mode's choice where it says nothing: nobody's, in the mode `paths` everybody's.
    pub of: Option<PathsOf>,
    /// How much before the present time.
    pub tail: Span,
    /// How much after it.
    pub lead: Span,
    /// How far a particle may be from the path that stands for it, pixels.
    pub spacing: f64,
    /// A fixed flow level; chosen by `spacing` where it is `None`.
    pub level: Option<u32>,
    /// Where spacing is [`FOCUS_SPACING`].
    pub focus: Option<Focus>,
    /// What a path looks like.
    pub shape: PathShape,
    /// Width of a path of mean mass, pixels.
    pub width: f64,
    /// The largest width, hundredths of the picture's height.
    pub widest: f64,
    /// Paths of fewer particles are left out.
    pub least: f64,
    /// What its colour follows: [`PathSettings::colored_by`].
    pub color: String,
    /// Opacity.
    pub opacity: f64,
    /// Width of the dark rim, pixels.
    pub halo: f64,
    /// Whether paths go on beyond the faces of a periodic box.
    pub unwrapped: bool,
    /// Highlights run so many intervals in a second of a tour.
    pub run: f64,
    /// Where they are, intervals behind each step.
    pub phase: f64,
}

/// Spacing in the focus, pixels.
pub const FOCUS_SPACING: f64 = 2.0;

impl Default for PathSettings {
    fn default() -> PathSettings {
        let number = |setting: &Setting| match setting.kind {
            SettingKind::Number { default, .. } => default,
            _ => 0.0,
        };
        PathSettings {
            of: None,
            tail: Span::Steps(number(&TAIL)),
            lead: Span::Steps(number(&LEAD)),
            spacing: number(&SPACING),
            level: None,
            focus: None,
            shape: PathShape::default(),
            width: number(&WIDTH),
            widest: number(&WIDEST),
            least: number(&LEAST),
            color: "speed".into(),
            opacity: number(&OPACITY),
            halo: number(&HALO),
            unwrapped: false,
            run: number(&RUN),
            phase: number(&PHASE),
        }
    }
}

impl PathSettings {
    /// Whose paths are drawn in a picture of a mode.
    pub fn whose(&self, mode: &Mode) -> PathsOf {
        self.of.clone().unwrap_or(if mode.is_of_paths() { PathsOf::All } else { PathsOf::None })
    }

    /// The value of one of [`SETTINGS`]; `None` where none is chosen.
    pub fn value(&self, setting: &Setting) -> Option<SettingValue> {
        Some(match setting.name {
            "tail" => self.tail.into(),
            "lead" => self.lead.into(),
            "level" => SettingValue::Number(f64::from(self.level?)),
            "shape" => SettingValue::Name(self.shape.name().into()),
            "unwrapped" => SettingValue::Flag(self.unwrapped),
            name => SettingValue::Number(*self.number(name)?),
        })
    }

    /// Sets one of [`SETTINGS`].
    ///
    /// # Errors
    /// [`SettingError::Value`] where it does not take the value.
    pub fn set(&mut self, setting: &Setting, value: &SettingValue) -> Result<(), SettingError> {
        let mut changed = self.clone();
        let span = |value: &SettingValue| Span::try_from(value.clone()).ok();
        match (setting.name, value) {
            ("tail", value) if span(value).is_some() => changed.tail = span(value).unwrap_or(changed.tail),
            ("lead", value) if span(value).is_some() => changed.lead = span(value).unwrap_or(changed.lead),
            ("level", SettingValue::Number(level)) => changed.level = Some(*level as u32),
            ("unwrapped", SettingValue::Flag(unwrapped)) => changed.unwrapped = *unwrapped,
            ("shape", SettingValue::Name(name)) => {
                setting.check(value)?;
                changed.shape = PathShape::ALL.into_iter().find(|shape| shape.name() == name).unwrap_or_default();
            }
            (name, SettingValue::Number(number)) => match changed.number_mut(name) {
                Some(own) => *own = *number,
                None => setting.check(value)?,
            },
            (_, value) => setting.check(value)?,
        }
        changed.check_setting(setting)?;
        *self = changed;
        Ok(())
    }

    fn number(&self, name: &str) -> Option<&f64> {
        Some(match name {
            "spacing" => &self.spacing,
            "width" => &self.width,
            "widest" => &self.widest,
            "least" => &self.least,
            "opacity" => &self.opacity,
            "halo" => &self.halo,
            "run" => &self.run,
            "phase" => &self.phase,
            _ => return None,
        })
    }

    fn number_mut(&mut self, name: &str) -> Option<&mut f64> {
        Some(match name {
            "spacing" => &mut self.spacing,
            "width" => &mut self.width,
            "widest" => &mut self.widest,
            "least" => &mut self.least,
            "opacity" => &mut self.opacity,
            "halo" => &mut self.halo,
            "run" => &mut self.run,
            "phase" => &mut self.phase,
            _ => return None,
        })
    }

    fn check_setting(&self, setting: &Setting) -> Result<(), SettingError> {
        match self.value(setting) {
            // The clock's unit is the run's own.
            Some(SettingValue::Name(_)) if [TAIL.name, LEAD.name].contains(&setting.name) => Ok(()),
            Some(value) => setting.check(&value),
            None => Ok(()),
        }
    }

    /// Whether every value makes sense.
    ///
    /// # Errors
    /// [`SettingError::Value`] for the first that does not.
    pub fn check(&self) -> Result<(), SettingError> {
        SETTINGS.iter().try_for_each(|setting| self.check_setting(setting))?;
        let wrong =
            |name, found: String, expected: &str| SettingError::Value { name, found, expected: expected.into() };
        if self.color.trim().is_empty() || (self.color.starts_with('#') && parse_color(&self.color).is_none()) {
            let expected = "speed, direction, mass, time, an attribute, or a colour like \"#ff8000\"";
            return Err(wrong("color", self.color.clone(), expected));
        }
        if let Some(Focus::Ball { center, radius }) = &self.focus
            && !(center.is_finite() && radius.is_finite() && *radius > 0.0)
        {
            return Err(wrong(
                "focus",
                format!("{center}, {radius}"),
                "a ball with a finite centre and a positive radius",
            ));
        }
        Ok(())
    }

    /// What its colour follows.
    pub fn colored_by(&self) -> PathColor {
        match self.color.trim() {
            "speed" => PathColor::Speed,
            "direction" => PathColor::Direction,
            "mass" => PathColor::Mass,
            "time" => PathColor::Time,
            name => match parse_color(name) {
                Some(color) => PathColor::Plain(color),
                None => PathColor::Attribute(name.into()),
            },
        }
    }

    /// Between two, at a share of the way: numbers are between theirs, what is no number is as in the first.
    pub fn mixed(&self, last: &PathSettings, share: f64) -> PathSettings {
        let span = |a: Span, b: Span| match (a, b) {
            (Span::Steps(a), Span::Steps(b)) => Span::Steps(a + (b - a) * share),
            (Span::Clock(a), Span::Clock(b)) => Span::Clock(a + (b - a) * share),
            (a, _) => a,
        };
        let mut mixed =
            PathSettings { tail: span(self.tail, last.tail), lead: span(self.lead, last.lead), ..self.clone() };
        for setting in SETTINGS {
            if let (Some(own), Some(a), Some(b)) =
                (mixed.number_mut(setting.name), self.number(setting.name), last.number(setting.name))
            {
                *own = a + (b - a) * share;
            }
        }
        mixed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<PathSettings, String> {
        let options = ron::Options::default().with_default_extension(ron::extensions::Extensions::IMPLICIT_SOME);
        let read: PathSettings = options.from_str(text).map_err(|error| error.to_string())?;
        read.check().map_err(|error| error.to_string()).map(|()| read)
    }

    #[test]
    fn settings_are_read_and_written_as_ron() {
        let all = PathSettings {
            of: Some(PathsOf::Selections(vec!["halo".into(), "a \"b\"".into()])),
            tail: Span::Clock(2.5),
            lead: Span::Steps(0.5),
            level: Some(3),
            focus: Some(Focus::Ball { center: DVec3::new(1.0, -2.0, 0.5), radius: 3.0 }),
            shape: PathShape::Arrow,
            color: "#ff8000".into(),
            opacity: 0.25,
            run: -1.5,
            ..PathSettings::default()
        };
        let focus = Some(Focus::Selection("halo".into()));
        for settings in [PathSettings::default(), PathSettings { of: Some(PathsOf::All), focus, ..all.clone() }, all] {
            let text = ron::ser::to_string_pretty(&settings, ron::ser::PrettyConfig::default()).unwrap();
            assert_eq!(read(&text).unwrap(), settings, "{text}");
        }
        let short = read("(of: all, level: 0, tail: \"2.5tau\", shape: tube)").unwrap();
        assert_eq!((short.of, short.level, short.tail), (Some(PathsOf::All), Some(0), Span::Clock(2.5)));
        assert_eq!(read("(of: [\"halo\"])").unwrap().of, Some(PathsOf::Selections(vec!["halo".into()])));
        for (wrong, part) in [
            ("(of: \"halo\")", "all, none, or names of selections"),
            ("(of: some)", "all, none, or names of selections"),
            ("(tail: \"2.5\")", "expected a number of steps"),
            ("(tail: -1.0)", "expected a number of steps"),
            ("(width: 0.0)", "width is 0, expected a number from 0.05"),
            ("(color: \"#12345\")", "color is #12345"),
            ("(shap: line)", "shap"),
            ("(level: -1)", "1:"),
            ("(focus: ball(center: (0.0, 0.0, 0.0), radius: -1.0))", "focus is"),
        ] {
            let message = read(wrong).unwrap_err();
            assert!(message.contains(part), "{wrong}: {message}");
        }
    }

    #[test]
    fn what_is_described_is_what_there_is() {
        let mut settings = PathSettings::default();
        for setting in SETTINGS {
            setting.check(&setting.default()).unwrap();
            if setting.name != LEVEL.name {
                assert_eq!(settings.value(setting), Some(setting.default()), "{}", setting.name);
            }
            settings.set(setting, &setting.default()).unwrap();
        }
        assert_eq!(settings, PathSettings { level: Some(0), ..PathSettings::default() });
        assert!(settings.set(&WIDTH, &SettingValue::Number(-1.0)).is_err() && settings.width == 3.0);
        settings.set(&TAIL, &SettingValue::Name("3tau".into())).unwrap();
        assert_eq!(settings.tail, Span::Clock(3.0));
    }
}
