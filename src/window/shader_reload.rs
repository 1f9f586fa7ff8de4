//! While a mode is developed: a shader file that changes is taken up by the running window. It is composed and validated before
//! anything draws with it, so that a mistake is told with its file and line and the last good picture stays.
//!
//! Where the sources are not there, as for an installed program, there is nothing to watch. The shaders of volumes are built when their
//! renderer opens, and are taken up with the next start.

use super::state::notices::Notices;
use crate::gpu::shaders::check::{Variant, compose, texts, variants, variants_of};
use crate::gpu::shaders::{SHADERS, ShaderFiles, load};
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
        let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders");
        let own = SHADERS.iter().map(|(name, _)| (*name, own.join(name)));
        let watched = own.chain(files.iter().map(|file| (file.name, PathBuf::from(file.file))));
        let watched: Vec<Watched> = watched.filter_map(|(name, path)| Watched::new(name, path)).collect();
        if !watched.is_empty() {
            let variants = || variants().into_iter().chain(variants_of(&files));
            let (texts, variants) = (texts(&files), variants().collect());
            app.insert_resource(Watcher { watched, texts, variants, looked: None }).add_systems(Update, reload);
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

/// The files, and the shaders in use.
#[derive(Resource)]
struct Watcher {
    watched: Vec<Watched>,
    texts: Vec<(&'static str, String)>,
    variants: Vec<Variant>,
    looked: Option<Instant>,
}

impl Watcher {
    /// Takes a text over, if all shaders are right with it.
    fn take(&mut self, name: &str, text: String) -> Result<(), String> {
        let mut texts = self.texts.clone();
        texts.iter_mut().filter(|(other, _)| *other == name).for_each(|(_, old)| old.clone_from(&text));
        let is_library = text.contains("#define_import_path");
        for variant in self.variants.iter().filter(|variant| is_library || variant.path == name) {
            compose(&texts, variant)?;
        }
        self.texts = texts;
        Ok(())
    }
}

/// Takes up what has changed.
fn reload(
    mut watcher: ResMut<Watcher>,
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
        match watcher.take(name, text.clone()) {
            Ok(()) => {
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
    fn mistakes_are_told_with_their_line_and_not_taken_over() {
        let mut watcher = Watcher { watched: vec![], texts: texts(&[]), variants: variants(), looked: None };
        let name = "composite/composite.wgsl";
        let good = watcher.texts.iter().find(|text| text.0 == name).unwrap().1.clone();
        let wrong = watcher.take(name, format!("{good}\nfn wrong() -> f32 {{ return 1u; }}\n")).unwrap_err();
        let line = good.lines().count() + 2;
        assert!(wrong.contains(&format!("{name}:{line}:")), "{wrong}");
        assert!(!wrong.contains('\n') && watcher.texts.iter().any(|text| text.0 == name && text.1 == good));
        watcher.take(name, format!("{good}\nfn right() -> f32 {{ return 1.0; }}\n")).unwrap();
        assert!(watcher.texts.iter().any(|text| text.0 == name && text.1 != good));
    }
}
