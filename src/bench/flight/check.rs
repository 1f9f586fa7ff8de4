//! Halts of a flight: whether a picture that streamed in is the one that was waited for, what the flight's sample costs in
//! colour, and how many splats lie over each pixel (F12 figure 4.10).

use super::super::splat::Failure;
use super::Options;
use super::engine::Engine;
use super::path::Flight;
use crate::color::composite::{Image, color_error, composite_at};
use crate::color::output;
use crate::color::transfer::TransferFunction;
use crate::mode::Raw;
use crate::picture::Subject;
use serde::Serialize;

/// A halt.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Check {
    /// Seconds of the flight.
    pub seconds: f64,
    /// Whether the picture converged.
    pub converged: bool,
    /// Largest difference of a pixel of the picture that streamed in and of the one that was waited for, relative to the
    /// brightest one.
    pub difference: f64,
    /// Mean colour error, of 255, of the flight's picture of that place, clusters or a sample, from that of everything in view.
    pub color_error: f64,
    /// Particles or clusters of that picture.
    pub drawn: u64,
    /// Splats over a pixel, mean and most: of what the flight draws, and of everything in view; none of light.
    pub overdraw: Option<[(f64, u32); 2]>,
}

/// The values of a picture's pixels.
pub(in crate::bench) fn values(picture: &Raw) -> &[f32] {
    match picture {
        Raw::Sums(sums, _) => &sums.p,
        Raw::Light(painted) => painted.colors.rgba.as_flattened(),
    }
}

/// A picture's colours, those of sums with the ranges that the picture of everything has.
fn image(picture: &Raw, everything: &Raw, transfer: &TransferFunction) -> Image {
    match (picture, everything) {
        (Raw::Sums(sums, _), Raw::Sums(all, _)) => composite_at(sums, transfer, &transfer.levels(all)),
        (Raw::Sums(sums, _), Raw::Light(_)) => composite_at(sums, transfer, &transfer.levels(sums)),
        (Raw::Light(painted), _) => painted.colors.image(),
    }
}

/// Seconds of flight before a halt.
const RUN_UP: f64 = 2.0;

/// Flies for some seconds, halts, and compares. Writes the flight's picture of that place and that of everything, and the
/// overdraw of both.
///
/// # Errors
/// When a backend fails or a picture cannot be written.
pub fn check(
    engine: &mut Engine,
    options: &Options,
    flight: &Flight,
    seconds: f64,
    backend: &str,
) -> Result<Check, Failure> {
    let mut streamer = engine.streamer();
    engine.fly(&mut streamer, flight, (seconds - RUN_UP).max(0.0), seconds)?;
    let view = flight.view(seconds, engine.size.0, engine.size.1)?;
    let streamed = engine.converge(&mut streamer, &view)?;
    let (in_motion, stands_in) = engine.in_motion(&mut streamer, &view)?;
    drop(streamer);
    let waited = engine.waited(&view)?;
    let brightest = values(&waited).iter().copied().fold(0.0_f32, f32::max);
    let pairs = values(&streamed.picture).iter().zip(values(&waited));
    let differences = pairs.map(|(a, b)| f64::from((a - b).abs()));
    let difference = differences.fold(0.0, f64::max) / f64::from(brightest.max(f32::MIN_POSITIVE));

    let everything = engine.everything();
    let (governed, taken) = match stands_in {
        true => (everything, in_motion.particles),
        false => engine.governed(&view, &in_motion, engine.frame_ms),
    };
    let drawn = [(governed, &in_motion.nodes, ""), (everything, &streamed.selection.nodes, "-whole")];
    let name = |what: &str, kind: &str| options.folder().join(format!("{what}-{backend}-{seconds:.0}s{kind}.png"));
    let preset = options.mode().transfer[usize::from(engine.depiction.attribute.is_some())];
    let transfer = TransferFunction::preset(preset).unwrap_or_default();
    // Sums have no use for a diameter.
    let subject = Subject::new(engine.tree.metadata(), &engine.depiction, &transfer, 0.0);
    let mut overdraw = (!options.mode().is_light()).then_some([(0.0, 0); 2]);
    for (&(plan, nodes, kind), out) in drawn.iter().zip(overdraw.iter_mut().flatten()) {
        let counted = subject.overdraw(&view, &subject.decode(&view, nodes, &plan), &plan)?;
        output::write_png(&name("overdraw", kind), &counted.image())?;
        *out = (counted.mean(), counted.max());
    }
    let mut pictures = Vec::with_capacity(drawn.len());
    for (plan, nodes, _) in &drawn {
        engine.canvas.draw(&view, nodes, plan)?;
        pictures.push(engine.canvas.picture()?);
    }
    let images: Vec<_> = pictures.iter().map(|picture| image(picture, &pictures[1], &transfer)).collect();
    for (image, (_, _, kind)) in images.iter().zip(drawn) {
        output::write_png(&name("flight", kind), image)?;
    }
    let color_error = color_error(&images[0], &images[1]).0;
    let converged = streamed.converged.is_some();
    Ok(Check { seconds, converged, difference, color_error, drawn: taken, overdraw })
}
