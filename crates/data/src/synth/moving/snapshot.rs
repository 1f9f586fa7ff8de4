//! Moving particles at a time as a Gadget binary snapshot, format 2: several families, ids of 64 bits, rows in an order of their own.

use super::{Moving, State};
use crate::model::mixing::mix_bits;
use crate::model::new_file;
use crate::synth::gadget::{Header, frame};
use rayon::prelude::*;
use std::io::{BufWriter, Error, ErrorKind, Seek, SeekFrom, Write};
use std::path::Path;

/// Bytes of the longest column of a particle: positions and velocities.
const WIDEST: u64 = 12;

/// Writes the snapshot of step `step`.
///
/// # Errors
/// Those of the disk, and `InvalidInput` for a step without particles or with more than a file can hold.
pub(super) fn write(moving: &dyn Moving, step: usize, time: f64, seed: u64, path: &Path) -> std::io::Result<()> {
    let there = |particle: u64| Some((particle, moving.at(particle, step, time)?));
    let mut rows: Vec<(u64, State)> = (0..moving.len()).into_par_iter().filter_map(there).collect();
    if rows.is_empty() || rows.len() as u64 * WIDEST > u64::from(u32::MAX) - 256 {
        let message = format!("{} particles at step {step}, expected 1 to 357 million", rows.len());
        return Err(Error::new(ErrorKind::InvalidInput, message));
    }
    let order = |particle: u64| mix_bits(mix_bits(seed ^ (step as u64) << 32) ^ particle);
    // A file has one family after the other.
    rows.par_sort_unstable_by_key(|(particle, state)| (state.family.gadget_type(), order(*particle), *particle));
    let mut counts = [0; 6];
    rows.iter().filter_map(|(_, state)| state.family.gadget_type()).for_each(|kind| counts[usize::from(kind)] += 1);
    let edge = moving.edge();
    let header = Header {
        counts,
        counts_of_all: counts.map(u64::from),
        masses: [0.0; 6],
        time,
        redshift: edge.map_or(0.0, |_| 1.0 / time - 1.0),
        files: 1,
        box_size: edge.unwrap_or(0.0),
        omega_matter: f64::from(u8::from(edge.is_some())),
        omega_lambda: 0.0,
        hubble: 0.7,
    };
    let folder = crate::store::temporary::folder_of(path);
    let file = new_file::builder().tempfile_in(folder)?;
    let mut out = BufWriter::new(file.as_file());
    let floats = |values: [f64; 3]| values.map(|value| value as f32).iter().flat_map(|v| v.to_le_bytes()).collect();
    let wrapped = |position: [f64; 3]| match edge {
        // What rounds to the upper face is at it.
        Some(edge) => position.map(|x| x - edge * (x / edge).floor()),
        None => position,
    };
    type Encode<'a> = &'a dyn Fn(&(u64, State)) -> Vec<u8>;
    let single = |value: f64| (value as f32).to_le_bytes().to_vec();
    let mass = moving.mass();
    let columns: [(&str, Encode<'_>); 7] = [
        ("POS ", &|(_, state)| floats(wrapped(state.position))),
        ("VEL ", &|(_, state)| floats(state.velocity)),
        ("ID  ", &|(particle, _)| moving.id(*particle).to_le_bytes().to_vec()),
        ("MASS", &|_| single(mass)),
        ("U   ", &|_| single(1.0)),
        ("RHO ", &|(_, state)| single(state.density)),
        ("HSML", &|(_, state)| single(state.smoothing_length)),
    ];
    let bytes = header.encode();
    block(&mut out, "HEAD", &bytes)?;
    for (index, (label, encode)) in columns.into_iter().enumerate() {
        // The first four are there for every family, the others for gas.
        let rows = if index < 4 { &rows[..] } else { &rows[..counts[0] as usize] };
        if !rows.is_empty() {
            block(&mut out, label, &rows.iter().flat_map(encode).collect::<Vec<u8>>())?;
        }
    }
    out.flush()?;
    drop(out);
    file.persist(path).map_err(|error| error.error)?;
    Ok(())
}

/// Appends a block.
fn block(out: &mut (impl Write + Seek + Send), label: &str, bytes: &[u8]) -> std::io::Result<()> {
    let at = out.stream_position()?;
    frame(out, at, label, bytes.len() as u64)?;
    out.seek(SeekFrom::Start(at + 20))?;
    out.write_all(bytes)?;
    out.seek(SeekFrom::Current(4))?;
    Ok(())
}
