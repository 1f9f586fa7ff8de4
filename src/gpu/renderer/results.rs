//! What has been drawn, read back: sums, light and colours, and what was seen and counted.

use super::HeadlessRenderer;
use crate::color::composite::Image as Picture;
use crate::color::transfer::TransferFunction;
use crate::color::{Accumulation, Colors};
use crate::cpu::overdraw::{Differences, Overdraw};
use crate::cpu::screen_spheres::Front;
use crate::cpu::shadowing::Covering;
use crate::gpu::device::GpuError;
use crate::gpu::readback::{read_buffer, read_texture};
use crate::gpu::spheres::{self, Spheres};
use crate::gpu::splat::{Bindings, CountOverdraw, OverdrawBuffers, SplatPipelines};
use crate::gpu::surface::seen;
use crate::gpu::surface::work::SurfaceWork;
use crate::gpu::tiles::TileBindings;
use crate::gpu::view::{Backend, Composite};
use crate::gpu::volume::{VolumeWork, covering};
use bevy::render::render_asset::RenderAssets;
use bevy::render::texture::GpuImage;
use std::sync::atomic::Ordering;
use std::time::Instant;

impl HeadlessRenderer {
    /// Counts the splats over each pixel; the picture is not drawn.
    ///
    /// # Errors
    /// [`GpuError`]: an adapter without compute shaders, a shader that does not compile, or the driver fails.
    pub fn overdraw(&mut self) -> Result<Overdraw, GpuError> {
        let lacks = |pipelines: &SplatPipelines| pipelines.capabilities.technique(Backend::Compute).err();
        if let Some(missing) = self.render_world().get_resource().and_then(lacks) {
            return Err(GpuError::Unsupported { adapter: self.adapter.clone(), backend: "compute", missing });
        }
        self.insert(CountOverdraw);
        let start = Instant::now();
        let differences = loop {
            self.frame()?;
            if let Some(differences) = self.differences()? {
                break differences;
            }
            self.check_shaders(start)?;
        };
        self.app.world_mut().entity_mut(self.camera).remove::<CountOverdraw>();
        Ok(differences.sum())
    }

    /// What has been counted, once it is.
    fn differences(&mut self) -> Result<Option<Differences>, GpuError> {
        let (device, queue) = self.device();
        let world = self.render_world();
        let mut query = world.query::<&OverdrawBuffers>();
        let Some(buffers) = query.iter(world).next().filter(|buffers| buffers.counted.load(Ordering::Relaxed)) else {
            return Ok(None);
        };
        let ([width, height], bytes) = (buffers.size, buffers.bytes());
        let found = read_buffer(&device, &queue, &buffers.differences, 0, bytes);
        let found = found.ok_or_else(|| GpuError::Failed("(reading the overdraw back)".into()))?;
        Ok(Some(Differences::found(width, height, bytemuck::pod_collect_to_vec(&found))))
    }

    /// Reads the accumulation back, and the number of splats where the technique counts them.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn accumulation(&mut self, attribute: bool) -> Result<(Accumulation, Option<u64>), GpuError> {
        let failed = || GpuError::Failed("(reading the picture back)".into());
        let (device, queue) = self.device();
        let size = self.size;
        let buffers = self.buffers().ok_or_else(failed)?;
        let (width, stride) = (size.x as usize, buffers.stride as usize);
        let bytes = 8 * u64::from(buffers.stride) * u64::from(size.y);
        let cells = read_buffer(&device, &queue, &buffers.shared.cells, 0, bytes).ok_or_else(failed)?;
        let splats = match &buffers.bindings {
            Some(Bindings::Compute(bindings)) => {
                // What is outside comes last and is not counted.
                let outside = u64::from(buffers.grids.uniform.bin_count - 1) * 4;
                let counted = read_buffer(&device, &queue, &bindings.starts, outside, 4).ok_or_else(failed)?;
                counted.first_chunk::<4>().map(|bytes| u64::from(u32::from_le_bytes(*bytes)))
            }
            Some(Bindings::Raster(_)) | None => None,
        };
        let cells: &[[f32; 2]] = bytemuck::cast_slice(&cells);
        let cells = cells.chunks(stride).flat_map(|row| &row[..width.min(row.len())]);
        let mut accumulation = Accumulation::new(size.x, size.y, attribute);
        for (index, cell) in cells.enumerate() {
            accumulation.p[index] = cell[0];
            if let Some(ps) = accumulation.ps.get_mut(index) {
                *ps = cell[1];
            }
        }
        Ok((accumulation, splats))
    }

    /// Reads the light of the camera's passes back.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn light(&mut self) -> Result<Colors, GpuError> {
        let failed = || GpuError::Failed("(reading the light back)".into());
        let (device, queue) = self.device();
        let cells = self.cells().ok_or_else(failed)?;
        let [width, height] = cells.size;
        let bytes = 16 * u64::from(width) * u64::from(height);
        let rgba = read_buffer(&device, &queue, &cells.buffer, 0, bytes).ok_or_else(failed)?;
        Ok(Colors { width, height, rgba: bytemuck::pod_collect_to_vec(&rgba) })
    }

    /// Colours the picture and reads it back.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn colors(&mut self, transfer: &TransferFunction, accumulation: &Accumulation) -> Result<Picture, GpuError> {
        let composite = Composite::new(transfer, transfer.levels(accumulation), accumulation.has_attribute());
        self.insert(composite);
        self.shown()
    }

    /// Reads back what the camera's target shows.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn shown(&mut self) -> Result<Picture, GpuError> {
        // The first frame compiles the pipeline.
        for _ in 0..3 {
            self.frame()?;
        }
        let failed = || GpuError::Failed("(reading the colours back)".into());
        let (device, queue) = self.device();
        let (target, size) = (self.target.clone(), self.size);
        let images = self.render_world().resource::<RenderAssets<GpuImage>>();
        let image = images.get(&target).ok_or_else(failed)?;
        let rgba = read_texture(&device, &queue, &image.texture, size).ok_or_else(failed)?;
        Ok(Picture { width: size.x, height: size.y, rgba })
    }

    /// Reads back the number of what each sample of the heights shows that were drawn last, row by row.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn surface_seen(&mut self) -> Result<Vec<u32>, GpuError> {
        let (device, queue) = self.device();
        let world = self.render_world();
        let mut query = world.query::<&SurfaceWork>();
        let found = query.iter(world).next().and_then(|work| seen::numbers(work, &device, &queue));
        found.ok_or_else(|| GpuError::Failed("(reading back what is seen)".into()))
    }

    /// Reads back how many pixels of the heights that were drawn last, in colours, are covered by what was measured.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn surface_covered(&mut self) -> Result<f64, GpuError> {
        let (device, queue) = self.device();
        let world = self.render_world();
        let mut query = world.query::<&SurfaceWork>();
        let found = query.iter(world).next().and_then(|work| seen::covered(work, &device, &queue));
        found.ok_or_else(|| GpuError::Failed("(reading back what is covered)".into()))
    }

    /// Reads back the surface of the spheres that were drawn last.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn spheres_shown(&mut self) -> Result<Front, GpuError> {
        let (device, queue) = self.device();
        let world = self.render_world();
        let mut query = world.query::<&TileBindings<Spheres>>();
        let found = query.iter(world).next().and_then(|bindings| spheres::shown(bindings, &device, &queue));
        found.ok_or_else(|| GpuError::Failed("(reading back the spheres that are seen)".into()))
    }

    /// Reads back what covers each pixel of the volume that was drawn last, of one that keeps it.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub fn volume_covering(&mut self) -> Result<Covering, GpuError> {
        let (device, queue) = self.device();
        let world = self.render_world();
        let mut query = world.query::<&VolumeWork>();
        let found = query.iter(world).next().and_then(|work| covering::read(work, &device, &queue));
        found.ok_or_else(|| GpuError::Failed("(reading back what covers the pixels)".into()))
    }
}
