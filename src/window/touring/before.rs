//! The picture before a keyframe that blends into the one after it: drawn by the processor on a thread of its own, from the page file
//! itself, whatever draws the other. What a blend begins with is drawn before it begins; where the camera moves on, it is drawn again
//! as often as there is time, for where the camera will be then.

use super::{Player, Ranges};
use crate::color::Image;
use crate::color::transfer::Levels;
use crate::look::LookPatch;
use crate::mode::{Footprint, Mode};
use crate::modes;
use crate::picture::drawing_cost::DrawingCost;
use crate::picture::{AnySession, PictureError};
use crate::tour::{Blend, State, Timeline};
use crate::view::View;
use crate::window::lens::view_of;
use crate::window::look::Look;
use crate::window::picture::Picture;
use crate::window::picture_sizes::{drawing_size, moving_size, volume_limit};
use crate::window::preset::Preset;
use crate::window::scene::{Scene, Settings};
use crate::window::scene_io::viewpoint_of;
use crate::window::state::aim::Aim;
use crate::window::state::answer::Answer;
use crate::window::state::notices::Notices;
use bevy::prelude::*;
use std::sync::Arc;
use std::time::Instant;

/// How long before a blend begins its first picture is drawn, seconds.
const AHEAD: f64 = 4.0;
/// Memory for pages that it is drawn from, beside those of the window's own picture, bytes.
const BUDGET: u64 = 1 << 30;

/// What a picture is drawn from.
#[derive(Clone, PartialEq)]
struct Key {
    view: View,
    look: LookPatch,
    levels: Option<Levels>,
    limit: u64,
    dataset: u32,
}

/// A picture that is wanted.
struct Wanted {
    key: Key,
    /// The keyframe that begins with the blend.
    keyframe: usize,
    timeline: Arc<Timeline>,
    diameter: f64,
    /// Whether it is as good as it will be.
    is_final: bool,
    painted: bool,
}

/// A picture that is being drawn.
struct Coming {
    wanted: Wanted,
    since: Instant,
    answer: Answer<(AnySession, Result<(Image, u64), PictureError>)>,
}

/// A picture that has been drawn.
struct Drawn {
    wanted: Wanted,
    image: Arc<Image>,
}

/// The picture before, and what draws it.
#[derive(Resource, Default)]
pub struct Before {
    coming: Option<Coming>,
    drawn: Option<Drawn>,
    /// Counts the pictures.
    number: u64,
    /// How much of the picture after is seen; `None` without a blend, or before there is a picture.
    share: Option<f32>,
    awaited: bool,
    settled: bool,
    /// What draws it, and the [`Scene::dataset`] that it has open, as a field or as particles.
    session: Option<((u32, bool), AnySession)>,
    /// What could not be drawn.
    failed: Option<Key>,
    /// The mode and ranges of the last frame without a blend.
    last: Option<(&'static Mode, Levels)>,
    /// Size and milliseconds of the last picture of a volume.
    cost: Option<(UVec2, f64)>,
    drawing_cost: DrawingCost,
}

impl Before {
    /// The picture before, and how much of the one after is seen.
    pub fn fade(&self) -> Option<(&Arc<Image>, f32)> {
        self.drawn.as_ref().map(|drawn| &drawn.image).zip(self.share)
    }

    /// The number of that picture.
    pub fn number(&self) -> u64 {
        self.number
    }

    /// Whether there is a blend, and its picture is still being drawn.
    pub fn is_awaited(&self) -> bool {
        self.awaited
    }

    /// Whether there is no blend, or one of a picture that will not change.
    pub fn is_settled(&self) -> bool {
        self.settled
    }

    /// How long the last picture took that is drawn as this one, seconds.
    fn lag(&self) -> f64 {
        self.cost.map_or(0.0, |(_, milliseconds)| (1e-3 * milliseconds).min(1.0))
    }

    /// Takes in what has been drawn.
    fn receive(&mut self, messages: &mut Notices) {
        let Some(mut coming) = self.coming.take() else { return };
        if !coming.answer.receive() {
            self.coming = Some(coming);
            return;
        }
        let Coming { wanted, since, answer } = coming;
        let drawn = match answer {
            Answer::Here((session, drawn)) => {
                let is_field = !matches!(session, AnySession::Particles(_));
                self.session = Some(((wanted.key.dataset, is_field), session));
                drawn.map_err(|error| error.to_string())
            }
            Answer::Failed(why) => Err(why),
            Answer::Nothing | Answer::Coming(_) => return,
        };
        match drawn {
            Ok((image, taken)) => {
                let milliseconds = 1e3 * since.elapsed().as_secs_f64();
                let size = UVec2::new(image.width, image.height);
                self.cost = Some((size, milliseconds));
                if !wanted.painted {
                    self.drawing_cost.drew(taken, milliseconds);
                }
                self.number += 1;
                self.drawn = Some(Drawn { wanted, image: Arc::new(image) });
            }
            Err(why) => {
                messages.error(format!("the picture that this one blends from: {why}"));
                self.failed = Some(wanted.key);
            }
        }
    }

    /// Begins to draw.
    fn start(&mut self, wanted: Wanted, scene: &Scene) {
        let mode = wanted.key.look.mode.unwrap_or(modes::first());
        let of = (scene.dataset, scene.field_for(mode).is_some());
        let known = self.session.take().filter(|(known, _)| *known == of);
        let open = scene.opener_for(mode, BUDGET);
        let Key { view, look, levels, limit, .. } = wanted.key.clone();
        let diameter = wanted.diameter;
        let answer = Answer::ask("blend", move |_| {
            let mut session = known.map_or_else(open, |(_, session)| Ok(session))?;
            // What is missing is told where the picture itself is drawn.
            let drawn = session.image(&look, &view, levels, diameter, limit);
            Ok::<_, PictureError>((session, drawn))
        });
        self.coming = Some(Coming { wanted, since: Instant::now(), answer });
    }
}

/// The picture that is blended with at a moment, or at one that comes soon, and the keyframe that begins with it.
fn next_blend(timeline: &Timeline, state: &State, waiting: Option<usize>) -> Option<(Blend, State)> {
    if let Some(blend) = &state.blend {
        return Some((blend.clone(), state.clone()));
    }
    // Whoever waits for a presenter goes on from the end of the pause.
    let from = waiting.and_then(|keyframe| timeline.stops().get(keyframe)).map_or(state.time, |stop| stop.leave);
    let coming = timeline.stops().iter().filter(|stop| stop.fade > 0.0 && stop.arrive > state.time);
    let next = coming.min_by(|a, b| a.arrive.total_cmp(&b.arrive)).filter(|stop| stop.arrive - from <= AHEAD)?;
    let then = timeline.state(next.arrive);
    Some((then.blend.clone()?, then))
}

/// Draws the picture before.
pub fn draw_before(
    mut before: ResMut<Before>,
    player: Res<Player>,
    ranges: Res<Ranges>,
    (scene, settings, look): (Option<Res<Scene>>, Res<Settings>, Option<Res<Look>>),
    (picture, aim, preset): (Res<Picture>, Option<Res<Aim>>, Res<Preset>),
    mut messages: ResMut<Notices>,
) {
    let before = before.bypass_change_detection();
    before.receive(messages.bypass_change_detection());
    (before.share, before.awaited, before.settled) = (None, false, true);
    let (Some(scene), Some(state), Some(timeline)) = (scene, player.state(), player.timeline()) else {
        if before.coming.is_none() && player.tour().is_none() {
            (before.drawn, before.session) = (None, None);
        }
        return;
    };
    if state.blend.is_none() {
        before.last = look.map(|look| (look.depiction.mode, look.levels));
    }
    let Some((mut blend, mut then)) = next_blend(timeline, state, player.clock().waiting()) else { return };
    let is_now = state.blend.is_some();
    // Where the camera moves, it will have moved on when the picture is there.
    let is_moving = is_now && player.clock().is_running() && {
        let stop = timeline.stops().get(state.keyframe);
        let end = stop.map_or(state.time, |stop| stop.arrive + stop.fade - 1e-6);
        let later = timeline.state((state.time + before.lag().max(0.02)).min(end));
        let moved = later.blend.clone().filter(|later| later.camera != blend.camera);
        let is_moving = moved.is_some();
        if let Some(moved) = moved {
            (blend, then) = (moved, later);
        }
        is_moving
    };
    let exposed = ranges.exposed(timeline, then.keyframe.saturating_sub(1), then.time, &blend.look);
    let Ok(depiction) = scene.depict(&blend.look).map(|depiction| depiction.blended()) else { return };
    let numbers = exposed.as_ref().and_then(|look| look.transfer.as_ref()?.numbers());
    let levels = numbers.or(before.last.filter(|(mode, _)| *mode == depiction.mode).map(|last| last.1));
    let painted = depiction.mode.is_light();
    let full = picture.size();
    let motion = &preset.motion;
    let size = match (is_moving, painted) {
        (false, _) => full,
        (true, true) => moving_size(full, before.cost, motion.volume_ms, motion),
        (true, false) => {
            let fixed_discs = matches!(depiction.footprint(), Footprint::Pixels(_));
            drawing_size(full, true, fixed_discs, motion)
        }
    };
    let limit = match (is_moving, painted) {
        (false, _) => u64::MAX,
        (true, true) => volume_limit(true, false, u64::MAX, motion),
        (true, false) => before.drawing_cost.limit(motion.volume_ms, motion.sample_sizes()),
    };
    let (place, lens) = viewpoint_of(&blend.camera);
    let cut = blend.look.cut.unwrap_or_default();
    let own = Settings { lens, look: crate::look::Look { cut, ..settings.look.clone() }, ..settings.clone() };
    let Ok(view) = view_of(&place, &own, scene.periodic, size, aim.as_deref()) else { return };
    let look = exposed.unwrap_or(blend.look);
    let look = LookPatch { time: look.time.or(scene.when()), ..look };
    let key = Key { view, look, levels, limit, dataset: scene.dataset };
    let keyframe = then.keyframe;
    let is_same = |known: &Wanted| known.keyframe == keyframe && Arc::ptr_eq(&known.timeline, timeline);
    let there = before.drawn.as_ref().filter(|drawn| is_same(&drawn.wanted));
    let is_drawn = there.is_some_and(|drawn| drawn.wanted.key == key);
    let has_failed = before.failed.as_ref() == Some(&key);
    if is_now {
        before.share = state.blend.as_ref().filter(|_| there.is_some()).map(|blend| blend.share as f32);
        before.awaited = there.is_none() && !has_failed;
        before.settled = has_failed || there.is_some_and(|drawn| is_drawn && drawn.wanted.is_final);
    }
    if is_drawn || has_failed || before.coming.is_some() {
        return;
    }
    let diameter = scene.frame.size().length();
    let timeline = Arc::clone(timeline);
    before.start(Wanted { key, keyframe, timeline, diameter, is_final: !is_moving, painted }, &scene);
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed helper fails its test")]
mod tests {
    use super::*;
    use crate::picture::Session;
    use crate::picture::ranges::Format;
    use crate::tour::TourFile;
    use crate::view::Surround;
    use crate::window::exposure::Exposure;
    use crate::window::look::{Held, follow_settings, glide_levels};
    use crate::window::touring::Asked;
    use crate::window::touring::player::play_tour;
    use crate::window::touring::player::tests::Window;
    use crate::window::touring::ranges::{hold_ranges, measure_ahead};
    use crate::window::touring::tests::surroundings;
    use crate::window::transfer_presets::TransferPresets;

    /// A cut to a volume at 3 s, a blend on the move to another mode at 8 s.
    const TOUR: &str = r#"(version: 1, size: (300, 200), keyframes: [
        (at: 0.0, mode: "density-squared", camera: (eye: (25.0, 30.0, 140.0), target: (25.0, 25.0, 25.0))),
        (at: 3.0, move: cut, fade: 2.0, mode: "column-density", camera: (eye: (90.0, 30.0, 60.0), target: (25.0, 25.0, 25.0))),
        (at: 8.0, fade: 2.0, mode: "volume", camera: (eye: (90.0, 30.0, 20.0), target: (25.0, 25.0, 25.0))),
        (at: 12.0, camera: (eye: (60.0, 30.0, -40.0), target: (25.0, 25.0, 25.0))),
    ])"#;

    fn window() -> Window {
        let mut window = Window::new();
        let systems = (follow_settings, measure_ahead, hold_ranges, glide_levels, draw_before);
        window
            .app
            .init_resource::<Ranges>()
            .init_resource::<Held>()
            .init_resource::<Before>()
            .init_resource::<Exposure>()
            .init_resource::<Preset>()
            .init_resource::<TransferPresets>()
            .add_systems(Update, systems.chain().after(play_tour));
        window.open(&TourFile::parse("test", TOUR).unwrap());
        // It begins by itself.
        window.frame(0.0);
        window.ask(Asked::Toggle);
        window
    }

    fn before(window: &Window) -> &Before {
        window.app.world().resource()
    }

    #[test]
    fn a_blend_begins_with_the_picture_that_was_there() {
        let mut window = window();
        let timeline = Arc::clone(window.player().timeline().unwrap());
        let all = |app: &App| matches!(app.world().resource::<Ranges>().progress(), [known, all] if known == all);
        window.wait("ranges", all);
        // Drawn before it begins.
        window.ask(Asked::Seek(2.0));
        window.wait("the picture", |app| app.world().resource::<Before>().drawn.is_some());
        window.wait("its thread", |app| app.world().resource::<Before>().coming.is_none());
        assert!(before(&window).fade().is_none() && before(&window).is_settled());
        window.ask(Asked::Seek(4.0));
        window.frame(0.0);
        let (image, share) = before(&window).fade().unwrap();
        assert!((share - 0.5).abs() < 1e-6 && before(&window).is_settled() && !before(&window).is_awaited(), "{share}");
        // It is the picture of the end of what was before, with the ranges that a recording finds there.
        let scene = window.app.world().resource::<Scene>();
        let mut session = Session::of(Arc::clone(&scene.file), u64::MAX);
        let end = timeline.state(3.0 - 1e-6);
        let format = Format { size: (300, 200), surround: Surround::Flat };
        let found = session.ranges(&end.look, &end.camera, format).unwrap();
        let diameter = scene.frame.size().length();
        let view = end.camera.view(900, 600).unwrap();
        let (expected, _) = session.image(&end.look, &view, Some(found.levels), diameter, u64::MAX).unwrap();
        let pairs = image.rgba.as_flattened().iter().zip(expected.rgba.as_flattened());
        let most = pairs.map(|(a, b)| a.abs_diff(*b)).max();
        assert!((image.width, image.height) == (900, 600) && most <= Some(1), "{most:?}");
        assert!(expected.rgba.iter().filter(|pixel| pixel[0] > 60).count() > 2000, "there is something to see");
        window.ask(Asked::Seek(6.0));
        window.frame(0.0);
        assert!(before(&window).fade().is_none());
    }

    #[test]
    fn on_the_move_it_is_drawn_again_and_again() {
        let mut window = window();
        // Ranges that are found later are another picture.
        let all = |app: &App| matches!(app.world().resource::<Ranges>().progress(), [known, all] if known == all);
        window.wait("ranges", all);
        window.ask(Asked::Seek(7.9));
        window.wait("the first picture", |app| app.world().resource::<Before>().drawn.is_some());
        window.wait("its thread", |app| app.world().resource::<Before>().coming.is_none());
        window.ask(Asked::Toggle);
        window.frame(0.1);
        let mut views = Vec::new();
        while window.player().state().unwrap().time < 8.85 {
            // The clock stands while it is drawn.
            let number = before(&window).number();
            window.frame(0.1);
            window.wait("another picture", |app| app.world().resource::<Before>().number() > number);
            views.push(before(&window).drawn.as_ref().unwrap().wanted.key.view);
            assert!(before(&window).fade().is_some() && !before(&window).is_settled());
        }
        assert!(views.len() > 6 && views.windows(2).all(|pair| pair[0].eye != pair[1].eye), "{}", views.len());
        assert!(views.iter().all(|view| view.width < 900), "smaller in motion");
        // At rest it becomes what it is to be.
        window.ask(Asked::Seek(9.0));
        window.ask(Asked::Toggle);
        window.wait("rest", |app| app.world().resource::<Before>().is_settled());
        let state = window.player().state().unwrap().clone();
        let view = before(&window).drawn.as_ref().unwrap().wanted.key.view;
        assert!(view.eye.to_array() == state.blend.unwrap().camera.eye && view.width == 900);
    }

    #[test]
    fn what_comes_soon_is_known() {
        let timeline = Timeline::new(&TourFile::parse("test", TOUR).unwrap(), &surroundings()).unwrap();
        let at =
            |time: f64, waiting| next_blend(&timeline, &timeline.state(time), waiting).map(|(_, then)| then.keyframe);
        assert_eq!(
            [0.0, 2.0, 3.5, 4.99, 5.5, 7.0, 10.5].map(|time| at(time, None)),
            [Some(1), Some(1), Some(1), Some(1), Some(2), Some(2), None]
        );
        let far = TOUR.replace("at: 3.0", "at: 5.0");
        let timeline = Timeline::new(&TourFile::parse("test", &far).unwrap(), &surroundings()).unwrap();
        assert!(next_blend(&timeline, &timeline.state(0.5), None).is_none());
    }
}
