//! Reading pages of a file from a disk that may misbehave: which pages there is no asking for at present, and what is told of them, in the words
//! of [`crate::stream`].

use super::locked;
use crate::stream::patience::Patience;
use crate::stream::report::Report;
use crate::stream::residency::{ATTEMPTS, backoff};
use deepfield_data::store::container::RawPage;
use deepfield_data::store::{PageId, StoreError};
use deepfield_heights::store::HeightFile;
use std::collections::{HashMap, HashSet};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// How long after a picture to look whether a disk answers again.
const LOOK: Duration = Duration::from_secs(5);

/// The pages of a file, each read where it is asked for.
pub(super) struct Pages {
    file: Arc<HeightFile>,
    patience: Patience,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    failures: HashMap<PageId, Failure>,
    /// Whether some page has failed since somebody asked, and is to be tried again before it is told.
    is_trying: bool,
    /// Why the first page that this picture could not have is not there.
    lacks: Option<String>,
    /// Pages that were told and have not been read since.
    told: HashSet<PageId>,
    report: Report,
}

/// A page that could not be read.
struct Failure {
    /// Names the file and the page.
    why: String,
    attempts: u32,
    /// Whether pictures do without it from now on, until it may be asked for again.
    given_up: bool,
    again: Again,
}

/// When a page that pictures do without is asked for again, as far as a picture begins then.
enum Again {
    /// Never, since it is not the disk's fault.
    Never,
    At(Instant),
    /// Once the disk has answered what it was asked for.
    Answered,
}

impl Pages {
    /// Reads are waited for so long.
    pub fn new(file: Arc<HeightFile>, stall: Duration) -> Pages {
        let patience = Patience::new(stall, file.reads_at_once());
        Pages { file, patience, state: Mutex::default() }
    }

    /// Reads are waited for so long from now on.
    pub fn wait_for(&mut self, stall: Duration) {
        self.patience.set_stall(stall, self.file.reads_at_once());
    }

    /// Begins a picture: what earlier ones lacked is forgotten, and what may be asked for again is. Whether there is any.
    pub fn begin(&self) -> bool {
        let (now, mut is_any) = (Instant::now(), false);
        let mut state = locked(&self.state);
        (state.lacks, state.is_trying) = (None, false);
        state.failures.retain(|page, failure| {
            let is_due = match failure.again {
                Again::At(at) => at <= now,
                Again::Answered => !self.patience.is_stalled(*page),
                Again::Never => false,
            };
            is_any |= is_due;
            // How often the disk has failed to give a page is known until it gives it, for pauses to grow.
            let is_kept = !is_due || (failure.given_up && matches!(failure.again, Again::At(_)));
            failure.given_up &= !is_due;
            is_kept
        });
        is_any
    }

    /// When a picture that does without pages may have one of them; nobody is told when a disk answers after all.
    pub fn again(&self) -> Option<Instant> {
        let state = locked(&self.state);
        let lost = state.failures.values().filter(|failure| failure.given_up);
        let again = lost.filter_map(|failure| match failure.again {
            Again::At(at) => Some(at),
            Again::Answered => Some(Instant::now() + LOOK),
            Again::Never => None,
        });
        again.min()
    }

    /// Whether a page may be asked for.
    pub fn is_there(&self, page: PageId) -> bool {
        locked(&self.state).failures.get(&page).is_none_or(|failure| !failure.given_up)
    }

    /// How many pages pictures do without.
    pub fn lost(&self) -> usize {
        locked(&self.state).failures.values().filter(|failure| failure.given_up).count()
    }

    /// Reads a page and decodes what is wanted of it; `None` where that fails, or may not be tried now.
    pub fn read<T>(&self, page: PageId, decode: impl FnOnce(&RawPage) -> Result<T, StoreError>) -> Option<T> {
        {
            let mut state = locked(&self.state);
            let State { failures, lacks, .. } = &mut *state;
            if let Some(failure) = failures.get(&page).filter(|failure| failure.given_up) {
                lacks.get_or_insert_with(|| failure.why.clone());
                return None;
            }
        }
        let (file, path) = (Arc::clone(&self.file), self.file.path());
        let answer = self.patience.wait(page, move || (file.read_page(page), file.change()));
        let (outcome, change) = match answer {
            Ok(Ok((raw, change))) => (raw.and_then(|raw| decode(&raw)), change),
            Ok(Err(age)) => {
                self.unanswered(page, age);
                return None;
            }
            Err(error) => {
                let source = std::io::Error::new(error.kind(), format!("no thread can be started: {error}"));
                (Err(StoreError::Page { path: path.to_path_buf(), page: page.0, source }), None)
            }
        };
        let mut state = locked(&self.state);
        match outcome {
            Ok(read) => {
                state.failures.remove(&page);
                state.told.remove(&page);
                if let Some(change) = change {
                    state.report.changed(path, change);
                }
                Some(read)
            }
            Err(error) => {
                state.failed(page, &error, &self.file);
                None
            }
        }
    }

    /// The same for what is read while a picture is drawn: where the disk fails it is tried a few times, unless pictures do without pages
    /// already.
    pub fn read_patiently<T>(&self, page: PageId, decode: impl Fn(&RawPage) -> Result<T, StoreError>) -> Option<T> {
        let mut found = self.read(page, &decode);
        for attempt in 1..ATTEMPTS {
            if found.is_some() || self.lost() > 0 {
                break;
            }
            std::thread::sleep(backoff(attempt));
            found = self.read(page, &decode);
        }
        found
    }

    /// A page's read was waited for in vain for so long.
    fn unanswered(&self, page: PageId, age: Duration) {
        let path = self.file.path();
        let why = format!("{}: page {}: no answer", path.display(), page.0);
        let mut state = locked(&self.state);
        state.report.stalled(path, page, age);
        state.lacks.get_or_insert_with(|| why.clone());
        state.failures.insert(page, Failure { why, attempts: 0, given_up: true, again: Again::Answered });
    }

    /// Something else cannot be read.
    pub fn note(&self, error: &StoreError) {
        locked(&self.state).lacks.get_or_insert_with(|| error.to_string());
    }

    /// Why something that this picture needs could not be read.
    pub fn error(&self) -> Option<String> {
        locked(&self.state).lacks.clone()
    }

    /// What this picture lacks so far is forgotten, and given.
    pub fn take_lack(&self) -> Option<String> {
        locked(&self.state).lacks.take()
    }

    /// The picture lacks this, too.
    pub fn lack(&self, why: Option<String>) {
        let mut state = locked(&self.state);
        state.lacks = state.lacks.take().or(why);
    }

    /// Whether some page has failed, since this was asked last, that is to be tried again before it is told: nothing is lacked until then.
    pub fn try_again(&self) -> bool {
        let mut state = locked(&self.state);
        let is_trying = std::mem::take(&mut state.is_trying);
        if is_trying {
            state.lacks = None;
        }
        is_trying
    }

    /// What is to be told since the last call, one sentence each.
    pub fn take_messages(&self) -> Vec<String> {
        let (path, mut state) = (self.file.path(), locked(&self.state));
        let State { failures, told, report, .. } = &mut *state;
        // Nobody tries these again in this picture.
        for (page, failure) in failures.iter().filter(|(_, failure)| matches!(failure.again, Again::At(_))) {
            if told.insert(*page) {
                report.failed(path, &failure.why);
            }
        }
        if self.patience.stalled() == 0 {
            report.answered(path);
        }
        report.take()
    }
}

impl State {
    fn failed(&mut self, page: PageId, error: &StoreError, file: &HeightFile) {
        let why = error.to_string();
        let attempts = 1 + self.failures.get(&page).map_or(0, |failure| failure.attempts);
        let given_up = !error.may_pass() || attempts >= ATTEMPTS;
        let again = if error.may_pass() { Again::At(Instant::now() + backoff(attempts)) } else { Again::Never };
        self.is_trying |= !given_up;
        self.lacks.get_or_insert_with(|| why.clone());
        if given_up && self.told.insert(page) {
            self.report.failed(file.path(), &why);
        }
        self.failures.insert(page, Failure { why, attempts, given_up, again });
    }
}
