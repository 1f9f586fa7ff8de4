//! A picture drawn by the processor, or beside the window's frames: of nodes of the open file, or of live particles.

use super::beside::{self, Shared};
use crate::color::transfer::Levels;
use crate::cpu::paths::PathFragments;
use crate::cpu::volume::VolumeError;
use crate::mode::{LodBudget, Plan, Raw};
use crate::model::{Dataset, FamilyName};
use crate::picture::Subject;
use crate::store::InMemory;
use crate::stream::{SceneNode, first_nodes};
use crate::view::View;
use crate::view::perspective_grid::GridError;
use bevy::prelude::UVec2;
use std::sync::Arc;

/// Whose particles are drawn.
pub(super) enum Source {
    /// Nodes of the open file.
    Nodes(Arc<[SceneNode]>),
    /// Particles that another system hands over, and the families that are shown.
    Live(Arc<Dataset>, Vec<FamilyName>),
}

/// What a picture is to leave out.
pub(super) struct Limits {
    /// What the settings allow.
    pub lod_budget: LodBudget,
    /// What that came to for the picture before, where it is to be the same.
    pub plan: Option<Plan>,
    /// How many particles it may take.
    pub particles: u64,
}

/// What was drawn.
pub(super) struct Outcome {
    /// Sums or light; `None` where nothing is in view.
    pub values: Option<Raw>,
    /// What the settings came to.
    pub plan: Plan,
    /// How many particles it took, and whether that is less than the plan would.
    pub taken: u64,
    pub is_cut: bool,
    /// Whether an adapter drew it; and what is to be said of one that did not.
    pub by_adapter: bool,
    pub told: Option<String>,
}

impl Source {
    /// The particles' tree, where they have one of their own, and what of it lies in a view.
    pub fn nodes(&self, view: &View) -> Result<(Option<InMemory>, Arc<[SceneNode]>), String> {
        match self {
            Source::Nodes(nodes) => Ok((None, Arc::clone(nodes))),
            Source::Live(dataset, shown) => {
                let families = dataset.families.iter().filter(|family| shown.contains(&family.name)).cloned().collect();
                let tree = InMemory::new(Dataset { families, ..Dataset::clone(dataset) });
                let nodes = first_nodes(&tree, view).map_err(|error| error.to_string())?;
                Ok((Some(tree), nodes.into()))
            }
        }
    }
}

/// Draws nodes with `size` pixels, with paths among them, where there is an adapter by that; blocks for as long as it takes. `known` are ranges of
/// the colours that what may be left out depends on.
pub(super) fn draw(
    subject: &Subject<'_>,
    nodes: &[SceneNode],
    (view, size): (&View, UVec2),
    limits: &Limits,
    (known, paths): (Option<Levels>, Option<&PathFragments>),
    adapter: Option<&Shared>,
) -> Result<Outcome, VolumeError> {
    // What may be left out is decided for the whole picture, also where this one has fewer pixels.
    let plan = match limits.plan {
        Some(plan) => plan,
        None => subject.plan(view, nodes, &limits.lod_budget, known)?,
    };
    let (fitting, taken) = subject.within(limits.particles, plan, view, nodes);
    let sized = View { width: size.x, height: size.y, ..*view };
    let mut told = None;
    let by_adapter = match adapter {
        Some(shared) => beside::draw(shared, subject, (&sized, nodes, &fitting), &mut told),
        None => Ok(None),
    };
    let drawn = by_adapter.and_then(|drawn| match drawn {
        Some(values) => Ok((values, true)),
        None => {
            let decoded = subject.decode(view, nodes, &fitting);
            Ok((subject.draw_with_paths(&sized, &decoded, &fitting, paths)?, false))
        }
    });
    let (values, by_adapter) = match drawn {
        Err(VolumeError::Grid(GridError::NothingInView)) => (None, false),
        drawn => drawn.map(|(values, by_adapter)| (Some(values), by_adapter))?,
    };
    Ok(Outcome { values, plan, taken, is_cut: fitting != plan, by_adapter, told })
}
