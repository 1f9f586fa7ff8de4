//! A path that is typed: where the system has no dialogs, and for who has it at hand.

use super::{Ask, Files, Purpose};
use crate::import::file_of_step;
use crate::model::is_url;
use crate::model::url::shown;
use crate::window::theme;
use bevy_egui::egui::{self, Align2, Key, RichText, TextEdit};
use std::path::{Path, PathBuf};

/// A path that is being typed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Typed {
    /// What it is typed for.
    pub purpose: Purpose,
    text: String,
    is_begun: bool,
    refused: Option<String>,
}

impl Typed {
    /// Nothing has been typed.
    pub fn new(purpose: Purpose) -> Typed {
        Typed { purpose, text: String::new(), is_begun: false, refused: None }
    }

    /// The path that the text means.
    fn path(&self) -> Result<PathBuf, String> {
        let path = path_of(&self.text, etcetera::home_dir().ok().as_deref());
        let path = path.ok_or("found no path, expected one")?;
        if is_url(&path) && self.purpose == Purpose::Open {
            // What is there shows when it is opened.
            return Ok(shown(&path));
        }
        let path = std::path::absolute(&path).map_err(|error| format!("{}: {error}", path.display()))?;
        match self.purpose {
            Purpose::Open if !file_of_step(&path).exists() => Err(format!("{}: no file is there", path.display())),
            // The system's dialogs ask before a file is replaced.
            Purpose::SaveAs if super::scene_path(path.clone()).exists() => {
                Err(format!("{}: found a file, expected a name that none has", path.display()))
            }
            Purpose::Open | Purpose::SaveAs => Ok(path),
        }
    }
}

/// The path in a text as people paste it: with quotes around it, or from their home folder on.
fn path_of(text: &str, home: Option<&Path>) -> Option<PathBuf> {
    let text = text.trim();
    let quoted = |mark: char| text.strip_prefix(mark)?.strip_suffix(mark);
    let text = quoted('"').or_else(|| quoted('\'')).unwrap_or(text);
    match (text.strip_prefix("~/"), home) {
        (Some(rest), Some(home)) => Some(home.join(rest)),
        _ => Some(text).filter(|text| !text.is_empty()).map(PathBuf::from),
    }
}

/// Draws the small window in the middle of the picture, where a path is being typed. Enter takes it, Esc does not.
pub fn show(ctx: &egui::Context, picture: egui::Rect, files: &mut Files) {
    let Some(typed) = &mut files.typed else { return };
    let (title, verb) = match typed.purpose {
        Purpose::Open => ("Open", "Open"),
        Purpose::SaveAs => ("Save the scene as", "Save"),
    };
    let mut is_over = ctx.input(|input| input.key_pressed(Key::Escape));
    let mut is_done = false;
    egui::Area::new("typed path".into())
        .order(egui::Order::Foreground)
        .pivot(Align2::CENTER_CENTER)
        .fixed_pos(picture.center())
        .show(ctx, |ui| {
            theme::card_frame().show(ui, |ui| {
                let heading = ui.label(RichText::new(title).size(16.0).color(theme::TEXT));
                ui.add_space(6.0);
                let width = (picture.width() - 80.0).clamp(160.0, 460.0);
                let field = ui.add(TextEdit::singleline(&mut typed.text).desired_width(width).hint_text("its path"));
                let field = field.labelled_by(heading.id);
                theme::register(ui, "typed:path", field.rect);
                if !std::mem::replace(&mut typed.is_begun, true) {
                    field.request_focus();
                }
                if field.changed() {
                    typed.refused = None;
                }
                is_done = field.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter));
                if let Some(why) = &typed.refused {
                    ui.label(RichText::new(why).color(theme::BAD));
                }
                ui.add_space(6.0);
                ui.horizontal(|ui| {
                    is_done |= theme::button(ui, "typed:take", verb, !typed.text.trim().is_empty(), "Enter");
                    is_over |= theme::button(ui, "typed:cancel", "Cancel", true, "Esc");
                });
                if is_done {
                    match typed.path() {
                        Ok(path) => {
                            files.asked = Some(Ask::Use(typed.purpose, path));
                            is_over = true;
                        }
                        Err(why) => {
                            typed.refused = Some(why);
                            field.request_focus();
                        }
                    }
                }
            });
        });
    if is_over {
        files.typed = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_understood_as_people_paste_them() {
        let home = Path::new("/home/ada");
        for (text, path) in [
            (" /data/a b.hdf5\n", Some("/data/a b.hdf5")),
            ("\"/data/a b.hdf5\"", Some("/data/a b.hdf5")),
            ("'it is'", Some("it is")),
            ("~/a.df", Some("/home/ada/a.df")),
            ("~a.df", Some("~a.df")),
            ("\"", Some("\"")),
            ("  ", None),
            ("''", None),
        ] {
            assert_eq!(path_of(text, Some(home)), path.map(PathBuf::from), "{text}");
        }
        assert_eq!(path_of("~/a.df", None), Some("~/a.df".into()));
    }

    #[test]
    fn what_is_opened_is_there_and_what_is_saved_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let there = folder.path().join("a.scene.ron");
        std::fs::write(&there, "").unwrap();
        let typed = |purpose, path: &Path| Typed { text: path.display().to_string(), ..Typed::new(purpose) }.path();
        assert_eq!(typed(Purpose::Open, &there), Ok(there.clone()));
        let url = typed(Purpose::Open, Path::new("https://data.example/a.df?sig=1"));
        assert_eq!(url, Ok("https://data.example/a.df".into()));
        assert!(typed(Purpose::Open, &folder.path().join("b.df")).unwrap_err().ends_with("b.df: no file is there"));
        assert!(typed(Purpose::SaveAs, &folder.path().join("a")).unwrap_err().contains("found a file"));
        assert!(typed(Purpose::SaveAs, &folder.path().join("b")).is_ok());
    }
}
