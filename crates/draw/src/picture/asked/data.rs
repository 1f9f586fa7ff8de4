//! The data that is opened, from what a program says of it.

use super::Failure;
use crate::heights::OpenHeights;
use crate::heights::import::PhotoChoice;
use crate::look::{
    DatasetRef, HeightsSaid, Member, SceneFile, TakenFor, check_dataset, check_derived, data_file, of_json, say,
};
use crate::model::{DerivedQuantity, ReadMethod, Unit, is_url};
use crate::picture::Reporter;
use serde::Deserialize;
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};

/// Data that a program opens: files, or a scene's.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AskedData {
    /// What is said of each file, as scenes have it but without its path.
    pub datasets: Vec<Map<String, Value>>,
    /// A scene in RON, whose data is opened.
    pub scene: Option<String>,
    /// The file that it was read from.
    pub scene_file: Option<PathBuf>,
    /// What is said of all heights, and derived for all particles, as [`said`] reads it.
    pub said: Map<String, Value>,
}

/// What is said of heights, and derived for particles, by the names of the command line's options and of scenes.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct AskedSaid {
    kind: Option<TakenFor>,
    nodata: Option<f64>,
    spacing: Option<[f64; 2]>,
    xy_unit: Option<String>,
    height_unit: Option<String>,
    texture: Option<PathBuf>,
    /// Two opposite corners of the texture.
    texture_at: Option<[f64; 4]>,
    before: Option<PathBuf>,
    /// Names with commas between them, or `all`.
    derive: Option<String>,
}

/// What a program says of heights, and has derived for particles.
///
/// # Errors
/// A sentence that begins with the field.
pub fn said(fields: &Map<String, Value>) -> Result<HeightsSaid, Failure> {
    let asked: AskedSaid = of_json(&Value::Object(fields.clone()))?;
    let AskedSaid { kind, nodata, spacing, xy_unit, height_unit, texture, texture_at, before, derive } = asked;
    if texture.is_none() && texture_at.is_some() {
        return Err("texture_at: found no texture, expected one".into());
    }
    let derive = derive.as_deref().map(DerivedQuantity::list).transpose();
    Ok(HeightsSaid {
        taken_for: kind,
        nodata,
        spacing,
        xy_unit: xy_unit.map(Unit::new),
        height_unit: height_unit.map(Unit::new),
        texture: texture.map(|path| PhotoChoice { path, rectangle: texture_at }),
        before,
        derive: derive.map_err(|sentence| format!("derive: {sentence}"))?.unwrap_or_default(),
    })
}

impl AskedData {
    /// The datasets: the files `paths`, or those of the scene. What there is to tell of the latter goes to `reporter`.
    ///
    /// # Errors
    /// When a file cannot be found, or what is said of it makes no sense.
    pub fn members(&self, paths: &[PathBuf], reporter: &dyn Reporter) -> Result<Vec<Member>, Failure> {
        let mut members = match &self.scene {
            Some(text) => {
                let name = self.scene_file.as_deref().unwrap_or(Path::new("scene"));
                let scene = SceneFile::parse(&name.display().to_string(), text)?;
                // It is the same data wherever the program goes.
                let located = scene.locate(&std::path::absolute(name)?)?;
                located.notes.into_iter().for_each(|note| reporter.tell(note));
                located.members
            }
            None => {
                let none = Map::new();
                let said = self.datasets.iter().chain(std::iter::repeat(&none));
                paths.iter().zip(said).map(|(path, said)| member(path, said)).collect::<Result<_, _>>()?
            }
        };
        let said = said(&self.said)?;
        say(&mut members, &said);
        check_derived(&members)?;
        check_heights(&members, &said)?;
        for member in members.iter().filter(|member| member.is_of_heights()) {
            if let Some(before) = &member.said.before {
                OpenHeights::open(before, &member.said.of_before().options(ReadMethod::default()))?;
            }
        }
        Ok(members)
    }
}

/// A file, with what is said of it.
fn member(path: &Path, said: &Map<String, Value>) -> Result<Member, Failure> {
    let mut said = said.clone();
    // Not every path is a text.
    said.insert("path".into(), Value::String(String::new()));
    let dataset: DatasetRef = of_json(&Value::Object(said))?;
    check_dataset(&dataset, &|names: &[&str], found: String, expected: String| {
        format!("{}: {}: found {found}, expected {expected}", path.display(), names.join(": "))
    })?;
    Ok(dataset.member(data_file(path)?))
}

/// Refuses what is said of heights where there are none. What is not there is told where it is opened.
fn check_heights(members: &[Member], said: &HeightsSaid) -> Result<(), Failure> {
    let is_there = |member: &Member| is_url(&member.path) || member.path.exists();
    if members.iter().any(Member::is_of_heights) || !members.iter().all(is_there) {
        return Ok(());
    }
    let of_heights = [
        ("nodata", said.nodata.is_some()),
        ("spacing", said.spacing.is_some()),
        ("xy_unit", said.xy_unit.is_some()),
        ("height_unit", said.height_unit.is_some()),
        ("texture", said.texture.is_some()),
        ("before", said.before.is_some()),
    ];
    match (of_heights.into_iter().find(|(_, is_said)| *is_said), members.first()) {
        (Some((name, _)), Some(first)) => {
            let instead = "an array or a grey picture is taken for such by kind \"heights\"";
            Err(format!("{}: {name}: found no heights, expected some; {instead}", first.path.display()).into())
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use serde_json::json;

    fn asked(said: Value) -> AskedData {
        serde_json::from_value(said).unwrap()
    }

    #[test]
    fn what_is_said_of_data_is_said_as_scenes_and_options_have_it() {
        let folder = tempfile::tempdir().unwrap();
        let [one, other, scene] = ["a.df", "b.df", "a.scene.ron"].map(|name| folder.path().join(name));
        for path in [&one, &other] {
            std::fs::write(path, b"data").unwrap();
        }
        let fields = json!({
            "datasets": [{}, {"offset": [1, 2, 3], "scale": 2, "families": ["gas"], "derive": ["vorticity"]}],
            "said": {"derive": "divergence,vorticity"},
        });
        let members = asked(fields).members(&[one.clone(), other.clone()], &()).unwrap();
        assert_eq!(members[0].path, one);
        assert_eq!((members[1].offset, members[1].scale), (DVec3::new(1.0, 2.0, 3.0), Some(2.0)));
        // What is said of all comes before what is said of one, as options come before scenes.
        assert!(members.iter().all(|member| member.said.derive.len() == 2));
        assert_eq!(members[1].families.as_ref().map(Vec::len), Some(1));

        // The same of a scene.
        let text = "(version: 1, datasets: [(path: \"a.df\"), (path: \"b.df\", offset: (1.0, 2.0, 3.0), scale: 2.0,
            families: [gas], derive: [\"vorticity\"])])";
        let said = json!({"scene": text, "scene_file": scene, "said": {"derive": "divergence,vorticity"}});
        assert_eq!(asked(said).members(&[], &()).unwrap(), members);

        for (fields, expected) in [
            (json!({"said": {"kind": "hights"}}), "kind: unknown variant `hights`, expected one of `heights`"),
            (json!({"said": {"spacing": [1]}}), "spacing: invalid length 1"),
            (json!({"said": {"derive": "speed"}}), "derive: expected all, or some of velocity-dispersion"),
            (json!({"said": {"texture_at": [0, 0, 1, 1]}}), "texture_at: found no texture, expected one"),
            (json!({"said": {"nodata": 0}}), "a.df: nodata: found no heights, expected some"),
            (json!({"datasets": [{"ofset": [0, 0, 0]}]}), "ofset: unknown field `ofset`"),
            (json!({"datasets": [{"scale": -1}]}), "a.df: scale: found -1, expected a positive number"),
        ] {
            let message = asked(fields.clone()).members(std::slice::from_ref(&one), &()).unwrap_err().to_string();
            assert!(message.contains(expected), "{fields}: {message}");
        }
    }
}
