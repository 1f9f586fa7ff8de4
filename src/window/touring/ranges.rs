//! The ranges of the open tour's colours, found in advance as a recording finds them: on a thread of their own, a moment at a time,
//! those first that are needed first. While the tour is shown and its ranges are known, the picture has these.

use super::Player;
use crate::color::transfer::Levels;
use crate::look::LookPatch;
use crate::mode::Footprint;
use crate::picture::ranges::{Format, Measured};
use crate::picture::{AnySession, PictureError, Session};
use crate::tour::exposure::{Exposure, Moment, is_searched};
use crate::tour::{State, Timeline, TourFile};
use crate::view::Surround;
use crate::window::look::{Held, Look};
use crate::window::picture::Picture;
use crate::window::run_ranges::RunRanges;
use crate::window::scene::{Scene, Settings};
use crate::window::state::answer::Answer;
use bevy::prelude::*;
use std::collections::HashSet;
use std::sync::Arc;

/// Memory for pages that moments are drawn from, beside those of the window's own picture, bytes.
const BUDGET: u64 = 512 << 20;

/// What is known of the tour's ranges.
#[derive(Resource, Default)]
pub struct Ranges {
    tour: Option<Rehearsed>,
    coming: Option<Coming>,
    /// What draws for it, and the [`Scene::generation`] of its file, as a field or as particles.
    session: Option<((u32, bool), AnySession)>,
}

/// A moment that is being drawn.
struct Coming {
    timeline: Arc<Timeline>,
    moment: Moment,
    generation: u32,
    answer: Answer<(AnySession, Result<Measured, PictureError>)>,
}

/// A tour, and what is known of it.
struct Rehearsed {
    timeline: Arc<Timeline>,
    generation: u32,
    format: Format,
    /// The window's rows, where ranges depend on them.
    rows: Option<u32>,
    exposure: Exposure,
    moments: Vec<Moment>,
    /// What cannot be drawn.
    failed: HashSet<Moment>,
}

impl Rehearsed {
    /// Nothing is known of it, but what was known of the one before and shows the same.
    fn new(
        timeline: &Arc<Timeline>,
        tour: &TourFile,
        scene: &Scene,
        rows: u32,
        before: Option<Rehearsed>,
    ) -> Rehearsed {
        let format = Format { size: tour.size, surround: tour.projection };
        let in_pixels = timeline.stops().iter().enumerate().any(|(index, stop)| {
            let depiction = scene.depict(&timeline.look(index, stop.arrive));
            depiction.is_ok_and(|depiction| matches!(depiction.footprint(), Footprint::Pixels(_)))
        });
        let rows = in_pixels.then_some(rows);
        let mut exposure = Exposure::new(timeline);
        let alike = |old: &Rehearsed| (old.generation, old.format, old.rows) == (scene.generation, format, rows);
        if let Some(old) = before.filter(alike) {
            exposure.keep(&old.exposure, timeline, |time| {
                let [was, is] = [&old.timeline, timeline].map(|timeline| timeline.state(time));
                was.camera == is.camera && was.look == is.look
            });
        }
        let moments = exposure.moments(timeline);
        let (timeline, generation) = (Arc::clone(timeline), scene.generation);
        Rehearsed { timeline, generation, format, rows, exposure, moments, failed: HashSet::new() }
    }

    /// The moment to draw now, for one who is at a time after a keyframe: what is needed there, what comes after, and the rest.
    fn next(&self, keyframe: usize, time: f64) -> Option<Moment> {
        let now = self.exposure.needed(keyframe, time);
        let is_open = |moment: &&Moment| !self.exposure.knows(**moment) && !self.failed.contains(moment);
        let needed = now.iter().filter(|moment| self.moments.contains(moment)).find(is_open);
        let later = || self.moments.iter().filter(|moment| self.exposure.time(**moment) >= time).find(is_open);
        needed.or_else(later).or_else(|| self.moments.iter().find(is_open)).copied()
    }

    /// The ranges of the picture's look at a moment of the tour, where they are known and the picture shows what was measured.
    fn levels(&self, state: &State, look: &Look) -> Option<Levels> {
        let shown = LookPatch { transfer: Some(look.transfer.clone()), ..state.look.clone() };
        if is_searched(&shown) {
            self.exposure.measured(state.keyframe, state.time).filter(|measured| look.shows(measured))?;
        }
        self.exposure.exposed(state.keyframe, state.time, &shown)?.transfer?.numbers()
    }
}

impl Ranges {
    /// How many moments are known, and how many there are.
    pub fn progress(&self) -> [usize; 2] {
        self.tour.as_ref().map_or([0; 2], |tour| {
            let known = tour.moments.iter().filter(|moment| tour.exposure.knows(**moment)).count();
            [known, tour.moments.len()]
        })
    }

    /// A look after a keyframe as it is at a time of this tour, with numbers for its ranges; `None` before they are known.
    pub fn exposed(&self, timeline: &Arc<Timeline>, keyframe: usize, time: f64, look: &LookPatch) -> Option<LookPatch> {
        let tour = self.tour.as_ref().filter(|tour| Arc::ptr_eq(&tour.timeline, timeline))?;
        tour.exposure.exposed(keyframe, time, look)
    }

    /// Takes in what has been drawn.
    fn receive(&mut self) {
        let Some(mut coming) = self.coming.take() else { return };
        if !coming.answer.receive() {
            self.coming = Some(coming);
            return;
        }
        let tour = self.tour.as_mut().filter(|tour| Arc::ptr_eq(&tour.timeline, &coming.timeline));
        let measured = match coming.answer {
            Answer::Here((session, measured)) => {
                let is_field = !matches!(session, AnySession::Particles(_));
                self.session = Some(((coming.generation, is_field), session));
                measured.ok()
            }
            _ => None,
        };
        let Some(tour) = tour else { return };
        match measured {
            Some(measured) => tour.exposure.take(coming.moment, measured),
            // The picture's own ranges are used there.
            None => drop(tour.failed.insert(coming.moment)),
        }
    }

    /// Begins to draw a moment.
    fn start(&mut self, moment: Moment, scene: &Scene) {
        let Some(tour) = &self.tour else { return };
        let State { look, camera, .. } = tour.timeline.state(tour.exposure.time(moment));
        let field = look.mode.and_then(|mode| scene.field_for(mode));
        let of = (scene.generation, field.is_some());
        let known = self.session.take().filter(|(known, _)| *known == of);
        let open = || match field {
            Some(field) => field.opened.drawer(Arc::new(())),
            None => AnySession::Particles(Box::new(Session::of(Arc::clone(&scene.file), BUDGET))),
        };
        let mut session = known.map_or_else(open, |(_, session)| session);
        let format = match tour.rows {
            // Dots are compared with those of a window, whose picture is flat.
            Some(rows) if scene.depict(&look).is_ok_and(|own| own.footprint() != Footprint::Kernel) => {
                let aspect = f64::from(tour.format.size.0) / f64::from(tour.format.size.1.max(1));
                let width = (f64::from(rows) * aspect).round().clamp(1.0, 16384.0) as u32;
                Format { size: (width, rows), surround: Surround::Flat }
            }
            _ => tour.format,
        };
        let draw = move || {
            // What is missing is told where the picture itself is drawn.
            let measured = session.ranges(&look, &camera, format);
            (session, measured)
        };
        let answer = Answer::ask("tour", move |_| {
            // A part of the processor only: the window's picture needs it more.
            let all = std::thread::available_parallelism().map_or(1, usize::from);
            let few = rayon::ThreadPoolBuilder::new().num_threads((all / 4).max(1)).build();
            few.map(|few| few.install(draw))
        });
        let (timeline, generation) = (Arc::clone(&tour.timeline), scene.generation);
        self.coming = Some(Coming { timeline, moment, generation, answer });
    }
}

/// Draws the open tour's moments, one after the other.
pub fn measure_ahead(
    mut ranges: ResMut<Ranges>,
    player: Res<Player>,
    scene: Option<Res<Scene>>,
    picture: Res<Picture>,
) {
    let ranges = ranges.bypass_change_detection();
    ranges.receive();
    let (Some(scene), Some(tour), Some(timeline)) = (scene, player.tour(), player.timeline()) else {
        // In the frame of an edit there is no timeline.
        if player.tour().is_none() {
            (ranges.tour, ranges.session) = (None, None);
        }
        return;
    };
    let rows = picture.size().y;
    let is_known = ranges.tour.as_ref().is_some_and(|known| {
        Arc::ptr_eq(&known.timeline, timeline)
            && known.generation == scene.generation
            && known.format == (Format { size: tour.size, surround: tour.projection })
            && known.rows.is_none_or(|known| known == rows)
    });
    if !is_known {
        ranges.tour = Some(Rehearsed::new(timeline, tour, &scene, rows, ranges.tour.take()));
    }
    if ranges.coming.is_some() {
        return;
    }
    let (keyframe, time) = player.state().map_or((0, 0.0), |state| (state.keyframe, state.time));
    match ranges.tour.as_ref().and_then(|tour| tour.next(keyframe, time)) {
        Some(moment) => ranges.start(moment, &scene),
        // All ranges are known: its pages are not needed any more.
        None => ranges.session = None,
    }
}

/// Gives the picture the ranges of the tour's moment that is shown, without a tour those of the run.
pub fn hold_ranges(
    (ranges, run): (Res<Ranges>, Option<Res<RunRanges>>),
    player: Res<Player>,
    (look, settings): (Option<Res<Look>>, Option<Res<Settings>>),
    mut held: ResMut<Held>,
) {
    // Each picture has its own, or an eye adapts to what is seen.
    let is_held = settings.is_none_or(|settings| settings.exposure.is_found_ahead());
    let of_run = || run.filter(|_| is_held)?.levels(look.as_deref()?);
    let known = ranges.tour.as_ref().zip(player.state()).zip(look.as_deref());
    let same = |tour: &Rehearsed| player.timeline().is_some_and(|timeline| Arc::ptr_eq(&tour.timeline, timeline));
    let levels = known.filter(|((tour, _), _)| same(tour)).and_then(|((tour, state), look)| tour.levels(state, look));
    // A tour that is shown has ranges along its way, else those of the run that is open are held.
    let levels = if player.state().is_some() { levels } else { of_run() };
    held.set_if_neq(Held(levels));
}

#[cfg(all(test, feature = "viewer"))]
#[allow(clippy::unwrap_used, reason = "a failed helper fails its test")]
mod tests {
    use super::*;
    use crate::window::exposure::Exposure as Own;
    use crate::window::look::{follow_settings, glide_levels};
    use crate::window::state::choices::Choices;
    use crate::window::touring::Asked;
    use crate::window::touring::player::play_tour;
    use crate::window::touring::player::tests::Window;
    use crate::window::transfer_presets::TransferPresets;
    use std::path::Path;

    /// A window with the shipped tour, at a small size.
    fn window() -> Window {
        let mut window = Window::new();
        let world = window.app.world_mut();
        world.resource_mut::<Choices>().attributes = vec!["speed".into()];
        window
            .app
            .init_resource::<Ranges>()
            .init_resource::<Held>()
            .init_resource::<Own>()
            .init_resource::<TransferPresets>()
            .add_systems(Update, (follow_settings, measure_ahead, hold_ranges, glide_levels).chain().after(play_tour));
        let mut tour = TourFile::read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/tours/demo.ron")).unwrap();
        tour.size = (320, 180);
        tour.dataset = None;
        window.open(&tour);
        window
    }

    fn look(window: &Window) -> Look {
        window.app.world().resource::<Look>().clone()
    }

    #[test]
    fn colours_have_the_ranges_that_a_recording_finds() {
        let mut window = window();
        // The clock stands, and goes to a moment far away: that one is looked for first.
        // It begins by itself.
        window.frame(0.0);
        window.ask(Asked::Toggle);
        window.ask(Asked::Seek(50.0));
        window.wait("ranges", |app| app.world().resource::<Held>().0.is_some());
        let [known, all] = window.app.world().resource::<Ranges>().progress();
        assert!(known < 12 && all > 40, "{known} of {all}");
        window.wait("all ranges", |app| {
            let [known, all] = app.world().resource::<Ranges>().progress();
            known == all && all > 0
        });
        let file = Arc::clone(&window.app.world().resource::<Scene>().file);
        let mut session = Session::of(file, u64::MAX);
        let format = Format { size: (320, 180), surround: Surround::Flat };
        let timeline = Arc::clone(window.player().timeline().unwrap());
        let mut modes = HashSet::new();
        for i in 0..11 {
            let time = 1.0 + 5.7 * f64::from(i);
            window.ask(Asked::Seek(time));
            window.frame(0.0);
            let (own, state) = (look(&window), timeline.state(time));
            modes.insert(own.depiction.mode.name);
            assert!(own.settled);
            // A picture of this very moment finds the same, as far as a curve between moments can be that.
            let here = session.ranges(&state.look, &state.camera, format).unwrap();
            let ratio = |range: [f64; 2]| range[1] / range[0];
            let apart = |a: f64, b: f64| (a / b).ln().abs() / ratio(here.levels.p).ln();
            for k in 0..2 {
                let [found, expected] = [own.levels.p[k], here.levels.p[k]];
                assert!(apart(found, expected) < 0.06, "{time}: {found} {expected}");
            }
        }
        assert_eq!(modes.len(), 3, "{modes:?}");
        // Words change no picture; another mode from a keyframe on changes those after it.
        window.ask(Asked::Caption(2, "Other words".into()));
        window.frame(0.0);
        assert_eq!(window.app.world().resource::<Ranges>().progress()[0], all);
        window.ask(Asked::Remove(11));
        window.frame(0.0);
        let [kept, left] = window.app.world().resource::<Ranges>().progress();
        assert!(kept > left / 2 && left < all, "{kept} of {left}");
        // What the user sets is the user's.
        window.ask(Asked::Seek(20.0));
        window.wait("ranges", |app| app.world().resource::<Held>().0.is_some());
        window.app.world_mut().resource_mut::<crate::window::scene::Settings>().transfer.scale =
            crate::color::transfer::Scale::Linear;
        window.frame(0.0);
        assert_eq!(*window.app.world().resource::<Held>(), Held(None));
    }
}
