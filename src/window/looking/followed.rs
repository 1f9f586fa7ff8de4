//! Selections of the open run whose members stay the same: who they are is found on a thread of its own, and where they are at the moment
//! that is shown is worked out in every frame from their tracks over one interval. The tracks of the next one are read ahead.

use crate::explore::{Center, Followed, Members, Places};
use crate::window::scene::{RunNow, Scene, Settings};
use crate::window::state::answer::Answer;
use bevy::prelude::*;
use std::sync::Arc;

/// Members whose places are worked out within a frame, at most: some milliseconds.
const AT_ONCE: u64 = 200_000;

/// The selections that are followed.
#[derive(Resource, Default)]
pub struct FollowedSets {
    sets: Vec<FollowedSet>,
    dataset: u32,
    /// Counts up with everything that becomes known.
    pub revision: u64,
}

struct FollowedSet {
    members: Members,
    who: Answer<Option<Arc<Followed>>>,
    /// Tracks of an interval on their way.
    coming: Answer<()>,
}

impl FollowedSets {
    /// What is known of a selection's members; `None` where nobody asked.
    pub fn of(&self, members: &Members) -> Option<&Answer<Option<Arc<Followed>>>> {
        self.sets.iter().find(|set| set.members == *members).map(|set| &set.who)
    }

    /// A selection whose tracks at the moment are in memory.
    fn ready(&self, members: &Members, now: &RunNow) -> Option<&Arc<Followed>> {
        let followed = self.of(members)?.here()?.as_ref()?;
        followed.knows(now.following.run().interval_at(now.moment).0).then_some(followed)
    }

    /// Where a selection's members are; `None` before that is known.
    pub fn places(&self, members: &Members, now: &RunNow) -> Option<Places> {
        let followed = self.ready(members, now).filter(|followed| followed.ids().len() <= AT_ONCE)?;
        followed.places(now.moment, now.interpolation).ok().map(Places::new)
    }

    /// Where a selection's centre of mass is; `None` before that is known, or without a particle.
    pub fn center(&self, members: &Members, now: &RunNow) -> Option<Center> {
        self.ready(members, now)?.center(now.moment, now.interpolation).ok().flatten()
    }
}

/// Finds who is followed, and reads tracks for now and for the next interval.
pub(super) fn follow(mut sets: ResMut<FollowedSets>, scene: Option<Res<Scene>>, settings: Res<Settings>) {
    let known = sets.bypass_change_detection();
    let Some(scene) = scene else { return };
    if known.dataset != scene.dataset {
        *known = FollowedSets { sets: Vec::new(), dataset: scene.dataset, revision: known.revision + 1 };
    }
    let Some(now) = RunNow::of(&scene) else { return };
    let wanted = || settings.selections.iter().map(|set| &set.members).filter(|members| members.stay());
    known.sets.retain(|set| wanted().any(|members| *members == set.members));
    for members in wanted() {
        if known.of(members).is_none() {
            let (following, members) = (Arc::clone(&now.following), members.clone());
            let asked = members.clone();
            let who = Answer::ask("members", move |work| following.of(&asked, work));
            known.sets.push(FollowedSet { members, who, coming: Answer::Nothing });
        }
    }
    let interval = now.following.run().interval_at(now.moment).0;
    let last = now.following.run().directory().intervals.len().saturating_sub(1);
    for set in &mut known.sets {
        known.revision += u64::from(set.who.receive()) + u64::from(set.coming.receive());
        let Some(Some(followed)) = set.who.here() else { continue };
        // One at a time; what has failed is not asked again and again.
        if matches!(set.coming, Answer::Coming(_) | Answer::Failed(_)) {
            continue;
        }
        let next = [interval, (interval + 1).min(last)].into_iter().find(|interval| !followed.knows(*interval));
        if let Some(interval) = next {
            let followed = Arc::clone(followed);
            set.coming = Answer::ask("tracks", move |_| followed.over(interval).map(drop));
        }
    }
}
