//! Samples of images, volumes and height fields as arrays of NumPy.

use crate::error::Failure;
use deepfield_draw::build::default_memory;
use deepfield_draw::heights::OpenHeights;
use deepfield_draw::heights::model::{Heights, Window};
use deepfield_draw::import::{GridOptions, GridSource, open_grid};
use deepfield_draw::look::{DataKind, Member, is_field};
use deepfield_draw::model::{Channel, Grid, ReadMethod, Region};
use deepfield_draw::picture::Reporter;
use deepfield_draw::picture::asked::State;
use deepfield_draw::store::GridFile;
use serde::Deserialize;
use serde_json::{Value, json};
use std::path::Path;

/// Bytes that are read at a time where not all samples are kept.
const BAND: u64 = 64 << 20;

/// Which samples.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AskedSamples {
    /// Of a grid: every 2^level-th sample along each axis.
    level: u32,
    /// Whether they stay as they are stored; else there has to be room for the 64-bit floats that they stand for, too.
    stored: bool,
    /// Of heights: the first row or column and the one after the last, all where nothing is said.
    rows: Option<[u64; 2]>,
    columns: Option<[u64; 2]>,
    /// Bytes that they may take.
    memory: Option<u64>,
}

/// Samples of a grid, as they are stored in this machine's byte order, and what they are, as JSON.
pub struct Samples {
    /// The bytes, the fastest axis last.
    pub bytes: Vec<u8>,
    /// Type, shape, channels, spacing and origin.
    pub about: Value,
}

/// An image or a volume, open.
enum Open {
    File(GridFile),
    Source(GridSource),
}

impl Open {
    fn grid(&self) -> &Grid {
        match self {
            Open::File(file) => &file.about().grid,
            Open::Source(source) => source.grid(),
        }
    }

    fn read(&self, region: &Region, out: &mut [u8]) -> Result<(), Failure> {
        match self {
            Open::File(file) => Ok(file.read(region, out)?),
            Open::Source(source) => Ok(source.read(region, out)?),
        }
    }
}

impl AskedSamples {
    fn room_for(&self, path: &Path, bytes: Option<u64>, what: &str) -> Result<usize, Failure> {
        let memory = self.memory.unwrap_or_else(default_memory);
        let bytes = bytes.filter(|bytes| *bytes <= memory).and_then(|bytes| usize::try_from(bytes).ok());
        bytes.ok_or_else(|| format!("{}: memory: found {what}, expected at most {memory} bytes", path.display()).into())
    }

    /// The samples of an image or a volume.
    ///
    /// # Errors
    /// When they cannot be read, or take too much memory.
    pub fn grid(&self, path: &Path, state: &State) -> Result<Samples, Failure> {
        let open = match DataKind::of(path)? {
            DataKind::Grid => Open::File(GridFile::open(path, ReadMethod::default())?),
            DataKind::Source if is_field(path) => Open::Source(open_grid(path, &GridOptions::default())?),
            kind => {
                let found = kind.described();
                return Err(format!("{}: array: found {found}, expected an image or a volume", path.display()).into());
            }
        };
        let every = 1_u64.checked_shl(self.level).filter(|_| self.level < 63);
        let every = every.ok_or_else(|| format!("level: found {}, expected 0 to 62", self.level))?;
        let whole = open.grid();
        let kept = whole.thinned(every);
        let what = format!("{} in an array", kept.described());
        let is_plain =
            |channel: &Channel| (channel.scale.slope, channel.scale.intercept, channel.no_data) == (1.0, 0.0, None);
        let floats = match self.stored || kept.channels.iter().all(is_plain) {
            true => 0,
            false => (size_of::<f64>() / kept.sample_type.size()) as u64,
        };
        let stored = kept.bytes().unwrap_or(u64::MAX);
        self.room_for(path, stored.checked_mul(1 + floats), &what)?;
        let mut bytes = vec![0; self.room_for(path, Some(stored), &what)?];
        match every {
            1 => open.read(&whole.region(), &mut bytes)?,
            _ => self.thin(path, &open, every, &mut bytes, state)?,
        }
        let axes = kept.dimensions.min(3);
        let mut shape: Vec<u64> = kept.shape[..axes].iter().rev().copied().collect();
        if kept.channels.len() > 1 {
            shape.push(kept.channels.len() as u64);
        }
        let channels = kept.channels.iter().map(|channel| {
            json!({
                "name": channel.name,
                "unit": channel.unit,
                "slope": channel.scale.slope,
                "intercept": channel.scale.intercept,
                "no_data": channel.no_data,
            })
        });
        let about = json!({
            "dtype": kept.sample_type.name(),
            "shape": shape,
            "channels": channels.collect::<Vec<_>>(),
            "spacing": kept.spacing(),
            "origin": kept.to_world.translation.to_array(),
            "unit": kept.length_unit,
        });
        Ok(Samples { bytes, about })
    }

    /// The heights of a window, row by row, NaN where nothing was measured; how many rows and columns; and what they are, as JSON.
    ///
    /// # Errors
    /// When they cannot be read, are not there, or take too much memory.
    pub fn heights(&self, member: &Member) -> Result<(Vec<f64>, [usize; 2], Value), Failure> {
        let path = &*member.path;
        let open = OpenHeights::for_pictures(path, &member.said.options(ReadMethod::default()))?.0;
        let grid = open.grid();
        let part = |name: &str, asked: Option<[u64; 2]>, all: u64| match asked {
            None => Ok([0, all]),
            Some([start, end]) if start < end && end <= all => Ok([start, end]),
            Some([start, end]) => {
                let place = path.display();
                Err(format!("{place}: {name}: found {start} to {end}, expected a part of 0 to {all}"))
            }
        };
        let [row, row_end] = part("rows", self.rows, grid.rows)?;
        let [column, column_end] = part("columns", self.columns, grid.columns)?;
        let window = Window { row, column, rows: row_end - row, columns: column_end - column };
        let bytes = window.rows.checked_mul(window.columns).and_then(|samples| samples.checked_mul(8));
        let what = format!("{} x {} heights", window.columns, window.rows);
        let mut heights = vec![0.0; self.room_for(path, bytes, &what)? / 8];
        open.heights(window, &mut heights)?;
        let about = json!({
            "origin": grid.place(row as f64, column as f64),
            "step": grid.step,
            "unit": grid.xy_unit,
            "height_unit": grid.height_unit,
        });
        Ok((heights, [window.rows as usize, window.columns as usize], about))
    }

    /// Reads every so many-th sample along each axis of a grid, some of it at a time.
    fn thin(&self, path: &Path, open: &Open, every: u64, out: &mut [u8], state: &State) -> Result<(), Failure> {
        let grid = open.grid();
        let [width, height, depth] = grid.shape;
        let sample = grid.sample_bytes() as usize;
        // Bands along the slowest axis that there is.
        let (axis, length) = if grid.dimensions == 2 { (1, height) } else { (2, depth) };
        let across = [width, height].into_iter().take(axis).fold(grid.sample_bytes(), u64::saturating_mul);
        self.room_for(path, Some(across), "a slice of the grid")?;
        let band = (BAND / across.max(1)).max(1);
        let step = |axis: usize| if axis < grid.dimensions { every as usize } else { 1 };
        let mut kept = out.chunks_exact_mut(sample);
        let mut samples = Vec::new();
        let mut next = 0;
        while next < length {
            if state.is_stopped() {
                return Err("array: stopped before it was done".into());
            }
            // Where not all of a band's slices are kept, the kept ones are read alone.
            let end = if every >= band { next + 1 } else { (next + band).min(length) };
            let region = grid.region().with(axis, next..end);
            let [columns, rows, slices] = region.shape().map(|side| side as usize);
            samples.resize(columns * rows * slices * sample, 0);
            open.read(&region, &mut samples)?;
            let first = (next.next_multiple_of(every) - next) as usize;
            let from = |own: usize| if own == axis { first } else { 0 };
            for z in (from(2)..slices).step_by(step(2)) {
                for y in (from(1)..rows).step_by(step(1)) {
                    for (x, out) in (0..columns).step_by(step(0)).zip(&mut kept) {
                        let at = ((z * rows + y) * columns + x) * sample;
                        out.copy_from_slice(&samples[at..at + sample]);
                    }
                }
            }
            next = if every >= band { next.saturating_add(every) } else { end };
        }
        Ok(())
    }
}
