//! Who draws the modes of the perspective grid in the window: the graphics adapter by compute passes, where the preset lets
//! it and it is more than the processor in disguise; else the processor.

use super::look::Look;
use super::preset::{Backend, Preset};
use super::shader_reload::ShaderTexts;
use crate::cpu::volume::{CpuRayCaster, RayCaster};
use crate::gpu::{Capabilities, VolumeRenderer, Withheld};
use bevy::prelude::*;
use bevy::render::renderer::{RenderAdapter, RenderAdapterInfo, RenderDevice, RenderQueue};
use std::sync::Arc;
use wgpu::DeviceType;

/// What draws.
#[derive(Resource, Debug)]
pub struct VolumeCaster {
    caster: Arc<dyn RayCaster>,
    on_adapter: bool,
    /// Whether the adapter is not asked any more.
    gave_up: bool,
    /// Whether it may keep something from picture to picture.
    keeps: bool,
}

impl Default for VolumeCaster {
    fn default() -> VolumeCaster {
        VolumeCaster { caster: Arc::new(CpuRayCaster), on_adapter: false, gave_up: false, keeps: false }
    }
}

impl VolumeCaster {
    /// What draws, for a picture.
    pub fn caster(&mut self) -> Arc<dyn RayCaster> {
        self.keeps = true;
        Arc::clone(&self.caster)
    }

    /// Frees what the pictures before have left, while other modes are shown.
    pub fn rest(&mut self) {
        if self.keeps {
            self.keeps = !self.caster.rest();
        }
    }

    /// Whether that is an adapter.
    pub fn is_on_adapter(&self) -> bool {
        self.on_adapter
    }

    /// Leaves everything to the processor from now on.
    pub fn give_up(&mut self) {
        *self = VolumeCaster { gave_up: true, ..VolumeCaster::default() };
    }
}

/// Whether an adapter draws, for a preset's backend.
fn wants_adapter(backend: Backend, compute: bool, device: DeviceType) -> bool {
    match backend {
        // A driver without a graphics card draws on the processor too, and slower than our own renderer.
        Backend::Auto => compute && device != DeviceType::Cpu,
        Backend::Compute => compute,
        Backend::Raster | Backend::Cpu => false,
    }
}

/// Follows the preset, and shaders that have changed: those are drawn with from the next picture on.
pub(super) fn choose_caster(
    preset: Res<Preset>,
    shaders: Res<ShaderTexts>,
    device: Option<Res<RenderDevice>>,
    queue: Option<Res<RenderQueue>>,
    adapter: Option<Res<RenderAdapter>>,
    info: Option<Res<RenderAdapterInfo>>,
    mut caster: ResMut<VolumeCaster>,
    look: Option<ResMut<Look>>,
) {
    if shaders.is_changed() && !shaders.is_added() {
        *caster = VolumeCaster::default();
        if let Some(mut look) = look {
            look.depiction_revision += 1;
        }
    }
    let graphics = device.zip(queue).zip(adapter).zip(info);
    let able = graphics.map(|(((device, queue), adapter), info)| {
        let capabilities = Capabilities::of(&device, &adapter, &info, Withheld::default());
        (device, queue, adapter, info, capabilities)
    });
    let wanted = able.filter(|(.., info, capabilities)| {
        wants_adapter(preset.drawing.backend, capabilities.compute, info.device_type)
    });
    match wanted {
        Some((device, queue, adapter, info, capabilities)) if !caster.on_adapter && !caster.gave_up => {
            let name = format!("{} ({})", info.name, info.driver_info);
            let (device, queue) = (device.clone(), queue.clone());
            let renderer = VolumeRenderer::new(device, queue, &adapter, name, &capabilities, &shaders.0);
            *caster = VolumeCaster { caster: Arc::new(renderer), on_adapter: true, ..VolumeCaster::default() };
        }
        None if caster.on_adapter => *caster = VolumeCaster::default(),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn software_adapters_draw_only_when_asked() {
        assert!(wants_adapter(Backend::Auto, true, DeviceType::DiscreteGpu));
        assert!(!wants_adapter(Backend::Auto, true, DeviceType::Cpu));
        assert!(wants_adapter(Backend::Compute, true, DeviceType::Cpu));
        assert!(!wants_adapter(Backend::Compute, false, DeviceType::DiscreteGpu));
        assert!(!wants_adapter(Backend::Raster, true, DeviceType::DiscreteGpu));
        assert!(!wants_adapter(Backend::Cpu, true, DeviceType::DiscreteGpu));
    }
}
