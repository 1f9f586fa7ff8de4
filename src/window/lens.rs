//! What the camera's picture is made with beside its place: projection, field of view, and what is left out of the data.

use super::camera::Viewpoint;
use super::picture::DataCamera;
use super::scene::Settings;
use crate::model::PeriodicBox;
use crate::view::{Projection, View, ViewError};
use crate::window::state::aim::Aim;
use bevy::prelude::*;

/// What the camera sees in a picture of that many pixels, with the settings' projection, what they leave out, and how they draw a
/// periodic box; where `aim` says, turned to what an output displays of the show.
///
/// # Errors
/// [`ViewError`] for a camera that cannot see anything.
pub fn view_of(
    viewpoint: &Viewpoint,
    settings: &Settings,
    periodic: Option<PeriodicBox>,
    size: UVec2,
    aim: Option<&Aim>,
) -> Result<View, ViewError> {
    let view = viewpoint.view(size.x, size.y)?;
    let view = aim.map_or(Ok(view), |aim| aim.view(&view, size))?;
    let view = settings.cut.applied(&view, viewpoint.target, periodic);
    if !settings.lens.parallel || aim.is_some() {
        return Ok(view);
    }
    let projection = Projection::Orthographic { height: settings.lens.height_at(viewpoint.distance()) };
    Ok(View { projection, ..view })
}

/// Gives the camera the field of view that the settings say.
pub(super) fn follow_lens(settings: Res<Settings>, mut cameras: Query<&mut Viewpoint, With<DataCamera>>) {
    let fov_y = settings.lens.fov_deg.to_radians();
    for mut viewpoint in &mut cameras {
        if viewpoint.fov_y != fov_y {
            viewpoint.fov_y = fov_y;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::window::camera::Lens;
    use crate::window::preset::Preset;
    use bevy::math::DVec3;

    #[test]
    fn the_target_keeps_its_size_when_the_projection_changes() {
        let viewpoint = Viewpoint { eye: DVec3::new(0.0, 3.0, 40.0), target: DVec3::ZERO, up: DVec3::Y, fov_y: 0.6 };
        let mut settings = Settings::new(&Preset::default(), None);
        settings.lens.fov_deg = 0.6f64.to_degrees();
        let at = |settings: &Settings| {
            let view = view_of(&viewpoint, settings, None, UVec2::new(300, 200), None).unwrap();
            view.to_pixels(view.to_camera(DVec3::X)).unwrap()
        };
        let before = at(&settings);
        settings.lens.parallel = true;
        let after = at(&settings);
        assert!((0..2).all(|axis| (before[axis] - after[axis]).abs() < 1e-9), "{before:?} {after:?}");
        let height = settings.lens.height_at(viewpoint.distance());
        assert!((Lens::fov_of(height, viewpoint.distance()) - settings.lens.fov_deg).abs() < 1e-12);
    }
}
