//! Which task has which part of the work: blocks of the source, groups of buckets, and runs of about the same size.

use super::*;

impl Settings {
    /// Family, and number among its own, of a task that reads the source.
    pub(super) fn input(&self, task: u32) -> (usize, &FamilyTasks, u32) {
        self.of_family(task, |family| family.input)
    }

    /// The same of one that has some of the buckets of a family.
    pub(super) fn group(&self, task: u32) -> (usize, &FamilyTasks, u32) {
        self.of_family(task, |family| family.groups)
    }

    pub(super) fn of_family(&self, task: u32, tasks: impl Fn(&FamilyTasks) -> u32) -> (usize, &FamilyTasks, u32) {
        let families = &self.families;
        let mut rest = task;
        let mut number = 0;
        while number + 1 < families.len() && rest >= tasks(&families[number]) {
            rest -= tasks(&families[number]);
            number += 1;
        }
        (number, &families[number], rest)
    }

    /// The tasks of each family that read the source.
    pub(super) fn inputs(&self) -> impl Iterator<Item = Range<u32>> {
        self.of_families(|family| family.input)
    }

    /// The tasks of each family that have some of its buckets.
    pub(super) fn groups(&self) -> impl Iterator<Item = Range<u32>> {
        self.of_families(|family| family.groups)
    }

    pub(super) fn of_families(&self, tasks: fn(&FamilyTasks) -> u32) -> impl Iterator<Item = Range<u32>> {
        self.families.iter().scan(0, move |first, family| {
            let start = *first;
            *first += tasks(family);
            Some(start..*first)
        })
    }

    /// Bytes of the source that some chunks of a family take, about.
    pub(super) fn source_bytes(&self, family: &FamilyTasks, chunks: &Range<usize>) -> u64 {
        let particles = family.particles as f64 * chunks.len() as f64 / family.chunks.max(1) as f64;
        (self.source_bytes as f64 * particles / self.particles().max(1) as f64) as u64
    }
}

/// Codebook and part of whatever is coded by itself; the numbers of these units are those of this order.
pub(super) fn units(books: &[(usize, Book)]) -> Vec<(usize, usize)> {
    let units = |(number, (_, book)): (usize, &(usize, Book))| (0..book.parts.len()).map(move |part| (number, part));
    books.iter().enumerate().flat_map(units).collect()
}

/// Things of these sizes for a number of tasks, each of which has about as much to do.
pub(super) fn balanced(sizes: &[u64], tasks: u32) -> Vec<Vec<usize>> {
    let mut order: Vec<usize> = (0..sizes.len()).collect();
    order.sort_by_key(|&i| (std::cmp::Reverse(sizes[i]), i));
    let mut all = vec![(0, Vec::new()); tasks.max(1) as usize];
    for i in order {
        if let Some((held, own)) = all.iter_mut().min_by_key(|(held, _)| *held) {
            *held += sizes[i];
            own.push(i);
        }
    }
    let in_order = |(_, mut own): (u64, Vec<usize>)| {
        own.sort_unstable();
        own
    };
    all.into_iter().map(in_order).collect()
}

/// Things of these sizes in runs of about the same size, one for each task.
pub(super) fn runs(sizes: &[u64], tasks: u32) -> Vec<Range<usize>> {
    let total: u128 = sizes.iter().map(|size| u128::from(*size)).sum();
    let mut ends = vec![0; tasks.max(1) as usize];
    let mut before = 0;
    for (i, size) in sizes.iter().enumerate() {
        let middle = before + u128::from(*size) / 2;
        let task = (middle * ends.len() as u128 / total.max(1)).min(ends.len() as u128 - 1) as usize;
        ends[task] = i + 1;
        before += u128::from(*size);
    }
    let mut start = 0;
    let run = |end: usize| {
        let own = start..end.max(start);
        start = own.end;
        own
    };
    ends.into_iter().map(run).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Each thing is one task's, and no task has much more than its share.
        #[test]
        fn work_is_shared_out_evenly(sizes in prop::collection::vec(0..1000_u64, 0..100), tasks in 1..20_u32) {
            let share = sizes.iter().sum::<u64>() / u64::from(tasks) + sizes.iter().max().unwrap_or(&0) + 2;
            let of = |own: &mut dyn Iterator<Item = usize>| own.map(|i| sizes[i]).sum::<u64>();
            let balanced = balanced(&sizes, tasks);
            prop_assert!(balanced.iter().all(|own| of(&mut own.iter().copied()) <= share));
            let mut all = balanced.concat();
            all.sort_unstable();
            prop_assert!(all.into_iter().eq(0..sizes.len()) && balanced.len() == tasks as usize);
            let runs = runs(&sizes, tasks);
            prop_assert!(runs.iter().all(|run| of(&mut run.clone()) <= share));
            prop_assert!(runs.iter().cloned().flatten().eq(0..sizes.len()) && runs.len() == tasks as usize);
        }
    }
}
