//! What is drawn for a command, from what, and how: without how the command line said it.

use super::cache;
use super::progress_bar::{Terminal, TerminalProgress};
use crate::heights::import::height_format;
use crate::import::{GridOptions, grid_format, open_grid};
use crate::look::{DataKind, Member, Shot, TakenFor, is_field, said_of_particles};
use crate::mode::Mode;
use crate::picture::field::FieldSession;
use crate::picture::mixed::MixedSession;
use crate::picture::surface::SurfaceSession;
use crate::picture::{AnySession, PictureError, Session, SessionOptions};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A picture for a command.
#[derive(Default)]
pub struct Request {
    /// The datasets that are drawn: one or more.
    pub members: Vec<Member>,
    /// The picture.
    pub shot: Shot,
    /// How they are opened and drawn.
    pub options: SessionOptions,
}

/// Opens datasets for pictures of these shots: heights, an image or a volume that is alone as what it is, unless a mode draws particles alone, which
/// are a source's pixels or voxels then; several kinds of data as a scene of all of them; everything else as particles.
///
/// # Errors
/// As [`open`], [`FieldSession::open`], [`SurfaceSession::open`] and [`MixedSession::open`].
pub fn open_any<'a>(
    members: &[Member],
    options: SessionOptions,
    shots: impl IntoIterator<Item = &'a Shot>,
) -> Result<AnySession, PictureError> {
    let shots: Vec<&Shot> = shots.into_iter().collect();
    let takes_surfaces = |shot: &&Shot| shot.look.mode.is_none_or(Mode::takes_surfaces);
    let takes_fields = |shot: &&Shot| shot.look.mode.is_none_or(Mode::takes_fields);
    Ok(match members {
        _ if MixedSession::is_for(members) => {
            let page_file = |path: &Path| page_file(members, path);
            let session = MixedSession::open(members, options, shots, page_file, Arc::new(Terminal))?;
            AnySession::Mixed(Box::new(session))
        }
        [only] if shots.iter().all(takes_surfaces) && only.is_of_heights() => {
            let session = SurfaceSession::open(&only.path, &only.said, options, Arc::new(Terminal))?;
            #[cfg(feature = "viewer")]
            let session = session.with_adapter(Some(Box::new(crate::gpu::Offscreen::default())));
            AnySession::Surface(Box::new(session))
        }
        [only]
            if (shots.iter().all(takes_fields) || matches!(DataKind::of(&only.path), Ok(DataKind::Grid)))
                && only.said.taken_for != Some(TakenFor::Particles)
                && is_field(&only.path) =>
        {
            let session = FieldSession::open(&only.path, options, Arc::new(Terminal))?;
            #[cfg(feature = "viewer")]
            let session = session.with_adapter(Some(Box::new(crate::gpu::Offscreen::default())));
            AnySession::Field(Box::new(session))
        }
        [only] if matches!(DataKind::of(&only.path), Ok(DataKind::Heights)) => {
            let modes = shots.iter().filter_map(|shot| shot.look.mode).filter(|mode| !mode.takes_surfaces());
            let names: Vec<&str> = modes.map(|mode| mode.name).collect();
            let why = match &names[..] {
                [] => "--kind: found a file of heights, expected one that could be something else".to_owned(),
                names => format!("mode {} does not draw heights, expected surface", names.join(", ")),
            };
            return Err(PictureError::Asked(format!("{}: {why}", only.path.display())));
        }
        _ => {
            let of_heights = shots.iter().filter_map(|shot| shot.look.mode).find(|mode| mode.takes_surfaces());
            if let (Some(mode), Some(first)) = (of_heights, members.first()) {
                refuse_grid(mode, &first.path)?;
            }
            AnySession::Particles(Box::new(open(members, options, shots)?))
        }
    })
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
    Err(PictureError::Asked(format!("{}: mode {} draws heights, found {found}{hint}", path.display(), mode.name)))
}

/// The page file of what a user names, with what is derived for the datasets that it is of.
fn page_file(members: &[Member], path: &Path) -> Result<PathBuf, PictureError> {
    Ok(cache::page_file_with(path, &said_of_particles(members, path), &TerminalProgress::new())?)
}

/// Opens datasets for pictures of these shots; sources by their page files in the cache, which are built first where there are
/// none.
///
/// # Errors
/// As [`Session::open`].
pub fn open<'a>(
    members: &[Member],
    options: SessionOptions,
    shots: impl IntoIterator<Item = &'a Shot>,
) -> Result<Session, PictureError> {
    let page_file = |path: &Path| page_file(members, path);
    let session = Session::open(members, options, shots, page_file, Arc::new(Terminal))?;
    #[cfg(feature = "viewer")]
    let session = session.with_adapter(Some(Box::new(crate::gpu::Offscreen::default())));
    Ok(session)
}
