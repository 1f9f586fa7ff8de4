//! A window that is kept open by [`crate::show::supervisor`]: what it hears from there, and where it goes on when it is opened again
//! ([`resume`]).

pub mod resume;

use crate::show::supervisor::{Line, RunFolder, line};
use crate::window::adopt::adopt_opened;
use crate::window::state::notices::Notices;
use crate::window::touring::player;
use bevy::prelude::*;
use std::sync::mpsc::{Receiver, TryRecvError};
use std::sync::{Mutex, PoisonError};

/// Frames after which a window has been seen: a driver that fails with the first ones is not worth trying again.
const SEEN: u32 = 3;

/// The window's end of the line.
#[derive(Resource)]
pub struct Supervised {
    folder: RunFolder,
    lines: Mutex<Receiver<Line>>,
    outputs: Vec<(String, Option<u32>)>,
    frames: u32,
}

impl Supervised {
    /// A window whose lines come from `lines`.
    pub fn new(folder: RunFolder, lines: Receiver<Line>) -> Supervised {
        Supervised { folder, lines: Mutex::new(lines), outputs: Vec::new(), frames: 0 }
    }

    /// The windows of this machine's outputs that are open, and the numbers of their processes.
    pub fn outputs(&self) -> impl Iterator<Item = (&str, u32)> {
        self.outputs.iter().filter_map(|(name, process)| Some((name.as_str(), (*process)?)))
    }
}

/// Lets a window be kept open; one that shows something `of_its_own` goes on where the one before it was.
pub fn add(app: &mut App, folder: RunFolder, of_its_own: bool, went_on: Option<resume::State>) {
    let lines = line::hear(std::io::BufReader::new(std::io::stdin()), || std::process::exit(0));
    app.insert_resource(Supervised::new(folder, lines))
        .add_systems(PreUpdate, receive_lines)
        .add_systems(Last, report_shown);
    if of_its_own {
        app.insert_resource(resume::Keeping::default()).add_systems(Last, resume::keep_state);
    }
    if let Some(state) = went_on {
        app.insert_resource(resume::GoingOn(state))
            .add_systems(Update, resume::restore_state.after(adopt_opened).before(player::take_keys));
    }
}

/// Takes in what is said; ends the window where nobody is there any more.
fn receive_lines(mut supervised: ResMut<Supervised>, mut notices: ResMut<Notices>, mut exit: MessageWriter<AppExit>) {
    let supervised = supervised.bypass_change_detection();
    let lines = supervised.lines.get_mut().unwrap_or_else(PoisonError::into_inner);
    loop {
        match lines.try_recv() {
            Ok(Line::Said(text)) => notices.error(text),
            Ok(Line::Output { name, process }) => {
                match supervised.outputs.iter_mut().find(|(known, _)| *known == name) {
                    Some(output) => output.1 = process,
                    None => supervised.outputs.push((name, process)),
                }
            }
            Err(TryRecvError::Empty) => break,
            Err(TryRecvError::Disconnected) => {
                exit.write(AppExit::Success);
                break;
            }
        }
    }
}

/// Says, once, that the window can be seen.
fn report_shown(mut supervised: ResMut<Supervised>, mut notices: ResMut<Notices>) {
    let supervised = supervised.bypass_change_detection();
    supervised.frames = supervised.frames.saturating_add(1);
    if supervised.frames == SEEN
        && let Err(error) = supervised.folder.set_shown()
    {
        notices.error(format!("this window is not opened again when it fails: {error}"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::channel;

    #[test]
    fn what_is_said_is_told_and_a_window_ends_with_its_line() {
        let folder = tempfile::tempdir().unwrap();
        let (sender, lines) = channel();
        let mut app = App::new();
        app.add_plugins(MinimalPlugins)
            .init_resource::<Notices>()
            .insert_resource(Supervised::new(RunFolder::at(folder.path()), lines))
            .add_systems(PreUpdate, receive_lines)
            .add_systems(Last, report_shown);
        let output = |process| Line::Output { name: "left".into(), process };
        for line in [output(None), Line::Said("left: its window has ended".into()), output(Some(7))] {
            sender.send(line).unwrap();
        }
        let shown = || std::fs::read_dir(folder.path()).unwrap().count();
        app.update();
        assert_eq!(app.world().resource::<Supervised>().outputs().collect::<Vec<_>>(), [("left", 7)]);
        assert_eq!(app.world().resource::<Notices>().all().count(), 1);
        assert_eq!((shown(), app.should_exit()), (0, None));
        (0..SEEN).for_each(|_| app.update());
        assert_eq!((shown(), app.should_exit()), (1, None));
        drop(sender);
        app.update();
        assert_eq!(app.should_exit(), Some(AppExit::Success));
    }
}
