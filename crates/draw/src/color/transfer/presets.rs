//! Presets of transfer functions: built in, and files in the folder `assets/transfer` where the program finds one. A file
//! wins over a built-in one of the same name.

use super::TransferFunction;
use crate::model::new_file;
use crate::model::ron_file::{self, RonError};
use std::path::{Path, PathBuf};

/// Those that are built in: the files of this repository.
const PRESETS: &[(&str, &str)] = &[
    ("density", include_str!("../../../../../assets/transfer/density.ron")),
    ("density-hue", include_str!("../../../../../assets/transfer/density-hue.ron")),
    ("stars", include_str!("../../../../../assets/transfer/stars.ron")),
    ("grey", include_str!("../../../../../assets/transfer/grey.ron")),
    ("terrain", include_str!("../../../../../assets/transfer/terrain.ron")),
    ("land", include_str!("../../../../../assets/transfer/land.ron")),
    ("signed", include_str!("../../../../../assets/transfer/signed.ron")),
    ("cyclic", include_str!("../../../../../assets/transfer/cyclic.ron")),
    ("volume", include_str!("../../../../../assets/transfer/volume.ron")),
    ("volume-hue", include_str!("../../../../../assets/transfer/volume-hue.ron")),
    ("volume-values", include_str!("../../../../../assets/transfer/volume-values.ron")),
];

/// Where presets are files: `assets/transfer` in the folder that `BEVY_ASSET_ROOT` names, else beside the manifest under
/// cargo, else beside the executable; `None` where there is no such folder.
pub fn folder() -> Option<PathBuf> {
    let named = ["BEVY_ASSET_ROOT", "CARGO_MANIFEST_DIR"].iter().find_map(std::env::var_os).map(PathBuf::from);
    let beside = || Some(std::env::current_exe().ok()?.parent()?.to_owned());
    named.or_else(beside).map(|base| base.join("assets").join("transfer")).filter(|folder| folder.is_dir())
}

impl TransferFunction {
    /// Names of the built-in transfer functions.
    pub fn presets() -> impl Iterator<Item = &'static str> {
        PRESETS.iter().map(|(name, _)| *name)
    }

    /// A built-in transfer function.
    pub fn preset(name: &str) -> Option<TransferFunction> {
        let (_, text) = PRESETS.iter().find(|(known, _)| *known == name)?;
        TransferFunction::parse(text, name).ok()
    }

    /// Reads a file by its path (which ends in `.ron`), or a preset by its name: from a file in `folder`, or built in.
    ///
    /// # Errors
    /// [`RonError`], with the names of the presets where there is none.
    pub fn named(name: &str, folder: Option<&Path>) -> Result<TransferFunction, RonError> {
        if name.ends_with(".ron") {
            return ron_file::read(Path::new(name));
        }
        let file = folder.filter(|_| is_name(name)).map(|folder| folder.join(format!("{name}.ron")));
        if let Some(file) = file.filter(|file| file.is_file()) {
            return ron_file::read(&file);
        }
        TransferFunction::preset(name).ok_or_else(|| {
            let expected = format!("{} or a file that ends in .ron", names(folder).join(", "));
            RonError::value("transfer function", "its name", name, expected)
        })
    }

    /// Writes the file of a preset; it appears under its name only when it is complete.
    ///
    /// # Errors
    /// [`RonError`] for a name that is no file's name, and when the file system refuses.
    pub fn save(&self, name: &str, folder: &Path) -> Result<PathBuf, RonError> {
        if !is_name(name) {
            let expected = "letters, digits, `-` and `_`, at most 64 of them";
            return Err(RonError::value(&folder.display().to_string(), "the preset's name", name, expected));
        }
        let path = folder.join(format!("{name}.ron"));
        let io = |source: std::io::Error| RonError::Io { file: path.display().to_string(), source };
        new_file::write(&path, &format!("{}\n", self.to_ron())).map_err(io)?;
        Ok(path)
    }
}

/// Whether a preset may be called that: nothing that leads to another folder.
fn is_name(name: &str) -> bool {
    let fits = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    !name.is_empty() && name.len() <= 64 && name.chars().all(fits)
}

/// Names of all presets: those built in, then those that are only files, in alphabetical order.
pub fn names(folder: Option<&Path>) -> Vec<String> {
    let mut names: Vec<String> = TransferFunction::presets().map(str::to_owned).collect();
    let files = folder.and_then(|folder| std::fs::read_dir(folder).ok()).into_iter().flatten().flatten();
    let stems = files.filter_map(|entry| entry.file_name().to_str()?.strip_suffix(".ron").map(str::to_owned));
    let mut others: Vec<String> = stems.filter(|stem| is_name(stem) && !names.contains(stem)).collect();
    others.sort_unstable();
    names.append(&mut others);
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_parse_and_round_trip() {
        for (name, text) in PRESETS {
            let function = TransferFunction::parse(text, name).expect(name);
            assert_eq!(TransferFunction::parse(&function.to_ron(), name).expect(name), function);
        }
    }

    #[test]
    fn files_win_are_saved_and_refused() {
        let folder = tempfile::tempdir().unwrap();
        let at = Some(folder.path());
        let own = TransferFunction { gamma: 2.5, ..TransferFunction::default() };
        assert_eq!(TransferFunction::named("density", at).unwrap(), TransferFunction::preset("density").unwrap());
        for name in ["density", "my_own-2"] {
            let path = own.save(name, folder.path()).unwrap();
            assert_eq!(TransferFunction::named(name, at).unwrap(), own);
            assert_eq!(TransferFunction::named(path.to_str().unwrap(), None).unwrap(), own);
        }
        let all = names(at);
        assert_eq!((all.len(), all.last().map(String::as_str)), (PRESETS.len() + 1, Some("my_own-2")));
        for wrong in ["", "../up", "a/b", "a b", ".hidden"] {
            assert!(own.save(wrong, folder.path()).unwrap_err().to_string().contains("the preset's name"), "{wrong}");
            assert!(TransferFunction::named(wrong, at).unwrap_err().to_string().contains("density-hue"), "{wrong}");
        }
        std::fs::write(folder.path().join("bad.ron"), "(\n  gama: 1.0,\n)").unwrap();
        let message = TransferFunction::named("bad", at).unwrap_err().to_string();
        assert!(message.contains("bad.ron:2:") && message.contains("gama"), "{message}");
        assert!(TransferFunction::named("/nowhere/x.ron", None).unwrap_err().to_string().starts_with("/nowhere/x.ron"));
    }
}
