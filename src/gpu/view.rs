//! What a camera draws: the component that the main world sets and the renderer extracts.

use super::scene::{NodeId, TableId};
use crate::color::Image;
use crate::color::transfer::{Levels, Lut, Scale, TransferFunction};
use crate::mode::sample::Sample;
use crate::model::Kernel;
use crate::view::View;
use bevy::math::DVec3;
use bevy::prelude::Component;
use bevy::render::extract_component::ExtractComponent;
use std::sync::Arc;

/// One node in a camera's picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DrawItem {
    /// A resident node; others are left out.
    pub node: NodeId,
    /// What its codes mean; not used by raw particles.
    pub table: Option<TableId>,
    /// Factor on every weight: a page node's `mass_scale` or `mass_density_scale`, else 1.
    pub weight_scale: f32,
    /// By how much its image is displaced from where the node is, world units.
    pub offset: DVec3,
    /// Which of its particles are drawn; raw particles all are.
    pub sample: Sample,
    /// Which of its clusters are drawn, if it holds some ([`crate::codec::clusters::cluster_limit`]).
    pub limit: u16,
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
    /// What the adapter can: compute passes, else blended quads.
    #[default]
    Auto,
    /// Compute passes. They need no optional feature of the adapter: no float atomics, no float blending.
    Compute,
    /// Instanced, blended quads. They need blending of 32-bit floats.
    Raster,
}

impl Backend {
    /// The name by which users know it.
    pub fn name(self) -> &'static str {
        match self {
            Backend::Auto => "auto",
            Backend::Compute => "compute",
            Backend::Raster => "raster",
        }
    }
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
    /// Whether particles outside the picture are dropped at once. The picture is the same without; for measurements.
    pub culling: bool,
    /// Particles that add less than this to every pixel's `P` are dropped; 0: none.
    pub faintest: f32,
    /// What is drawn. Replace the list to change it: a picture is accumulated again when the list is another one.
    pub items: Arc<[DrawItem]>,
    /// Accumulate in every frame, though nothing changed: for measurements.
    pub always: bool,
    /// Whether the picture of the list before is kept, for [`Composite::last`].
    pub keeps_last: bool,
}

impl SplatView {
    /// Of a camera whose picture is not of particles: `items`, the same list for each picture, are none.
    pub fn without_particles(view: View, items: &Arc<[DrawItem]>) -> SplatView {
        SplatView {
            view,
            footprint: Footprint::Kernel(Kernel::default()),
            backend: Backend::Compute,
            culling: true,
            faintest: 0.0,
            items: Arc::clone(items),
            always: false,
            keeps_last: false,
        }
    }
}

/// The baked transfer function by which the accumulation becomes colour. A camera without it shows none.
#[derive(Component, Clone, Debug, PartialEq, ExtractComponent)]
pub struct Composite {
    /// The table of colours.
    pub lut: Arc<Lut>,
    /// The ranges that it spans.
    pub levels: Levels,
    /// How `P` is placed in its range.
    pub p_scale: Scale,
    /// How `S` is placed in its range.
    pub s_scale: Scale,
    /// Whether `S` counts; else every hue is the middle one.
    pub attribute: bool,
    /// The picture that this one takes the place of.
    pub before: Option<Fading>,
    /// How much is seen of what is accumulated, from 0 to 1, over the picture that was there before it, if [`SplatView::keeps_last`] has
    /// kept that; both in the same colours. `None`: it is seen alone.
    pub last: Option<f32>,
}

/// A picture that blends into another.
#[derive(Clone, Debug)]
pub struct Fading {
    /// The picture; stretched where it has another size.
    pub image: Arc<Image>,
    /// How much of the other is seen, from 0 to 1.
    pub share: f32,
}

impl PartialEq for Fading {
    fn eq(&self, other: &Fading) -> bool {
        Arc::ptr_eq(&self.image, &other.image) && self.share == other.share
    }
}

impl Composite {
    /// The table of a transfer function with the ranges `levels`. Without an attribute every hue is the middle one, as
    /// on the CPU.
    pub fn new(transfer: &TransferFunction, levels: Levels, attribute: bool) -> Composite {
        let hue = transfer.hue.clone().unwrap_or_default();
        Composite {
            lut: Arc::new(transfer.bake_lut()),
            levels,
            p_scale: transfer.scale,
            s_scale: hue.scale,
            attribute,
            before: None,
            last: None,
        }
    }

    /// Whether it is another's: of the same table, not of an equal one.
    pub fn is_same(&self, other: &Composite) -> bool {
        Arc::ptr_eq(&self.lut, &other.lut)
            && self.levels == other.levels
            && self.attribute == other.attribute
            && [self.p_scale, self.s_scale] == [other.p_scale, other.s_scale]
            && self.before == other.before
            && self.last == other.last
    }
}
