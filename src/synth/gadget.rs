//! Writes generated particles as a Gadget binary snapshot, format 2, little-endian.

use super::{CHUNK, Chunk, Generator};
use crate::model::progress::Progress;
use rayon::prelude::*;
use std::io::Write;

/// Most particles that one file can hold: the block of positions must stay below 4 GiB.
pub const MOST: u64 = (u32::MAX as u64 - 256) / 12;

/// Chunks that are generated at a time.
const WINDOW: u64 = 16;

/// Writes a snapshot with the blocks HEAD, POS, VEL, ID, U, RHO and HSML; the mass is in the header.
///
/// # Errors
/// Those of `out`, and `InvalidInput` for more than [`MOST`] particles.
pub fn write(generator: &dyn Generator, out: &mut dyn Write, progress: &dyn Progress) -> std::io::Result<()> {
    let count = generator.len();
    if count == 0 || count > MOST {
        let message = format!("{count} particles, expected 1 to {MOST} in one Gadget file");
        return Err(std::io::Error::new(std::io::ErrorKind::InvalidInput, message));
    }
    progress.begin("writing particles", 6 * count);
    block(out, "HEAD", 256, |out| out.write_all(&header(generator)))?;
    let vectors = |of: fn(&Chunk) -> &Vec<[f32; 3]>| move |chunk: &Chunk, _: u64| bytes(of(chunk).as_flattened());
    let scalars = |of: fn(&Chunk) -> &Vec<f32>| move |chunk: &Chunk, _: u64| bytes(of(chunk));
    let ids = |chunk: &Chunk, first: u64| -> Vec<u8> {
        (0..chunk.positions.len() as u64).flat_map(|i| ((first + i + 1) as u32).to_le_bytes()).collect()
    };
    column(generator, out, progress, "POS ", 12, &vectors(|chunk| &chunk.positions))?;
    column(generator, out, progress, "VEL ", 12, &vectors(|chunk| &chunk.velocities))?;
    column(generator, out, progress, "ID  ", 4, &ids)?;
    column(generator, out, progress, "U   ", 4, &scalars(|chunk| &chunk.internal_energy))?;
    column(generator, out, progress, "RHO ", 4, &scalars(|chunk| &chunk.density))?;
    column(generator, out, progress, "HSML", 4, &scalars(|chunk| &chunk.smoothing_length))
}

fn bytes(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

/// One block of format 2: its name and length as a small record, then the data between two length markers.
fn block(
    out: &mut dyn Write,
    name: &str,
    length: u32,
    data: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
) -> std::io::Result<()> {
    for value in [8u32.to_le_bytes(), name.as_bytes().try_into().unwrap_or(*b"    ")] {
        out.write_all(&value)?;
    }
    for value in [length.wrapping_add(8), 8, length] {
        out.write_all(&value.to_le_bytes())?;
    }
    data(out)?;
    out.write_all(&length.to_le_bytes())
}

/// A block with one value of `size` bytes for each particle; `encode` gets a chunk and the index of its first particle.
fn column(
    generator: &dyn Generator,
    out: &mut dyn Write,
    progress: &dyn Progress,
    name: &str,
    size: u64,
    encode: &(dyn Fn(&Chunk, u64) -> Vec<u8> + Sync),
) -> std::io::Result<()> {
    // At most 4 GiB: `write` has checked the count.
    block(out, name, (generator.len() * size) as u32, |out| {
        let chunks = generator.len().div_ceil(CHUNK);
        for start in (0..chunks).step_by(WINDOW as usize) {
            let window = start..chunks.min(start + WINDOW);
            let parts: Vec<Vec<u8>> =
                window.into_par_iter().map(|index| encode(&generator.chunk(index), index * CHUNK)).collect();
            for part in parts {
                out.write_all(&part)?;
                progress.advance(part.len() as u64 / size);
            }
        }
        Ok(())
    })
}

/// Gadget's header: 256 bytes.
fn header(generator: &dyn Generator) -> Vec<u8> {
    let mut header = Vec::with_capacity(256);
    // Counts by type in this file, masses by type, time, redshift, two flags.
    let counts = |header: &mut Vec<u8>| {
        header.extend((generator.len() as u32).to_le_bytes());
        header.extend([0; 20]);
    };
    counts(&mut header);
    header.extend(generator.particle_mass().to_le_bytes());
    header.extend([0; 40]);
    header.extend(1f64.to_le_bytes());
    header.extend(0f64.to_le_bytes());
    header.extend([0; 8]);
    // Counts in all files, a flag, number of files, box, cosmology.
    counts(&mut header);
    header.extend([0; 4]);
    header.extend(1u32.to_le_bytes());
    for value in [generator.box_size(), 0.3, 0.7, 0.7] {
        header.extend(value.to_le_bytes());
    }
    header.resize(256, 0);
    header
}
