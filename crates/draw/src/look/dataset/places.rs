//! Where a scene's data is: as the scene names it, and beside the scene where it has moved.

use super::{DatasetRef, Fingerprint};
use crate::look::{HeightsSaid, Member, SceneError, SceneFile, data_file};
use crate::model::is_url;
use crate::model::url::shown;
use std::path::{Path, PathBuf};

/// Where a scene's data is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Located {
    /// The datasets to open.
    pub members: Vec<Member>,
    /// What the user should know about it, a sentence each.
    pub notes: Vec<String>,
}

impl DatasetRef {
    /// Finds the data of the scene file `scene`: where it says, else beside the scene file. What lies behind a URL and cannot be read is told
    /// where it is opened.
    ///
    /// # Errors
    /// [`SceneError::Missing`] where it is in neither place, or cannot be read.
    pub fn locate(&self, scene: &Path) -> Result<Located, SceneError> {
        let folder = folder_of(scene);
        let named = if is_url(&self.path) { shown(&self.path) } else { folder.join(&self.path) };
        // What is wrong with a folder is told where it is opened, and so is why a server does not give a file: it is not asked again here.
        let data = data_file(&named);
        let is_lost = is_url(&named) && data.is_err();
        let named = data.unwrap_or(named);
        let beside = self.path.file_name().map(|name| folder.join(name)).filter(|beside| *beside != named);
        let places = [Some(named.clone()).filter(|_| !is_lost), beside.clone()].into_iter().flatten();
        let mut found: Vec<(PathBuf, Fingerprint)> =
            places.filter_map(|path| Fingerprint::of(&path).ok().map(|fingerprint| (path, fingerprint))).collect();
        let is_same = |fingerprint: &Fingerprint| self.fingerprint.is_none_or(|known| known == *fingerprint);
        if found.is_empty() && is_url(&named) {
            found.push((named.clone(), self.fingerprint.unwrap_or(Fingerprint { bytes: 0, crc32c: 0 })));
        }
        let best = found.iter().position(|(_, fingerprint)| is_same(fingerprint)).unwrap_or(0);
        if found.is_empty() {
            let nor = beside.map(|beside| format!(", nor at {}", beside.display())).unwrap_or_default();
            return Err(SceneError::Missing { scene: scene.to_owned(), path: named, nor });
        }
        let (path, fingerprint) = found.swap_remove(best);
        let mut notes = Vec::new();
        if path != named {
            let what = if named.is_file() { "has changed" } else { "is not there" };
            let (scene, named, path) = (scene.display(), named.display(), path.display());
            notes.push(format!("{scene}: {named} {what}; {path} beside the scene is opened instead"));
        }
        if let Some(known) = self.fingerprint.filter(|known| *known != fingerprint) {
            let how = match known.bytes == fingerprint.bytes {
                true => "its content differs".to_owned(),
                false => format!("it has {} bytes and had {}", fingerprint.bytes, known.bytes),
            };
            notes.push(format!(
                "{}: {} is not the file that the scene was saved with ({how}); what does not fit it is left out",
                scene.display(),
                path.display()
            ));
        }
        Ok(Located { members: vec![self.placed(scene).member(path)], notes })
    }

    /// The same with what lies over its data, or is compared with it, where that is for the scene file `scene`.
    pub(super) fn placed(&self, scene: &Path) -> DatasetRef {
        DatasetRef { said: self.said.with_files(|file| located(file, scene)), ..self.clone() }
    }

    /// The files that it names for the scene file `scene`: its data, and what lies over that or is compared with it.
    pub fn files(&self, scene: &Path) -> impl Iterator<Item = PathBuf> {
        let HeightsSaid { texture, before, .. } = &self.said;
        let named = [Some(&self.path), texture.as_ref().map(|photo| &photo.path), before.as_ref()];
        named.into_iter().flatten().map(move |path| located(path, scene))
    }
}

impl SceneFile {
    /// Finds all data of this scene, which is the file `scene`.
    ///
    /// # Errors
    /// As [`DatasetRef::locate`].
    pub fn locate(&self, scene: &Path) -> Result<Located, SceneError> {
        let mut all = Located::default();
        for dataset in &self.datasets {
            let Located { members, notes } = dataset.locate(scene)?;
            all.members.extend(members.into_iter().map(|member| {
                let families = member.families.or_else(|| self.look.families.clone());
                Member { families, ..member }
            }));
            all.notes.extend(notes);
        }
        Ok(all)
    }

    /// The files that this scene, which is the file `scene`, names: data, labels, and pictures that lie over it.
    pub fn files(&self, scene: &Path) -> Vec<PathBuf> {
        let data = self.datasets.iter().flat_map(|dataset| dataset.files(scene));
        let images = self.film.iter().flat_map(|film| &film.overlay.images).map(|image| &image.path);
        data.chain(self.labels.iter().chain(images).map(|path| located(path, scene))).collect()
    }
}

/// A file as a scene names it: relative where it lies in the scene's folder or below.
pub fn relative_to(path: &Path, scene: &Path) -> PathBuf {
    let path = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let folder = match folder_of(scene) {
        folder if folder.as_os_str().is_empty() => PathBuf::from("."),
        folder => folder,
    };
    let folder = folder.canonicalize().unwrap_or(folder);
    path.strip_prefix(&folder).map(Path::to_owned).unwrap_or(path)
}

/// Where a file that a scene names is: where the scene says, else beside the scene file if it is there.
pub fn located(path: &Path, scene: &Path) -> PathBuf {
    let folder = folder_of(scene);
    let named = named_in(&folder, path);
    let beside = path.file_name().map(|name| folder.join(name)).filter(|beside| beside.is_file() && !named.is_file());
    beside.unwrap_or(named)
}

/// A file that is named from a folder; a URL is named as it is, and whoever opens it tells whether it can be read from there.
pub fn named_in(folder: &Path, path: &Path) -> PathBuf {
    if is_url(path) { path.to_owned() } else { folder.join(path) }
}

/// The folder that a file lies in; empty for the working folder.
fn folder_of(file: &Path) -> PathBuf {
    file.parent().map(Path::to_owned).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_is_found_where_it_was_or_beside_the_scene_and_changes_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let (data, scene) = (folder.path().join("data"), folder.path().join("scenes"));
        for path in [&data, &scene] {
            std::fs::create_dir(path).unwrap();
        }
        let (file, scene) = (data.join("box.df"), scene.join("a.scene.ron"));
        std::fs::write(&file, vec![7; 200_000]).unwrap();
        let named = DatasetRef::of(&file, &scene);
        assert_eq!(
            named.locate(&scene).unwrap(),
            Located { members: vec![Member::new(file.canonicalize().unwrap())], notes: Vec::new() }
        );
        let below = DatasetRef::of(&file, &folder.path().join("b.scene.ron"));
        assert_eq!(below.path, Path::new("data/box.df"), "relative where that survives a move of both");

        // Moved: found beside the scene, and told.
        let moved = scene.with_file_name("box.df");
        std::fs::rename(&file, &moved).unwrap();
        let located = named.locate(&scene).unwrap();
        assert_eq!(located.members[0].path, moved);
        assert!(located.notes.len() == 1 && located.notes[0].contains("box.df is not there"), "{located:?}");

        // Changed: told, and opened all the same.
        let mut content = vec![7; 200_000];
        content[199_999] = 8;
        std::fs::write(&moved, &content).unwrap();
        let located = named.locate(&scene).unwrap();
        assert!(located.notes[1].contains("its content differs"), "{located:?}");
        std::fs::write(&moved, [1]).unwrap();
        assert!(named.locate(&scene).unwrap().notes[1].contains("it has 1 bytes and had 200000"));
        // The one that is the same is preferred.
        std::fs::write(&file, vec![7; 200_000]).unwrap();
        assert_eq!(named.locate(&scene).unwrap().members[0].path, file.canonicalize().unwrap());

        // What lies behind a URL is named as it is, wherever the scene lies; why it cannot be read is told where it is opened.
        let url = DatasetRef { path: "http://data.example/a.df?sig=1".into(), ..DatasetRef::default() };
        let located = url.locate(&scene).unwrap();
        assert_eq!(
            (located.members[0].path.as_path(), located.notes.len()),
            (Path::new("http://data.example/a.df"), 0)
        );

        let labels = |path: &str| super::located(Path::new(path), &scene);
        assert_eq!(labels("http://data.example/a.csv?sig=1"), Path::new("http://data.example/a.csv?sig=1"));
        assert_eq!(labels("a.csv"), scene.with_file_name("a.csv"));

        // A folder of slices is named as it is.
        let slices = data.join("slices");
        std::fs::create_dir(&slices).unwrap();
        for name in ["s0.png", "s1.png"] {
            std::fs::write(slices.join(name), b"\x89PNG\r\n\x1a\n").unwrap();
        }
        let named_slices = DatasetRef::of(&slices, &scene);
        let located = named_slices.locate(&scene).unwrap();
        assert_eq!((located.members[0].path.as_path(), located.notes.len()), (&*slices.canonicalize().unwrap(), 0));
        std::fs::write(slices.join("s2.png"), b"\x89PNG\r\n\x1a\n").unwrap();
        assert!(named_slices.locate(&scene).unwrap().notes[0].contains("slices is not the file that"));
        // So is a catalogue, whose files lie deeper.
        let (sky, partition) = (data.join("sky"), data.join("sky/dataset/Norder=0/Dir=0/Npix=4.parquet"));
        std::fs::create_dir_all(partition.parent().unwrap()).unwrap();
        std::fs::write(&partition, "PAR1").unwrap();
        let named_sky = DatasetRef::of(&sky, &scene);
        std::fs::write(sky.join("notes.txt"), "told").unwrap();
        assert!(named_sky.locate(&scene).unwrap().notes.is_empty());
        std::fs::write(&partition, "PAR1PAR1").unwrap();
        assert!(named_sky.locate(&scene).unwrap().notes[0].contains("it has 8 bytes and had 4"));

        // Gone: both places are named, and what to do.
        std::fs::remove_file(&file).unwrap();
        std::fs::remove_file(&moved).unwrap();
        let message = named.locate(&scene).unwrap_err().to_string();
        for part in ["a.scene.ron", "data/box.df", "scenes/box.df", "deepfield tour"] {
            assert!(message.contains(part), "{message}");
        }
    }
}
