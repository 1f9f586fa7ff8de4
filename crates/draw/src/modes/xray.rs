//! `xray`: the line integral of a volume's values (WM03 section 5.2).

use super::{grid, samples};
use crate::cpu::volume::VolumeError;
use crate::cpu::{Counts, field};
use crate::mode::{FieldJob, Mode, Output, Raw};

fn draw(job: &FieldJob<'_>) -> Result<Raw, VolumeError> {
    Ok(Raw::Sums(field::xray::draw(job.view, job.field, 0), Counts::default()))
}

/// The value's integral over world lengths.
pub static MODE: Mode = Mode {
    name: "xray",
    help: "of volumes: the integral of the value along each ray, as in an X-ray picture",
    settings: &[samples::SAMPLES],
    technique: &samples::OfFields {
        output: Output::Values,
        dimensions: &[3],
        is_integral: true,
        facing: None,
        draw,
        parts: None,
    },
    quantity: "line integral",
    transfer: ["density", "density-hue"],
    ..grid::MODE
};
