//! What opens datasets for pictures, whatever they are.

use super::adapter::Adapter;
use super::field::FieldSession;
use super::mixed::MixedSession;
use super::surface::SurfaceSession;
use super::{AnySession, PictureError, Reporter, Session, SessionOptions};
use crate::heights::import::height_format;
use crate::import::{GridOptions, grid_format, open_grid};
use crate::look::{DataKind, Member, Shot, TakenFor, is_field};
use crate::mode::Mode;
use std::path::{Path, PathBuf};
use std::sync::Arc;

impl AnySession {
    /// Opens datasets for pictures of these shots: heights, an image or a volume that is alone as what it is, unless a mode draws particles
    /// alone, which are a source's pixels or voxels then; several kinds of data as a scene of all of them; everything else as particles,
    /// sources of which `page_file` builds.
    ///
    /// # Errors
    /// As [`Session::open`], [`FieldSession::open`], [`SurfaceSession::open`] and [`MixedSession::open`].
    pub fn open<'a>(
        members: &[Member],
        options: SessionOptions,
        shots: impl IntoIterator<Item = &'a Shot>,
        page_file: impl FnMut(&Path) -> Result<PathBuf, PictureError>,
        reporter: Arc<dyn Reporter>,
    ) -> Result<AnySession, PictureError> {
        let shots: Vec<&Shot> = shots.into_iter().collect();
        let takes_surfaces = |shot: &&Shot| shot.look.mode.is_none_or(Mode::takes_surfaces);
        let takes_fields = |shot: &&Shot| shot.look.mode.is_none_or(Mode::takes_fields);
        Ok(match members {
            _ if MixedSession::is_for(members) => {
                AnySession::Mixed(Box::new(MixedSession::open(members, options, shots, page_file, reporter)?))
            }
            [only] if shots.iter().all(takes_surfaces) && only.is_of_heights() => {
                AnySession::Surface(Box::new(SurfaceSession::open(&only.path, &only.said, options, reporter)?))
            }
            [only]
                if (shots.iter().all(takes_fields) || matches!(DataKind::of(&only.path), Ok(DataKind::Grid)))
                    && only.said.taken_for != Some(TakenFor::Particles)
                    && is_field(&only.path) =>
            {
                AnySession::Field(Box::new(FieldSession::open(&only.path, options, reporter)?))
            }
            [only] if is_nothing_but_heights(only) => {
                let modes = shots.iter().filter_map(|shot| shot.look.mode).filter(|mode| !mode.takes_surfaces());
                let names: Vec<&str> = modes.map(|mode| mode.name).collect();
                let why = match &names[..] {
                    [] => "--kind: found a file of heights, expected one that could be something else".to_owned(),
                    names => format!("mode {} does not draw heights, expected surface", names.join(", ")),
                };
                return Err(PictureError::of(&only.path, why));
            }
            _ => {
                let of_heights = shots.iter().filter_map(|shot| shot.look.mode).find(|mode| mode.takes_surfaces());
                if let (Some(mode), Some(first)) = (of_heights, members.first()) {
                    refuse_grid(mode, &first.path)?;
                }
                AnySession::Particles(Box::new(Session::open(members, options, shots, page_file, reporter)?))
            }
        })
    }

    /// The same with an adapter, which draws what it is asked for or is faster at; of scenes of several kinds of data as [`MixedSession::use_adapter`]
    /// says.
    #[must_use]
    pub fn with_adapter(self, adapter: Option<Box<dyn Adapter>>) -> AnySession {
        match self {
            AnySession::Particles(session) => AnySession::Particles(Box::new(session.with_adapter(adapter))),
            AnySession::Field(session) => AnySession::Field(Box::new(session.with_adapter(adapter))),
            AnySession::Surface(session) => AnySession::Surface(Box::new(session.with_adapter(adapter))),
            AnySession::Mixed(mut session) => {
                session.use_adapter(adapter);
                AnySession::Mixed(session)
            }
        }
    }
}

/// Whether a dataset is of heights and has no pixels that could be particles: it was built, is said to be heights, or its format knows nothing else.
fn is_nothing_but_heights(member: &Member) -> bool {
    matches!(DataKind::of(&member.path), Ok(DataKind::Heights))
        || member.said.is_heights() == Some(true)
        || member.is_of_heights() && !is_field(&member.path)
}

/// Refuses the source of an image or a volume where a mode draws heights, before its pixels or voxels are made particles; says how its values are
/// taken for heights, where they can be.
fn refuse_grid(mode: &Mode, path: &Path) -> Result<(), PictureError> {
    // What cannot be read is told where it is opened.
    let is_grid = matches!(DataKind::of(path), Ok(DataKind::Source)) && matches!(grid_format(path), Ok(Some(_)));
    let Some(source) = is_grid.then(|| open_grid(path, &GridOptions::default())).and_then(Result::ok) else {
        return Ok(());
    };
    let (is_image, channels) = (source.grid().dimensions == 2, source.grid().channels.len());
    let found = if is_image { "an image" } else { "a volume" };
    let fits = is_image && channels == 1 && matches!(height_format(path), Ok(Some(_)));
    let hint = if fits { "; --kind heights takes its values for heights" } else { "" };
    Err(PictureError::of(path, format!("mode {} draws heights, found {found}{hint}", mode.name)))
}
