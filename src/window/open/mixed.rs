//! Opening heights with particles or with other heights: as one scene, which the processor draws.

use super::heights::check_map;
use super::sketch::sketched;
use super::{Opened, Seen};
use crate::look::{HeightsSaid, Member};
use crate::mode::{SettingValue, Settings};
use crate::model::progress::Progress;
use crate::model::{ReadMethod, When};
use crate::picture::PictureError;
use crate::picture::surface::OpenMixed;
use crate::stream::first_frame;
use crate::window::options::Opener;
use crate::window::sampled::Sampled;
use crate::window::scene::SceneField;
use std::path::Path;
use std::sync::Arc;

/// Opens datasets of which one at least is of heights.
///
/// # Errors
/// When they cannot be read, or built, or do not fit together.
pub(super) fn open_mixed(
    members: Vec<Member>,
    seen: &Seen,
    (read, time): (ReadMethod, Option<When>),
    opener: &Opener,
    progress: &dyn Progress,
) -> Result<Opened, String> {
    let members = members.iter().map(Member::resolved).collect::<Result<Vec<_>, _>>();
    let members = members.map_err(|error| error.to_string())?;
    let look = seen.scene.as_ref().map(|opened| &opened.scene.look);
    let map = seen.map.clone().map(SettingValue::Name);
    let map = map.or_else(|| look.and_then(|look| look.settings.0.get("map").cloned()));
    let settings = Settings(map.map(|map| ("map".to_owned(), map)).into_iter().collect());
    let built = |path: &Path, said: &HeightsSaid| opener(path, said, progress).map_err(PictureError::Asked);
    let when = time.or(look.and_then(|look| look.time));
    let opened = OpenMixed::open(&members, (read, when), &settings, built);
    let (opened, notes) = opened.map_err(|error| error.to_string())?;
    for field in opened.fields() {
        check_map(&field.member.path, &field.opened.file().about().grid, seen)?;
    }
    let sampled = Sampled::Mixed(Arc::new(opened));
    let particles = sampled.mixed().and_then(|opened| opened.particles().cloned());
    // Where there are none, a few samples of the first field stand in.
    let (file, folder) = match particles {
        Some(file) => (file, None),
        None => {
            let (file, folder) = sketched(&sampled)?;
            (Arc::new(file), Some(Arc::new(folder)))
        }
    };
    let families: Vec<u32> = (0..file.metadata().families.len() as u32).collect();
    let frame = first_frame(&*file, &families, 0.0);
    Ok(Opened {
        path: members.first().map(|member| member.path.clone()).unwrap_or_default(),
        members,
        notes,
        run: None,
        tracks: None,
        field: Some(SceneField { sketch: folder, ..SceneField::new(sampled) }),
        file,
        frame,
        scene: seen.scene.clone().map(Arc::new),
        map: seen.map.clone(),
        keeps: false,
        has_more: false,
    })
}
