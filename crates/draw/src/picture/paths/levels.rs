//! Flow levels: which clusters stand for the particles, track by track (F12 6.4.1).

use super::kept::{Held, Kept};
use super::long::Long;
use super::{Choice, Chosen, PathLayer, PathRequest, reached};
use crate::cpu::paths::{Curves, Part};
use crate::mode::Focus;
use crate::mode::paths::FOCUS_SPACING;
use crate::model::Bounds;
use crate::picture::PictureError;
use crate::store::StoreError;
use crate::store::run::{RunFile, TrackNode};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::sync::Arc;

/// A flow level of an interval that was read.
pub(super) struct Level {
    pub curves: Arc<Curves>,
    /// The first child of each track in the next finer level, and one more.
    children: Vec<u32>,
    /// Velocities at both ends, world units by the clock's.
    pub velocities: [Vec<[f32; 3]>; 2],
}

impl Held for Level {
    fn memory(&self) -> u64 {
        let velocities = self.velocities.iter().map(|own| size_of_val(&own[..]) as u64).sum::<u64>();
        self.curves.memory() + self.children.memory() + velocities
    }
}

/// What was read of flow levels.
pub(super) struct FlowKept {
    /// By interval, family and level.
    levels: Kept<[u32; 3], Level>,
    /// By interval, family and number of the leaf.
    leaves: Kept<[u32; 3], Vec<u32>>,
    /// By scale and number of the stretch, family and level.
    pub long: Kept<[u32; 4], Long>,
}

impl FlowKept {
    /// Nothing yet; up to so many bytes are kept beyond those that a picture needs.
    pub fn within(budget_bytes: u64) -> FlowKept {
        FlowKept {
            levels: Kept::within(budget_bytes / 2),
            leaves: Kept::within(budget_bytes / 4),
            long: Kept::within(budget_bytes / 4),
        }
    }

    /// The next picture begins.
    pub fn begin(&mut self) {
        self.levels.begin();
        self.leaves.begin();
        self.long.begin();
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.levels.clear();
        self.leaves.clear();
        self.long.clear();
    }

    /// Which track of level 1 each track of a leaf belongs to.
    pub fn leaf(
        &mut self,
        run: &RunFile,
        interval: usize,
        family: u32,
        number: u32,
        leaf: &TrackNode,
    ) -> Result<Arc<Vec<u32>>, StoreError> {
        let key = [interval as u32, family, number];
        match self.leaves.get(&key) {
            Some(known) => Ok(known),
            None => Ok(self.leaves.put(key, run.leaf_flow(interval, family as usize, leaf)?)),
        }
    }

    /// The tracks of a level, from 1 on.
    pub fn level(
        &mut self,
        run: &RunFile,
        [interval, family, level]: [usize; 3],
        attribute: Option<usize>,
    ) -> Result<Arc<Level>, StoreError> {
        let key = [interval, family, level].map(|number| number as u32);
        if let Some(known) = self.levels.get(&key) {
            return Ok(known);
        }
        let flow = run.flow_tracks(interval, family, level)?;
        let space = run.interval(interval)?;
        let mut curves = Curves::new(&flow.tracks, &space, attribute, |_| true);
        curves.counts = flow.counts;
        let velocities = [0, 1].map(|end| {
            let unit = space.lattice.unit() / space.spans[end];
            let movements = flow.tracks.ends[end].movements.iter();
            movements.map(|movement| movement.map(|v| (v as f64 * unit) as f32)).collect()
        });
        Ok(self.levels.put(key, Level { curves: Arc::new(curves), children: flow.children, velocities }))
    }
}

/// Tracks that are looked at by one thread at least.
pub(super) const ENOUGH: usize = 512;

/// The share of the spacing that a long track may be beside the tracks that it is drawn for: less than what is seen as a path of its own.
const LONG_SHARE: f64 = 1.0 / 8.0;

impl Choice<'_> {
    /// How many pixels `error` is at what lies in these bounds and as far around them, where it is nearest; `None` out of view.
    fn pixels(&self, bounds: Bounds, error: f64) -> Option<f64> {
        let reached = reached(bounds, self.box_size, self.request.settings.unwrapped);
        let images = self.offsets.iter().map(|offset| reached.moved(*offset));
        let seen = images.filter(|bounds| self.sight.sees(*bounds, error));
        seen.map(|bounds| self.sight.pixels(bounds, error)).reduce(f64::max)
    }

    /// How far in the picture a particle may be from what stands for it, pixels.
    fn spacing(&self, bounds: Bounds, error: f64) -> f64 {
        let spacing = self.request.settings.spacing;
        let in_focus = self.focus.is_some_and(|(center, radius)| {
            let away = (center - center.clamp(bounds.min, bounds.max)).length();
            away <= radius + error
        });
        if in_focus { FOCUS_SPACING.min(spacing) } else { spacing }
    }

    /// Whether a track whose particles are within `error` of it is near enough to them, where it is nearest; `None` out of view.
    fn is_fine(&self, bounds: Bounds, error: f64) -> Option<bool> {
        Some(self.pixels(bounds, error)? <= self.spacing(bounds, error))
    }

    /// Whether a long track of a level is near enough to the tracks that it would be drawn for, and where levels are chosen by the view, to
    /// their particles, too.
    pub fn takes_long(&self, bounds: Bounds, level_error: f64, error: f64) -> bool {
        // What goes round the box many times has more images than are drawn.
        if self.box_size.is_some_and(|edge| bounds.size().max_element() > edge) {
            return false;
        }
        let beside = self.pixels(bounds, error).is_some_and(|off| off <= LONG_SHARE * self.spacing(bounds, error));
        beside && (self.request.settings.level.is_some() || self.is_fine(bounds, level_error + error) == Some(true))
    }
}

impl PathLayer {
    /// Chooses tracks of flow levels: of `fixed`, or each by the view, down to the particles where level 1 is too coarse.
    pub(super) fn choose_flow(
        &mut self,
        choice: &Choice<'_>,
        family: u32,
        part: Part,
        fixed: Option<usize>,
        chosen: &mut Vec<Chosen>,
    ) -> Result<(), PictureError> {
        let run = Arc::clone(self.run());
        let errors = run.flow_errors();
        let attribute = self.attribute_of(family);
        let least = choice.request.settings.least;
        let mut level = fixed.unwrap_or(errors.len());
        // Tracks of the level that are looked at; all of the first one.
        let mut looked_at: Option<Vec<u32>> = None;
        while level > 0 {
            let own = self.flow.level(&run, [part.interval, family as usize, level], attribute)?;
            let error = errors.get(level - 1).copied().unwrap_or(0.0);
            let shares = match &self.kept_of.0 {
                Some(whose) => Some(self.shares.of(&run, whose, [part.interval, family as usize, level])?),
                None => None,
            };
            let is_selected =
                |i: usize| shares.as_ref().is_none_or(|shares| shares.get(i).is_some_and(|own| *own > 0.0));
            let all = || (0..own.curves.len() as u32).collect::<Vec<u32>>();
            let (mut drawn, mut open) = (Vec::new(), Vec::new());
            let looked_at_here = looked_at.unwrap_or_else(all);
            let is_fine = |track: &u32| {
                let i = *track as usize;
                let is_asked = i < own.curves.len() && f64::from(own.curves.count(i)) >= least && is_selected(i);
                is_asked.then(|| choice.is_fine(bounds_of(&own.curves, i), error)).flatten()
            };
            let found: Vec<Option<bool>> = looked_at_here.par_iter().with_min_len(ENOUGH).map(is_fine).collect();
            for (track, found) in looked_at_here.into_iter().zip(found) {
                match found {
                    None => {}
                    Some(is_fine) if is_fine || fixed.is_some() => drawn.push(track),
                    Some(_) => open.push(track),
                }
            }
            if !drawn.is_empty() {
                let place = [part.interval as u32, family, level as u32, 0];
                chosen.push(Chosen { place, curves: Arc::clone(&own.curves), which: Some(drawn), shares, part });
            }
            if open.is_empty() {
                return Ok(());
            }
            if level == 1 {
                let mut is_open = vec![false; own.curves.len()];
                open.iter().for_each(|track| is_open[*track as usize] = true);
                return self.particles(choice, family, part, Some(&is_open), chosen);
            }
            let children = |track: &u32| {
                let ends = own.children.get(*track as usize..*track as usize + 2);
                ends.map_or(0..0, |ends| ends[0]..ends[1])
            };
            looked_at = Some(open.iter().flat_map(children).collect());
            level -= 1;
        }
        Ok(())
    }

    /// The ball that is in focus.
    pub(super) fn focus(&mut self, request: &PathRequest<'_>) -> Result<Option<(DVec3, f64)>, PictureError> {
        let name = match &request.settings.focus {
            None => return Ok(None),
            Some(Focus::Ball { center, radius }) => return Ok(Some((*center, *radius))),
            Some(Focus::Selection(name)) => name,
        };
        let set = super::members::named(&self.run, request.selections, name)?;
        match &set.members {
            crate::explore::Members::Region(region) => match region.first_sphere() {
                Some(ball) => Ok(Some(ball)),
                None => {
                    let why = format!("paths: focus: found {name}, expected a selection with a sphere, or by ids");
                    Err(PictureError::of(self.run.path(), why))
                }
            },
            members => {
                let run = Arc::clone(&self.run);
                let Some(followed) = self.members.followed(&run, members)? else { return Ok(None) };
                let Some(found) = followed.center(request.moment, request.interpolation)? else { return Ok(None) };
                let radius = followed.radius(found.position, request.moment, request.interpolation)?;
                Ok(radius.map(|radius| (found.position, radius)))
            }
        }
    }
}

/// A box around a curve, world units.
pub(super) fn bounds_of(curves: &Curves, i: usize) -> Bounds {
    let points = curves.points[i].map(Vec3::from_array);
    let min = points.iter().fold(Vec3::INFINITY, |min, at| min.min(*at));
    let max = points.iter().fold(Vec3::NEG_INFINITY, |max, at| max.max(*at));
    Bounds { min: curves.origin + min.as_dvec3(), max: curves.origin + max.as_dvec3() }
}
