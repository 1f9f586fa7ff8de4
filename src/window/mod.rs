//! The window: a Bevy application that opens files, moves a camera, shows a panel and overlays, and draws what
//! streaming has brought.
//!
//! A frame: files that are asked for are opened ([`files`], [`dropped`]), those that have arrived are adopted ([`open`],
//! [`scene`]); keys are carried out ([`shortcuts`]); the panel and the overlays are laid out ([`ui`]) and settle who owns the
//! mouse ([`input`]); the camera moves ([`camera`]); its view drives streaming and drawing, which fill the picture's image
//! ([`picture`]).

pub mod adopt;
mod assistive;
mod bloom;
pub mod bookmarks;
pub mod camera;
mod comparison;
pub mod cpu_backend;
pub mod dropped;
pub mod exposure;
pub mod facts;
mod field_backend;
pub mod files;
pub mod free_name;
pub mod gpu_backend;
mod ground;
pub mod growing;
pub mod hidden;
mod history;
pub mod input;
pub mod lens;
mod light_backend;
mod listed;
pub mod live;
pub mod look;
pub mod looking;
pub mod objects;
pub mod occlusion;
pub mod open;
pub mod options;
pub mod overlay;
pub mod pacing;
pub mod page_entities;
pub mod pages;
pub mod panel;
mod panes;
mod pass_times;
pub mod paths;
pub mod pick;
pub mod picture;
mod picture_sizes;
pub mod playhead;
mod pointer_motion;
pub mod preset;
mod run_ranges;
pub mod sampled;
pub mod scene;
pub mod scene_io;
pub mod screenshot;
pub mod shortcuts;
pub mod state;
pub mod statistics;
pub mod streaming;
pub mod surround_backend;
pub mod theme;
pub mod time_dock;
pub mod touring;
pub mod transfer_presets;
pub mod written;

mod preset_assets;
mod ron_asset;
mod shader_reload;
mod sheet;
mod status;
mod ui;

pub use live::{LiveBuffer, LiveParticles};
pub use options::{AppError, Demo, Extension, Grower, More, OpenRequest, Opener, WindowOptions};
pub use preset::{Backend, Preset};

use crate::gpu::{DeepfieldRenderPlugins, ParticleScene};
use bevy::camera::CameraUpdateSystems;
use bevy::log::LogPlugin;
use bevy::prelude::*;
use bevy::render::{RenderPlugin, settings::WgpuSettings};
use bevy::window::{CursorOptions, PresentMode, WindowMode, WindowResolution};
use bevy_egui::{EguiPlugin, EguiPrimaryContextPass};
use camera::{CameraPlugin, CameraSystems};
use pages::PageSystems;

/// What is logged. Packets that are refused are an everyday matter. That an X server has no settings or a monitor no size
/// (winit), or that a driver draws on the processor (bevy_render; the statistics say which adapter it is), nobody who starts the
/// program can change. That there are no dialogs (rfd), the window says.
const LOG_FILTER: &str =
    "warn,deepfield=info,wgpu_hal=error,renetcode=off,winit=error,bevy_render::renderer=error,rfd=off";

/// Opens the window and runs until it is closed.
///
/// # Errors
///
/// What [`build_window`] and [`run_app`] refuse.
pub fn run_window(options: WindowOptions) -> Result<(), AppError> {
    run_app(build_window(options)?)
}

/// The window with all its plugins, and those of the caller; it opens when the app runs.
///
/// # Errors
///
/// [`AppError::NoDisplay`] where there is no display, [`AppError::Preset`] where the preset is refused.
pub fn build_window(options: WindowOptions) -> Result<App, AppError> {
    let shown = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    if cfg!(target_os = "linux") && !shown("DISPLAY") && !shown("WAYLAND_DISPLAY") {
        return Err(AppError::NoDisplay);
    }
    let preset = options.resolved_preset()?;
    let mut app = App::new();
    preset_assets::register_sources(&mut app);
    app.add_plugins(
        DefaultPlugins
            .set(WindowPlugin {
                primary_window: Some(primary_window(&preset, options.fullscreen)),
                primary_cursor_options: Some(CursorOptions { visible: !options.audience, ..default() }),
                ..default()
            })
            .set(RenderPlugin {
                render_creation: WgpuSettings { backends: Some(options.drivers), ..default() }.into(),
                ..default()
            })
            .set(LogPlugin { filter: LOG_FILTER.to_owned(), ..default() }),
    );
    let extension = options.extension.clone();
    app.add_plugins(WindowApp { options, preset });
    if let Some(extend) = extension {
        extend(&mut app);
    }
    Ok(app)
}

/// Runs a window until it is closed.
///
/// # Errors
///
/// [`AppError::Failed`] where the event loop ends with an error, as it does when the adapter is lost.
pub fn run_app(mut app: App) -> Result<(), AppError> {
    match app.run() {
        AppExit::Success => Ok(()),
        AppExit::Error(_) => Err(AppError::Failed),
    }
}

/// What others than the window itself may switch off, by conditions on these sets.
#[derive(SystemSet, Clone, Debug, PartialEq, Eq, Hash)]
pub enum WindowSystems {
    /// Files that are dropped, and keys.
    TakeInput,
    /// A tour moves the camera and changes settings.
    PlayTour,
    /// The panels, the picture and what is over it are laid out.
    LayOut,
}

/// The window as the preset asks for it.
fn primary_window(preset: &Preset, fullscreen: bool) -> Window {
    Window {
        mode: if fullscreen { shortcuts::FULLSCREEN } else { WindowMode::Windowed },
        title: "deepfield".to_owned(),
        name: Some("deepfield".to_owned()),
        resolution: WindowResolution::new(preset.window.width, preset.window.height),
        present_mode: if preset.window.vsync { PresentMode::AutoVsync } else { PresentMode::AutoNoVsync },
        ..default()
    }
}

/// Everything that the window does, on top of Bevy's default plugins.
struct WindowApp {
    options: WindowOptions,
    preset: Preset,
}

impl Plugin for WindowApp {
    fn build(&self, app: &mut App) {
        let mut openings = open::Openings::new(self.options.opener.clone());
        openings.read = self.preset.residency.read;
        if let Some(request) = self.options.open.clone() {
            openings.start(request);
        }
        if let Some(grower) = self.options.grower.clone() {
            app.insert_resource(growing::Growing::new(grower, self.options.opener.clone()));
        }
        let mut objects = objects::Objects::default();
        if let Some(path) = self.options.labels.clone() {
            objects.is_given = true;
            objects.open(path);
        }
        let (surround, stereo) = self.options.projection;
        let mut settings =
            scene::Settings { surround, stereo, ..scene::Settings::new(&self.preset, self.options.mode.as_deref()) };
        settings.look = settings.look.with(&self.options.light);
        let residency = &self.preset.residency;
        app.insert_resource(ParticleScene::new(residency.gpu_bytes()[0], residency.upload_mib << 20));
        app.add_plugins((
            DeepfieldRenderPlugins,
            // Panels have few textures. Asked for arrays of them, it warns of adapters that have none.
            EguiPlugin { bindless_mode_array_size: None },
            CameraPlugin,
            pointer_motion::PointerMotionPlugin,
            pacing::PacingPlugin,
            assistive::AssistivePlugin,
            touring::TouringPlugin { open: self.options.tour.clone(), light: self.options.light.clone() },
            pages::PagesPlugin,
            looking::LookingPlugin,
            panel::PanelPlugin,
            preset_assets::PresetPlugin::new(&self.options),
            shader_reload::ShaderReloadPlugin,
            transfer_presets::TransferPresetsPlugin { folder: crate::color::transfer::presets::folder() },
        ))
        .insert_resource(ClearColor(Color::BLACK))
        .insert_resource(state::panels::Shown {
            panel: self.preset.panel.open,
            left: true,
            right: self.preset.panel.right,
            help: false,
        })
        .insert_resource(self.preset.clone())
        .insert_resource(settings)
        .insert_resource(openings)
        .insert_resource(files::Files::new(&self.options))
        .insert_resource(status::StatusFile::new(self.options.status.clone()))
        .insert_resource(state::panels::Closed(self.preset.panel.closed.iter().cloned().collect()))
        .init_resource::<history::History>()
        .insert_resource(objects)
        .init_resource::<scene_io::SceneFiles>()
        .init_resource::<scene_io::Bookmarks>()
        .init_resource::<state::plots::PlotChoice>()
        .init_resource::<ui::Controls>()
        .init_resource::<overlay::tour::TourPictures>()
        .init_resource::<exposure::Exposure>()
        .init_resource::<look::Held>()
        .init_resource::<input::PointerOwner>()
        .init_resource::<state::notices::Notices>()
        .insert_resource(state::choices::Choices::of_program())
        .init_resource::<cpu_backend::CpuPicture>()
        .init_resource::<field_backend::FieldPicture>()
        .init_resource::<field_backend::on_adapter::FieldOnAdapter>()
        .init_resource::<field_backend::surface_on_adapter::SurfaceOnAdapter>()
        .init_resource::<written::WrittenHeights>()
        .init_resource::<paths::Paths>()
        .init_resource::<comparison::Comparison>()
        .init_resource::<run_ranges::RunRanges>()
        .init_resource::<surround_backend::SurroundPicture>()
        .init_resource::<picture::Letterbox>()
        .init_resource::<live::LiveParticles>()
        .init_resource::<live::copies::LiveCopies>()
        .init_resource::<gpu_backend::GpuTables>()
        .init_resource::<light_backend::LightPictures>()
        .init_resource::<pass_times::LastPasses>()
        .init_resource::<statistics::ActiveBackend>()
        .init_resource::<screenshot::Screenshots>()
        .init_resource::<statistics::Converged>()
        .init_resource::<statistics::FrameClock>()
        .init_resource::<statistics::Statistics>()
        .add_message::<open::Opened>()
        .add_message::<open::Wanted>()
        .add_message::<scene::TransferKept>()
        .add_systems(
            Startup,
            (picture::spawn_cameras, bevy::ecs::schedule::ApplyDeferred, gpu_backend::choose_backend).chain(),
        )
        .add_observer(gpu_backend::free_slot)
        .add_systems(
            PreUpdate,
            (state::notices::advance_notices, pass_times::follow_times, screenshot::report_screenshots),
        )
        .add_systems(
            Update,
            (
                open::follow_preset.run_if(resource_changed::<Preset>),
                (files::take_keys, files::carry_out, dropped::open_dropped_files)
                    .chain()
                    .in_set(WindowSystems::TakeInput),
                // What turns out to be data joins what is on its way, which is there before it has arrived.
                objects::receive_catalogue,
                // A run gives way to a file that has been asked for until that is handed over.
                (growing::grow.run_if(resource_exists::<growing::Growing>), open::finish_opening).chain(),
                objects::follow_time,
                (adopt::adopt_opened, files::remember_opened).chain(),
                objects::stand_on_heights,
                ground::follow_ground,
                (playhead::play, playhead::show_moment).chain(),
                history::undo_and_redo,
                lens::follow_lens,
                scene_io::save_scene,
                bookmarks::run_bookmarks,
                (
                    touring::player::take_keys,
                    touring::player::take_presenter_keys,
                    touring::player::play_tour.in_set(WindowSystems::PlayTour),
                    touring::player::lead_time.in_set(WindowSystems::PlayTour),
                )
                    .chain(),
                (
                    look::follow_settings,
                    touring::ranges::measure_ahead.in_set(WindowSystems::PlayTour),
                    run_ranges::measure_run,
                    touring::ranges::hold_ranges,
                    look::glide_levels,
                )
                    .chain(),
                shortcuts::run_shortcuts.in_set(WindowSystems::TakeInput),
                gpu_backend::follow_budgets.run_if(resource_changed::<Preset>),
                gpu_backend::choose_backend.run_if(
                    resource_changed::<Preset>
                        .or_else(gpu_backend::technique_changed)
                        .or_else(live::came_or_went)
                        .or_else(paths::among_changed)
                        .or_else(field_backend::came_or_went)
                        .or_else(surround_backend::came_or_went),
                ),
            )
                .chain(),
        )
        .add_systems(EguiPrimaryContextPass, ui::draw_window.in_set(WindowSystems::LayOut))
        .add_systems(
            PostUpdate,
            (
                picture::fit_picture.in_set(CameraSystems::Steer).before(CameraUpdateSystems),
                (gpu_backend::renew_content, gpu_backend::receive_copies)
                    .chain()
                    .in_set(PageSystems::Arrive)
                    .after(pages::finish_loads),
                (
                    touring::before::draw_before.run_if(not(surround_backend::is_active)),
                    comparison::compare,
                    paths::follow_paths,
                    cpu_backend::draw_on_cpu,
                    cpu_backend::show_on_cpu,
                    (field_backend::draw_field, field_backend::show_field).chain(),
                    surround_backend::draw_surround,
                    gpu_backend::upload_pages,
                    gpu_backend::hold_picture,
                    live::copies::copy_live,
                    gpu_backend::draw_on_gpu,
                    light_backend::draw_light_on_gpu,
                    field_backend::on_adapter::draw_field_on_adapter,
                    field_backend::surface_on_adapter::draw_surface_on_adapter,
                    bloom::follow_bloom,
                    paths::draw_paths,
                    run_ranges::hold_convergence,
                )
                    .chain()
                    .in_set(PageSystems::Serve)
                    .after(pages::evict),
            ),
        )
        .add_systems(PostUpdate, files::keep_title)
        .add_systems(Last, (history::record_settings, status::write_status).chain());
    }
}
