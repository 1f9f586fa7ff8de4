//! `xray`: the line integral of a volume's values (WM03 section 5.2).

use super::{grid, samples};
use crate::cpu::volume::VolumeError;
use crate::cpu::{Counts, field};
use crate::mode::{FieldJob, Job, Mode, Output, Raw, Technique};

struct Xray;

impl Technique for Xray {
    fn output(&self) -> Output {
        Output::Values
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
        if !job.values.is_volume {
            let expected = "image: an image has no depth".to_owned();
            return Err(VolumeError::Setting { field: "mode", found: MODE.name.into(), expected });
        }
        Ok(Raw::Sums(field::xray::draw(job.view, job.field, 0), Counts::default()))
    }
}

/// The value's integral over world lengths.
pub static MODE: Mode = Mode {
    name: "xray",
    help: "of volumes: the integral of the value along each ray, as in an X-ray picture",
    settings: &[samples::SAMPLES],
    technique: &Xray,
    quantity: "line integral",
    transfer: ["density", "density-hue"],
    ..grid::MODE
};
