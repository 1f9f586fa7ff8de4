//! Pictures of clusters: whether there are any, how many an error asks for, and how far they are from the leaves.

use super::{Session, Shown};
use crate::cpu::over::Order;
use crate::hierarchy::Purpose;
use crate::mode::{Depiction, LevelChoice, Levels, Output, Plan, Raw};
use crate::picture::adapter::AdapterJob;
use crate::picture::level_report::{LevelReport, ROUNDING, bound, estimate, has_clusters};
use crate::picture::splat_budget::SplatBudget;
use crate::picture::{PictureError, Subject};
use crate::store::{Metadata, Tree};
use crate::stream::SceneSelection;
use crate::view::{Detail, View};
use std::time::Instant;

/// Splats that an error of the picture is looked for with first.
const FIRST: u64 = 2000;
/// Pictures after which the number of splats for a time is taken as it is.
const TRIES: usize = 8;
/// By what power of the number of splats errors fall, at least.
const POWER: f64 = 0.5;

impl Session {
    /// Refuses clusters of data that has none.
    pub(super) fn check_levels(&self, depiction: &Depiction, metadata: &Metadata) -> Result<(), PictureError> {
        let wants = depiction.choice.levels == Levels::Clusters;
        if (wants || depiction.choice.frame_ms.is_some()) && !metadata.has_clusters() {
            let why = "clusters: not in this file, expected one built with --hierarchy pca";
            return Err(PictureError::of(self.path(), why));
        }
        let mode = depiction.mode.name;
        if depiction.choice.error_picture.is_some() && depiction.mode.technique.output() != Output::Sums {
            return Err(PictureError::Asked(format!(
                "error-picture: the error of a picture of the mode {mode} is not known, expected a number of splats"
            )));
        }
        if (wants || depiction.choice.is_bounded()) && !depiction.takes_clusters() {
            return Err(PictureError::Asked(format!(
                "levels, splats, error-picture, frame-ms: the mode {mode} draws no splats of clusters yet"
            )));
        }
        Ok(())
    }

    /// A depiction with as many splats as there is time for, where that is limited.
    pub(super) fn in_time(&mut self, tree: &dyn Tree, shown: &Shown<'_>) -> Result<Option<Depiction>, PictureError> {
        let choice = shown.depiction.choice;
        let Some(frame_ms) = choice.frame_ms.filter(|_| self.scene.purpose == Purpose::Clusters) else {
            return Ok(None);
        };
        let most = choice.splats.unwrap_or(u64::MAX).min(tree.metadata().particles());
        let mut splat_budget = SplatBudget::default();
        let mut splats = splat_budget.limit(frame_ms).min(most);
        for tried in 0..TRIES {
            let choice = LevelChoice { splats: Some(splats), ..choice };
            let depiction = Depiction { choice, ..shown.depiction.clone() };
            let selection = self.select(&depiction, &shown.view, shown.shot.look.error_px())?;
            let shown = Shown { depiction: &depiction, ..*shown };
            // The first picture makes tables and shaders, which take time once.
            if tried == 0 {
                self.timed(tree, &shown, &selection)?;
            }
            let took = self.timed(tree, &shown, &selection)?;
            splat_budget.drew(selection.particles, took);
            let next = splat_budget.limit(frame_ms).min(most);
            let is_enough = took <= frame_ms && (splats >= most || next as f64 <= 1.15 * splats as f64);
            if is_enough {
                break;
            }
            splats = next;
        }
        let choice = LevelChoice { splats: Some(splats), ..choice };
        Ok(Some(Depiction { choice, ..shown.depiction.clone() }))
    }

    /// Milliseconds in which what draws pictures draws a selection.
    fn timed(&mut self, tree: &dyn Tree, shown: &Shown<'_>, selection: &SceneSelection) -> Result<f64, PictureError> {
        let passes = self.passes_without_paths(shown)?;
        let (view, nodes, plan) = (&shown.view, &selection.nodes, &Plan::default());
        if let Some((passes, adapter)) = passes.zip(self.adapter.as_mut()) {
            let (depiction, metadata) = (shown.depiction, tree.metadata());
            let job = AdapterJob { view, depiction, metadata, nodes, plan, passes, light: None, repeat: 1 };
            // What an adapter lacks is told when the picture is drawn.
            if let Ok(frame) = adapter.draw(&job) {
                return Ok(frame.milliseconds.get("frame").copied().unwrap_or_default());
            }
        }
        let start = Instant::now();
        drop(self.subject(tree, shown).draw_nodes(view, nodes, plan)?);
        Ok(1e3 * start.elapsed().as_secs_f64())
    }

    /// A depiction with as many splats as the error of the picture asks for, where one does.
    pub(super) fn refined(&mut self, tree: &dyn Tree, shown: &Shown<'_>) -> Result<Option<Depiction>, PictureError> {
        let choice = shown.depiction.choice;
        let Some(error) = choice.error_picture.filter(|_| self.scene.purpose == Purpose::Clusters) else {
            return Ok(None);
        };
        let most = choice.splats.unwrap_or(u64::MAX).min(tree.metadata().particles());
        let with = |splats| {
            let choice = LevelChoice { splats: Some(splats), ..choice };
            Depiction { choice, ..shown.depiction.clone() }
        };
        let mut splats = FIRST.min(most);
        loop {
            let depiction = with(splats);
            let selection = self.select(&depiction, &shown.view, shown.shot.look.error_px())?;
            if splats >= most || !has_clusters(&selection.nodes) {
                return Ok(Some(depiction));
            }
            let subject = Subject { depiction: &depiction, ..self.subject(tree, shown) };
            let drawn = subject.draw_nodes(&shown.view, &selection.nodes, &Plan::default())?;
            let Some(found) = self.estimate(&subject, &shown.view, &selection, &drawn)? else {
                return Ok(Some(depiction));
            };
            if found <= error {
                return Ok(Some(depiction));
            }
            let more = (1.05 * found / error).powf(1.0 / POWER).clamp(1.3, 16.0);
            splats = ((splats as f64 * more) as u64).min(most);
        }
    }

    /// What a picture that was drawn says of its levels.
    pub(super) fn level_report(
        &mut self,
        subject: &Subject<'_>,
        view: &View,
        selection: &SceneSelection,
        drawn_from: &'static str,
        values: &Raw,
    ) -> Result<LevelReport, PictureError> {
        let depiction = subject.depiction;
        let budget = depiction.choice.splats;
        let order = depiction.choice.order.map(Order::name);
        let report =
            LevelReport { levels: drawn_from, splats: selection.particles, budget, order, ..LevelReport::default() };
        let (Raw::Sums(sums, _), Purpose::Clusters) = (values, self.scene.purpose) else { return Ok(report) };
        let total: f64 = sums.p.iter().map(|p| f64::from(*p)).sum();
        let error_bound = bound(view, depiction, &selection.nodes, total);
        let error_estimate = self.estimate(subject, view, selection, values)?;
        Ok(LevelReport { error_bound, error_estimate, ..report })
    }

    /// By how much the sums of a selection are thought to be wrong; `None` where nothing tells.
    fn estimate(
        &mut self,
        subject: &Subject<'_>,
        view: &View,
        selection: &SceneSelection,
        values: &Raw,
    ) -> Result<Option<f64>, PictureError> {
        let Raw::Sums(sums, _) = values else { return Ok(None) };
        if !has_clusters(&selection.nodes) {
            return Ok(Some(ROUNDING));
        }
        let seen = subject.depiction.selection_view(view);
        // What is coarser is there.
        let half = self.scene.select(&seen, Detail::Budget { splats: (selection.particles / 2).max(1) });
        match subject.draw_nodes(view, &half.nodes, &Plan::default())? {
            Raw::Sums(of_half, _) if half.particles < selection.particles => Ok(Some(estimate(&sums.p, &of_half.p))),
            _ => Ok(None),
        }
    }
}
