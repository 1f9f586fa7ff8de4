//! What is drawn for a command, from what, and how: without how the command line said it.

use super::cache;
use super::progress_bar::{Terminal, TerminalProgress};
use crate::heights::import::HeightOptions;
use crate::look::{DataKind, Member, Shot};
use crate::mode::Mode;
use crate::picture::field::FieldSession;
use crate::picture::surface::SurfaceSession;
use crate::picture::{AnySession, PictureError, Session, SessionOptions};
use std::path::Path;
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

/// Opens datasets for pictures of these shots: heights, an image or a volume that is alone as what it is (`said` is what the user says where it
/// is taken for heights), unless a mode draws particles alone, which
/// are a source's pixels or voxels then; everything else as particles.
///
/// # Errors
/// As [`open`], [`FieldSession::open`] and [`SurfaceSession::open`].
pub fn open_any<'a>(
    members: &[Member],
    said: Option<&HeightOptions>,
    options: SessionOptions,
    shots: impl IntoIterator<Item = &'a Shot>,
) -> Result<AnySession, PictureError> {
    let shots: Vec<&Shot> = shots.into_iter().collect();
    let takes_surfaces = |shot: &&Shot| shot.look.mode.is_none_or(Mode::takes_surfaces);
    let takes_fields = |shot: &&Shot| shot.look.mode.is_none_or(Mode::takes_fields);
    if let [_, _, ..] = members
        && let Some(surface) = members.iter().find(|member| SurfaceSession::is_surface(&member.path))
        && !FieldSession::is_field(&surface.path)
    {
        return Err(PictureError::Asked(format!("{}: --with: heights are drawn alone yet", surface.path.display())));
    }
    Ok(match members {
        [only] if shots.iter().all(takes_surfaces) && said.is_some() => {
            let said = said.cloned().unwrap_or_default();
            let session = SurfaceSession::open(&only.path, &said, options, Arc::new(Terminal))?;
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
    let page_file = |path: &Path| Ok(cache::page_file_of(path, &TerminalProgress::new())?);
    let session = Session::open(members, options, shots, page_file, Arc::new(Terminal))?;
    #[cfg(feature = "viewer")]
    let session = session.with_adapter(Some(Box::new(crate::gpu::Offscreen::default())));
    Ok(session)
}
