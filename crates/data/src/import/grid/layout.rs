//! Where the samples of a grid lie in its storage, and how a box of them is gathered.

use super::super::ImportError;
use super::super::bytes::Order;
use super::scratch::Storage;
use crate::model::{Grid, Region};
use std::path::Path;

/// Byte offset of the first sample and distances between neighbours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Layout {
    /// Byte of the first sample.
    pub offset: u64,
    /// Bytes from one sample to the next: among channels, and along the three axes.
    pub strides: [u64; 4],
    /// The order of a sample's bytes.
    pub order: Order,
}

/// The byte order of this machine.
pub(super) const NATIVE: Order = Order::NATIVE;

/// Channels of a sample side by side, then x, y, z.
pub(super) const INTERLEAVED: [usize; 4] = [0, 1, 2, 3];

/// One whole grid for each channel.
pub(super) const PLANAR: [usize; 4] = [1, 2, 3, 0];

impl Layout {
    /// Samples without gaps, of which the axes (0: channels, 1 to 3: x, y, z) follow each other as `axes` says, the fastest
    /// first.
    pub(super) fn packed(grid: &Grid, axes: [usize; 4], offset: u64, order: Order) -> Layout {
        let mut stride = grid.sample_type.size() as u64;
        let mut strides = [0; 4];
        for axis in axes {
            strides[axis] = stride;
            stride = stride.saturating_mul(extents(grid)[axis]);
        }
        Layout { offset, strides, order }
    }

    /// Fills `out` with the samples of a box: channels, x, y, z, in this machine's byte order.
    ///
    /// # Errors
    /// When the storage cannot be read.
    pub(super) fn gather(
        &self,
        grid: &Grid,
        storage: &Storage,
        path: &Path,
        region: &Region,
        out: &mut [u8],
    ) -> Result<(), ImportError> {
        let size = grid.sample_type.size();
        let shape = region.shape();
        let counts = [grid.channels.len() as u64, shape[0], shape[1], shape[2]];
        let starts = [0, region.min[0], region.min[1], region.min[2]];
        let base: u64 =
            self.offset + starts.iter().zip(self.strides).map(|(start, stride)| start * stride).sum::<u64>();
        let mut places = [size as u64; 4];
        for axis in 1..4 {
            places[axis] = places[axis - 1] * counts[axis - 1];
        }
        let mut axes: Vec<Axis> = (0..4)
            .filter(|&axis| counts[axis] > 1)
            .map(|axis| Axis {
                count: counts[axis],
                is_whole: counts[axis] == extents(grid)[axis],
                from: self.strides[axis],
                to: places[axis],
            })
            .collect();
        axes.sort_by_key(|axis| axis.from);
        // What lies in one piece: axes that continue each other, all but the last of them whole.
        let mut piece = size as u64;
        let mut inner = 0;
        while let Some(axis) = axes.get(inner).filter(|axis| axis.from == piece) {
            piece *= axis.count;
            inner += 1;
            if !axis.is_whole {
                break;
            }
        }
        let (inner, outer) = axes.split_at(inner);
        // Whether the piece goes to one place as it is.
        let mut reach = size as u64;
        let is_straight = inner.iter().all(|axis| {
            let continues = axis.to == reach;
            reach *= axis.count;
            continues
        });
        let mut buffer = if is_straight { Vec::new() } else { vec![0; piece as usize] };
        each(outer, &mut |from, to| {
            if is_straight {
                return match out.get_mut(to as usize..(to + piece) as usize) {
                    Some(out) => storage.read(path, base + from, out),
                    None => Ok(()),
                };
            }
            storage.read(path, base + from, &mut buffer)?;
            each(inner, &mut |from, place| {
                let sample = buffer.get(from as usize..from as usize + size);
                let place = (to + place) as usize;
                if let (Some(sample), Some(out)) = (sample, out.get_mut(place..place + size)) {
                    out.copy_from_slice(sample);
                }
                Ok(())
            })
        })?;
        if self.order != NATIVE && size > 1 {
            out.chunks_exact_mut(size).for_each(<[u8]>::reverse);
        }
        Ok(())
    }
}

/// Channels and samples along each axis.
fn extents(grid: &Grid) -> [u64; 4] {
    [grid.channels.len() as u64, grid.shape[0], grid.shape[1], grid.shape[2]]
}

/// One axis of a box: samples along it, whether these are all of the grid's, and the bytes between them there and here.
struct Axis {
    count: u64,
    is_whole: bool,
    from: u64,
    to: u64,
}

/// Calls `visit` with the byte offsets, there and here, of all combinations of places along `axes`, the first fastest.
fn each(axes: &[Axis], visit: &mut dyn FnMut(u64, u64) -> Result<(), ImportError>) -> Result<(), ImportError> {
    let mut at = [0_u64; 4];
    loop {
        let (mut from, mut to) = (0, 0);
        for (axis, at) in axes.iter().zip(at) {
            from += axis.from * at;
            to += axis.to * at;
        }
        visit(from, to)?;
        let mut axis = 0;
        loop {
            let Some(along) = axes.get(axis) else { return Ok(()) };
            at[axis] += 1;
            if at[axis] < along.count {
                break;
            }
            at[axis] = 0;
            axis += 1;
        }
    }
}
