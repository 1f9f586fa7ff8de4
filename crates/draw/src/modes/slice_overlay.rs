//! What slices have drawn over their colours, as settings say it: lines of equal value, and a vector field.

use super::surface::{CONTOUR_BASE, CONTOUR_MAJOR, CONTOUR_WIDTH, CONTOURS, LINE_COLOR};
use crate::cpu::slice::arrows::ArrowKey;
use crate::cpu::slice::{Overlay, Vectors};
use crate::cpu::surface::look::Contours;
use crate::cpu::volume::VolumeError;
use crate::mode::{Setting, SettingKind, Settings};

/// How a vector field is drawn.
pub static VECTORS: Setting = Setting {
    name: "vectors",
    unit: "",
    kind: SettingKind::Choice { options: &["off", "arrows", "lic"] },
    help: "how the part of a vector field within the slice is drawn over it: not at all, as arrows, or as streaks along it (line integral \
           convolution)",
};
/// Which one.
pub static VECTOR_FIELD: Setting = Setting {
    name: "vector-field",
    unit: "",
    kind: SettingKind::Vector { default: "velocity" },
    help: "the vector field: an attribute, or channels of an image or a volume, with components along x, y and z of the world; of an image or a \
           volume without velocities its only vector field unless another one is named",
};
/// From an arrow to the next.
pub static VECTOR_SPACING: Setting = Setting {
    name: "vector-spacing",
    unit: "px",
    kind: SettingKind::Number { min: 4.0, max: 1000.0, default: 24.0 },
    help: "from one arrow to the next",
};
/// The vector that is as long as that.
pub static VECTOR_SCALE: Setting = Setting {
    name: "vector-scale",
    unit: "",
    kind: SettingKind::Number { min: 0.0, max: 1e30, default: 0.0 },
    help: "length of the vectors whose arrows are as long as arrows are apart, in the field's unit; arrows end at one and a half times that; 0: such \
           that 95 % of the arrows are no longer than they are apart",
};
/// How far streaks are averaged.
pub static LIC_LENGTH: Setting = Setting {
    name: "lic-length",
    unit: "px",
    kind: SettingKind::Number { min: 2.0, max: 1000.0, default: 30.0 },
    help: "length of the streaks",
};

/// The settings of every slice.
pub static OVERLAY: &[&Setting] = &[
    &CONTOURS,
    &CONTOUR_BASE,
    &CONTOUR_MAJOR,
    &CONTOUR_WIDTH,
    &VECTORS,
    &VECTOR_FIELD,
    &VECTOR_SPACING,
    &VECTOR_SCALE,
    &LIC_LENGTH,
];

/// What ends the names of a vector's components: those of attributes, and of channels that have no names of their own.
const COMPONENTS: [[&str; 3]; 2] = [["-x", "-y", "-z"], ["-1", "-2", "-3"]];

/// What is drawn over a slice.
pub fn of(settings: &Settings) -> Overlay {
    let contours = Some(settings.number(&CONTOURS)).filter(|interval| *interval > 0.0).map(|interval| Contours {
        interval,
        base: settings.number(&CONTOUR_BASE),
        major: settings.number(&CONTOUR_MAJOR) as u32,
        width: settings.number(&CONTOUR_WIDTH),
        color: LINE_COLOR,
        labels: None,
    });
    let vectors = match &*settings.name(&VECTORS) {
        "arrows" => Some(Vectors::Arrows {
            spacing: settings.number(&VECTOR_SPACING),
            scale: Some(settings.number(&VECTOR_SCALE)).filter(|scale| *scale > 0.0),
        }),
        "lic" => Some(Vectors::Streaks { length: settings.number(&LIC_LENGTH) }),
        _ => None,
    };
    Overlay { contours, vectors }
}

/// How long arrows are, where settings say it.
pub fn key(settings: &Settings) -> Option<ArrowKey> {
    match of(settings).vectors {
        Some(Vectors::Arrows { spacing, scale: Some(scale) }) => Some(ArrowKey { scale, spacing }),
        _ => None,
    }
}

/// The columns of particles that are the components of the vector field that is drawn; none where none is.
pub fn columns(settings: &Settings) -> Option<[String; 3]> {
    let name = settings.name(&VECTOR_FIELD);
    of(settings).vectors.map(|_| COMPONENTS[0].map(|end| format!("{name}{end}")))
}

/// The places of the vector field's components among the names of channels. Two components are those along x and y.
///
/// # Errors
/// [`VolumeError::Setting`] with the vector fields that there are, where the one that is meant is not among them.
pub fn channels(settings: &Settings, names: &[&str]) -> Result<[Option<usize>; 3], VolumeError> {
    let wanted = settings.name(&VECTOR_FIELD);
    let is_named = settings.0.contains_key(VECTOR_FIELD.name);
    let all = fields(names);
    let found = all.iter().find(|(name, _)| name.eq_ignore_ascii_case(&wanted));
    // Nobody calls the only vectors of a simulation's grid by another name to see them.
    let only = if is_named || all.len() != 1 { None } else { all.first() };
    found.or(only).map(|(_, channels)| *channels).ok_or_else(|| {
        let known: Vec<&str> = all.iter().map(|(name, _)| *name).collect();
        let expected = match &known[..] {
            [] => "channels with components of a vector, as a-x, a-y and a-z: there are none".to_owned(),
            known => format!("one of {}", known.join(", ")),
        };
        VolumeError::Setting { field: VECTOR_FIELD.name, found: wanted, expected }
    })
}

/// The vector fields among channels: two or three whose names differ by their ends.
fn fields<'a>(names: &[&'a str]) -> Vec<(&'a str, [Option<usize>; 3])> {
    let mut all: Vec<(&str, [Option<usize>; 3])> = Vec::new();
    for ends in COMPONENTS {
        for name in names.iter().filter_map(|name| name.strip_suffix(ends[0])) {
            let place = |end: &str| names.iter().position(|other| other.strip_suffix(end) == Some(name));
            let channels = ends.map(place);
            if channels[1].is_some() && !all.iter().any(|(known, _)| *known == name) {
                all.push((name, channels));
            }
        }
    }
    all
}

/// The names of the vectors whose components are among columns.
pub fn vectors_among(columns: &[String]) -> Vec<String> {
    let names: Vec<&str> = columns.iter().map(String::as_str).collect();
    let whole = fields(&names).into_iter().filter(|(_, channels)| channels.iter().all(Option::is_some));
    whole.map(|(name, _)| name.to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mode::SettingValue;

    fn settings(set: &[(&str, &str)]) -> Settings {
        let name = |(setting, name): &(&str, &str)| ((*setting).into(), SettingValue::Name((*name).into()));
        Settings(set.iter().map(name).collect())
    }

    #[test]
    fn vector_fields_are_found_by_the_names_of_their_components() {
        let names = ["density", "B-x", "B-y", "B-z", "Velocity-x", "Velocity-y", "Velocity-z", "slope-x"];
        let found =
            |set: &[(&str, &str)], names: &[&str]| channels(&settings(set), names).map_err(|error| error.to_string());
        assert_eq!(found(&[], &names), Ok([Some(4), Some(5), Some(6)]));
        assert_eq!(found(&[("vector-field", "b")], &names), Ok([Some(1), Some(2), Some(3)]));
        assert_eq!(found(&[], &["value-1", "value-2"]), Ok([Some(0), Some(1), None]));
        assert_eq!(found(&[], &names[..4]), Ok([Some(1), Some(2), Some(3)]), "the only one");
        let wrong = found(&[("vector-field", "slope")], &names).unwrap_err();
        assert_eq!(wrong, "vector-field is slope, expected one of B, Velocity");
        assert!(found(&[("vector-field", "velocity")], &names[..4]).is_err(), "who names one means it");
        assert!(found(&[], &["density"]).unwrap_err().ends_with("there are none"));
        let columns = names.map(str::to_owned);
        assert_eq!(vectors_among(&columns), ["B", "Velocity"]);
    }

    #[test]
    fn columns_are_those_of_what_is_drawn() {
        assert_eq!(columns(&settings(&[("vector-field", "magnetic-field")])), None);
        let of = |set: &[(&str, &str)]| columns(&settings(set)).map(|names| names.join(" "));
        assert_eq!(of(&[("vectors", "lic")]).as_deref(), Some("velocity-x velocity-y velocity-z"));
        let named = [("vectors", "arrows"), ("vector-field", "magnetic-field")];
        assert_eq!(of(&named).as_deref(), Some("magnetic-field-x magnetic-field-y magnetic-field-z"));
    }
}
