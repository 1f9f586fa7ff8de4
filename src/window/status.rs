//! The window's state as JSON in a file, for scripts and tests that cannot look at pixels.

use super::camera::{Navigation, Viewpoint};
use super::comparison::{Comparison, Found};
use super::files::Files;
use super::history::History;
use super::look::Look;
use super::looking::LookingState;
use super::looking::report::Report;
use super::open::Openings;
use super::paths::Paths;
use super::picture::{DataCamera, Picture};
use super::playhead::Playhead;
use super::preset::{Preset, Repeat};
use super::scene::{Scene, Settings};
use super::scene_io::SceneFiles;
use super::state::notices::Notices;
use super::state::panels::{Closed, Shown};
use super::state::show::ShowStatus;
use super::statistics::{Converged, PageCounts, Statistics};
use super::touring::{Player, Ranges};
use super::ui::Controls;
use crate::annotate::Annotations;
use crate::color::transfer::TransferFunction;
use crate::color::{Bloom, ExposureMode};
use crate::explore::SelectionSet;
use crate::look::Attribute;
use crate::picture::decode::decoded_nodes;
use crate::picture::field::PointsReport;
use crate::view::{CutSettings, Stereo, Surround};
use bevy::prelude::*;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Where the state is written, and what was written last.
#[derive(Resource, Default)]
pub struct StatusFile {
    path: Option<PathBuf>,
    written: String,
    next_secs: f64,
    frames: u64,
}

impl StatusFile {
    /// Writes to `path`, if any.
    pub fn new(path: Option<PathBuf>) -> StatusFile {
        StatusFile { path, ..default() }
    }
}

/// The open tour, as the state for scripts says it.
#[derive(Serialize)]
struct TourStatus<'a> {
    /// Where it is; `None` while it shows nothing.
    time: Option<f64>,
    duration: f64,
    running: bool,
    waiting: Option<usize>,
    stops: Vec<f64>,
    selected: Option<usize>,
    recording: bool,
    path: Option<&'a Path>,
    /// At how many moments the ranges of its colours are known, and at how many they are looked for.
    exposed: [usize; 2],
}

/// Seconds between two writes at least.
const INTERVAL_SECS: f64 = 0.1;

/// The state; lengths in physical pixels and world units.
#[derive(Serialize)]
struct Status<'a> {
    /// The number of the window's process.
    process: u32,
    /// Frames since the start.
    frames: u64,
    open: Option<&'a std::path::Path>,
    opening: Option<&'a std::path::Path>,
    /// Whether the page of a window without a file is shown, and whether a path is being typed.
    first_page: bool,
    typing: bool,
    panel: bool,
    help: bool,
    flying: bool,
    picture: [f32; 4],
    eye: [f64; 3],
    target: [f64; 3],
    mode: &'a str,
    levels: &'a str,
    /// Points that stand for the samples of an image or a volume, where that is drawn.
    points: Option<PointsReport>,
    /// The ranges of the colours in use, and whether they have arrived.
    ranges: Option<([[f64; 2]; 2], bool)>,
    converged: bool,
    error_px: f64,
    particles_drawn: u64,
    sampled: Option<u64>,
    live: Option<u64>,
    nodes_drawn: usize,
    nodes_hidden: usize,
    pages_resident: usize,
    pages_failed: usize,
    pages: PageCounts,
    memory: MemoryStatus,
    /// Nodes that the processor has decoded for pictures since the start.
    decoded: u64,
    /// Slabs of a volume that the adapter has drawn, and how many its picture has.
    slabs: Option<[usize; 2]>,
    /// Milliseconds of the passes of the last picture.
    passes: BTreeMap<&'static str, f64>,
    backend: &'a str,
    adapter: &'a str,
    /// What can be undone and redone.
    history: [usize; 2],
    scene: Option<&'a std::path::Path>,
    settings: SettingsStatus<'a>,
    tour: Option<TourStatus<'a>>,
    show: Option<&'a ShowStatus>,
    looking: Report<'a>,
    /// Where a run stands.
    time: Option<TimeStatus>,
    /// Paths over the picture.
    paths: PathsStatus,
    /// The comparison of two hierarchies, where its pictures are there, and where the divider is.
    comparison: Option<(Found, f32)>,
    /// The panels' controls: left, top, right and bottom; 1 where they are in sight, else 0.
    controls: BTreeMap<&'a str, [f32; 5]>,
    messages: Vec<&'a str>,
}

/// Where a run stands.
#[derive(Serialize)]
struct TimeStatus {
    /// The present time, in the unit of the steps' times.
    time: f64,
    /// The step that is shown.
    step: usize,
    /// Whether it is the one of the present time.
    there: bool,
    /// Whether tracks are shown, at that time.
    moves: bool,
    /// Whether stored steps alone are shown.
    holds: bool,
    playing: bool,
    /// How many times as fast as usual it plays.
    speed: f64,
    /// What it does at its end.
    repeat: Repeat,
    /// Steps that can be shown.
    steps_ready: usize,
    /// Frames that showed another time than the present one, while it played.
    late_frames: u64,
    /// Steps that cannot be shown.
    damaged: Vec<usize>,
}

/// Paths over the picture.
#[derive(Serialize)]
struct PathsStatus {
    /// Whether the processor draws them among what the mode shows.
    among: bool,
    /// Tracks that they are of, in the interval where they are most; `None` where none is laid over the picture.
    tracks: Option<u64>,
    /// Of the one that was clicked: flow level (0 for a particle), particles and the interval.
    picked: Option<[u64; 3]>,
}

/// Bytes: what is held, and what may be.
#[derive(Serialize)]
struct MemoryStatus {
    pages: [u64; 2],
    copies: Option<[u64; 2]>,
    volumes: u64,
}

/// What the panels set.
#[derive(Serialize)]
struct SettingsStatus<'a> {
    mode: &'a str,
    attribute: String,
    values: &'a crate::mode::Settings,
    budget: &'a crate::mode::Settings,
    transfer: &'a TransferFunction,
    exposure: ExposureMode,
    bloom: Bloom,
    annotations: &'a Annotations,
    error_px: f64,
    families: &'a [bool],
    fov: f64,
    parallel: bool,
    projection: Surround,
    stereo: Option<Stereo>,
    cut: CutSettings,
    selections: &'a [SelectionSet],
    closed: &'a Closed,
}

/// Writes the state where it has changed: into a file beside it, which then takes its name, so that a reader never
/// sees half of it.
pub(super) fn write_status(
    mut file: ResMut<StatusFile>,
    time: Res<Time<Real>>,
    scene: Option<Res<Scene>>,
    openings: Res<Openings>,
    shown: Res<Shown>,
    settings: Res<Settings>,
    picture: Res<Picture>,
    converged: Res<Converged>,
    statistics: Res<Statistics>,
    mut notices: ResMut<Notices>,
    (history, files, closed, controls): (Res<History>, (Res<SceneFiles>, Res<Files>), Res<Closed>, Res<Controls>),
    looking: LookingState,
    (player, ranges, look, playhead): (Res<Player>, Res<Ranges>, Option<Res<Look>>, Option<Res<Playhead>>),
    (show, paths, preset): (Option<Res<ShowStatus>>, Res<Paths>, Res<Preset>),
    comparison: Res<Comparison>,
    camera: Single<(&Viewpoint, &Navigation), With<DataCamera>>,
) {
    let file = file.bypass_change_detection();
    file.frames += 1;
    let now = time.elapsed_secs_f64();
    let Some(path) = file.path.clone().filter(|_| now >= file.next_secs) else { return };
    file.next_secs = now + INTERVAL_SECS;
    let (viewpoint, navigation) = camera.into_inner();
    let opening = openings.progress();
    let corners = [picture.rect.min, picture.rect.max].map(|corner| corner * picture.scale);
    let status = Status {
        process: std::process::id(),
        frames: file.frames,
        open: scene.as_ref().map(|scene| scene.path.as_path()),
        opening: opening.as_ref().map(|(path, ..)| *path),
        first_page: files.1.is_page_shown,
        typing: files.1.typed.is_some(),
        panel: shown.panel,
        help: shown.help,
        flying: *navigation == Navigation::Fly,
        picture: [corners[0].x, corners[0].y, corners[1].x, corners[1].y],
        eye: viewpoint.eye.to_array(),
        target: viewpoint.target.to_array(),
        mode: settings.mode.name,
        levels: statistics.levels,
        points: statistics.points,
        ranges: look.as_ref().map(|look| ([look.levels.p, look.levels.s], look.settled)),
        converged: converged.0,
        error_px: statistics.error_px,
        particles_drawn: statistics.particles,
        sampled: statistics.sampled,
        live: statistics.live,
        nodes_drawn: statistics.nodes,
        nodes_hidden: statistics.hidden,
        pages_resident: statistics.pages_resident,
        pages_failed: statistics.pages_failed,
        pages: statistics.pages,
        memory: MemoryStatus {
            pages: [statistics.bytes, statistics.budget_bytes],
            copies: statistics.copies,
            volumes: statistics.work_bytes,
        },
        decoded: decoded_nodes(),
        slabs: statistics.slabs,
        passes: statistics.passes.iter().copied().collect(),
        backend: &statistics.backend,
        adapter: &statistics.adapter,
        history: history.steps(),
        scene: files.0.path.as_deref(),
        settings: SettingsStatus {
            mode: settings.mode.name,
            attribute: match &settings.attribute {
                Attribute::Automatic => "automatic".to_owned(),
                Attribute::None => "none".to_owned(),
                Attribute::Named(name) => name.clone(),
            },
            values: &settings.look.settings,
            budget: &settings.budget,
            transfer: &settings.transfer,
            exposure: settings.exposure,
            bloom: settings.bloom,
            annotations: &settings.annotations,
            error_px: settings.error_px,
            families: &settings.families,
            fov: settings.lens.fov_deg,
            parallel: settings.lens.parallel,
            projection: settings.surround,
            stereo: settings.stereo,
            cut: settings.cut,
            selections: &settings.selections,
            closed: &closed,
        },
        tour: player.timeline().map(|timeline| TourStatus {
            time: player.state().map(|state| state.time),
            duration: timeline.duration(),
            running: player.clock().is_running(),
            waiting: player.clock().waiting(),
            stops: timeline.stops().iter().map(|stop| stop.arrive).collect(),
            selected: player.selected,
            recording: player.is_recording(),
            path: player.path(),
            exposed: ranges.progress(),
        }),
        show: show.as_deref(),
        time: playhead.map(|playhead| TimeStatus {
            time: playhead.time(),
            step: playhead.shown(),
            there: playhead.is_there(),
            moves: playhead.is_moving(),
            holds: playhead.holds(),
            playing: playhead.is_playing(),
            speed: playhead.speed(),
            repeat: preset.playing.repeat,
            steps_ready: playhead.times().times.len() - playhead.damaged().len(),
            late_frames: playhead.late_frames(),
            damaged: playhead.damaged().iter().copied().collect(),
        }),
        paths: PathsStatus {
            among: paths.is_among(),
            tracks: paths.tracks(),
            picked: paths
                .picked
                .here()
                .and_then(Option::as_ref)
                .map(|found| [found.level as u64, u64::from(found.count), found.interval as u64]),
        },
        comparison: comparison.found().map(|found| (found, comparison.divider)),
        looking: Report::of(&looking, &settings.selections),
        controls: controls
            .0
            .iter()
            .map(|(name, (rect, in_sight))| {
                let [left, top, right, bottom] =
                    [rect.left(), rect.top(), rect.right(), rect.bottom()].map(|side| side * picture.scale);
                (name.as_str(), [left, top, right, bottom, f32::from(u8::from(*in_sight))])
            })
            .collect(),
        messages: notices.all().map(|notice| notice.text.as_str()).collect(),
    };
    let Ok(text) = serde_json::to_string_pretty(&status) else { return };
    if text == file.written {
        return;
    }
    let beside = path.with_extension("part");
    match std::fs::write(&beside, &text).and_then(|()| std::fs::rename(&beside, &path)) {
        Ok(()) => file.written = text,
        Err(error) => {
            notices.error(format!("{}: {error}", path.display()));
            file.path = None;
        }
    }
}
