//! The name of one of several arrays in a file: the file's, `#` and the array's, as in `run.h5#fields/density`. Whatever takes the name
//! of a grid takes that.

use std::path::Path;

/// The file and the array that a name stands for; a file that has such a name itself is meant by it.
pub(in crate::import) fn parts(path: &Path) -> (&Path, Option<&str>) {
    let whole = (path, None);
    let Some(text) = path.to_str().filter(|text| text.contains('#') && !path.exists()) else { return whole };
    let mut named = text.match_indices('#').map(|(at, _)| (Path::new(&text[..at]), &text[at + 1..]));
    let found = named.find(|(file, part)| !part.is_empty() && file.is_file());
    found.map_or(whole, |(file, part)| (file, Some(part)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_array_is_named_behind_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("a.h5"), "").unwrap();
        std::fs::write(path("b#1.h5"), "").unwrap();
        let named = |name: &str| {
            let path = path(name);
            let (file, part) = parts(&path);
            (file.file_name().unwrap().to_str().unwrap().to_owned(), part.map(str::to_owned))
        };
        let of = |file: &str, part: &str| (file.to_owned(), Some(part.to_owned()));
        assert_eq!(named("a.h5#fields/density"), of("a.h5", "fields/density"));
        assert_eq!(named("b#1.h5#v"), of("b#1.h5", "v"));
        assert_eq!(named("a.h5#x#2"), of("a.h5", "x#2"));
        for whole in ["a.h5", "b#1.h5", "a.h5#", "c.h5#v"] {
            assert_eq!(named(whole), (whole.to_owned(), None));
        }
    }
}
