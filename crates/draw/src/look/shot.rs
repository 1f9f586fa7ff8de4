//! The picture that is wanted, whatever draws it: what files and the command line come to together.

use super::dataset::located;
use super::{CameraConfig, Film, LookPatch, SceneFile};
use crate::mode::Span;
use crate::model::{Bounds, PeriodicBox};
use crate::view::{Projection, Stereo, Surround, View, ViewError};
use glam::DVec3;
use std::path::{Path, PathBuf};

/// A picture that is wanted of some data. What it does not say is the program's own.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shot {
    /// What it looks like.
    pub look: LookPatch,
    /// Where the camera stands, world units; around the data where it says nothing.
    pub camera: CameraConfig,
    /// Width and height, pixels.
    pub size: Option<(u32, u32)>,
    /// How directions become a picture.
    pub surround: Surround,
    /// A picture for each eye.
    pub stereo: Option<Stereo>,
    /// A catalogue whose objects are named in the picture.
    pub labels: Option<PathBuf>,
    /// What a tour's picture has beyond others; its images' paths are complete.
    pub film: Option<Film>,
}

impl Shot {
    /// What a scene, read from `file`, says.
    pub fn of_scene(scene: SceneFile, file: &Path) -> Shot {
        let [eye, target, up] = [0, 1, 2].map(|i| scene.camera.map(|camera| [camera.eye, camera.target, camera.up][i]));
        let (fov, ortho) = (scene.camera.map(|camera| camera.fov), scene.camera.and_then(|camera| camera.ortho));
        Shot {
            look: scene.look,
            camera: CameraConfig { eye, target, up, fov, ortho },
            size: scene.size,
            surround: scene.projection,
            stereo: scene.stereo,
            labels: scene.labels.map(|labels| located(&labels, file)),
            film: scene.film,
        }
    }

    /// What both say, `next` last.
    pub fn then(self, next: Shot) -> Shot {
        Shot {
            look: self.look.then(&next.look),
            camera: self.camera.then(next.camera),
            size: next.size.or(self.size),
            surround: if next.surround.is_flat() { self.surround } else { next.surround },
            stereo: next.stereo.or(self.stereo),
            labels: next.labels.or(self.labels),
            film: next.film.or(self.film),
        }
    }

    /// Whether the picture is more than one flat view.
    pub fn is_projected(&self) -> bool {
        !self.surround.is_flat() || self.stereo.is_some()
    }

    /// Whether it shows nothing but where particles of a run came from.
    pub fn is_of_tails(&self) -> bool {
        let LookPatch { mode, settings, paths, .. } = &self.look;
        let leads = paths.as_ref().is_some_and(|paths| paths.lead != Span::Steps(0.0));
        !leads && mode.is_some_and(|mode| !mode.technique.needs(settings).particles)
    }

    /// Its size, pixels.
    pub fn size(&self) -> (u32, u32) {
        self.size.unwrap_or(match self.surround {
            Surround::Flat => (1200, 800),
            Surround::Dome { .. } => (2048, 2048),
            Surround::Equirectangular => (4096, 2048),
            Surround::Cube { .. } => (1024, 1024),
        })
    }

    /// Its camera; around `bounds` where it says nothing.
    ///
    /// # Errors
    /// [`ViewError`] for a camera that cannot see anything.
    pub fn view(&self, bounds: Bounds, periodic: Option<PeriodicBox>) -> Result<View, ViewError> {
        let (width, height) = self.size();
        let CameraConfig { eye, target, up, fov, ortho } = self.camera;
        let [own_eye, own_target, up] = [eye, target, up].map(|place| place.map(DVec3::from));
        let up = |along: DVec3| up.unwrap_or_else(|| usual_up(along));
        let cut = self.look.cut.unwrap_or_default();
        let fov_y = fov.unwrap_or(45.0).to_radians();
        let around = View::around(bounds, fov_y, width, height)?;
        let target = own_target.unwrap_or(bounds.center());
        if !self.surround.is_flat() {
            // From the middle of the data, unless told otherwise: what there is to see is all around.
            let eye = own_eye.unwrap_or(bounds.center());
            let ahead =
                if eye == bounds.center() { eye - DVec3::Z * bounds.size().length().max(1e-30) } else { target };
            let projection = Projection::Perspective { fov_y };
            let target = own_target.unwrap_or(ahead);
            let view = View::look_at(eye, target, up(target - eye), projection, width, height)?;
            return Ok(cut.applied(&view, eye, periodic));
        }
        let eye = own_eye.unwrap_or(around.eye + (target - bounds.center()));
        let projection = match ortho {
            Some(height) => Projection::Orthographic { height },
            None => Projection::Perspective { fov_y },
        };
        let view = View::look_at(eye, target, up(target - eye), projection, width, height)?;
        Ok(cut.applied(&view, target, periodic))
    }
}

/// What points up for who looks along a direction and has not said it: y, and z where that is the direction itself.
fn usual_up(along: DVec3) -> DVec3 {
    if along.cross(DVec3::Y).length() <= 1e-6 * along.length() { along.y.signum() * DVec3::Z } else { DVec3::Y }
}

impl CameraConfig {
    /// What both say, `next` last; a projection goes as a whole.
    pub fn then(self, next: CameraConfig) -> CameraConfig {
        let has_projection = next.fov.is_some() || next.ortho.is_some();
        let (fov, ortho) = if has_projection { (next.fov, next.ortho) } else { (self.fov, self.ortho) };
        let [eye, target, up] =
            [(next.eye, self.eye), (next.target, self.target), (next.up, self.up)].map(|(next, own)| next.or(own));
        CameraConfig { eye, target, up, fov, ortho }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_may_look_along_what_is_up_elsewhere() {
        let bounds = Bounds { min: DVec3::splat(-1.0), max: DVec3::splat(1.0) };
        for eye in [[0.0, 5.0, 0.0], [0.0, -5.0, 0.0], [0.0, 0.0, 5.0]] {
            for surround in [Surround::Flat, Surround::Equirectangular] {
                let camera = CameraConfig { eye: Some(eye), target: Some([0.0; 3]), ..CameraConfig::default() };
                let view = Shot { camera, surround, ..Shot::default() }.view(bounds, None).expect("a view");
                assert!(view.right.distance(DVec3::X) < 1e-12, "{eye:?}: {}", view.right);
            }
        }
        // Who says what is up is taken at their word.
        let camera = CameraConfig { eye: Some([0.0, 5.0, 0.0]), up: Some([0.0, 1.0, 0.0]), ..CameraConfig::default() };
        assert_eq!(Shot { camera, ..Shot::default() }.view(bounds, None).err(), Some(ViewError::NoUp));
    }
}
