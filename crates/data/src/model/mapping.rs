//! A file mapped to memory, read by copying, and what happens where the file has lost what is mapped.

#[cfg(unix)]
mod lost_pages;

#[cfg(unix)]
use lost_pages::Guard;
use memmap2::{MmapOptions, MmapRaw};
use std::fs::File;
use std::sync::atomic::{Ordering, fence};

/// A file as memory, as long as it was when it was mapped.
#[derive(Debug)]
pub(super) struct Mapping {
    /// Dropped before the memory that it guards.
    guard: Guard,
    memory: MmapRaw,
}

impl Mapping {
    /// Maps the whole file; `None` where it is empty or the system refuses.
    pub fn of(file: &File) -> Option<Mapping> {
        let len = usize::try_from(file.metadata().ok()?.len()).ok().filter(|&len| len > 0)?;
        let memory = MmapOptions::new().len(len).map_raw_read_only(file).ok()?;
        Some(Mapping { guard: Guard::of(memory.as_ptr() as usize, len)?, memory })
    }

    /// Bytes that are mapped.
    pub fn len(&self) -> u64 {
        self.memory.len() as u64
    }

    /// Fills `buffer` from byte `offset` on. False where that is not mapped, or was lost, now or earlier; the buffer holds
    /// anything then.
    pub fn copy(&self, buffer: &mut [u8], offset: u64) -> bool {
        let Some(start) = usize::try_from(offset).ok() else { return false };
        let Some(end) = start.checked_add(buffer.len()).filter(|&end| end <= self.memory.len()) else { return false };
        if end > self.guard.sound() {
            return false;
        }
        // SAFETY: the range lies in the mapping, which lives as long as `self`, and the buffer is not part of it. No reference
        // to the mapping is made, so that it does not matter if another program writes the file meanwhile. Where the file has
        // become shorter the system signals a fault, and the guard puts zeros there.
        unsafe { self.memory.as_ptr().add(start).copy_to_nonoverlapping(buffer.as_mut_ptr(), buffer.len()) };
        // The copy is complete before the guard is asked, whose answer covers it then.
        fence(Ordering::SeqCst);
        end <= self.guard.sound()
    }
}

/// Windows refuses to cut a file while it is mapped, so nothing is lost there.
#[cfg(not(unix))]
#[derive(Debug)]
struct Guard;

#[cfg(not(unix))]
impl Guard {
    /// Guards nothing.
    fn of(_start: usize, _len: usize) -> Option<Guard> {
        Some(Guard)
    }

    /// All is sound.
    fn sound(&self) -> usize {
        usize::MAX
    }
}
