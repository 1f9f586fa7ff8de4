//! Selections by id in the open file: page files hold no ids, so the source is searched for each such set once, and what is found
//! is kept as long as the file is open and the set is there.

use super::prober::opened;
use crate::explore::{Data, ExploreError, FoundIds, Highlighter, IdSet, Members, Show, ids_of};
use crate::window::scene::{Scene, Settings};
use crate::window::state::answer::Answer;
use crate::window::state::notices::Notices;
use bevy::prelude::*;
use std::sync::Arc;

/// The sets of ids that have been looked up in the open file.
#[derive(Resource, Default)]
pub struct LookedUp {
    sets: Vec<Lookup>,
    generation: u32,
    /// Counts up with every answer that arrives.
    pub revision: u64,
}

/// A set and where its particles are.
struct Lookup {
    ids: IdSet,
    answer: Answer<FoundIds>,
}

impl LookedUp {
    /// What is known of a set; `None` where it was not looked up: nobody shows it.
    pub fn of(&self, ids: &IdSet) -> Option<&Answer<FoundIds>> {
        self.sets.iter().find(|lookup| lookup.ids == *ids).map(|lookup| &lookup.answer)
    }

    /// What marks a set's particles, where it has been found.
    pub fn highlighter(&self, ids: &IdSet) -> Option<Arc<Highlighter>> {
        Some(Arc::clone(&self.of(ids)?.here()?.highlighter))
    }
}

/// Looks up the sets that are shown, one after the other, and forgets those that are gone.
pub(super) fn look_up(mut looked_up: ResMut<LookedUp>, scene: Option<Res<Scene>>, settings: Res<Settings>) {
    let looked_up = looked_up.bypass_change_detection();
    let Some(scene) = scene else { return };
    if looked_up.generation != scene.generation {
        *looked_up = LookedUp { sets: Vec::new(), generation: scene.generation, revision: looked_up.revision + 1 };
    }
    for lookup in &mut looked_up.sets {
        looked_up.revision += u64::from(lookup.answer.receive());
    }
    // A run with tracks knows its ids itself.
    let is_followed = scene.following.is_some();
    let sets = || settings.selections.iter().filter(|_| !is_followed);
    let all = || sets().filter_map(|set| Some((set.members.ids()?, set.show)));
    looked_up.sets.retain(|lookup| all().any(|(ids, _)| *ids == lookup.ids));
    // Each reads all of the source.
    if looked_up.sets.iter().any(|lookup| matches!(lookup.answer, Answer::Coming(_))) {
        return;
    }
    let next = all().find(|(ids, show)| *show != Show::Hidden && looked_up.of(ids).is_none());
    if let Some((ids, _)) = next {
        let (file, source, wanted) = (Arc::clone(&scene.file), scene.source(), ids.clone());
        let answer = Answer::ask("ids", move |work| {
            FoundIds::of(opened(&file, source)?.as_ref(), &wanted, file.metadata(), work)
        });
        looked_up.sets.push(Lookup { ids: ids.clone(), answer });
    }
}

/// A region's particles on their way to being kept by their ids.
#[derive(Resource, Default)]
pub struct ByIds {
    /// The region.
    of: Option<Members>,
    /// The ids.
    pub answer: Answer<IdSet>,
}

impl ByIds {
    /// Asks the source for the ids of a selection's particles.
    pub fn ask(&mut self, scene: &Scene, members: &Members) {
        let (file, source) = (Arc::clone(&scene.file), scene.source());
        self.of = Some(members.clone());
        let members = members.clone();
        self.answer = Answer::ask("ids", move |work| {
            let source = opened(&file, source)?;
            let periodic = Data::Pages(&file).periodic_edge()?;
            let ids = ids_of(source.as_ref(), &members, periodic, work)?;
            match ids.is_empty() {
                true => {
                    Err(ExploreError::missing(&source.description().path, "ids of particles in it", "one at least"))
                }
                false => Ok(ids),
            }
        });
    }

    /// Whether the ids of this selection are being looked for.
    pub fn is_asked(&self, members: &Members) -> bool {
        matches!(self.answer, Answer::Coming(_)) && self.of.as_ref() == Some(members)
    }
}

/// Puts the ids that have been found in the place of the region.
pub(super) fn keep_ids(mut by_ids: ResMut<ByIds>, mut settings: ResMut<Settings>, mut notices: ResMut<Notices>) {
    let by_ids = by_ids.bypass_change_detection();
    if !by_ids.answer.receive() {
        return;
    }
    match (std::mem::take(&mut by_ids.answer), by_ids.of.take()) {
        (Answer::Here(ids), Some(of)) => {
            let count = crate::annotate::number::count(ids.len());
            // It may have been removed meanwhile.
            let Some(at) = settings.selections.iter().position(|set| set.members == of) else { return };
            let set = &mut settings.selections[at];
            notices.info(format!("{}: {count} particles, from now on known by their ids", set.name));
            set.members = Members::Ids(ids);
        }
        (Answer::Failed(why), _) => notices.error(why),
        _ => {}
    }
}
