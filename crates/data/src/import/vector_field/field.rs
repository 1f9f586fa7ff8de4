//! A velocity field on a grid: where its nodes are, at which times, and its velocities at each of them.

use super::axis::Axis;
use super::interval::{Interval, Slab};
use super::{grids, numpy};
use crate::import::grid::{GridSource, NumpyArrays};
use crate::import::{ImportError, Times};
use crate::model::{Bounds, ReadMethod, Unit};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Velocities at so many times are kept: those that an interval needs.
const KEPT: usize = 4;

/// How a velocity field is read.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FieldOptions {
    /// Names of arrays that hold one component each, along x, y and z; none: an array of vectors, or `u`, `v` and `w`.
    pub components: Vec<String>,
    /// The field's times; `None`: those of the file, else the numbers of its steps.
    pub times: Option<Times>,
    /// Along which axes the field goes on at its other end.
    pub periodic: [bool; 3],
    /// Where its nodes are, in place of what the file says: the first and the last ones, of a periodic axis one period.
    pub bounds: Option<Bounds>,
}

/// The component of a field, or several of them, at one time: some slices of a grid.
pub(super) struct Part {
    pub source: Arc<GridSource>,
    /// The first slice.
    pub first: u64,
}

/// What a file says of a field.
pub(super) struct Stored {
    pub path: PathBuf,
    pub format: String,
    pub bytes: u64,
    /// The parts of each time, which together have two components or three, in their order.
    pub steps: Vec<Vec<Part>>,
    /// Nodes along each axis in the order of the grid, with a name for messages.
    pub nodes: [(String, Vec<f64>); 3],
    pub times: Option<Vec<f64>>,
    pub length_unit: Unit,
    pub notes: Vec<String>,
}

/// A velocity field on a grid, steady or not. Velocities of a few times are in memory, in single precision.
pub struct VectorField {
    stored: Stored,
    axes: Arc<[Axis; 3]>,
    times: Vec<f64>,
    kept: Mutex<VecDeque<(usize, Arc<Slab>)>>,
}

impl std::fmt::Debug for VectorField {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("VectorField")
            .field("path", &self.stored.path)
            .field("times", &self.times)
            .finish_non_exhaustive()
    }
}

impl VectorField {
    /// Opens a field: of one file, or of several with one time each.
    ///
    /// # Errors
    /// [`ImportError`] where a file cannot be read, holds no velocities on a grid, or contradicts itself or the options.
    pub fn open(files: &[PathBuf], options: &FieldOptions, method: ReadMethod) -> Result<VectorField, ImportError> {
        let arrays = match files {
            [only] => NumpyArrays::open(only, method)?,
            _ => None,
        };
        let stored = match arrays {
            Some(arrays) => numpy::stored(&arrays, options)?,
            None => grids::stored(files, options, method)?,
        };
        VectorField::of(stored, options)
    }

    fn of(mut stored: Stored, options: &FieldOptions) -> Result<VectorField, ImportError> {
        let path = &*stored.path;
        let count = stored.steps.len();
        let times = match (&options.times, stored.times.take()) {
            (Some(times), _) => listed(path, times, count)?,
            (None, Some(times)) => times,
            (None, None) => {
                if count > 1 {
                    stored.notes.push("times of the field are the numbers of its steps; --times says others".into());
                }
                (0..count).map(|step| step as f64).collect()
            }
        };
        let ascend = times.windows(2).all(|pair| pair[0] < pair[1]);
        let span = times.last().zip(times.first()).map(|(last, first)| last - first);
        if times.len() != count || !ascend || !span.is_some_and(f64::is_finite) {
            let found = format!("{} others", times.len());
            let expected = format!("{count} finite times, each later than the one before");
            return Err(ImportError::malformed(path, "times", found, expected));
        }
        let [x, y, z] = &mut stored.nodes;
        let new = |(name, nodes): &mut (String, Vec<f64>)| Axis::new(path, name, std::mem::take(nodes));
        let mut axes = [new(x)?, new(y)?, new(z)?];
        if axes.iter().all(Axis::is_flat) {
            return Err(ImportError::malformed(path, "shape", "one node", "several along one axis at least"));
        }
        for (number, axis) in axes.iter_mut().enumerate() {
            let is_periodic = options.periodic[number];
            if let Some(bounds) = options.bounds.filter(|_| !axis.is_flat()) {
                let (from, to) = (bounds.min[number], bounds.max[number]);
                if !(from < to && (to - from).is_finite()) {
                    let found = format!("{from} to {to} along {}", ["x", "y", "z"][number]);
                    return Err(ImportError::malformed(path, "--box", found, "the smaller end first"));
                }
                axis.within(from, to, is_periodic);
            } else if is_periodic {
                axis.repeat();
            }
        }
        Ok(VectorField { axes: Arc::new(axes), times, stored, kept: Mutex::default() })
    }

    /// The file that was named first.
    pub fn path(&self) -> &Path {
        &self.stored.path
    }

    /// Size of all files, bytes.
    pub fn bytes(&self) -> u64 {
        self.stored.bytes
    }

    /// Unit of lengths; empty when unknown.
    pub fn length_unit(&self) -> &Unit {
        &self.stored.length_unit
    }

    /// Unit of velocities; empty when unknown.
    pub fn velocity_unit(&self) -> Unit {
        let part = self.stored.steps.first().and_then(|parts| parts.first());
        part.map(|part| part.source.grid().channels[0].unit.clone()).unwrap_or_default()
    }

    /// The times of its velocities, ascending; one of a steady field.
    pub fn times(&self) -> &[f64] {
        &self.times
    }

    /// What was assumed, one sentence each.
    pub fn notes(&self) -> &[String] {
        &self.stored.notes
    }

    /// The box that it fills; of a periodic axis one period.
    pub fn bounds(&self) -> Bounds {
        let [x, y, z] = &*self.axes;
        Bounds { min: DVec3::new(x.start(), y.start(), z.start()), max: DVec3::new(x.end(), y.end(), z.end()) }
    }

    /// The edge of the periodic box, where it goes on at all faces of a cube; a flat one at all edges of a square.
    pub fn periodic_edge(&self) -> Option<f64> {
        let mut axes = self.axes.iter().filter(|axis| !axis.is_flat());
        let edge = axes.next().filter(|axis| axis.is_periodic()).map(|axis| axis.end() - axis.start())?;
        let is_same = |axis: &Axis| axis.is_periodic() && (axis.end() - axis.start() - edge).abs() <= 1e-6 * edge;
        axes.all(is_same).then_some(edge)
    }

    /// Its nodes and times in words.
    pub fn described(&self) -> String {
        let nodes: Vec<String> =
            self.axes.iter().filter(|axis| !axis.is_flat()).map(|axis| axis.len().to_string()).collect();
        let nodes = format!("{} ({} nodes)", self.stored.format, nodes.join(" x "));
        match &self.times[..] {
            [first, .., last] => format!("{nodes} at {} times from {first} to {last}", self.times.len()),
            _ => nodes,
        }
    }

    /// The axes of its grid.
    pub(super) fn axes(&self) -> &Arc<[Axis; 3]> {
        &self.axes
    }

    /// The field around a time: up to its next one.
    ///
    /// # Errors
    /// [`ImportError`] where it has no such time, or cannot be read.
    pub fn interval(&self, time: f64) -> Result<Interval, ImportError> {
        let (Some(first), Some(last)) = (self.times.first(), self.times.last()) else {
            return Err(ImportError::missing(self.path(), "times", "one at least"));
        };
        if self.times.len() == 1 {
            return Ok(Interval::steady(&self.axes, self.slab(0)?));
        }
        if !(*first..=*last).contains(&time) {
            let expected = format!("{first} to {last}, the times of the field");
            return Err(ImportError::malformed(self.path(), "time", time, expected));
        }
        let step = self.times.partition_point(|own| *own <= time).saturating_sub(1).min(self.times.len() - 2);
        let numbers = [step.checked_sub(1), Some(step), Some(step + 1), Some(step + 2)];
        let (mut slabs, mut times) = ([None, None, None, None], [0.0; 4]);
        for (place, number) in numbers.into_iter().enumerate() {
            let Some((number, own)) = number.and_then(|number| Some((number, *self.times.get(number)?))) else {
                continue;
            };
            (slabs[place], times[place]) = (Some(self.slab(number)?), own);
        }
        Ok(Interval::unsteady(&self.axes, slabs, times))
    }

    /// The velocities at one of its times.
    fn slab(&self, step: usize) -> Result<Arc<Slab>, ImportError> {
        let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, slab)) = kept.iter().find(|(number, _)| *number == step) {
            return Ok(Arc::clone(slab));
        }
        // The oldest goes before the new one takes its room.
        kept.truncate(KEPT - 1);
        let slab = Arc::new(self.read(step)?);
        kept.push_front((step, Arc::clone(&slab)));
        Ok(slab)
    }

    fn read(&self, step: usize) -> Result<Slab, ImportError> {
        let [x, y, z] = &*self.axes;
        let parts = self.stored.steps.get(step).map(Vec::as_slice).unwrap_or_default();
        let mut slab: Slab = vec![[0.0; 3]; x.len() * y.len() * z.len()];
        let turned = |axis: &Axis, node: usize| if axis.is_reversed() { axis.len() - 1 - node } else { node };
        slab.par_chunks_mut(x.len() * y.len()).enumerate().try_for_each_init(
            || (Vec::new(), Vec::new()),
            |(bytes, values), (number, plane)| {
                let slice = turned(z, number) as u64;
                let mut component = 0;
                for part in parts {
                    let grid = part.source.grid();
                    let at = part.first + slice;
                    bytes.resize(plane.len() * grid.sample_bytes() as usize, 0);
                    part.source.read(&grid.region().with(2, at..at + 1), bytes)?;
                    let size = grid.sample_type.size();
                    for (number, channel) in grid.channels.iter().enumerate() {
                        values.clear();
                        grid.sample_type.decode(&bytes[number * size..], grid.channels.len(), values);
                        let along = component;
                        component += 1;
                        // Nothing goes across a field without thickness.
                        if self.axes.get(along).is_none_or(Axis::is_flat) {
                            continue;
                        }
                        for (node, velocity) in plane.iter_mut().enumerate() {
                            let (column, row) = (turned(x, node % x.len()), turned(y, node / x.len()));
                            let value = values.get(row * x.len() + column).copied().unwrap_or(f64::NAN);
                            let is_none = channel.no_data == Some(value);
                            velocity[along] = if is_none { f32::NAN } else { channel.scale.value(value) as f32 };
                        }
                    }
                }
                Ok::<(), ImportError>(())
            },
        )?;
        Ok(slab)
    }
}

/// So many times that options say.
fn listed(path: &Path, times: &Times, count: usize) -> Result<Vec<f64>, ImportError> {
    match times {
        Times::Steps => Ok((0..count).map(|step| step as f64).collect()),
        Times::Even { from, step } => Ok((0..count).map(|number| from + step * number as f64).collect()),
        Times::List(list) if list.len() == count => Ok(list.clone()),
        Times::List(list) => {
            let found = format!("{} times", list.len());
            Err(ImportError::malformed(path, "--times", found, format!("{count}, as many as the field has")))
        }
    }
}
