//! The mode `brightest`: along each line of sight the one particle that shines brightest, not the sum of all. What it is made
//! of stands here: the mode and its settings, and how the processor draws it; [`adapter`] is the same for a graphics adapter,
//! and [`xyz`] a format of files.

#[cfg(feature = "viewer")]
pub mod adapter;
pub mod xyz;

use deepfield::color::Accumulation;
use deepfield::cpu::Counts;
use deepfield::cpu::volume::VolumeError;
use deepfield::mode::{Adapter, Conserved, Job, Mode, Output, Raw, Setting, SettingKind, Settings, Technique};
use deepfield::model::Unit;
use deepfield::view::Projection;
use std::f64::consts::TAU;

/// deepfield with what this crate adds.
pub fn program() -> deepfield::Program {
    let program = deepfield::Program::default().mode(&MODE).format(&xyz::Xyz);
    #[cfg(feature = "viewer")]
    let program = program.plugin(adapter::plugin);
    program
}

/// Ripples of brightness for each doubling of depth.
pub static RIPPLES: Setting = Setting {
    name: "ripples",
    unit: "",
    kind: SettingKind::Number { min: 0.0, max: 16.0, default: 0.0 },
    help: "ripples of brightness for each doubling of the distance from the eye; 0: none",
};

/// How fast they run.
pub static SPEED: Setting = Setting {
    name: "speed",
    unit: "Hz",
    kind: SettingKind::Number { min: 0.0, max: 5.0, default: 0.5 },
    help: "how many ripples run past in a second, in a window; pictures in files show them at second 0",
};

/// `P` is the largest column density that any one particle has, and `S` that particle's attribute.
pub static MODE: Mode = Mode {
    name: "brightest",
    help: "the particle with the largest column density along each line of sight, coloured by its attribute",
    settings: &[&[&RIPPLES, &SPEED]],
    technique: &Brightest,
    quantity: "largest column density",
    unit: |mass, length| match mass.is_unknown() || length.is_unknown() {
        true => Unit::default(),
        false => Unit::new(format!("{mass} / ({length})^2")),
    },
    weight: |columns| columns.mass.to_vec(),
    conserves: Conserved::Mass,
    hue_tolerance: 1.0,
    usual_attributes: &["temperature", "speed"],
    weight_attributes: &[],
    transfer: ["density", "density-hue"],
};

/// How the mode is drawn.
struct Brightest;

impl Technique for Brightest {
    fn output(&self) -> Output {
        Output::Values
    }

    fn adapter(&self) -> Adapter {
        Adapter::Plugin
    }

    fn draw(&self, job: &Job<'_>) -> Result<Raw, VolumeError> {
        let view = job.view;
        let (focal, [middle_x, middle_y]) = (view.focal_pixels(), view.middle());
        let is_perspective = matches!(view.projection, Projection::Perspective { .. });
        let with_attribute = job.batches.iter().any(|batch| batch.attribute().is_some());
        let mut picture = Accumulation::new(view.width, view.height, with_attribute);
        let mut counts = Counts::default();
        for batch in job.batches {
            for index in 0..batch.len() {
                let Some(h) = batch.ball(index).map(f64::from) else { break };
                let place = view.to_camera(batch.positions().world(index));
                // What the eye is in, or what is behind it, is not drawn.
                if !(h > 0.0 && place.z > h) {
                    continue;
                }
                counts.drawn += 1;
                let weight = f64::from(batch.weight()[index]) * ripple(job.settings, place.z);
                let pixels = |at: f64, middle: f64, size: u32| {
                    // The sphere's box, seen at its nearest and at its farthest depth.
                    let [near, far] = if is_perspective { [place.z - h, place.z + h] } else { [1.0, 1.0] };
                    let ends = [(at - h) / near, (at - h) / far, (at + h) / near, (at + h) / far];
                    let low = ends.into_iter().fold(f64::INFINITY, f64::min) * focal + middle;
                    let high = ends.into_iter().fold(f64::NEG_INFINITY, f64::max) * focal + middle;
                    let inside = |x: f64| x.clamp(0.0, f64::from(size)) as u32;
                    inside(low.floor())..inside(high.ceil())
                };
                for y in pixels(-place.y, middle_y, view.height) {
                    for x in pixels(place.x, middle_x, view.width) {
                        let ray = [(f64::from(x) + 0.5 - middle_x) / focal, (middle_y - f64::from(y) - 0.5) / focal];
                        // Squared distance of the line of sight from the particle.
                        let square = match is_perspective {
                            true => {
                                let ray = glam::DVec3::new(ray[0], ray[1], 1.0);
                                place.cross(ray).length_squared() / ray.length_squared()
                            }
                            false => (place.x - ray[0]).powi(2) + (place.y - ray[1]).powi(2),
                        };
                        let q = square.sqrt() / h;
                        if q >= 1.0 {
                            continue;
                        }
                        let value = (weight / (h * h) * job.options.kernel.projected(q)) as f32;
                        let pixel = (y * view.width + x) as usize;
                        if value > picture.p[pixel] {
                            picture.p[pixel] = value;
                            if let Some(attribute) = batch.attribute() {
                                picture.ps[pixel] = value * attribute[index];
                            }
                        }
                    }
                }
            }
        }
        Ok(Raw::Sums(picture, counts))
    }
}

/// The factor on the brightness at a depth, at second 0.
fn ripple(settings: &Settings, depth: f64) -> f64 {
    match settings.number(&RIPPLES) {
        ripples if ripples > 0.0 => 1.0 + 0.5 * (TAU * ripples * depth.log2()).cos(),
        _ => 1.0,
    }
}
