//! The files of other tasks that a task has open. It may read those of thousands, and others in the same process as many, while some systems
//! let a process have no more than 256 open.

use super::Header;
use std::collections::HashMap;
use std::fs::File;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Files that all tasks of a process have open together, about.
const MOST: usize = 128;

/// How many these tasks are.
static TASKS: AtomicUsize = AtomicUsize::new(0);

/// Where lanes begin, by their numbers.
pub(super) type Lanes = Arc<HashMap<u32, u64>>;

/// A file that has been opened for reading.
#[derive(Debug)]
pub(super) struct Opened {
    pub file: File,
    pub header: Header,
    pub lanes: Lanes,
    /// Whether it is the one that was opened first: else another has taken its place since.
    pub is_first: bool,
}

/// Those that a task has open.
#[derive(Debug)]
pub(super) struct OpenFiles {
    /// By the numbers of the tasks that have written them, each with when it was last asked for.
    files: HashMap<u32, (u64, Arc<Opened>)>,
    asked: u64,
    /// What each began with when it was first opened, and its lanes: there may be as many as buckets of a group, which is a lot to read at each
    /// opening.
    first: HashMap<u32, (Header, Lanes)>,
}

impl OpenFiles {
    /// None yet.
    pub fn new() -> OpenFiles {
        TASKS.fetch_add(1, Ordering::Relaxed);
        OpenFiles { files: HashMap::new(), asked: 0, first: HashMap::new() }
    }

    /// The file of a task, if it is open.
    pub fn get(&mut self, number: u32) -> Option<Arc<Opened>> {
        self.asked += 1;
        let (last, opened) = self.files.get_mut(&number)?;
        *last = self.asked;
        Some(Arc::clone(opened))
    }

    /// The lanes of the file of a task, if one that begins so has been open.
    pub fn lanes(&self, number: u32, header: &Header) -> Option<Lanes> {
        self.first.get(&number).filter(|(first, _)| first == header).map(|(_, lanes)| Arc::clone(lanes))
    }

    /// Keeps a file open that was asked for; those that were asked for longest ago are closed where there are too many.
    pub fn keep(&mut self, number: u32, file: File, header: Header, lanes: Lanes) -> Arc<Opened> {
        let most = (MOST / TASKS.load(Ordering::Relaxed).max(1)).max(1);
        while self.files.len() >= most
            && let Some(oldest) = self.files.iter().min_by_key(|(_, (last, _))| *last).map(|(number, _)| *number)
        {
            self.files.remove(&oldest);
        }
        let (first, _) = self.first.entry(number).or_insert_with(|| (header, Arc::clone(&lanes)));
        let is_first = *first == header;
        let opened = Arc::new(Opened { file, header, lanes, is_first });
        self.files.insert(number, (self.asked, Arc::clone(&opened)));
        opened
    }
}

impl Drop for OpenFiles {
    fn drop(&mut self) {
        TASKS.fetch_sub(1, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Names, Parts};
    use super::*;
    use crate::build::BuildError;
    use crate::build::spill::{Blob, Spill};
    use crate::model::positioned::write_all_at;
    use std::path::Path;

    fn names(folder: &Path, tasks: u32) -> Names {
        Names { folder: folder.to_owned(), job: 7, stages: vec![("survey".into(), tasks)] }
    }

    /// Writes the file of a task, with a number in it.
    fn write(names: Names, task: u32, number: u32) {
        let parts = Arc::new(Parts::of_task(names, task).unwrap());
        let spill = Spill::of_parts(Arc::clone(&parts));
        let blob = spill.put(&[&number.to_le_bytes()]).unwrap();
        drop(spill);
        Arc::into_inner(parts).unwrap().finish(&blob, 0, 0).unwrap();
    }

    /// However many there are, and how many read them at a time.
    #[test]
    fn few_files_are_open_and_all_are_read() {
        const FILES: u32 = 3 * MOST as u32;
        let folder = tempfile::tempdir().unwrap();
        (0..FILES).for_each(|task| write(names(folder.path(), FILES), task, task));
        let readers = [(); 4].map(|()| Arc::new(Parts::reader(names(folder.path(), FILES))));
        for parts in &readers {
            let spill = Spill::of_parts(Arc::clone(parts));
            let blobs: Vec<Blob> = (0..FILES).map(|number| parts.index(number).unwrap()).collect();
            // Those that are still open, and those that are not any more.
            for number in (0..FILES).rev() {
                assert_eq!(*spill.get(&blobs[number as usize]).unwrap(), number.to_le_bytes());
            }
            let open = parts.open.lock().unwrap();
            assert!((1..=MOST / readers.len()).contains(&open.files.len()), "{}", open.files.len());
            assert!(open.files.contains_key(&0));
        }
    }

    /// Where a task has run once more, and has written other bytes: whoever has read the index of the first file leaves the second alone.
    #[test]
    fn files_that_replace_others_stay() {
        let folder = tempfile::tempdir().unwrap();
        let names = names(folder.path(), MOST as u32 + 1);
        (0..=MOST as u32).for_each(|task| write(names.clone(), task, task));
        let parts = Arc::new(Parts::reader(names.clone()));
        let blobs: Vec<Blob> = (0..=MOST as u32).map(|task| parts.index(task).unwrap()).collect();
        write(names.clone(), 0, 7);
        let spill = Spill::of_parts(Arc::clone(&parts));
        let told = BuildError::temporary(&spill, spill.get(&blobs[0]).err().unwrap()).to_string();
        assert!(told.contains("survey.0: found another file"), "{told}");
        assert!(names.done(0).is_some());
        assert_eq!(*spill.get(&blobs[1]).unwrap(), 1_u32.to_le_bytes());
    }

    /// What was read of them is damaged meanwhile: it is not read again.
    #[test]
    fn lanes_of_files_that_were_closed_are_known() {
        let folder = tempfile::tempdir().unwrap();
        let names = names(folder.path(), MOST as u32 + 1);
        let parts = Arc::new(Parts::of_task(names.clone(), 0).unwrap());
        let spill = Spill::of_parts(Arc::clone(&parts));
        let lane = spill.lane(3);
        let blob = lane.put(&[b"lane"]).unwrap();
        lane.close().unwrap();
        drop(spill);
        Arc::into_inner(parts).unwrap().finish(&blob, 0, 0).unwrap();
        (1..=MOST as u32).for_each(|task| write(names.clone(), task, task));
        let parts = Arc::new(Parts::reader(names.clone()));
        let blobs: Vec<Blob> = (0..=MOST as u32).map(|task| parts.index(task).unwrap()).collect();
        assert!(!parts.open.lock().unwrap().files.contains_key(&0));
        let Header { lanes_len, index_offset, .. } = names.done(0).unwrap();
        let file = File::options().write(true).open(names.path(0)).unwrap();
        write_all_at(&file, &vec![7; lanes_len as usize], index_offset - lanes_len).unwrap();
        assert_eq!(*Spill::of_parts(Arc::clone(&parts)).get(&blobs[0]).unwrap(), *b"lane");
    }
}
