//! The files that a run is named by: single names, folders, patterns and lists.

use crate::import::folder::{claimants, listed, name_of, whole};
use crate::import::{ImportError, file_in};
use std::cmp::Ordering;
use std::path::{Path, PathBuf};

/// The files that the names stand for, each once, in the order in which they were named; those of a folder, of a pattern or of a
/// list in the order of their numbers, or of the list.
///
/// A name is a file; a folder, which stands for the one source in it or for the largest group of files in it whose names differ only
/// in their numbers; a pattern with `*`, `?` or `[...]`; or `@` and a text file with such a name in each line, relative to its own
/// folder, where `#` begins a comment.
///
/// # Errors
/// [`ImportError`] where a list or folder cannot be read, or a pattern or folder has no source.
pub(super) fn expand(names: &[PathBuf]) -> Result<Vec<PathBuf>, ImportError> {
    let mut files = Vec::new();
    for name in names {
        match list_of(name) {
            Some(list) => {
                let folder = list.parent().unwrap_or(Path::new(""));
                let text = std::fs::read_to_string(&list).map_err(|error| ImportError::io(&list, "list", error))?;
                let lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
                for line in lines {
                    expand_one(&folder.join(line), &mut files)?;
                }
            }
            None => expand_one(name, &mut files)?,
        }
    }
    let mut seen = std::collections::HashSet::new();
    files.retain(|file| seen.insert(file.clone()));
    Ok(files)
}

/// The list that `@LIST` names.
fn list_of(name: &Path) -> Option<PathBuf> {
    let text = name.to_str()?.strip_prefix('@')?;
    (!name.exists()).then(|| PathBuf::from(text))
}

fn expand_one(name: &Path, files: &mut Vec<PathBuf>) -> Result<(), ImportError> {
    if name.is_dir() {
        files.extend(in_folder(name)?);
        return Ok(());
    }
    let pattern = name.to_str().filter(|text| text.contains(['*', '?', '[']) && !name.exists());
    let Some(pattern) = pattern else {
        files.push(name.to_owned());
        return Ok(());
    };
    let wrong = |found: String| ImportError::malformed(name, "pattern", found, "names of files, with *, ? or [...]");
    let found = glob::glob(pattern).map_err(|error| wrong(error.to_string()))?;
    let mut found: Vec<PathBuf> = found.filter_map(Result::ok).collect();
    if found.is_empty() {
        return Err(wrong("no file of such a name".into()));
    }
    found.sort_by(|a, b| by_numbers(a, b));
    for path in found {
        match path.is_dir() {
            true => files.extend(in_folder(&path)?),
            false => files.push(path),
        }
    }
    Ok(())
}

/// The sources of a folder that make a run: of the files that claim to be sources, the largest group whose names differ only in
/// their numbers; where there is none of two or more, of the folders inside, each of which is a snapshot in several files; else the
/// one source in it.
fn in_folder(folder: &Path) -> Result<Vec<PathBuf>, ImportError> {
    if let Some(file) = whole(folder) {
        return Ok(vec![file]);
    }
    let io = |error| ImportError::io(folder, "folder", error);
    let files = largest_group(claimants(folder)?);
    if files.len() > 1 {
        return Ok(files);
    }
    let entries = std::fs::read_dir(folder).map_err(io)?.collect::<Result<Vec<_>, _>>().map_err(io)?;
    let folders = largest_group(entries.into_iter().map(|entry| entry.path()).filter(|path| path.is_dir()).collect());
    if files.is_empty() && folders.len() > 1 {
        return folders.iter().map(|folder| file_in(folder, &[])).collect();
    }
    Ok(vec![file_in(folder, &[])?])
}

/// The largest group of paths whose names differ only in their numbers, in the order of these.
fn largest_group(paths: Vec<PathBuf>) -> Vec<PathBuf> {
    let mut groups = std::collections::BTreeMap::<String, Vec<PathBuf>>::new();
    for path in paths {
        let shape: String = words(&name_of(&path)).iter().map(|word| word.number.map_or(word.text, |_| "#")).collect();
        groups.entry(shape).or_default().push(path);
    }
    // Of several as large, the first one.
    let mut largest = groups.into_values().rev().max_by_key(Vec::len).unwrap_or_default();
    largest.sort_by(|a, b| by_numbers(a, b));
    largest
}

/// A part of a name: all digits, or none.
struct Word<'a> {
    text: &'a str,
    number: Option<u128>,
}

fn words(name: &str) -> Vec<Word<'_>> {
    let mut words = Vec::new();
    let mut rest = name;
    while let Some(first) = rest.chars().next() {
        let is_digits = first.is_ascii_digit();
        let end = rest.find(|c: char| c.is_ascii_digit() != is_digits).unwrap_or(rest.len());
        let (text, after) = rest.split_at(end);
        // More digits than that are compared as text.
        words.push(Word { text, number: if is_digits { text.parse().ok() } else { None } });
        rest = after;
    }
    words
}

/// The order of names in which `snap_9` comes before `snap_10`.
pub(super) fn by_numbers(a: &Path, b: &Path) -> Ordering {
    let (a, b) = (a.to_string_lossy(), b.to_string_lossy());
    let (one, other) = (words(&a), words(&b));
    let compared = one.iter().zip(&other).map(|(one, other)| match (one.number, other.number) {
        (Some(one), Some(other)) => one.cmp(&other),
        _ => one.text.cmp(other.text),
    });
    let differing = compared.into_iter().find(|order| order.is_ne());
    differing.unwrap_or_else(|| one.len().cmp(&other.len()).then_with(|| a.cmp(&b)))
}

/// A sentence for each place where the numbers in the names leave out more than they do elsewhere. `files` are in the order of time.
pub(super) fn gaps(files: &[&Path]) -> Vec<String> {
    let names: Vec<String> = files.iter().map(|file| name_of(file)).collect();
    let step = |pair: &[String]| {
        let (before, after) = (words(&pair[0]), words(&pair[1]));
        if before.len() != after.len() {
            return None;
        }
        let mut differing = before.iter().zip(&after).filter(|(before, after)| before.text != after.text);
        let (before, after) = differing.next()?;
        let only = differing.next().is_none();
        after.number?.checked_sub(before.number?).filter(|step| only && *step > 0)
    };
    let steps: Vec<Option<u128>> = names.windows(2).map(step).collect();
    let Some(usual) = steps.iter().flatten().min().copied() else { return Vec::new() };
    let is_gap = |step: &Option<u128>| step.is_some_and(|step| step > usual);
    let gaps = names.windows(2).zip(&steps).filter(|(_, step)| is_gap(step)).map(|(pair, _)| pair);
    let told: Vec<String> = gaps.map(|pair| format!("no file between {} and {}", pair[0], pair[1])).collect();
    match told.len() {
        0..=4 => told.into_iter().map(|gap| gap + ": the interval is longer").collect(),
        _ => vec![format!("{}: the intervals are longer", listed(&told, told.len()))],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stand_for_files() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let table = "x,y,z\n0,0,0\n1,1,1\n";
        for name in ["t_9.csv", "t_10.csv", "t_1.csv", "other.csv"] {
            std::fs::write(at(name), table).unwrap();
        }
        std::fs::write(at("notes.bin"), [0, 1, 2, 255]).unwrap();
        let numbered = vec![at("t_1.csv"), at("t_9.csv"), at("t_10.csv")];
        assert_eq!(expand(&[folder.path().to_owned()]).unwrap(), numbered);
        assert_eq!(expand(&[at("t_*.csv")]).unwrap(), numbered);
        assert_eq!(expand(&[at("t_[19].csv"), at("t_9.csv")]).unwrap(), numbered[..2]);
        std::fs::write(at("list.txt"), "# a run\n\nt_10.csv\nt_?.csv\n").unwrap();
        let list = PathBuf::from(format!("@{}", at("list.txt").display()));
        assert_eq!(expand(&[list]).unwrap(), [at("t_10.csv"), at("t_1.csv"), at("t_9.csv")]);
        assert!(expand(&[at("u_*.csv")]).unwrap_err().to_string().contains("u_*.csv: pattern: found no file"));
        assert!(expand(&[PathBuf::from("@absent.txt")]).unwrap_err().to_string().starts_with("absent.txt: list"));

        // Snapshots in folders of their own.
        let run = tempfile::tempdir().unwrap();
        for step in [2, 11] {
            std::fs::create_dir(run.path().join(format!("step{step}"))).unwrap();
            std::fs::write(run.path().join(format!("step{step}/table.csv")), table).unwrap();
        }
        let inside = [run.path().join("step2/table.csv"), run.path().join("step11/table.csv")];
        assert_eq!(expand(&[run.path().to_owned()]).unwrap(), inside);
        let empty = tempfile::tempdir().unwrap();
        assert!(expand(&[empty.path().to_owned()]).unwrap_err().to_string().contains("nothing"));
    }

    #[test]
    fn gaps_are_what_the_numbers_leave_out() {
        let gaps_of = |names: &[&str]| gaps(&names.iter().map(Path::new).collect::<Vec<_>>());
        assert_eq!(gaps_of(&["s_001.hdf5", "s_002.hdf5", "s_003.hdf5"]), [""; 0]);
        assert_eq!(gaps_of(&["s_001", "s_002", "s_004"]), ["no file between s_002 and s_004: the interval is longer"]);
        // Every fifth is the run's own spacing.
        assert_eq!(gaps_of(&["s_000", "s_005", "s_010"]), [""; 0]);
        assert_eq!(gaps_of(&["a", "b", "c"]), [""; 0]);
        assert_eq!(gaps_of(&["s_2", "s_1"]), [""; 0]);
        assert_eq!(gaps_of(&["s_1", "s_2", "s_4", "s_6", "s_8", "s_10", "s_12"]).len(), 1);
    }
}
