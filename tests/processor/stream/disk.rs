//! A small page file of several pages, a disk that misbehaves as it is told, and a camera that flies at random.

use crate::support::kept_page_file;
use deepfield::build::{BuildOptions, build};
use deepfield::store::{Disk, PageFile, PageId};
use deepfield::synth::{clusters::Clusters, dataset};
use std::collections::HashMap;
use std::io::{self, ErrorKind};
use std::path::Path;
use std::sync::{Arc, Condvar, Mutex, OnceLock};
use std::time::Duration;

/// The bytes of a page file with several pages.
pub fn sound() -> &'static [u8] {
    static BYTES: OnceLock<Vec<u8>> = OnceLock::new();
    BYTES.get_or_init(|| kept("clusters", 1_500_000, &BuildOptions::default()))
}

/// The bytes of a page file with more pages, which are smaller.
pub fn many() -> &'static [u8] {
    static BYTES: OnceLock<Vec<u8>> = OnceLock::new();
    let options = BuildOptions { page_bytes: 1 << 20, ..BuildOptions::default() };
    BYTES.get_or_init(|| kept("clusters-many", 1_500_000, &options))
}

/// The bytes of a page file of so many particles, which is kept under this name.
pub fn kept(name: &str, particles: u64, options: &BuildOptions) -> Vec<u8> {
    kept_page_file(name, |path| generate(particles, options, path))
}

fn generate(particles: u64, options: &BuildOptions, path: &Path) {
    build(dataset(&Clusters::new(3, particles)), options, path, &()).unwrap();
    let pages = PageFile::open(path).unwrap().page_count();
    assert!(pages >= 4, "{pages} pages are too few for these tests");
}

/// Where a page starts.
pub fn offset_of(bytes: &[u8], page: PageId) -> u64 {
    pages(bytes)[page.0 as usize].0
}

/// Offset and length of all pages, from the page table at the start of the footer.
fn pages(bytes: &[u8]) -> Vec<(u64, u64)> {
    use deepfield::store::layout::PAGE_ENTRY_LEN;
    let u64_at = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
    let u32_at = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    let footer = u64_at(24) as usize;
    let entry = |page: usize| footer + page * PAGE_ENTRY_LEN;
    (0..u32_at(44) as usize).map(|page| (u64_at(entry(page)), u64::from(u32_at(entry(page) + 8)))).collect()
}

/// What a disk answers when it is asked for a page.
#[derive(Clone, Copy, Debug)]
pub enum Answer {
    Sound,
    After(Duration),
    Fail { times: u32, kind: ErrorKind },
    Never,
}

/// A disk of bytes in memory.
#[derive(Debug)]
pub struct FaultyDisk {
    bytes: &'static [u8],
    pages: Vec<(u64, u64)>,
    answers: Mutex<HashMap<u32, Answer>>,
    changed: Condvar,
}

impl FaultyDisk {
    pub fn new(bytes: &'static [u8]) -> Arc<FaultyDisk> {
        let (pages, answers) = (pages(bytes), Mutex::default());
        Arc::new(FaultyDisk { bytes, pages, answers, changed: Condvar::new() })
    }

    pub fn set(&self, page: PageId, answer: Answer) {
        self.answers.lock().unwrap().insert(page.0, answer);
        self.changed.notify_all();
    }

    fn answer(&self, offset: u64) -> io::Result<()> {
        let Some(page) = self.pages.iter().position(|(start, len)| (*start..start + len).contains(&offset)) else {
            return Ok(());
        };
        let page = page as u32;
        let mut answers = self.answers.lock().unwrap();
        loop {
            match answers.get_mut(&page) {
                None | Some(Answer::Sound) => return Ok(()),
                Some(Answer::Fail { times: 0, .. }) => return Ok(()),
                Some(Answer::Fail { times, kind }) => {
                    *times -= 1;
                    return Err((*kind).into());
                }
                Some(Answer::After(delay)) => {
                    let delay = *delay;
                    drop(answers);
                    std::thread::sleep(delay);
                    return Ok(());
                }
                Some(Answer::Never) => answers = self.changed.wait(answers).unwrap(),
            }
        }
    }
}

impl Disk for FaultyDisk {
    fn read_exact_at(&self, buffer: &mut [u8], offset: u64) -> io::Result<()> {
        self.answer(offset)?;
        let at = offset as usize;
        let bytes = self.bytes.get(at..at + buffer.len()).ok_or(ErrorKind::UnexpectedEof)?;
        buffer.copy_from_slice(bytes);
        Ok(())
    }

    fn size(&self) -> io::Result<u64> {
        Ok(self.bytes.len() as u64)
    }

    fn change(&self) -> Option<deepfield::store::Change> {
        None
    }
}

/// The file on a disk in memory that answers at once.
pub fn in_memory(bytes: &'static [u8]) -> Arc<PageFile> {
    Arc::new(PageFile::open_on(Path::new("memory.df"), FaultyDisk::new(bytes)).unwrap())
}
