//! Opens the graphics adapter, with errors as values.
//!
//! Bevy's own initialisation panics where no adapter is found; a program without a display should say instead what to
//! install. `WGPU_ADAPTER_NAME`, `WGPU_BACKEND` and `WGPU_POWER_PREF` choose among several adapters.

use super::capabilities::{Capabilities, Technique, Withheld};
use super::view::Backend;
use bevy::render::renderer::{
    RenderAdapter, RenderAdapterInfo, RenderDevice, RenderInstance, RenderQueue, WgpuWrapper,
};
use bevy::render::settings::RenderCreation;
use bevy::tasks::block_on;
use std::sync::Arc;
use thiserror::Error;
use wgpu::{
    Adapter, AdapterInfo, Backends, DeviceDescriptor, ExperimentalFeatures, Features, Instance, InstanceDescriptor,
    Limits, PowerPreference,
};

/// What can go wrong with a GPU.
#[derive(Debug, Error)]
pub enum GpuError {
    /// There is no adapter at all.
    #[error(
        "no graphics adapter found ({0}); install a Vulkan driver: on Debian, `apt-get install mesa-vulkan-drivers` \
         brings one that needs no graphics card"
    )]
    NoAdapter(String),
    /// The adapter does not give a device.
    #[error("graphics adapter {adapter}: {message}")]
    NoDevice {
        /// Its name.
        adapter: String,
        /// What the driver says.
        message: String,
    },
    /// The adapter lacks what the wanted backend needs.
    #[error("graphics adapter {adapter} lacks {missing}, which the {backend} backend needs")]
    Unsupported {
        /// Its name.
        adapter: String,
        /// The backend.
        backend: &'static str,
        /// What is missing.
        missing: &'static str,
    },
    /// A shader does not compile on this adapter.
    #[error("a shader does not compile: {0}")]
    Shader(String),
    /// The driver reported an error while drawing; it is in the log.
    #[error("the graphics driver failed while drawing {0}")]
    Failed(String),
    /// Not even the smallest part of a picture or a volume fits.
    #[error("the graphics memory is too small for a part of the picture ({0})")]
    NoRoom(String),
    /// A Cartesian grid that does not fit.
    #[error("the graphics memory is too small for the grid: at most {most} cells along its longest side fit")]
    GridTooLarge {
        /// Most cells along its longest side.
        most: u32,
    },
    /// Particle data larger than what the adapter can hold.
    #[error("{needed} bytes of particles exceed the adapter's memory budget of {budget} bytes")]
    OutOfMemory {
        /// Bytes to be drawn.
        needed: u64,
        /// Bytes that may be used.
        budget: u64,
    },
}

/// Features that are used where the adapter has them.
fn optional_features() -> Features {
    Features::FLOAT32_BLENDABLE
        | Features::TIMESTAMP_QUERY
        | Features::TIMESTAMP_QUERY_INSIDE_ENCODERS
        | Features::SUBGROUP
}

/// How to open an adapter.
#[derive(Clone, Debug, Default)]
pub struct DeviceOptions {
    /// Limits that the device must stay within, for tests of how work is split.
    pub constrained_limits: Option<Limits>,
    /// What is not used though the adapter has it.
    pub withheld: Withheld,
}

/// An open adapter.
pub struct Gpu {
    /// For Bevy's `RenderPlugin`.
    pub creation: RenderCreation,
    /// The adapter's name and driver.
    pub adapter: String,
    /// What it can do.
    pub capabilities: Capabilities,
    /// What creates buffers and pipelines.
    pub device: RenderDevice,
    /// What takes commands.
    pub queue: RenderQueue,
    /// The adapter itself.
    pub handle: RenderAdapter,
}

impl Gpu {
    /// The technique for a backend.
    ///
    /// # Errors
    /// [`GpuError::Unsupported`].
    pub fn technique(&self, backend: Backend) -> Result<Technique, GpuError> {
        self.capabilities.technique(backend).map_err(|missing| GpuError::Unsupported {
            adapter: self.adapter.clone(),
            backend: backend.name(),
            missing,
        })
    }
}

/// Opens the adapter that the environment asks for, or the fastest one.
///
/// # Errors
/// [`GpuError::NoAdapter`], [`GpuError::NoDevice`].
pub fn open(options: &DeviceOptions) -> Result<Gpu, GpuError> {
    let (instance, adapter) = block_on(find())?;
    let info = adapter.get_info();
    let name = match info.driver_info.as_str() {
        "" => info.name.clone(),
        driver => format!("{} ({driver})", info.name),
    };
    let mut limits = adapter.limits();
    if let Some(constrained) = &options.constrained_limits {
        limits = limits.or_worse_values_from(constrained);
    }
    let descriptor = DeviceDescriptor {
        label: Some("deepfield"),
        required_features: adapter.features() & optional_features(),
        required_limits: limits,
        experimental_features: ExperimentalFeatures::disabled(),
        ..DeviceDescriptor::default()
    };
    let (device, queue) = block_on(adapter.request_device(&descriptor))
        .map_err(|error| GpuError::NoDevice { adapter: name.clone(), message: error.to_string() })?;
    let device = RenderDevice::from(device);
    let adapter = RenderAdapter(Arc::new(WgpuWrapper::new(adapter)));
    let info = RenderAdapterInfo(WgpuWrapper::new(info));
    let capabilities = Capabilities::of(&device, &adapter, &info, options.withheld);
    let queue = RenderQueue(Arc::new(WgpuWrapper::new(queue)));
    let creation = RenderCreation::manual(
        device.clone(),
        queue.clone(),
        info,
        adapter.clone(),
        RenderInstance(Arc::new(WgpuWrapper::new(instance))),
    );
    Ok(Gpu { creation, adapter: name, capabilities, device, queue, handle: adapter })
}

/// What the adapter is that would be opened. Bevy panics where there is none.
///
/// # Errors
/// [`GpuError::NoAdapter`].
pub fn probe() -> Result<AdapterInfo, GpuError> {
    block_on(find()).map(|(_, adapter)| adapter.get_info())
}

/// The adapter that the environment asks for, or the fastest one, and its instance. OpenGL is started only where nothing else
/// has an adapter: it loads a compiler and a window system's libraries, for a driver that does less.
async fn find() -> Result<(Instance, Adapter), GpuError> {
    let asked = Backends::from_env().unwrap_or(Backends::all());
    let mut missing = None;
    for backends in [asked - Backends::GL, asked & Backends::GL] {
        if backends.is_empty() {
            continue;
        }
        let instance =
            Instance::new(InstanceDescriptor { backends, ..InstanceDescriptor::new_without_display_handle() });
        match find_in(&instance, backends).await {
            Ok(adapter) => return Ok((instance, adapter)),
            Err(error) => missing = missing.or(Some(error)),
        }
    }
    Err(missing.unwrap_or_else(|| GpuError::NoAdapter("WGPU_BACKEND names no backend".into())))
}

async fn find_in(instance: &Instance, backends: Backends) -> Result<Adapter, GpuError> {
    if let Ok(wanted) = std::env::var("WGPU_ADAPTER_NAME") {
        let wanted = wanted.to_lowercase();
        let all = instance.enumerate_adapters(backends).await;
        let found = all.into_iter().find(|adapter| adapter.get_info().name.to_lowercase().contains(&wanted));
        return found.ok_or_else(|| GpuError::NoAdapter(format!("none is named {wanted}")));
    }
    let options = wgpu::RequestAdapterOptions {
        power_preference: PowerPreference::from_env().unwrap_or(PowerPreference::HighPerformance),
        ..Default::default()
    };
    instance.request_adapter(&options).await.map_err(|error| GpuError::NoAdapter(error.to_string()))
}
