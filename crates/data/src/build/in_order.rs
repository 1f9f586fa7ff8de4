//! Work on many things that is taken in their order.

use rayon::prelude::*;

/// Makes something of each of `items`, as many at a time as there are threads, and lets `take` have it in order while the next ones are made. So
/// no more than two such rounds are in memory, and the order of what is written does not depend on threads.
///
/// # Errors
/// The first one of either.
pub(super) fn in_order<T: Sync, U: Send, E: Send>(
    items: &[T],
    make: impl Fn(&T) -> Result<U, E> + Sync,
    mut take: impl FnMut(U) -> Result<(), E> + Send,
) -> Result<(), E> {
    let mut made: Vec<U> = Vec::new();
    // Nothing is made beside what is taken last.
    for some in items.chunks(rayon::current_num_threads().max(1)).chain([&[][..]]) {
        let before = std::mem::take(&mut made);
        let (taken, next) = rayon::join(
            || before.into_iter().try_for_each(&mut take),
            || some.par_iter().with_max_len(1).map(&make).collect::<Result<Vec<U>, E>>(),
        );
        taken?;
        made = next?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everything_is_taken_once_and_in_order_until_something_fails() {
        let items: Vec<u32> = (0..1000).collect();
        let mut taken = Vec::new();
        let take = |value: u32| {
            taken.push(value);
            Ok::<(), u32>(())
        };
        assert_eq!(in_order(&items, |i| Ok(i * 2), take), Ok(()));
        assert_eq!(taken, items.iter().map(|i| i * 2).collect::<Vec<_>>());
        assert_eq!(in_order(&items, |i| if *i == 700 { Err(*i) } else { Ok(*i) }, |_| Ok(())), Err(700));
        assert_eq!(in_order(&items, |i| Ok(*i), |i| if i == 300 { Err(i) } else { Ok(()) }), Err(300));
        assert_eq!(in_order(&[], |i: &u32| Ok::<u32, u32>(*i), |_| Ok(())), Ok(()));
    }
}
