//! `image`: an image in its own plane.

use super::{grid, samples, slice_overlay};
use crate::cpu::field::plane::Plane;
use crate::cpu::paths::PathFragments;
use crate::cpu::volume::VolumeError;
use crate::mode::{FieldJob, Mode, Output, Raw};
use glam::DVec3;

/// Where it lies, in indices of samples.
const PLANE: Plane = Plane { normal: DVec3::Z, distance: 0.0 };

fn draw(job: &FieldJob<'_>) -> Result<Raw, VolumeError> {
    samples::on_plane(job, &PLANE)
}

fn parts(job: &FieldJob<'_>) -> Result<PathFragments, VolumeError> {
    samples::parts_of_plane(job, &PLANE)
}

/// The image's own colours, or those of its values.
pub static MODE: Mode = Mode {
    name: "image",
    help: "of images: the picture itself, in its own colours or those of a transfer function",
    settings: &[slice_overlay::OVERLAY, samples::SAMPLES],
    technique: &samples::OfFields {
        output: Output::Light,
        dimensions: &[2],
        is_integral: false,
        facing: None,
        draw,
        parts: Some(parts),
    },
    quantity: "value",
    ..grid::MODE
};
