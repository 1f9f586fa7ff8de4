//! The surface on which a volume's samples are an isovalue. The lattice is the samples' own, wherever its axes point.
//!
//! Samples are read in blocks, which are kept as long as there is memory for them. What has no value (NaN, or the number
//! that stands for none) counts as low: the surface closes half-way to it.

use super::output::{Searched, write_surface};
use super::{Isosurface, IsosurfaceOptions, memory_of_bricks, needs_doubles};
use crate::cpu::mesh::{BEFORE, BLOCK, BRICK, Faces, Field, Lattice, LatticePlacement, MOST_CELLS, Samples};
use crate::explore::batch::Work;
use crate::explore::error::ExploreError;
use crate::explore::export::mesh::{MeshAbout, MeshFormat};
use crate::import::GridSource;
use crate::model::{Grid, Region};
use crate::store::GridFile;
use glam::DVec3;
use lru::LruCache;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// Samples along an edge of a block; built files have theirs in bricks of as many.
const BLOCK_SIDE: u64 = 64;

/// Most samples: the bricks of all are listed, however little of a file holds something.
const MOST_SAMPLES: u64 = 1 << 42;

/// A volume whose samples are read in boxes, by several threads at once.
pub trait ReadGrid: Sync {
    /// The file.
    fn path(&self) -> &Path;

    /// The grid.
    fn grid(&self) -> &Grid;

    /// Reads the samples of a box, as [`GridSource::read`] does.
    ///
    /// # Errors
    /// When the file cannot be read there, or the box is not in the grid.
    fn read(&self, region: &Region, out: &mut [u8]) -> Result<(), ExploreError>;
}

impl ReadGrid for GridSource {
    fn path(&self) -> &Path {
        &self.description().path
    }

    fn grid(&self) -> &Grid {
        GridSource::grid(self)
    }

    fn read(&self, region: &Region, out: &mut [u8]) -> Result<(), ExploreError> {
        Ok(GridSource::read(self, region, out)?)
    }
}

impl ReadGrid for GridFile {
    fn path(&self) -> &Path {
        GridFile::path(self)
    }

    fn grid(&self) -> &Grid {
        &self.about().grid
    }

    fn read(&self, region: &Region, out: &mut [u8]) -> Result<(), ExploreError> {
        Ok(GridFile::read(self, region, out)?)
    }
}

/// Writes the surface of a volume's channel to the file `out`. Of the options neither spacing nor cells count.
///
/// # Errors
/// [`ExploreError`] when the samples cannot be read, are none of a volume, have no such surface or channel, or the file
/// cannot be written; a file that was there before stays as it was.
pub fn isosurface_of_grid(
    source: &dyn ReadGrid,
    options: &IsosurfaceOptions,
    (format, out): (MeshFormat, &Path),
    work: Work,
) -> Result<Isosurface, ExploreError> {
    let (path, grid, isovalue) = (source.path(), source.grid(), options.isovalue);
    let sides = 2..=u64::from(MOST_CELLS);
    let samples = grid.shape.iter().copied().fold(1, u64::saturating_mul);
    if grid.dimensions != 3 || !grid.shape.iter().all(|side| sides.contains(side)) || samples > MOST_SAMPLES {
        let expected = format!("a volume of 2 to {MOST_CELLS} samples along each axis, {MOST_SAMPLES} at most");
        return Err(ExploreError::malformed(path, "content", grid.described(), expected));
    }
    let channel = match &options.attribute {
        None => 0,
        Some(name) => grid.channels.iter().position(|channel| channel.name == *name).ok_or_else(|| {
            let names: Vec<&str> = grid.channels.iter().map(|channel| channel.name.as_str()).collect();
            ExploreError::missing(path, format!("channel {name}"), format!("one of {}", names.join(", ")))
        })?,
    };
    let lattice = Lattice { origin: DVec3::ZERO, spacing: 1.0, cells: grid.shape.map(|side| (side - 1) as u32) };
    let bricks = lattice.bricks(BRICK);
    let values = Values {
        source,
        work,
        channel,
        isovalue,
        faces: if options.is_open { Faces::Cut } else { Faces::Capped },
        blocks: Mutex::new(Blocks { held: LruCache::unbounded(), bytes: 0, range: (f64::INFINITY, f64::NEG_INFINITY) }),
        most_bytes: options.memory.saturating_sub(memory_of_bricks(false, false)),
    };
    let spacing = grid.to_world.matrix3.determinant().abs().cbrt();
    let own = &grid.channels[channel];
    let about = MeshAbout {
        isovalue,
        spacing,
        length_unit: &grid.length_unit,
        quantity: &own.name,
        unit: &own.unit.to_string(),
        attribute: None,
        is_double: needs_doubles(grid.bounds(), spacing),
        smooth: options.smooth,
    };
    let searched = Searched { path, lattice: &lattice, side: BRICK, bricks: &bricks };
    let Some((mesh, bytes)) = write_surface(&values, searched, options, &about, (format, out), work)? else {
        let (min, max) = values.blocks.into_inner().unwrap_or_else(PoisonError::into_inner).range;
        let expected = match min <= max {
            true => format!("a number above {min}, up to {max}, which {} has", own.name),
            false => format!("another channel: {} has no values", own.name),
        };
        return Err(ExploreError::malformed(path, "--isovalue", isovalue, expected));
    };
    Ok(Isosurface {
        isovalue,
        spacing,
        finer_spacing: None,
        cells: lattice.cells.into_iter().map(u64::from).product(),
        particles: None,
        samples: Some(samples),
        smoothed: options.smooth,
        mesh,
        bytes,
    })
}

/// The values of a channel.
struct Values<'a> {
    source: &'a dyn ReadGrid,
    work: Work<'a>,
    channel: usize,
    isovalue: f64,
    faces: Faces,
    blocks: Mutex<Blocks>,
    /// Bytes of blocks in memory.
    most_bytes: u64,
}

/// Blocks that were read, the one that was used longest ago first out.
struct Blocks {
    held: LruCache<[u64; 3], Arc<Block>>,
    bytes: u64,
    /// The smallest and the largest value so far.
    range: (f64, f64),
}

/// The values of a box of samples, x first.
struct Block {
    region: Region,
    values: Vec<f64>,
}

impl Values<'_> {
    /// A block by its place among all, from memory where it is there.
    fn block(&self, place: [u64; 3]) -> Result<Arc<Block>, ExploreError> {
        let known = self.blocks.lock().unwrap_or_else(PoisonError::into_inner).held.get(&place).cloned();
        if let Some(block) = known {
            return Ok(block);
        }
        // Others may read it at the same time; nobody waits for a disk with the lock.
        let block = Arc::new(self.read(place)?);
        let size = |block: &Block| 8 * block.values.len() as u64;
        let known = block.values.iter().copied().filter(|value| !value.is_nan());
        let (min, max) = known.fold((f64::INFINITY, f64::NEG_INFINITY), |(min, max), v| (v.min(min), v.max(max)));
        let mut blocks = self.blocks.lock().unwrap_or_else(PoisonError::into_inner);
        blocks.range = (blocks.range.0.min(min), blocks.range.1.max(max));
        blocks.bytes += size(&block);
        if let Some(same) = blocks.held.put(place, Arc::clone(&block)) {
            blocks.bytes -= size(&same);
        }
        while blocks.bytes > self.most_bytes && blocks.held.len() > 1 {
            let Some((_, oldest)) = blocks.held.pop_lru() else { break };
            blocks.bytes -= size(&oldest);
        }
        Ok(block)
    }

    fn read(&self, place: [u64; 3]) -> Result<Block, ExploreError> {
        let grid = self.source.grid();
        let min = place.map(|index| index * BLOCK_SIDE);
        let max = [0, 1, 2].map(|axis| grid.shape[axis].min(min[axis] + BLOCK_SIDE));
        let region = Region { min, max };
        let samples = region.shape().into_iter().product::<u64>() as usize;
        // A block has few samples, and a sample few channels: the import has checked.
        let mut bytes = vec![0; samples * grid.sample_bytes() as usize];
        self.source.read(&region, &mut bytes)?;
        let mut values = Vec::with_capacity(samples);
        let first = self.channel * grid.sample_type.size();
        grid.sample_type.decode(&bytes[first..], grid.channels.len(), &mut values);
        let channel = &grid.channels[self.channel];
        for value in &mut values {
            let is_none = channel.no_data == Some(*value);
            *value = if is_none { f64::NAN } else { channel.scale.value(*value) };
        }
        Ok(Block { region, values })
    }
}

impl Field for Values<'_> {
    type Error = ExploreError;

    fn faces(&self) -> Faces {
        self.faces
    }

    fn placement(&self) -> Option<LatticePlacement> {
        Some(LatticePlacement::new(self.source.grid().to_world))
    }

    fn sample(&self, corner: [u32; 3], samples: &mut Samples) -> Result<(), ExploreError> {
        self.work.go_on()?;
        let (shape, row) = (self.source.grid().shape, samples.row());
        // Beyond the volume there is no value.
        samples.values.fill(f64::NAN);
        // Numbers of samples are higher by this one than those of the brick's points.
        let first = corner.map(|cell| i64::from(cell) - BEFORE as i64);
        let from = first.map(|first| first.max(0) as u64);
        let to = [0, 1, 2].map(|axis| shape[axis].min((first[axis] + row as i64) as u64));
        let blocks = |axis: usize| from[axis] / BLOCK_SIDE..to[axis].div_ceil(BLOCK_SIDE);
        for z in blocks(2) {
            for y in blocks(1) {
                for x in blocks(0) {
                    self.block([x, y, z])?.copy(first, (from, to), samples);
                }
            }
        }
        self.activate(corner, samples);
        Ok(())
    }
}

impl Values<'_> {
    /// Tells which blocks of a brick have values on both sides of the isovalue, or high ones at a face of the volume.
    fn activate(&self, corner: [u32; 3], samples: &mut Samples) {
        let (blocks, shape) = (samples.blocks(), self.source.grid().shape);
        for index in 0..samples.active.len() {
            let place = [index % blocks, index / blocks % blocks, index / blocks / blocks].map(|place| place * BLOCK);
            let is_at_face = (0..3).any(|axis| {
                let first = u64::from(corner[axis]) + place[axis] as u64;
                first == 0 || first + BLOCK as u64 + 1 >= shape[axis]
            });
            let points = BLOCK + 1;
            let mut high = 0;
            for z in 0..points {
                for y in 0..points {
                    let start = samples.index([place[0], place[1] + y, place[2] + z].map(|point| point + BEFORE));
                    let values = &samples.values[start..start + points];
                    high += values.iter().filter(|value| **value >= self.isovalue).count();
                }
            }
            samples.active[index] = high > 0 && (is_at_face || high < points * points * points);
        }
    }
}

impl Block {
    /// Copies its part of the samples `from` up to `to` to a brick whose points begin with sample `first`.
    fn copy(&self, first: [i64; 3], (from, to): ([u64; 3], [u64; 3]), samples: &mut Samples) {
        let Region { min, max } = self.region;
        let from = [0, 1, 2].map(|axis| from[axis].max(min[axis]));
        let to = [0, 1, 2].map(|axis| to[axis].min(max[axis]));
        let shape = self.region.shape();
        let point = |axis: usize, sample: u64| (sample as i64 - first[axis]) as usize;
        let count = to[0].saturating_sub(from[0]) as usize;
        for z in from[2]..to[2] {
            for y in from[1]..to[1] {
                let start = (((z - min[2]) * shape[1] + y - min[1]) * shape[0] + from[0] - min[0]) as usize;
                let at = samples.index([point(0, from[0]), point(1, y), point(2, z)]);
                samples.values[at..at + count].copy_from_slice(&self.values[start..start + count]);
            }
        }
    }
}
