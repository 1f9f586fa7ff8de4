//! `image`: an image in its own plane.

use super::{grid, samples};
use crate::cpu::field::plane::{self, Plane};
use crate::cpu::volume::{VolumeError, VolumeReport};
use crate::mode::{FieldJob, Job, LightPicture, Mode, Output, Raw, Technique};
use glam::DVec3;

struct Image;

impl Technique for Image {
    fn output(&self) -> Output {
        Output::Light
    }

    fn takes_particles(&self) -> bool {
        false
    }

    fn takes_fields(&self) -> bool {
        true
    }

    fn draw(&self, _: &Job<'_>) -> Result<Raw, VolumeError> {
        Err(samples::no_particles(MODE.name))
    }

    fn draw_field(&self, job: &FieldJob<'_>) -> Result<Raw, VolumeError> {
        if job.values.is_volume {
            let expected = "slice: a volume has many images".to_owned();
            return Err(VolumeError::Setting { field: "mode", found: MODE.name.into(), expected });
        }
        let (levels, color) = samples::colors_of(job)?;
        let plane = Plane { normal: DVec3::Z, distance: 0.0 };
        let colors = plane::draw(job.view, job.field, &plane, color);
        Ok(Raw::Light(LightPicture { colors, report: VolumeReport::default(), levels, isovalues: Vec::new() }))
    }
}

/// The image's own colours, or those of its values.
pub static MODE: Mode = Mode {
    name: "image",
    help: "of images: the picture itself, in its own colours or those of a transfer function",
    settings: &[samples::SAMPLES],
    technique: &Image,
    quantity: "value",
    ..grid::MODE
};
