//! While a mode is developed: a shader file that changes is taken up by the running window. It is composed and validated before
//! anything draws with it, so that a mistake is told with its file and line and the last good picture stays.
//!
//! Where the sources are not there, as for an installed program, there is nothing to watch.

use super::state::notices::Notices;
use crate::gpu::shaders::check::{Composer, Variant, texts, variants, variants_of};
use crate::gpu::shaders::{SHADERS, ShaderFiles, load};
use bevy::asset::io::file::FileAssetReader;
use bevy::prelude::*;
use bevy::shader::Shader;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

/// How often files are looked at.
const EVERY: Duration = Duration::from_millis(300);

/// Watches the files of shaders.
pub(super) struct ShaderReloadPlugin;

impl Plugin for ShaderReloadPlugin {
    fn build(&self, app: &mut App) {
        let files = app.world().get_resource::<ShaderFiles>().cloned().unwrap_or_default().0;
        // Where other assets are that may be edited, else where the program was compiled.
        let roots = [FileAssetReader::get_base_path(), PathBuf::from(env!("CARGO_MANIFEST_DIR"))];
        let own = SHADERS.iter().filter_map(|(name, _)| {
            let mut paths = roots.iter().map(|root| root.join("shaders").join(name));
            Some((*name, paths.find(|path| path.is_file())?))
        });
        let watched = own.chain(files.iter().map(|file| (file.name, PathBuf::from(file.file))));
        let watched: Vec<Watched> = watched.filter_map(|(name, path)| Watched::new(name, path)).collect();
        app.insert_resource(ShaderTexts(texts(&files)));
        if !watched.is_empty() {
            let variants = variants().into_iter().chain(variants_of(&files)).collect();
            app.insert_resource(Watcher { watched, variants, looked: None }).add_systems(Update, reload);
        }
    }
}

/// A file, and when it was written.
struct Watched {
    name: &'static str,
    path: PathBuf,
    written: SystemTime,
}

impl Watched {
    fn new(name: &'static str, path: PathBuf) -> Option<Watched> {
        let written = written(&path)?;
        Some(Watched { name, path, written })
    }

    /// Its text, if it has been written since the last call.
    fn changed(&mut self) -> Option<String> {
        let now = written(&self.path)?;
        if std::mem::replace(&mut self.written, now) == now {
            return None;
        }
        std::fs::read_to_string(&self.path).ok()
    }
}

fn written(path: &Path) -> Option<SystemTime> {
    std::fs::metadata(path).and_then(|about| about.modified()).ok()
}

/// The shaders in use: their paths and texts.
#[derive(Resource)]
pub(super) struct ShaderTexts(pub Vec<(&'static str, String)>);

impl ShaderTexts {
    /// The same with another text of one of them, if all that is made of them is right then.
    fn with(&self, name: &str, text: &str, variants: &[Variant]) -> Result<ShaderTexts, String> {
        let mut texts = self.0.clone();
        texts.iter_mut().filter(|(other, _)| *other == name).for_each(|(_, old)| text.clone_into(old));
        let is_library = text.contains("#define_import_path");
        let mut composer = Composer::new(&texts);
        for variant in variants.iter().filter(|variant| is_library || variant.path == name) {
            composer.compose(variant)?;
        }
        Ok(ShaderTexts(texts))
    }
}

/// The files, and all that is made of them.
#[derive(Resource)]
struct Watcher {
    watched: Vec<Watched>,
    variants: Vec<Variant>,
    looked: Option<Instant>,
}

/// Takes up what has changed.
fn reload(
    mut watcher: ResMut<Watcher>,
    mut texts: ResMut<ShaderTexts>,
    server: Res<AssetServer>,
    mut shaders: ResMut<Assets<Shader>>,
    mut notices: ResMut<Notices>,
) {
    if watcher.looked.is_some_and(|looked| looked.elapsed() < EVERY) {
        return;
    }
    watcher.looked = Some(Instant::now());
    let changed: Vec<(&'static str, PathBuf, String)> = watcher
        .watched
        .iter_mut()
        .filter_map(|file| file.changed().map(|text| (file.name, file.path.clone(), text)))
        .collect();
    for (name, path, text) in changed {
        match texts.with(name, &text, &watcher.variants) {
            Ok(with) => {
                *texts = with;
                let shader = Shader::from_wgsl(text, format!("embedded://deepfield/{name}"));
                match shaders.insert(load(&server, name).id(), shader) {
                    Ok(()) => notices.info(format!("{}: in use", path.display())),
                    Err(error) => notices.error(format!("{}: {error}", path.display())),
                }
            }
            Err(error) => {
                let place = error.replace(name, &path.to_string_lossy());
                notices.error(format!("{place}; the last good shader stays"));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mistakes_are_told_with_their_line() {
        let (variants, texts) = (variants(), ShaderTexts(texts(&[])));
        let name = "composite/composite.wgsl";
        let text = |texts: &ShaderTexts| texts.0.iter().find(|text| text.0 == name).unwrap().1.clone();
        let good = text(&texts);
        let wrong = format!("{good}\nfn wrong() -> f32 {{ return 1u; }}\n");
        let wrong = texts.with(name, &wrong, &variants).map(|_| ()).unwrap_err();
        let line = good.lines().count() + 2;
        assert!(wrong.contains(&format!("{name}:{line}:")), "{wrong}");
        assert!(!wrong.contains('\n'));
        let right = format!("{good}\nfn right() -> f32 {{ return 1.0; }}\n");
        assert_eq!(text(&texts.with(name, &right, &variants).unwrap()), right);
    }
}
