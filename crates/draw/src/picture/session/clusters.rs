//! Pictures of clusters: whether there are any, how many an error asks for, and how far they are from the leaves.

use super::{Session, Shown};
use crate::cpu::Counts;
use crate::cpu::over::Order;
use crate::hierarchy::Purpose;
use crate::mode::{Depiction, LevelChoice, Levels, Output, Plan, Raw};
use crate::picture::adapter::{AdapterFrame, AdapterJob, AdapterValues};
use crate::picture::level_report::{LevelReport, ROUNDING, bound, estimate, has_clusters};
use crate::picture::splat_budget::SplatBudget;
use crate::picture::{Picture, PictureError, Subject};
use crate::store::{Metadata, Representative, Tree};
use crate::stream::SceneSelection;
use std::time::{Duration, Instant};

/// Splats that an error of the picture is looked for with first.
const FIRST: u64 = 2000;
/// Pictures after which the number of splats for a time is taken as it is.
const TRIES: usize = 8;
/// By what power of the number of splats errors fall, at least.
const POWER: f64 = 0.5;

/// A picture that was drawn to see how it becomes.
pub(super) struct Attempt {
    /// Splats that were selected for it.
    pub splats: u64,
    /// Whether any of them is a cluster.
    pub has_clusters: bool,
    /// How long drawing took, without what had to be read.
    pub took: Duration,
    /// It.
    pub values: Raw,
}

/// A picture that was drawn.
#[derive(Clone, Copy)]
pub(super) struct Drawn<'a> {
    /// See [`Attempt::splats`].
    pub splats: u64,
    /// See [`Attempt::has_clusters`].
    pub has_clusters: bool,
    /// See [`Attempt::values`].
    pub values: &'a Raw,
}

impl Attempt {
    /// As a picture that was drawn.
    fn of(&self) -> Drawn<'_> {
        Drawn { splats: self.splats, has_clusters: self.has_clusters, values: &self.values }
    }
}

/// Draws the picture as a depiction says.
pub(super) type Attempting<'a> = dyn FnMut(&mut Session, &Depiction) -> Result<Attempt, PictureError> + 'a;

impl Session {
    /// Refuses clusters of data that has none.
    pub(super) fn check_levels(&self, depiction: &Depiction, metadata: &Metadata) -> Result<(), PictureError> {
        let choice = &depiction.choice;
        let wants = choice.levels == Levels::Clusters;
        let is_to_be_refined = choice.frame_ms.is_some() || choice.error_picture.is_some();
        if (wants || is_to_be_refined) && !metadata.has_clusters() {
            let why = "clusters: not in this file, expected one built with --hierarchy pca";
            return Err(PictureError::of(self.path(), why));
        }
        if is_to_be_refined && choice.levels == Levels::Splats {
            let why = "error-picture, frame-ms: found the levels splats, expected auto or clusters";
            return Err(PictureError::Asked(why.into()));
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

    /// Tells, once, of what was asked for that the file has not got: a budget of splats without clusters, sizes that were not published.
    pub(super) fn tell_of_levels(&mut self, picture: &Picture, depiction: &Depiction, metadata: &Metadata) {
        if self.has_told_of_levels {
            return;
        }
        let LevelReport { splats, budget, .. } = picture.level_report;
        let is_published = depiction.choice.representative == Representative::Published;
        let told = match (metadata.has_clusters(), budget) {
            (false, Some(budget)) if splats > budget => format!(
                "splats: {splats} are the fewest that show this view without clusters, in place of {budget}; build --hierarchy octree,pca \
                 makes files that keep to any number"
            ),
            (true, _) if is_published && !metadata.is_published() => {
                "representative: published sizes are in files built with --split distortion, here clusters are round"
                    .into()
            }
            _ => return,
        };
        self.has_told_of_levels = true;
        self.reporter.tell(format!("{}: {told}", self.path().display()));
    }

    /// A depiction with as many splats as there is time for, or as the error of the picture asks for, where either is limited; `attempt`
    /// draws the picture as a depiction says.
    pub(super) fn chosen(
        &mut self,
        tree: &dyn Tree,
        depiction: &Depiction,
        attempt: &mut Attempting<'_>,
    ) -> Result<Option<Depiction>, PictureError> {
        if self.scene.purpose != Purpose::Clusters {
            return Ok(None);
        }
        let most = depiction.choice.splats.unwrap_or(u64::MAX).min(tree.metadata().particles());
        match depiction.choice {
            LevelChoice { frame_ms: Some(frame_ms), .. } => {
                self.in_time(depiction, (frame_ms, most), attempt).map(Some)
            }
            LevelChoice { error_picture: Some(error), .. } => self.refined(depiction, (error, most), attempt).map(Some),
            _ => Ok(None),
        }
    }

    fn in_time(
        &mut self,
        depiction: &Depiction,
        (frame_ms, most): (f64, u64),
        attempt: &mut Attempting<'_>,
    ) -> Result<Depiction, PictureError> {
        let mut splat_budget = SplatBudget::default();
        let mut splats = splat_budget.limit(frame_ms).min(most);
        for tried in 0..TRIES {
            // The first picture makes tables and shaders, which take time once.
            if tried == 0 {
                attempt(self, &within(depiction, splats))?;
            }
            let Attempt { splats: drawn, took, .. } = attempt(self, &within(depiction, splats))?;
            let took = 1e3 * took.as_secs_f64();
            splat_budget.drew(drawn, took);
            let next = splat_budget.limit(frame_ms).min(most);
            let is_enough = took <= frame_ms && (splats >= most || next as f64 <= 1.15 * splats as f64);
            if is_enough {
                break;
            }
            splats = next;
        }
        Ok(within(depiction, splats))
    }

    fn refined(
        &mut self,
        depiction: &Depiction,
        (error, most): (f64, u64),
        attempt: &mut Attempting<'_>,
    ) -> Result<Depiction, PictureError> {
        let mut splats = FIRST.min(most);
        loop {
            let refined = within(depiction, splats);
            let drawn = attempt(self, &refined)?;
            if splats >= most || !drawn.has_clusters {
                return Ok(refined);
            }
            match self.estimate(&refined, drawn.of(), attempt)? {
                Some(found) if found > error => {
                    let more = (1.05 * found / error).powf(1.0 / POWER).clamp(1.3, 16.0);
                    splats = ((splats as f64 * more) as u64).min(most);
                }
                _ => return Ok(refined),
            }
        }
    }

    /// Draws a flat picture as a depiction says.
    pub(super) fn attempt_flat(
        &mut self,
        tree: &dyn Tree,
        shown: &Shown<'_>,
        depiction: &Depiction,
    ) -> Result<Attempt, PictureError> {
        let passes = self.passes_without_paths(&Shown { depiction, ..*shown })?;
        let subject = Subject { depiction, ..self.subject(tree, shown) };
        let tau = shown.shot.look.error_px();
        if let Some(listing) = self.listing(&subject, &shown.view, tau, passes.is_some())? {
            return self.attempt_listed(&subject, &shown.view, &listing, passes);
        }
        let selection = self.select(depiction, &shown.view, tau)?;
        let (splats, has_clusters) = (selection.particles, has_clusters(&selection.nodes));
        let (view, nodes, plan) = (&shown.view, &selection.nodes, &Plan::default());
        if let Some((passes, adapter)) = passes.zip(self.adapter.as_mut()) {
            let metadata = tree.metadata();
            let job = AdapterJob { view, depiction, metadata, nodes, plan, passes, light: None, repeat: 1 };
            // What an adapter lacks is told when the picture is drawn.
            if let Ok(AdapterFrame { values: AdapterValues::Sums(sums), milliseconds, .. }) = adapter.draw(&job) {
                let took = Duration::from_secs_f64(1e-3 * milliseconds.get("frame").copied().unwrap_or_default());
                return Ok(Attempt { splats, has_clusters, took, values: Raw::Sums(sums, Counts::default()) });
            }
        }
        let start = Instant::now();
        let values = subject.draw_nodes(view, nodes, plan)?;
        Ok(Attempt { splats, has_clusters, took: start.elapsed(), values })
    }

    /// What a flat picture that was drawn says of its levels.
    pub(super) fn flat_report(
        &mut self,
        tree: &dyn Tree,
        shown: &Shown<'_>,
        selection: &SceneSelection,
        values: &Raw,
    ) -> Result<LevelReport, PictureError> {
        let (splats, has_clusters) = (selection.particles, has_clusters(&selection.nodes));
        let drawn = Drawn { splats, has_clusters, values };
        if shown.ground.is_some() {
            return Ok(self.plain_report(shown.depiction, drawn));
        }
        let attempt = &mut |session: &mut Session, depiction: &Depiction| session.attempt_flat(tree, shown, depiction);
        let report = self.level_report(shown.depiction, drawn, attempt)?;
        let (Raw::Sums(sums, _), Purpose::Clusters) = (values, self.scene.purpose) else { return Ok(report) };
        let total: f64 = sums.p.iter().map(|p| f64::from(*p)).sum();
        let error_bound = bound(&shown.view, shown.depiction, &selection.nodes, total);
        Ok(LevelReport { error_bound, ..report })
    }

    /// What a picture that was drawn says of its levels; `attempt` draws it as a depiction says.
    pub(super) fn level_report(
        &mut self,
        depiction: &Depiction,
        drawn: Drawn<'_>,
        attempt: &mut Attempting<'_>,
    ) -> Result<LevelReport, PictureError> {
        let report = self.plain_report(depiction, drawn);
        let (Raw::Sums(..), Purpose::Clusters) = (drawn.values, self.scene.purpose) else { return Ok(report) };
        let error_estimate = self.estimate(depiction, drawn, attempt)?;
        Ok(LevelReport { error_estimate, ..report })
    }

    /// The same without errors: of a picture in which surfaces hide some of what there is, nothing tells them.
    pub(super) fn plain_report(&self, depiction: &Depiction, drawn: Drawn<'_>) -> LevelReport {
        let (splats, budget, order) = (drawn.splats, depiction.choice.splats, depiction.choice.order.map(Order::name));
        LevelReport { levels: self.drawn_from(), splats, budget, order, ..LevelReport::default() }
    }

    /// By how much the sums of a picture are thought to be wrong; `None` where nothing tells.
    fn estimate(
        &mut self,
        depiction: &Depiction,
        drawn: Drawn<'_>,
        attempt: &mut Attempting<'_>,
    ) -> Result<Option<f64>, PictureError> {
        let Raw::Sums(sums, _) = drawn.values else { return Ok(None) };
        if !drawn.has_clusters {
            return Ok(Some(ROUNDING));
        }
        let half = attempt(self, &within(depiction, (drawn.splats / 2).max(1)))?;
        match half.values {
            Raw::Sums(of_half, _) if half.splats < drawn.splats => Ok(Some(estimate(&sums.p, &of_half.p))),
            _ => Ok(None),
        }
    }
}

/// The same within so many splats.
fn within(depiction: &Depiction, splats: u64) -> Depiction {
    Depiction { choice: LevelChoice { splats: Some(splats), ..depiction.choice }, ..depiction.clone() }
}
