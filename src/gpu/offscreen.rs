//! The adapter that draws pictures which no window shows.

use super::depiction::request_nodes;
use super::view::Backend;
use super::volume::VolumeRenderer;
use super::{HeadlessRequest, device, render_headless};
use crate::cpu::volume::RayCaster;
use crate::picture::adapter::{Adapter, AdapterFrame, AdapterJob, Passes};
use std::sync::Arc;

/// The best adapter there is, opened when something is to be drawn.
#[derive(Debug, Default)]
pub struct Offscreen {
    is_card: Option<bool>,
}

impl Adapter for Offscreen {
    fn is_card(&mut self) -> bool {
        let probe = || device::probe().is_ok_and(|adapter| adapter.device_type != wgpu::DeviceType::Cpu);
        *self.is_card.get_or_insert_with(probe)
    }

    fn draw(&mut self, job: &AdapterJob<'_>) -> Result<AdapterFrame, String> {
        let AdapterJob { view, depiction, metadata, nodes, plan, passes, repeat } = *job;
        let backend = match passes {
            Passes::Best => Backend::Auto,
            Passes::Compute => Backend::Compute,
            Passes::Raster => Backend::Raster,
        };
        let request = request_nodes(view, depiction, metadata, nodes, plan, backend);
        let frame = render_headless(HeadlessRequest { repeat, ..request }).map_err(|error| error.to_string())?;
        let passes = frame.stats.passes.medians().map(|(pass, time)| (pass.to_owned(), time));
        Ok(AdapterFrame {
            accumulation: frame.accumulation,
            splats: frame.stats.splats,
            backend: frame.stats.backend,
            adapter: frame.stats.adapter,
            milliseconds: passes.chain([("frame".to_owned(), frame.stats.frame)]).collect(),
        })
    }

    fn caster(&mut self) -> Result<Arc<dyn RayCaster>, String> {
        let renderer = VolumeRenderer::open(&Default::default()).map_err(|error| error.to_string())?;
        Ok(Arc::new(renderer))
    }
}
