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
//! 4. A camera with a [`LightView`] beside its [`SplatView`] shows the light that a mode's passes draw of these nodes.
//! 5. A camera with an [`integrals::IntegralView`] accumulates line integrals of a sampled field in their place.
//! 6. A camera with a [`surface::SurfaceView`] beside its [`LightView`] shows measured heights.
//! 7. With a [`Glow`] it shows how bright light of any of these spreads.
//! 8. [`timing::PassTimer`] measures milliseconds of passes, [`ParticleScene::stats`] memory.
//!
//! [`render_headless`] does all that for one picture without a window.

pub mod answer;
pub mod arena;
pub mod bloom;
pub mod capabilities;
pub mod clusters;
pub mod column_tables;
pub mod composite;
pub mod content_look;
pub mod depiction;
pub mod device;
pub mod environment;
pub mod field_samples;
pub mod front_to_back;
pub mod headless;
pub mod integrals;
pub mod layered;
pub mod light;
pub mod matter;
pub mod measure;
pub mod mode_view;
pub mod moving;
pub mod news;
pub mod offscreen;
pub mod over_splats;
pub mod page_copies;
pub mod parts;
pub mod plugins;
pub mod readback;
pub mod renderer;
pub mod scene;
pub mod shaders;
pub mod sorted_splats;
pub mod spheres;
pub mod splat;
pub mod surface;
pub mod target;
pub mod tile_passes;
pub mod tiles;
pub mod timing;
pub mod view;
pub mod volume;

pub use bloom::Glow;
pub use capabilities::{Capabilities, Technique, Withheld};
pub use clusters::GpuCluster;
pub use device::{DeviceOptions, Gpu, GpuError, open};
pub use headless::{HeadlessFrame, HeadlessNode, HeadlessRequest, HeadlessStats, render_headless};
pub use layered::Layered;
pub use light::{LightCells, LightView};
pub use mode_view::{ModePlugin, ModeView};
pub use offscreen::Offscreen;
pub use over_splats::OverSplats;
pub use renderer::HeadlessRenderer;
pub use scene::{
    NodeId, NodeState, NodeUpload, ParticleScene, Payload, RawParticle, SceneStats, Table, TableEntry, TableId,
};
pub use sorted_splats::SortedSplats;
pub use spheres::Spheres;
pub use tiles::TilePicture;
pub use view::{Backend, Composite, DrawItem, Fading, Footprint, SplatView};
pub use volume::{VolumeFindings, VolumeJob, VolumeNews, VolumeView};

use bevy::app::{PluginGroup, PluginGroupBuilder};

/// Everything that draws. Needs a [`ParticleScene`] in the world, and Bevy's plugins before it.
pub struct DeepfieldRenderPlugins;

impl PluginGroup for DeepfieldRenderPlugins {
    fn build(self) -> PluginGroupBuilder {
        PluginGroupBuilder::start::<Self>()
            .add(shaders::ShaderPlugin)
            .add(splat::SplatPlugin)
            .add(composite::CompositePlugin)
            .add(light::LightPlugin)
            .add(bloom::BloomPlugin)
            .add(volume::VolumePlugin)
            .add(measure::MeasurePlugin)
            .add(integrals::IntegralPlugin)
            .add(surface::SurfacePlugin)
            .add(tiles::TilePlugin::<SortedSplats>::default())
            .add(tiles::TilePlugin::<OverSplats>::default())
            .add(tiles::TilePlugin::<Spheres>::default())
            .add(tiles::TilePlugin::<Layered>::default())
            .add(timing::TimingPlugin)
            .add(plugins::OtherCrates)
    }
}
