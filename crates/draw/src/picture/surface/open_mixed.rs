//! Heights among other things, open: what several sessions draw pictures from.

use super::in_scene::FieldInScene;
use super::mixed::{MixedSession, in_lengths_of, placement_of};
use super::opened::OpenSurface;
use super::session::SurfaceSession;
use super::standing::standing;
use crate::heights::OpenHeights;
use crate::heights::import::HeightOptions;
use crate::heights::store::HeightFile;
use crate::look::{CameraConfig, DataKind, HeightsSaid, Member, OpenData, Shot};
use crate::mode::{Mode, Settings};
use crate::model::{Bounds, Moment, ReadMethod, Unit, When};
use crate::modes::{self, surface};
use crate::picture::session::Reporter;
use crate::picture::{PictureError, Session, SessionOptions};
use crate::store::PageFile;
use crate::view::View;
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Memory for pages of particles unless it is set, bytes.
const PAGES: u64 = 1 << 30;

/// Datasets of which one at least is of heights, as they are open.
pub struct OpenMixed {
    fields: Vec<OpenField>,
    /// The particles as one, and their datasets.
    particles: Option<(Arc<PageFile>, Vec<Member>)>,
    /// Whether the first dataset is of heights.
    begins_with_heights: bool,
}

/// A field of heights among others.
pub struct OpenField {
    /// Which of the datasets it is.
    pub index: usize,
    /// The dataset.
    pub member: Member,
    /// Its samples.
    pub opened: Arc<OpenSurface>,
}

impl OpenMixed {
    /// Opens datasets; `page_file` turns what a user names, and says of heights in it, into a page file. Particles of other units are as large as in
    /// a world of heights that these settings place. Of runs one moment is opened; what the user should know comes with it, a sentence each.
    ///
    /// # Errors
    /// What cannot be read or built, or does not fit together.
    pub fn open(
        members: &[Member],
        (read, when): (ReadMethod, Option<When>),
        settings: &Settings,
        mut page_file: impl FnMut(&Path, &HeightsSaid) -> Result<PathBuf, PictureError>,
    ) -> Result<(OpenMixed, Vec<String>), PictureError> {
        let (mut fields, mut others, mut notes) = (Vec::new(), Vec::new(), Vec::new());
        for (index, member) in members.iter().enumerate() {
            if !member.is_of_heights() {
                others.push(member.clone());
                continue;
            }
            let mut file = |path: &Path, said: &HeightsSaid| built_file(path, said, read, &mut page_file);
            let mut opened = OpenSurface::new(&member.path, file(&member.path, &member.said)?)?;
            if let Some(before) = &member.said.before {
                opened = opened.since(before, file(before, &member.said.of_before())?, None)?;
            }
            let opened = Arc::new(opened);
            fields.push(OpenField { index, member: member.clone(), opened });
        }
        let Some(first) = fields.first() else { return Err(PictureError::Asked("no heights".into())) };
        let begins_with_heights = first.index == 0;
        let mut built = |path: &Path| page_file(path, &HeightsSaid::default());
        let particles = match others.is_empty() {
            true => None,
            false => {
                if begins_with_heights {
                    let unit = first.opened.length_unit(first.opened.placed(settings)?.map);
                    in_lengths_of(&unit, &mut others, read, &mut built)?;
                }
                let data = OpenData::open(&others, read, built)?;
                let moment = data.moment(when)?;
                let (file, unlike) = data.at(moment.unwrap_or_default())?;
                notes.extend(unlike);
                if let (Some(run), Some(Moment { step, .. })) = (data.run(), moment) {
                    let path = run.path().display();
                    notes.push(format!("{path}: among heights one step of a run is shown, here that of number {step}"));
                }
                Some((Arc::new(file), others))
            }
        };
        Ok((OpenMixed { fields, particles, begins_with_heights }, notes))
    }

    /// The fields, one at least, in the order of the datasets.
    pub fn fields(&self) -> &[OpenField] {
        &self.fields
    }

    /// The first field.
    pub fn first(&self) -> &Arc<OpenSurface> {
        &self.fields[0].opened
    }

    /// The particles as one file, where there are some.
    pub fn particles(&self) -> Option<&Arc<PageFile>> {
        self.particles.as_ref().map(|(file, _)| file)
    }

    /// Whether the first dataset is of heights: then the world is theirs, with z up.
    pub fn begins_with_heights(&self) -> bool {
        self.begins_with_heights
    }

    /// The field that is asked what is under the mouse: the first, where the world is its own.
    pub fn asked(&self) -> Option<&Arc<OpenSurface>> {
        let first = &self.fields[0];
        (self.begins_with_heights && first.member.is_in_place()).then_some(&first.opened)
    }

    /// Those of the datasets that are particles.
    pub fn of_particles<T: Clone>(&self, all: &[T]) -> Vec<T> {
        let is_field = |index: usize| self.fields.iter().any(|field| field.index == index);
        all.iter().enumerate().filter(|(index, _)| !is_field(*index)).map(|(_, one)| one.clone()).collect()
    }

    /// Whether a mode draws them.
    pub fn is_drawn_by(&self, mode: &Mode) -> bool {
        let meets = mode.takes_particles() && mode.technique.meets_surfaces();
        mode.takes_surfaces() || self.particles.is_some() && meets
    }

    /// Whether a mode's pictures are about heights: what a legend tells, and colours are of.
    pub fn is_about_heights(&self, mode: &Mode) -> bool {
        mode.takes_surfaces() || self.particles.is_none()
    }

    /// The mode that they are shown in where none is chosen: that of the first dataset.
    pub fn usual_mode(&self) -> &'static Mode {
        match &self.particles {
            Some((file, _)) if !self.begins_with_heights => {
                let families = file.metadata().families.iter();
                modes::usual(families.flat_map(|family| &family.attributes).map(|attribute| attribute.name.as_str()))
            }
            _ => &surface::MODE,
        }
    }

    /// What draws pictures of them.
    pub fn session(&self, reporter: &Arc<dyn Reporter>) -> MixedSession {
        let options = SessionOptions::default;
        let field = |field: &OpenField| {
            let session = SurfaceSession::of(Arc::clone(&field.opened), options(), Arc::clone(reporter));
            (field.member.clone(), session)
        };
        let particles = self.particles.as_ref().map(|(file, members)| {
            let mut session = Session::of(Arc::clone(file), PAGES).with_reporter(Arc::clone(reporter));
            session.show_members(members.clone());
            session
        });
        let fields = self.fields.iter().map(field).collect();
        MixedSession::of(fields, particles, self.begins_with_heights, Arc::clone(reporter))
    }

    /// The box around the heights that a picture is framed by, as settings place them: around the first field, or around all where there is
    /// nothing else.
    ///
    /// # Errors
    /// A map that does not fit.
    pub fn bounds(&self, settings: &Settings) -> Result<Bounds, PictureError> {
        let unit = self.unit(settings)?;
        let count = if self.particles.is_some() { 1 } else { self.fields.len() };
        self.fields[..count].iter().try_fold(Bounds::EMPTY, |all, field| {
            Ok(all.union(self.placement(field, settings, &unit)?.bounds(field.opened.bounds(settings)?)))
        })
    }

    /// The unit of the scene's lengths: that of its first dataset.
    ///
    /// # Errors
    /// A map that does not fit.
    pub fn unit(&self, settings: &Settings) -> Result<Unit, PictureError> {
        Ok(match &self.particles {
            Some((file, _)) if !self.begins_with_heights => file.metadata().length_unit.clone(),
            _ => self.first().length_unit(self.first().placed(settings)?.map),
        })
    }

    /// The fields where settings place them in the scene.
    ///
    /// # Errors
    /// A map that does not fit.
    pub fn in_scene(&self, settings: &Settings) -> Result<Vec<FieldInScene>, PictureError> {
        let unit = self.unit(settings)?;
        let each = self.fields.iter().map(|field| {
            let placed = field.opened.placed(settings)?;
            let placement = self.placement(field, settings, &unit)?;
            Ok(FieldInScene { index: field.index, opened: Arc::clone(&field.opened), placed, placement })
        });
        each.collect()
    }

    fn placement(
        &self,
        field: &OpenField,
        settings: &Settings,
        unit: &Unit,
    ) -> Result<super::placement::FieldPlacement, PictureError> {
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
        if !self.begins_with_heights {
            return Ok(None);
        }
        let camera = CameraConfig { fov: Some(fov_deg), ..CameraConfig::default() };
        let shot = Shot { camera, size: Some(size), ..Shot::default() };
        let bounds = self.bounds(settings)?;
        let view = standing(&shot, bounds, &self.first().placed(settings)?)?.view(bounds, None)?;
        Ok(Some((view, bounds.center())))
    }
}

/// The page file of heights that a user names and says something of.
fn built_file(
    path: &Path,
    said: &HeightsSaid,
    read: ReadMethod,
    page_file: &mut dyn FnMut(&Path, &HeightsSaid) -> Result<PathBuf, PictureError>,
) -> Result<HeightFile, PictureError> {
    let file = match DataKind::of(path) {
        // What is said of a file that was built is refused there.
        Ok(DataKind::Heights) => OpenHeights::open(path, &said.options(read)),
        _ => {
            let built = page_file(path, said)?;
            OpenHeights::open(&built, &HeightOptions { read, ..HeightOptions::default() })
        }
    };
    match file.map_err(|error| PictureError::Asked(error.to_string()))? {
        OpenHeights::Pages(file) => Ok(*file),
        OpenHeights::Source(_) => Err(PictureError::of(path, "the file that was built of it holds no heights")),
    }
}
