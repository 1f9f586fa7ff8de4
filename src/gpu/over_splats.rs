//! Splats that lie over each other (HE03) on the adapter: particles by tiles, sorted by their distance from the eye, each in one colour,
//! blended front to back for each pixel as [`crate::cpu::over`] does in its exact order, which its pictures are held against.
//!
//! Particles are blurred and get their own columns where they are listed (`shaders/tiles/gather.wgsl`). What is equally far away has the order
//! of the draw list.

use super::capabilities::Capabilities;
use super::front_to_back::{BlendGroups, BlendPipelines};
use super::matter::map_to_place;
use super::splat::layout::Grids;
use super::tiles::spots::listed_within;
use super::tiles::{Binding, Canvas, OverRequest, TileList, TileMode, TileRequest, opaque_depths};
use crate::color::splat_colors::{OwnColumn, SplatColors};
use crate::color::transfer::Scale;
use crate::cpu::over::{LOW_PASS, TERMINATION};
use crate::cpu::volume::OpaqueDepths;
use crate::view::{Extent, View};
use bevy::asset::AssetServer;
use bevy::prelude::Resource;
use bevy::render::render_resource::{BufferUsages, PipelineCache};
use bevy::render::renderer::RenderContext;
use bytemuck::{Pod, Zeroable};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Nearer than this share of the farthest distance nothing is drawn.
const NEAREST: f64 = 1e-6;

/// A camera's particles lie over each other. Their table tells densities. The view's footprint is the kernel.
#[derive(Clone, Debug)]
pub struct OverSplats {
    /// What splats look like.
    pub colors: Arc<SplatColors>,
    /// By what their own columns are found.
    pub column: OwnColumn,
    /// Whether they have an attribute.
    pub attribute: bool,
    /// Depth of the first particle that is drawn, and the distance of the last one.
    pub planes: [f64; 2],
}

impl PartialEq for OverSplats {
    fn eq(&self, other: &OverSplats) -> bool {
        Arc::ptr_eq(&self.colors, &other.colors)
            && self.column == other.column
            && self.attribute == other.attribute
            && self.planes == other.planes
    }
}

impl OverSplats {
    /// Between which depths particles are listed that reach so far; `None` without any.
    pub fn planes(view: &View, extents: &[Extent]) -> Option<[f64; 2]> {
        let farthest = |extent: &Extent| {
            let [low, high] = [extent.bounds.min, extent.bounds.max].map(|corner| (corner - view.eye).abs());
            low.max(high).length() + extent.margin
        };
        let far = extents.iter().map(farthest).fold(0.0, f64::max);
        (far > 0.0 && far.is_finite()).then_some([NEAREST * far, far])
    }
}

/// WGSL `SplatLook`.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct SplatLookUniform {
    /// Factor and offset from a column, or its base-2 logarithm, to its place in the table's rows.
    pub column_map: [f32; 2],
    /// The same from an attribute to the row.
    pub attribute_map: [f32; 2],
    /// Columns and rows of the table.
    pub size: [u32; 2],
    /// 1: columns count by their logarithm.
    pub column_log: u32,
    /// 1: attributes do.
    pub attribute_log: u32,
    /// 1: hues follow the attribute.
    pub has_hue: u32,
    /// Optical depth of a column of 1.
    pub depth: f32,
    /// Padding.
    pub unused: [u32; 2],
}

impl SplatLookUniform {
    fn new(colors: &SplatColors, has_attribute: bool) -> SplatLookUniform {
        let (scale, range) = colors.column_scale();
        let (column_map, column_log) = map_to_place(scale, range);
        let hue = colors.hue_scale().filter(|_| has_attribute);
        let (attribute_map, attribute_log) =
            hue.map_or(([0.0; 2], 0), |(scale, range): (Scale, [f64; 2])| map_to_place(scale, range));
        let (_, size) = colors.table();
        SplatLookUniform {
            column_map,
            attribute_map,
            size: size.map(|entries| entries as u32),
            column_log,
            attribute_log,
            has_hue: hue.is_some().into(),
            depth: colors.depth() as f32,
            unused: [0; 2],
        }
    }
}

/// Layouts and pipelines.
#[derive(Resource)]
pub struct OverPipelines(BlendPipelines);

impl TileMode for OverSplats {
    type Pipelines = OverPipelines;
    type Bound = BlendGroups;

    fn pipelines(server: &AssetServer, cache: &PipelineCache, on: &Capabilities) -> OverPipelines {
        let bytes = size_of::<SplatLookUniform>();
        OverPipelines(BlendPipelines::new((server, cache, on), "deepfield splats' look", bytes, "over/arrange.wgsl"))
    }

    fn request(&self, _: &View, _: &Grids, memory: u64) -> TileRequest {
        let [factor, power] = self.column.by_density().unwrap_or_default();
        TileRequest {
            planes: self.planes,
            least: 0.0,
            density_scale: 1.0,
            extent: 1.0,
            lead: 0.0,
            smallest: 0.0,
            layers: None,
            over: Some(OverRequest {
                blur: LOW_PASS as f32,
                column_factor: factor as f32,
                column_power: power as f32,
                column_area: (TAU * self.column.variance) as f32,
            }),
            at_a_time: listed_within(memory, TileList::SPOT_BYTES),
        }
    }

    fn bind(&self, before: Option<(&Self, &BlendGroups)>, to: &Binding<'_, Self>) -> BlendGroups {
        let table = match before {
            Some((before, groups)) if Arc::ptr_eq(&before.colors, &self.colors) => groups.table(),
            _ => {
                let (colors, _) = self.colors.table();
                let entries: Vec<[f32; 4]> = colors.iter().map(|&[r, g, b]| [r, g, b, 0.0]).collect();
                to.buffer(bytemuck::cast_slice(&entries), BufferUsages::STORAGE)
            }
        };
        let look = SplatLookUniform::new(&self.colors, self.attribute);
        let before = before.map(|(_, groups)| groups);
        BlendGroups::new(&to.pipelines.0, (bytemuck::bytes_of(&look), table), TERMINATION, before, to)
    }

    fn bytes(bound: &BlendGroups) -> u64 {
        bound.bytes()
    }

    fn draw(&self, bound: &BlendGroups, on: &Canvas<'_, Self>, context: &mut RenderContext) -> Option<()> {
        bound.draw(&on.pipelines.0, on, context)
    }

    fn opaque(&self, view: &View, ends: &[f32]) -> OpaqueDepths {
        opaque_depths(view, ends, 0.0)
    }
}
