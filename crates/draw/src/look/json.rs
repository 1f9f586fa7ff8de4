//! What other languages say in JSON: fields as in RON, a variant such as `fixed(1.0, 2.0)` being `{"fixed": [1.0, 2.0]}`.

use super::LookPatch;
use crate::explore::Members;
use crate::mode::PathsOf;
use crate::model::When;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

/// What JSON says.
///
/// # Errors
/// A sentence that begins with the names that lead to what cannot be read: the place in a text that nobody wrote would tell nothing.
pub fn of_json<T: DeserializeOwned>(said: &Value) -> Result<T, String> {
    let read = |said: &Value| <T as Deserialize>::deserialize(said);
    read(said).map_err(|error| {
        let error = error.to_string();
        let mut sentence = path_to_mistake(said, &|said| read(said).is_ok());
        sentence.push(&error);
        sentence.join(": ")
    })
}

/// The names that lead to what cannot be read: that of the field without which all else is read, and those in it. `reads` reads what takes
/// the place of all that is said.
fn path_to_mistake<'a>(said: &'a Value, reads: &dyn Fn(&Value) -> bool) -> Vec<&'a str> {
    let Some(fields) = said.as_object() else { return Vec::new() };
    for (name, own) in fields {
        let mut others = fields.clone();
        others.remove(name);
        // One that is alone may be a variant, without which nothing is read, and have the field.
        let may_be_variant = others.is_empty();
        let is_field = reads(&Value::Object(others.clone()));
        if !is_field && !may_be_variant {
            continue;
        }
        let reads_within = |own: &Value| {
            let mut all = others.clone();
            all.insert(name.clone(), own.clone());
            reads(&Value::Object(all))
        };
        let within = path_to_mistake(own, &reads_within);
        if is_field || !within.is_empty() {
            return std::iter::once(name.as_str()).chain(within).collect();
        }
    }
    Vec::new()
}

/// What is said of a run in a look: RON alone tells the forms of these apart.
#[derive(Default)]
pub struct OfRun {
    time: Option<When>,
    paths_of: Option<PathsOf>,
    /// When the members of selections are in their regions, by the selection's number.
    tracked: Vec<(usize, When)>,
}

impl OfRun {
    /// Takes it out of the fields of a look; members that are tracked are those of their region then.
    ///
    /// # Errors
    /// A sentence that begins with the field.
    pub fn take(said: &mut Value) -> Result<OfRun, String> {
        let Some(fields) = said.as_object_mut() else { return Ok(OfRun::default()) };
        let time = fields.remove("time").filter(|time| !time.is_null());
        let paths = fields.get_mut("paths").and_then(Value::as_object_mut);
        let of = paths.and_then(|paths| paths.remove("of")).filter(|of| !of.is_null());
        let mut tracked = Vec::new();
        let selections = fields.get_mut("selections").and_then(Value::as_array_mut);
        for (number, selection) in selections.into_iter().flatten().enumerate() {
            tracked.extend(take_tracked(selection)?.map(|at| (number, at)));
        }
        Ok(OfRun {
            time: time.map(|time| when("time", &time)).transpose()?,
            paths_of: of.map(|of| paths_of(&of)).transpose()?,
            tracked,
        })
    }

    /// Gives it to the look that was read of the other fields.
    pub fn give(self, look: &mut LookPatch) {
        look.time = self.time.or(look.time);
        if let Some(of) = self.paths_of {
            look.paths.get_or_insert_default().of = Some(of);
        }
        for (number, at) in self.tracked {
            let selection = look.selections.as_mut().and_then(|selections| selections.get_mut(number));
            if let Some(members) = selection.map(|selection| &mut selection.members)
                && let Members::Region(region) = members
            {
                let region = std::mem::take(region);
                *members = Members::Tracked { at, region };
            }
        }
    }
}

/// When the members of a selection are in their region, where they are tracked.
fn take_tracked(selection: &mut Value) -> Result<Option<When>, String> {
    const PLACE: &str = "selections: members: Tracked";
    let Some(members) = selection.get_mut("members") else { return Ok(None) };
    let Some(tracked) = members.get_mut("Tracked").and_then(Value::as_object_mut) else { return Ok(None) };
    let found = tracked.keys().cloned().collect::<Vec<_>>().join(", ");
    let (Some(at), Some(region), true) = (tracked.remove("at"), tracked.remove("region"), tracked.is_empty()) else {
        return Err(format!("{PLACE}: found {found}, expected at and region"));
    };
    *members = json!({ "Region": region });
    when(&format!("{PLACE}: at"), &at).map(Some)
}

/// A time as on the command line, or as JSON is written of it: a number, or `{"step": 12}`.
fn when(field: &str, said: &Value) -> Result<When, String> {
    let named = said.as_object().and_then(|fields| fields.iter().next());
    let text = match (said, named) {
        (Value::String(text), _) => text.clone(),
        (_, Some((name, value))) => {
            let name = match name.as_str() {
                "redshift" => "z",
                "scale_factor" => "a",
                other => other,
            };
            format!("{name}:{value}")
        }
        (other, None) => other.to_string(),
    };
    text.parse::<When>().map_err(|expected| format!("{field}: found {text}, {expected}"))
}

/// Whose paths are drawn: `all`, `none`, or names of selections.
fn paths_of(said: &Value) -> Result<PathsOf, String> {
    match said {
        Value::String(text) => {
            text.parse::<PathsOf>().map_err(|expected| format!("paths: of: found {text:?}, {expected}"))
        }
        names => match of_json::<Vec<String>>(names) {
            Ok(names) if names.iter().all(|name| !name.trim().is_empty()) => Ok(PathsOf::Selections(names)),
            _ => Err(format!("paths: of: found {names}, expected all, none, or names of selections")),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::look::PictureConfig;

    #[test]
    fn fields_in_json_are_those_in_ron() {
        for (ron, said) in [
            (
                "annotations: (legend: true, labels: 3, caption: \"z = 0\", scale: 1.5)",
                json!({"annotations": {"legend": true, "labels": 3, "caption": "z = 0", "scale": 1.5}}),
            ),
            ("annotations: ()", json!({"annotations": {}})),
            (
                "cut: (clip: (min: (0.0, 0.0, 0.0), max: (4.0, 4.0, 4.5)), slab: (axis: y, middle: 3.5, thickness: 2.0), periodic: tiled(3, 3, 1))",
                json!({"cut": {"clip": {"min": [0, 0, 0], "max": [4, 4, 4.5]}, "slab": {"axis": "y", "middle": 3.5, "thickness": 2},
                            "periodic": {"tiled": [3, 3, 1]}}}),
            ),
            (
                "cut: (fade: (start: 10.0, length: 2.0), periodic: wrapped)",
                json!({"cut": {"fade": {"start": 10.0, "length": 2.0}, "periodic": "wrapped"}}),
            ),
            (
                "selections: [(name: \"a\", members: Region((families: [gas])), show: alone), (name: \"b\", color: \"#e69f00\", \
              members: Tracked(at: step(3), region: (shapes: [Sphere(center: (1.0, 2.0, 3.0), radius: 1.5)])))]",
                json!({"selections": [
                    {"name": "a", "members": {"Region": {"families": ["gas"]}}, "show": "alone"},
                    {"name": "b", "color": "#e69f00",
                     "members": {"Tracked": {"at": {"step": 3}, "region": {"shapes": [{"Sphere": {"center": [1, 2, 3], "radius": 1.5}}]}}}},
                ]}),
            ),
            (
                "selections: [(name: \"c\", members: Ids(\"5,7-9\"))], paths: (of: [\"c\"], tail: \"2.5tau\", level: 0)",
                json!({"selections": [{"name": "c", "members": {"Ids": "5,7-9"}}], "paths": {"of": ["c"], "tail": "2.5tau", "level": 0}}),
            ),
            ("paths: (of: all)", json!({"paths": {"of": "all"}})),
            ("projection: dome()", json!({"projection": "dome"})),
            (
                "projection: dome(aperture: 210.0, tilt: 27.0)",
                json!({"projection": {"dome": {"aperture": 210, "tilt": 27}}}),
            ),
            ("projection: cube(layout: strip)", json!({"projection": {"cube": {"layout": "strip"}}})),
            ("projection: flat", json!({"projection": "flat"})),
            (
                "stereo: (kind: off-axis, separation: 0.5, zero_parallax: 60.0, eyes: side-by-side)",
                json!({"stereo": {"kind": "off-axis", "separation": 0.5, "zero_parallax": 60, "eyes": "side-by-side"}}),
            ),
            (
                "catalogue: \"groups.hdf5\", families: [gas, dark], interpolation: linear, time: redshift(1.5)",
                json!({"catalogue": "groups.hdf5", "families": ["gas", "dark"], "interpolation": "linear", "time": "z:1.5"}),
            ),
            (
                "exposure: adaptive(), bloom: (strength: 0.4)",
                json!({"exposure": "adaptive", "bloom": {"strength": 0.4}}),
            ),
            (
                "exposure: adaptive(bright: 0.2), volume: (gamma: 2.0)",
                json!({"exposure": {"adaptive": {"bright": 0.2}}, "volume": {"gamma": 2.0}}),
            ),
        ] {
            let read = PictureConfig::parse("p.ron", &format!("({ron})")).unwrap();
            let fields = said.as_object().unwrap();
            let found = PictureConfig::of_json(fields).unwrap();
            // They are said over others, too.
            let over =
                PictureConfig::parse("p.ron", "(projection: equirectangular, annotations: (axes: true))").unwrap();
            let text = format!("{read:?}");
            assert_eq!(format!("{found:?}"), text, "{ron}");
            assert_ne!(text, format!("{:?}", PictureConfig::default()), "{ron}");
            let projection = found.projection.or(over.projection);
            let annotations = found.look.annotations.clone().or(over.look.annotations.clone());
            let both = over.then(found);
            assert_eq!((both.projection, both.look.annotations), (projection, annotations), "{ron}");
        }
    }

    #[test]
    fn mistakes_are_led_to_by_names() {
        for (said, expected) in [
            (
                json!({"annotations": {"axes": true, "legnd": true}}),
                "annotations: legnd: unknown field `legnd`, expected one of `legend`",
            ),
            (
                json!({"annotations": {"axes": true, "legend": "yes"}}),
                "annotations: legend: invalid type: string \"yes\", expected a boolean",
            ),
            (
                json!({"annotations": {"scale": 99}}),
                "annotations: scale: scale is 99, expected a number from 0.25 to 16",
            ),
            (json!({"annotations": "yes"}), "annotations: invalid type: string \"yes\""),
            (json!({"cut": {"slab": {"axis": "y", "middle": 0}}}), "cut: slab: missing field `thickness`"),
            (json!({"projection": "done"}), "projection: unknown variant `done`, expected one of `flat`, `dome`"),
            (
                json!({"projection": {"done": {"tilt": 3}}}),
                "projection: unknown variant `done`, expected one of `flat`, `dome`",
            ),
            (
                json!({"projection": {"dome": {"aperture": "wide"}}}),
                "projection: dome: aperture: invalid type: string \"wide\", expected f64",
            ),
            (
                json!({"projection": {"dome": {"aperture": 361}}}),
                "projection: aperture: found 361, expected above 0 and at most 360 degrees",
            ),
            (json!({"bloom": {"strength": 2}}), "bloom: strength: found 2, expected a number from 0 to 1"),
            (
                json!({"selections": [{"name": "a", "members": {"Region": {}}, "color": "red"}]}),
                "selections: a: color: found red, expected a colour such as #e69f00",
            ),
            (
                json!({"selections": [{"name": "a", "members": {"Tracked": {"at": "soon", "region": {}}}}]}),
                "selections: members: Tracked: at: found soon, expected a time such as",
            ),
            (
                json!({"selections": [{"name": "a", "members": {"Tracked": {"region": {}}}}]}),
                "selections: members: Tracked: found region, expected at and region",
            ),
            (json!({"paths": {"of": [""]}}), "paths: of: found [\"\"], expected all, none, or names of selections"),
            (json!({"caption": "z = 0"}), "caption: unknown field `caption`, expected one of `family`"),
        ] {
            let message = PictureConfig::of_json(said.as_object().unwrap()).unwrap_err();
            assert!(message.starts_with(expected), "{said}: {message}");
        }
    }
}
