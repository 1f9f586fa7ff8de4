//! Order-dependent splatting (F12 5.9) on the adapter: particles by tiles, classified each on its own and blended front to back
//! for each pixel, as [`crate::cpu::sorted`] does, which its pictures are held against.

use super::capabilities::Capabilities;
use super::front_to_back::{BlendGroups, BlendPipelines};
use super::matter::{LookupUniform, table};
use super::splat::layout::Grids;
use super::tiles::spots::listed_within;
use super::tiles::{Binding, Canvas, TileList, TileMode, TileRequest, opaque_depths};
use crate::cpu::volume::{Classifier, OpaqueDepths};
use crate::view::View;
use bevy::asset::AssetServer;
use bevy::prelude::Resource;
use bevy::render::render_resource::{BufferUsages, PipelineCache};
use bevy::render::renderer::RenderContext;
use std::sync::Arc;

/// A camera's particles are blended in the order of their depth. Their table tells densities. The view's footprint is the kernel.
#[derive(Clone, Debug)]
pub struct SortedSplats {
    /// What densities and attributes emit and absorb.
    pub classifier: Arc<Classifier>,
    /// Depths of the first and the last particle that is drawn.
    pub planes: [f64; 2],
    /// Rays end at this opacity.
    pub termination: f32,
    /// Least smoothing length, pixels: smaller particles are enlarged to it, with their mass.
    pub smallest: f64,
    /// Factor on the particles' own densities.
    pub density_scale: f32,
}

impl PartialEq for SortedSplats {
    fn eq(&self, other: &SortedSplats) -> bool {
        Arc::ptr_eq(&self.classifier, &other.classifier)
            && self.planes == other.planes
            && self.termination == other.termination
            && self.smallest == other.smallest
            && self.density_scale == other.density_scale
    }
}

/// Layouts and pipelines.
#[derive(Resource)]
pub struct SortedPipelines(BlendPipelines);

impl TileMode for SortedSplats {
    type Pipelines = SortedPipelines;
    type Bound = BlendGroups;

    fn pipelines(server: &AssetServer, cache: &PipelineCache, on: &Capabilities) -> SortedPipelines {
        let bytes = size_of::<LookupUniform>();
        SortedPipelines(BlendPipelines::new((server, cache, on), "deepfield matter", bytes, "sorted/arrange.wgsl"))
    }

    fn request(&self, _: &View, _: &Grids, memory: u64) -> TileRequest {
        TileRequest {
            planes: self.planes,
            least: self.classifier.least(),
            density_scale: self.density_scale,
            extent: 1.0,
            lead: 0.0,
            smallest: self.smallest,
            layers: None,
            over: None,
            at_a_time: listed_within(memory, TileList::SPOT_BYTES),
        }
    }

    fn bind(&self, before: Option<(&Self, &BlendGroups)>, to: &Binding<'_, Self>) -> BlendGroups {
        let table = match before {
            Some((before, groups)) if Arc::ptr_eq(&before.classifier, &self.classifier) => groups.table(),
            _ => to.buffer(bytemuck::cast_slice(&table(&self.classifier)), BufferUsages::STORAGE),
        };
        let look = LookupUniform::new(&self.classifier);
        let before = before.map(|(_, groups)| groups);
        BlendGroups::new(&to.pipelines.0, (bytemuck::bytes_of(&look), table), self.termination, before, to)
    }

    fn bytes(bound: &BlendGroups) -> u64 {
        bound.bytes()
    }

    fn draw(&self, bound: &BlendGroups, on: &Canvas<'_, Self>, context: &mut RenderContext) -> Option<()> {
        bound.draw(&on.pipelines.0, on, context)
    }

    fn opaque(&self, view: &View, ends: &[f32]) -> OpaqueDepths {
        opaque_depths(view, ends, self.smallest)
    }
}
