//! Files that were opened before: a short list in the user's configuration folder, the latest first, which all windows share.

use crate::import::file_of_step;
use crate::model::ron_file::{self, RonError};
use crate::model::{is_url, new_file};
use crate::window::state::answer::Answer;
use etcetera::BaseStrategy;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::path::{Path, PathBuf};

/// Files that are kept.
const MOST: usize = 12;
/// Bytes of a list that is read at most.
const MOST_BYTES: u64 = 1 << 20;
/// The version of the list.
const VERSION: u32 = 1;
/// Seconds after which it is looked again which files are there.
const LOOK_SECS: f64 = 5.0;

/// The list as it is written.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Text {
    version: u32,
    files: Vec<String>,
}

/// A file that was opened before.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Known {
    /// Where it was.
    pub path: PathBuf,
    /// Whether it is not there any more.
    pub is_missing: bool,
}

/// Where the user's list is; `None` where he has no home folder.
pub fn list_of_user() -> Option<PathBuf> {
    let base = etcetera::choose_base_strategy().ok()?;
    Some(base.config_dir().join("deepfield").join("recent.ron"))
}

/// Whether a file is one of the user's, not one that was built or written in the cache folder.
fn is_of_user(path: &Path) -> bool {
    let base = etcetera::choose_base_strategy().ok();
    base.is_none_or(|base| !path.starts_with(base.cache_dir().join("deepfield")))
}

/// The files of a list, the latest first; none where there is no list.
///
/// # Errors
/// When the list cannot be read, or is none.
fn read(list: &Path) -> Result<Vec<PathBuf>, RonError> {
    let name = list.display().to_string();
    match std::fs::metadata(list) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Ok(about) if about.len() > MOST_BYTES => {
            return Err(RonError::value(&name, "length", about.len(), format!("at most {MOST_BYTES} bytes")));
        }
        _ => {}
    }
    let (name, text) = ron_file::read_text(list)?;
    if let Some(version) = ron_file::later_version(&text, VERSION) {
        return Err(RonError::value(&name, "version", version, format!("{VERSION}")));
    }
    let files = ron_file::parse::<Text>(&name, &text)?.files;
    let checked = files.into_iter().take(MOST).enumerate().map(|(index, file)| match is_whole(Path::new(&file)) {
        true => Ok(PathBuf::from(file)),
        false => Err(RonError::value(&name, &format!("files[{index}]"), file, "a whole path")),
    });
    checked.collect()
}

/// Whether a path names the same file from every folder.
fn is_whole(path: &Path) -> bool {
    path.is_absolute() || is_url(path)
}

/// Writes a list anew: whole, or not at all. What is not Unicode is left out.
fn write(list: &Path, files: &[PathBuf]) -> Result<(), String> {
    let files = files.iter().filter_map(|path| path.to_str()).map(str::to_owned).collect();
    let text = ron::ser::to_string_pretty(&Text { version: VERSION, files }, ron::ser::PrettyConfig::default());
    let text = text.map_err(|error| format!("{}: {error}", list.display()))? + "\n";
    let folder = list.parent().map_or(Ok(()), std::fs::create_dir_all);
    folder.and_then(|()| new_file::write(list, &text)).map_err(|error| format!("{}: {error}", list.display()))
}

/// Puts a file at the head, where it is the only one of its name.
fn put_first(files: &mut Vec<PathBuf>, path: &Path) {
    files.retain(|known| known != path);
    files.insert(0, path.to_owned());
    files.truncate(MOST);
}

/// Puts a file at the head of a list.
fn add(list: &Path, path: &Path) -> Result<(), String> {
    // Another window may have written it meanwhile.
    let mut files = read(list).map_err(|error| error.to_string())?;
    put_first(&mut files, path);
    write(list, &files)
}

/// What is done with a list.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Job {
    Look,
    Add(PathBuf),
    Clear,
}

impl Job {
    /// Does it; what is in the list then.
    fn run(self, list: &Path) -> Result<Vec<Known>, String> {
        match self {
            Job::Look => {}
            Job::Add(path) => add(list, &path)?,
            Job::Clear => write(list, &[])?,
        }
        let files = read(list).map_err(|error| error.to_string())?;
        Ok(files
            .into_iter()
            .map(|path| Known { is_missing: !is_url(&path) && !file_of_step(&path).exists(), path })
            .collect())
    }
}

/// The list as the window knows it. A disk that does not answer holds up none of its frames.
#[derive(Default)]
pub struct Recent {
    list: Option<PathBuf>,
    files: Vec<Known>,
    work: Answer<Vec<Known>>,
    to_do: VecDeque<Job>,
    next_look_secs: f64,
    told: Option<String>,
}

impl Recent {
    /// The list in a file; none is kept where it is `None`.
    pub fn new(list: Option<PathBuf>) -> Recent {
        Recent { list, to_do: [Job::Look].into(), ..Recent::default() }
    }

    /// The files, the latest first.
    pub fn files(&self) -> &[Known] {
        &self.files
    }

    /// Puts a file at the head.
    pub(super) fn add(&mut self, path: &Path) {
        let whole = if is_url(path) { Ok(path.to_owned()) } else { std::path::absolute(path) };
        if let Ok(path) = whole
            && is_of_user(&path)
        {
            self.to_do.push_back(Job::Add(path));
        }
    }

    /// Forgets all of them.
    pub(super) fn clear(&mut self) {
        self.to_do.push_back(Job::Clear);
    }

    /// Looks now and then what is in the list, and which of it is there, as long as it is shown.
    pub(super) fn keep_fresh(&mut self, now_secs: f64) {
        if now_secs >= self.next_look_secs && self.to_do.is_empty() {
            self.next_look_secs = now_secs + LOOK_SECS;
            self.to_do.push_back(Job::Look);
        }
    }

    /// Goes on with what is to be done; what has gone wrong, once.
    pub(super) fn go_on(&mut self) -> Option<String> {
        self.work.receive();
        if matches!(self.work, Answer::Coming(_)) {
            return None;
        }
        let failed = match std::mem::take(&mut self.work) {
            Answer::Here(files) => {
                self.files = files;
                None
            }
            Answer::Failed(why) => Some(why).filter(|why| self.told.as_ref() != Some(why)),
            Answer::Nothing | Answer::Coming(_) => None,
        };
        if let Some(why) = &failed {
            self.told = Some(why.clone());
        }
        if let (Some(list), Some(job)) = (self.list.clone(), self.to_do.pop_front()) {
            self.work = Answer::ask("recent files", move |_| job.run(&list));
        }
        failed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Whatever is opened: the latest files stay, each once, the latest first.
        #[test]
        fn the_latest_files_stay(opened in prop::collection::vec(0..20_u8, 0..60)) {
            let path = |number: &u8| PathBuf::from(format!("/data/snapshot_{number}.hdf5"));
            let mut files = Vec::new();
            opened.iter().for_each(|number| put_first(&mut files, &path(number)));
            let mut expected: Vec<PathBuf> = Vec::new();
            for path in opened.iter().rev().map(path) {
                if !expected.contains(&path) && expected.len() < MOST {
                    expected.push(path);
                }
            }
            prop_assert_eq!(files, expected);
        }
    }

    #[test]
    fn a_list_is_read_as_it_was_written_and_missing_files_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let list = folder.path().join("deepfield").join("recent.ron");
        let [there, gone] = ["a \"quoted\" Ω.hdf5", "gone.df"].map(|name| folder.path().join(name));
        std::fs::write(&there, "").unwrap();
        assert_eq!(Job::Look.run(&list).unwrap(), []);
        assert_eq!(Job::Add(there.clone()).run(&list).unwrap().len(), 1);
        let known = Job::Add(gone.clone()).run(&list).unwrap();
        let expected = [(gone, true), (there, false)].map(|(path, is_missing)| Known { path, is_missing });
        assert_eq!(known, expected);
        assert_eq!(Job::Clear.run(&list).unwrap(), []);
    }

    #[test]
    fn a_list_that_is_none_is_told_and_left_as_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let list = folder.path().join("recent.ron");
        for (text, why) in [
            ("(version: 2, files: [], more: 1)", "version is 2, expected 1"),
            ("(version: 1, files: [\"a.df\"])", "files[0] is a.df, expected a whole path"),
            ("(version: 1, files: 7)", "recent.ron:1:"),
            ("(((", "recent.ron:1:"),
            ("\u{0}\u{7f}(((", "recent.ron: content: found no text, expected RON"),
        ] {
            std::fs::write(&list, text).unwrap();
            let told = add(&list, &folder.path().join("b.df")).unwrap_err();
            assert!(told.contains(why), "{text}: {told}");
            assert_eq!(std::fs::read_to_string(&list).unwrap(), text);
        }
        std::fs::write(&list, vec![b' '; MOST_BYTES as usize + 1]).unwrap();
        assert!(read(&list).unwrap_err().to_string().contains("length is 1048577, expected at most 1048576 bytes"));
    }

    #[test]
    fn what_lies_in_the_cache_is_not_remembered() {
        let cache = etcetera::choose_base_strategy().unwrap().cache_dir().join("deepfield");
        assert!(!is_of_user(&cache.join("demo").join("demo.hdf5")) && is_of_user(Path::new("/data/demo.hdf5")));
    }
}
