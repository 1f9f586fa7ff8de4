//! Answers that take their time: worked out on a thread of their own, with progress, and stopped when nobody waits any more.

use crate::explore::Work;
use crate::window::state::progress::SharedProgress;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::sync::{Arc, Mutex, PoisonError};

/// What is known of an answer.
#[derive(Default)]
pub enum Answer<T> {
    /// Nothing was asked.
    #[default]
    Nothing,
    /// It is being worked out.
    Coming(Coming<T>),
    /// The answer.
    Here(T),
    /// Why there is none.
    Failed(String),
}

/// An answer that is being worked out; dropping this stops the work.
pub struct Coming<T> {
    /// How far it is.
    pub progress: Arc<SharedProgress>,
    stop: Arc<AtomicBool>,
    /// What may be shown in the meantime.
    so_far: Mutex<Receiver<T>>,
    outcome: Mutex<Receiver<Result<T, String>>>,
}

impl<T> Drop for Coming<T> {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
    }
}

impl<T: Send + 'static> Answer<T> {
    /// Begins to work out an answer on a thread called `name`.
    pub fn ask<E: std::fmt::Display>(
        name: &str,
        find: impl FnOnce(Work<'_>) -> Result<T, E> + Send + 'static,
    ) -> Answer<T> {
        Answer::ask_in_steps(name, |work, _| find(work))
    }

    /// The same of an answer that becomes better: what is told before it is done is [`Answer::so_far`].
    pub fn ask_in_steps<E: std::fmt::Display>(
        name: &str,
        find: impl FnOnce(Work<'_>, &dyn Fn(T)) -> Result<T, E> + Send + 'static,
    ) -> Answer<T> {
        let progress = Arc::new(SharedProgress::default());
        let stop = Arc::new(AtomicBool::new(false));
        let (tell, so_far) = channel();
        let (send, outcome) = channel();
        let (shared, halt) = (Arc::clone(&progress), Arc::clone(&stop));
        let run = move || {
            let work = Work { progress: shared.as_ref(), stop: &halt };
            // Whoever no longer waits does not hear it.
            let found = find(work, &|found| drop(tell.send(found)));
            drop(send.send(found.map_err(|error| error.to_string())));
        };
        match std::thread::Builder::new().name(format!("deepfield {name}")).spawn(run) {
            Ok(_) => {
                Answer::Coming(Coming { progress, stop, so_far: Mutex::new(so_far), outcome: Mutex::new(outcome) })
            }
            Err(error) => Answer::Failed(error.to_string()),
        }
    }

    /// An answer that is there already; it is received as one that has been worked out.
    pub fn ready(answer: T) -> Answer<T> {
        let (send, outcome) = channel();
        drop(send.send(Ok(answer)));
        let (so_far, outcome) = (Mutex::new(channel().1), Mutex::new(outcome));
        Answer::Coming(Coming { progress: Arc::default(), stop: Arc::default(), so_far, outcome })
    }

    /// Takes what was told of the answer last, while it is being worked out.
    pub fn so_far(&self) -> Option<T> {
        let Answer::Coming(coming) = self else { return None };
        coming.so_far.lock().unwrap_or_else(PoisonError::into_inner).try_iter().last()
    }

    /// Takes the answer if it has come in the meantime; whether it has.
    pub fn receive(&mut self) -> bool {
        let Answer::Coming(coming) = self else { return false };
        let outcome = coming.outcome.lock().unwrap_or_else(PoisonError::into_inner).try_recv();
        *self = match outcome {
            Ok(Ok(answer)) => Answer::Here(answer),
            Ok(Err(why)) => Answer::Failed(why),
            Err(TryRecvError::Disconnected) => Answer::Failed("the work ended without an answer".to_owned()),
            Err(TryRecvError::Empty) => return false,
        };
        true
    }

    /// The answer, where it is here.
    pub fn here(&self) -> Option<&T> {
        match self {
            Answer::Here(answer) => Some(answer),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    fn settled<T: Send + 'static>(mut answer: Answer<T>) -> Answer<T> {
        while !answer.receive() {
            std::thread::sleep(Duration::from_millis(1));
        }
        answer
    }

    #[test]
    fn answers_errors_and_panics_arrive() {
        let answer = settled(Answer::ask("test", |_| Ok::<i32, String>(7)));
        assert_eq!(answer.here(), Some(&7));
        let answer = settled(Answer::<i32>::ask("test", |_| Err("no")));
        assert!(matches!(answer, Answer::Failed(why) if why == "no"));
        assert_eq!(settled(Answer::ready(9)).here(), Some(&9));
        let answer = settled(Answer::<i32>::ask("test", |_| -> Result<i32, String> { panic!("a bug") }));
        assert!(matches!(answer, Answer::Failed(why) if why.contains("without an answer")));
    }

    #[test]
    fn what_is_told_before_an_answer_can_be_had_once() {
        let (go, wait) = channel();
        let mut answer = Answer::<i32>::ask_in_steps("test", move |_, tell| {
            [1, 2].into_iter().for_each(tell);
            wait.recv().map_err(|error| error.to_string())?;
            Ok::<_, String>(3)
        });
        let told = loop {
            // Both may not have come yet.
            match answer.so_far() {
                Some(told) if told == 2 => break told,
                _ => std::thread::sleep(Duration::from_millis(1)),
            }
        };
        assert_eq!((told, answer.so_far(), answer.receive()), (2, None, false));
        go.send(()).unwrap();
        let answer = settled(answer);
        assert_eq!((answer.so_far(), answer.here()), (None, Some(&3)));
    }

    #[test]
    fn work_that_nobody_waits_for_is_stopped() {
        let (tell, told) = channel();
        let answer = Answer::<()>::ask("test", move |work| -> Result<(), String> {
            while !work.stop.load(Ordering::Relaxed) {
                std::thread::sleep(Duration::from_millis(1));
            }
            tell.send(()).map_err(|error| error.to_string())?;
            Ok(())
        });
        drop(answer);
        told.recv_timeout(Duration::from_secs(30)).unwrap();
    }
}
