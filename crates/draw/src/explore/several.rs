//! Several questions about the same particles, answered by one pass over them.

use super::batch::{Batch, Gather, Work};
use super::data::Data;
use super::error::ExploreError;
use super::estimate::{Effort, Estimate, Estimated, Found, Totals, ask};
use super::query::Query;

/// The questions. Their totals lie one after the other.
pub(super) struct Several<G>(pub Vec<G>);

impl<G: Gather> Gather for Several<G> {
    type Part = Vec<G::Part>;

    fn part(&self) -> Vec<G::Part> {
        self.0.iter().map(G::part).collect()
    }

    fn take(&self, parts: &mut Vec<G::Part>, batch: &Batch) {
        self.0.iter().zip(parts).for_each(|(gather, part)| gather.take(part, batch));
    }

    fn join(&self, whole: &mut Vec<G::Part>, next: Vec<G::Part>) -> Result<(), ExploreError> {
        self.0.iter().zip(whole).zip(next).try_for_each(|((gather, whole), next)| gather.join(whole, next))
    }
}

impl<G: Estimated> Several<G> {
    /// Asks as much of the data as is enough for each of them; gives what was found for each.
    ///
    /// # Errors
    /// [`ExploreError`] where the data cannot be read.
    pub(super) fn ask(
        &self,
        data: Data,
        query: &Query,
        effort: Effort,
        work: Work,
    ) -> Result<Vec<Found<G::Part>>, ExploreError> {
        let Found { part, sampled } = ask(data, query, self, effort, work)?;
        let sampled: Vec<Option<(Totals, Estimate)>> = match sampled {
            None => self.0.iter().map(|_| None).collect(),
            Some((totals, estimate)) => {
                let own = |(gather, totals): (&G, Totals)| {
                    let (errors, largest) = gather.errors(&totals);
                    Some((totals, Estimate { errors, largest, ..estimate.clone() }))
                };
                self.0.iter().zip(self.split(&totals)).map(own).collect()
            }
        };
        Ok(part.into_iter().zip(sampled).map(|(part, sampled)| Found { part, sampled }).collect())
    }

    /// Each of them, and where its totals begin.
    fn placed(&self) -> impl Iterator<Item = (usize, &G)> {
        self.0.iter().scan(0, |next, gather| {
            let first = *next;
            *next += gather.totals();
            Some((first, gather))
        })
    }

    /// The totals of each.
    fn split(&self, totals: &Totals) -> Vec<Totals> {
        let mut ratios = 0;
        let own = |(first, gather): (usize, &G)| {
            let (count, first_ratio) = (gather.totals(), ratios);
            ratios += gather.ratios().len();
            totals.part(first..first + count, first_ratio..ratios)
        };
        self.placed().map(own).collect()
    }
}

impl<G: Estimated> Estimated for Several<G> {
    fn totals(&self) -> usize {
        self.0.iter().map(G::totals).sum()
    }

    fn ratios(&self) -> Vec<[usize; 2]> {
        let own =
            |(first, gather): (usize, &G)| gather.ratios().into_iter().map(move |pair| pair.map(|total| first + total));
        self.placed().flat_map(own).collect()
    }

    fn count(&self, parts: &Vec<G::Part>, totals: &mut [f64]) {
        for ((first, gather), part) in self.placed().zip(parts) {
            gather.count(part, &mut totals[first..][..gather.totals()]);
        }
    }

    fn merged(&self, batch: &Batch, per_mass: f64, say: &mut dyn FnMut(usize, f64)) {
        for (first, gather) in self.placed() {
            gather.merged(batch, per_mass, &mut |total, value| say(first + total, value));
        }
    }

    fn scaled(&self, parts: Vec<G::Part>, factor: f64) -> Vec<G::Part> {
        self.0.iter().zip(parts).map(|(gather, part)| gather.scaled(part, factor)).collect()
    }

    /// Those of all of them, and the largest of any.
    fn errors(&self, totals: &Totals) -> (Vec<f64>, f64) {
        let each = self.0.iter().zip(self.split(totals));
        each.fold((Vec::new(), 0.0), |(mut all, largest), (gather, totals)| {
            let (errors, own) = gather.errors(&totals);
            all.extend(errors);
            (all, own.max(largest))
        })
    }
}
