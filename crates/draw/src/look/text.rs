//! Scenes as text: read with every mistake named by its place, written under a temporary name first.

use super::{SceneFile, VERSION, VERSION_TIME, check};
use crate::model::new_file;
use crate::model::ron_file::{self, RonError};
use std::path::{Path, PathBuf};

/// Why a scene is not opened or saved.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// Its text is refused.
    #[error(transparent)]
    Ron(#[from] RonError),
    /// It was written by a later version of the program.
    #[error("{file}: version is {found}, expected at most {VERSION_TIME}: a later deepfield has written it")]
    Version {
        /// The scene file.
        file: String,
        /// Its version.
        found: u32,
    },
    /// The data is neither where the scene says nor beside it.
    #[error(
        "{}: the data is not at {}{nor}; put it beside this file, correct its path there, or name it: \
         deepfield view DATA --scene {}, or of a tour deepfield tour {} DATA",
        scene.display(), path.display(), scene.display(), scene.display()
    )]
    Missing {
        /// The scene file.
        scene: PathBuf,
        /// Where the scene says that the data is.
        path: PathBuf,
        /// Where it was looked for, too, in words.
        nor: String,
    },
    /// The file cannot be written.
    #[error("{}: {source}", path.display())]
    Write {
        /// The scene file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
}

/// Whether a path is that of a scene by its name: `NAME.scene.ron`, or any other `.ron`.
pub fn is_scene_file(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("ron"))
}

impl SceneFile {
    /// Reads a scene file.
    ///
    /// # Errors
    /// [`SceneError::Ron`] and [`SceneError::Version`].
    pub fn read(path: &Path) -> Result<SceneFile, SceneError> {
        let (file, text) = ron_file::read_text(path)?;
        SceneFile::parse(&file, &text)
    }

    /// Reads a scene from text; `file` is what errors call it.
    ///
    /// # Errors
    /// [`SceneError::Ron`] and [`SceneError::Version`].
    pub fn parse(file: &str, text: &str) -> Result<SceneFile, SceneError> {
        if let Some(found) = ron_file::later_version(text, VERSION_TIME) {
            return Err(SceneError::Version { file: file.to_owned(), found });
        }
        let scene: SceneFile = ron_file::parse(file, text)?;
        check::check(&scene, file, text)?;
        Ok(scene)
    }

    /// The first version that can say it.
    fn least_version(&self) -> u32 {
        let before = self.film.as_ref().and_then(|film| film.from.as_ref());
        let is_timed = self.look.is_of_runs() || before.is_some_and(|before| before.look.is_of_runs());
        if is_timed { VERSION_TIME } else { VERSION }
    }

    /// The scene as text.
    ///
    /// # Errors
    /// [`SceneError::Write`] if RON cannot say it.
    pub fn text(&self, path: &Path) -> Result<String, SceneError> {
        let style = ron::ser::PrettyConfig::new().depth_limit(4).struct_names(false);
        let fail = |error: ron::Error| SceneError::Write {
            path: path.to_owned(),
            source: std::io::Error::new(std::io::ErrorKind::InvalidData, error.to_string()),
        };
        let mut scene = SceneFile { version: self.least_version(), ..self.clone() };
        scene.look = scene.look.without_usual();
        if let Some(from) = scene.film.as_mut().and_then(|film| film.from.as_mut()) {
            from.look = std::mem::take(&mut from.look).without_usual();
        }
        let body = ron::ser::to_string_pretty(&scene, style).map_err(fail)?;
        Ok(format!("// A scene of deepfield: `deepfield view` and `deepfield render` open it.\n{body}\n"))
    }

    /// Writes the scene file under another name, which then takes its place.
    ///
    /// # Errors
    /// [`SceneError::Write`].
    pub fn write(&self, path: &Path) -> Result<(), SceneError> {
        let text = self.text(path)?;
        new_file::write(path, &text).map_err(|source| SceneError::Write { path: path.to_owned(), source })
    }
}

#[cfg(test)]
mod tests;
