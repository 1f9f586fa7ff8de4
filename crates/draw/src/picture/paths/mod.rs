//! Pathlines of a run as a layer of a picture: which tracks are drawn, read from the run as a view needs them and kept for the next
//! picture. What they look like, [`crate::cpu::paths`] knows.

mod colors;
mod kept;
mod levels;
mod long;
mod members;
mod picking;
mod shares;
mod sight;
#[cfg(test)]
mod tests;
mod window;

pub use picking::PickedPath;
pub use sight::Sight;

use super::error::PictureError;
use crate::color::Colors;
use crate::color::transfer::TransferFunction;
use crate::cpu::paths::{Canvas, Curves, Drawn, Part, PathFragments, Quantity, Style};
use crate::explore::SelectionSet;
use crate::hierarchy::spacetime::Interpolation;
use crate::mode::{Depiction, PathColor, PathSettings, PathsOf};
use crate::model::{Bounds, FamilyName, Moment};
use crate::store::StoreError;
use crate::store::run::{RunFile, TrackIndex};
use crate::view::View;
use glam::DVec3;
use kept::{Kept, Place};
use rayon::prelude::*;
use std::collections::HashMap;
use std::sync::Arc;

/// How far beyond the picture paths are read, pixels: as far as their heads may reach.
const MARGIN_PX: u32 = 64;

/// Bytes of tracks that are kept beyond those that a picture needs, where nobody says how many.
pub const KEPT_BYTES: u64 = 1 << 31;

/// What of paths is asked for.
#[derive(Clone, Copy)]
pub struct PathRequest<'a> {
    /// The camera.
    pub view: &'a View,
    /// The settings.
    pub settings: &'a PathSettings,
    /// Whose.
    pub of: &'a PathsOf,
    /// The look's selections.
    pub selections: &'a [SelectionSet],
    /// The present.
    pub moment: Moment,
    /// How particles move.
    pub interpolation: Interpolation,
    /// The families that are shown.
    pub families: &'a [FamilyName],
    /// The mode and the attribute of the picture.
    pub depiction: &'a Depiction,
    /// Its colours.
    pub transfer: &'a TransferFunction,
}

/// How many paths were drawn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PathCounts {
    /// Tracks that have a path in the picture, of the interval where they are most.
    pub tracks: u64,
    /// Curves that all paths consist of: one for a track over an interval, or for a long one over several.
    pub curves: u64,
}

/// Paths of a run.
pub struct PathLayer {
    run: Arc<RunFile>,
    canvas: Canvas,
    indices: HashMap<[u32; 2], Arc<TrackIndex>>,
    kept: Kept<Place, Curves>,
    flow: levels::FlowKept,
    /// What was kept is of these members, with this attribute.
    kept_of: (Option<members::Whose>, Option<String>),
    members: members::Found,
    /// How much of clusters is selected of whom that is kept of.
    shares: shares::Shares,
}

/// Curves that are drawn.
struct Chosen {
    /// Where they come from.
    place: Place,
    curves: Arc<Curves>,
    which: Option<Vec<u32>>,
    /// How much of each of the curves is selected; all of them where it is `None`.
    shares: Option<Arc<Vec<f32>>>,
    part: Part,
}

/// All that is drawn.
struct Selected {
    chosen: Vec<Chosen>,
    families: Vec<u32>,
    parts: Vec<Part>,
}

/// What a picture's paths are chosen by.
struct Choice<'a> {
    request: &'a PathRequest<'a>,
    sight: &'a Sight,
    /// Displacements to the images of a periodic box.
    offsets: Vec<DVec3>,
    /// The edge of the periodic box.
    box_size: Option<f64>,
    /// The ball that is in focus.
    focus: Option<(DVec3, f64)>,
}

/// The paths of a picture, to be drawn in any of its views.
pub struct ChosenPaths {
    chosen: Vec<Chosen>,
    style: Style,
    box_size: Option<f64>,
    /// Which of them were seen.
    seen: Vec<Vec<bool>>,
}

impl ChosenPaths {
    /// How many were drawn.
    pub fn counts(&self) -> PathCounts {
        let mut of_intervals: HashMap<(usize, bool), u64> = HashMap::new();
        let mut curves = 0;
        for (Chosen { part, .. }, seen) in self.chosen.iter().zip(&self.seen) {
            let count = seen.iter().filter(|seen| **seen).count() as u64;
            let last = part.interval + part.intervals - 1;
            for interval in part.interval..=last {
                *of_intervals.entry((interval, part.head && interval == last)).or_default() += count;
            }
            curves += count;
        }
        PathCounts { tracks: of_intervals.into_values().max().unwrap_or(0), curves }
    }
}

impl PathLayer {
    /// Of a run; nothing is read yet. Up to `budget_bytes` of tracks are kept beyond those that a picture needs.
    ///
    /// # Errors
    /// Where the run has no tracks.
    pub fn new(run: Arc<RunFile>, budget_bytes: u64) -> Result<PathLayer, StoreError> {
        run.tracks()?;
        Ok(PathLayer {
            run,
            canvas: Canvas::default(),
            indices: HashMap::new(),
            kept: Kept::within(budget_bytes / 2),
            flow: levels::FlowKept::within(budget_bytes / 2),
            kept_of: (None, None),
            members: members::Found::default(),
            shares: shares::Shares::default(),
        })
    }

    /// The run.
    pub fn run(&self) -> &Arc<RunFile> {
        &self.run
    }

    /// Reads what is not here yet, and projects all paths; returns how many are drawn.
    ///
    /// # Errors
    /// Where the run cannot be read, or the settings name what there is not.
    pub fn gather(&mut self, request: &PathRequest<'_>) -> Result<PathCounts, PictureError> {
        self.gather_chosen(request, true)
    }

    /// The same with long tracks, or without.
    fn gather_chosen(&mut self, request: &PathRequest<'_>, with_long: bool) -> Result<PathCounts, PictureError> {
        let mut paths = self.choose(request, &Sight::flat([*request.view], request.view.height), with_long)?;
        self.project(&mut paths, request.view, None);
        Ok(paths.counts())
    }

    /// Reads what is not here yet of all views of a picture, and finds what its paths look like in each of them.
    ///
    /// # Errors
    /// As [`PathLayer::gather`].
    pub fn choose_for(&mut self, request: &PathRequest<'_>, sight: &Sight) -> Result<ChosenPaths, PictureError> {
        self.choose(request, sight, true)
    }

    fn choose(
        &mut self,
        request: &PathRequest<'_>,
        sight: &Sight,
        with_long: bool,
    ) -> Result<ChosenPaths, PictureError> {
        let box_size = self.run.tracks()?.box_size;
        let Some(Selected { chosen, families, parts }) = self.select(request, sight, with_long)? else {
            let style = style(request, sight.height, &[], 1.0);
            return Ok(ChosenPaths { chosen: Vec::new(), style, box_size, seen: Vec::new() });
        };
        let mean_mass = self.mean_mass(&families, &parts, &chosen)?;
        let style = style(request, sight.height, &chosen, mean_mass);
        let count = |own: &Chosen| own.which.as_ref().map_or(own.curves.len(), Vec::len);
        let seen = chosen.iter().map(|own| vec![false; count(own)]).collect();
        Ok(ChosenPaths { chosen, style, box_size, seen })
    }

    /// Projects the paths of a picture in one of its views; a face of a panorama has the angle of the panorama's pixels, radians.
    pub fn project(&mut self, paths: &mut ChosenPaths, view: &View, around: Option<f64>) {
        let ChosenPaths { chosen, style, box_size, seen } = paths;
        style.around = around;
        let face = around.map(|_| Sight::flat([*view], view.height));
        let offsets: Vec<DVec3> = view.images.offsets().collect();
        let is_in_view = |own: &Chosen| {
            let bounds = reached(own.curves.bounds, *box_size, style.unwrapped);
            face.as_ref().is_none_or(|face| offsets.iter().any(|offset| face.sees(bounds.moved(*offset), 0.0)))
        };
        let drawn: Vec<usize> = (0..chosen.len()).filter(|k| is_in_view(&chosen[*k])).collect();
        let of = |own: &usize| {
            let Chosen { curves, which, shares, part, .. } = &chosen[*own];
            let shares = shares.as_ref().map(|shares| &shares[..]);
            Drawn { curves, which: which.as_deref(), shares, part: *part, box_size: *box_size }
        };
        self.canvas.gather(view, &drawn.iter().map(of).collect::<Vec<_>>(), style);
        self.canvas.each_seen(|number, place| seen[drawn[number]][place] = true);
    }

    /// Reads what is not here yet of what a picture shows, with long tracks where they are near enough, if those are wanted; `None` where
    /// that are nobody's paths.
    fn select(
        &mut self,
        request: &PathRequest<'_>,
        sight: &Sight,
        with_long: bool,
    ) -> Result<Option<Selected>, PictureError> {
        let settings = request.settings;
        let wanted = self.members.of(&self.run, request)?;
        if wanted.as_ref().is_some_and(members::Whose::is_empty) {
            return Ok(None);
        }
        let attribute = self.attribute(settings)?;
        let kept_of = (wanted, attribute);
        if kept_of != self.kept_of {
            self.kept.clear();
            self.flow.clear();
            self.shares.clear();
            self.kept_of = kept_of;
        }
        self.kept.begin();
        self.flow.begin();
        let layout = self.run.tracks()?;
        let parts = window::parts(settings, request.moment, &layout.clock);
        let shown = layout.families.iter().enumerate().filter(|(_, own)| request.families.contains(&own.name));
        let families: Vec<u32> = shown.map(|(family, _)| family as u32).collect();
        let box_size = layout.box_size;
        let focus = self.focus(request)?;
        let choice = Choice { request, sight, offsets: sight.offsets(), box_size, focus };
        let levels = self.run.flow_errors().len();
        let level = match settings.level {
            _ if levels == 0 => Some(0),
            Some(level) => Some((level as usize).min(levels)),
            None => None,
        };
        // Of a selection another share may be in each interval.
        let with_long = with_long && level != Some(0) && self.kept_of.0.is_none();
        let mut chosen = Vec::new();
        for &family in &families {
            for part in &parts {
                match level {
                    Some(0) => self.particles(&choice, family, *part, None, &mut chosen)?,
                    level => self.choose_flow(&choice, family, *part, level, &mut chosen)?,
                }
            }
            if with_long {
                self.lengthen(&choice, family, &mut chosen)?;
            }
        }
        Ok(Some(Selected { chosen, families, parts }))
    }

    /// The paths that were gathered, over one another.
    pub fn colors(&self) -> Colors {
        self.canvas.colors()
    }

    /// The same without what is behind surfaces.
    pub fn colors_behind(&self, surfaces: Option<&PathFragments>) -> Colors {
        surfaces.map_or_else(|| self.colors(), |surfaces| self.fragments().colors_behind(surfaces))
    }

    /// The fragments of the paths that were gathered.
    pub fn fragments(&self) -> PathFragments {
        self.canvas.fragments()
    }

    /// The attribute that colours paths.
    fn attribute(&self, settings: &PathSettings) -> Result<Option<String>, PictureError> {
        let PathColor::Attribute(name) = settings.colored_by() else { return Ok(None) };
        let families = &self.run.tracks()?.families;
        let all = || families.iter().flat_map(|family| &family.attributes).map(|(name, _)| name.as_str());
        if all().any(|own| own == name) {
            return Ok(Some(name));
        }
        let mut names: Vec<&str> = ["speed", "direction", "mass", "time"].into_iter().chain(all()).collect();
        names.dedup();
        let why =
            format!("paths: color: found {name}, expected one of {}, or a colour like \"#ff8000\"", names.join(", "));
        Err(PictureError::of(self.run.path(), why))
    }

    fn index(&mut self, interval: usize, family: u32) -> Result<Arc<TrackIndex>, StoreError> {
        if let Some(known) = self.indices.get(&[interval as u32, family]) {
            return Ok(Arc::clone(known));
        }
        let index = Arc::new(self.run.track_index(interval, family as usize)?);
        self.indices.insert([interval as u32, family], Arc::clone(&index));
        Ok(index)
    }

    /// The number of the attribute that colours paths in a family.
    fn attribute_of(&self, family: u32) -> Option<usize> {
        let name = self.kept_of.1.as_ref()?;
        let own = &self.run.tracks().ok()?.families.get(family as usize)?.attributes;
        own.iter().position(|(own, _)| own == name)
    }

    /// The particles' own paths that may be in view; of `open` those of the flow tracks of level 1 that are refined.
    fn particles(
        &mut self,
        choice: &Choice<'_>,
        family: u32,
        part: Part,
        open: Option<&[bool]>,
        chosen: &mut Vec<Chosen>,
    ) -> Result<(), PictureError> {
        let index = self.index(part.interval, family)?;
        let interval = self.run.interval(part.interval)?;
        let in_view = |node: &crate::store::run::TrackNode| {
            let bounds = reached(node.bounds, choice.box_size, choice.request.settings.unwrapped);
            choice.offsets.iter().any(|offset| choice.sight.sees(bounds.moved(*offset), 0.0))
        };
        let place = |number: usize| -> Place { [part.interval as u32, family, 0, number as u32] };
        let leaves = || index.nodes.iter().enumerate().filter(|(_, node)| node.is_leaf() && in_view(node));
        let attribute = self.attribute_of(family);
        let missing: Vec<_> = leaves().filter(|(number, _)| !self.kept.has(&place(*number))).collect();
        let (run, wanted) = (&self.run, &self.kept_of.0);
        let read = |(number, node): &(usize, &crate::store::run::TrackNode)| -> Result<_, StoreError> {
            let tracks = run.node_tracks(part.interval, family as usize, node, wanted.is_some())?;
            let keep = |i: usize| {
                wanted.as_ref().is_none_or(|who| tracks.ids.get(i).is_some_and(|id| who.has(family as usize, *id)))
            };
            Ok((*number, Curves::new(&tracks, &interval, attribute, keep)))
        };
        let found = missing.par_iter().map(read).collect::<Result<Vec<_>, _>>()?;
        for (number, curves) in found {
            self.kept.put(place(number), curves);
        }
        for (number, node) in leaves() {
            let which = match open {
                None => None,
                Some(open) => {
                    let flow = self.flow.leaf(&self.run, part.interval, family, number as u32, node)?;
                    let Some(curves) = self.kept.get(&place(number)) else { continue };
                    let is_open = |i: &u32| {
                        let track = flow.get(curves.number(*i as usize));
                        track.and_then(|track| open.get(*track as usize)).copied().unwrap_or(false)
                    };
                    Some((0..curves.len() as u32).filter(is_open).collect::<Vec<u32>>())
                }
            };
            if which.as_ref().is_some_and(Vec::is_empty) || choice.request.settings.least > 1.0 {
                continue;
            }
            if let Some(curves) = self.kept.get(&place(number)).filter(|curves| !curves.is_empty()) {
                chosen.push(Chosen { place: place(number), curves, which, shares: None, part });
            }
        }
        Ok(())
    }

    /// The mass that has the width of the settings: the mean one of all particles, or of what is drawn of them.
    fn mean_mass(&mut self, families: &[u32], parts: &[Part], chosen: &[Chosen]) -> Result<f64, StoreError> {
        let is_level_0 = chosen.iter().all(|own| own.which.is_none() && own.curves.counts.is_empty());
        let head = parts.iter().find(|part| part.head);
        let (mut sum, mut count) = (0.0, 0.0);
        if let (true, None, Some(head)) = (is_level_0, &self.kept_of.0, head) {
            // Of all, so that it does not change with the view.
            for family in families {
                let index = self.index(head.interval, *family)?;
                for leaf in index.leaves() {
                    sum += 0.5 * (leaf.mass[0] + leaf.mass[1]);
                    count += f64::from(leaf.tracks);
                }
            }
        } else {
            for own in chosen.iter().filter(|own| own.part.head) {
                let mut add = |i: usize| {
                    let [begin, end] = own.curves.mass[i].map(f64::from);
                    sum += 0.5 * (begin + end);
                    count += 1.0;
                };
                match &own.which {
                    Some(which) => which.iter().for_each(|i| add(*i as usize)),
                    None => (0..own.curves.len()).for_each(add),
                }
            }
        }
        Ok(if count > 0.0 && sum > 0.0 { sum / count } else { 1.0 })
    }
}

/// Where tracks within `bounds` are drawn: what sticks out of a periodic box of this edge goes on at its other side, or unwrapped on
/// either side of it.
fn reached(bounds: Bounds, box_size: Option<f64>, unwrapped: bool) -> Bounds {
    let Some(edge) = box_size else { return bounds };
    let sticks_out = bounds.min.cmplt(DVec3::ZERO) | bounds.max.cmpge(DVec3::splat(edge));
    let beyond = if unwrapped { bounds.size() } else { DVec3::ZERO };
    Bounds {
        min: DVec3::select(sticks_out, -beyond, bounds.min),
        max: DVec3::select(sticks_out, DVec3::splat(edge) + beyond, bounds.max),
    }
}

/// The settings in pixels of a picture of that height, with the colours of what is drawn.
fn style(request: &PathRequest<'_>, height: u32, chosen: &[Chosen], mean_mass: f64) -> Style {
    let settings = request.settings;
    // Long tracks are no more of what there is: colours are the same with them.
    let single = chosen.iter().filter(|own| own.part.intervals == 1);
    let curves: Vec<Arc<Curves>> = single.map(|own| Arc::clone(&own.curves)).collect();
    let mut palette = colors::palette(settings, request.depiction, request.transfer, &curves);
    if let Quantity::Plain(color) = palette.quantity {
        palette = crate::cpu::paths::Palette::plain(color);
    }
    Style {
        shape: settings.shape,
        width: settings.width as f32,
        widest: (0.01 * settings.widest * f64::from(height)) as f32,
        mean_mass,
        opacity: settings.opacity as f32,
        halo: settings.halo as f32,
        palette,
        // They come again with each step.
        highlights: (settings.run != 0.0).then_some(settings.phase.rem_euclid(1.0) as f32),
        unwrapped: settings.unwrapped,
        around: None,
    }
}
