//! What a scene says of data that a program has opened by itself.

use super::{DatasetRef, located};
use crate::look::{HeightsSaid, Member, SceneFile, data_file};
use crate::model::is_url;
use crate::model::url::shown;
use glam::DVec3;
use std::path::{Path, PathBuf};

impl SceneFile {
    /// Says of data that a program has opened what this scene, which is the file `scene`, says of its own: everything of what the scene names, too, but
    /// where something else was said when it was opened, and of other data which families are drawn, as of the dataset in its place. Gives what is
    /// left out, a sentence each.
    pub fn say_of(&self, scene: &Path, members: &mut [Member]) -> Vec<String> {
        let named: Vec<PathBuf> =
            self.datasets.iter().map(|dataset| by_one_name(&located(&dataset.path, scene))).collect();
        let mut left: Vec<Option<&DatasetRef>> = self.datasets.iter().map(Some).collect();
        let mut others = Vec::new();
        for (place, member) in members.iter_mut().enumerate() {
            let path = by_one_name(&member.path);
            let own = left.iter_mut().zip(&named).find(|(dataset, named)| dataset.is_some() && **named == path);
            match own.and_then(|(dataset, _)| dataset.take()) {
                Some(dataset) => {
                    let said = dataset.placed(scene).member(member.path.clone());
                    *member = Member { said: member.said.clone().or(&said.said), ..said };
                }
                None => others.push((place, member)),
            }
        }
        let mut notes = Vec::new();
        let mut tell = |dataset: &DatasetRef, why: String| {
            let (scene, path) = (scene.display(), dataset.path.display());
            notes.push(format!("{scene}: datasets: what is said of {path} is left out{why}"));
        };
        for (place, member) in others {
            let Some(dataset) = left.get_mut(place).and_then(Option::take) else { continue };
            member.families = dataset.families.clone().or_else(|| member.families.take());
            let names = dataset.names_said();
            if !names.is_empty() {
                tell(dataset, format!(" but for its families, since other data is drawn: {}", names.join(", ")));
            }
        }
        for dataset in left.into_iter().flatten() {
            tell(dataset, ", which is not among the data that is drawn".to_owned());
        }
        notes
    }
}

impl DatasetRef {
    /// The names of what it says beside which families are drawn.
    fn names_said(&self) -> Vec<&'static str> {
        let HeightsSaid { taken_for, nodata, spacing, xy_unit, height_unit, texture, before, derive } = &self.said;
        let said = [
            ("offset", DVec3::from(self.offset) != DVec3::ZERO),
            ("scale", self.scale.is_some()),
            ("kind", taken_for.is_some()),
            ("nodata", nodata.is_some()),
            ("spacing", spacing.is_some()),
            ("xy_unit", xy_unit.is_some()),
            ("height_unit", height_unit.is_some()),
            ("texture", texture.is_some()),
            ("before", before.is_some()),
            ("derive", !derive.is_empty()),
            ("look", self.own_look.is_some()),
        ];
        said.into_iter().filter(|(_, is_said)| *is_said).map(|(name, _)| name).collect()
    }
}

/// A file as it is opened, by the one name that its links have in common. A server is not asked.
fn by_one_name(path: &Path) -> PathBuf {
    if is_url(path) {
        return shown(path);
    }
    // What is wrong with a folder is told where it is opened.
    let path = data_file(path).unwrap_or_else(|_| path.to_owned());
    path.canonicalize().or_else(|_| std::path::absolute(&path)).unwrap_or(path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::look::TakenFor;
    use crate::model::{DerivedQuantity, FamilyName};

    #[test]
    fn open_data_is_said_what_a_scene_says_of_it() {
        let folder = tempfile::tempdir().unwrap();
        let [file, other, scene] = ["a.df", "b.df", "a.scene.ron"].map(|name| folder.path().join(name));
        for path in [&file, &other] {
            std::fs::write(path, b"data").unwrap();
        }
        let text = |datasets: &str| format!("(version: 1, datasets: [{datasets}])");
        let said = |datasets: &str, members: &mut [Member]| {
            SceneFile::parse("a.scene.ron", &text(datasets)).unwrap().say_of(&scene, members)
        };
        let gas = Some(vec![FamilyName::Gas]);
        let whole = "(path: \"a.df\", kind: particles, families: [gas], offset: (1.0, 2.0, 3.0), scale: 2.0, \
                     derive: [\"vorticity\"])";

        // Its own data, whatever its place; what was said of it when it was opened holds.
        let derive = vec![DerivedQuantity::Divergence, DerivedQuantity::Vorticity];
        let opened = HeightsSaid { nodata: Some(-1.0), derive, ..HeightsSaid::default() };
        let mut members = [Member::new(&other), Member { said: opened, ..Member::new(&file) }];
        assert_eq!(said(&format!("{whole}, (path: \"b.df\")"), &mut members), Vec::<String>::new());
        assert_eq!((members[0].clone(), &members[1].families), (Member::new(&other), &gas));
        assert_eq!((members[1].offset, members[1].scale), (DVec3::new(1.0, 2.0, 3.0), Some(2.0)));
        let HeightsSaid { taken_for, derive, nodata, .. } = &members[1].said;
        assert_eq!((*taken_for, derive.len(), *nodata), (Some(TakenFor::Particles), 2, Some(-1.0)));

        // Other data shows the same families, and the rest is told.
        let mut members = [Member::new(&other)];
        let notes = said(whole, &mut members);
        assert_eq!(members, [Member { families: gas, ..Member::new(&other) }]);
        assert!(
            notes.len() == 1 && notes[0].ends_with("other data is drawn: offset, scale, kind, derive"),
            "{notes:?}"
        );
        let notes = said("(path: \"b.df\"), (path: \"a.df\")", &mut [Member::new(&other)]);
        assert!(notes.len() == 1 && notes[0].contains("a.df is left out, which is not among"), "{notes:?}");
        assert_eq!(said("(path: \"a.df\")", &mut [Member::new(&other)]), Vec::<String>::new());
    }
}
