//! Writes generated particles as a Gadget binary snapshot, format 2, little-endian.

use super::{CHUNK, Chunk, Generator};
use crate::model::progress::Progress;
use rayon::prelude::*;
use std::io::{Seek, SeekFrom, Write};
use std::ops::Range;

/// Most particles that one file can hold: the block of positions must stay below 4 GiB.
pub const MOST: u64 = (u32::MAX as u64 - 256) / 12;

/// Chunks that are generated at a time.
const WINDOW: u64 = 16;

/// Which particles of a snapshot a file holds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Part {
    /// The particles.
    pub particles: Range<u64>,
    /// Number of files of the snapshot.
    pub files: u32,
}

/// A column of a file: its label, the bytes for each particle, and how a chunk's part of it is encoded.
struct Column {
    label: &'static str,
    size: u64,
    encode: Box<dyn Fn(&Chunk, Range<usize>, u64) -> Vec<u8> + Sync>,
}

/// Writes a snapshot in one file.
///
/// # Errors
/// Those of [`write_part`].
pub fn write(
    generator: &dyn Generator,
    out: &mut (impl Write + Seek + Send),
    progress: &dyn Progress,
) -> std::io::Result<()> {
    progress.begin("writing particles", generator.len());
    write_part(generator, &Part { particles: 0..generator.len(), files: 1 }, out, progress)
}

/// Writes one file of a snapshot, with the blocks HEAD, POS, VEL, ID, the scalars of the generator, RHO and HSML; the mass
/// is in the header. Every particle is generated once; its values go to their places in all blocks.
///
/// # Errors
/// Those of `out`, and `InvalidInput` for no particles or more than [`MOST`].
pub fn write_part(
    generator: &dyn Generator,
    part: &Part,
    out: &mut (impl Write + Seek + Send),
    progress: &dyn Progress,
) -> std::io::Result<()> {
    let Range { start, end } = part.particles;
    let count = end.saturating_sub(start);
    if count == 0 || count > MOST || end > generator.len() {
        let message = format!("{count} particles, expected 1 to {MOST} in one Gadget file");
        return Err(std::io::Error::new(std::io::ErrorKind::InvalidInput, message));
    }
    let header = header(generator, part);
    frame(out, 0, "HEAD", header.len() as u64)?;
    out.seek(SeekFrom::Start(20))?;
    out.write_all(&header)?;
    let columns = columns(generator);
    let mut at = 24 + header.len() as u64;
    let mut starts = Vec::with_capacity(columns.len());
    for column in &columns {
        frame(out, at, column.label, count * column.size)?;
        starts.push(at + 20);
        at += count * column.size + 24;
    }
    let encode = |window: Range<u64>| -> Vec<(u64, Vec<Vec<u8>>)> {
        let of_chunk = |index: u64| {
            let first = index * CHUNK;
            let (from, to) = (start.max(first), end.min(first + CHUNK));
            let chunk = generator.chunk(index);
            let rows = (from - first) as usize..(to - first) as usize;
            (from - start, columns.iter().map(|column| (column.encode)(&chunk, rows.clone(), from)).collect())
        };
        window.into_par_iter().map(of_chunk).collect()
    };
    let chunks = start / CHUNK..end.div_ceil(CHUNK);
    let window = |from: u64| from..chunks.end.min(from + WINDOW);
    let mut ready = encode(window(chunks.start));
    let mut next = window(chunks.start).end;
    while !ready.is_empty() {
        // The next window is generated while this one is written.
        let write = || -> std::io::Result<()> {
            for (row, encoded) in &ready {
                for ((bytes, column), start) in encoded.iter().zip(&columns).zip(&starts) {
                    out.seek(SeekFrom::Start(start + row * column.size))?;
                    out.write_all(bytes)?;
                }
                progress.advance(encoded[0].len() as u64 / columns[0].size);
            }
            Ok(())
        };
        let (written, following) = rayon::join(write, || encode(window(next)));
        written?;
        next = window(next).end;
        ready = following;
    }
    Ok(())
}

/// Bytes that a snapshot of so many particles takes, headers left out.
pub fn bytes(generator: &dyn Generator, particles: u64) -> u64 {
    columns(generator).iter().map(|column| column.size).sum::<u64>().saturating_mul(particles)
}

/// The columns of every file of a generator.
fn columns(generator: &dyn Generator) -> Vec<Column> {
    fn floats(values: &[f32]) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(4 * values.len());
        values.iter().for_each(|value| bytes.extend_from_slice(&value.to_le_bytes()));
        bytes
    }
    let wide = generator.len() > u64::from(u32::MAX);
    let ids = move |_: &Chunk, rows: Range<usize>, first: u64| -> Vec<u8> {
        let ids = first + 1..first + 1 + rows.len() as u64;
        if wide {
            ids.flat_map(u64::to_le_bytes).collect()
        } else {
            ids.flat_map(|id| (id as u32).to_le_bytes()).collect()
        }
    };
    let scalar = |index: usize| move |chunk: &Chunk, rows: Range<usize>, _: u64| floats(&chunk.scalars[index][rows]);
    let mut columns = vec![
        Column { label: "POS ", size: 12, encode: Box::new(|c, rows, _| floats(c.positions[rows].as_flattened())) },
        Column { label: "VEL ", size: 12, encode: Box::new(|c, rows, _| floats(c.velocities[rows].as_flattened())) },
        Column { label: "ID  ", size: if wide { 8 } else { 4 }, encode: Box::new(ids) },
    ];
    let scalars = generator.scalars().iter().enumerate();
    columns.extend(scalars.map(|(i, about)| Column { label: about.label, size: 4, encode: Box::new(scalar(i)) }));
    columns.push(Column { label: "RHO ", size: 4, encode: Box::new(|c, rows, _| floats(&c.density[rows])) });
    columns.push(Column { label: "HSML", size: 4, encode: Box::new(|c, rows, _| floats(&c.smoothing_length[rows])) });
    columns
}

/// What stands around a block's data: a record with its name and the length of the whole, then the data between two
/// length markers. 20 bytes before the data, 4 after.
pub(super) fn frame(out: &mut (impl Write + Seek + Send), at: u64, label: &str, length: u64) -> std::io::Result<()> {
    // Below 4 GiB: `write_part` has checked the count.
    let length = length as u32;
    let mut before = Vec::with_capacity(20);
    before.extend(8u32.to_le_bytes());
    before.extend(label.as_bytes());
    for value in [length.wrapping_add(8), 8, length] {
        before.extend(value.to_le_bytes());
    }
    out.seek(SeekFrom::Start(at))?;
    out.write_all(&before)?;
    out.seek(SeekFrom::Start(at + 20 + u64::from(length)))?;
    out.write_all(&length.to_le_bytes())
}

/// The header of one file of a generator's snapshot.
fn header(generator: &dyn Generator, part: &Part) -> Vec<u8> {
    let kind = usize::from(generator.family().gadget_type().unwrap_or(0));
    let (mut counts, mut counts_of_all, mut masses) = ([0; 6], [0; 6], [0.0; 6]);
    counts[kind] = (part.particles.end - part.particles.start) as u32;
    counts_of_all[kind] = generator.len();
    masses[kind] = generator.particle_mass();
    let box_size = if generator.periodic() { generator.bounds().size().x } else { 0.0 };
    let (time, redshift) = (1.0, 0.0);
    let (files, omega_matter, omega_lambda, hubble) = (part.files, 0.3, 0.7, 0.7);
    Header { counts, counts_of_all, masses, time, redshift, files, box_size, omega_matter, omega_lambda, hubble }
        .encode()
}

/// Gadget's header.
pub(super) struct Header {
    /// Particles of each type in this file.
    pub counts: [u32; 6],
    /// The same in all files.
    pub counts_of_all: [u64; 6],
    /// Masses of all particles of a type; 0 where each has its own.
    pub masses: [f64; 6],
    /// Time, of comoving data the scale factor.
    pub time: f64,
    /// Redshift.
    pub redshift: f64,
    /// Number of files.
    pub files: u32,
    /// Edge of the periodic box, or 0.
    pub box_size: f64,
    /// Density of matter; 0 for what does not expand.
    pub omega_matter: f64,
    /// Density of the cosmological constant.
    pub omega_lambda: f64,
    /// Hubble's constant by 100 km/s/Mpc.
    pub hubble: f64,
}

impl Header {
    /// The header's 256 bytes.
    pub fn encode(&self) -> Vec<u8> {
        let mut header = Vec::with_capacity(256);
        let counts = |header: &mut Vec<u8>, counts: [u32; 6]| {
            counts.into_iter().for_each(|count| header.extend(count.to_le_bytes()));
        };
        // Counts by type in this file, masses by type, time, redshift, two flags.
        counts(&mut header, self.counts);
        for value in self.masses.into_iter().chain([self.time, self.redshift]) {
            header.extend(value.to_le_bytes());
        }
        header.extend([0; 8]);
        // Counts in all files, a flag, number of files, box, cosmology, two flags, upper halves of the counts.
        counts(&mut header, self.counts_of_all.map(|count| count as u32));
        header.extend([0; 4]);
        header.extend(self.files.to_le_bytes());
        for value in [self.box_size, self.omega_matter, self.omega_lambda, self.hubble] {
            header.extend(value.to_le_bytes());
        }
        header.extend([0; 8]);
        counts(&mut header, self.counts_of_all.map(|count| (count >> 32) as u32));
        header.resize(256, 0);
        header
    }
}
