//! Selections that follow their particles through a run: who they are is found once, and where they are at any time is read from their
//! tracks alone.

use super::batch::{Batch, Gather, Work};
use super::center::{Center, CenterSums};
use super::data::Data;
use super::error::ExploreError;
use super::ids::IdSet;
use super::query::{Of, Query, Wanted};
use super::region::Region;
use super::selection::Members;
use super::shape::{Cover, Shapes};
use crate::hierarchy::spacetime::{Interpolation, Moving, TrackFlags};
use crate::model::{Bounds, FamilyName, Moment, When};
use crate::store::RunFile;
use crate::store::run::{MemberTracks, RunSnapshot};
use glam::DVec3;
use std::sync::{Arc, Mutex, PoisonError};

/// Intervals whose tracks of a selection are kept.
const KEPT_INTERVALS: usize = 4;
/// Selections of a run that are kept.
const KEPT_SELECTIONS: usize = 32;
/// Bits of a filter at least, and for each id.
const FILTER_BITS: u64 = 1 << 12;
const BITS_OF_ID: u64 = 16;
/// Sets of more ids than this are asked directly.
const MOST_FILTERED: u64 = 1 << 24;
/// The share of a selection's particles that lie in the ball that stands for it.
const IN_BALL: f64 = 0.9;

/// The selections of a run, as far as they have been asked for.
#[derive(Debug)]
pub struct Following {
    run: Arc<RunFile>,
    known: Mutex<Vec<(Members, Arc<Followed>)>>,
}

impl Following {
    /// Nothing is known yet. `None` for a run without tracks, in which nobody can be followed.
    pub fn new(run: Arc<RunFile>) -> Option<Following> {
        run.tracks().ok()?;
        Some(Following { run, known: Mutex::default() })
    }

    /// The run.
    pub fn run(&self) -> &Arc<RunFile> {
        &self.run
    }

    /// Edge of the periodic box that tracks go round.
    pub fn periodic(&self) -> Option<f64> {
        self.run.tracks().ok().and_then(|layout| layout.box_size)
    }

    /// Who the members are, found once; `None` for a region, which has no members of its own.
    ///
    /// # Errors
    /// When the run cannot be read, has no ids where they are asked for, or no such time.
    pub fn of(&self, members: &Members, work: Work) -> Result<Option<Arc<Followed>>, ExploreError> {
        if matches!(members, Members::Region(_)) {
            return Ok(None);
        }
        let known = || self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, found)) = known().iter().find(|(other, _)| other == members) {
            return Ok(Some(Arc::clone(found)));
        }
        let found = Arc::new(Followed::new(&self.run, members, work)?);
        let mut kept = known();
        if kept.len() >= KEPT_SELECTIONS {
            kept.remove(0);
        }
        kept.push((members.clone(), Arc::clone(&found)));
        Ok(Some(found))
    }

    /// The particles of a selection at a moment, and the region of these that is meant: of a region those that may be in it then.
    ///
    /// # Errors
    /// As [`Following::of`].
    pub fn snapshot(
        &self,
        members: &Members,
        moment: Moment,
        interpolation: Interpolation,
        work: Work,
    ) -> Result<(RunSnapshot, Region), ExploreError> {
        match (self.of(members, work)?, members) {
            (Some(followed), _) => Ok((followed.snapshot(moment, interpolation)?, Region::whole())),
            (None, Members::Region(region)) => {
                Ok((within(&self.run, region, self.periodic(), moment, interpolation)?, region.clone()))
            }
            (None, _) => Ok((self.run.at(moment, interpolation)?, Region::whole())),
        }
    }

    /// The centre of mass of a selection at a moment; `None` without particles.
    ///
    /// # Errors
    /// As [`Following::of`].
    pub fn center(
        &self,
        members: &Members,
        moment: Moment,
        interpolation: Interpolation,
        work: Work,
    ) -> Result<Option<Center>, ExploreError> {
        match (self.of(members, work)?, members) {
            (Some(followed), _) => followed.center(moment, interpolation),
            (None, members) => {
                let (snapshot, _) = self.snapshot(members, moment, interpolation, work)?;
                super::center::center(Data::Source(&snapshot), members, self.periodic(), work)
            }
        }
    }
}

/// The particles of a run at a moment that may be in a region.
fn within(
    run: &Arc<RunFile>,
    region: &Region,
    periodic: Option<f64>,
    moment: Moment,
    interpolation: Interpolation,
) -> Result<RunSnapshot, ExploreError> {
    let shapes = Shapes::new(region, periodic)?;
    let may_be_in = |bounds: Bounds| {
        // Those that leave a periodic box come in again on the other side.
        let sticks_out = |edge: f64| bounds.min.min_element() < 0.0 || bounds.max.max_element() >= edge;
        periodic.is_some_and(sticks_out) || shapes.cover(bounds) != Cover::Outside
    };
    Ok(run.leaves_at(moment, interpolation, |leaf| may_be_in(leaf.bounds))?)
}

/// Who belongs to a selection, wherever they are.
#[derive(Debug)]
struct Who {
    ids: IdSet,
    /// By family of the run: ids that others have there, who are not meant.
    others: Vec<IdSet>,
    /// By family of the run: whether its ids are meant.
    is_meant: Vec<bool>,
    /// A bit for the hash of each id; empty where the set is asked directly.
    filter: Vec<u64>,
}

impl Who {
    fn new(ids: IdSet, others: Vec<IdSet>, is_meant: Vec<bool>) -> Who {
        let mut filter = Vec::new();
        if ids.len() <= MOST_FILTERED {
            let bits = (ids.len() * BITS_OF_ID).max(FILTER_BITS).next_power_of_two();
            filter.resize((bits / 64) as usize, 0);
            for id in ids.iter() {
                let bit = hash(id) & (bits - 1);
                filter[(bit / 64) as usize] |= 1 << (bit % 64);
            }
        }
        Who { ids, others, is_meant, filter }
    }

    #[inline]
    fn has(&self, family: usize, id: u64) -> bool {
        let bit = hash(id) & (self.filter.len() as u64 * 64).wrapping_sub(1);
        let word = self.filter.get((bit / 64) as usize);
        word.is_none_or(|word| word >> (bit % 64) & 1 == 1)
            && self.is_meant.get(family).copied().unwrap_or(false)
            && self.ids.contains(id)
            && !self.others.get(family).is_some_and(|others| others.contains(id))
    }
}

/// A number that looks random, the same for the same id.
#[inline]
fn hash(id: u64) -> u64 {
    let z = id.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z ^ z >> 32
}

/// A selection of a run whose members are known.
#[derive(Debug)]
pub struct Followed {
    run: Arc<RunFile>,
    who: Who,
    kept: Mutex<Vec<Arc<MemberTracks>>>,
}

impl Followed {
    fn new(run: &Arc<RunFile>, members: &Members, work: Work) -> Result<Followed, ExploreError> {
        let layout = run.tracks()?;
        let who = match members {
            Members::Ids(ids) => {
                if layout.families.iter().all(|family| !family.has_ids) {
                    return Err(ExploreError::missing(run.path(), "ids", "particle ids"));
                }
                let is_meant = layout.families.iter().map(|family| family.has_ids).collect();
                Who::new(ids.clone(), Vec::new(), is_meant)
            }
            Members::Tracked { at, region } => who_is_in(run, *at, region, work)?,
            Members::Region(_) => Who::new(IdSet::default(), Vec::new(), Vec::new()),
        };
        Ok(Followed { run: Arc::clone(run), who, kept: Mutex::default() })
    }

    /// The ids of the members; rows of the sources in families that have none.
    pub fn ids(&self) -> &IdSet {
        &self.who.ids
    }

    /// Whether a particle of a family (by its number in the run) with an id is a member.
    pub fn has(&self, family: usize, id: u64) -> bool {
        self.who.has(family, id)
    }

    /// Whether the members' tracks over an interval are in memory.
    pub fn knows(&self, interval: usize) -> bool {
        let kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.iter().any(|known| known.interval == interval)
    }

    /// The members' tracks over an interval.
    ///
    /// # Errors
    /// When the run cannot be read.
    pub fn over(&self, interval: usize) -> Result<Arc<MemberTracks>, ExploreError> {
        let kept = || self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        let find = |interval: usize| kept().iter().find(|known| known.interval == interval).cloned();
        if let Some(known) = find(interval) {
            return Ok(known);
        }
        let wanted = |family, id| self.who.has(family, id);
        let members = match interval.checked_sub(1).and_then(find) {
            Some(before) => self.run.carry_members(&before, &wanted)?,
            None => self.run.find_members(interval, &wanted)?,
        };
        let members = Arc::new(members);
        let mut kept = kept();
        if kept.len() >= KEPT_INTERVALS {
            kept.remove(0);
        }
        kept.push(Arc::clone(&members));
        Ok(members)
    }

    /// The members at a moment.
    ///
    /// # Errors
    /// When the run cannot be read.
    pub fn snapshot(&self, moment: Moment, interpolation: Interpolation) -> Result<RunSnapshot, ExploreError> {
        let members = self.over(self.run.interval_at(moment).0)?;
        Ok(self.run.members_at(moment, interpolation, &members)?)
    }

    /// The members at a moment, by family of the run.
    fn moving(&self, moment: Moment, interpolation: Interpolation) -> Result<Vec<(FamilyName, Moving)>, ExploreError> {
        let (number, u) = self.run.interval_at(moment);
        let (members, space) = (self.over(number)?, self.run.interval(number)?);
        let families = members.families.iter().zip(&self.run.tracks()?.families).map(|(own, family)| {
            let mut moving = Moving::default();
            own.tracks.at(&space, u, family.moved(interpolation), &family.rules(), &mut moving);
            (family.name, moving)
        });
        Ok(families.collect())
    }

    /// Where the members are at a moment, by family.
    ///
    /// # Errors
    /// When the run cannot be read.
    pub fn places(
        &self,
        moment: Moment,
        interpolation: Interpolation,
    ) -> Result<Vec<(FamilyName, Vec<DVec3>)>, ExploreError> {
        let all = self.moving(moment, interpolation)?;
        let places = |moving: Moving| moving.positions.into_iter().map(DVec3::from).collect();
        Ok(all.into_iter().map(|(name, moving)| (name, places(moving))).collect())
    }

    /// The members' centre of mass at a moment; `None` without particles.
    ///
    /// # Errors
    /// When the run cannot be read.
    pub fn center(&self, moment: Moment, interpolation: Interpolation) -> Result<Option<Center>, ExploreError> {
        let mut sums = CenterSums::new(self.run.tracks()?.box_size);
        for (_, moving) in self.moving(moment, interpolation)? {
            let all = moving.positions.iter().zip(&moving.mass);
            all.for_each(|(&at, &mass)| sums.add(DVec3::from(at), f64::from(mass)));
        }
        Ok(sums.finish())
    }

    /// The radius of the ball around `center` that nine tenths of the members are in at a moment.
    ///
    /// # Errors
    /// When the run cannot be read.
    pub fn radius(
        &self,
        center: DVec3,
        moment: Moment,
        interpolation: Interpolation,
    ) -> Result<Option<f64>, ExploreError> {
        let edge = self.run.tracks()?.box_size;
        let all = self.places(moment, interpolation)?;
        let places = all.iter().flat_map(|(_, places)| places);
        let mut distances: Vec<f64> = places.map(|&at| nearest(at - center, edge).length()).collect();
        distances.sort_by(f64::total_cmp);
        Ok(distances.get((IN_BALL * distances.len() as f64) as usize).copied())
    }
}

/// The shortest of the ways that lead from image to image.
pub(crate) fn nearest(way: DVec3, edge: Option<f64>) -> DVec3 {
    edge.map_or(way, |edge| way - edge * (way / edge).round())
}

/// Who is in a region at a time.
fn who_is_in(run: &Arc<RunFile>, at: When, region: &Region, work: Work) -> Result<Who, ExploreError> {
    let layout = run.tracks()?;
    let moment = run.moment(at)?;
    let (interval, u) = run.interval_at(moment);
    let snapshot = within(run, region, layout.box_size, moment, Interpolation::Auto)?;
    let data = Data::Source(&snapshot);
    let query = Query::new(data, Of::Region(region), Wanted::default(), layout.box_size)?;
    let rows = query.ask(data, &Rows(layout.families.len()), work)?;
    // The snapshot has all families of the run.
    let ids = rows.into_iter().enumerate().map(|(family, mut rows)| {
        rows.sort_unstable();
        snapshot.ids_of(family, &rows)
    });
    let ids = ids.collect::<Result<Vec<_>, _>>()?;
    let all = IdSet::new(ids.iter().flatten().copied().collect());
    let is_meant = vec![true; layout.families.len()];
    if layout.families.len() < 2 || all.is_empty() {
        return Ok(Who::new(all, Vec::new(), is_meant));
    }
    // Codes that count each family by itself give ids to others, too. Who changes the family keeps it.
    let who = Who::new(all, Vec::new(), is_meant);
    let found = run.find_members(interval, &|family, id| who.has(family, id))?;
    let others = found.families.iter().zip(&ids).map(|(found, own)| {
        let own = IdSet::new(own.clone());
        let tracks = found.tracks.ids.iter().zip(&found.tracks.flags);
        let stays = |flags: &TrackFlags| match u {
            0.0 => !flags.has(TrackFlags::COMES),
            1.0 => !flags.has(TrackFlags::GOES),
            _ => flags.weights() == [1.0, 1.0],
        };
        let others = tracks.filter(|(id, flags)| stays(flags) && !own.contains(**id)).map(|(id, _)| *id);
        IdSet::new(others.collect())
    });
    let others = others.collect();
    Ok(Who { others, ..who })
}

/// The rows of a question's particles, by family.
struct Rows(usize);

impl Gather for Rows {
    type Part = Vec<Vec<u64>>;

    fn part(&self) -> Vec<Vec<u64>> {
        vec![Vec::new(); self.0]
    }

    fn take(&self, part: &mut Vec<Vec<u64>>, batch: &Batch) {
        part[batch.family].extend_from_slice(&batch.keys);
    }

    fn join(&self, whole: &mut Vec<Vec<u64>>, next: Vec<Vec<u64>>) -> Result<(), ExploreError> {
        whole.iter_mut().zip(next).for_each(|(whole, next)| whole.extend(next));
        Ok(())
    }
}
