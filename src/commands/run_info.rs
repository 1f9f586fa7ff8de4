//! What `deepfield info` says about a run: its steps, as a table for people or as JSON for programs.

use crate::model::ClockVariable;
use crate::store::RunFile;
use crate::store::run::Step;
use serde_json::{Value, json};
use std::fmt::Write as _;

/// The facts as JSON.
pub fn json(run: &RunFile) -> Value {
    let directory = run.directory();
    let particles: u64 = directory.steps.iter().map(|step| step.particles).sum();
    json!({
        "kind": "run",
        "format": "deepfield-run",
        "bytes": run.bytes(),
        "clock": { "variable": directory.clock, "unit": directory.time_unit },
        "length_unit": directory.length_unit,
        "mass_unit": directory.mass_unit,
        "box_size": directory.box_size,
        "bytes_per_particle_step": run.bytes() as f64 / particles.max(1) as f64,
        "steps": directory.steps.iter().enumerate().map(|(index, step)| step_json(index, step)).collect::<Vec<_>>(),
        "notes": directory.notes,
    })
}

fn step_json(index: usize, step: &Step) -> Value {
    json!({
        "index": index,
        "time": step.time,
        "redshift": step.redshift,
        "scale_factor": step.redshift.map(|redshift| 1.0 / (1.0 + redshift)),
        "particles": step.particles,
        "mass": step.mass,
        "bounds": step.bounds,
        "source": step.source,
        "bytes": step.still.len,
    })
}

/// The facts as a table for people.
pub fn table(run: &RunFile) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = write_table(&mut text, run);
    text
}

fn write_table(text: &mut String, run: &RunFile) -> std::fmt::Result {
    let directory = run.directory();
    let particles: u64 = directory.steps.iter().map(|step| step.particles).sum();
    writeln!(
        text,
        "deepfield run, {} bytes: {} steps, {:.2} bytes for each particle of a step",
        run.bytes(),
        directory.steps.len(),
        run.bytes() as f64 / particles.max(1) as f64
    )?;
    writeln!(text, "length unit: {}, mass unit: {}", directory.length_unit, directory.mass_unit)?;
    if let Some(edge) = directory.box_size {
        writeln!(text, "box: {edge}")?;
    }
    directory.notes.iter().try_for_each(|note| writeln!(text, "note: {note}"))?;
    let has_redshifts = directory.steps.iter().any(|step| step.redshift.is_some_and(|redshift| redshift != 0.0));
    let redshift = |words: String| if has_redshifts { format!(" {words:>10}") } else { String::new() };
    let heading = redshift("redshift".into());
    let time = if directory.clock == ClockVariable::ScaleFactor { "scale factor" } else { "time" };
    writeln!(text, "\n  {:>6} {time:>14}{heading} {:>14} {:>14}  source", "step", "particles", "bytes")?;
    for (index, step) in directory.steps.iter().enumerate() {
        let own = redshift(step.redshift.map_or(String::new(), |redshift| format!("{redshift:.4}")));
        let source = step.source.display();
        writeln!(text, "  {index:>6} {:>14}{own} {:>14} {:>14}  {source}", step.time, step.particles, step.still.len)?;
    }
    Ok(())
}
