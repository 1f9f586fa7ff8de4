//! Several kinds of data, open: what several sessions draw pictures from.

use super::looks::Kinds;
use super::units::{in_lengths_of, placement_of};
use super::{MixedSession, usual_of};
use crate::heights::OpenHeights;
use crate::heights::import::HeightOptions;
use crate::heights::store::HeightFile;
use crate::look::{CameraConfig, DataKind, HeightsSaid, Member, MemberKind, OpenData, Shot, said_of_particles};
use crate::mode::{Mode, Settings};
use crate::model::{Bounds, Moment, ReadMethod, Unit, When};
use crate::modes::{self, surface};
use crate::picture::field::{FieldSession, OpenField};
use crate::picture::placement::FieldPlacement;
use crate::picture::session::Reporter;
use crate::picture::surface::painting::Painter;
use crate::picture::surface::standing::view_of;
use crate::picture::surface::{FieldInScene, OpenSurface, SurfaceSession};
use crate::picture::{PictureError, Session, SessionOptions};
use crate::store::PageFile;
use crate::view::View;
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Datasets of which one at least is no particles, as they are open.
pub struct OpenMixed {
    heights: Vec<HeightsField>,
    fields: Vec<FieldAmong>,
    /// The particles as one, and their datasets.
    particles: Option<(Arc<PageFile>, Vec<Member>)>,
    /// Bytes that the pages of a session's particles may take.
    page_memory: u64,
    /// Of each dataset, in their order.
    kinds: Vec<MemberKind>,
    /// The first dataset that is no particles.
    first: Samples,
}

/// A field of heights among others.
pub struct HeightsField {
    /// Which of the datasets it is.
    pub index: usize,
    /// The dataset.
    pub member: Member,
    /// Its samples.
    pub opened: Arc<OpenSurface>,
}

/// An image or a volume among others.
pub struct FieldAmong {
    /// Which of the datasets it is.
    pub index: usize,
    /// The dataset.
    pub member: Member,
    /// Its samples, or what stands for them.
    pub opened: Arc<OpenField>,
}

/// What is no particles.
#[derive(Clone)]
pub enum Samples {
    /// Heights.
    Heights(Arc<OpenSurface>),
    /// An image or a volume.
    Field(Arc<OpenField>),
}

impl OpenMixed {
    /// Opens datasets; `page_file` turns what a user names, and says of heights in it, into a page file. Of the bytes of `memory` images and volumes
    /// take at most the first number each, pages of particles the second. Particles of other units are as large as in a world of heights that these
    /// settings place, or of an image or a volume. Of runs one moment is opened; what the user should know comes with it, a sentence each.
    ///
    /// # Errors
    /// What cannot be read or built, or does not fit together.
    pub fn open(
        members: &[Member],
        (read, when): (ReadMethod, Option<When>),
        memory: [u64; 2],
        settings: &Settings,
        mut page_file: impl FnMut(&Path, &HeightsSaid) -> Result<PathBuf, PictureError>,
    ) -> Result<(OpenMixed, Vec<String>), PictureError> {
        let [sample_memory, page_memory] = memory;
        let kinds: Vec<MemberKind> = members.iter().map(Member::kind).collect();
        let (mut heights, mut fields, mut others, mut notes) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for (index, (member, kind)) in members.iter().zip(&kinds).enumerate() {
            let member = member.clone();
            match kind {
                MemberKind::Heights => {
                    let mut file = |path: &Path, said: &HeightsSaid| built_file(path, said, read, &mut page_file);
                    let mut opened = OpenSurface::new(&member.path, file(&member.path, &member.said)?)?;
                    if let Some(before) = &member.said.before {
                        opened = opened.since(before, file(before, &member.said.of_before())?, None)?;
                    }
                    heights.push(HeightsField { index, member, opened: Arc::new(opened) });
                }
                MemberKind::Field => {
                    let opened = OpenField::open(&member.path, read, Some(sample_memory))?;
                    notes.extend(opened.notes().iter().map(|note| format!("{}: {note}", member.path.display())));
                    fields.push(FieldAmong { index, member, opened: Arc::new(opened) });
                }
                MemberKind::Particles => others.push(member),
            }
        }
        let of_heights = heights.first().map(|field| (field.index, Samples::Heights(Arc::clone(&field.opened))));
        let of_field = fields.first().map(|field| (field.index, Samples::Field(Arc::clone(&field.opened))));
        let first = of_heights.into_iter().chain(of_field).min_by_key(|(index, _)| *index);
        let Some((_, first)) = first else { return Err(PictureError::Asked("nothing but particles".into())) };
        let mut mixed = OpenMixed { heights, fields, particles: None, page_memory, kinds, first };
        if others.is_empty() {
            return Ok((mixed, notes));
        }
        if mixed.first_kind() != MemberKind::Particles {
            let unit = mixed.unit(settings)?;
            let own = others.clone();
            in_lengths_of(&unit, &mut others, read, &mut |path| page_file(path, &said_of_particles(&own, path)))?;
        }
        let data = OpenData::open(&others, read, |path| page_file(path, &said_of_particles(&others, path)))?;
        let moment = data.moment(when)?;
        let (file, unlike) = data.at(moment.unwrap_or_default())?;
        notes.extend(unlike);
        if let (Some(run), Some(Moment { step, .. })) = (data.run(), moment) {
            let path = run.path().display();
            notes.push(format!("{path}: among other data one step of a run is shown, here that of number {step}"));
        }
        mixed.particles = Some((Arc::new(file), others));
        Ok((mixed, notes))
    }

    /// The fields of heights, in the order of the datasets.
    pub fn heights(&self) -> &[HeightsField] {
        &self.heights
    }

    /// The images and volumes, in the order of the datasets.
    pub fn fields(&self) -> &[FieldAmong] {
        &self.fields
    }

    /// The first dataset that is no particles.
    pub fn first(&self) -> &Samples {
        &self.first
    }

    /// What pictures in a mode are about, if they are not about particles.
    pub fn told_by(&self, mode: &Mode) -> Option<Samples> {
        match self.kinds().about(Some(mode)) {
            MemberKind::Heights => self.heights.first().map(|first| Samples::Heights(Arc::clone(&first.opened))),
            MemberKind::Field => self.fields.first().map(|first| Samples::Field(Arc::clone(&first.opened))),
            MemberKind::Particles => None,
        }
    }

    /// The particles as one file, where there are some.
    pub fn particles(&self) -> Option<&Arc<PageFile>> {
        self.particles.as_ref().map(|(file, _)| file)
    }

    /// Whether the first dataset is of heights: then the world is theirs, with z up.
    pub fn begins_with_heights(&self) -> bool {
        self.first_kind() == MemberKind::Heights
    }

    fn first_kind(&self) -> MemberKind {
        self.kinds.first().copied().unwrap_or(MemberKind::Particles)
    }

    /// The heights that are asked what is under the mouse: the first, where the world is their own.
    pub fn asked(&self) -> Option<&Arc<OpenSurface>> {
        let first = self.heights.first().filter(|first| self.begins_with_heights() && first.member.is_in_place());
        first.map(|first| &first.opened)
    }

    /// Those of the datasets that are particles.
    pub fn of_particles<T: Clone>(&self, all: &[T]) -> Vec<T> {
        let each = all.iter().enumerate();
        each.filter(|(index, _)| self.is_of_particles(*index)).map(|(_, one)| one.clone()).collect()
    }

    /// Whether one of the datasets, by its number, is particles.
    pub fn is_of_particles(&self, index: usize) -> bool {
        self.kinds.get(index).is_none_or(|kind| *kind == MemberKind::Particles)
    }

    /// The kinds of its data.
    fn kinds(&self) -> Kinds {
        let dimensions = self.fields.iter().map(|field| field.opened.grid().dimensions);
        let of_particles = usual_of(self.particles().map(|file| file.metadata()));
        Kinds { all: self.kinds.clone(), dimensions: dimensions.collect(), of_particles }
    }

    /// Whether a mode draws some of it among the rest.
    pub fn is_drawn_by(&self, mode: &Mode) -> bool {
        self.kinds().are_drawn_by(mode)
    }

    /// The mode that it is shown in where none is chosen: that of the first dataset.
    pub fn usual_mode(&self) -> &'static Mode {
        let kinds = self.kinds();
        match kinds.first() {
            MemberKind::Heights => &surface::MODE,
            MemberKind::Field => modes::of_fields(kinds.dimensions.first().copied().unwrap_or(3)),
            MemberKind::Particles => kinds.of_particles,
        }
    }

    /// What draws pictures of them.
    pub fn session(&self, reporter: &Arc<dyn Reporter>) -> MixedSession {
        let heights = self.heights.iter().map(|field| {
            let (opened, options) = (Arc::clone(&field.opened), SessionOptions::default());
            (field.member.clone(), SurfaceSession::of(opened, options, Arc::clone(reporter)))
        });
        let fields = self
            .fields
            .iter()
            .map(|field| (field.member.clone(), FieldSession::of(Arc::clone(&field.opened), Arc::clone(reporter))));
        let particles = self.particles.as_ref().map(|(file, members)| {
            let mut session = Session::of(Arc::clone(file), self.page_memory).with_reporter(Arc::clone(reporter));
            session.show_members(members.clone());
            session
        });
        MixedSession {
            heights: heights.collect(),
            fields: fields.collect(),
            particles,
            kinds: self.kinds.clone(),
            is_raw: false,
            backend: None,
            painter: Painter::default(),
            names: None,
            reporter: Arc::clone(reporter),
        }
    }

    /// The box around what is no particles that a picture is framed by, as settings place it: around the first of it, or around all where all data is of
    /// that kind.
    ///
    /// # Errors
    /// A map that does not fit.
    pub fn bounds(&self, settings: &Settings) -> Result<Bounds, PictureError> {
        let unit = self.unit(settings)?;
        let first = if self.heights.is_empty() { MemberKind::Field } else { self.first_kind() };
        let all: Vec<Bounds> = match first {
            MemberKind::Field => {
                let each = self.fields.iter().map(|field| {
                    let grid = field.opened.grid();
                    placement_of(&field.member, &grid.length_unit, &unit).bounds(grid.bounds())
                });
                each.collect()
            }
            _ => {
                let each = self
                    .heights
                    .iter()
                    .map(|field| Ok(self.placement(field, settings, &unit)?.bounds(field.opened.bounds(settings)?)));
                each.collect::<Result<_, PictureError>>()?
            }
        };
        let count = if self.kinds.iter().all(|kind| *kind == first) { all.len() } else { 1 };
        Ok(all.into_iter().take(count).reduce(Bounds::union).unwrap_or(Bounds::EMPTY))
    }

    /// The unit of the scene's lengths: that of its first dataset.
    ///
    /// # Errors
    /// A map that does not fit.
    pub fn unit(&self, settings: &Settings) -> Result<Unit, PictureError> {
        Ok(match (self.first_kind(), &self.particles, self.heights.first(), self.fields.first()) {
            (MemberKind::Particles, Some((file, _)), ..) => file.metadata().length_unit.clone(),
            (MemberKind::Field, .., Some(first)) => first.opened.grid().length_unit.clone(),
            (_, _, Some(first), _) => first.opened.length_unit(first.opened.placed(settings)?.map),
            _ => Unit::default(),
        })
    }

    /// The fields of heights where settings place them in the scene.
    ///
    /// # Errors
    /// A map that does not fit.
    pub fn in_scene(&self, settings: &Settings) -> Result<Vec<FieldInScene>, PictureError> {
        let unit = self.unit(settings)?;
        let each = self.heights.iter().map(|field| {
            let placed = field.opened.placed(settings)?;
            let placement = self.placement(field, settings, &unit)?;
            Ok(FieldInScene { index: field.index, opened: Arc::clone(&field.opened), placed, placement })
        });
        each.collect()
    }

    fn placement(
        &self,
        field: &HeightsField,
        settings: &Settings,
        unit: &Unit,
    ) -> Result<FieldPlacement, PictureError> {
        Ok(placement_of(&field.member, &field.opened.length_unit(field.opened.placed(settings)?.map), unit))
    }

    /// The view of pictures whose camera nobody has placed, and what it looks at; `None` where particles come first.
    ///
    /// # Errors
    /// As [`OpenMixed::bounds`], and sizes and fields of view that are none.
    pub fn home(
        &self,
        settings: &Settings,
        fov_deg: f64,
        size: (u32, u32),
    ) -> Result<Option<(View, DVec3)>, PictureError> {
        let camera = CameraConfig { fov: Some(fov_deg), ..CameraConfig::default() };
        let shot = Shot { camera, size: Some(size), ..Shot::default() };
        match (self.first_kind(), self.heights.first()) {
            (MemberKind::Heights, Some(first)) => {
                let bounds = self.bounds(settings)?;
                view_of(&shot, bounds, &first.opened.placed(settings)?).map(Some)
            }
            (MemberKind::Field, _) => {
                let bounds = self.bounds(settings)?;
                Ok(Some((shot.view(bounds, None)?, bounds.center())))
            }
            _ => Ok(None),
        }
    }
}

/// The page file of heights that a user names and says something of, as pictures have it.
fn built_file(
    path: &Path,
    said: &HeightsSaid,
    read: ReadMethod,
    page_file: &mut dyn FnMut(&Path, &HeightsSaid) -> Result<PathBuf, PictureError>,
) -> Result<HeightFile, PictureError> {
    let file = match DataKind::of(path) {
        // What is said of a file that was built is refused there.
        Ok(DataKind::Heights) => OpenHeights::for_pictures(path, &said.options(read)),
        _ => {
            let built = page_file(path, said)?;
            OpenHeights::for_pictures(&built, &HeightOptions { read, ..HeightOptions::default() })
        }
    };
    match file.map_err(|error| PictureError::Asked(error.to_string()))? {
        (OpenHeights::Pages(file), _) => Ok(*file),
        (OpenHeights::Source(_), _) => Err(PictureError::of(path, "the file that was built of it holds no heights")),
    }
}
