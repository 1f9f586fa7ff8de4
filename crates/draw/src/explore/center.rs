//! Centres of mass of selections, also of those that lie across the faces of a periodic box.
//!
//! Where a box is periodic, a mean of coordinates depends on where the box is cut open. Masses and moments are kept in slices along
//! each axis; the mean of the slices' directions on a circle says where the particles are, the box is cut open at the slice's end
//! that is farthest from there, and the mean is taken of what is on either side. For anything smaller than half of the box that is
//! its centre of mass, from one pass over the particles. What fills the box evenly has the plain mean.

use super::batch::{Batch, Gather, Work};
use super::data::Data;
use super::error::ExploreError;
use super::query::{Of, Query, Wanted};
use glam::DVec3;
use std::f64::consts::TAU;

/// Slices along each axis.
const SLICES: usize = 64;

/// Length of the mean direction on the circle from which on particles are somewhere: it is 0 where they fill the box evenly, and
/// more than 0.63 within half of it.
const GATHERED: f64 = 0.3;

/// Where a selection is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Center {
    /// Its centre of mass, world units; within the periodic box where there is one.
    pub position: DVec3,
    /// Its mass.
    pub mass: f64,
    /// Its particles.
    pub count: u64,
}

/// The centre of mass of a selection, in a periodic box of edge `periodic` or none; `None` without particles.
///
/// # Errors
/// [`ExploreError`] when the data cannot be read, or has no ids where they are asked for.
pub fn center<'a>(
    data: Data,
    of: impl Into<Of<'a>>,
    periodic: Option<f64>,
    work: Work,
) -> Result<Option<Center>, ExploreError> {
    let query = Query::new(data, of.into(), Wanted::default(), periodic)?;
    Ok(query.ask(data, &Centering { periodic }, work)?.finish())
}

/// Sums of which a centre of mass is made.
#[derive(Clone, Debug)]
pub struct CenterSums {
    edge: Option<f64>,
    count: u64,
    /// By axis and slice: mass, and its moment about the slice's lower end.
    slices: Vec<[[f64; 2]; 3]>,
}

impl CenterSums {
    /// Of nothing, in a periodic box of edge `periodic` or none.
    pub fn new(periodic: Option<f64>) -> CenterSums {
        let edge = periodic.filter(|edge| *edge > 0.0 && edge.is_finite());
        let slices = if edge.is_some() { SLICES } else { 1 };
        CenterSums { edge, count: 0, slices: vec![[[0.0; 2]; 3]; slices] }
    }

    /// Adds a particle.
    pub fn add(&mut self, position: DVec3, mass: f64) {
        self.count += 1;
        for axis in 0..3 {
            let (slice, offset) = match self.edge {
                Some(edge) => {
                    let share = (position[axis] / edge).rem_euclid(1.0) * SLICES as f64;
                    // The cast cuts off, and saturates for what is no number.
                    let slice = (share as usize).min(SLICES - 1);
                    (slice, (share - slice as f64) * edge / SLICES as f64)
                }
                None => (0, position[axis]),
            };
            let [sum, moment] = &mut self.slices[slice][axis];
            *sum += mass;
            *moment += mass * offset;
        }
    }

    /// Adds what others have summed up in the same box.
    pub fn join(&mut self, other: &CenterSums) {
        self.count += other.count;
        for (own, other) in self.slices.iter_mut().flatten().zip(other.slices.iter().flatten()) {
            *own = [own[0] + other[0], own[1] + other[1]];
        }
    }

    /// The centre; `None` without particles, or where their numbers are none.
    pub fn finish(&self) -> Option<Center> {
        let mass: f64 = self.slices.iter().map(|slice| slice[0][0]).sum();
        let position = DVec3::from_array([0, 1, 2].map(|axis| self.along(axis)));
        (self.count > 0 && mass > 0.0 && position.is_finite()).then_some(Center { position, mass, count: self.count })
    }

    fn along(&self, axis: usize) -> f64 {
        let slices = || self.slices.iter().map(|slice| slice[axis]);
        let mass: f64 = slices().map(|[mass, _]| mass).sum();
        let Some(edge) = self.edge else { return slices().map(|[_, moment]| moment).sum::<f64>() / mass };
        let width = edge / SLICES as f64;
        let angle = |slice: usize| (slice as f64 + 0.5) * TAU / SLICES as f64;
        let toward =
            |part: fn(f64) -> f64| slices().enumerate().map(|(i, [mass, _])| mass * part(angle(i))).sum::<f64>();
        let (sine, cosine) = (toward(f64::sin), toward(f64::cos));
        // The slice with which the box that is cut open begins; what fills the box is nowhere in particular, and it stays as it is.
        let first = match sine.hypot(cosine) < GATHERED * mass {
            true => 0,
            false => ((sine.atan2(cosine) / TAU + 0.5).rem_euclid(1.0) * SLICES as f64).round() as usize % SLICES,
        };
        let moment: f64 = (0..SLICES)
            .map(|step| {
                let [mass, moment] = self.slices[(first + step) % SLICES][axis];
                moment + mass * (first + step) as f64 * width
            })
            .sum();
        (moment / mass).rem_euclid(edge)
    }
}

struct Centering {
    periodic: Option<f64>,
}

impl Gather for Centering {
    type Part = CenterSums;

    fn part(&self) -> CenterSums {
        CenterSums::new(self.periodic)
    }

    fn take(&self, part: &mut CenterSums, batch: &Batch) {
        batch.positions.iter().zip(&batch.mass).for_each(|(&at, &mass)| part.add(at, mass));
    }

    fn join(&self, whole: &mut CenterSums, next: CenterSums) -> Result<(), ExploreError> {
        whole.join(&next);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// A cluster that is smaller than half of the box has the centre of mass that it has in the open, wherever in the box it is.
        #[test]
        fn clusters_across_faces_have_their_centre(
            offsets in prop::collection::vec((prop::array::uniform3(-0.2..0.2f64), 0.5..2.0f64), 1..60),
            middle in prop::array::uniform3(0.0..1.0f64),
            edge in 0.1..1e5f64,
            split in 0..60_usize,
        ) {
            let middle = DVec3::from(middle);
            let mass: f64 = offsets.iter().map(|(_, mass)| mass).sum();
            let mean = offsets.iter().map(|(at, mass)| DVec3::from(*at) * *mass).sum::<DVec3>() / mass;
            let (mut whole, mut rest) = (CenterSums::new(Some(edge)), CenterSums::new(Some(edge)));
            let mut open = CenterSums::new(None);
            for (i, (at, mass)) in offsets.iter().enumerate() {
                let at = middle + DVec3::from(*at);
                let sums = if i < split { &mut whole } else { &mut rest };
                sums.add(edge * (at - at.floor()), *mass);
                open.add(edge * at, *mass);
            }
            whole.join(&rest);
            let found = whole.finish().unwrap();
            let apart = (found.position / edge - (middle + mean)).to_array().map(|x| x - x.round());
            prop_assert!(apart.iter().all(|x| x.abs() < 1e-9), "{apart:?}");
            prop_assert!((found.mass / mass - 1.0).abs() < 1e-9);
            prop_assert!(found.position.min_element() >= 0.0 && found.position.max_element() <= edge);
            prop_assert!((open.finish().unwrap().position / edge - (middle + mean)).abs().max_element() < 1e-9);
            prop_assert_eq!(found.count, offsets.len() as u64);
        }
    }

    #[test]
    fn what_fills_the_box_has_the_mean_of_its_coordinates() {
        let mut sums = CenterSums::new(Some(8.0));
        let at = |i: u32| f64::from(i) * 0.125 + 0.03;
        (0..64 * 64).for_each(|i| sums.add(DVec3::new(at(i / 64), at(i % 64), 7.9), 1.0));
        let mean = (0..64).map(at).sum::<f64>() / 64.0;
        assert!(sums.finish().unwrap().position.abs_diff_eq(DVec3::new(mean, mean, 7.9), 1e-9), "{:?}", sums.finish());
    }

    #[test]
    fn nothing_has_no_centre_and_what_is_no_number_does_no_harm() {
        assert_eq!(CenterSums::new(Some(1.0)).finish(), None);
        for periodic in [None, Some(1.0), Some(f64::NAN), Some(-1.0)] {
            let mut sums = CenterSums::new(periodic);
            sums.add(DVec3::NAN, 1.0);
            sums.add(DVec3::INFINITY, f64::NAN);
            assert_eq!(sums.finish(), None);
        }
    }
}
