//! What a graphics adapter does for pictures that no window shows. Nothing here knows of one: a program that has adapters hands
//! one to its sessions.

use crate::color::Accumulation;
use crate::cpu::volume::RayCaster;
use crate::look::Backend;
use crate::mode;
use crate::mode::{Depiction, Mode, Plan};
use crate::store::Metadata;
use crate::stream::SceneNode;
use crate::view::View;
use std::collections::BTreeMap;
use std::sync::Arc;

/// A graphics adapter.
pub trait Adapter: Send + Sync {
    /// Whether it is a graphics card. A driver without one draws on the processor too, and slower than our own renderer.
    fn is_card(&mut self) -> bool;

    /// `P` and `P S` of nodes.
    ///
    /// # Errors
    /// What is missing.
    fn draw(&mut self, job: &AdapterJob<'_>) -> Result<AdapterFrame, String>;

    /// What draws modes of the perspective grid.
    ///
    /// # Errors
    /// What is missing.
    fn caster(&mut self) -> Result<Arc<dyn RayCaster>, String>;
}

/// What an adapter draws.
pub struct AdapterJob<'a> {
    /// The camera and the picture's size.
    pub view: &'a View,
    /// The mode and the attribute.
    pub depiction: &'a Depiction,
    /// What is known of the data.
    pub metadata: &'a Metadata,
    /// What is drawn of it.
    pub nodes: &'a [SceneNode],
    /// What of that is left out.
    pub plan: &'a Plan,
    /// By which passes.
    pub passes: Passes,
    /// How often, for times.
    pub repeat: u32,
}

/// Passes of an adapter that draw splats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Passes {
    /// The best that it has.
    Best,
    /// Compute passes.
    Compute,
    /// Rasterised discs.
    Raster,
}

/// What an adapter has drawn.
#[derive(Clone, Debug)]
pub struct AdapterFrame {
    /// `P` and `P S`.
    pub accumulation: Accumulation,
    /// Splats that reach the picture, where they are counted.
    pub splats: Option<u64>,
    /// The passes that drew.
    pub backend: &'static str,
    /// Name and driver.
    pub adapter: String,
    /// Median of each pass, milliseconds.
    pub milliseconds: BTreeMap<String, f64>,
}

/// The passes of an adapter that draw a mode for somebody who asks for `backend`; `None` where the processor does.
///
/// # Errors
/// What draws the mode, where the backend that is asked for does not.
pub(super) fn passes(
    mode: &Mode,
    backend: Option<Backend>,
    adapter: Option<&mut (dyn Adapter + 'static)>,
) -> Result<Option<Passes>, String> {
    use mode::Adapter as Has;
    let on_processor = mode.technique.on_processor();
    let only = |names: &str| Err(format!("--backend: only {names} the mode {}", mode.name));
    let Some(adapter) = adapter else {
        return match backend {
            Some(Backend::Compute | Backend::Raster) => {
                Err("this deepfield was built without the feature `viewer`, so only --backend cpu draws".into())
            }
            _ => Ok(None),
        };
    };
    match (backend, mode.technique.adapter()) {
        (Some(Backend::Cpu), _) | (None, Has::None) => Ok(None),
        (Some(Backend::Compute), Has::Splats | Has::Plugin | Has::RayMarcher) => Ok(Some(Passes::Compute)),
        (Some(Backend::Raster), Has::Splats) => Ok(Some(Passes::Raster)),
        (Some(_), Has::Plugin) if !on_processor => only("compute draws"),
        (Some(_), Has::Plugin | Has::RayMarcher) => only("compute and cpu draw"),
        (Some(_), _) => only("cpu draws"),
        (None, Has::Splats) => Ok(adapter.is_card().then_some(Passes::Best)),
        (None, Has::RayMarcher) => Ok(adapter.is_card().then_some(Passes::Compute)),
        (None, Has::Plugin) => Ok((!on_processor || adapter.is_card()).then_some(Passes::Compute)),
    }
}
