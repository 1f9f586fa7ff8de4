//! How a task reads what many others have left: some of it at a time, and what it will need again once.

use rayon::prelude::*;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

/// Hands what is read of each task to `take`, one after the other; `at_once` of them are read at a time.
///
/// # Errors
/// The first of those that `read` meets.
pub(super) fn each<T: Send, E: Send>(
    tasks: Range<u32>,
    at_once: u32,
    read: impl Fn(u32) -> Result<T, E> + Sync,
    mut take: impl FnMut(T),
) -> Result<(), E> {
    for start in tasks.clone().step_by(at_once as usize) {
        let now = start..tasks.end.min(start.saturating_add(at_once));
        for found in now.into_par_iter().map(&read).collect::<Vec<_>>() {
            take(found?);
        }
    }
    Ok(())
}

/// Numbered things, of which the last that were asked for are kept.
pub(super) struct Kept<T> {
    most: usize,
    /// The last one behind the others.
    things: Mutex<Vec<(u32, Arc<T>)>>,
}

impl<T> Kept<T> {
    /// Nothing yet; `most` of them at a time later, and one at least.
    pub fn new(most: usize) -> Kept<T> {
        Kept { most: most.max(1), things: Mutex::default() }
    }

    /// A thing that is kept, or else `read`.
    ///
    /// # Errors
    /// Those of `read`.
    pub fn get<E>(&self, number: u32, read: impl FnOnce() -> Result<T, E>) -> Result<Arc<T>, E> {
        let known = {
            // A list of things that are whole is whole.
            let mut things = self.things.lock().unwrap_or_else(PoisonError::into_inner);
            let known = things.iter().position(|(own, _)| *own == number).map(|place| things.remove(place).1);
            // One more comes, and has its room while it is read.
            let too_many = (things.len() + 1).saturating_sub(self.most);
            things.drain(..too_many);
            known
        };
        // Others may ask meanwhile.
        let thing = known.map_or_else(|| read().map(Arc::new), Ok)?;
        let mut things = self.things.lock().unwrap_or_else(PoisonError::into_inner);
        things.push((number, Arc::clone(&thing)));
        Ok(thing)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn what_is_read_at_a_time_is_taken_in_order() {
        for at_once in [1, 4, 100] {
            let (reads, mut taken) = (AtomicUsize::new(0), Vec::new());
            let read = |task: u32| {
                reads.fetch_add(1, Ordering::Relaxed);
                if task == 8 || task == 9 { Err(task) } else { Ok(task) }
            };
            assert_eq!(each(3..20, at_once, read, |task| taken.push(task)), Err(8));
            assert_eq!(taken, [3, 4, 5, 6, 7]);
            // None behind those that are read with the wrong one.
            assert!(reads.into_inner() <= (6 + at_once as usize).min(17));
        }
        assert_eq!(each(3..3, 4, |_| Err::<(), _>(()), |()| {}), Ok(()));
    }

    #[test]
    fn what_was_asked_for_last_is_kept() {
        let (kept, reads) = (Kept::new(2), AtomicUsize::new(0));
        let get = |number: u32| {
            let read = || {
                reads.fetch_add(1, Ordering::Relaxed);
                Ok::<_, ()>(number)
            };
            assert_eq!(kept.get(number, read).map(|thing| *thing), Ok(number));
            assert!(kept.things.lock().unwrap().len() <= 2);
            reads.load(Ordering::Relaxed)
        };
        assert_eq!([1, 2, 1, 2, 3, 2, 1, 3].map(get), [1, 2, 2, 2, 3, 3, 4, 5]);
        // What cannot be read is asked for again.
        assert_eq!(kept.get(7, || Err("gone")), Err("gone"));
        assert_eq!(get(7), 6);
    }
}
