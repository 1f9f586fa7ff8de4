//! Flow levels: which clusters stand for the particles, track by track (F12 6.4.1).

use super::{Choice, Chosen, PathLayer, PathRequest, reached};
use crate::cpu::paths::{Curves, Part};
use crate::mode::Focus;
use crate::mode::paths::FOCUS_SPACING;
use crate::model::Bounds;
use crate::picture::PictureError;
use crate::store::StoreError;
use crate::store::run::{RunFile, TrackNode};
use glam::{DVec3, Vec3};
use std::collections::HashMap;
use std::sync::Arc;

/// Flow levels of an interval that were read.
struct Level {
    curves: Arc<Curves>,
    /// The first child of each track in the next finer level, and one more.
    children: Vec<u32>,
}

/// What was read of flow levels.
#[derive(Default)]
pub(super) struct FlowKept {
    levels: HashMap<[u32; 3], Arc<Level>>,
    leaves: HashMap<[u32; 3], Arc<Vec<u32>>>,
}

/// Intervals whose levels are kept.
const KEPT_LEVELS: usize = 256;
/// Leaves whose particles' clusters are kept.
const KEPT_LEAVES: usize = 65_536;

impl FlowKept {
    /// Forgets everything.
    pub fn clear(&mut self) {
        self.levels.clear();
        self.leaves.clear();
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
        if let Some(known) = self.leaves.get(&key) {
            return Ok(Arc::clone(known));
        }
        let flow = Arc::new(run.leaf_flow(interval, family as usize, leaf)?);
        if self.leaves.len() >= KEPT_LEAVES {
            self.leaves.clear();
        }
        self.leaves.insert(key, Arc::clone(&flow));
        Ok(flow)
    }

    fn level(
        &mut self,
        run: &RunFile,
        [interval, family, level]: [usize; 3],
        attribute: Option<usize>,
    ) -> Result<Arc<Level>, StoreError> {
        let key = [interval, family, level].map(|number| number as u32);
        if let Some(known) = self.levels.get(&key) {
            return Ok(Arc::clone(known));
        }
        let flow = run.flow_tracks(interval, family, level)?;
        let mut curves = Curves::new(&flow.tracks, &run.interval(interval)?, attribute, |_| true);
        curves.counts = flow.counts;
        let found = Arc::new(Level { curves: Arc::new(curves), children: flow.children });
        if self.levels.len() >= KEPT_LEVELS {
            self.levels.clear();
        }
        self.levels.insert(key, Arc::clone(&found));
        Ok(found)
    }
}

impl Choice<'_> {
    /// Whether a track whose particles are within `error` of it is near enough to them, where it is nearest; `None` out of view.
    fn is_fine(&self, bounds: Bounds, error: f64) -> Option<bool> {
        let images = self
            .offsets
            .iter()
            .map(|offset| reached(bounds, self.box_size, self.request.settings.unwrapped).moved(*offset));
        let seen = images.filter(|bounds| self.sight.sees(*bounds, error));
        let pixels = seen.map(|bounds| self.sight.pixels(bounds, error)).reduce(f64::max)?;
        let in_focus = self.focus.is_some_and(|(center, radius)| {
            let away = (center - center.clamp(bounds.min, bounds.max)).length();
            away <= radius + error
        });
        let spacing = self.request.settings.spacing;
        Some(pixels <= if in_focus { FOCUS_SPACING.min(spacing) } else { spacing })
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
        let attribute = self.kept_of.1.as_ref().and_then(|name| {
            let own = &run.tracks().ok()?.families.get(family as usize)?.attributes;
            own.iter().position(|(own, _)| own == name)
        });
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
            for track in looked_at.unwrap_or_else(all) {
                let i = track as usize;
                if i >= own.curves.len() || f64::from(own.curves.count(i)) < least || !is_selected(i) {
                    continue;
                }
                match choice.is_fine(bounds_of(&own.curves, i), error) {
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
fn bounds_of(curves: &Curves, i: usize) -> Bounds {
    let points = curves.points[i].map(Vec3::from_array);
    let min = points.iter().fold(Vec3::INFINITY, |min, at| min.min(*at));
    let max = points.iter().fold(Vec3::NEG_INFINITY, |max, at| max.max(*at));
    Bounds { min: curves.origin + min.as_dvec3(), max: curves.origin + max.as_dvec3() }
}
