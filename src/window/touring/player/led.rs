//! A tour that another machine leads: it says what time it is, and this one shows words and pictures of that moment.

use super::{FORESIGHT, Player};
use crate::show::protocol::Moment;
use crate::show::protocol::follower::LedTour;
use crate::window::camera::Viewpoint;
use crate::window::messages::Messages;
use crate::window::scene::Scene;
use crate::window::scene_io::viewpoint_of;

impl Player {
    /// Takes the tour of a leader in the place of the one that is open.
    pub(crate) fn follow(&mut self, led: Option<LedTour>) {
        *self = match led {
            Some(LedTour { tour, text, folder, aspect }) => {
                let path = Some(folder.join("the leader's tour"));
                Player { tour: Some(tour), path, text, aspect: Some(aspect), ..Player::default() }
            }
            None => Player::default(),
        };
    }

    /// Shows the moment of the tour that the leader told at the program's time `heard`, or that none is shown: its words and pictures
    /// only, because camera and settings are the leader's. Where the camera is to be in a moment.
    pub(crate) fn show_moment(
        &mut self,
        moment: Option<Moment>,
        (heard, now): (f64, f64),
        scene: &Scene,
        messages: &mut Messages,
    ) -> Option<Viewpoint> {
        if self.tour.is_some() && self.generation != scene.generation {
            self.resolve(scene, self.aspect.unwrap_or(1.0), messages);
        }
        let (Some(moment), Some(timeline)) = (moment, &self.timeline) else {
            self.clock.stand(now);
            self.state = None;
            return None;
        };
        self.clock.lead(heard, moment.time, moment.running);
        let at = self.clock.tick(now, timeline);
        let state = timeline.state(at);
        let next = moment.running.then(|| viewpoint_of(&timeline.state(at + FORESIGHT).camera).0);
        self.shown = Some(state.look.clone());
        self.state = Some(state);
        next
    }
}
