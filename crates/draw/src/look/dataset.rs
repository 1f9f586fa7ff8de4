//! A scene's data: by path, and by a fingerprint that tells whether it is still the same.

use super::{Attribute, HeightsSaid, Member, SceneError, SceneFile, TakenFor, data_file};
use crate::color::transfer::TransferFunction;
use crate::heights::import::PhotoChoice;
use crate::import::files_of;
use crate::mode::{Mode, Settings};
use crate::model::url::shown;
use crate::model::{DerivedQuantity, FamilyName, ReadMethod, Unit, is_url};
use crate::store::known_disk;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A dataset that a scene shows.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(from = "DatasetText", into = "DatasetText")]
pub struct DatasetRef {
    /// The source or page file; where it is relative, from the scene file's folder.
    pub path: PathBuf,
    /// What the file was when the scene was saved.
    pub fingerprint: Option<Fingerprint>,
    /// The families that are drawn; all where it is `None`.
    pub families: Option<Vec<FamilyName>>,
    /// Where its origin lies in the scene, the length unit of the scene's first dataset.
    pub offset: [f64; 3],
    /// Scene lengths for one of its own; what the units say, and else 1, where it is `None`.
    pub scale: Option<f64>,
    /// What is said of it; paths of a photo and of an earlier state of heights are as the dataset's.
    pub said: HeightsSaid,
    /// How it is drawn among other data where it is an image or a volume.
    pub own_look: Option<OwnLook>,
}

/// How an image or a volume is drawn among other data.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OwnLook {
    /// The mode; `volume` or `image` where it is `None`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mode: Option<&'static Mode>,
    /// Its settings.
    #[serde(skip_serializing_if = "Settings::is_empty")]
    pub settings: Settings,
    /// Which channel gives the hue.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub attribute: Option<Attribute>,
    /// From values to colours; the usual one of such values where it is `None`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transfer: Option<TransferFunction>,
}

/// A dataset as files have it.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct DatasetText {
    path: PathBuf,
    #[serde(default)]
    fingerprint: Option<Fingerprint>,
    #[serde(default)]
    families: Option<Vec<FamilyName>>,
    #[serde(default)]
    offset: [f64; 3],
    #[serde(default)]
    scale: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    kind: Option<TakenFor>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    nodata: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    spacing: Option<[f64; 2]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    xy_unit: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    height_unit: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    texture: Option<PathBuf>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    texture_at: Option<[f64; 4]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    before: Option<PathBuf>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    derive: Vec<DerivedText>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    look: Option<OwnLook>,
}

/// A derived quantity by its name.
#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
struct DerivedText(DerivedQuantity);

impl TryFrom<String> for DerivedText {
    type Error = String;

    fn try_from(name: String) -> Result<DerivedText, String> {
        let names = || DerivedQuantity::ALL.map(DerivedQuantity::name).join(", ");
        let found =
            DerivedQuantity::of_name(&name).ok_or_else(|| format!("found {name:?}, expected one of {}", names()));
        found.map(DerivedText)
    }
}

impl From<DerivedText> for String {
    fn from(DerivedText(quantity): DerivedText) -> String {
        quantity.name().to_owned()
    }
}

impl From<DatasetText> for DatasetRef {
    fn from(text: DatasetText) -> DatasetRef {
        let rectangle = text.texture_at;
        let said = HeightsSaid {
            taken_for: text.kind,
            nodata: text.nodata,
            spacing: text.spacing,
            xy_unit: text.xy_unit.map(Unit::new),
            height_unit: text.height_unit.map(Unit::new),
            texture: text.texture.map(|path| PhotoChoice { path, rectangle }),
            before: text.before,
            derive: text.derive.iter().map(|DerivedText(quantity)| *quantity).collect(),
        };
        let DatasetText { path, fingerprint, families, offset, scale, look, .. } = text;
        DatasetRef { path: shown(&path), fingerprint, families, offset, scale, said, own_look: look }
    }
}

impl From<DatasetRef> for DatasetText {
    fn from(dataset: DatasetRef) -> DatasetText {
        let DatasetRef { path, fingerprint, families, offset, scale, said, own_look } = dataset;
        DatasetText {
            path,
            fingerprint,
            families,
            offset,
            scale,
            kind: said.taken_for,
            nodata: said.nodata,
            spacing: said.spacing,
            xy_unit: said.xy_unit.map(|unit| unit.0),
            height_unit: said.height_unit.map(|unit| unit.0),
            texture_at: said.texture.as_ref().and_then(|photo| photo.rectangle),
            texture: said.texture.map(|photo| photo.path),
            before: said.before,
            derive: said.derive.into_iter().map(DerivedText).collect(),
            look: own_look,
        }
    }
}

/// What tells one file from another without reading all of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fingerprint {
    /// Its length.
    pub bytes: u64,
    /// CRC-32C of its first and last [`SPAN`] bytes.
    pub crc32c: u32,
}

/// Bytes at either end that a fingerprint is made of.
pub const SPAN: u64 = 1 << 16;

impl Fingerprint {
    /// The fingerprint of a file; of a folder that of the names and lengths of the files that are read of it, none where nothing in it can be
    /// opened, which is told where it is.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn of(path: &Path) -> std::io::Result<Fingerprint> {
        if path.is_dir() {
            return Fingerprint::of_folder(path);
        }
        let file = known_disk(path, ReadMethod::default(), "file").map_err(std::io::Error::other)?;
        let bytes = file.size()?;
        let span = bytes.min(SPAN);
        let mut ends = vec![0; 2 * span as usize];
        let (first, last) = ends.split_at_mut(span as usize);
        file.read_exact_at(first, 0)?;
        file.read_exact_at(last, bytes - span)?;
        Ok(Fingerprint { bytes, crc32c: crc32c::crc32c(&ends) })
    }

    fn of_folder(path: &Path) -> std::io::Result<Fingerprint> {
        let mut files = Vec::new();
        for file in files_of(path).unwrap_or_default() {
            let bytes = std::fs::metadata(&file)?.len();
            files.push((file.strip_prefix(path).unwrap_or(&file).as_os_str().to_owned(), bytes));
        }
        files.sort();
        let bytes = files.iter().map(|(_, bytes)| bytes).sum();
        let crc32c = files.iter().fold(0, |crc, (name, bytes)| {
            crc32c::crc32c_append(crc32c::crc32c_append(crc, name.as_encoded_bytes()), &bytes.to_le_bytes())
        });
        Ok(Fingerprint { bytes, crc32c })
    }
}

/// Where a scene's data is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Located {
    /// The datasets to open.
    pub members: Vec<Member>,
    /// What the user should know about it, a sentence each.
    pub notes: Vec<String>,
}

impl DatasetRef {
    /// The data at `path` as a scene beside it, or anywhere else, names it: relative where it lies in the scene's folder or below.
    pub fn of(path: &Path, scene: &Path) -> DatasetRef {
        let fingerprint = Fingerprint::of(path).ok();
        DatasetRef { path: relative_to(path, scene), fingerprint, ..DatasetRef::default() }
    }

    /// The same for what a user says of a member: where it lies, and its heights.
    #[must_use]
    pub fn of_member(member: &Member, scene: &Path) -> DatasetRef {
        let photo = |photo: PhotoChoice| PhotoChoice { path: relative_to(&photo.path, scene), ..photo };
        let before = member.said.before.as_ref().map(|before| relative_to(before, scene));
        let said = HeightsSaid { texture: member.said.texture.clone().map(photo), before, ..member.said.clone() };
        let (offset, scale, own_look) = (member.offset.to_array(), member.scale, member.own_look.clone());
        DatasetRef { offset, scale, said, own_look, ..DatasetRef::of(&member.path, scene) }
    }

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
        let (offset, scale, families) = (DVec3::from(self.offset), self.scale, self.families.clone());
        let photo = |photo: PhotoChoice| PhotoChoice { path: located(&photo.path, scene), ..photo };
        let before = self.said.before.as_ref().map(|before| located(before, scene));
        let said = HeightsSaid { texture: self.said.texture.clone().map(photo), before, ..self.said.clone() };
        let own_look = self.own_look.clone();
        Ok(Located { members: vec![Member { path, offset, scale, families, said, own_look }], notes })
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
            let one = dataset.locate(scene)?;
            let families = |member: Member| member.families.clone().or(self.look.families.clone());
            all.members
                .extend(one.members.into_iter().map(|member| Member { families: families(member.clone()), ..member }));
            all.notes.extend(one.notes);
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
