//! Pictures by the camera's own passes: volumes, tiles and measured heights, drawn until what is asked for has been found out.

use super::HeadlessRenderer;
use crate::color::Colors;
use crate::cpu::volume::{FieldRange, OpaqueDepths};
use crate::gpu::device::GpuError;
use crate::gpu::integrals::{IntegralFindings, IntegralNews};
use crate::gpu::light::LightView;
use crate::gpu::surface::{SurfaceNews, SurfaceView};
use crate::gpu::tile_passes::TilePasses;
use crate::gpu::tiles::TileNews;
use crate::gpu::timing::{MeasuredPasses, median};
use crate::gpu::volume::{VolumeFindings, VolumeNews, VolumeView};
use std::sync::Arc;
use std::time::Instant;

impl HeadlessRenderer {
    /// Draws a volume of the particles, as often as asked: its light, what was found out, and the median milliseconds of its passes and
    /// of a whole picture.
    ///
    /// # Errors
    /// [`GpuError`]: a shader does not compile, the driver fails, or nothing fits.
    pub fn volume(
        &mut self,
        volume: VolumeView,
        repeat: u32,
    ) -> Result<(Colors, VolumeFindings, (MeasuredPasses, f64)), GpuError> {
        let (found, times) = self.draw_volume(volume, repeat)?;
        Ok((self.light()?, found, times))
    }

    /// The same without reading its light back.
    ///
    /// # Errors
    /// As [`HeadlessRenderer::volume`].
    pub fn draw_volume(
        &mut self,
        mut volume: VolumeView,
        repeat: u32,
    ) -> Result<(VolumeFindings, (MeasuredPasses, f64)), GpuError> {
        let mut frames = Vec::new();
        let mut passes = MeasuredPasses::default();
        self.pass_times();
        let number = volume.light.as_ref().map_or(0, |job| job.number);
        let found = loop {
            let round = frames.len() as u64;
            if let Some(job) = &mut volume.light {
                job.number = number + (round << 32);
            }
            self.insert((LightView::default(), volume.clone()));
            let wanted = volume.light.as_ref().map(|job| job.number);
            let start = Instant::now();
            let found = self.until(&mut passes, |found| match found.no_room {
                no_room if no_room.is_some() && no_room == wanted => Err(()),
                _ => Ok(found.drawn == wanted),
            })?;
            frames.push(start.elapsed().as_secs_f64() * 1e3);
            // The first one compiles the shaders.
            if frames.len() > repeat.max(1) as usize || repeat <= 1 {
                break found;
            }
        };
        if frames.len() > 1 {
            frames.remove(0);
        }
        Ok((found, (passes, median(&mut frames))))
    }

    /// Draws what passes by tiles do, as often as asked: its light, what it hides where that is asked for, and the median milliseconds
    /// of its passes and of a frame. Every picture has another number.
    ///
    /// # Errors
    /// As [`HeadlessRenderer::volume`].
    pub fn tiles(
        &mut self,
        number: u64,
        passes: TilePasses,
        repeat: u32,
    ) -> Result<(Colors, Option<Arc<OpaqueDepths>>, (MeasuredPasses, f64)), GpuError> {
        let (opaque, times) = self.draw_tiles(number, passes, repeat)?;
        Ok((self.light()?, opaque, times))
    }

    /// The same without reading its light back.
    ///
    /// # Errors
    /// As [`HeadlessRenderer::volume`].
    pub fn draw_tiles(
        &mut self,
        number: u64,
        passes: TilePasses,
        repeat: u32,
    ) -> Result<(Option<Arc<OpaqueDepths>>, (MeasuredPasses, f64)), GpuError> {
        self.insert(LightView::default());
        let world = self.app.world_mut();
        passes.show(number, u64::MAX, &mut world.commands().entity(self.camera));
        world.flush();
        let start = Instant::now();
        let mut passes = MeasuredPasses::default();
        self.pass_times();
        self.complete()?;
        let mut frames = vec![start.elapsed().as_secs_f64() * 1e3];
        passes.add(self.pass_times());
        if repeat > 1 {
            (frames, passes) = self.measure(repeat)?;
        }
        let opaque = loop {
            let found = self.app.world().resource::<TileNews>().now();
            if found.drawn == Some(number) {
                break found.opaque;
            }
            self.frame()?;
            self.check_shaders(start)?;
        };
        Ok((opaque, (passes, median(&mut frames))))
    }

    /// Draws measured heights: their light, if it is wanted, and the milliseconds of the passes and of a frame.
    ///
    /// # Errors
    /// As [`HeadlessRenderer::volume`].
    pub fn surface(&mut self, surface: SurfaceView) -> Result<(Colors, (MeasuredPasses, f64)), GpuError> {
        let (number, is_colored, [width, height]) = (surface.number, surface.is_colored, surface.job.size());
        self.insert((LightView::default(), surface));
        let start = Instant::now();
        let mut passes = MeasuredPasses::default();
        self.pass_times();
        loop {
            self.frame()?;
            passes.add(self.pass_times());
            let found = self.app.world().resource::<SurfaceNews>().now();
            match found.number == number {
                true if found.no_room => return Err(GpuError::NoRoom(format!("{width}x{height} pixels of heights"))),
                true if self.is_complete() => break,
                _ => self.check_shaders(start)?,
            }
        }
        let colors = if is_colored { self.light()? } else { Colors::default() };
        Ok((colors, (passes, 1e3 * start.elapsed().as_secs_f64())))
    }

    /// What has been found out about line integrals.
    pub fn integral_findings(&self) -> IntegralFindings {
        self.app.world().resource::<IntegralNews>().now()
    }

    /// What has been found out about the volume on its way.
    pub fn volume_findings(&self) -> VolumeFindings {
        self.app.world().resource::<VolumeNews>().now()
    }

    /// Finds between which values the mass of the particles' field lies; `None` where there is none.
    ///
    /// # Errors
    /// As [`HeadlessRenderer::volume`].
    pub fn ranges(&mut self, volume: VolumeView) -> Result<Option<FieldRange>, GpuError> {
        let wanted = volume.ranges.as_ref().map(|job| job.number);
        self.insert((LightView::default(), volume));
        let found = self.until(&mut MeasuredPasses::default(), |found| match found.no_room {
            no_room if no_room.is_some() && no_room == wanted => Err(()),
            _ => Ok(found.ranges.map(|(number, _)| number) == wanted),
        })?;
        Ok(found.ranges.and_then(|(_, range)| range))
    }

    /// Draws frames until something has been found out; there is no room for it where `is_there` fails.
    fn until(
        &mut self,
        passes: &mut MeasuredPasses,
        is_there: impl Fn(&VolumeFindings) -> Result<bool, ()>,
    ) -> Result<VolumeFindings, GpuError> {
        let start = Instant::now();
        loop {
            self.frame()?;
            passes.add(self.pass_times());
            let found = self.volume_findings();
            match is_there(&found) {
                Ok(true) => return Ok(found),
                Ok(false) => self.check_shaders(start)?,
                Err(()) => {
                    let pixels = || GpuError::NoRoom(format!("{}x{} pixels", self.size.x, self.size.y));
                    return Err(found
                        .most_cells
                        .filter(|most| *most > 1)
                        .map_or_else(pixels, |most| GpuError::GridTooLarge { most }));
                }
            }
        }
    }
}
