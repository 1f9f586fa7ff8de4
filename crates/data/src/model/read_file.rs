//! Files that several threads read by offset, in one of two ways: by positioned reads, or through memory that the file is
//! mapped to. Both give the same bytes and the same errors.

use super::mapping::Mapping;
use super::positioned;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io;

/// How the bytes of a file come into memory.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum ReadMethod {
    /// The system copies what is asked for.
    #[default]
    Positioned,
    /// The file is mapped to memory, and what is asked for is copied from there. For files that nobody else writes.
    Mapped,
}

/// An open file that is read by offset, without a shared cursor.
#[derive(Debug)]
pub struct ReadFile {
    file: File,
    /// None for positioned reads.
    mapping: Option<Mapping>,
}

impl ReadFile {
    /// Reads an open file in this way. Where the system does not map the file (it is empty or a pipe, or too many are mapped
    /// already), its reads are positioned.
    pub fn new(file: File, method: ReadMethod) -> ReadFile {
        let mapping = match method {
            ReadMethod::Positioned => None,
            ReadMethod::Mapped => Mapping::of(&file),
        };
        ReadFile { file, mapping }
    }

    /// The file.
    pub fn file(&self) -> &File {
        &self.file
    }

    /// Bytes from the start of the file that are mapped; 0 for positioned reads.
    pub fn mapped_len(&self) -> u64 {
        self.mapping.as_ref().map_or(0, Mapping::len)
    }

    /// Fills `buffer` from byte `offset` on.
    ///
    /// # Errors
    /// [`io::ErrorKind::UnexpectedEof`] where the file ends before the buffer does, also if it was longer when it was opened;
    /// whatever else the system answers.
    pub fn read_exact_at(&self, buffer: &mut [u8], offset: u64) -> io::Result<()> {
        if let Some(mapping) = &self.mapping
            && mapping.copy(buffer, offset)
            // What a file has lost of the memory page in which it ends reads as zeros, without a fault.
            && self.file.metadata()?.len() >= offset + buffer.len() as u64
        {
            return Ok(());
        }
        // What is not mapped or was lost: the system says what there is now.
        positioned::read_exact_at(&self.file, buffer, offset)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::path::Path;
    use std::sync::{Mutex, MutexGuard, PoisonError};

    /// One test takes all places for mappings that the others need.
    fn alone() -> MutexGuard<'static, ()> {
        static PLACES: Mutex<()> = Mutex::new(());
        PLACES.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn content(len: usize) -> Vec<u8> {
        (0..len).map(|i| (i * 31 + i / 253) as u8 | 1).collect()
    }

    fn open(path: &Path, method: ReadMethod) -> ReadFile {
        ReadFile::new(File::open(path).unwrap(), method)
    }

    fn read(file: &ReadFile, offset: u64, len: usize) -> Result<Vec<u8>, io::ErrorKind> {
        let mut buffer = vec![0; len];
        file.read_exact_at(&mut buffer, offset).map(|()| buffer).map_err(|error| error.kind())
    }

    proptest! {
        #[test]
        fn both_methods_read_the_same(
            len in 0_usize..40_000,
            ranges in prop::collection::vec((0_u64..50_000, 0_usize..20_000), 1..20),
        ) {
            let _alone = alone();
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("file");
            std::fs::write(&path, content(len)).unwrap();
            let [positioned, mapped] = [ReadMethod::Positioned, ReadMethod::Mapped].map(|method| open(&path, method));
            prop_assert_eq!((positioned.mapped_len(), mapped.mapped_len()), (0, len as u64));
            for (offset, count) in ranges.into_iter().chain([(0, len), (0, len + 1), (len as u64, 0), (u64::MAX - 3, 9)]) {
                let expected = read(&positioned, offset, count);
                prop_assert_eq!(read(&mapped, offset, count), expected.clone());
                prop_assert!(expected.is_err() || expected == Ok(content(50_000)[offset as usize..][..count].to_vec()) || offset > 50_000);
            }
        }
    }

    /// Windows does not cut a file that is mapped.
    #[cfg(unix)]
    #[test]
    fn a_file_that_is_cut_while_threads_read_it_gives_errors_and_no_signal() {
        use std::sync::atomic::{AtomicBool, Ordering};
        const LEN: usize = 1 << 20;
        let set_len = |path: &Path, len: u64| {
            std::fs::OpenOptions::new().write(true).open(path).unwrap().set_len(len).unwrap();
        };
        let _alone = alone();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        let all = content(LEN);
        std::fs::write(&path, &all).unwrap();
        let other = folder.path().join("other");
        std::fs::write(&other, content(100_000)).unwrap();
        let other = open(&other, ReadMethod::Mapped);
        for round in 0..20_u64 {
            set_len(&path, LEN as u64);
            std::fs::write(&path, &all).unwrap();
            let file = open(&path, ReadMethod::Mapped);
            assert_eq!(file.mapped_len(), LEN as u64);
            // Neither a multiple of a memory page nor far from one.
            let cut = 4096 * (1 + 11 * round) + [0, 1, 100, 4095][round as usize % 4];
            let is_cut = AtomicBool::new(false);
            std::thread::scope(|scope| {
                for thread in 0..4_u64 {
                    let (file, all, is_cut) = (&file, &all, &is_cut);
                    scope.spawn(move || {
                        let mut state = round * 4 + thread;
                        for _ in 0..2000 {
                            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                            let offset = (state >> 33) % LEN as u64;
                            let len = ((state >> 20) % 9000).min(LEN as u64 - offset) as usize;
                            let was_cut = is_cut.load(Ordering::SeqCst);
                            match read(file, offset, len) {
                                Ok(bytes) => {
                                    assert!(bytes == all[offset as usize..][..len]);
                                    assert!(!was_cut || offset + len as u64 <= cut || len == 0);
                                }
                                Err(error) => {
                                    assert_eq!(error, io::ErrorKind::UnexpectedEof);
                                    assert!(offset + len as u64 > cut);
                                }
                            }
                        }
                    });
                }
                set_len(&path, cut);
                is_cut.store(true, Ordering::SeqCst);
            });
            assert_eq!(read(&file, 0, cut as usize), Ok(all[..cut as usize].to_vec()));
            assert_eq!(read(&file, cut - 1, 2), Err(io::ErrorKind::UnexpectedEof));
            assert_eq!(read(&file, LEN as u64 - 10, 10), Err(io::ErrorKind::UnexpectedEof));
            assert_eq!(read(&other, 5000, 90_000).unwrap(), content(100_000)[5000..95_000]);
            // A file that is as long again is read as it is now, not as what stood in for its lost pages.
            std::fs::write(&path, content(LEN).iter().map(|byte| byte ^ 2).collect::<Vec<u8>>()).unwrap();
            let end: Vec<u8> = all[LEN - 10..].iter().map(|byte| byte ^ 2).collect();
            assert_eq!(read(&file, LEN as u64 - 10, 10), Ok(end));
        }
    }

    #[test]
    fn more_files_than_can_be_mapped_are_read_all_the_same() {
        let _alone = alone();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        std::fs::write(&path, content(5000)).unwrap();
        let files: Vec<ReadFile> = (0..700).map(|_| open(&path, ReadMethod::Mapped)).collect();
        assert!(files.iter().all(|file| read(file, 100, 4000).unwrap() == content(5000)[100..4100]));
        let mapped = files.iter().filter(|file| file.mapped_len() > 0).count();
        assert!(mapped > 0 && (mapped < files.len() || cfg!(not(unix))), "{mapped}");
        drop(files);
        assert_eq!(open(&path, ReadMethod::Mapped).mapped_len(), 5000, "places are given back");
    }
}
