//! Heights with particles, or several fields of heights, in one picture: depth decides what hides what.
//!
//! A look is that of the kind that its mode draws, or where it names none, of the first dataset: attribute, colours and legend are of that kind,
//! and the other kind is drawn as usual, heights as `surface` and particles in the mode that suits them. Settings are those of both modes.

use super::depths::SurfaceDepths;
use super::names::{Floor, Names, take};
use super::placement::FieldPlacement;
use super::raw::{SurfaceChannels, SurfaceShown};
use super::session::{Prepared, SurfaceSession};
use super::standing::standing;
use crate::annotate::Units;
use crate::color::transfer::Levels;
use crate::color::{Colors, Image};
use crate::cpu::paths::PathFragments;
use crate::cpu::surface::fragments::{Layer, fragments};
use crate::cpu::surface::paged::PagedSurface;
use crate::cpu::surface::placed::Placed;
use crate::cpu::surface::sight::Sight;
use crate::cpu::surface::{SurfaceOptions, SurfaceReport, draw};
use crate::heights::model::{Heights, units};
use crate::import;
use crate::look::{Attribute, Camera, DataKind, LookPatch, Member, Shot};
use crate::mode::{LightPicture, Mode, Raw};
use crate::model::{Bounds, ReadMethod, Unit};
use crate::modes::{self, surface};
use crate::picture::drawn::Coloration;
use crate::picture::ground::Ground;
use crate::picture::projected::Projector;
use crate::picture::ranges::{Format, Measured};
use crate::picture::session::Reporter;
use crate::picture::times::Times;
use crate::picture::{Picture, PictureError, Session, SessionOptions};
use crate::store::{PageFile, RunFile};
use crate::view::{Panorama, View};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Draws pictures of heights among other things.
pub struct MixedSession {
    /// The fields, one at least, each as a member.
    fields: Vec<(Member, SurfaceSession)>,
    particles: Option<Session>,
    /// Whether the first dataset is of heights.
    begins_with_heights: bool,
    is_raw: bool,
    /// Names that stand on the fields.
    names: Option<Names>,
    reporter: Arc<dyn Reporter>,
}

/// What a look comes to for both kinds.
struct Looks {
    heights: LookPatch,
    particles: LookPatch,
    /// Whether the picture is about heights: what a legend tells.
    is_of_heights: bool,
}

/// A field that is drawn.
struct Standing<'a> {
    nodes: &'a PagedSurface,
    placed: Placed,
    placement: FieldPlacement,
    options: SurfaceOptions,
}

/// The fields of a picture.
struct Fields<'a> {
    fields: Vec<Standing<'a>>,
    report: Mutex<SurfaceReport>,
    /// How far they are away in the last picture.
    depths: Mutex<Option<SurfaceDepths>>,
}

/// What came of a picture.
enum Drawn {
    Particles(Box<Picture>),
    Fields(Colors),
}

impl<'a> Fields<'a> {
    /// As each of them is prepared and placed, in their order.
    fn new(
        fields: &'a mut [(Member, SurfaceSession)],
        prepared: &[Prepared],
        placements: Vec<FieldPlacement>,
        look: &LookPatch,
    ) -> Fields<'a> {
        let each = fields.iter_mut().zip(prepared).zip(placements).map(|(((_, session), prepared), placement)| {
            let options = SurfaceOptions { raw: false, ..session.surface_options(prepared, look) };
            let placed = prepared.placed;
            Standing { nodes: session.nodes(prepared), placed, placement, options }
        });
        let report = Mutex::new(SurfaceReport { is_converged: true, ..SurfaceReport::default() });
        Fields { fields: each.collect(), report, depths: Mutex::default() }
    }

    /// What was drawn.
    fn report(&self) -> SurfaceReport {
        *self.report.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Why something could not be read.
    fn error(&self) -> Option<String> {
        self.fields.iter().find_map(|field| field.nodes.error())
    }

    /// Raw channels at pixels' centres, of what is nearest there.
    fn channels(&self, sight: &Sight) -> SurfaceChannels {
        let [width, height] = sight.size();
        let mut whole: Vec<[f64; 7]> = Vec::new();
        for Standing { nodes, placed, placement, options } in &self.fields {
            let (own, options) = (placement.sight(sight), SurfaceOptions { look: None, raw: true, ..options.clone() });
            nodes.prepare(placed, &own, &options);
            let mut drawn = draw(*nodes, placed, &own, &options).raw;
            drawn.iter_mut().for_each(|channels| channels[0] *= placement.scale);
            match whole.is_empty() {
                true => whole = drawn,
                false => whole.iter_mut().zip(drawn).for_each(|(whole, own)| {
                    if own[0] < whole[0] || whole[0].is_nan() {
                        *whole = own;
                    }
                }),
            }
        }
        SurfaceChannels { width, height, values: whole }
    }
}

impl Ground for Fields<'_> {
    fn fragments(&self, view: &View) -> PathFragments {
        let sights: Vec<Sight> = self.fields.iter().map(|field| Sight::Flat(field.placement.view(view))).collect();
        for (field, sight) in self.fields.iter().zip(&sights) {
            field.nodes.prepare(&field.placed, sight, &field.options);
        }
        let layers = self.fields.iter().zip(&sights).map(|(Standing { nodes, placed, placement, options }, sight)| {
            Layer { source: *nodes, placed, sight, options, scale: placement.scale }
        });
        let (found, report) = fragments(&layers.collect::<Vec<_>>());
        self.report.lock().unwrap_or_else(PoisonError::into_inner).add(&report);
        *self.depths.lock().unwrap_or_else(PoisonError::into_inner) = SurfaceDepths::of_fragments(view, &found);
        found
    }
}

impl MixedSession {
    /// Whether it draws datasets: where there are heights among several, or heights that lie elsewhere than by themselves.
    pub fn is_for(members: &[Member]) -> bool {
        let is_alone = matches!(members, [only] if only.is_in_place());
        !is_alone && members.iter().any(Member::is_of_heights)
    }

    /// Opens datasets, of which one at least is of heights. `page_file` turns what the user names into a page file of particles; these are read as
    /// the shots that will be drawn need them.
    ///
    /// # Errors
    /// As [`SurfaceSession::open`] and [`Session::open`].
    pub fn open<'a>(
        members: &[Member],
        options: SessionOptions,
        shots: impl IntoIterator<Item = &'a Shot>,
        mut page_file: impl FnMut(&Path) -> Result<PathBuf, PictureError>,
        reporter: Arc<dyn Reporter>,
    ) -> Result<MixedSession, PictureError> {
        let (of_heights, others): (Vec<&Member>, Vec<&Member>) =
            members.iter().partition(|member| member.is_of_heights());
        let mut others: Vec<Member> = others.into_iter().cloned().collect();
        let begins_with_heights = members.first().is_some_and(Member::is_of_heights);
        let mut fields = Vec::new();
        for member in of_heights {
            let session = SurfaceSession::open(&member.path, &member.said, options.clone(), Arc::clone(&reporter))?;
            fields.push((member.clone(), session));
        }
        let Some((_, first)) = fields.first() else { return Err(PictureError::Asked("no heights".into())) };
        let shots: Vec<&Shot> = shots.into_iter().collect();
        if begins_with_heights {
            let look = shots.first().map(|shot| of_mode(&shot.look, &surface::MODE)).unwrap_or_default();
            let unit = first.opened().length_unit(first.prepare(&look)?.placed.map);
            in_lengths_of(&unit, &mut others, options.read, &mut page_file)?;
        }
        let is_raw = options.raw;
        let particles = match others.is_empty() {
            true => None,
            false => {
                // What a look about heights says of an attribute is none of the particles'.
                let own = |shot: &&Shot| match shot.look.mode.map_or(begins_with_heights, Mode::takes_surfaces) {
                    true => {
                        Shot { look: LookPatch { mode: None, attribute: None, ..shot.look.clone() }, ..Shot::default() }
                    }
                    false => (*shot).clone(),
                };
                let shots: Vec<Shot> = shots.iter().map(own).collect();
                Some(Session::open(&others, options, &shots, page_file, Arc::clone(&reporter))?)
            }
        };
        Ok(MixedSession { fields, particles, begins_with_heights, is_raw, names: None, reporter })
    }

    /// What is open: fields, one at least, each as a member, and what draws the particles.
    pub(super) fn of(
        fields: Vec<(Member, SurfaceSession)>,
        particles: Option<Session>,
        begins_with_heights: bool,
        reporter: Arc<dyn Reporter>,
    ) -> MixedSession {
        MixedSession { fields, particles, begins_with_heights, is_raw: false, names: None, reporter }
    }

    /// What draws the particles, where there are some.
    pub fn particles(&mut self) -> Option<&mut Session> {
        self.particles.as_mut()
    }

    /// Whether the first dataset is of heights: then the world is theirs, with z up.
    pub fn begins_with_heights(&self) -> bool {
        self.begins_with_heights
    }

    /// The box that a look's pictures are framed by: that of the first dataset, of fields of heights alone that of all.
    ///
    /// # Errors
    /// Settings that do not fit the data.
    pub fn framed(&mut self, look: &LookPatch) -> Result<Bounds, PictureError> {
        let looks = self.looks(look)?;
        match &mut self.particles {
            Some(session) if !self.begins_with_heights => session.framed(&looks.particles),
            _ => {
                let prepared = self.prepare(&looks.heights)?;
                Ok(self.bounds(&prepared))
            }
        }
    }

    /// The box of the first field, or of all where there is nothing else.
    fn bounds(&self, prepared: &[Prepared]) -> Bounds {
        let count = if self.particles.is_some() { 1 } else { self.fields.len() };
        let own = |(((_, session), prepared), placement): ((&(Member, SurfaceSession), &Prepared), FieldPlacement)| {
            placement.bounds(session.bounds(&prepared.placed))
        };
        let all = self.fields.iter().zip(prepared).zip(self.placements(prepared)).take(count).map(own);
        all.reduce(Bounds::union).unwrap_or(Bounds::EMPTY)
    }

    /// What each field comes to, in the order of fields.
    fn prepare(&self, look: &LookPatch) -> Result<Vec<Prepared>, PictureError> {
        self.fields.iter().map(|(_, session)| session.prepare(look)).collect()
    }

    /// The unit of the scene's lengths: that of its first dataset.
    fn unit(&self, prepared: &[Prepared]) -> Unit {
        match (&self.particles, self.fields.first().zip(prepared.first())) {
            (Some(session), _) if !self.begins_with_heights => session.tree().metadata().length_unit.clone(),
            (_, Some(((_, session), prepared))) => session.opened().length_unit(prepared.placed.map),
            (_, None) => Unit::default(),
        }
    }

    /// Where each field lies.
    fn placements(&self, prepared: &[Prepared]) -> Vec<FieldPlacement> {
        let scene = self.unit(prepared);
        let each = self.fields.iter().zip(prepared).map(|((member, session), prepared)| {
            placement_of(member, &session.opened().length_unit(prepared.placed.map), &scene)
        });
        each.collect()
    }

    /// What a look says of each kind.
    fn looks(&self, look: &LookPatch) -> Result<Looks, PictureError> {
        let is_of_heights = match (look.mode, &self.particles) {
            (_, None) => true,
            (Some(mode), _) => mode.takes_surfaces(),
            (None, _) => self.begins_with_heights,
        };
        if self.particles.is_none() {
            return Ok(Looks { heights: look.clone(), particles: LookPatch::default(), is_of_heights });
        }
        let usual = || {
            let metadata = self.particles.as_ref().map(|session| session.tree().metadata());
            let families = metadata.iter().flat_map(|metadata| &metadata.families);
            let fields: Vec<&str> =
                families.flat_map(|family| &family.attributes).map(|field| field.name.as_str()).collect();
            modes::usual(fields.into_iter())
        };
        let of_particles = look.mode.filter(|mode| !mode.takes_surfaces()).unwrap_or_else(usual);
        let known = |name: &str| [&surface::MODE, of_particles].iter().any(|mode| has(mode, name));
        let strangers = look.settings.filtered(|name| !known(name));
        if let Err(error) = strangers.check(if is_of_heights { &surface::MODE } else { of_particles }) {
            return Err(PictureError::Asked(error.to_string()));
        }
        let (mut heights, mut particles) = (of_mode(look, &surface::MODE), of_mode(look, of_particles));
        let other = if is_of_heights { &mut particles } else { &mut heights };
        (other.attribute, other.transfer) = (other.attribute.take().filter(|own| *own == Attribute::None), None);
        Ok(Looks { heights, particles, is_of_heights })
    }

    /// Draws a shot.
    ///
    /// # Errors
    /// [`PictureError`] when the data cannot be read, a setting does not fit it, or nothing draws a mode among heights.
    pub fn draw(&mut self, shot: &Shot) -> Result<Picture, PictureError> {
        let looks = self.looks(&shot.look)?;
        let prepared = self.prepare(&looks.heights)?;
        let (unit, bounds, placements) = (self.unit(&prepared), self.bounds(&prepared), self.placements(&prepared));
        self.check(shot, &prepared)?;
        let (mut shot, mut lifted) = (shot.clone(), None);
        if let Some(first) = prepared.first().filter(|_| self.begins_with_heights) {
            shot = standing(&shot, bounds, &first.placed)?;
            for (((_, session), prepared), placement) in self.fields.iter().zip(&prepared).zip(&placements) {
                lifted = session.keep_above(&mut shot, prepared, placement)?.or(lifted);
            }
        }
        let each = self.fields.iter().zip(&prepared).zip(&placements);
        let floors: Vec<(&dyn Heights, Floor)> = each
            .map(|(((_, session), prepared), placement)| {
                (session.file() as &dyn Heights, session.floor(prepared, *placement))
            })
            .collect();
        let names = take(&mut self.names, &mut shot, &floors, &*self.reporter)?;
        let shot = &shot;
        let ground = Fields::new(&mut self.fields, &prepared, placements, &looks.heights);
        let mut times = Times::default();
        let (drawn, view) = match &mut self.particles {
            Some(session) => {
                let picture = session.draw_among(&Shot { look: looks.particles, ..shot.clone() }, Some(&ground))?;
                let view = picture.annotation.view;
                (Drawn::Particles(Box::new(picture)), view)
            }
            None => {
                let view = shot.view(bounds, None)?;
                let colors = times.frame(|times| times.measure("draw", || alone(&ground, shot, &view)))?;
                (Drawn::Fields(colors), view)
            }
        };
        let channels = match self.is_raw {
            true => Some(ground.channels(&sight_of(&view, shot)?)),
            false => None,
        };
        let (report, error) = (ground.report(), ground.error());
        let shown = SurfaceShown { report, channels, labels: None, lifted };
        drop(ground);
        if let Some(error) = &error {
            self.reporter.tell(error.clone());
        }
        let is_whole = report.is_converged && error.is_none();
        let names = names.map(|names| names.seen(&view));
        let first = self.fields.first().zip(prepared.into_iter().next());
        let Some(((_, first), about)) = first else { return Err(PictureError::Stopped) };
        let picture = match drawn {
            Drawn::Fields(colors) => {
                let shot = Shot { look: looks.heights, ..shot.clone() };
                let picture = first.pictured(&shot, (view, bounds), about, colors, shown, times.medians())?;
                let annotation = picture.annotation.naming(names);
                return Ok(Picture { converged: is_whole, annotation, ..picture });
            }
            Drawn::Particles(picture) => *picture,
        };
        let (depiction, units, told) = match looks.is_of_heights {
            true => {
                let (depiction, units) = first.told(&about, &looks.heights);
                let levels = Levels { p: about.look.range, s: [0.0, 1.0] };
                (depiction, units, Some(Coloration { transfer: about.look.transfer, levels }))
            }
            false => (picture.annotation.depiction.clone(), picture.annotation.units().clone(), None),
        };
        Ok(Picture {
            converged: picture.converged && is_whole,
            error_px: picture.error_px.max(report.error_px),
            annotation: picture.annotation.telling(depiction, Units { length: unit, ..units }).naming(names),
            told,
            surface: Some(shown),
            ..picture
        })
    }

    /// Refuses what there is none of.
    fn check(&self, shot: &Shot, prepared: &[Prepared]) -> Result<(), PictureError> {
        let is_flat = prepared.iter().all(|prepared| prepared.placed.is_flat());
        if self.is_raw && (shot.stereo.is_some() || !is_flat && !shot.surround.is_flat()) {
            let why =
                "--raw: expected one picture with rays of its own: no pair for two eyes, and no globe around the eye";
            return Err(self.refuse(why));
        }
        if self.particles.is_none() && shot.look.time.is_some() {
            return Err(self.refuse("--time: heights have no times"));
        }
        Ok(())
    }

    fn refuse(&self, why: &str) -> PictureError {
        PictureError::of(self.fields.first().map_or(Path::new(""), |(_, session)| session.path()), why)
    }

    /// A drawn picture in colours, with what the shot's film does to it.
    ///
    /// # Errors
    /// As [`MixedSession::draw`] for the picture that it is blended with, and where a picture over it cannot be read.
    pub fn finished(&mut self, shot: &Shot, picture: &Picture) -> Result<Image, PictureError> {
        picture.finished_by(shot, |before| self.draw(before))
    }

    /// A look's picture of a view, of about `limit` particles at most; colours of what it is about have the ranges `levels`, or their own. And how
    /// many particles it took.
    ///
    /// # Errors
    /// As [`MixedSession::draw`].
    pub fn image(
        &mut self,
        look: &LookPatch,
        view: &View,
        levels: Option<Levels>,
        diameter: f64,
        limit: u64,
    ) -> Result<(Image, u64), PictureError> {
        let seen = self.seen(look, view, levels, (diameter, limit))?;
        Ok((seen.image, seen.particles.taken))
    }

    /// What is known of a look's picture from a camera: the ranges of what it is about.
    ///
    /// # Errors
    /// As [`MixedSession::draw`].
    pub fn ranges(&mut self, look: &LookPatch, camera: &Camera, format: Format) -> Result<Measured, PictureError> {
        let looks = self.looks(look)?;
        match (&mut self.particles, self.fields.first_mut()) {
            (Some(session), _) if !looks.is_of_heights => session.ranges(&looks.particles, camera, format),
            (_, Some((_, first))) => first.ranges(&looks.heights, camera, format),
            (_, None) => Err(PictureError::Stopped),
        }
    }
}

/// Where a field lies that has lengths of its own.
pub(super) fn placement_of(member: &Member, own: &Unit, scene: &Unit) -> FieldPlacement {
    let scale = member.scale.or_else(|| ratio(own, scene)).unwrap_or(1.0);
    // A ratio of units that are the same may differ from 1 by rounding.
    let scale = if (scale - 1.0).abs() < 1e-12 { 1.0 } else { scale };
    FieldPlacement { offset: member.offset, scale }
}

/// Says of particles how long their lengths are in a world of heights, where both units are known and nobody has said it.
pub(super) fn in_lengths_of(
    unit: &Unit,
    particles: &mut [Member],
    read: ReadMethod,
    page_file: &mut dyn FnMut(&Path) -> Result<PathBuf, PictureError>,
) -> Result<(), PictureError> {
    for member in particles.iter_mut().filter(|member| member.scale.is_none()) {
        let own = unit_of(&member.path, read, page_file)?;
        member.scale = ratio(&own, unit).filter(|ratio| (ratio - 1.0).abs() > 1e-12);
    }
    Ok(())
}

/// The line of sight of each pixel of a picture.
fn sight_of(view: &View, shot: &Shot) -> Result<Sight, PictureError> {
    Ok(match Panorama::around(view, shot.surround)? {
        None => Sight::Flat(*view),
        Some(panorama) => Sight::Around { panorama, eye: view.eye, cut: view.cut },
    })
}

/// Fields alone, in colours.
fn alone(fields: &Fields<'_>, shot: &Shot, view: &View) -> Result<Colors, PictureError> {
    if !shot.is_projected() {
        return Ok(fields.fragments(view).colors());
    }
    let projector = Projector::new(*view, shot.surround, shot.stereo)?;
    let each = |view: &View| Ok(Some(Raw::Light(LightPicture::of(fields.fragments(view).colors()))));
    match projector.draw_each(true, each)? {
        Raw::Light(light) => Ok(light.colors),
        Raw::Sums(..) => Err(PictureError::Stopped),
    }
}

/// A look of another mode.
fn of_mode(look: &LookPatch, mode: &'static Mode) -> LookPatch {
    LookPatch { mode: Some(mode), settings: look.settings.of_mode(mode), ..look.clone() }
}

/// Whether a mode has a setting.
fn has(mode: &Mode, name: &str) -> bool {
    mode.own_settings().any(|setting| setting.name == name)
}

/// How many of another unit one is, where both are lengths.
fn ratio(own: &Unit, other: &Unit) -> Option<f64> {
    let metres = |unit: &Unit| units::metres(unit).or_else(|| unit.ratio(&Unit::new("m")));
    metres(own).zip(metres(other)).map(|(own, other)| own / other).or_else(|| own.ratio(other))
}

/// The unit of a dataset's lengths.
fn unit_of(
    path: &Path,
    read: ReadMethod,
    page_file: &mut dyn FnMut(&Path) -> Result<PathBuf, PictureError>,
) -> Result<Unit, PictureError> {
    if matches!(DataKind::of(path), Ok(DataKind::Source)) {
        return Ok(import::open(path)?.description().length_unit.clone());
    }
    let path = page_file(path)?;
    Ok(match DataKind::of_particles(&path)? {
        DataKind::Run => RunFile::open(&path, read)?.directory().length_unit.clone(),
        _ => PageFile::open_with(&path, read)?.metadata().length_unit.clone(),
    })
}

mod seen;
#[cfg(test)]
mod tests;

pub use seen::{ParticlesSeen, SeenMixed};
