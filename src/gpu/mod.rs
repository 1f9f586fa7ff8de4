//! The techniques on the GPU, as Bevy render plugins.
//!
//! How the main world draws particles:
//!
//! 1. Insert a [`ParticleScene`] resource, then add [`DeepfieldRenderPlugins`] (after Bevy's own plugins).
//! 2. [`ParticleScene::insert_nodes`] queues nodes for upload, [`ParticleScene::insert_table`] what their codes mean in
//!    one mode; [`ParticleScene::node_state`] tells what is resident, [`ParticleScene::remove_nodes`] frees.
//! 3. A camera with a [`SplatView`] accumulates `P` and `P S` of its list of nodes; with a [`Composite`] it shows them in
//!    its target. Replace the component's list to change what is drawn, [`SplatView::view`] to move the camera. An
//!    unchanged picture is not accumulated again.
//! 4. [`timing::PassTimes`] collects milliseconds per pass, [`ParticleScene::stats`] memory.
//!
//! [`render_headless`] does all that for one picture without a window.

pub mod arena;
pub mod capabilities;
pub mod composite;
pub mod depiction;
pub mod device;
pub mod environment;
pub mod headless;
pub mod mode_view;
pub mod offscreen;
pub mod page_copies;
pub mod parts;
pub mod plugins;
pub mod readback;
pub mod renderer;
pub mod scene;
pub mod shaders;
pub mod splat;
pub mod timing;
pub mod view;
pub mod volume;

pub use capabilities::{Capabilities, Technique, Withheld};
pub use device::{DeviceOptions, Gpu, GpuError, open};
pub use headless::{HeadlessFrame, HeadlessNode, HeadlessRequest, HeadlessStats, render_headless};
pub use mode_view::{ModePlugin, ModeView};
pub use offscreen::Offscreen;
pub use renderer::HeadlessRenderer;
pub use scene::{NodeId, NodeState, NodeUpload, ParticleScene, Payload, RawParticle, SceneStats, TableEntry, TableId};
pub use view::{Backend, Composite, DrawItem, Fading, Footprint, SplatView};
pub use volume::VolumeRenderer;

use bevy::app::{PluginGroup, PluginGroupBuilder};
use bevy::render::diagnostic::RenderDiagnosticsPlugin;

/// Everything that draws. Needs a [`ParticleScene`] in the world, and Bevy's plugins before it.
pub struct DeepfieldRenderPlugins;

impl PluginGroup for DeepfieldRenderPlugins {
    fn build(self) -> PluginGroupBuilder {
        PluginGroupBuilder::start::<Self>()
            .add(shaders::ShaderPlugin)
            .add(splat::SplatPlugin)
            .add(composite::CompositePlugin)
            .add(RenderDiagnosticsPlugin)
            .add(plugins::OtherCrates)
    }
}
