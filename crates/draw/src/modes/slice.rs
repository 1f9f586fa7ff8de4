//! `slice`: a plane through a volume.

use super::{grid, samples, slice_overlay};
use crate::cpu::field::plane::Plane;
use crate::cpu::paths::PathFragments;
use crate::cpu::volume::VolumeError;
use crate::mode::{FieldJob, Mode, Output, Raw, Setting, SettingKind, Settings};
use glam::{DAffine3, DVec3};

/// Across which axis of the grid it lies.
pub static AXIS: Setting = Setting {
    name: "axis",
    unit: "",
    kind: SettingKind::Choice { options: &["z", "y", "x"] },
    help: "the axis of the grid, of particles of the world, that the slice lies across",
};
/// Where it lies.
pub static AT: Setting = Setting {
    name: "at",
    unit: "",
    kind: SettingKind::Number { min: 0.0, max: 1.0, default: 0.5 },
    help: "where the slice lies: 0 at the data's beginning, 1 at its end",
};
/// Any direction.
pub static NORMAL: Setting = Setting {
    name: "normal",
    unit: "",
    kind: SettingKind::Numbers { min: -1e30, max: 1e30, most: 3 },
    help: "the slice's normal in the world, three numbers, in place of an axis",
};

/// The plane that settings mean, in indices of samples.
fn plane(job: &FieldJob<'_>) -> Result<Plane, VolumeError> {
    let shape = job.field.shape().map(|side| side as f64);
    let normal = match *job.settings.numbers(&NORMAL) {
        [] => axis(job.settings),
        // A plane's normal is a covector: n . (M i) = (M^T n) . i.
        [x, y, z] if (x, y, z) != (0.0, 0.0, 0.0) => job.field.to_world.matrix3.transpose() * DVec3::new(x, y, z),
        ref found => {
            let found = format!("{found:?}");
            return Err(VolumeError::Setting { field: "normal", found, expected: "three numbers, not all 0".into() });
        }
    };
    let ends = (0..8).map(|corner| {
        let end = |axis: usize| if corner >> axis & 1 == 0 { -0.5 } else { shape[axis] - 0.5 };
        normal.dot(DVec3::new(end(0), end(1), end(2)))
    });
    let [low, high] = ends.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], at| [low.min(at), high.max(at)]);
    Ok(Plane { normal, distance: low + job.settings.number(&AT) * (high - low) })
}

/// The axis of the grid that it lies across.
pub(super) fn axis(settings: &Settings) -> DVec3 {
    match settings.name(&AXIS).as_str() {
        "x" => DVec3::X,
        "y" => DVec3::Y,
        _ => DVec3::Z,
    }
}

/// Along the plane's normal, from the volume's end.
fn facing(settings: &Settings, to_world: &DAffine3) -> Option<DVec3> {
    let normal = match *settings.numbers(&NORMAL) {
        [x, y, z] => DVec3::new(x, y, z),
        // The normal of a plane of indices, a covector.
        _ => to_world.matrix3.inverse().transpose() * axis(settings),
    };
    normal.try_normalize()
}

fn draw(job: &FieldJob<'_>) -> Result<Raw, VolumeError> {
    samples::on_plane(job, &plane(job)?)
}

fn parts(job: &FieldJob<'_>) -> Result<PathFragments, VolumeError> {
    samples::parts_of_plane(job, &plane(job)?)
}

/// The value on a plane.
pub static MODE: Mode = Mode {
    name: "slice",
    help: "of volumes: what lies on a plane through them, with lines of equal value and vectors in the plane if wanted",
    settings: &[&[&AXIS, &AT, &NORMAL], slice_overlay::OVERLAY, samples::SAMPLES],
    technique: &samples::OfFields {
        output: Output::Light,
        dimensions: &[3],
        is_integral: false,
        facing: Some(facing),
        draw,
        parts: Some(parts),
    },
    quantity: "value",
    ..grid::MODE
};
