//! A window for the audience that shows its output's part of a show: on its monitor, bent and blended as its rig says.
//!
//! A follower's camera is the show's ([`super::network`]). [`aim_picture`] turns it to what the output displays, [`drawing`] bends the
//! picture and darkens what overlaps with others, [`placing`] keeps the window on its monitor. [`crate::show::supervisor`] opens such
//! windows for the outputs of this machine, and opens them again when they fail.

mod drawing;
mod lettering;
#[cfg(target_os = "linux")]
mod monitors;
mod placing;

use crate::show::rig::{Cover, Mesh, Monitor, Output, OutputError, OutputsFile, Projector};
use crate::window::WindowSystems;
use crate::window::camera::{CameraSystems, Viewpoint};
use crate::window::picture::{DataCamera, Picture};
use crate::window::state::aim::Aim;
use crate::window::state::notices::Notices;
use bevy::prelude::*;
use bevy::window::PrimaryWindow;
use bevy_egui::{EguiPrimaryContextPass, egui};
use std::path::{Path, PathBuf};

/// What a window displays of the show.
#[derive(Resource)]
pub struct OutputWindow {
    output: Output,
    folder: PathBuf,
    bent: Option<Bent>,
    /// The mask as a texture.
    mask: Option<egui::TextureHandle>,
    words: lettering::Words,
    /// What was said to be wrong, once.
    told: Option<String>,
}

/// An output's picture at one size.
struct Bent {
    size: [u32; 2],
    projector: Projector,
    fov_y: f64,
    cover: Cover,
    mesh: Mesh,
}

impl OutputWindow {
    /// The output of that name in a file of outputs.
    ///
    /// # Errors
    /// [`OutputError`] for files that cannot be used.
    pub fn open(file: &Path, name: &str) -> Result<OutputWindow, OutputError> {
        let outputs = OutputsFile::read(file)?;
        let output = outputs.output(file, name)?.clone();
        let folder = file.parent().unwrap_or(Path::new("")).to_owned();
        let window =
            OutputWindow { output, folder, bent: None, mask: None, words: lettering::Words::default(), told: None };
        // What is wrong with its files is better said before there is a window.
        let size = window.output.window.map_or([1920, 1080], |(_, _, width, height)| [width, height]);
        let projector = Projector::open(&window.output, &window.folder, size)?;
        let cover = Cover::of(&projector, size, 0.8);
        cover.map_err(|source| OutputError::Cover { name: window.output.name.clone(), source })?;
        Ok(window)
    }

    /// The output.
    pub fn output(&self) -> &Output {
        &self.output
    }

    /// Fits the picture to the window's size and the show's field of view.
    fn fit(&mut self, size: [u32; 2], fov_y: f64, notices: &mut Notices) -> Result<(), OutputError> {
        let projector = match self.bent.take() {
            Some(bent) if bent.size == size && (bent.fov_y == fov_y || !bent.projector.is_flat()) => {
                self.bent = Some(bent);
                return Ok(());
            }
            Some(bent) if bent.size == size => bent.projector,
            before => {
                self.mask = None;
                let projector = Projector::open(&self.output, &self.folder, size)?;
                if before.is_none() {
                    projector.notes().iter().for_each(|note| notices.error(note.clone()));
                }
                projector
            }
        };
        let cover = Cover::of(&projector, size, fov_y)
            .map_err(|source| OutputError::Cover { name: self.output.name.clone(), source })?;
        let mesh = Mesh::of(&projector, &cover, size, fov_y);
        self.bent = Some(Bent { size, projector, fov_y, cover, mesh });
        Ok(())
    }
}

/// Makes a follower's window an output.
pub fn add(app: &mut App, window: OutputWindow) {
    app.insert_resource(window)
        .init_resource::<placing::Placed>()
        .configure_sets(EguiPrimaryContextPass, WindowSystems::LayOut.run_if(not(resource_exists::<OutputWindow>)))
        .add_systems(EguiPrimaryContextPass, drawing::draw_output)
        .add_systems(Update, placing::place_window)
        .add_systems(PostUpdate, aim_picture.after(CameraSystems::Settle));
}

/// Turns the picture to what the output displays.
fn aim_picture(
    mut commands: Commands,
    mut output: ResMut<OutputWindow>,
    mut picture: ResMut<Picture>,
    mut notices: ResMut<Notices>,
    known: Option<Res<Aim>>,
    windows: Query<&Window, With<PrimaryWindow>>,
    camera: Single<&Viewpoint, With<DataCamera>>,
) {
    let Ok(window) = windows.single() else { return };
    // Where it is seen from is the leader's, whatever becomes of its place.
    picture.bypass_change_detection().is_placed = true;
    let size = [window.physical_width().max(1), window.physical_height().max(1)];
    let output = output.bypass_change_detection();
    if let Err(error) = output.fit(size, camera.fov_y, notices.bypass_change_detection()) {
        let text = error.to_string();
        if output.told.as_ref() != Some(&text) {
            notices.error(text.clone());
            output.told = Some(text);
        }
        return;
    }
    output.told = None;
    let Some(bent) = &output.bent else { return };
    let aim = Aim { axes: bent.cover.axes, fov_y: bent.cover.fov_y };
    if known.is_none_or(|known| *known != aim) {
        commands.insert_resource(aim);
    }
    let scale = window.scale_factor().max(0.1);
    let [width, height] = bent.cover.size.map(|side| side as f32 / scale);
    let rect = Rect::new(0.0, 0.0, width, height);
    if picture.rect != rect || picture.scale != scale {
        (picture.rect, picture.scale) = (rect, scale);
    }
}

/// What the system calls a monitor, for messages.
fn monitor_name(monitor: &Monitor) -> String {
    match monitor {
        Monitor::Number(number) => format!("monitor {number}"),
        Monitor::Named(name) => format!("monitor {name}"),
    }
}
