//! A tour that another machine leads: it says what time it is, and this one shows words and pictures of that moment.

use super::{FORESIGHT_SECS, Player};
use crate::tour::TourFile;
use crate::window::camera::Viewpoint;
use crate::window::scene::Scene;
use crate::window::scene_io::viewpoint_of;
use crate::window::state::notices::Notices;
use std::path::Path;

impl Player {
    /// Takes the tour of a leader in the place of the one that is open.
    /// `text` is the tour's, `folder` the one that its pictures are named from, and `aspect` width over height of the leader's picture.
    pub fn follow(&mut self, tour: TourFile, text: String, folder: &Path, aspect: f64) {
        let path = Some(folder.join("the leader's tour"));
        *self = Player { tour: Some(tour), path, text, aspect: Some(aspect), ..Player::default() };
    }

    /// Shows the moment of the tour that the leader told at the program's time `heard`, seconds of the tour and whether it runs, or
    /// that none is shown: its words and pictures only, because camera and settings are the leader's. Where the camera is to be in
    /// a moment.
    pub fn show_moment(
        &mut self,
        moment: Option<(f64, bool)>,
        (heard, now): (f64, f64),
        scene: &Scene,
        notices: &mut Notices,
    ) -> Option<Viewpoint> {
        if self.tour.is_some() && self.dataset != scene.dataset {
            self.resolve(scene, self.aspect.unwrap_or(1.0), notices);
        }
        let (Some((time, running)), Some(timeline)) = (moment, &self.timeline) else {
            self.clock.stand(now);
            self.state = None;
            return None;
        };
        self.clock.lead(heard, time, running);
        let at = self.clock.tick(now, timeline);
        let state = timeline.state(at);
        let next = running.then(|| viewpoint_of(&timeline.state(at + FORESIGHT_SECS).camera).0);
        self.shown = Some(state.look.clone());
        self.state = Some(state);
        next
    }
}
