//! What `deepfield info` says about a run: its steps, as a table for people or as JSON for programs.

use super::text_of;
use crate::hierarchy::spacetime::{Stretch, recorded_error};
use crate::model::ClockVariable;
use crate::store::RunFile;
use crate::store::run::{FamilyTracks, IntervalTracks, Step};
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
        "stills": directory.has_stills,
        "steps": directory.steps.iter().enumerate().map(|(index, step)| step_json(index, step)).collect::<Vec<_>>(),
        "intervals": directory.intervals.iter().enumerate().map(|(from, found)| interval_json(run, from, found)).collect::<Vec<_>>(),
        "flow": flow_json(run),
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

fn interval_json(run: &RunFile, from: usize, interval: &IntervalTracks) -> Value {
    let layout = run.directory().tracks.iter().flat_map(|tracks| &tracks.families);
    let families = layout.zip(&interval.families).map(|(family, FamilyTracks { matches, tracks, nodes, .. })| {
        let [mean, max] = matches.position_error;
        json!({
            "name": family.name,
            "tangents": family.tangents.name(),
            "tracks": tracks,
            "bytes": nodes.len,
            "matched": matches.matched,
            "born": matches.born,
            "vanished": matches.vanished,
            "changed": matches.changed,
            "ambiguous": matches.ambiguous,
            "crossing": matches.crossing,
            "unresolved": matches.unresolved,
            "velocity_factor": matches.velocity_factor,
            "leave_one_out": matches.leave_one_out.map(|off| json!({ "rms": off.rms, "p99": off.p99, "max": off.max })),
            "position_error": { "mean": mean, "max": max },
        })
    });
    json!({ "from": from, "to": from + 1, "families": families.collect::<Vec<_>>() })
}

/// The flow levels, from the finest on: their errors, and tracks and bytes over the intervals.
fn flow_json(run: &RunFile) -> Vec<Value> {
    let level = |(level, error): (usize, &f64)| {
        let intervals = run.directory().intervals.iter();
        let of = |interval: &IntervalTracks| {
            let parts = interval.families.iter().filter_map(|family| family.flow.levels.get(level));
            parts.fold((0_u64, 0_u64), |(tracks, bytes), (own, part)| {
                (tracks + u64::from(*own), bytes + u64::from(part.len))
            })
        };
        let all: Vec<(u64, u64)> = intervals.map(of).collect();
        let tracks = || all.iter().map(|(tracks, _)| *tracks);
        json!({
            "level": level + 1,
            "error": error,
            "tracks": {
                "mean": tracks().sum::<u64>() as f64 / all.len().max(1) as f64,
                "least": tracks().min(),
                "most": tracks().max(),
            },
            "bytes": all.iter().map(|(_, bytes)| *bytes).sum::<u64>(),
            "scales": scales(run, level).iter().map(|scale| scale_json(run, level, *error, scale)).collect::<Vec<_>>(),
        })
    };
    run.flow_errors().iter().enumerate().map(level).collect()
}

/// The long tracks of a flow level that are over as many intervals.
struct LongTracks {
    /// How many intervals.
    scale: usize,
    /// How many there are.
    tracks: u64,
    /// Of so many tracks over single intervals as they are in their place.
    share: f64,
    bytes: u64,
}

/// The long tracks of a flow level by the intervals that they are over, up to the most that some are over.
fn scales(run: &RunFile, level: usize) -> Vec<LongTracks> {
    let families = || {
        run.directory()
            .intervals
            .iter()
            .enumerate()
            .flat_map(|(number, own)| own.families.iter().map(move |family| (number, family)))
    };
    let all: u64 =
        families().filter_map(|(_, family)| family.flow.levels.get(level)).map(|(tracks, _)| u64::from(*tracks)).sum();
    let mut scales: Vec<LongTracks> = Vec::new();
    for (number, family) in families() {
        let stretches = Stretch::ending_with(number).zip(family.flow.long.get(level).into_iter().flatten());
        for (at, (stretch, (tracks, part))) in stretches.enumerate() {
            if scales.len() == at {
                scales.push(LongTracks { scale: stretch.scale, tracks: 0, share: 0.0, bytes: 0 });
            }
            let own = &mut scales[at];
            own.tracks += u64::from(*tracks);
            own.bytes += u64::from(part.len);
        }
    }
    for own in &mut scales {
        own.share = (own.tracks * own.scale as u64) as f64 / all.max(1) as f64;
    }
    let used = scales.iter().take_while(|own| own.tracks > 0).count();
    scales.truncate(used);
    scales
}

fn scale_json(run: &RunFile, level: usize, level_error: f64, own: &LongTracks) -> Value {
    let intervals = run.directory().intervals.iter().enumerate();
    let stretches = intervals.flat_map(|(number, interval)| {
        let own = Stretch::ending_with(number).filter(|stretch| stretch.scale == own.scale);
        own.flat_map(move |stretch| (0..interval.families.len()).map(move |family| (stretch, family)))
    });
    // What cannot be read has no error; `deepfield verify` says why.
    let long = stretches.filter_map(|(stretch, family)| run.long_tracks(stretch, family, level + 1).ok()).flatten();
    let errors: Vec<f64> = long.map(|long| recorded_error(level_error, long.error)).collect();
    json!({
        "intervals": own.scale,
        "tracks": own.tracks,
        "share": own.share,
        "bytes": own.bytes,
        "error": {
            "mean": errors.iter().sum::<f64>() / errors.len().max(1) as f64,
            "most": errors.iter().copied().fold(0.0, f64::max),
        },
    })
}

/// The facts as a table for people.
pub fn table(run: &RunFile) -> String {
    text_of(|text| write_table(text, run))
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
    write_tracks(text, run)?;
    write_flow(text, run)
}

/// What became of the particles from each step to the next.
fn write_tracks(text: &mut String, run: &RunFile) -> std::fmt::Result {
    let Some(layout) = &run.directory().tracks else { return Ok(()) };
    writeln!(
        text,
        "\n  {:>9} {:>11} {:>12} {:>10} {:>10} {:>10} {:>10} {:>10} {:>12}",
        "interval", "family", "matched", "born", "vanished", "changed", "unresolved", "velocities", "bytes"
    )?;
    for (from, interval) in run.directory().intervals.iter().enumerate() {
        for (family, FamilyTracks { matches, nodes, .. }) in layout.families.iter().zip(&interval.families) {
            let factor = matches.velocity_factor.map_or("-".into(), |factor| format!("{factor:.3}"));
            writeln!(
                text,
                "  {:>9} {:>11} {:>12} {:>10} {:>10} {:>10} {:>8.1} % {factor:>10} {:>12}",
                format!("{from} to {}", from + 1),
                family.name.as_str(),
                matches.matched,
                matches.born,
                matches.vanished,
                matches.changed,
                100.0 * matches.unresolved,
                nodes.len
            )?;
        }
    }
    Ok(())
}

/// The flow levels, and how much of each is in long tracks, too.
fn write_flow(text: &mut String, run: &RunFile) -> std::fmt::Result {
    if run.flow_errors().is_empty() {
        return Ok(());
    }
    let heading = "in long tracks over so many intervals";
    writeln!(text, "\n  {:>10} {:>14} {:>14} {:>12}  {heading}", "flow level", "error", "tracks", "bytes")?;
    for (level, error) in run.flow_errors().iter().enumerate() {
        let families = run.directory().intervals.iter().flat_map(|interval| &interval.families);
        let (mut tracks, mut bytes) = (0, 0);
        for (own, part) in families.filter_map(|family| family.flow.levels.get(level)) {
            tracks += u64::from(*own);
            bytes += u64::from(part.len);
        }
        let long = scales(run, level);
        let shares: Vec<String> = long.iter().map(|own| format!("{}: {:.1} %", own.scale, 100.0 * own.share)).collect();
        writeln!(text, "  {:>10} {error:>14.6} {tracks:>14} {bytes:>12}  {}", level + 1, shares.join(", "))?;
    }
    Ok(())
}
