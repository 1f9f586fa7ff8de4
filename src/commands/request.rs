//! What is drawn for a command, from what, and how: without how the command line said it.

use super::cache;
use super::progress_bar::{Terminal, TerminalProgress};
use crate::look::{Member, Shot, said_of_particles};
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

/// Opens datasets for pictures of these shots, to be drawn by an adapter where the program has one; sources of particles by their page files in the
/// cache, which are built first where there are none.
///
/// # Errors
/// As [`AnySession::open`].
pub fn open_any<'a>(
    members: &[Member],
    options: SessionOptions,
    shots: impl IntoIterator<Item = &'a Shot>,
) -> Result<AnySession, PictureError> {
    let session = AnySession::open(members, options, shots, |path| page_file(members, path), Arc::new(Terminal))?;
    #[cfg(feature = "viewer")]
    let session = session.with_adapter(Some(Box::new(crate::gpu::Offscreen::default())));
    Ok(session)
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
