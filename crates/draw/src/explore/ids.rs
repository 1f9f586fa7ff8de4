//! Sets of particle ids: sorted, without gaps between what follows on, exact to all 64 bits.

use super::error::ExploreError;
use crate::store::temporary::{self, Temporary};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::io::{BufRead, BufWriter, Write};
use std::path::Path;
use std::sync::Arc;

/// A set of particle ids as runs of consecutive numbers, so that the ids of a halo, which come in runs, take little room. A copy
/// shares its runs.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct IdSet {
    /// First and last id of each run, ascending, with gaps between them.
    runs: Arc<[(u64, u64)]>,
    len: u64,
}

impl IdSet {
    /// The set of these ids, in any order, repeated or not.
    pub fn new(mut ids: Vec<u64>) -> IdSet {
        ids.sort_unstable();
        IdSet::of_runs(ids.into_iter().map(|id| (id, id)))
    }

    /// Joins runs whose first ids ascend.
    fn of_runs(sorted: impl IntoIterator<Item = (u64, u64)>) -> IdSet {
        let mut runs: Vec<(u64, u64)> = Vec::new();
        for (first, last) in sorted {
            match runs.last_mut() {
                Some(run) if first <= run.1.saturating_add(1) => run.1 = run.1.max(last),
                _ => runs.push((first, last)),
            }
        }
        let len = runs.iter().fold(0_u64, |len, (first, last)| len.saturating_add((last - first).saturating_add(1)));
        IdSet { runs: runs.into(), len }
    }

    /// How many ids (all 2^64 of them count one less).
    pub fn len(&self) -> u64 {
        self.len
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.runs.is_empty()
    }

    /// Whether `id` is in the set.
    pub fn contains(&self, id: u64) -> bool {
        let after = self.runs.partition_point(|run| run.0 <= id);
        after > 0 && id <= self.runs[after - 1].1
    }

    /// First and last id of each run of consecutive ids, ascending.
    pub fn runs(&self) -> &[(u64, u64)] {
        &self.runs
    }

    /// The ids, ascending.
    pub fn iter(&self) -> impl Iterator<Item = u64> + '_ {
        self.runs.iter().flat_map(|(first, last)| *first..=*last)
    }

    /// What is in either set.
    #[must_use]
    pub fn union(&self, other: &IdSet) -> IdSet {
        let mut runs: Vec<_> = self.runs.iter().chain(&*other.runs).copied().collect();
        runs.sort_unstable();
        IdSet::of_runs(runs)
    }

    /// Reads a set from text: ids and runs `first-last`, separated by commas, blanks or line ends, in any order. What follows
    /// a `#` up to the end of its line is left out.
    ///
    /// # Errors
    /// The number of the line and the word that is neither.
    pub fn parse(text: &str) -> Result<IdSet, (usize, String)> {
        let mut runs = Vec::new();
        for (line, text) in text.lines().enumerate() {
            parse_line(text, &mut runs).map_err(|word| (line + 1, word))?;
        }
        runs.sort_unstable();
        Ok(IdSet::of_runs(runs))
    }

    /// Reads a file of ids, as [`IdSet::parse`].
    ///
    /// # Errors
    /// When the file cannot be read or has something else in it.
    pub fn read(path: &Path) -> Result<IdSet, ExploreError> {
        let io = |source| ExploreError::io(path, "reading", source);
        let mut file = std::io::BufReader::new(std::fs::File::open(path).map_err(io)?);
        let (mut runs, mut line, mut number) = (Vec::new(), Vec::new(), 0_usize);
        loop {
            line.clear();
            number += 1;
            // No id needs a line that is longer than a mebibyte; a file of one endless line is not read into memory.
            let mut most = std::io::Read::take(&mut file, 1 << 20);
            if most.read_until(b'\n', &mut line).map_err(io)? == 0 {
                break;
            }
            let wrong = |found: String| {
                ExploreError::malformed(path, format!("line {number}"), found, "ids or runs such as 20-31")
            };
            if line.len() == 1 << 20 {
                return Err(wrong("more than a mebibyte".into()));
            }
            let text = std::str::from_utf8(&line).map_err(|_| wrong("something else than text".into()))?;
            parse_line(text, &mut runs).map_err(|word| wrong(format!("{word:?}")))?;
        }
        runs.sort_unstable();
        Ok(IdSet::of_runs(runs))
    }

    /// Writes a file of ids, a run or an id each line, under a temporary name first. `about` goes into a first line.
    ///
    /// # Errors
    /// When the file cannot be written; one that was there before stays as it was.
    pub fn write(&self, path: &Path, about: &str) -> Result<(), ExploreError> {
        let io = |source| ExploreError::io(path, "writing", source);
        temporary::clean(path, temporary::folder_of(path));
        let file = Temporary::create(path, None).map_err(io)?;
        let mut out = BufWriter::new(file.file());
        let write = |out: &mut BufWriter<_>| {
            writeln!(out, "# {} ids{about}", self.len)?;
            for (first, last) in &*self.runs {
                if first == last { writeln!(out, "{first}")? } else { writeln!(out, "{first}-{last}")? }
            }
            out.flush()
        };
        write(&mut out).map_err(io)?;
        drop(out);
        file.persist(path).map_err(io)?;
        Ok(())
    }
}

/// Adds the runs of a line; the error is the word that is none.
fn parse_line(text: &str, runs: &mut Vec<(u64, u64)>) -> Result<(), String> {
    let text = text.split('#').next().unwrap_or_default();
    for word in text.split([',', ' ', '\t', '\r', '\n', ';']).filter(|word| !word.is_empty()) {
        let (first, last) = word.split_once('-').unwrap_or((word, word));
        match (first.parse(), last.parse()) {
            (Ok(first), Ok(last)) if first <= last => runs.push((first, last)),
            _ => return Err(word.chars().take(40).collect()),
        }
    }
    Ok(())
}

impl std::fmt::Display for IdSet {
    /// As in scene files: `17,20-31`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (i, (first, last)) in self.runs.iter().enumerate() {
            let comma = if i == 0 { "" } else { "," };
            if first == last { write!(f, "{comma}{first}")? } else { write!(f, "{comma}{first}-{last}")? }
        }
        Ok(())
    }
}

impl Serialize for IdSet {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for IdSet {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<IdSet, D::Error> {
        let text = String::deserialize(deserializer)?;
        IdSet::parse(&text).map_err(|(_, word)| {
            serde::de::Error::custom(format!("expected ids and runs such as \"17,20-31\", found {word:?}"))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    proptest! {
        #[test]
        fn sets_are_what_went_in(ids in prop::collection::vec(prop_oneof![0..40_u64, any::<u64>(), (u64::MAX - 3)..=u64::MAX], 0..60)) {
            let expected: BTreeSet<u64> = ids.iter().copied().collect();
            let set = IdSet::new(ids.clone());
            prop_assert!(set.iter().eq(expected.iter().copied()));
            prop_assert_eq!(set.len(), expected.len() as u64);
            for id in ids.iter().flat_map(|id| [id.wrapping_sub(1), *id, id.wrapping_add(1)]) {
                prop_assert_eq!(set.contains(id), expected.contains(&id));
            }
            prop_assert_eq!(&IdSet::parse(&set.to_string()).unwrap(), &set);
            let (a, b) = ids.split_at(ids.len() / 2);
            prop_assert_eq!(&IdSet::new(a.to_vec()).union(&IdSet::new(b.to_vec())), &set);
        }
    }

    #[test]
    fn files_are_read_back_and_wrong_lines_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("halo.ids");
        let set = IdSet::new(vec![1 << 60, (1 << 60) + 1, 7, u64::MAX]);
        set.write(&path, " of a halo").unwrap();
        assert_eq!(IdSet::read(&path).unwrap(), set);
        for wrong in ["7\n8-\n", "1 2\n-5", "1\n9-8", "1\n1e3", "1\n18446744073709551616"] {
            std::fs::write(&path, wrong).unwrap();
            let message = IdSet::read(&path).unwrap_err().to_string();
            assert!(message.contains("halo.ids: line 2: found"), "{message}");
        }
        std::fs::write(&path, vec![b'1'; 3 << 20]).unwrap();
        assert!(IdSet::read(&path).unwrap_err().to_string().contains("line 1"));
        assert!(IdSet::read(&folder.path().join("none")).is_err());
    }
}
