//! Presets: everything about the window that a user sets in `configs/*.ron`, loaded as a Bevy asset and reloaded
//! while the program runs.
//!
//! The presets are embedded too, so that an installed program needs no files beside it. Where the program finds a
//! folder `configs` (beside the manifest under cargo, else beside the executable or in `BEVY_ASSET_ROOT`), the file
//! there wins. Unknown fields and wrong values are refused with file, line and column; the last good preset stays.

use crate::gpu::Offscreen;
use crate::gpu::volume::Room;
use crate::mode::Settings;
use crate::model::ReadMethod;
use crate::model::ron_file::{self, RonError};
use crate::model::ron_place::Place;
use crate::picture::Adapter;
use crate::picture::drawing_cost::{self, SampleSizes};
use crate::stream::{CopyOptions, LookAhead, StreamOptions};
use bevy::prelude::*;
use serde::{Deserialize, Serialize};
use std::time::Duration;
use thiserror::Error;

/// The presets that the program knows by name, with their embedded text.
pub(super) const EMBEDDED: [(&str, &str); 4] = [
    ("desktop", include_str!("../../configs/desktop.ron")),
    ("laptop", include_str!("../../configs/laptop.ron")),
    ("headless", include_str!("../../configs/headless.ron")),
    ("planetarium", include_str!("../../configs/planetarium.ron")),
];

/// Which renderer draws the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Reflect)]
#[serde(rename_all = "kebab-case")]
pub enum Backend {
    /// The best that the adapter can do.
    #[default]
    Auto,
    /// Compute passes.
    Compute,
    /// Blended quads, where the adapter can blend 32-bit floats.
    Raster,
    /// The processor; needs no adapter features at all.
    Cpu,
}

impl Backend {
    /// The name used on the command line and in RON.
    pub const fn as_str(self) -> &'static str {
        match self {
            Backend::Auto => "auto",
            Backend::Compute => "compute",
            Backend::Raster => "raster",
            Backend::Cpu => "cpu",
        }
    }

    /// What draws pictures that are put together beside the window's passes: an adapter of their own that draws all that it can where one is
    /// asked for, or what it is faster at; none where the processor is to draw.
    pub fn beside(self) -> Option<Box<dyn Adapter>> {
        match self {
            Backend::Cpu => None,
            Backend::Auto => Some(Box::new(Offscreen::default())),
            Backend::Compute | Backend::Raster => Some(Box::new(Offscreen::preferred())),
        }
    }
}

/// The window when it opens.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Reflect)]
#[serde(default, deny_unknown_fields)]
pub struct WindowPreset {
    /// Width, logical pixels.
    pub width: u32,
    /// Height, logical pixels.
    pub height: u32,
    /// Whether frames wait for the display's refresh.
    pub vsync: bool,
}

impl Default for WindowPreset {
    fn default() -> Self {
        Self { width: 1280, height: 720, vsync: true }
    }
}

/// How much of the page file may be in memory, and how it gets there.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Reflect)]
#[serde(default, deny_unknown_fields)]
pub struct ResidencyPreset {
    /// Pages in main memory at most, MiB. What was used longest ago makes room.
    pub budget_mib: u64,
    /// The graphics adapter's memory at most, MiB: copies of pages, and what volumes work in.
    pub gpu_budget_mib: u64,
    /// Copied to the graphics adapter in one frame at most, MiB.
    pub upload_mib: u64,
    /// Pages that may be loading at a time.
    pub requests: usize,
    /// Time without an answer after which a read is told and left to itself, seconds.
    pub stall_secs: f64,
    /// Whether pages are read before the camera needs them.
    pub prefetch: bool,
    /// How page files that are opened from now on are read, and their sources.
    #[reflect(ignore)]
    pub read: ReadMethod,
    /// How far ahead, if they are.
    pub ahead: AheadPreset,
}

impl Default for ResidencyPreset {
    fn default() -> Self {
        Self {
            budget_mib: 2048,
            gpu_budget_mib: 1024,
            upload_mib: 24,
            requests: 8,
            stall_secs: 5.0,
            prefetch: true,
            read: ReadMethod::default(),
            ahead: AheadPreset::default(),
        }
    }
}

impl ResidencyPreset {
    /// Bytes that pages of particles may take that are drawn among other data: a quarter, beside those that the window streams.
    pub fn memory_among_others(&self) -> u64 {
        (self.budget_mib << 20) / 4
    }

    /// Time without an answer after which a read is told and left to itself.
    pub fn stall(&self) -> Duration {
        Duration::from_secs_f64(self.stall_secs)
    }

    /// How the open file is streamed.
    pub fn stream_options(&self) -> StreamOptions {
        StreamOptions {
            budget: self.budget_mib << 20,
            in_flight: self.requests,
            stall: self.stall(),
            prefetch: self.prefetch,
            ahead: LookAhead {
                loads: self.ahead.loads,
                least_secs: self.ahead.least_secs,
                most_secs: self.ahead.most_secs,
                pages: self.ahead.pages,
                share: self.ahead.share,
            },
        }
    }

    /// Bytes of the graphics adapter's memory for copies of pages, and for what passes that draw light work in.
    pub fn gpu_bytes(&self) -> [u64; 2] {
        let budget = self.gpu_budget_mib << 20;
        let volumes = (budget / 8).max(2 * Room::LEAST).min(budget);
        [budget - volumes, volumes]
    }

    /// How copies in the graphics adapter's memory are kept. A part of its budget is left for gaps between them, and
    /// two frames' worth of copies are on their way while one is being made.
    pub fn copy_options(&self) -> CopyOptions {
        let [budget, _] = self.gpu_bytes();
        CopyOptions { budget: budget - budget / 8, on_their_way: 2 * (self.upload_mib << 20) }
    }
}

/// How far ahead of the camera pages are read (F12 4.8.2).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Reflect)]
#[serde(default, deny_unknown_fields)]
pub struct AheadPreset {
    /// The camera's way is looked ahead for so many times the time that the largest page takes to come.
    pub loads: f64,
    /// For so long at least, seconds.
    pub least_secs: f64,
    /// For so long at most, seconds.
    pub most_secs: f64,
    /// Pages that are asked for at once, at most.
    pub pages: usize,
    /// Share of [`ResidencyPreset::requests`] that may be for pages that nothing misses yet.
    pub share: f64,
}

impl Default for AheadPreset {
    fn default() -> Self {
        let LookAhead { loads, least_secs, most_secs, pages, share } = LookAhead::default();
        Self { loads, least_secs, most_secs, pages, share }
    }
}

/// What a picture gives up while the view moves or pages come in. At rest everything is drawn.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Reflect)]
#[serde(default, deny_unknown_fields)]
pub struct MotionPreset {
    /// How long the view must rest before the full picture is drawn, milliseconds.
    pub rest_ms: u64,
    /// Particles of the first picture of splats, before it is known what they cost.
    pub first_particles: u64,
    /// Particles of a picture of splats at least, however slow the machine is.
    pub least_particles: u64,
    /// What the sides of a picture of splats are divided by where the processor has no time for all its particles.
    pub splat_shrink: u32,
    /// Particles that a volume takes at most where the processor draws it.
    pub volume_particles: u64,
    /// The same where the adapter does.
    pub volume_particles_gpu: u64,
    /// What the sides of a volume's picture are divided by at most, as time demands.
    pub volume_shrink: f64,
    /// Milliseconds that a volume's picture may take where [`DrawingPreset::frame_ms`] sets no limit, and the picture that a tour
    /// fades from.
    pub volume_ms: f64,
}

impl Default for MotionPreset {
    fn default() -> Self {
        let SampleSizes { first, least } = SampleSizes::default();
        Self {
            rest_ms: 120,
            first_particles: first,
            least_particles: least,
            splat_shrink: 2,
            volume_particles: 200_000,
            volume_particles_gpu: 4_000_000,
            volume_shrink: 4.0,
            volume_ms: 50.0,
        }
    }
}

impl MotionPreset {
    /// How many particles a picture of splats may have, whatever they cost.
    pub fn sample_sizes(&self) -> SampleSizes {
        SampleSizes { first: self.first_particles, least: self.least_particles }
    }
}

/// How the picture is made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Reflect)]
#[serde(default, deny_unknown_fields)]
pub struct DrawingPreset {
    /// Which renderer.
    pub backend: Backend,
    /// The screen-space error `tau`, pixels.
    pub error_px: f64,
    /// Milliseconds that a picture may take to draw while the view moves or pages come in: a sample of the particles is drawn
    /// then, as large as that allows, and all when the view rests. 0: always all.
    pub frame_ms: f64,
    /// The setting `presence` of every mode: see `deepfield modes`.
    pub presence: f64,
    /// The setting `thinning` of every mode: see `deepfield modes`.
    pub thinning: f64,
    /// Whether a run that plays waits for each picture; else what is not there yet is drawn coarser.
    pub wait: bool,
}

impl Default for DrawingPreset {
    fn default() -> Self {
        let lod_budget = Settings::default().lod_budget();
        Self {
            backend: Backend::Auto,
            error_px: 0.8,
            frame_ms: 40.0,
            presence: lod_budget.presence,
            thinning: lod_budget.thinning,
            wait: false,
        }
    }
}

/// How the camera answers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Reflect)]
#[serde(default, deny_unknown_fields)]
pub struct CameraPreset {
    /// Vertical field of view, degrees.
    pub field_of_view_deg: f64,
    /// Factor on orbiting, panning and zooming with the mouse.
    pub orbit_sensitivity: f32,
    /// 0: the camera follows the mouse at once; towards 1: it glides.
    pub smoothness: f32,
    /// Flying speed: the share of the distance to the data covered in a second.
    pub fly_speed: f64,
    /// Mouse look: degrees per pixel of mouse motion.
    pub look_sensitivity: f64,
    /// How long a flight to a double-clicked place takes, seconds.
    pub flight_secs: f64,
}

impl Default for CameraPreset {
    fn default() -> Self {
        Self {
            field_of_view_deg: 45.0,
            orbit_sensitivity: 1.0,
            smoothness: 0.1,
            fly_speed: 0.6,
            look_sensitivity: 0.15,
            flight_secs: 1.2,
        }
    }
}

/// The panel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Reflect)]
#[serde(default, deny_unknown_fields)]
pub struct PanelPreset {
    /// Whether the panels are open at the start.
    pub open: bool,
    /// Whether those at the right are.
    pub right: bool,
    /// Width at the left, logical pixels.
    pub width: f32,
    /// Width at the right, logical pixels.
    pub right_width: f32,
    /// Factor on the size of text and controls; 0: by the monitor's own scale and its height.
    pub scale: f32,
    /// Factor on the light of the panels, for a dark room.
    pub brightness: f32,
    /// Names of the sections that are closed at the start.
    pub closed: Vec<String>,
}

impl Default for PanelPreset {
    fn default() -> Self {
        Self {
            open: true,
            right: true,
            width: 304.0,
            right_width: 256.0,
            scale: 0.0,
            brightness: 1.0,
            closed: Vec::new(),
        }
    }
}

/// What goes evenly along a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Reflect)]
#[serde(rename_all = "kebab-case")]
pub enum Along {
    /// Time.
    #[default]
    Time,
    /// Its steps, however far apart they are in time.
    Steps,
}

/// What automatic ranges of colours are found over.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Reflect)]
#[serde(rename_all = "kebab-case")]
pub enum Over {
    /// The whole run, in the present view: colours mean the same while it plays.
    #[default]
    Run,
    /// The picture of now.
    Now,
}

/// What a run does that has been played to its end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Reflect)]
#[serde(rename_all = "kebab-case")]
pub enum Repeat {
    /// It stands there.
    #[default]
    Once,
    /// It begins again.
    Again,
    /// It goes back, and on again from the beginning.
    ToAndFro,
}

/// How a run of snapshots is played.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Reflect)]
#[serde(default, deny_unknown_fields)]
pub struct PlayingPreset {
    /// Seconds in which the whole run plays at its usual speed.
    pub seconds: f64,
    /// What goes evenly while it plays.
    pub pace: Along,
    /// What the dock's line shows evenly.
    pub marks: Along,
    /// What it does at its end.
    pub repeat: Repeat,
    /// What automatic ranges of colours are found over.
    pub range: Over,
}

impl Default for PlayingPreset {
    fn default() -> Self {
        Self { seconds: 20.0, pace: Along::Time, marks: Along::Time, repeat: Repeat::Once, range: Over::Run }
    }
}

/// Everything that a preset file sets. Fields left out keep their defaults.
#[derive(Asset, Resource, Clone, Debug, Default, PartialEq, Serialize, Deserialize, Reflect)]
#[serde(default, deny_unknown_fields)]
pub struct Preset {
    /// The window when it opens.
    pub window: WindowPreset,
    /// Memory for pages.
    pub residency: ResidencyPreset,
    /// How the picture is made.
    pub drawing: DrawingPreset,
    /// What it gives up in motion.
    pub motion: MotionPreset,
    /// How a run is played.
    pub playing: PlayingPreset,
    /// How the camera answers.
    pub camera: CameraPreset,
    /// The panel.
    pub panel: PanelPreset,
}

/// Why there is no preset.
#[derive(Debug, Error)]
pub enum PresetError {
    /// The preset's text is refused.
    #[error(transparent)]
    Ron(#[from] RonError),
    /// No preset of that name.
    #[error("no preset named {0}: expected one of {names}", names = EMBEDDED.map(|(name, _)| name).join(", "))]
    Unknown(String),
}

impl Preset {
    /// The embedded preset of that name.
    pub fn embedded(name: &str) -> Result<Preset, PresetError> {
        match EMBEDDED.iter().find(|(known, _)| *known == name) {
            Some((name, text)) => Ok(Preset::parse(&format!("{name}.ron"), text)?),
            None => Err(PresetError::Unknown(name.to_owned())),
        }
    }

    /// Reads RON text; `file` is what errors call it.
    pub fn parse(file: &str, text: &str) -> Result<Preset, RonError> {
        let preset: Preset = ron_file::parse(file, text)?;
        preset.check(Place { file, text })?;
        Ok(preset)
    }

    /// Checks every number against its range.
    fn check(&self, place: Place) -> Result<(), RonError> {
        let Preset { window, residency, drawing, motion, playing, camera, panel } = self;
        let ahead = &residency.ahead;
        let least = drawing_cost::LEAST as f64;
        let checks = [
            ("window.width", f64::from(window.width), 320.0, 16384.0, "320 to 16384"),
            ("window.height", f64::from(window.height), 240.0, 16384.0, "240 to 16384"),
            ("residency.budget_mib", residency.budget_mib as f64, 16.0, 1.0e9, "16 or more"),
            ("residency.gpu_budget_mib", residency.gpu_budget_mib as f64, 32.0, 1.0e9, "32 or more"),
            ("residency.upload_mib", residency.upload_mib as f64, 1.0, 65536.0, "1 to 65536"),
            ("residency.stall_secs", residency.stall_secs, 0.1, 3600.0, "0.1 to 3600"),
            ("residency.requests", residency.requests as f64, 1.0, 4096.0, "1 to 4096"),
            ("residency.ahead.loads", ahead.loads, 0.0, 1000.0, "0 to 1000"),
            ("residency.ahead.least_secs", ahead.least_secs, 0.0, 60.0, "0 to 60"),
            ("residency.ahead.most_secs", ahead.most_secs, ahead.least_secs, 600.0, "least_secs to 600"),
            ("residency.ahead.pages", ahead.pages as f64, 1.0, 1.0e6, "1 to 1000000"),
            ("residency.ahead.share", ahead.share, 0.0, 1.0, "0 to 1"),
            ("motion.rest_ms", motion.rest_ms as f64, 0.0, 10_000.0, "0 to 10000"),
            ("motion.first_particles", motion.first_particles as f64, least, 1.0e12, "20000 to 1e12"),
            ("motion.least_particles", motion.least_particles as f64, least, 1.0e12, "20000 to 1e12"),
            ("motion.splat_shrink", f64::from(motion.splat_shrink), 1.0, 8.0, "1 to 8"),
            ("motion.volume_particles", motion.volume_particles as f64, 1000.0, 1.0e12, "1000 to 1e12"),
            ("motion.volume_particles_gpu", motion.volume_particles_gpu as f64, 1000.0, 1.0e12, "1000 to 1e12"),
            ("motion.volume_shrink", motion.volume_shrink, 1.0, 16.0, "1 to 16"),
            ("motion.volume_ms", motion.volume_ms, 1.0, 10_000.0, "1 to 10000"),
            ("drawing.error_px", drawing.error_px, 0.05, 64.0, "0.05 to 64"),
            ("drawing.frame_ms", drawing.frame_ms, 0.0, 10_000.0, "0 to 10000"),
            ("drawing.presence", drawing.presence, 0.0, 1.0e9, "0 to 1e9"),
            ("drawing.thinning", drawing.thinning, 0.0, 32.0, "0 to 32"),
            ("playing.seconds", playing.seconds, 0.1, 1.0e6, "0.1 to 1e6"),
            ("camera.field_of_view_deg", camera.field_of_view_deg, 1.0, 150.0, "1 to 150"),
            ("camera.orbit_sensitivity", f64::from(camera.orbit_sensitivity), 0.01, 100.0, "0.01 to 100"),
            ("camera.smoothness", f64::from(camera.smoothness), 0.0, 0.95, "0 to 0.95"),
            ("camera.fly_speed", camera.fly_speed, 0.001, 1000.0, "0.001 to 1000"),
            ("camera.look_sensitivity", camera.look_sensitivity, 0.001, 10.0, "0.001 to 10"),
            ("camera.flight_secs", camera.flight_secs, 0.0, 60.0, "0 to 60"),
            ("panel.width", f64::from(panel.width), 240.0, 640.0, "240 to 640"),
            ("panel.right_width", f64::from(panel.right_width), 200.0, 640.0, "200 to 640"),
            ("panel.brightness", f64::from(panel.brightness), 0.1, 1.0, "0.1 to 1"),
        ];
        for (field, value, least, most, expected) in checks {
            if !(least..=most).contains(&value) {
                return Err(place.refuse(&field.split('.').collect::<Vec<_>>(), value, expected));
            }
        }
        if !(panel.scale == 0.0 || (0.5..=4.0).contains(&panel.scale)) {
            return Err(place.refuse(&["panel", "scale"], panel.scale, "0 (automatic), or 0.5 to 4"));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_embedded_preset_parses_and_differs() {
        let presets: Vec<Preset> = EMBEDDED.iter().map(|(name, _)| Preset::embedded(name).unwrap()).collect();
        assert_eq!(presets[0].residency.budget_mib, 4096);
        assert_ne!(presets[0], presets[1]);
        assert_ne!(presets[0], presets[2]);
        let unknown = Preset::embedded("tablet").unwrap_err().to_string();
        assert_eq!(unknown, "no preset named tablet: expected one of desktop, laptop, headless, planetarium");
    }

    #[test]
    fn the_planetarium_is_dark_and_leaves_the_presenter_what_a_show_needs() {
        let preset = Preset::embedded("planetarium").unwrap();
        assert!(preset.panel.brightness < 0.6 && preset.drawing.frame_ms > 0.0 && preset.drawing.frame_ms < 20.0);
        for section in ["show", "tour", "bookmarks", "messages"] {
            assert!(!preset.panel.closed.iter().any(|closed| closed == section), "{section}");
        }
    }

    #[test]
    fn what_is_read_ahead_is_what_the_preset_says() {
        let preset = Preset::parse("a.ron", "(residency: (ahead: (loads: 5.0, pages: 7, share: 0.25)))").unwrap();
        let ahead = LookAhead { loads: 5.0, pages: 7, share: 0.25, ..LookAhead::default() };
        assert_eq!(preset.residency.stream_options().ahead, ahead);
        assert_eq!(Preset::default().residency.stream_options().ahead, LookAhead::default());
    }

    #[test]
    fn settings_of_motion_and_prefetching_are_checked_with_their_place() {
        for (text, refusal) in [
            ("(motion: (\n  volume_shrink: 0.5))", "a.ron:2:3: volume_shrink: found 0.5, expected 1 to 16"),
            ("(motion: (\n  least_particles: 10))", "a.ron:2:3: least_particles: found 10, expected 20000 to 1e12"),
            ("(residency: (ahead: (\nshare: 1.5)))", "a.ron:2:1: share: found 1.5, expected 0 to 1"),
            ("(panel: (\n brightness: 0.0))", "a.ron:2:2: brightness: found 0, expected 0.1 to 1"),
        ] {
            assert_eq!(Preset::parse("a.ron", text).unwrap_err().to_string(), refusal);
        }
        for wrong in ["motion: (particles: 5)", "residency: (ahead: (seconds: 5))", "motion: (rest_ms: -1)"] {
            let error = Preset::parse("a.ron", &format!("(\n    {wrong},\n)")).unwrap_err().to_string();
            assert!(error.starts_with("a.ron:2:"), "{error}");
        }
    }

    #[test]
    fn an_unknown_field_names_file_line_and_column() {
        let error = Preset::parse("desk.ron", "(\n    drawing: (error_pixels: 1.0),\n)").unwrap_err().to_string();
        assert!(error.starts_with("desk.ron:2:"), "{error}");
        assert!(error.contains("error_pixels"), "{error}");
    }

    #[test]
    fn a_value_out_of_range_names_its_place() {
        let error = Preset::parse("a.ron", "(drawing: (error_px: -1.0))").unwrap_err().to_string();
        assert_eq!(error, "a.ron:1:12: error_px: found -1, expected 0.05 to 64");
    }

    #[test]
    fn a_partial_preset_keeps_defaults() {
        let preset = Preset::parse("a.ron", "(panel: (open: false))").unwrap();
        assert_eq!(preset, Preset { panel: PanelPreset { open: false, ..default() }, ..default() });
        let mapped = Preset::parse("a.ron", "(residency: (read: mapped))").unwrap();
        assert_eq!(mapped.residency, ResidencyPreset { read: ReadMethod::Mapped, ..default() });
    }
}
