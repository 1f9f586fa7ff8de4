//! Which techniques an adapter can carry out.

use super::view::Backend;
use bevy::prelude::Resource;
use bevy::render::renderer::{RenderAdapter, RenderAdapterInfo, RenderDevice};
use wgpu::{DownlevelFlags, Features};

/// A way to accumulate particles.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Technique {
    /// Compute passes.
    Compute,
    /// Blended quads.
    Raster,
}

impl Technique {
    /// Its name in messages and statistics.
    pub fn name(self) -> &'static str {
        match self {
            Technique::Compute => "compute",
            Technique::Raster => "raster",
        }
    }
}

/// What is not used though the adapter has it, so that tests see how others are served. In the main world, before the
/// plugins.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Withheld {
    /// Compute shaders.
    pub compute: bool,
    /// Blending of 32-bit floats.
    pub blending: bool,
    /// Subgroups.
    pub subgroup: bool,
}

/// What an adapter can do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capabilities {
    /// Compute shaders with as many storage buffers as the passes bind.
    pub compute: bool,
    /// Blending of 32-bit floats, and storage buffers in vertex shaders.
    pub raster: bool,
    /// Subgroups of exactly eight: a processor's vectors.
    pub vector_subgroups: bool,
    /// Whether a processor is the adapter.
    pub is_software: bool,
}

/// Storage buffers that one shader binds at most: `project.wgsl`.
const COMPUTE_STORAGE_BUFFERS: u32 = 8;
/// The same for `blend.wgsl`.
const RASTER_STORAGE_BUFFERS: u32 = 5;

impl Capabilities {
    /// Asks the adapter.
    pub fn of(
        device: &RenderDevice,
        adapter: &RenderAdapter,
        info: &RenderAdapterInfo,
        withheld: Withheld,
    ) -> Capabilities {
        let flags = adapter.get_downlevel_capabilities().flags;
        let features = device.features();
        let buffers = device.limits().max_storage_buffers_per_shader_stage;
        Capabilities {
            compute: flags.contains(DownlevelFlags::COMPUTE_SHADERS)
                && buffers >= COMPUTE_STORAGE_BUFFERS
                && !withheld.compute,
            raster: flags.contains(DownlevelFlags::VERTEX_STORAGE)
                && features.contains(Features::FLOAT32_BLENDABLE)
                && buffers >= RASTER_STORAGE_BUFFERS
                && !withheld.blending,
            vector_subgroups: features.contains(Features::SUBGROUP)
                && info.subgroup_min_size == 8
                && info.subgroup_max_size == 8
                && !withheld.subgroup,
            is_software: info.device_type == wgpu::DeviceType::Cpu,
        }
    }

    /// The technique for a backend.
    ///
    /// # Errors
    /// What the adapter lacks.
    pub fn technique(&self, backend: Backend) -> Result<Technique, &'static str> {
        match backend {
            Backend::Auto | Backend::Compute if self.compute => Ok(Technique::Compute),
            Backend::Auto | Backend::Raster if self.raster => Ok(Technique::Raster),
            Backend::Auto => Err("compute shaders, and blending of 32-bit floats"),
            Backend::Compute => Err("compute shaders with eight storage buffers"),
            Backend::Raster => Err("blending of 32-bit floats (or storage buffers in vertex shaders)"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn automatic_choice_takes_what_is_there() {
        let adapter = |compute, raster| Capabilities { compute, raster, vector_subgroups: false, is_software: false };
        for (backend, both, only_compute, only_raster, none) in [
            (Backend::Auto, Some(Technique::Compute), Some(Technique::Compute), Some(Technique::Raster), None),
            (Backend::Compute, Some(Technique::Compute), Some(Technique::Compute), None, None),
            (Backend::Raster, Some(Technique::Raster), None, Some(Technique::Raster), None::<Technique>),
        ] {
            let found = [(true, true), (true, false), (false, true), (false, false)]
                .map(|(compute, raster)| adapter(compute, raster).technique(backend).ok());
            assert_eq!(found, [both, only_compute, only_raster, none], "{backend:?}");
        }
    }
}
