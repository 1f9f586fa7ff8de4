//! The name of a step in a file that holds several: the file's, `#` and the step's number from 0, as in `movie.xyz#12`. Whatever takes
//! a source's name takes that.

use std::path::{Path, PathBuf};

/// The name of a step in a file.
pub fn step_name(file: &Path, step: u64) -> PathBuf {
    let mut name = file.as_os_str().to_owned();
    name.push(format!("#{step}"));
    name.into()
}

/// The file that a source's name stands for, without the number of a step, or the name of an array in it.
pub fn file_of_step(path: &Path) -> &Path {
    match parts(path) {
        (file, Some(_)) => file,
        (whole, None) => super::grid::file_of_part(whole),
    }
}

/// The file and the step that a name stands for; a file that has such a name itself is meant by it.
pub(super) fn parts(path: &Path) -> (&Path, Option<u64>) {
    let named = path.to_str().and_then(|text| text.rsplit_once('#'));
    let named = named.filter(|(_, step)| !step.is_empty() && step.bytes().all(|byte| byte.is_ascii_digit()));
    let step = named.and_then(|(file, step)| Some((Path::new(file), step.parse().ok()?)));
    match step {
        Some((file, step)) if !path.exists() && file.is_file() => (file, Some(step)),
        _ => (path, None),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_is_named_behind_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("movie.xyz");
        std::fs::write(&file, "").unwrap();
        let step = step_name(&file, 12);
        assert!(step.to_str().unwrap().ends_with("movie.xyz#12"));
        assert_eq!(parts(&step), (&*file, Some(12)));
        assert_eq!(parts(&file), (&*file, None));
        // Nothing of the kind, no such file, and a file of that name.
        for name in ["movie.xyz#", "movie.xyz#a", "other.xyz#1", "movie.xyz#99999999999999999999"] {
            let path = folder.path().join(name);
            assert_eq!(parts(&path), (&*path, None));
        }
        std::fs::write(&step, "").unwrap();
        assert_eq!(parts(&step), (&*step, None));
    }
}
