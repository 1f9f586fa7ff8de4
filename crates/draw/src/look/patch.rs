//! What a picture looks like, and what files and the command line say of it. Each field stands in one table, from which the look,
//! the patch and the text of every file that has one are made.

use super::Attribute;
use crate::annotate::Annotations;
use crate::color::composite::Background;
use crate::color::transfer::TransferFunction;
use crate::color::{Bloom, ExposureMode};
use crate::explore::ExploreError;
use crate::hierarchy::spacetime::Interpolation;
use crate::mode::setting::SettingError;
use crate::mode::{Mode, PathSettings, PathsOf, Setting, SettingValue, Settings, lod_budget};
use crate::model::{FamilyName, When};
use crate::modes;
use crate::view::CutSettings;
use std::ops::RangeInclusive;

/// Hands the fields that any look has to a macro, behind what else it is given. A new field is a line here.
macro_rules! with_look_fields {
    ($then:ident! { $($own:tt)* }) => {
        $then! { $($own)*
            [
                /// From values to colours.
                transfer: $crate::color::transfer::TransferFunction,
                /// What is written into the picture.
                annotations: $crate::annotate::Annotations,
                /// Largest displacement of a particle on screen, pixels.
                error_px: f64,
                /// What is left out and faded.
                cut: $crate::view::CutSettings,
                /// Coloured selections.
                selections: Vec<$crate::explore::SelectionSet>,
                /// Pathlines of a run over whatever the mode draws.
                paths: $crate::mode::PathSettings,
                /// What is behind the picture; the window shows black.
                background: $crate::color::composite::Background,
                /// How automatic ranges follow what is seen.
                exposure: $crate::color::ExposureMode,
                /// How bright light spreads.
                bloom: $crate::color::Bloom,
            ]
        }
    };
}

macro_rules! define_looks {
    ([ $($(#[$doc:meta])* $field:ident: $type:ty,)* ]) => {
        /// What a picture looks like, whatever data it is of and wherever its camera stands.
        #[derive(Clone, Debug, PartialEq)]
        pub struct Look {
            /// Visualization mode.
            pub mode: &'static Mode,
            /// Settings of the mode that differ from their defaults; none of another mode.
            pub settings: Settings,
            /// What may be left undrawn, where that differs from its default: settings of no mode ([`lod_budget::COMMON`]).
            pub budget: Settings,
            /// Which attribute gives the hue.
            pub attribute: Attribute,
            $($(#[$doc])* pub $field: $type,)*
        }

        /// What is said of a look. What it says nothing of stays as it was, or is the program's own.
        #[derive(Clone, Debug, Default, PartialEq)]
        pub struct LookPatch {
            /// Visualization mode.
            pub mode: Option<&'static Mode>,
            /// Settings of the mode.
            pub settings: Settings,
            /// What may be left undrawn, of [`lod_budget::COMMON`].
            pub budget: Settings,
            /// Which attribute gives the hue.
            pub attribute: Option<Attribute>,
            /// The families that are drawn.
            pub families: Option<Vec<FamilyName>>,
            /// When it is, of data that has times.
            pub time: Option<When>,
            /// How particles move between the steps of a run.
            pub interpolation: Option<Interpolation>,
            $($(#[$doc])* pub $field: Option<$type>,)*
        }

        impl Look {
            /// The look with what a patch says; of a mode's settings those stay that another mode has too.
            pub fn with(&self, patch: &LookPatch) -> Look {
                let all = self.patch().then(patch);
                let mode = all.mode.unwrap_or(self.mode);
                Look {
                    mode,
                    settings: all.settings.of_mode(mode),
                    budget: all.budget,
                    attribute: all.attribute.unwrap_or_default(),
                    $($field: all.$field.unwrap_or_else(|| self.$field.clone()),)*
                }
            }

            /// Everything of it, said.
            pub fn patch(&self) -> LookPatch {
                LookPatch {
                    mode: Some(self.mode),
                    settings: self.settings.clone(),
                    budget: self.budget.clone(),
                    attribute: Some(self.attribute.clone()),
                    families: None,
                    time: None,
                    interpolation: None,
                    $($field: Some(self.$field.clone()),)*
                }
            }
        }

        impl LookPatch {
            /// What both say, `next` last. Another mode keeps the settings that it has too, and begins with its own colours.
            pub fn then(&self, next: &LookPatch) -> LookPatch {
                let mut all = self.clone();
                if next.mode.is_some() && next.mode != all.mode {
                    all.mode = next.mode;
                    all.settings = all.settings.of_mode(next.mode.unwrap_or(modes::first()));
                    all.transfer = None;
                }
                all.settings.0.extend(next.settings.0.clone());
                all.budget.0.extend(next.budget.0.clone());
                all.attribute = next.attribute.clone().or(all.attribute);
                all.families = next.families.clone().or(all.families);
                all.time = next.time.or(all.time);
                all.interpolation = next.interpolation.or(all.interpolation);
                $(all.$field = next.$field.clone().or(all.$field);)*
                all
            }

            /// What has to be said for a look to follow this one.
            pub fn patch_to(&self, next: &LookPatch) -> LookPatch {
                let another_mode = self.mode != next.mode;
                let new = |next: &Settings, own: &Settings| {
                    let new = next.0.iter().filter(|(name, value)| own.0.get(*name) != Some(value));
                    Settings(new.map(|(name, value)| (name.clone(), value.clone())).collect())
                };
                let mut patch = LookPatch {
                    mode: next.mode.filter(|_| another_mode),
                    settings: if another_mode { next.settings.clone() } else { new(&next.settings, &self.settings) },
                    budget: new(&next.budget, &self.budget),
                    attribute: next.attribute.clone().filter(|_| self.attribute != next.attribute),
                    // Where all families come back, they have to be named.
                    families: match (&self.families, &next.families) {
                        (Some(_), None) => Some(FamilyName::GADGET.to_vec()),
                        (own, next) => next.clone().filter(|_| own != next),
                    },
                    time: next.time.filter(|_| self.time != next.time),
                    interpolation: next.interpolation.filter(|_| self.interpolation != next.interpolation),
                    $($field: next.$field.clone().filter(|_| self.$field != next.$field),)*
                };
                if another_mode {
                    patch.transfer = next.transfer.clone();
                }
                patch
            }
        }
    };
}

with_look_fields!(define_looks! {});

/// The text of a file that says something of a look beside fields of its own: `$text` is what serde reads and writes for `$whole`,
/// whose field `look` is a [`LookPatch`]. `$attribute` is how the text names the attribute. `written`: serde writes it, too.
macro_rules! define_look_text {
    (written $($rest:tt)*) => {
        $crate::look::define_look_text! { read [serde::Serialize, serde::Deserialize] $($rest)* }
        $crate::look::define_look_text! { into $($rest)* }
    };
    (
        read [$($derive:path),*] $text:ident of $whole:ident, attribute $attribute:ty,
        { $($(#[$own_attr:meta])* $own:ident: $own_type:ty,)* }
        [ $($(#[$doc:meta])* $field:ident: $type:ty,)* ]
    ) => {
        #[derive($($derive),*)]
        #[serde(deny_unknown_fields)]
        struct $text {
            $($(#[$own_attr])* $own: $own_type,)*
            #[serde(default, skip_serializing_if = "Option::is_none")]
            mode: Option<&'static $crate::mode::Mode>,
            #[serde(default)]
            settings: $crate::mode::Settings,
            #[serde(default)]
            budget: $crate::mode::Settings,
            #[serde(default, skip_serializing_if = "Option::is_none")]
            attribute: Option<$attribute>,
            #[serde(default, skip_serializing_if = "Option::is_none")]
            families: Option<Vec<$crate::model::FamilyName>>,
            #[serde(default, skip_serializing_if = "Option::is_none")]
            time: Option<$crate::model::When>,
            #[serde(default, skip_serializing_if = "Option::is_none")]
            interpolation: Option<$crate::hierarchy::spacetime::Interpolation>,
            $(#[serde(default, skip_serializing_if = "Option::is_none")] $field: Option<$type>,)*
        }

        impl From<$text> for $whole {
            fn from(text: $text) -> $whole {
                let $text { $($own,)* mode, settings, budget, attribute, families, time, interpolation, $($field,)* } = text;
                let attribute = attribute.map(Into::into);
                let look = $crate::look::LookPatch { mode, settings, budget, attribute, families, time, interpolation, $($field,)* };
                $whole { $($own,)* look: look.with_early_budget() }
            }
        }
    };
    (
        into $text:ident of $whole:ident, attribute $attribute:ty,
        { $($(#[$own_attr:meta])* $own:ident: $own_type:ty,)* }
        [ $($(#[$doc:meta])* $field:ident: $type:ty,)* ]
    ) => {
        impl From<$whole> for $text {
            fn from($whole { $($own,)* look }: $whole) -> $text {
                let $crate::look::LookPatch { mode, settings, budget, attribute, families, time, interpolation, $($field,)* } = look;
                $text { $($own,)* mode, settings, budget, attribute, families, time, interpolation, $($field,)* }
            }
        }
    };
}

pub(crate) use {define_look_text, with_look_fields};

impl Look {
    /// A mode as it is by default.
    pub fn of(mode: &'static Mode) -> Look {
        Look {
            mode,
            settings: Settings::default(),
            budget: Settings::default(),
            attribute: Attribute::Automatic,
            transfer: TransferFunction::default(),
            annotations: Annotations::default(),
            error_px: ERROR_PX,
            cut: CutSettings::default(),
            selections: Vec::new(),
            paths: PathSettings::default(),
            background: Background::default(),
            exposure: ExposureMode::default(),
            bloom: Bloom::default(),
        }
    }

    /// The values that a setting of [`Mode::all_settings`] stands among.
    pub fn values(&mut self, setting: &Setting) -> &mut Settings {
        if lod_budget::is_common(setting.name) { &mut self.budget } else { &mut self.settings }
    }

    /// Sets one of [`Mode::all_settings`].
    pub fn set(&mut self, setting: &Setting, value: SettingValue) {
        self.values(setting).set(setting, value);
    }
}

/// Largest displacement of a particle on screen where nothing is said, pixels.
pub const ERROR_PX: f64 = 0.8;

/// Displacements that a scene or a tour may ask for, pixels.
pub const ERRORS_PX: RangeInclusive<f64> = 0.05..=64.0;

impl LookPatch {
    /// Largest displacement of a particle on screen, pixels; the usual one where it says nothing.
    pub fn error_px(&self) -> f64 {
        self.error_px.unwrap_or(ERROR_PX)
    }

    /// What a scene or a tour begins with: all of the data, its usual hue and light, and no selections.
    pub fn beginning() -> LookPatch {
        LookPatch {
            attribute: Some(Attribute::Automatic),
            cut: Some(CutSettings::default()),
            selections: Some(Vec::new()),
            exposure: Some(ExposureMode::default()),
            bloom: Some(Bloom::default()),
            ..LookPatch::default()
        }
    }

    /// Whose paths are drawn.
    pub fn paths_of(&self) -> PathsOf {
        let paths = self.paths.clone().unwrap_or_default();
        self.mode.map_or_else(|| paths.of.clone().unwrap_or_default(), |mode| paths.whose(mode))
    }

    /// Whether it has what the first version of scenes and tours has not: a time, paths, or selections that follow.
    pub fn is_of_runs(&self) -> bool {
        let paths = self.paths.as_ref().is_some_and(|paths| *paths != PathSettings::default());
        let tracked = self.selections.iter().flatten().any(|set| set.members.are_timed());
        self.time.is_some() || self.interpolation.is_some() || paths || tracked
    }

    /// The same without paths and light that are as they are by default, which files need not say.
    #[must_use]
    pub fn without_usual(mut self) -> LookPatch {
        self.paths = self.paths.filter(|paths| *paths != PathSettings::default());
        self.exposure = self.exposure.filter(|exposure| *exposure != ExposureMode::default());
        self.bloom = self.bloom.filter(|bloom| *bloom != Bloom::default());
        self
    }

    /// The same, with what earlier files have among the settings of a mode and belongs to none.
    pub(crate) fn with_early_budget(mut self) -> LookPatch {
        let early = self.settings.common();
        self.settings.0.retain(|name, _| !lod_budget::is_common(name));
        self.budget = Settings(early.0.into_iter().chain(self.budget.0).collect());
        self
    }

    /// The attribute by name, where one is named.
    pub fn attribute_name(&self) -> Option<&str> {
        match &self.attribute {
            Some(Attribute::Named(name)) => Some(name),
            _ => None,
        }
    }

    /// Whether no attribute is to give the hue.
    pub fn is_plain(&self) -> bool {
        self.attribute == Some(Attribute::None)
    }

    /// Whether the same values are shown, so that the ranges of their colours can be compared.
    pub fn is_measured_like(&self, other: &LookPatch) -> bool {
        let scales = |look: &LookPatch| {
            look.transfer.as_ref().map(|transfer| (transfer.scale, transfer.hue.as_ref().map(|hue| hue.scale)))
        };
        let fields = |look: &LookPatch| look.mode_of_settings().technique.fields(&look.settings);
        self.mode == other.mode
            && fields(self) == fields(other)
            && self.attribute == other.attribute
            && self.families == other.families
            && scales(self) == scales(other)
    }

    /// The mode whose settings it has: where it names none, and the data's usual one is meant, the first that takes them all.
    pub fn mode_of_settings(&self) -> &'static Mode {
        let takes = |mode: &&'static Mode| self.settings.check(mode).is_ok();
        self.mode.unwrap_or_else(|| modes::all().into_iter().find(takes).unwrap_or(modes::first()))
    }

    /// Checks what types cannot, of settings those of `mode`. `refuse` makes the error of a field by its path, of what was found and
    /// what is expected.
    ///
    /// # Errors
    /// The first mistake.
    pub fn check<E>(
        &self,
        mode: &Mode,
        errors_px: RangeInclusive<f64>,
        refuse: &dyn Fn(&[&str], String, String) -> E,
    ) -> Result<(), E> {
        let in_map = |map: &'static str| {
            move |error: SettingError| match error {
                SettingError::Unknown { mode, name, expected } => {
                    refuse(&[map, &name], name.clone(), format!("a setting of {mode}: {expected}"))
                }
                SettingError::Value { name, found, expected } => refuse(&[map, name], found, expected),
            }
        };
        self.settings.check(mode).map_err(in_map("settings"))?;
        self.budget.check_common().map_err(in_map("budget"))?;
        if let Some(error_px) = self.error_px.filter(|value| !errors_px.contains(value)) {
            let expected = match errors_px == ERRORS_PX {
                true => format!("{} to {} pixels", ERRORS_PX.start(), ERRORS_PX.end()),
                false => "a number greater than 0".into(),
            };
            return Err(refuse(&["error_px"], error_px.to_string(), expected));
        }
        if let Some((field, found, expected)) = self.exposure.and_then(|exposure| exposure.mistake()) {
            return Err(refuse(&["exposure", field], found, expected));
        }
        if let Some((field, found, expected)) = self.bloom.and_then(|bloom| bloom.mistake()) {
            return Err(refuse(&["bloom", field], found, expected));
        }
        if let Some(paths) = &self.paths {
            paths.check().map_err(in_map("paths"))?;
        }
        let selections = self.selections.as_deref().unwrap_or_default();
        if selections.iter().filter(|set| set.follow).count() > 1 {
            return Err(refuse(&["selections", "follow"], "two that are followed".into(), "one at most".into()));
        }
        for set in selections {
            set.check().map_err(|error| match error {
                ExploreError::Value { field, found, expected } => {
                    let last = field.rsplit('.').next().unwrap_or(&field);
                    refuse(&["selections", &set.name, last], found, expected.to_string())
                }
                other => refuse(&["selections"], other.to_string(), "a selection".into()),
            })?;
        }
        Ok(())
    }
}
