//! Pictures of all directions, and pictures for two eyes: drawn view by view and put together before they become colours.
//!
//! The processor draws them, or an adapter ([`super::adapter_faces`]). Nodes are selected for each face, so the error bound holds in every
//! direction, in pixels of the panorama's own rate. Within a number of splats they are selected once, for all faces and both eyes together:
//! the number is that of the picture, and what one eye sees the other one sees, too.

mod listed;

use super::adapter::{Adapter, Passes};
use super::adapter_faces;
use super::around::{SharedLook, sketch, with_images};
use super::decode::{batches, cut, decode};
use super::error::PictureError;
use super::ground::{Ground, among, lighting};
use super::level_report::{bound_around, has_clusters};
use super::panorama::{Texels, assemble};
use super::paths::{ChosenPaths, PathLayer, Sight};
use super::session::Reporter;
use super::subject::Subject;
use crate::color::Accumulation;
use crate::color::Colors;
use crate::color::transfer::Levels;
use crate::cpu::paths::PathFragments;
use crate::cpu::shadowing::Lighting;
use crate::cpu::volume::VolumeError;
use crate::cpu::{Counts, Splats};
use crate::hierarchy::Purpose;
use crate::mode::{self, Depiction, Footprint, InView, LightPicture, Needs, Plan, Raw};
use crate::stream::{Scene, SceneNode, SceneSelection};
use crate::view::perspective_grid::GridError;
use crate::view::{Detail, Eye, Eyes, Panorama, Projection, Sampling, Scope, Sections, Stereo, Surround, View};
use std::sync::Arc;

/// How splats are sampled: with a few more pixels than the panorama has, since they may be as small as one.
const SPLATS: Sampling = Sampling { oversampling: 1.5, density: 1.5, margin: 0 };
/// How colours are sampled: rays cost more than splats, and a volume's grid is smooth.
const COLORS: Sampling = Sampling { oversampling: 1.0, density: 1.5, margin: 1 };

/// What draws faces.
pub(super) struct Means<'a> {
    /// What selects nodes.
    pub scene: &'a mut Scene,
    /// Whether what a face of sums draws is not held at once.
    pub lists: bool,
    /// An adapter, with the passes that draw the mode; else the processor draws.
    pub adapter: Option<(Passes, &'a mut (dyn Adapter + 'static))>,
    /// Who is told.
    pub reporter: &'a dyn Reporter,
    /// The paths of the picture, where it has some, and what draws them.
    pub paths: Option<(&'a mut PathLayer, &'a mut ChosenPaths)>,
    /// Measured surfaces in the picture.
    pub ground: Option<&'a dyn Ground>,
}

impl Means<'_> {
    /// The layer with the paths that are in a face, where the picture has some.
    fn paths_in(&mut self, face: &Face<'_>) -> Option<&PathLayer> {
        let (layer, paths) = self.paths.as_mut()?;
        layer.project(paths, face.view, face.around.map(|[pixel, _]| pixel));
        Some(layer)
    }

    /// What of surfaces is in a face, where the picture has some, for something else than their colours.
    fn surfaces_in(&self, face: &Face<'_>) -> Option<PathFragments> {
        Some(self.ground?.fragments(face.view, &Lighting::default()))
    }

    /// Waits until what a view needs is there.
    fn converge(&mut self, view: &View, detail: Detail) -> Result<SceneSelection, PictureError> {
        Ok(self.scene.converge(view, detail, &mut |why| self.reporter.tell(why))?)
    }

    /// Asks whether anybody still waits.
    fn go_on(&self) -> Result<(), PictureError> {
        if self.reporter.is_stopped() { Err(PictureError::Stopped) } else { Ok(()) }
    }
}

/// What is put together.
pub(super) struct Projector {
    /// The camera, in the middle of both eyes.
    pub base: View,
    panorama: Option<Panorama>,
    stereo: Option<Stereo>,
}

/// A view to be drawn.
struct Face<'a> {
    view: &'a View,
    /// Angle of a panorama's pixel, and the view's pixels for one of these; `None` for a flat picture.
    around: Option<[f64; 2]>,
}

impl Face<'_> {
    /// The view's pixels for one of the picture.
    fn scale(&self) -> f64 {
        self.around.map_or(1.0, |[_, scale]| scale)
    }
}

/// What was selected for all views together.
pub(super) struct Tally {
    pub converged: bool,
    pub error_px: f64,
    pub particles: u64,
    pub nodes: usize,
    /// Whether any of them is drawn as clusters.
    pub has_clusters: bool,
    pub counts: Counts,
    /// Of a panorama of sums whose faces draw the same clusters: see [`bound_around`].
    pub error_bound: Option<f64>,
    /// Backend and adapter that drew; `None` where the processor did.
    pub drawn_by: Option<[String; 2]>,
}

impl Tally {
    fn new() -> Tally {
        Tally {
            converged: true,
            error_px: 0.0,
            particles: 0,
            nodes: 0,
            has_clusters: false,
            counts: Counts::default(),
            error_bound: None,
            drawn_by: None,
        }
    }

    /// Adds a selection by a view with so many pixels for one of the picture.
    fn add(&mut self, selection: &SceneSelection, scale: f64) {
        self.converged &= selection.converged;
        self.error_px = self.error_px.max(selection.error_pixels / scale);
        self.particles += selection.particles;
        self.nodes += selection.nodes.len();
        self.has_clusters |= has_clusters(&selection.nodes);
    }
}

impl Projector {
    /// Around a camera.
    ///
    /// # Errors
    /// Projections and eyes that make no sense.
    pub fn new(mut base: View, surround: Surround, stereo: Option<Stereo>) -> Result<Projector, PictureError> {
        if let Some(stereo) = stereo {
            stereo.check_for(surround).map_err(|expected| PictureError::Asked(expected.into()))?;
            if matches!(base.projection, Projection::Orthographic { .. }) {
                return Err(PictureError::Asked("--stereo: an orthographic picture has no place for two eyes".into()));
            }
        }
        let panorama = Panorama::around(&base, surround)?;
        base.cut.around = panorama.is_some() && base.cut.fade_rate > 0.0;
        Ok(Projector { base, panorama, stereo })
    }

    /// Puts the picture together.
    fn shoot<const N: usize>(
        &self,
        sampling: Sampling,
        mut draw: impl FnMut(&Face<'_>) -> Result<Texels<N>, PictureError>,
    ) -> Result<Texels<N>, PictureError> {
        let mut whole: Option<Texels<N>> = None;
        let eyes = self.stereo.map_or(&[][..], |stereo| stereo.eyes.each());
        let each: Vec<Option<Eye>> =
            if eyes.is_empty() { vec![None] } else { eyes.iter().copied().map(Some).collect() };
        for eye in each {
            let pair = self.stereo.zip(eye);
            let picture = match (&self.panorama, pair) {
                (None, None) => draw(&Face { view: &self.base, around: None })?,
                (None, Some((stereo, eye))) => draw(&Face { view: &stereo.off_axis(&self.base, eye)?, around: None })?,
                (Some(panorama), pair) => {
                    let pixel = panorama.pixel_angle();
                    let circle = pair.map(|(stereo, eye)| stereo.omnidirectional(eye, pixel)).transpose()?;
                    let sections = Sections::new(*panorama, circle, sampling);
                    let around = Some([pixel, sections.oversampling()]);
                    assemble(&sections, &self.base, |view| draw(&Face { view, around }))?
                }
            };
            let below = self.stereo.is_some_and(|stereo| stereo.eyes == Eyes::OverUnder);
            whole = Some(match whole {
                None => picture,
                Some(first) => first.beside(&picture, below),
            });
        }
        whole.ok_or_else(|| PictureError::Asked("nothing was drawn".into()))
    }

    /// Puts together what `draw` shows in each view, colours or else sums; black where that is nothing. Views of a panorama reach `margin` pixels
    /// beyond what is seen of them.
    ///
    /// # Errors
    /// The first of `draw`, and where all views show nothing.
    pub fn draw_each(
        &self,
        is_light: bool,
        margin: u32,
        mut draw: impl FnMut(&View) -> Result<Option<Raw>, PictureError>,
    ) -> Result<Raw, PictureError> {
        let nothing = || PictureError::Asked("eye, target: nothing of the data is in view".into());
        let sampling = Sampling { margin: margin.max(COLORS.margin), ..COLORS };
        if is_light {
            let mut last: Option<LightPicture> = None;
            let texels = self.shoot(sampling, |face| {
                let Some(Raw::Light(mut light)) = draw(face.view)? else {
                    return Ok(Texels::black(face.view.width, face.view.height));
                };
                let colors = std::mem::take(&mut light.colors);
                // Those of a face are not the picture's.
                light.report.values = None;
                last = Some(light);
                Ok(colors.into())
            })?;
            return Ok(Raw::Light(LightPicture { colors: texels.into(), ..last.ok_or_else(nothing)? }));
        }
        let mut any = false;
        let texels = self.shoot(sampling, |face| {
            let Some(Raw::Sums(sums, _)) = draw(face.view)? else {
                return Ok(Texels::black(face.view.width, face.view.height));
            };
            any = true;
            Ok(sums.into())
        })?;
        if !any {
            return Err(nothing());
        }
        Ok(Raw::Sums(texels.accumulation(false), Counts::default()))
    }

    /// From where its paths are chosen: the same for all faces and both eyes.
    ///
    /// # Errors
    /// Eyes that make no sense.
    pub fn sight(&self) -> Result<Sight, PictureError> {
        let View { eye, height, .. } = self.base;
        let Some(panorama) = self.panorama else {
            let eyes = self.stereo.iter().flat_map(|stereo| stereo.eyes.each().iter().map(move |eye| (stereo, eye)));
            let mut views =
                eyes.map(|(stereo, eye)| stereo.off_axis(&self.base, *eye)).collect::<Result<Vec<_>, _>>()?;
            if views.is_empty() {
                views.push(self.base);
            }
            return Ok(Sight::flat(views, height));
        };
        let sections = Sections::new(panorama, None, COLORS);
        let faces = sections.faces(0, &self.base).into_iter().map(|face| face.view);
        let away = self.stereo.map_or(0.0, |stereo| 0.5 * stereo.separation);
        Ok(Sight::around(faces, eye, panorama.pixel_angle(), away, panorama.face_edge().unwrap_or(height)))
    }

    /// The paths of the picture alone, as far as surfaces do not hide them; black without.
    ///
    /// # Errors
    /// As [`Projector::draw`].
    pub fn paths(&self, means: &mut Means<'_>) -> Result<Colors, PictureError> {
        let texels = self.shoot(SPLATS, |face| {
            means.go_on()?;
            let surfaces = means.surfaces_in(face);
            let black = || Texels::black(face.view.width, face.view.height);
            Ok(means.paths_in(face).map_or_else(black, |layer| layer.colors_behind(surfaces.as_ref()).into()))
        })?;
        Ok(texels.into())
    }

    /// The surfaces of the picture alone, where it has some.
    ///
    /// # Errors
    /// As [`Projector::draw`].
    pub fn ground(&self, means: &Means<'_>) -> Result<Option<Colors>, PictureError> {
        let Some(ground) = means.ground else { return Ok(None) };
        let lighting = Lighting { camera: Some(&self.base), others: None };
        let margin = ground.light().margin_px.max(COLORS.margin);
        let texels = self.shoot(Sampling { margin, ..COLORS }, |face| {
            means.go_on()?;
            Ok(ground.fragments(face.view, &lighting).colors().into())
        })?;
        Ok(Some(texels.into()))
    }

    /// The angle of a pixel in the picture's middle.
    fn pixel(&self) -> f64 {
        self.panorama.map_or(1.0 / self.base.focal_pixels(), |panorama| panorama.pixel_angle())
    }

    /// What of a depiction no adapter draws so that all faces are alike, if anything.
    pub fn only_on_processor(&self, depiction: &Depiction) -> Option<String> {
        self.panorama?;
        if self.base.cut.around {
            return Some("panoramas that fade with the distance".into());
        }
        if depiction.mode.technique.tells_columns() {
            return Some("panoramas of splats over each other".into());
        }
        let is_able = match depiction.adapter() {
            // Discs have as many pixels everywhere in a flat picture.
            mode::Adapter::Splats => matches!(depiction.footprint(), Footprint::Kernel),
            mode::Adapter::Light => true,
            mode::Adapter::None | mode::Adapter::Plugin => false,
        };
        (!is_able).then(|| format!("panoramas of {}", depiction.mode.name))
    }

    /// Reads what a subject within a number of splats needs.
    ///
    /// # Errors
    /// As [`Projector::draw`].
    pub fn read(&self, means: &mut Means<'_>, subject: &Subject<'_>) -> Result<(), PictureError> {
        self.select_within(means, subject, &mut Tally::new()).map(drop)
    }

    /// Draws a subject, with splats displaced by `tau` pixels at most.
    ///
    /// # Errors
    /// [`PictureError`] as [`super::Session::draw`].
    pub fn draw(&self, means: &mut Means<'_>, subject: &Subject<'_>, tau: f64) -> Result<(Raw, Tally), PictureError> {
        let mut tally = Tally::new();
        let raw = match subject.depiction.mode.is_light() {
            true => Raw::Light(self.colors(means, subject, tau, &mut tally)?),
            false => {
                let texels = self.sums(means, subject, tau, &mut tally)?;
                Raw::Sums(texels.accumulation(subject.depiction.attribute.is_some()), tally.counts)
            }
        };
        Ok((raw, tally))
    }

    /// Sums, face by face.
    fn sums(
        &self,
        means: &mut Means<'_>,
        subject: &Subject<'_>,
        tau: f64,
        tally: &mut Tally,
    ) -> Result<Texels<2>, PictureError> {
        let depiction = subject.depiction;
        let whole = self.select_within(means, subject, tally)?;
        let is_decoded = whole.is_some() && means.adapter.is_none();
        let decoded = match &whole {
            Some(whole) if is_decoded => cut(&self.base, decode(depiction, subject.metadata, &whole.nodes)),
            _ => Vec::new(),
        };
        let decoded = batches(depiction, &decoded)?;
        let texels = self.shoot(SPLATS, |face| {
            means.go_on()?;
            let seen = seen(depiction.reach_px(), face);
            let pixel = face.around.map(|[pixel, _]| pixel);
            let surfaces = means.surfaces_in(face);
            let surfaces = surfaces.as_ref();
            if is_decoded {
                let (sums, counts) = subject.sum_batches(face.view, &seen_of(&decoded, &seen), pixel, surfaces)?;
                tally.counts += counts;
                return Ok(sums.into());
            }
            let detail = depiction.detail(face.view, tau * face.scale(), subject.metadata);
            if whole.is_none()
                && means.lists
                && surfaces.is_none()
                && let Some(sums) = listed::sums(means, subject, face, (&seen, detail), tally)?
            {
                return Ok(sums.into());
            }
            let own = match &whole {
                Some(_) => None,
                None => Some(means.converge(&seen, detail)?),
            };
            if let Some(own) = &own {
                tally.add(own, face.scale());
            }
            let nodes = own.as_ref().or(whole.as_ref()).map_or(&[][..], |selection| &selection.nodes);
            let (sums, counts) = match &mut means.adapter {
                Some((passes, adapter)) => {
                    let painter = (*passes, &mut **adapter);
                    adapter_faces::sums(painter, subject, face.view, nodes, pixel, &mut tally.drawn_by)?
                }
                None => subject.sum_face(face.view, nodes, pixel, surfaces)?,
            };
            tally.counts += counts;
            Ok(sums.into())
        })?;
        let clusters = whole.filter(|_| means.scene.purpose == Purpose::Clusters);
        if let (Some(clusters), Some(panorama), None) = (clusters, self.panorama, self.stereo) {
            let lit = |(index, [p, _]): (usize, &[f32; 2])| {
                let [x, y] = [index % texels.width as usize, index / texels.width as usize];
                f64::from(*p) * panorama.solid_angle([x as f64 + 0.5, y as f64 + 0.5])
            };
            let total = texels.values.iter().enumerate().map(lit).sum();
            tally.error_bound = bound_around(self.base.eye, depiction, &clusters.nodes, total);
        }
        Ok(texels)
    }

    /// Colours, face by face.
    fn colors(
        &self,
        means: &mut Means<'_>,
        subject: &Subject<'_>,
        tau: f64,
        tally: &mut Tally,
    ) -> Result<LightPicture, PictureError> {
        let &Subject { metadata, depiction, .. } = subject;
        let Needs { margin_px, of_data, .. } = depiction.needs();
        let reach = depiction.reach_px();
        let whole = if of_data { None } else { self.select_within(means, subject, tally)? };
        let is_of_all = of_data || whole.is_some();
        // Where faces do not share what they draw, all the data is read for ranges that are looked for.
        let everything = match whole {
            Some(whole) => whole,
            None if of_data || finds_in_all(subject) => self.select_all(means, subject)?,
            None => SceneSelection::default(),
        };
        if of_data {
            tally.add(&everything, 1.0);
        }
        let all = cut(&self.base, decode(depiction, metadata, &everything.nodes));
        let all = batches(depiction, &all)?;
        let mut shared = self.shared(subject, &all)?;
        self.look_in_views(means, subject, (&mut shared, tau), is_of_all.then_some(&everything))?;
        // What the last view that showed something was painted with.
        let mut last: Option<LightPicture> = None;
        let (ground, shared) = (means.ground, &shared);
        let margin = ground.map_or(0, |ground| ground.light().margin_px).max(margin_px);
        let texels = self.shoot(Sampling { margin, ..COLORS }, |face| {
            means.go_on()?;
            let own = match is_of_all {
                true => None,
                false => {
                    let detail = shared.depiction.detail(face.view, tau * face.scale(), metadata);
                    let own = means.converge(&seen(reach, face), detail)?;
                    tally.add(&own, face.scale());
                    Some(own)
                }
            };
            let selection = own.as_ref().unwrap_or(&everything);
            let decoded = match (&means.adapter, &own) {
                (None, Some(selection)) => cut(face.view, decode(depiction, metadata, &selection.nodes)),
                _ => Vec::new(),
            };
            let of_face = batches(depiction, &decoded)?;
            let seen = if own.is_some() { &of_face } else { &all };
            let in_the_way = |from: &View| ground.and_then(|ground| ground.opaque(from, face.view));
            let subject = &Subject { lighting: lighting(ground, &in_the_way), ..*subject };
            let surfaces =
                ground.map(|ground| shared.subject(subject).ground(ground, face.view, seen, Some(&self.base)));
            let takes_paths = depiction.mode.technique.takes_paths();
            let paths = takes_paths.then(|| means.paths_in(face).map(PathLayer::fragments)).flatten();
            let among = among(paths, surfaces.as_ref());
            let among = among.as_deref();
            let around = face.around.map(|[pixel, _]| pixel);
            let painted = match &mut means.adapter {
                Some((passes, adapter)) => {
                    let painter = (*passes, &mut **adapter);
                    let shared = shared.subject(subject);
                    adapter_faces::light(painter, &shared, face.view, &selection.nodes, &mut tally.drawn_by)?
                }
                None => shared.paint(subject, face.view, seen, (among, around))?,
            };
            let Some(mut painted) = painted else {
                let black = || Texels::black(face.view.width, face.view.height);
                return Ok(among.map_or_else(black, |paths| PathFragments::colors(paths).into()));
            };
            let colors = std::mem::take(&mut painted.colors);
            painted.report.values = None;
            last = Some(painted);
            Ok(colors.into())
        })?;
        let last = match (last, means.ground) {
            (Some(last), _) => last,
            (None, Some(_)) => LightPicture::of(Colors::default()),
            (None, None) => return Err(PictureError::Asked("eye, target: no particles are in view".into())),
        };
        Ok(LightPicture { colors: texels.into(), ..last })
    }

    /// What all views draw, where their number of splats is limited: so many of all together, and the same for both eyes. `None` where each
    /// draws what its own pixels ask for.
    fn select_within(
        &self,
        means: &mut Means<'_>,
        subject: &Subject<'_>,
        tally: &mut Tally,
    ) -> Result<Option<SceneSelection>, PictureError> {
        let Subject { metadata, depiction, .. } = *subject;
        let Detail::Budget { splats, .. } = depiction.detail(&self.base, 1.0, metadata) else { return Ok(None) };
        let reach = depiction.reach_px();
        let (view, scope) = match (&self.panorama, self.stereo) {
            (Some(panorama), stereo) => {
                let [right, up, forward] = panorama.frame();
                let pixel = panorama.pixel_angle();
                // A face's pixels are narrower towards its edges, as in `seen`.
                let half_angle = panorama.half_angle() + 3.0 * pixel * reach;
                let away = stereo.map_or(0.0, |stereo| 0.5 * stereo.separation);
                (View { right, up, forward, ..self.base }, Scope::Around { half_angle, pixel, away })
            }
            (None, Some(stereo)) => stereo.both(&depiction.selection_view(&self.base))?,
            (None, None) => (depiction.selection_view(&self.base), Scope::Picture),
        };
        let selection = means.converge(&view, Detail::Budget { splats, scope })?;
        tally.add(&selection, 1.0);
        Ok(Some(selection))
    }

    /// The nodes that all faces find their ranges in: those of all the data, as a parallel view of it has them.
    fn select_all(&self, means: &mut Means<'_>, subject: &Subject<'_>) -> Result<SceneSelection, PictureError> {
        let all = sketch(&self.base, with_images(&self.base, subject.metadata.bounds()))?;
        let detail = match (subject.depiction.detail(&all, 1.0, subject.metadata), means.scene.purpose) {
            (detail @ Detail::Budget { .. }, _) | (detail, Purpose::Splats | Purpose::Clusters) => detail,
            (_, Purpose::Samples) => Detail::Sampling { sigma: 1.0 / all.focal_pixels(), near: 0.0 },
        };
        means.converge(&all, detail)
    }

    /// The views in which ranges are looked for: those of both eyes, or the faces of a panorama around the middle between them; with what
    /// [`Face::around`] says.
    fn views(&self) -> Result<Vec<(View, Option<[f64; 2]>)>, PictureError> {
        let Some(panorama) = self.panorama else {
            let Some(stereo) = self.stereo else { return Ok(vec![(self.base, None)]) };
            // A picture of one eye has the colours of the pair.
            let [left, right] = [Eye::Left, Eye::Right].map(|eye| stereo.off_axis(&self.base, eye));
            return Ok(vec![(left?, None), (right?, None)]);
        };
        let sections = Sections::new(panorama, None, COLORS);
        let around = Some([panorama.pixel_angle(), sections.oversampling()]);
        Ok(sections.faces(0, &self.base).into_iter().map(|face| (face.view, around)).collect())
    }

    /// Notes what all views show together, where ranges are looked for in that; each of them draws `whole`, or what its own pixels ask for. One of
    /// the views that show something, and its nodes.
    fn look_in_views(
        &self,
        means: &mut Means<'_>,
        subject: &Subject<'_>,
        (shared, tau): (&mut SharedLook, f64),
        whole: Option<&SceneSelection>,
    ) -> Result<Option<(View, Vec<SceneNode>)>, PictureError> {
        let &Subject { metadata, depiction, transfer, .. } = subject;
        if !depiction.mode.technique.looks_in_view(&depiction.settings, transfer) {
            return Ok(None);
        }
        let (mut all, mut last): (Option<InView>, _) = (None, None);
        for (view, around) in self.views()? {
            means.go_on()?;
            let face = Face { view: &view, around };
            let nodes = match whole {
                Some(whole) => whole.nodes.clone(),
                None => {
                    let detail = shared.depiction.detail(&view, tau * face.scale(), metadata);
                    means.converge(&seen(depiction.reach_px(), &face), detail)?.nodes
                }
            };
            let found = {
                let decoded = cut(&view, decode(depiction, metadata, &nodes));
                let pixel = around.map(|[pixel, _]| pixel);
                shared.subject(subject).in_view(&view, &batches(depiction, &decoded)?, pixel)
            };
            match found {
                Ok(Some(found)) => {
                    match &mut all {
                        Some(all) => all.add(found),
                        None => all = Some(found),
                    }
                    last = Some((view, nodes));
                }
                Ok(None) | Err(VolumeError::Grid(GridError::NothingInView)) => {}
                Err(error) => return Err(error.into()),
            }
        }
        shared.in_views = all.map(Arc::new);
        Ok(last)
    }

    /// What all faces share, where `all` are the particles of all the data.
    fn shared(&self, subject: &Subject<'_>, all: &[Splats<'_>]) -> Result<SharedLook, PictureError> {
        let bounds = with_images(&self.base, subject.metadata.bounds());
        Ok(SharedLook::new(subject, &self.base, bounds, self.pixel(), all)?)
    }

    /// The ranges of its colours.
    ///
    /// # Errors
    /// As [`Projector::draw`].
    pub fn levels(&self, means: &mut Means<'_>, subject: &Subject<'_>, tau: f64) -> Result<Levels, PictureError> {
        if !subject.depiction.mode.is_light() {
            let texels = self.sums(means, subject, tau, &mut Tally::new())?;
            return Ok(subject.transfer.levels(&texels.accumulation(subject.depiction.attribute.is_some())));
        }
        let all = if finds_in_all(subject) { self.select_all(means, subject)? } else { SceneSelection::default() };
        let all = cut(&self.base, decode(subject.depiction, subject.metadata, &all.nodes));
        let mut shared = self.shared(subject, &batches(subject.depiction, &all)?)?;
        match self.look_in_views(means, subject, (&mut shared, tau), None)? {
            Some((view, nodes)) => Ok(shared.subject(subject).levels_of_nodes(&view, &nodes, &Plan::default())?),
            // No picture is asked for ranges that are numbers by now.
            None => Ok(shared.transfer.levels(&Accumulation::default())),
        }
    }
}

/// Whether colours of light have ranges that are looked for in all the data.
fn finds_in_all(subject: &Subject<'_>) -> bool {
    let &Subject { depiction, transfer, .. } = subject;
    transfer.numbers().is_none() && !depiction.mode.technique.looks_in_view(&depiction.settings, transfer)
}

/// The batches that a view may see. What clusters reach is not known before it is known how many are drawn of a node.
fn seen_of<'a>(batches: &[Splats<'a>], view: &View) -> Vec<Splats<'a>> {
    let is_seen = |batch: &&Splats<'_>| batch.reach().is_none_or(|reach| view.sees(&reach));
    batches.iter().filter(is_seen).copied().collect()
}

/// The view by which nodes are selected: what lies outside of a face reaches so many of the picture's pixels into it.
fn seen(reach: f64, face: &Face<'_>) -> View {
    // A face's pixels are narrower towards its edges, by half and more.
    match (3.0 * face.scale() * reach).ceil() as u32 {
        0 => *face.view,
        pixels => face.view.padded(pixels),
    }
}
