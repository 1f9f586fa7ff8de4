//! What stands in for a view's splats while there is no time for all of them: clusters, within a number of splats.
//!
//! A view that moves shows clusters alone. One that rests shows them until all that its own detail asks for is there, and asks for
//! that as soon as it has the clusters: something that deserves the name of a picture comes first, and the picture after it. Where no
//! clusters stand in, a view that moves is as fine as its mode is in motion ([`Depiction::detail_in_motion`]).

use crate::hierarchy::Purpose;
use crate::mode::{Conserved, Depiction, LevelChoice, Levels, Output};
use crate::store::{Metadata, NodeRef};
use crate::stream::Streamer;
use crate::view::{Detail, Selection, View};
use std::sync::Arc;

/// How long a picture at rest fades in over the clusters that stood in for it, seconds.
pub const FADE_SECS: f32 = 0.2;

/// What is wanted of a view.
#[derive(Clone, Copy)]
pub struct Wanted<'a> {
    /// The mode and its settings.
    pub depiction: &'a Depiction,
    /// Largest displacement of what is drawn at rest, pixels.
    pub tau: f64,
    /// Indices of the families in the file's metadata.
    pub families: &'a [u32],
    /// Whether the view moves: then what it would show at rest is not looked for.
    pub moves: bool,
    /// How many splats there is time for; `None`: all of them.
    pub splats: Option<u64>,
}

/// What a frame draws.
#[derive(Clone, Debug)]
pub struct Chosen {
    /// The nodes.
    pub selection: Selection<NodeRef>,
    /// In what detail they were chosen.
    pub detail: Detail,
    /// What its inner nodes are made for.
    pub purpose: Purpose,
    /// Whether they stand in for what was wanted: then the picture is not the view's own, converged or not.
    pub stands_in: bool,
    /// Whether it is as fine as what the view shows at rest.
    pub at_rest: bool,
}

/// Whether clusters of a file may stand in for what a depiction draws of it. Their shapes are those of their mass: where density counts
/// twice, a sample of the particles is closer to the picture (`docs/results.md`), so that clusters have to be asked for.
pub fn has_stand_in(depiction: &Depiction, metadata: &Metadata) -> bool {
    let suits = match depiction.choice.levels {
        Levels::Auto => depiction.mode.conserves != Conserved::MassDensity,
        Levels::Splats => false,
        Levels::Clusters => true,
    };
    suits && depiction.mode.technique.output() == Output::Sums && metadata.has_clusters()
}

/// What was asked for last.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Asked {
    /// Nothing that is known of.
    #[default]
    Nothing,
    /// What the clusters need.
    Clusters,
    /// What the view's own detail needs.
    Own,
}

/// What stands in from frame to frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StandIn {
    asked: Asked,
}

impl StandIn {
    /// Starts a frame: chooses what a view draws from what is in memory, and asks for what it lacks. What cannot be had is not waited for:
    /// then the view's own detail is shown as far as it is there.
    pub fn select(&mut self, streamer: &mut Streamer, view: &View, wanted: &Wanted<'_>) -> Chosen {
        let Wanted { depiction, tau, families, moves, splats } = *wanted;
        let tree = Arc::clone(streamer.residency.tree());
        let metadata = tree.metadata();
        let seen = depiction.selection_view(view);
        let (purpose, detail) = (depiction.purpose(metadata), depiction.detail(view, tau, metadata));
        let roots = streamer.roots(families.iter().copied(), purpose, view.time);
        let own = |selection| Chosen { selection, detail, purpose, stands_in: false, at_rest: true };
        let splats = splats.filter(|_| has_stand_in(depiction, metadata));
        // What comes next is read ahead for a view that rests there.
        streamer.goal = splats.map(|_| (detail, roots.clone()));
        let Some(splats) = splats else {
            self.asked = Asked::Nothing;
            let shown = if moves { depiction.detail_in_motion(view, tau, metadata) } else { detail };
            let selection = streamer.select(&seen, shown, &roots);
            // Of nothing in view there is nothing finer.
            let at_rest = shown == detail || selection.draw.is_empty() && selection.is_converged();
            return Chosen { detail: shown, at_rest, ..own(selection) };
        };
        // Nothing comes any more of what was asked for.
        let is_over = !streamer.is_busy();
        let at_rest = (!moves).then(|| streamer.select(&seen, detail, &roots));
        let is_best = |own: &&Selection<NodeRef>| {
            is_over && self.asked == Asked::Own && !own.draw.is_empty() || own.is_converged()
        };
        if let Some(selection) = at_rest.as_ref().filter(is_best) {
            return own(selection.clone());
        }
        let few = within(depiction, splats);
        let (purpose, detail) = (few.purpose(metadata), few.detail(view, tau, metadata));
        let roots = streamer.roots(families.iter().copied(), purpose, view.time);
        let selection = streamer.select(&seen, detail, &roots);
        let has_clusters = match self.asked {
            Asked::Nothing => selection.is_converged(),
            Asked::Clusters => is_over || selection.is_converged(),
            Asked::Own => true,
        };
        self.asked = match at_rest.filter(|_| has_clusters) {
            Some(at_rest) => {
                streamer.ask(&at_rest);
                Asked::Own
            }
            None => Asked::Clusters,
        };
        Chosen { selection, detail, purpose, stands_in: true, at_rest: false }
    }
}

/// The same from clusters, within so many splats.
fn within(depiction: &Depiction, splats: u64) -> Depiction {
    let splats = Some(depiction.choice.splats.map_or(splats, |own| own.min(splats)));
    let choice = LevelChoice { levels: Levels::Clusters, splats, ..depiction.choice };
    Depiction { choice, ..depiction.clone() }
}
