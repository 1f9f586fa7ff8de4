//! A picture larger than an adapter can hold is drawn in parts of one size, which meet without a seam: what is accumulated is
//! joined, colours come after that.

use super::capabilities::Technique;
use super::splat::layout::Grids;
use super::splat::raster;
use super::view::Footprint;
use crate::color::Accumulation;
use crate::view::View;
use wgpu::Limits;

/// Pixels of a part at most: its pyramid and what is read back of it are a gigabyte each.
const MOST_PIXELS: u64 = 1 << 26;
/// Parts are not made smaller than this along either side, pixels.
const SMALLEST: u32 = 16;
/// Bytes of a cell, with a quarter more for buffers that have room to grow.
const CELL_BYTES: u64 = 10;

/// How a picture is divided.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Parts {
    whole: [u32; 2],
    part: [u32; 2],
    counts: [u32; 2],
}

impl Parts {
    /// As few parts as an adapter with these limits can hold, one by one; `None` where it cannot hold even small ones.
    pub fn of(view: &View, footprint: Footprint, technique: Technique, limits: &Limits) -> Option<Parts> {
        let whole = [view.width, view.height];
        let mut parts = Parts { whole, part: whole, counts: [1, 1] };
        while !fits(&parts.view(view, 0), footprint, technique, limits) {
            let longer = usize::from(parts.part[1] > parts.part[0]);
            if parts.part[longer] <= SMALLEST {
                return None;
            }
            // As many as make them smaller; rounded up, fewer may do.
            let count = whole[longer].div_ceil(parts.part[longer] - 1);
            parts.part[longer] = whole[longer].div_ceil(count);
            parts.counts[longer] = whole[longer].div_ceil(parts.part[longer]);
        }
        Some(parts)
    }

    /// Number of parts.
    pub fn count(&self) -> usize {
        self.counts[0] as usize * self.counts[1] as usize
    }

    /// Width and height of each, pixels: the last ones may reach beyond the picture.
    pub fn size(&self) -> [u32; 2] {
        self.part
    }

    fn corner(&self, index: usize) -> [u32; 2] {
        let across = self.counts[0] as usize;
        [(index % across) as u32 * self.part[0], (index / across) as u32 * self.part[1]]
    }

    /// The view of a part.
    pub fn view(&self, whole: &View, index: usize) -> View {
        match self.count() {
            1 => *whole,
            _ => whole.part(self.corner(index).map(f64::from), self.part[0], self.part[1]),
        }
    }

    /// Puts a part where it belongs.
    pub fn join(&self, whole: &mut Accumulation, part: &Accumulation, index: usize) {
        self.join_values(&mut whole.p, &part.p, index);
        self.join_values(&mut whole.ps, &part.ps, index);
    }

    /// Puts the values of a part's pixels where they belong.
    pub fn join_values<T: Copy>(&self, whole: &mut [T], part: &[T], index: usize) {
        let [left, top] = self.corner(index).map(|pixels| pixels as usize);
        let [width, height] = self.whole.map(|pixels| pixels as usize);
        let stride = self.part[0] as usize;
        let (columns, rows) = (stride.min(width - left), (self.part[1] as usize).min(height - top));
        for (y, line) in part.chunks(stride).take(rows).enumerate() {
            let start = (top + y) * width + left;
            whole[start..start + columns].copy_from_slice(&line[..columns]);
        }
    }
}

/// Whether an adapter can hold all of a view.
fn fits(view: &View, footprint: Footprint, technique: Technique, limits: &Limits) -> bool {
    let grids = Grids::new(view, footprint, true, 0.0, false);
    let (cells, [width, height]) = match technique {
        Technique::Compute => (u64::from(grids.cells), [view.width, view.height]),
        Technique::Raster => (u64::from(raster::stride(view.width)) * u64::from(view.height), grids.uniform.atlas),
    };
    let most = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
    width.max(height) <= limits.max_texture_dimension_2d
        && u64::from(view.width) * u64::from(view.height) <= MOST_PIXELS
        && CELL_BYTES * cells + 256 <= most
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed helper fails its test")]
mod tests {
    use super::*;
    use crate::model::Kernel;
    use crate::view::Projection;
    use glam::DVec3;

    fn view(width: u32, height: u32) -> View {
        let projection = Projection::Perspective { fov_y: 0.7 };
        View::look_at(DVec3::new(1.0, 2.0, 9.0), DVec3::ZERO, DVec3::Y, projection, width, height).unwrap()
    }

    fn parts(width: u32, height: u32, technique: Technique, limits: &Limits) -> Option<Parts> {
        Parts::of(&view(width, height), Footprint::Kernel(Kernel::CubicSpline), technique, limits)
    }

    #[test]
    fn a_picture_that_fits_is_one_part_and_others_are_as_few_as_fit() {
        let limits = Limits { max_storage_buffer_binding_size: 1 << 31, max_buffer_size: 1 << 32, ..Limits::default() };
        let compute = |width, height| parts(width, height, Technique::Compute, &limits).unwrap();
        assert_eq!((compute(8192, 8192).count(), compute(8192, 8192).size()), (1, [8192, 8192]));
        assert_eq!((compute(8193, 100).counts, compute(8193, 100).size()), ([2, 1], [4097, 100]));
        assert_eq!(compute(20000, 12000).counts, [3, 2]);
        // The coarser levels lie beside the finest.
        let raster = parts(8192, 4000, Technique::Raster, &limits).unwrap();
        assert_eq!(raster.counts, [2, 1]);
        let small = Limits { max_storage_buffer_binding_size: 1 << 20, ..limits };
        assert!(parts(1000, 1000, Technique::Compute, &small).unwrap().count() >= 10);
        let none = Limits { max_buffer_size: 100, ..Limits::default() };
        assert_eq!(parts(1000, 1000, Technique::Compute, &none), None);
    }

    /// Every pixel is in one part, and its ray there is the one that it has in the whole.
    #[test]
    fn parts_make_the_whole() {
        let limits = Limits { max_texture_dimension_2d: 41, ..Limits::default() };
        let whole = view(100, 83);
        let parts = Parts::of(&whole, Footprint::Pixels { radius: 1.0 }, Technique::Compute, &limits).unwrap();
        assert_eq!((parts.count(), parts.size()), (9, [34, 28]));
        let mut joined = Accumulation::new(100, 83, true);
        for index in 0..parts.count() {
            let view = parts.view(&whole, index);
            let mut part = Accumulation::new(34, 28, true);
            for (i, (p, ps)) in part.p.iter_mut().zip(&mut part.ps).enumerate() {
                let ray = view.to_camera(view.at_depth([(i % 34) as f64 + 0.5, (i / 34) as f64 + 0.5], 1.0));
                (*p, *ps) = (ray.x as f32, ray.y as f32);
            }
            parts.join(&mut joined, &part, index);
        }
        for (i, (p, ps)) in joined.p.iter().zip(&joined.ps).enumerate() {
            let ray = whole.to_camera(whole.at_depth([(i % 100) as f64 + 0.5, (i / 100) as f64 + 0.5], 1.0));
            assert!((f64::from(*p) - ray.x).abs() < 1e-6 && (f64::from(*ps) - ray.y).abs() < 1e-6, "pixel {i}");
        }
    }
}
