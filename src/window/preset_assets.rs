//! Presets as assets: where they are found, and what happens when they change while the program runs.

use super::options::WindowOptions;
use super::preset::Preset;
use super::ron_asset::{RonAssetLoader, refusal};
use super::scene::{Settings, budget_of};
use super::state::notices::Notices;
use bevy::asset::io::{AssetSourceBuilder, AssetSourceId};
use bevy::asset::{AssetLoadFailedEvent, io::file::FileAssetReader};
use bevy::prelude::*;

/// Registers the folders that assets come from, where they exist. Must run before Bevy's default plugins.
pub fn register_sources(app: &mut App) {
    let base = FileAssetReader::get_base_path();
    let folder = base.join("configs");
    if folder.is_dir() {
        app.register_asset_source("configs", AssetSourceBuilder::platform_default(&folder.to_string_lossy(), None));
    }
    // Nothing is loaded from Bevy's usual folder: where it is missing, nobody has to hear that it cannot be watched.
    if !base.join("assets").is_dir() {
        let mut usual = AssetSourceBuilder::platform_default("assets", None);
        (usual.watcher, usual.watch_warning) = (None, None);
        app.register_asset_source(AssetSourceId::Default, usual);
    }
}

/// Loads the chosen preset and applies it whenever its file changes.
pub struct PresetPlugin {
    options: WindowOptions,
}

impl PresetPlugin {
    /// The preset that the options name, with what they override.
    pub fn new(options: &WindowOptions) -> PresetPlugin {
        PresetPlugin { options: options.clone() }
    }
}

/// The preset's asset, kept loaded so that it is watched.
#[derive(Resource)]
struct PresetFile {
    handle: Handle<Preset>,
    options: WindowOptions,
}

impl Plugin for PresetPlugin {
    fn build(&self, app: &mut App) {
        app.init_asset::<Preset>()
            .register_asset_loader(RonAssetLoader(Preset::parse))
            .add_systems(Update, apply_preset.run_if(resource_exists::<PresetFile>));
        if FileAssetReader::get_base_path().join("configs").is_dir() {
            let path = format!("configs://{}.ron", self.options.preset);
            let handle = app.world().resource::<AssetServer>().load(path);
            app.insert_resource(PresetFile { handle, options: self.options.clone() });
        }
    }
}

/// Takes over a preset that was loaded or changed; reports one that is refused and keeps the last good one.
fn apply_preset(
    mut events: MessageReader<AssetEvent<Preset>>,
    mut failures: MessageReader<AssetLoadFailedEvent<Preset>>,
    file: Res<PresetFile>,
    presets: Res<Assets<Preset>>,
    mut preset: ResMut<Preset>,
    mut settings: ResMut<Settings>,
    mut notices: ResMut<Notices>,
) {
    for failure in failures.read() {
        notices.error(refusal(&failure.error));
    }
    let changed = events.read().any(
        |event| matches!(event, AssetEvent::Added { id } | AssetEvent::Modified { id } if *id == file.handle.id()),
    );
    if !changed {
        return;
    }
    let Some(loaded) = presets.get(&file.handle) else { return };
    let mut loaded = loaded.clone();
    file.options.override_preset(&mut loaded);
    if loaded.drawing.error_px != preset.drawing.error_px {
        settings.error_px = loaded.drawing.error_px;
    }
    if loaded.camera.field_of_view_deg != preset.camera.field_of_view_deg {
        settings.lens.fov_deg = loaded.camera.field_of_view_deg;
    }
    let budget = budget_of(&loaded);
    if budget != budget_of(&preset) {
        settings.budget.0.extend(budget.0);
    }
    if preset.set_if_neq(loaded) {
        notices.info(format!("preset {} loaded", file.options.preset));
    }
}

#[cfg(test)]
mod tests {
    use super::super::ron_asset::tests::wait;
    use super::*;
    use std::sync::Arc;

    #[test]
    fn a_changed_preset_is_applied_and_a_wrong_one_is_refused_with_its_place() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("desktop.ron");
        std::fs::write(&file, "(drawing: (error_px: 2.0))").unwrap();
        let mut app = App::new();
        let source = AssetSourceBuilder::platform_default(&folder.path().to_string_lossy(), None);
        app.register_asset_source("configs", source);
        app.add_plugins((MinimalPlugins, AssetPlugin { watch_for_changes_override: Some(true), ..default() }))
            .init_asset::<Preset>()
            .register_asset_loader(RonAssetLoader(Preset::parse))
            .init_resource::<Notices>()
            .insert_resource(Preset::default())
            .insert_resource(Settings::new(&Preset::default(), None))
            .add_systems(Update, apply_preset);
        let handle = app.world().resource::<AssetServer>().load("configs://desktop.ron");
        let options = WindowOptions::new(None, Arc::new(|_, _, _| Err("nothing is opened here".to_owned())));
        app.insert_resource(PresetFile { handle, options });
        let error_px = |world: &World| world.resource::<Settings>().error_px;
        wait(&mut app, "the preset at the start", |world| error_px(world) == 2.0);

        std::fs::write(&file, "(\n    drawing: (error_pixels: 3.0),\n)").unwrap();
        let refused = |world: &World| {
            let notices = world.resource::<Notices>();
            notices.all().any(|notice| notice.text.contains("desktop.ron:2:") && notice.text.contains("error_pixels"))
        };
        wait(&mut app, "a message with file, line and field", refused);
        assert_eq!(error_px(app.world()), 2.0, "the last good preset stays");

        std::fs::write(&file, "(drawing: (error_px: 4.0))").unwrap();
        wait(&mut app, "the corrected preset", |world| error_px(world) == 4.0);
    }
}
