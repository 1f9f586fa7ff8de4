//! Transfer functions by name in the window: files under `assets/transfer` as Bevy assets, reloaded when they change, and
//! written when the user saves.

use super::ron_asset::{RonAssetLoader, refusal};
use super::scene::Settings;
use super::state::notices::Notices;
use crate::color::transfer::{TransferFunction, presets};
use bevy::asset::AssetLoadFailedEvent;
use bevy::prelude::*;
use std::path::PathBuf;

/// A preset's file.
#[derive(Asset, TypePath, Clone, Debug, PartialEq)]
pub struct TransferAsset(TransferFunction);

/// A preset.
struct Preset {
    name: String,
    transfer: Option<TransferFunction>,
    /// Its file, kept loaded so that it is watched.
    handle: Option<Handle<TransferAsset>>,
}

/// The presets, and the one that the picture's colours began with.
#[derive(Resource, Default)]
pub struct TransferPresets {
    all: Vec<Preset>,
    /// Where their files are.
    folder: Option<PathBuf>,
    chosen: Option<String>,
    to_save: Option<(String, TransferFunction)>,
}

impl TransferPresets {
    /// Their names.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.all.iter().map(|preset| preset.name.as_str())
    }

    /// The preset of that name.
    pub fn get(&self, name: &str) -> Option<&TransferFunction> {
        self.all.iter().find(|preset| preset.name == name)?.transfer.as_ref()
    }

    /// The preset that the picture's colours began with, as it is in its file.
    pub fn chosen(&self) -> Option<(&str, &TransferFunction)> {
        let name = self.chosen.as_deref()?;
        Some((name, self.get(name)?))
    }

    /// Makes a preset the chosen one, and gives it.
    pub fn choose(&mut self, name: &str) -> Option<TransferFunction> {
        let transfer = self.get(name)?.clone();
        self.chosen = Some(name.to_owned());
        Some(transfer)
    }

    /// Asks for a preset's file to be written.
    pub fn ask_to_save(&mut self, name: String, transfer: TransferFunction) {
        self.to_save = Some((name, transfer));
    }

    /// Takes over what a file says; the colours that the picture should have now, if they were those of the file.
    fn take_in(
        &mut self,
        name: &str,
        transfer: &TransferFunction,
        shown: &TransferFunction,
    ) -> Option<TransferFunction> {
        let preset = self.all.iter_mut().find(|preset| preset.name == name)?;
        let before = preset.transfer.replace(transfer.clone());
        let follows = self.chosen.as_deref() == Some(name) && before.as_ref() == Some(shown) && shown != transfer;
        follows.then(|| transfer.clone())
    }
}

/// Loads the presets, follows their files, and writes them.
pub struct TransferPresetsPlugin {
    /// Where their files are; `transfer` among Bevy's assets.
    pub folder: Option<PathBuf>,
}

impl Plugin for TransferPresetsPlugin {
    fn build(&self, app: &mut App) {
        app.init_asset::<TransferAsset>()
            .register_asset_loader(RonAssetLoader(|file, text| TransferFunction::parse(text, file).map(TransferAsset)))
            .insert_resource(TransferPresets { folder: self.folder.clone(), ..default() })
            .add_systems(Startup, load)
            .add_systems(Update, (follow_files, save_presets).chain());
    }
}

/// Where Bevy finds a preset's file.
fn asset_path(name: &str) -> String {
    format!("transfer/{name}.ron")
}

/// Finds all presets.
fn load(mut all: ResMut<TransferPresets>, assets: Res<AssetServer>) {
    let folder = all.folder.clone();
    all.all = presets::names(folder.as_deref())
        .into_iter()
        .map(|name| {
            let is_file = folder.as_ref().is_some_and(|folder| folder.join(format!("{name}.ron")).is_file());
            let handle = is_file.then(|| assets.load(asset_path(&name)));
            Preset { transfer: TransferFunction::preset(&name), name, handle }
        })
        .collect();
}

/// Takes over files that were loaded or changed; reports those that are refused.
fn follow_files(
    mut events: MessageReader<AssetEvent<TransferAsset>>,
    mut failures: MessageReader<AssetLoadFailedEvent<TransferAsset>>,
    files: Res<Assets<TransferAsset>>,
    mut presets: ResMut<TransferPresets>,
    mut settings: ResMut<Settings>,
    mut notices: ResMut<Notices>,
) {
    for failure in failures.read() {
        notices.error(refusal(&failure.error));
    }
    for event in events.read() {
        let (AssetEvent::Added { id } | AssetEvent::Modified { id }) = event else { continue };
        let of_file = |preset: &&Preset| preset.handle.as_ref().is_some_and(|handle| handle.id() == *id);
        let Some(name) = presets.all.iter().find(of_file).map(|preset| preset.name.clone()) else { continue };
        let Some(TransferAsset(transfer)) = files.get(*id) else { continue };
        if let Some(transfer) = presets.take_in(&name, transfer, &settings.transfer) {
            settings.transfer = transfer;
            notices.info(format!("colours {name} loaded"));
        }
    }
}

/// Writes the preset that is to be written.
fn save_presets(mut presets: ResMut<TransferPresets>, assets: Res<AssetServer>, mut notices: ResMut<Notices>) {
    if presets.to_save.is_none() {
        return;
    }
    let Some((name, transfer)) = presets.to_save.take() else { return };
    let Some(folder) = presets.folder.clone() else {
        notices.error(
            "there is no folder assets/transfer beside the program to write presets to; BEVY_ASSET_ROOT may name one",
        );
        return;
    };
    match transfer.save(&name, &folder) {
        Ok(path) => {
            notices.info(format!("saved {}", path.display()));
            match presets.all.iter_mut().find(|preset| preset.name == name) {
                Some(preset) => {
                    preset.transfer = Some(transfer);
                    preset.handle.get_or_insert_with(|| assets.load(asset_path(&name)));
                }
                None => {
                    let handle = Some(assets.load(asset_path(&name)));
                    presets.all.push(Preset { name: name.clone(), transfer: Some(transfer), handle });
                }
            }
            presets.chosen = Some(name);
        }
        Err(error) => notices.error(error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::super::ron_asset::tests::wait;
    use super::*;

    #[test]
    fn files_are_followed_written_and_refused_with_their_place() {
        let folder = tempfile::tempdir().unwrap();
        let files = folder.path().join("transfer");
        std::fs::create_dir(&files).unwrap();
        let file = files.join("mine.ron");
        std::fs::write(&file, "(gamma: 2.0)").unwrap();
        let mut app = App::new();
        let file_path = folder.path().to_string_lossy().into_owned();
        let assets = AssetPlugin { watch_for_changes_override: Some(true), file_path, ..default() };
        app.add_plugins((MinimalPlugins, assets))
            .init_resource::<Notices>()
            .insert_resource(Settings::new(&super::super::Preset::default(), None))
            .add_plugins(TransferPresetsPlugin { folder: Some(files.clone()) });
        wait(&mut app, "the file", |world| world.resource::<TransferPresets>().get("mine").is_some());
        let chosen = app.world_mut().resource_mut::<TransferPresets>().choose("mine").unwrap();
        assert_eq!(chosen.gamma, 2.0);
        app.world_mut().resource_mut::<Settings>().transfer = chosen;

        std::fs::write(&file, "(gamma: 3.0)").unwrap();
        wait(&mut app, "the changed file", |world| world.resource::<Settings>().transfer.gamma == 3.0);
        std::fs::write(&file, "(\n  gama: 4.0,\n)").unwrap();
        let refused = |world: &World| {
            let mut all = world.resource::<Notices>().all();
            all.any(|notice| notice.text.contains("mine.ron:2:") && notice.text.contains("gama"))
        };
        wait(&mut app, "a message with file, line and field", refused);
        assert_eq!(app.world().resource::<Settings>().transfer.gamma, 3.0, "the last good one stays");

        let edited = TransferFunction { gamma: 0.5, ..default() };
        app.world_mut().resource_mut::<Settings>().transfer = edited.clone();
        app.world_mut().resource_mut::<TransferPresets>().ask_to_save("other".into(), edited.clone());
        wait(&mut app, "the saved file", |world| {
            world.resource::<TransferPresets>().chosen() == Some(("other", &edited))
        });
        assert_eq!(TransferFunction::named("other", Some(&files)).unwrap(), edited);
        app.world_mut().resource_mut::<TransferPresets>().ask_to_save("../other".into(), edited);
        let refused = |world: &World| world.resource::<Notices>().all().any(|notice| notice.text.contains("../other"));
        wait(&mut app, "a refused name", refused);
    }

    #[test]
    fn a_changed_file_changes_the_picture_only_where_nothing_was_edited() {
        let [old, new, edited] = [1.0, 2.0, 3.0].map(|gamma| TransferFunction { gamma, ..Default::default() });
        let preset = |name: &str| Preset { name: name.into(), transfer: Some(old.clone()), handle: None };
        let mut presets = TransferPresets { all: vec![preset("a"), preset("b")], ..Default::default() };
        assert_eq!(presets.take_in("a", &new, &old), None, "none is chosen");
        assert_eq!(presets.choose("b"), Some(old.clone()));
        assert_eq!(presets.take_in("a", &old, &old), None);
        assert_eq!(presets.take_in("b", &new, &old), Some(new.clone()));
        assert_eq!(presets.take_in("b", &old, &edited), None, "what the user edited stays");
        assert_eq!(presets.chosen(), Some(("b", &old)));
        assert_eq!((presets.choose("c"), presets.take_in("c", &new, &old)), (None, None));
    }
}
