//! When the next frame comes: at once while something moves, later while nothing does, so that a window that is only looked at leaves
//! the machine, and its battery, to others.

use super::camera::Viewpoint;
use super::live::LiveParticles;
use super::open::Openings;
use super::picture::DataCamera;
use super::playhead::Playhead;
use super::scene::Scene;
use super::state::show::ShowStatus;
use super::statistics::{ActiveBackend, Converged, FrameClock};
use super::touring::Player;
use bevy::prelude::*;
use bevy::window::{RequestRedraw, WindowEvent};
use bevy::winit::{UpdateMode, WinitSettings};
use bevy_egui::egui::Event;
use bevy_egui::{EguiContext, EguiInput, EguiPreUpdateSet};
use std::time::Duration;

/// How long frames follow one another after the last key, click or motion, seconds: panels unfold, answers come.
const STIRRED_SECS: f64 = 0.5;

/// When the next frame comes.
#[derive(Resource, Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pacing {
    /// At once: something moves, the adapter draws a part of the picture each frame, or a system asks for a frame by Bevy's
    /// [`RequestRedraw`].
    #[default]
    Moving,
    /// After two frames' time: the processor draws, and needs the time that frames would take.
    Working,
    /// After four frames' time.
    Resting,
}

impl Pacing {
    /// How long the next frame waits at most where frames cost `frame_ms`; keys and the mouse end it sooner.
    fn mode(self, frame_ms: f64) -> UpdateMode {
        let after = |frames: f64, [least, most]: [f64; 2]| {
            UpdateMode::reactive_low_power(Duration::from_secs_f64(1e-3 * (frames * frame_ms).clamp(least, most)))
        };
        match self {
            Pacing::Moving => UpdateMode::Continuous,
            Pacing::Working => after(2.0, [16.0, 100.0]),
            Pacing::Resting => after(4.0, [50.0, 250.0]),
        }
    }
}

/// Adds the systems.
pub(super) struct PacingPlugin;

impl Plugin for PacingPlugin {
    fn build(&self, app: &mut App) {
        app.init_resource::<Pacing>()
            .add_systems(PreUpdate, tick_frame_clock)
            .add_systems(
                PreUpdate,
                drop_unchanged_modifiers.after(EguiPreUpdateSet::ProcessInput).before(EguiPreUpdateSet::BeginPass),
            )
            .add_systems(Last, pace);
    }
}

/// Measures the frames that follow one another: their durations say what a frame costs.
fn tick_frame_clock(time: Res<Time<Real>>, pacing: Res<Pacing>, mut clock: ResMut<FrameClock>) {
    if *pacing == Pacing::Moving {
        clock.tick(time.delta_secs_f64());
    }
}

/// egui draws once more for whatever it is told, and is told its modifier keys in every frame: alone and unchanged they are no news.
fn drop_unchanged_modifiers(mut contexts: Query<(&mut EguiInput, &mut EguiContext)>) {
    for (mut input, mut context) in &mut contexts {
        if let [Event::ModifiersChanged(modifiers)] = input.events[..]
            && modifiers == context.get_mut().input(|state| state.modifiers)
        {
            input.events.clear();
        }
    }
}

/// What the last frame had, and when something moved last.
#[derive(Default)]
struct Seen {
    viewpoint: Option<Viewpoint>,
    moved_secs: f64,
}

/// Settles when the next frame comes.
fn pace(
    (time, mut events, mut requests): (Res<Time<Real>>, MessageReader<WindowEvent>, MessageReader<RequestRedraw>),
    (scene, openings, converged, backend): (Option<Res<Scene>>, Res<Openings>, Res<Converged>, Res<ActiveBackend>),
    (player, playhead, show): (Res<Player>, Option<Res<Playhead>>, Option<Res<ShowStatus>>),
    (live, camera, clock): (Res<LiveParticles>, Single<&Viewpoint, With<DataCamera>>, Res<FrameClock>),
    mut seen: Local<Seen>,
    mut pacing: ResMut<Pacing>,
    mut winit: ResMut<WinitSettings>,
) {
    let now = time.elapsed_secs_f64();
    let has_input = events.read().count() > 0;
    let is_asked = requests.read().count() > 0;
    let viewpoint = Some(**camera);
    if has_input || seen.viewpoint != viewpoint {
        *seen = Seen { viewpoint, moved_secs: now };
    }
    let moves = is_asked
        || live.is_changed()
        || player.clock().is_running()
        || player.is_recording()
        || playhead.is_some_and(|playhead| playhead.is_playing())
        || show.is_some();
    let is_drawing = scene.is_some() && !converged.0;
    *pacing = match () {
        () if moves || now < seen.moved_secs + STIRRED_SECS => Pacing::Moving,
        () if is_drawing && backend.is_on_adapter() => Pacing::Moving,
        () if is_drawing || openings.is_opening() => Pacing::Working,
        () => Pacing::Resting,
    };
    let mode = pacing.mode(clock.milliseconds());
    // A mode that changes asks for a frame by itself.
    if winit.focused_mode != mode {
        let unfocused = if mode == UpdateMode::Continuous { WinitSettings::game().unfocused_mode } else { mode };
        *winit = WinitSettings { focused_mode: mode, unfocused_mode: unfocused };
    }
}
