//! What the adapter's passes draw of fields of particles' attributes: the processor finds their ranges, as it does for pictures in files, on a
//! background task.

use crate::color::transfer::TransferFunction;
use crate::cpu::volume::VolumeError;
use crate::cpu::volume::attributes::Column;
use crate::mode::{LightPasses, LightPlan, Plan};
use crate::picture::Subject;
use crate::view::View;
use crate::window::look::Look;
use crate::window::pages::ViewSelection;
use crate::window::scene::Scene;
use bevy::tasks::{AsyncComputeTaskPool, Task, futures::check_ready};
use std::sync::Arc;

/// What a plan depends on, beside the particles that ranges are looked for in.
#[derive(Clone, PartialEq)]
struct Content {
    generation: u32,
    depiction: u64,
    transfer: TransferFunction,
}

/// Whose ranges are looked for: a selection, and how many of its particles are drawn.
type Sample = (u64, u64);

/// A plan, or why there is none.
struct Found {
    content: Content,
    sample: Sample,
    plan: Result<LightPlan, VolumeError>,
}

/// The plans of pictures of fields.
#[derive(Default)]
pub(super) struct FieldPlans {
    task: Option<Task<Found>>,
    found: Option<Found>,
    /// Counts plans.
    number: u64,
    /// Whether the last one is that of what is wanted, and whether it is of another selection of that.
    is_current: bool,
    is_alike: bool,
}

impl FieldPlans {
    /// Takes in what has been found, and begins to look for what is wanted now.
    pub fn follow(
        &mut self,
        (scene, look, transfer): (&Scene, &Look, &TransferFunction),
        (view, selection, limit): (View, &ViewSelection, u64),
    ) {
        if let Some(found) = self.task.as_mut().and_then(check_ready) {
            self.task = None;
            self.number += 1;
            self.found = Some(found);
        }
        let depiction = &look.depiction;
        let looks = depiction.mode.technique.looks_in_view(&depiction.settings, transfer);
        let content =
            Content { generation: scene.generation, depiction: look.depiction_revision, transfer: transfer.clone() };
        let sample = (selection.revision, limit);
        let known = self.found.as_ref().filter(|found| found.content == content);
        self.is_alike = known.is_some();
        // What looks for no range is the same for every selection with something in it.
        self.is_current = known.is_some_and(|found| found.sample == sample || !looks && found.plan.is_ok());
        if self.is_current || self.task.is_some() {
            return;
        }
        let (tree, nodes, depiction) = (scene.tree(), Arc::clone(&selection.nodes), depiction.clone());
        let diameter = scene.frame.size().length();
        self.task = Some(AsyncComputeTaskPool::get().spawn(async move {
            let subject = Subject::new(tree.metadata(), &depiction, &content.transfer, diameter);
            let (drawn, _) = subject.within(limit, Plan::default(), &view, &nodes);
            let missing = || VolumeError::Device("no passes draw these fields".into());
            let plan = subject.light_of_fields(&view, &nodes, &drawn).and_then(|plan| plan.ok_or_else(missing));
            Found { content, sample, plan }
        }));
    }

    /// Counts up with every plan.
    pub fn number(&self) -> u64 {
        self.number
    }

    /// Whether the plan is that of what is wanted, and not of a selection before.
    pub fn is_current(&self) -> bool {
        self.is_current
    }

    /// The last plan for what is wanted, be it of a selection before; why there is none for this one.
    pub fn plan(&self) -> Option<&Result<LightPlan, VolumeError>> {
        let found = self.found.as_ref().filter(|found| self.is_current || self.is_alike && found.plan.is_ok());
        found.map(|found| &found.plan)
    }

    /// The columns that it draws.
    pub fn columns(&self) -> &[Column] {
        match self.plan() {
            Some(Ok(LightPlan { passes: LightPasses::Columns(march), .. })) => &march.columns,
            _ => &[],
        }
    }
}
