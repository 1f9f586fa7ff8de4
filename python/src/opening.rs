//! What draws pictures of datasets, by the processor alone.

use crate::cache;
use crate::work::State;
use deepfield_draw::look::{DataKind, Member, Shot, is_field};
use deepfield_draw::mode::Mode;
use deepfield_draw::picture::field::FieldSession;
use deepfield_draw::picture::mixed::MixedSession;
use deepfield_draw::picture::surface::SurfaceSession;
use deepfield_draw::picture::{AnySession, PictureError, Reporter, Session, SessionOptions};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Opens datasets for a shot of them, as `deepfield render` does.
///
/// # Errors
/// When they cannot be read, or do not fit together.
pub fn open_any(
    members: &[Member],
    options: SessionOptions,
    shot: &Shot,
    state: &Arc<State>,
) -> Result<AnySession, PictureError> {
    let reporter: Arc<dyn Reporter> = state.clone();
    let page_file = |path: &Path| -> Result<PathBuf, PictureError> { Ok(cache::page_file(path, &**state)?) };
    let takes = |takes: fn(&'static Mode) -> bool| shot.look.mode.is_none_or(takes);
    Ok(match members {
        _ if MixedSession::is_for(members) => {
            AnySession::Mixed(Box::new(MixedSession::open(members, options, [shot], page_file, reporter)?))
        }
        [only] if takes(|mode| mode.takes_surfaces()) && only.is_of_heights() => {
            AnySession::Surface(Box::new(SurfaceSession::open(&only.path, &only.said, options, reporter)?))
        }
        [only]
            if (takes(|mode| mode.takes_fields()) || matches!(DataKind::of(&only.path), Ok(DataKind::Grid)))
                && is_field(&only.path) =>
        {
            AnySession::Field(Box::new(FieldSession::open(&only.path, options, reporter)?))
        }
        [only] if matches!(DataKind::of(&only.path), Ok(DataKind::Heights)) => {
            let mode = shot.look.mode.map_or("", |mode| mode.name);
            let path = only.path.display();
            return Err(PictureError::Asked(format!("{path}: mode {mode} does not draw heights, expected surface")));
        }
        _ => AnySession::Particles(Box::new(Session::open(members, options, [shot], page_file, reporter)?)),
    })
}
