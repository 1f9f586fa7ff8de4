//! What is drawn for a command, from what, and how: without how the command line said it.

use super::cache;
use super::progress_bar::{Terminal, TerminalProgress};
use crate::look::{DataKind, Member, Shot};
use crate::mode::Mode;
use crate::picture::field::FieldSession;
use crate::picture::surface::{MixedSession, SurfaceSession};
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
/// are a source's pixels or voxels then; heights with others as a scene of all of them; everything else as particles.
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
                && FieldSession::is_field(&only.path) =>
        {
            let session = FieldSession::open(&only.path, options, Arc::new(Terminal))?;
            #[cfg(feature = "viewer")]
            let session = session.with_adapter(Some(Box::new(crate::gpu::Offscreen::default())));
            AnySession::Field(Box::new(session))
        }
        [only] if matches!(DataKind::of(&only.path), Ok(DataKind::Heights)) => {
            let names: Vec<&str> = shots.iter().filter_map(|shot| Some(shot.look.mode?.name)).collect();
            let why = format!("mode {} does not draw heights, expected surface", names.join(", "));
            return Err(PictureError::Asked(format!("{}: {why}", only.path.display())));
        }
        _ => AnySession::Particles(Box::new(open(members, options, shots)?)),
    })
}

/// The page file of what a user names.
fn page_file(path: &Path) -> Result<PathBuf, PictureError> {
    Ok(cache::page_file_of(path, &TerminalProgress::new())?)
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
    let session = Session::open(members, options, shots, page_file, Arc::new(Terminal))?;
    #[cfg(feature = "viewer")]
    let session = session.with_adapter(Some(Box::new(crate::gpu::Offscreen::default())));
    Ok(session)
}
