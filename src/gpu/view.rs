//! What a camera draws: the component that the main world sets and the renderer extracts.

use super::scene::{NodeId, TableId};
use crate::model::Kernel;
use crate::view::View;
use bevy::prelude::Component;
use bevy::render::extract_component::ExtractComponent;
use std::sync::Arc;

/// One node in a camera's picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DrawItem {
    /// A resident node; others are left out.
    pub node: NodeId,
    /// What its codes mean; not used by raw particles.
    pub table: Option<TableId>,
}

/// The shape that a particle has in the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Footprint {
    /// Its smoothing kernel, integrated along the line of sight.
    Kernel(Kernel),
    /// A disc of fixed size in pixels, shaped like the projected cubic spline: for stars. `P` is then weight per pixel.
    Pixels {
        /// Radius in pixels.
        radius: f32,
    },
}

/// How particles are accumulated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Backend {
    /// Compute passes where the adapter can, else [`Backend::Raster`].
    #[default]
    Auto,
    /// Compute passes.
    Compute,
    /// Instanced, blended quads.
    Raster,
}

/// The picture of particles that a camera accumulates: `P` and `P S` for each pixel. The camera's target, or its
/// viewport, must have `view.width` by `view.height` pixels. A camera without it draws no particles.
#[derive(Component, Clone, Debug, ExtractComponent)]
pub struct SplatView {
    /// Where the camera stands, in world units and double precision. Bevy's own transform is not used.
    pub view: View,
    /// The particles' shape.
    pub footprint: Footprint,
    /// How they are accumulated.
    pub backend: Backend,
    /// What is drawn.
    pub items: Arc<[DrawItem]>,
}

/// The baked transfer function by which the accumulation becomes colour. A camera without it shows none.
#[derive(Component, Clone, Debug, PartialEq, ExtractComponent)]
pub struct Composite {
    /// Colours, `width * height`, sRGB-encoded RGBA8: x runs with `P`, y with `S`.
    pub texels: Arc<[[u8; 4]]>,
    /// Texels along `P`.
    pub width: u32,
    /// Texels along `S`.
    pub height: u32,
    /// The values of `P` at the lower and upper end of the table.
    pub p_range: [f32; 2],
    /// Whether the table runs with `log P`.
    pub p_log: bool,
    /// The values of `S` at the lower and upper end of the table.
    pub s_range: [f32; 2],
    /// Whether the table runs with `log S`.
    pub s_log: bool,
}
