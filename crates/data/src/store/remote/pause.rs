//! How long servers ask to be left alone (`Retry-After`, RFC 9110, 10.2.3): nobody asks them for anything before that.

use crate::model::http_date;
use std::collections::BTreeMap;
use std::io::{self, ErrorKind};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// A server is left alone for so long at most, whatever it asks for.
const LONGEST: Duration = Duration::from_secs(120);
/// Pauses of so long are told, and nothing waits for them to be opened.
pub(super) const LONG: Duration = Duration::from_secs(10);

/// The pause that a server asks for.
#[derive(Clone, Debug, Default)]
pub(super) struct Pause(Arc<Mutex<State>>);

#[derive(Clone, Copy, Debug, Default)]
struct State {
    until: Option<Instant>,
    is_told: bool,
}

impl State {
    fn left(self) -> Duration {
        self.until.map_or(Duration::ZERO, |until| until.saturating_duration_since(Instant::now()))
    }
}

impl Pause {
    /// That of a server, which all files there have in common.
    pub fn of(server: &str) -> Pause {
        static PAUSES: Mutex<BTreeMap<String, Pause>> = Mutex::new(BTreeMap::new());
        let mut pauses = PAUSES.lock().unwrap_or_else(PoisonError::into_inner);
        pauses.entry(server.to_owned()).or_default().clone()
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The server is left alone for so long from now on.
    pub fn begin(&self, length: Duration) {
        let mut state = self.state();
        let (left, length) = (state.left(), length.min(LONGEST));
        if length > left {
            *state = State { until: Some(Instant::now() + length), is_told: state.is_told && !left.is_zero() };
        }
    }

    /// How long it is still left alone.
    pub fn left(&self) -> Duration {
        self.state().left()
    }

    /// The same where it is long and this was not asked before.
    pub fn left_untold(&self) -> Option<Duration> {
        let mut state = self.state();
        let left = state.left();
        (left >= LONG && !std::mem::replace(&mut state.is_told, true)).then_some(left)
    }

    /// Waits until the server, which messages call `host`, may be asked.
    ///
    /// # Errors
    /// [`ErrorKind::ResourceBusy`] where it may not after `patience`.
    pub fn wait(&self, host: &str, patience: Duration) -> io::Result<()> {
        let end = Instant::now() + patience;
        loop {
            let (left, patience) = (self.left(), end.saturating_duration_since(Instant::now()));
            if left.is_zero() {
                return Ok(());
            }
            if patience.is_zero() {
                let what = format!("{host} asks for no requests within {} s", in_seconds(left));
                return Err(io::Error::new(ErrorKind::ResourceBusy, what));
            }
            std::thread::sleep(left.min(patience));
        }
    }
}

/// What `Retry-After` asks for: seconds, or a date by the clock that has written the answer's own, else by ours.
pub(super) fn asked_for(after: &str, date: Option<&str>) -> Option<Duration> {
    let after = after.trim();
    if !after.is_empty() && after.bytes().all(|byte| byte.is_ascii_digit()) {
        return Some(Duration::from_secs(after.parse().unwrap_or(u64::MAX)).min(LONGEST));
    }
    let ours = || i64::try_from(SystemTime::now().duration_since(UNIX_EPOCH).ok()?.as_secs()).ok();
    let seconds = http_date::read(after)? - date.and_then(http_date::read).or_else(ours)?;
    u64::try_from(seconds).ok().map(|seconds| Duration::from_secs(seconds).min(LONGEST))
}

/// A time as messages have it: whole seconds, and no fewer than there are.
pub(super) fn in_seconds(time: Duration) -> u64 {
    time.as_secs() + u64::from(time.subsec_nanos() > 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_and_dates_are_read_and_nothing_else() {
        let date = Some("Sun, 06 Nov 1994 08:49:37 GMT");
        for (after, seconds) in [
            ("0", Some(0)),
            (" 7 ", Some(7)),
            ("121", Some(120)),
            ("99999999999999999999999999", Some(120)),
            ("Sun, 06 Nov 1994 08:50:07 GMT", Some(30)),
            ("Mon, 07 Nov 1994 08:50:07 GMT", Some(120)),
            ("Sun, 06 Nov 1994 08:49:36 GMT", None),
            ("-1", None),
            ("1.5", None),
            ("soon", None),
            ("", None),
        ] {
            assert_eq!(asked_for(after, date), seconds.map(Duration::from_secs), "{after}");
        }
        // Our clock is later than that.
        assert_eq!(asked_for("Sun, 06 Nov 1994 08:50:07 GMT", None), None);
        assert_eq!(asked_for("Fri, 31 Dec 9999 23:59:59 GMT", None), Some(LONGEST));
    }

    #[test]
    fn nobody_asks_before_the_pause_is_over_and_it_is_told_once() {
        let (pause, length, start) = (Pause::default(), Duration::from_millis(60), Instant::now());
        assert!(pause.wait("h", Duration::ZERO).is_ok() && pause.left().is_zero());
        pause.begin(length);
        // A shorter one changes nothing.
        pause.begin(length / 4);
        assert!(pause.clone().wait("h", Duration::from_secs(60)).is_ok() && start.elapsed() >= length);
        assert!(pause.left_untold().is_none());
        for _ in 0..2 {
            pause.begin(Duration::MAX);
            let error = pause.wait("h", length).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::ResourceBusy);
            assert_eq!(error.to_string(), "h asks for no requests within 120 s");
        }
        assert!(pause.left_untold().is_some_and(|left| left <= LONGEST) && pause.left_untold().is_none());
        Pause::of("a:1").begin(LONG);
        assert!(!Pause::of("a:1").left().is_zero() && Pause::of("a:2").left().is_zero());
    }
}
