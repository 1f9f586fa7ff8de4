//! What a caller hands to the window, and the errors that keep it from opening.

use super::preset::{Backend, Preset, PresetError};
use crate::hierarchy::spacetime::Interpolation;
use crate::look::{HeightsSaid, LookPatch, Member};
use crate::model::When;
use crate::model::progress::Progress;
use crate::view::{Stereo, Surround};
use bevy::prelude::App;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use thiserror::Error;

/// Turns something that a user named (a snapshot, a catalogue, a page file), and what he says of heights in it, into a page file and returns its
/// path. Runs on a background thread; the error is one line that names the file and the cause.
pub type Opener = Arc<dyn Fn(&Path, &HeightsSaid, &dyn Progress) -> Result<PathBuf, String> + Send + Sync>;

/// Gives more of a run that is being built, or that a simulation is writing, what is nearest to the time that is shown first: the path of
/// a run file that has more than the one before, [`More::Later`] where there is none yet, [`More::Done`] where there will be none. Runs on
/// a background thread.
pub type Grower = Arc<dyn Fn(Option<f64>, &dyn Progress) -> Result<More, String> + Send + Sync>;

/// What a [`Grower`] gives.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum More {
    /// A run file.
    Run(PathBuf),
    /// Something that the user should know about the run.
    Told(String),
    /// It may be asked again.
    Later,
    /// It need not be asked again.
    Done,
}

/// Writes the demo dataset where it is not yet, and returns its path. Runs on a background thread.
pub type Demo = Arc<dyn Fn() -> Result<PathBuf, String> + Send + Sync>;

/// Adds a caller's own plugins and systems to the window, after all others.
pub type Extension = Arc<dyn Fn(&mut App) + Send + Sync>;

/// What to open.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OpenRequest {
    /// Page files and sources, which make one scene; or first a scene file. None where `scene` says.
    pub members: Vec<Member>,
    /// A scene to show the data with, whatever data it names itself.
    pub scene: Option<PathBuf>,
    /// How directions become a picture, and for which eyes, in place of what the scene says.
    pub projection: Option<(Surround, Option<Stereo>)>,
    /// Exposure and bloom, over what the scene says.
    pub light: LookPatch,
    /// The moment of a run, in place of the one that the scene says.
    pub time: Option<When>,
    /// How its particles move between the steps, in place of what the scene says.
    pub interpolation: Option<Interpolation>,
    /// What is said of heights among the data, over what the scene says.
    pub said: HeightsSaid,
    /// How degrees of heights become places, in place of what the scene says.
    pub map: Option<String>,
}

impl OpenRequest {
    /// One file.
    pub fn of(path: impl Into<PathBuf>) -> OpenRequest {
        OpenRequest { members: vec![Member::new(path)], ..OpenRequest::default() }
    }
}

/// How the window starts.
#[derive(Clone)]
pub struct WindowOptions {
    /// Opened at the start.
    pub open: Option<OpenRequest>,
    /// How files are opened.
    pub opener: Opener,
    /// The run whose first step is opened at the start.
    pub grower: Option<Grower>,
    /// Window size in logical pixels; the preset's where it is `None`.
    pub size: Option<(u32, u32)>,
    /// Which preset in `configs/`: `desktop`, `laptop`, `headless` or `planetarium`.
    pub preset: String,
    /// The renderer; the preset's where it is `None`.
    pub backend: Option<Backend>,
    /// The graphics drivers that are asked for an adapter: those that are known to have one, or all.
    pub drivers: wgpu::Backends,
    /// Whether it fills the screen.
    pub fullscreen: bool,
    /// The screen-space error in pixels; the preset's where it is `None`.
    pub error_px: Option<f64>,
    /// Milliseconds that a picture in motion may take; the preset's where it is `None`.
    pub frame_ms: Option<f64>,
    /// The mode to begin with; chosen by the data where it is `None`.
    pub mode: Option<String>,
    /// How directions become a picture to begin with, and for which eyes.
    pub projection: (Surround, Option<Stereo>),
    /// Exposure and bloom to begin with.
    pub light: LookPatch,
    /// A file that is rewritten with the window's state as JSON whenever it changes (for scripts and tests).
    pub status: Option<PathBuf>,
    /// The caller's plugins and systems.
    pub extension: Option<Extension>,
    /// A catalogue of named objects.
    pub labels: Option<PathBuf>,
    /// A tour to play.
    pub tour: Option<PathBuf>,
    /// Whether it is an audience's, which has no mouse.
    pub audience: bool,
    /// The demo dataset, which the page of a window without a file offers.
    pub demo: Option<Demo>,
    /// The list of files that were opened before, which is kept; there is none where it is `None`.
    pub recent: Option<PathBuf>,
    /// The folder where other processes of the user find the window, to have a file opened; none does where it is `None`.
    pub reached_in: Option<PathBuf>,
}

impl WindowOptions {
    /// A window with the desktop preset that opens `path`.
    pub fn new(open: Option<OpenRequest>, opener: Opener) -> WindowOptions {
        WindowOptions {
            open,
            opener,
            grower: None,
            size: None,
            preset: "desktop".to_owned(),
            backend: None,
            drivers: wgpu::Backends::from_env().unwrap_or(wgpu::Backends::all()),
            fullscreen: false,
            error_px: None,
            frame_ms: None,
            mode: None,
            projection: (Surround::Flat, None),
            light: LookPatch::default(),
            status: None,
            extension: None,
            labels: None,
            tour: None,
            audience: false,
            demo: None,
            recent: None,
            reached_in: None,
        }
    }

    /// The preset by name, with the options that override it.
    pub fn resolved_preset(&self) -> Result<Preset, PresetError> {
        let mut preset = Preset::embedded(&self.preset)?;
        self.override_preset(&mut preset);
        Ok(preset)
    }

    /// Puts the options that were given explicitly in place of the preset's.
    pub fn override_preset(&self, preset: &mut Preset) {
        if let Some((width, height)) = self.size {
            preset.window.width = width;
            preset.window.height = height;
        }
        if let Some(backend) = self.backend {
            preset.drawing.backend = backend;
        }
        if let Some(error_px) = self.error_px {
            preset.drawing.error_px = error_px;
        }
        if let Some(frame_ms) = self.frame_ms {
            preset.drawing.frame_ms = frame_ms;
        }
    }
}

/// Why there is no window, or why it closed with a failure.
#[derive(Debug, Error)]
pub enum AppError {
    /// No X server and no Wayland compositor.
    #[error("no display: neither DISPLAY nor WAYLAND_DISPLAY is set")]
    NoDisplay,
    /// The preset is refused.
    #[error(transparent)]
    Preset(#[from] PresetError),
    /// The event loop ended with an error; the log says which.
    #[error("the window closed after an error")]
    Failed,
}
