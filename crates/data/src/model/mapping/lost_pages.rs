//! Faults in mapped files, turned from the end of the program into a mark.
//!
//! Who touches memory that is mapped to a part of a file which the file has lost, or which the disk cannot read, is sent the
//! signal `SIGBUS`. The handler here looks whether the fault lies in a guarded mapping. If so it notes from where on the
//! mapping is lost and puts zeros in the place of all that follows, so that the read goes on and its end finds the note. Any
//! other fault goes to the handler that was there before.
//!
//! The handler runs at any moment, even inside the allocator: it only uses atomics, `mmap`, `sigaction` and `raise`.

use libc::{c_int, c_void, siginfo_t};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering::SeqCst};

/// Mappings that are guarded at a time at most; the handler looks through all.
const PLACES: usize = 512;

/// A mapping, or none.
struct Place {
    /// Its address, [`FREE`] or [`TAKEN`].
    start: AtomicUsize,
    /// The address of its end.
    end: AtomicUsize,
    /// Bytes from the start in which no fault was.
    sound: AtomicUsize,
}

/// No mapping is there.
const FREE: usize = 0;
/// A mapping is being entered.
const TAKEN: usize = 1;

static MAPPINGS: [Place; PLACES] =
    [const { Place { start: AtomicUsize::new(FREE), end: AtomicUsize::new(0), sound: AtomicUsize::new(0) } }; PLACES];

/// What is needed beside the mappings: set before the handler is there.
struct Surroundings {
    /// Bytes of a memory page.
    page: usize,
    /// Who was told of faults before.
    previous: libc::sigaction,
}

/// `None` inside where the handler cannot be installed.
static SURROUNDINGS: OnceLock<Option<Surroundings>> = OnceLock::new();

/// A mapping for as long as it is guarded.
#[derive(Debug)]
pub(super) struct Guard {
    place: usize,
}

impl Guard {
    /// Guards the memory of `len` bytes from the address `start` on, which is mapped to a file; `None` where too many are
    /// guarded already or the system takes no handler. The guard must be dropped before the memory is unmapped.
    pub fn of(start: usize, len: usize) -> Option<Guard> {
        install()?;
        let take = |place: &Place| place.start.compare_exchange(FREE, TAKEN, SeqCst, SeqCst).is_ok();
        let place = MAPPINGS.iter().position(take)?;
        let entry = &MAPPINGS[place];
        entry.end.store(start + len, SeqCst);
        entry.sound.store(usize::MAX, SeqCst);
        entry.start.store(start, SeqCst);
        Some(Guard { place })
    }

    /// Bytes from the start that were not lost; more than there are where nothing was.
    pub fn sound(&self) -> usize {
        MAPPINGS[self.place].sound.load(SeqCst)
    }
}

impl Drop for Guard {
    fn drop(&mut self) {
        MAPPINGS[self.place].start.store(FREE, SeqCst);
    }
}

/// Installs the handler, once for the program.
fn install() -> Option<&'static Surroundings> {
    static IS_INSTALLED: OnceLock<bool> = OnceLock::new();
    let surroundings = SURROUNDINGS.get_or_init(|| {
        // SAFETY: sigaction is plain data for which zeros are valid, sysconf only answers, and the pointers are valid or null.
        unsafe {
            let page = usize::try_from(libc::sysconf(libc::_SC_PAGESIZE)).ok().filter(|page| page.is_power_of_two())?;
            let mut previous: libc::sigaction = std::mem::zeroed();
            (libc::sigaction(libc::SIGBUS, std::ptr::null(), &mut previous) == 0)
                .then_some(Surroundings { page, previous })
        }
    });
    let is_installed = *IS_INSTALLED.get_or_init(|| {
        // SAFETY: as above; the handler has the signature that SA_SIGINFO promises and does nothing that a handler may not.
        // It runs on the stack that the standard library keeps for handlers on its threads.
        unsafe {
            let mut ours: libc::sigaction = std::mem::zeroed();
            ours.sa_sigaction = on_fault as *const () as libc::sighandler_t;
            ours.sa_flags = libc::SA_SIGINFO | libc::SA_ONSTACK;
            libc::sigemptyset(&mut ours.sa_mask);
            libc::sigaction(libc::SIGBUS, &ours, std::ptr::null_mut()) == 0
        }
    });
    surroundings.as_ref().filter(|_| is_installed)
}

/// The handler.
extern "C" fn on_fault(signal: c_int, about: *mut siginfo_t, context: *mut c_void) {
    // SAFETY: the system passes a valid description of the signal.
    let (code, address) = unsafe { ((*about).si_code, (*about).si_addr() as usize) };
    let Some(Some(surroundings)) = SURROUNDINGS.get() else { return };
    // Codes of signals that another program sends are not positive, and what they call an address is none.
    if code <= 0 || !stand_in(address, surroundings.page) {
        pass_on(&surroundings.previous, signal, code, about, context);
    }
}

/// Puts zeros in the place of what a guarded mapping has from the page of `address` on; false where none is there.
fn stand_in(address: usize, page: usize) -> bool {
    let from = address & !(page - 1);
    for place in &MAPPINGS {
        let (start, end) = (place.start.load(SeqCst), place.end.load(SeqCst));
        // Start and end belong together where the start is the same before and after. A mapping that is read stays.
        if start > TAKEN && (start..end).contains(&address) && place.start.load(SeqCst) == start {
            // Before the zeros are there, so that no other thread takes them for content.
            place.sound.fetch_min(from - start, SeqCst);
            // SAFETY: from the page of the fault to the end the memory belongs to this mapping alone, which the thread that
            // the signal interrupts is reading and so keeps; nobody holds references into it. It may change `errno`, which
            // nobody reads after a copy.
            let zeros = unsafe {
                let flags = libc::MAP_PRIVATE | libc::MAP_ANON | libc::MAP_FIXED;
                libc::mmap(from as *mut c_void, end - from, libc::PROT_READ, flags, -1, 0)
            };
            return zeros != libc::MAP_FAILED;
        }
    }
    false
}

/// Does what would have been done without this handler.
fn pass_on(previous: &libc::sigaction, signal: c_int, code: c_int, about: *mut siginfo_t, context: *mut c_void) {
    match previous.sa_sigaction {
        libc::SIG_IGN if code <= 0 => {}
        libc::SIG_DFL | libc::SIG_IGN => {
            // SAFETY: both may be called in a handler. The signal arrives when this handler returns, and ends the program.
            unsafe {
                libc::signal(signal, libc::SIG_DFL);
                libc::raise(signal);
            }
        }
        handler if previous.sa_flags & libc::SA_SIGINFO != 0 => {
            // SAFETY: with this flag that is the handler's signature.
            let handler: extern "C" fn(c_int, *mut siginfo_t, *mut c_void) = unsafe { std::mem::transmute(handler) };
            handler(signal, about, context);
        }
        handler => {
            // SAFETY: without the flag that is the handler's signature.
            let handler: extern "C" fn(c_int) = unsafe { std::mem::transmute(handler) };
            handler(signal);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::process::ExitStatusExt;

    const WHICH: &str = "DEEPFIELD_TEST_FAULT";

    /// Runs in a program of its own, which ends in it.
    #[test]
    fn faults_of_others_end_the_program_as_before() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        let mapped = || {
            std::fs::write(&path, [7; 10_000]).unwrap();
            memmap2::MmapOptions::new().len(10_000).map_raw_read_only(&std::fs::File::open(&path).unwrap()).unwrap()
        };
        match std::env::var(WHICH).as_deref() {
            Ok("fault") => {
                install().unwrap();
                let memory = mapped();
                std::fs::write(&path, b"").unwrap();
                // SAFETY: the address lies in the mapping. The fault ends the program, which is what is tested.
                let lost = unsafe { memory.as_ptr().add(5000).read_volatile() };
                panic!("read {lost}");
            }
            Ok("sent") => {
                let memory = mapped();
                let _guard = Guard::of(memory.as_ptr() as usize, 10_000).unwrap();
                // SAFETY: sends a signal to this thread.
                unsafe { libc::raise(libc::SIGBUS) };
                // A handler of the standard library lets the first one pass.
                // SAFETY: as above.
                unsafe { libc::raise(libc::SIGBUS) };
                panic!("still here");
            }
            _ => {
                for which in ["fault", "sent"] {
                    let mut child = std::process::Command::new(std::env::current_exe().unwrap());
                    let name = "faults_of_others_end_the_program_as_before";
                    let ended = child.args(["--nocapture", name]).env(WHICH, which).output().unwrap();
                    assert_eq!(ended.status.signal(), Some(libc::SIGBUS), "{which}: {ended:?}");
                }
            }
        }
    }
}
