//! Several kinds of data in one picture, or several fields of heights, images or volumes: depth decides what hides what.
//!
//! A look is that of the kind that its mode draws, or where it names none, of the first dataset: attribute, colours and legend are of that kind,
//! and the others are drawn as usual, heights as `surface`, volumes as `volume`, particles in the mode that suits them. Settings are those of all these modes. An image or
//! a volume may have a look of its own.

mod among;
mod fields;
mod heights;
mod looks;
mod opened;
mod seen;
#[cfg(test)]
mod tests;
mod units;

pub use opened::{FieldAmong, HeightsField, OpenMixed, Samples};
pub use seen::{Colored, ParticlesSeen, SeenMixed};

use self::among::{Among, alone};
use self::fields::{FieldsAmong, Lying};
use self::heights::{Finder, HeightsAmong};
use self::looks::{Kinds, Looks};
use self::units::{in_lengths_of, placement_of};
use crate::annotate::Units;
use crate::color::transfer::{Levels, TransferFunction};
use crate::color::{Colors, Image};
use crate::cpu::surface::sight::Sight;
use crate::heights::model::Heights;
use crate::look::{Backend, Camera, CameraConfig, LookPatch, Member, MemberKind, Shot};
use crate::mode::{LightPicture, Raw};
use crate::model::{Bounds, Unit};
use crate::modes::{self, surface};
use crate::picture::adapter::Adapter;
use crate::picture::drawn::Coloration;
use crate::picture::field::{FieldSession, PreparedField};
use crate::picture::placement::FieldPlacement;
use crate::picture::ranges::{Format, Measured};
use crate::picture::session::Reporter;
use crate::picture::surface::names::{Floor, Names, take};
use crate::picture::surface::painting::Painter;
use crate::picture::surface::session::Prepared;
use crate::picture::surface::standing::standing;
use crate::picture::surface::{SurfaceSession, SurfaceShown};
use crate::picture::times::Times;
use crate::picture::{Picture, PictureError, Session, SessionOptions};
use crate::store::Metadata;
use crate::view::{Panorama, View};
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Draws pictures of several kinds of data.
pub struct MixedSession {
    /// The fields of heights, each as a member.
    heights: Vec<(Member, SurfaceSession)>,
    /// The images and volumes, each as a member.
    fields: Vec<(Member, FieldSession)>,
    particles: Option<Session>,
    /// Of each dataset, in their order.
    kinds: Vec<MemberKind>,
    is_raw: bool,
    backend: Option<Backend>,
    /// What finds what is seen of heights beside the processor.
    painter: Painter,
    /// Names that stand on heights.
    names: Option<Names>,
    reporter: Arc<dyn Reporter>,
}

/// What a look comes to on all that is not particles, ready for any view.
struct Ready {
    heights: Vec<Prepared>,
    fields: Vec<PreparedField>,
}

/// Where each of them lies.
struct Placements {
    heights: Vec<FieldPlacement>,
    fields: Vec<FieldPlacement>,
}

/// What came of a picture.
enum Drawn {
    Particles(Box<Picture>),
    Rest(Colors),
}

impl MixedSession {
    /// Whether it draws datasets: where there is something else than particles among several, or heights, an image or a volume that lie elsewhere than by
    /// themselves.
    pub fn is_for(members: &[Member]) -> bool {
        let is_alone = matches!(members, [only] if only.is_in_place());
        !is_alone && members.iter().any(|member| member.kind() != MemberKind::Particles)
    }

    /// Opens datasets, of which one at least is no particles. `page_file` turns what the user names into a page file of particles; these are read as
    /// the shots that will be drawn need them.
    ///
    /// # Errors
    /// As [`SurfaceSession::open`], [`FieldSession::open`] and [`Session::open`].
    pub fn open<'a>(
        members: &[Member],
        options: SessionOptions,
        shots: impl IntoIterator<Item = &'a Shot>,
        mut page_file: impl FnMut(&Path) -> Result<PathBuf, PictureError>,
        reporter: Arc<dyn Reporter>,
    ) -> Result<MixedSession, PictureError> {
        let kinds: Vec<MemberKind> = members.iter().map(Member::kind).collect();
        let (mut heights, mut fields, mut others) = (Vec::new(), Vec::new(), Vec::new());
        for (member, kind) in members.iter().zip(&kinds) {
            let (options, reporter) = (options.clone(), Arc::clone(&reporter));
            match kind {
                MemberKind::Heights => {
                    let session = SurfaceSession::open(&member.path, &member.said, options, reporter)?;
                    heights.push((member.clone(), session));
                }
                MemberKind::Field => {
                    fields.push((member.clone(), FieldSession::open(&member.path, options, reporter)?));
                }
                MemberKind::Particles => others.push(member.clone()),
            }
        }
        let mut opened = MixedSession {
            heights,
            fields,
            particles: None,
            kinds,
            is_raw: options.raw,
            backend: options.backend,
            painter: Painter::default(),
            names: None,
            reporter: Arc::clone(&reporter),
        };
        if others.is_empty() {
            return Ok(opened);
        }
        let shots: Vec<&Shot> = shots.into_iter().collect();
        if opened.first_kind() != MemberKind::Particles {
            let look = shots.first().map(|shot| shot.look.clone()).unwrap_or_default();
            let unit = opened.own_unit(&look)?;
            in_lengths_of(&unit, &mut others, options.read, &mut page_file)?;
        }
        // What a look about something else says of an attribute is none of the particles'.
        let kinds = opened.kinds(None);
        let own = |shot: &&Shot| match kinds.about(shot.look.mode) {
            MemberKind::Particles => (*shot).clone(),
            _ => Shot { look: LookPatch { mode: None, attribute: None, ..shot.look.clone() }, ..Shot::default() },
        };
        let shots: Vec<Shot> = shots.iter().map(own).collect();
        opened.particles = Some(Session::open(&others, options, &shots, page_file, reporter)?);
        Ok(opened)
    }

    /// Has an adapter find what each sample of a picture shows of heights, where it is asked to, or faster, and there is one field of them. The
    /// processor draws everything else, and puts all of it together.
    pub fn use_adapter(&mut self, adapter: Option<Box<dyn Adapter>>) {
        self.painter.adapter = adapter;
    }

    /// What draws the particles, where there are some.
    pub fn particles(&mut self) -> Option<&mut Session> {
        self.particles.as_mut()
    }

    /// Bytes that chunks of its heights may take. A tour, which asks, is of one member: of particles it is [`Session`] that draws.
    pub fn memory(&self) -> Option<u64> {
        self.heights.first().map(|(_, session)| session.chunk_memory())
    }

    /// Whether the picture that was drawn last has no memory for all of its heights.
    pub fn lacks_memory(&self) -> bool {
        self.heights.first().is_some_and(|(_, session)| session.lacks_memory())
    }

    /// What is to be told of pages of heights since the last call, as [`SurfaceSession::take_messages`] has it.
    pub fn take_messages(&self) -> Vec<String> {
        self.heights.iter().flat_map(|(_, session)| session.take_messages()).collect()
    }

    /// When another picture may have what the last one does without, of heights.
    pub fn again(&self) -> Option<Instant> {
        self.heights.iter().filter_map(|(_, session)| session.again()).min()
    }

    /// Pages of heights that the disk does not give are waited for so long from now on.
    pub fn wait_for(&mut self, stall: Duration) {
        self.heights.iter_mut().for_each(|(_, session)| session.wait_for(stall));
    }

    /// Whether the first dataset is of heights: then the world is theirs, with z up.
    pub fn begins_with_heights(&self) -> bool {
        self.first_kind() == MemberKind::Heights
    }

    fn first_kind(&self) -> MemberKind {
        self.kinds.first().copied().unwrap_or(MemberKind::Particles)
    }

    /// The kinds of its data, of particles that are known by `metadata`.
    fn kinds(&self, metadata: Option<&Metadata>) -> Kinds {
        let dimensions = self.fields.iter().map(|(_, session)| session.opened().grid().dimensions);
        Kinds { all: self.kinds.clone(), dimensions: dimensions.collect(), of_particles: usual_of(metadata) }
    }

    /// What a look says of each kind.
    fn looks(&self, look: &LookPatch) -> Result<Looks, PictureError> {
        let kinds = self.kinds(self.particles.as_ref().map(|session| session.tree().metadata()));
        let own: Vec<&Member> = self.fields.iter().map(|(member, _)| member).collect();
        kinds.looks(look, &own)
    }

    /// What it comes to on all that is not particles, in the order of each kind.
    fn prepare(&mut self, looks: &Looks) -> Result<Ready, PictureError> {
        let heights = self.heights.iter().map(|(_, session)| session.prepare(&looks.heights));
        let heights = heights.collect::<Result<Vec<Prepared>, _>>()?;
        heights.iter().try_for_each(Prepared::among_others).map_err(|why| self.refuse(why))?;
        let fields = self.fields.iter_mut().zip(&looks.fields);
        let fields =
            fields.map(|((_, session), look)| session.prepare(&Shot { look: look.clone(), ..Shot::default() }));
        Ok(Ready { heights, fields: fields.collect::<Result<_, _>>()? })
    }

    /// The transfer function of a shot: its own, or the usual one of what it is about.
    ///
    /// # Errors
    /// When its look does not fit the data.
    pub fn transfer(&mut self, shot: &Shot) -> Result<TransferFunction, PictureError> {
        let looks = self.looks(&shot.look)?;
        match (looks.about, self.heights.first(), self.fields.first_mut(), &mut self.particles) {
            (MemberKind::Heights, Some((_, session)), _, _) => Ok(session.prepare(&looks.heights)?.look.transfer),
            (MemberKind::Field, _, Some((_, session)), _) => {
                let look = looks.fields.first().cloned().unwrap_or_default();
                Ok(session.prepare(&Shot { look, ..Shot::default() })?.transfer)
            }
            (_, _, _, Some(session)) => Ok(session.show(&looks.particles)?.2),
            _ => Ok(shot.look.transfer.clone().unwrap_or_default()),
        }
    }

    /// The unit of the lengths of the first dataset that is no particles.
    fn own_unit(&self, look: &LookPatch) -> Result<Unit, PictureError> {
        match (self.first_kind(), self.heights.first(), self.fields.first()) {
            (MemberKind::Field, _, Some((_, session))) => Ok(session.opened().grid().length_unit.clone()),
            (_, Some((_, session)), _) => {
                let look = LookPatch {
                    mode: Some(&surface::MODE),
                    settings: look.settings.of_mode(&surface::MODE),
                    ..look.clone()
                };
                // What colours them is no question of lengths.
                let look = LookPatch { attribute: None, transfer: None, ..look };
                Ok(session.opened().length_unit(session.prepare(&look)?.placed.map))
            }
            _ => Ok(Unit::default()),
        }
    }

    /// The box that a look's pictures are framed by: that of the first dataset, of data of one kind that is no particles that of all.
    ///
    /// # Errors
    /// Settings that do not fit the data.
    pub fn framed(&mut self, look: &LookPatch) -> Result<Bounds, PictureError> {
        let looks = self.looks(look)?;
        if let (MemberKind::Particles, Some(session)) = (self.first_kind(), &mut self.particles) {
            return session.framed(&looks.particles);
        }
        let ready = self.prepare(&looks)?;
        Ok(self.bounds(&ready))
    }

    /// The box of the first dataset that is no particles, or of all where they are of one kind.
    fn bounds(&self, ready: &Ready) -> Bounds {
        let first = self.first_kind();
        let is_one = self.kinds.iter().all(|kind| *kind == first);
        let [heights, fields] = self.boxes(ready);
        let all = if first == MemberKind::Field { fields } else { heights };
        let count = if is_one { all.len() } else { 1 };
        all.into_iter().take(count).reduce(Bounds::union).unwrap_or(Bounds::EMPTY)
    }

    /// The box of each field of heights, and of each image and volume.
    fn boxes(&self, ready: &Ready) -> [Vec<Bounds>; 2] {
        let Placements { heights, fields } = self.placements(ready);
        let of_heights = self.heights.iter().zip(&ready.heights).zip(heights);
        let of_heights =
            of_heights.map(|(((_, session), prepared), placement)| placement.bounds(session.bounds(&prepared.placed)));
        let of_fields = self.fields.iter().zip(fields);
        let of_fields = of_fields.map(|((_, session), placement)| placement.bounds(session.opened().grid().bounds()));
        [of_heights.collect(), of_fields.collect()]
    }

    /// The diameter of all that looks show, of particles without far outliers: what hides light is no further away.
    fn scene(&mut self, ready: &Ready, looks: &Looks) -> Result<f64, PictureError> {
        let rest = self.boxes(ready).into_iter().flatten().fold(Bounds::EMPTY, Bounds::union);
        let particles = self.particles.as_mut().map(|session| session.framed(&looks.particles)).transpose()?;
        Ok(rest.union(particles.unwrap_or(Bounds::EMPTY)).size().length())
    }

    /// The unit of the scene's lengths: that of its first dataset.
    fn unit(&self, ready: &Ready) -> Unit {
        match (self.first_kind(), &self.particles, self.heights.first().zip(ready.heights.first())) {
            (MemberKind::Particles, Some(session), _) => session.tree().metadata().length_unit.clone(),
            (MemberKind::Heights, _, Some(((_, session), prepared))) => {
                session.opened().length_unit(prepared.placed.map)
            }
            _ => {
                self.fields.first().map(|(_, session)| session.opened().grid().length_unit.clone()).unwrap_or_default()
            }
        }
    }

    /// Where each lies.
    fn placements(&self, ready: &Ready) -> Placements {
        let scene = self.unit(ready);
        let heights = self.heights.iter().zip(&ready.heights).map(|((member, session), prepared)| {
            placement_of(member, &session.opened().length_unit(prepared.placed.map), &scene)
        });
        let fields = self
            .fields
            .iter()
            .map(|(member, session)| placement_of(member, &session.opened().grid().length_unit, &scene));
        Placements { heights: heights.collect(), fields: fields.collect() }
    }

    /// What particles are drawn among, and what draws these, where there are some.
    fn among<'s>(
        &'s mut self,
        ready: &Ready,
        placements: Placements,
        looks: &Looks,
        scene: f64,
    ) -> (Among<'s>, Option<&'s mut Session>) {
        let MixedSession { heights, particles, backend, painter, reporter, .. } = self;
        let finder = Finder { painter: Mutex::new(painter), backend: *backend, reporter: &**reporter };
        let heights = HeightsAmong::new(heights, &ready.heights, placements.heights, &looks.heights, finder);
        let fields = ready.fields.iter().zip(placements.fields);
        let fields = fields.map(|(prepared, placement)| Lying { prepared: prepared.clone(), placement });
        let among = Among { heights, fields: FieldsAmong::new(fields.collect()), scene, depths: Mutex::default() };
        (among, particles.as_mut())
    }

    /// Draws a shot.
    ///
    /// # Errors
    /// [`PictureError`] when the data cannot be read, a setting does not fit it, or nothing draws a mode among other data.
    pub fn draw(&mut self, shot: &Shot) -> Result<Picture, PictureError> {
        let looks = self.looks(&shot.look)?;
        let ready = self.prepare(&looks)?;
        let (unit, bounds, placements) = (self.unit(&ready), self.bounds(&ready), self.placements(&ready));
        self.check(shot, &ready)?;
        let (mut shot, mut lifted) = (shot.clone(), None);
        match (self.first_kind(), ready.heights.first()) {
            (MemberKind::Heights, Some(first)) => {
                shot = standing(&shot, bounds, &first.placed)?;
                for (((_, session), prepared), placement) in
                    self.heights.iter().zip(&ready.heights).zip(&placements.heights)
                {
                    lifted = session.keep_above(&mut shot, prepared, placement)?.or(lifted);
                }
            }
            (MemberKind::Field, _) => shot = framed_by(&shot, bounds)?,
            _ => {}
        }
        let each = self.heights.iter().zip(&ready.heights).zip(&placements.heights);
        let floors: Vec<(&dyn Heights, Floor)> = each
            .map(|(((_, session), prepared), placement)| {
                (session.file() as &dyn Heights, session.floor(prepared, *placement))
            })
            .collect();
        let names = take(&mut self.names, &mut shot, &floors, &*self.reporter)?;
        let (shot, is_raw) = (&shot, self.is_raw);
        let scene = self.scene(&ready, &looks)?;
        let (ground, particles) = self.among(&ready, placements, &looks, scene);
        let mut times = Times::default();
        let (drawn, view) = match particles {
            Some(session) => {
                let look = looks.particles.clone();
                let picture = session.draw_among(&Shot { look, ..shot.clone() }, Some(&ground))?;
                let view = picture.annotation.view;
                (Drawn::Particles(Box::new(picture)), view)
            }
            None => {
                let view = shot.view(bounds, None)?;
                let colors = times.frame(|times| times.measure("draw", || alone(&ground, shot, &view)))?;
                (Drawn::Rest(colors), view)
            }
        };
        let channels = match is_raw && !ground.heights.is_empty() {
            true => Some(ground.heights.channels(&sight_of(&view, shot)?)),
            false => None,
        };
        let (report, error, of_fields) = (ground.heights.report(), ground.error(), ground.fields.error());
        let shown = (!ground.heights.is_empty()).then_some(SurfaceShown { report, channels, labels: None, lifted });
        drop(ground);
        self.take_messages().into_iter().chain(of_fields).for_each(|message| self.reporter.tell(message));
        let (is_whole, is_coarser) = (report.is_converged && error.is_none(), report.is_coarser && error.is_none());
        // What is told of one field holds for all of them.
        self.heights.first_mut().into_iter().for_each(|(_, session)| session.note_shortage(is_coarser));
        let names = names.map(|names| names.seen(&view));
        let points = ready.fields.first().map(|first| first.report);
        let (first_heights, first_field) = (self.heights.first(), self.fields.first());
        let mut prepared = (ready.heights.into_iter().next(), ready.fields.into_iter().next());
        let picture = match drawn {
            Drawn::Rest(colors) => {
                let at = (view, bounds);
                let picture = match (looks.about, first_heights.zip(prepared.0.take()), first_field.zip(prepared.1)) {
                    (MemberKind::Field, _, Some(((_, session), prepared))) => {
                        let look = looks.fields.first().cloned().unwrap_or_default();
                        let light = LightPicture { levels: prepared.levels, ..LightPicture::of(colors) };
                        let shot = Shot { look, ..shot.clone() };
                        session.pictured(&shot, at, &prepared, Raw::Light(light), times.medians())?
                    }
                    (_, Some(((_, session), prepared)), _) => {
                        let shown = shown.clone().unwrap_or_default();
                        let shot = Shot { look: looks.heights, ..shot.clone() };
                        session.pictured(&shot, at, prepared, colors, shown, times.medians())?
                    }
                    _ => return Err(PictureError::Stopped),
                };
                let annotation = picture.annotation.naming(names);
                let error_px = picture.error_px.max(report.error_px);
                let (converged, surface) = (is_whole, shown);
                return Ok(Picture { converged, is_coarser, error_px, annotation, points, surface, ..picture });
            }
            Drawn::Particles(picture) => *picture,
        };
        let (depiction, units, told) = match (looks.about, first_heights.zip(prepared.0), first_field.zip(prepared.1)) {
            (MemberKind::Heights, Some(((_, session), about)), _) => {
                let (depiction, units) = session.told(&about, &looks.heights);
                let levels = Levels { p: about.look.range, s: [0.0, 1.0] };
                (depiction, units, Some(Coloration { transfer: about.look.transfer, levels }))
            }
            (MemberKind::Field, _, Some(((_, session), about))) => {
                let look = looks.fields.first().cloned().unwrap_or_default();
                let (depiction, units) = session.told(&about, &look)?;
                let levels = Levels { p: about.levels.density, s: about.levels.attribute };
                (depiction, units, Some(Coloration { transfer: about.transfer.clone(), levels }))
            }
            _ => (picture.annotation.depiction.clone(), picture.annotation.units().clone(), None),
        };
        let converged = picture.converged && is_whole;
        Ok(Picture {
            converged,
            is_coarser: !converged && (picture.converged || picture.is_coarser) && (is_whole || is_coarser),
            error_px: picture.error_px.max(report.error_px),
            annotation: picture.annotation.telling(depiction, Units { length: unit, ..units }).naming(names),
            told,
            points: points.or(picture.points),
            surface: shown,
            ..picture
        })
    }

    /// Refuses what there is none of.
    fn check(&self, shot: &Shot, ready: &Ready) -> Result<(), PictureError> {
        let is_flat = ready.heights.iter().all(|prepared| prepared.placed.is_flat());
        if self.is_raw && !self.heights.is_empty() && (shot.stereo.is_some() || !is_flat && !shot.surround.is_flat()) {
            let why =
                "--raw: expected one picture with rays of its own: no pair for two eyes, and no globe around the eye";
            return Err(self.refuse(why));
        }
        if self.particles.is_none() && shot.look.time.is_some() {
            return Err(self.refuse("--time: heights, images and volumes have no times"));
        }
        if self.particles.is_none()
            && !self.fields.is_empty()
            && matches!(self.backend, Some(Backend::Compute | Backend::Raster))
        {
            return Err(self.refuse("--backend: expected cpu, which alone draws images and volumes among other data"));
        }
        Ok(())
    }

    fn refuse(&self, why: &str) -> PictureError {
        let heights = self.heights.first().map(|(member, _)| member);
        let first = heights.or(self.fields.first().map(|(member, _)| member));
        PictureError::of(first.map_or(Path::new(""), |member| &member.path), why)
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
        match (looks.about, &mut self.particles, self.heights.first_mut(), self.fields.first_mut()) {
            (MemberKind::Particles, Some(session), ..) => session.ranges(&looks.particles, camera, format),
            (MemberKind::Heights, _, Some((_, first)), _) => first.ranges(&looks.heights, camera, format),
            (MemberKind::Field, .., Some((_, first))) => {
                first.ranges(looks.fields.first().unwrap_or(look), camera, format)
            }
            _ => Err(PictureError::Stopped),
        }
    }
}

/// The mode of particles that nobody has chosen one for.
fn usual_of(metadata: Option<&Metadata>) -> &'static crate::mode::Mode {
    let attributes = metadata.iter().flat_map(|metadata| &metadata.families).flat_map(|family| &family.attributes);
    modes::usual(attributes.map(|attribute| attribute.name.as_str()))
}

/// A shot with the camera that it has where nothing is there but what is in a box.
fn framed_by(shot: &Shot, bounds: Bounds) -> Result<Shot, PictureError> {
    let view = shot.view(bounds, None)?;
    let target = match shot.surround.is_flat() {
        true => shot.camera.target.map_or(bounds.center(), DVec3::from),
        false => view.eye + view.forward * bounds.size().length().max(1e-30),
    };
    let (eye, target) = (Some(view.eye.to_array()), Some(target.to_array()));
    Ok(Shot { camera: CameraConfig { eye, target, ..shot.camera }, ..shot.clone() })
}

/// The line of sight of each pixel of a picture.
fn sight_of(view: &View, shot: &Shot) -> Result<Sight, PictureError> {
    Ok(match Panorama::around(view, shot.surround)? {
        None => Sight::Flat(*view),
        Some(panorama) => Sight::Around { panorama, eye: view.eye, cut: view.cut },
    })
}
