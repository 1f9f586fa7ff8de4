//! A visitor's thread, which draws one picture at a time: what is asked for newest comes next, and what nobody waits for any more ends.

use super::asked::{FrameAsked, PickAsked};
use super::shown::Shown;
use super::studio::Studio;
use crate::picture::asked::State;
use hyper::body::Bytes;
use serde_json::Value;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::Ordering;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, oneshot};

/// After how long without a request a visitor has gone.
const IDLE: Duration = Duration::from_secs(120);
/// The same after hanging up in the middle of a picture: a page that is still there asks for another one at once.
const AWAY: Duration = Duration::from_secs(10);
/// Pictures of a visitor that have not been taken, at most: who took none would fill the memory with them.
const UNTAKEN: usize = 4;
/// Stack of a thread, bytes: as much as a program's first thread usually has.
const STACK: usize = 8 << 20;

/// What is to be done.
#[derive(Clone, Debug)]
pub(super) enum Task {
    Frame(Box<FrameAsked>),
    Pick(PickAsked),
}

/// What came of it.
pub(super) enum Outcome {
    Frame { kind: &'static str, bytes: Bytes, facts: Value },
    Picked(Value),
    Superseded,
    Untaken,
    Failed(String),
}

/// A picture until it has been taken, or its connection has ended.
struct Picture {
    bytes: Bytes,
    _place: OwnedSemaphorePermit,
}

impl AsRef<[u8]> for Picture {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}

/// Where a visitor's requests come to.
pub(super) struct Drawer {
    slot: Mutex<Slot>,
    changed: Condvar,
    /// Places for pictures that have not been taken.
    untaken: Arc<Semaphore>,
    /// What tells the picture that is drawn that nobody waits for it.
    state: Arc<State>,
}

struct Slot {
    /// What waits. It is the newest: nothing else waits.
    waiting: Option<(u64, Task, oneshot::Sender<Outcome>)>,
    /// What is drawn, and who waits for it, if anybody does.
    drawn: Option<(u64, oneshot::Sender<Outcome>)>,
    /// The number of the newest request.
    newest: u64,
    /// When there was the last one.
    last: Instant,
    /// Whether the thread draws, for somebody or for nobody any more.
    is_drawing: bool,
    is_closed: bool,
}

impl Slot {
    /// Nothing is to be done yet.
    fn new() -> Slot {
        let last = Instant::now();
        Slot { waiting: None, drawn: None, newest: 0, last, is_drawing: false, is_closed: false }
    }

    /// Whether the thread draws nothing more.
    fn is_ending(&self) -> bool {
        self.is_closed && !self.is_drawing
    }
}

impl Drawer {
    /// Starts a thread that draws what is shown. Where the same visitor had one before, what is on its way from there counts as before.
    ///
    /// # Errors
    /// Where the system gives no thread.
    pub(super) fn start(shown: Arc<Shown>, before: Option<&Arc<Drawer>>) -> std::io::Result<Arc<Drawer>> {
        let drawer = Arc::new(Drawer::without_thread(before));
        let own = Arc::clone(&drawer);
        let named = std::thread::Builder::new().name("deepfield visitor".into()).stack_size(STACK);
        named.spawn(move || own.work(&shown))?;
        Ok(drawer)
    }

    fn without_thread(before: Option<&Arc<Drawer>>) -> Drawer {
        let untaken = before.map(|before| Arc::clone(&before.untaken));
        let untaken = untaken.unwrap_or_else(|| Arc::new(Semaphore::new(UNTAKEN)));
        Drawer { slot: Mutex::new(Slot::new()), changed: Condvar::new(), untaken, state: Arc::default() }
    }

    /// Has something done. What was asked before is superseded; whoever stops waiting ends it.
    pub(super) async fn ask(&self, task: Task) -> Outcome {
        if self.untaken.available_permits() == 0 {
            return Outcome::Untaken;
        }
        let (sender, receiver) = oneshot::channel();
        let number = {
            let mut slot = self.slot();
            if slot.is_closed {
                return Outcome::Superseded;
            }
            slot.newest += 1;
            slot.last = Instant::now();
            let number = slot.newest;
            let before = slot.waiting.replace((number, task, sender)).map(|(_, _, sender)| sender);
            // Their answer need not wait until drawing has ended.
            for sender in before.into_iter().chain(slot.drawn.take().map(|(_, sender)| sender)) {
                let _ = sender.send(Outcome::Superseded);
            }
            self.state.stop().store(true, Ordering::Relaxed);
            number
        };
        self.changed.notify_all();
        let _waits = Waits { drawer: self, number };
        match receiver.await.unwrap_or(Outcome::Superseded) {
            Outcome::Frame { kind, bytes, facts } => match Arc::clone(&self.untaken).try_acquire_owned() {
                Ok(place) => Outcome::Frame { kind, bytes: Bytes::from_owner(Picture { bytes, _place: place }), facts },
                Err(_) => Outcome::Untaken,
            },
            other => other,
        }
    }

    /// Ends the thread, at once or as soon as what is drawn has been given up.
    pub(super) fn close(&self) {
        let mut slot = self.slot();
        slot.is_closed = true;
        (slot.waiting, slot.drawn) = (None, None);
        self.state.stop().store(true, Ordering::Relaxed);
        drop(slot);
        self.changed.notify_all();
    }

    /// Whether its visitor has gone, and nothing is drawn or on its way any more.
    pub(super) fn has_ended(&self) -> bool {
        self.slot().is_ending() && self.untaken.available_permits() == UNTAKEN
    }

    /// Notes that its visitor is there, or has come back before the thread has ended; whether that is so.
    pub(super) fn keep(&self) -> bool {
        let mut slot = self.slot();
        if slot.is_ending() {
            return false;
        }
        (slot.last, slot.is_closed) = (Instant::now(), false);
        true
    }

    fn slot(&self) -> MutexGuard<'_, Slot> {
        self.slot.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn work(&self, shown: &Arc<Shown>) {
        let mut studio = Studio::new(Arc::clone(shown), Arc::clone(&self.state));
        while let Some((number, task)) = self.next() {
            let done = catch_unwind(AssertUnwindSafe(|| studio.perform(&task)));
            let outcome = done.unwrap_or_else(|_| {
                // Also how what reports progress is given up.
                studio = Studio::new(Arc::clone(shown), Arc::clone(&self.state));
                Outcome::Failed("the picture could not be drawn".into())
            });
            self.finish(number, outcome);
        }
    }

    /// Waits for what to do next; nothing where the visitor has gone.
    fn next(&self) -> Option<(u64, Task)> {
        let mut slot = self.slot();
        loop {
            if slot.is_closed {
                return None;
            }
            if let Some((number, task, sender)) = slot.waiting.take() {
                self.state.stop().store(false, Ordering::Relaxed);
                slot.drawn = Some((number, sender));
                slot.is_drawing = true;
                return Some((number, task));
            }
            let Some(left) = IDLE.checked_sub(slot.last.elapsed()) else {
                slot.is_closed = true;
                return None;
            };
            slot = self.changed.wait_timeout(slot, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    fn finish(&self, number: u64, outcome: Outcome) {
        let mut slot = self.slot();
        slot.is_drawing = false;
        // Whoever has hung up hears nothing of it.
        if let Some((_, sender)) = slot.drawn.take_if(|(drawn, _)| *drawn == number) {
            slot.last = Instant::now();
            let _ = sender.send(outcome);
        }
    }
}

/// Somebody who waits for a request's answer.
struct Waits<'a> {
    drawer: &'a Drawer,
    number: u64,
}

impl Drop for Waits<'_> {
    /// Who hangs up wants nothing any more.
    fn drop(&mut self) {
        let mut slot = self.drawer.slot();
        let is_waiting = slot.waiting.take_if(|(number, _, _)| *number == self.number).is_some();
        let is_drawn = slot.drawn.take_if(|(number, _)| *number == self.number).is_some();
        if is_drawn {
            self.drawer.state.stop().store(true, Ordering::Relaxed);
        }
        if is_waiting || is_drawn {
            slot.last = Instant::now().checked_sub(IDLE - AWAY).unwrap_or(slot.last);
            drop(slot);
            self.drawer.changed.notify_all();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::task::{Context, Poll, Waker};

    #[test]
    fn who_leaves_keeps_the_place_until_the_picture_has_been_given_up() {
        let drawer = Drawer::without_thread(None);
        let context = &mut Context::from_waker(Waker::noop());
        let mut first = Box::pin(drawer.ask(Task::Pick(PickAsked::default())));
        assert!(first.as_mut().poll(context).is_pending() && drawer.next().is_some());
        drawer.close();
        assert!(matches!(first.as_mut().poll(context), Poll::Ready(Outcome::Superseded)) && !drawer.has_ended());
        // Who comes back meanwhile still has it.
        assert!(drawer.keep());
        drawer.finish(1, Outcome::Picked(Value::Null));
        let mut second = Box::pin(drawer.ask(Task::Pick(PickAsked::default())));
        assert!(second.as_mut().poll(context).is_pending() && matches!(drawer.next(), Some((2, _))));
        drawer.close();
        drawer.finish(2, Outcome::Picked(Value::Null));
        assert!(drawer.has_ended() && !drawer.keep() && drawer.next().is_none());
    }

    #[test]
    fn who_takes_no_pictures_gets_no_more_of_them_and_keeps_the_place() {
        let drawer = Arc::new(Drawer::without_thread(None));
        let context = &mut Context::from_waker(Waker::noop());
        let ask = || Box::pin(drawer.ask(Task::Pick(PickAsked::default())));
        let mut untaken = Vec::new();
        for number in 1..=UNTAKEN as u64 {
            let mut asked = ask();
            assert!(asked.as_mut().poll(context).is_pending() && drawer.next().is_some());
            drawer.finish(
                number,
                Outcome::Frame { kind: "image/png", bytes: Bytes::from_static(b"PNG"), facts: Value::Null },
            );
            match asked.as_mut().poll(context) {
                Poll::Ready(Outcome::Frame { bytes, .. }) => untaken.push(bytes),
                _ => panic!("picture {number}: expected it"),
            }
        }
        assert!(untaken.iter().all(|bytes| bytes[..] == *b"PNG"));
        assert!(matches!(ask().as_mut().poll(context), Poll::Ready(Outcome::Untaken)));
        untaken.pop();
        assert!(ask().as_mut().poll(context).is_pending());
        drawer.close();
        assert!(!drawer.has_ended() && !drawer.keep());
        let again = Drawer::without_thread(Some(&drawer));
        assert_eq!(again.untaken.available_permits(), 1);
        untaken.clear();
        assert!(drawer.has_ended() && again.untaken.available_permits() == UNTAKEN);
    }

    #[test]
    fn the_newest_is_next_and_nothing_is_drawn_for_nobody() {
        let drawer = Drawer::without_thread(None);
        let context = &mut Context::from_waker(Waker::noop());
        let ask = || Box::pin(drawer.ask(Task::Pick(PickAsked::default())));
        let is_stopped = || drawer.state.stop().load(Ordering::Relaxed);

        let mut first = ask();
        assert!(first.as_mut().poll(context).is_pending());
        assert!(matches!(drawer.next(), Some((1, _))) && !is_stopped());
        // The first is answered before its picture has been given up.
        let mut second = ask();
        assert!(second.as_mut().poll(context).is_pending() && is_stopped());
        assert!(matches!(first.as_mut().poll(context), Poll::Ready(Outcome::Superseded)));
        drawer.finish(1, Outcome::Picked(Value::Null));
        // One hangs up before it is begun, and one while it is drawn.
        drop(second);
        let mut third = ask();
        assert!(third.as_mut().poll(context).is_pending());
        assert!(matches!(drawer.next(), Some((3, _))) && !is_stopped());
        drop(third);
        assert!(is_stopped());
        drawer.finish(3, Outcome::Picked(Value::Null));
        // Whoever does not come back soon has gone.
        let is_leaving = || drawer.slot().last.elapsed() >= IDLE - AWAY;
        assert!(is_leaving());
        let mut fourth = ask();
        assert!(fourth.as_mut().poll(context).is_pending() && !is_leaving());
        assert!(matches!(drawer.next(), Some((4, _))));
        drawer.finish(4, Outcome::Picked(Value::Null));
        assert!(matches!(fourth.as_mut().poll(context), Poll::Ready(Outcome::Picked(_))));
        // Who comes when it is closed is told to ask again.
        drawer.close();
        assert!(matches!(ask().as_mut().poll(context), Poll::Ready(Outcome::Superseded)) && drawer.next().is_none());
    }
}
