//! Keeps the windows of a show open on this machine: each is a process of its own, which is started again when it fails.
//!
//! The program that a presenter starts opens no window itself and draws nothing, so that there is little in it that can fail. It starts
//! itself again for the window that was asked for and for those of the outputs, and looks after them ([`post`]). Where the first
//! window cannot even be opened, that is all; once it has drawn, it is kept open until it is closed, with whatever driver, adapter or
//! memory it fails, and all others end with it. What a window should know comes to it through its standard input ([`mod@line`]); when that
//! ends, the window ends, so that none is left behind. What the windows leave for those that come after them lies in a
//! [`RunFolder`].

pub mod line;
mod post;

pub use line::Line;

use post::{End, Post};
use std::ffi::OsString;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

/// How often it is looked whether a window has ended.
const LOOK: Duration = Duration::from_millis(50);
/// After so many failures of windows that have drawn, soon and one after the other, a window does not go on where the last one was: that
/// may be what it fails with. One that has not drawn fails with something else, as while there is no adapter.
const STUBBORN: u32 = 3;
/// The hidden option of `deepfield view` that names the [`RunFolder`].
pub const OPTION: &str = "--supervised";

/// A folder that only this user reads, with what the processes of one run leave for each other.
#[derive(Clone, Debug)]
pub struct RunFolder(PathBuf);

impl RunFolder {
    /// The one at a path.
    pub fn at(path: &Path) -> RunFolder {
        RunFolder(path.to_owned())
    }

    /// The show's key; not there without a show.
    pub fn key(&self) -> PathBuf {
        self.0.join("key")
    }

    /// What the window goes on from; not there before it has shown anything.
    pub fn state(&self) -> PathBuf {
        self.0.join("state.ron")
    }

    /// The scene that goes with it.
    pub fn scene(&self) -> PathBuf {
        self.0.join("state.scene.ron")
    }

    fn address(&self) -> PathBuf {
        self.0.join("address")
    }

    fn shown(&self) -> PathBuf {
        self.0.join("shown")
    }

    /// Says where the window leads the show, so that one that is opened again leads it there, too.
    ///
    /// # Errors
    /// When the folder cannot be written.
    pub fn set_address(&self, address: SocketAddr) -> std::io::Result<()> {
        std::fs::write(self.address(), address.to_string())
    }

    /// Where the window leads the show.
    pub fn leads_at(&self) -> Option<SocketAddr> {
        std::fs::read_to_string(self.address()).ok()?.parse().ok()
    }

    /// Says that the window has drawn.
    ///
    /// # Errors
    /// When the folder cannot be written.
    pub fn set_shown(&self) -> std::io::Result<()> {
        std::fs::write(self.shown(), "")
    }
}

/// What is kept open.
#[derive(Debug)]
pub struct ShowPlan {
    /// This program.
    pub program: PathBuf,
    /// The arguments of the window that was asked for.
    pub window: Vec<OsString>,
    /// The windows beside it: their names and arguments.
    pub outputs: Vec<(String, Vec<OsString>)>,
    /// What the processes leave for each other.
    pub folder: RunFolder,
}

impl ShowPlan {
    fn command(&self, arguments: &[OsString]) -> Command {
        let mut command = Command::new(&self.program);
        command.args(arguments).arg(OPTION).arg(&self.folder.0);
        command
    }

    /// Keeps the windows open until the first one is closed, or cannot be opened. Its exit code.
    ///
    /// # Errors
    /// When the program cannot be started.
    pub fn carry_out(&self) -> std::io::Result<i32> {
        let (mut window, mut has_shown, mut spoiled) = (Post::new("the window"), false, 0);
        let mut outputs: Vec<Post> = self.outputs.iter().map(|(name, _)| Post::new(name)).collect();
        let mut news: Vec<Line> = Vec::new();
        loop {
            let shows = self.folder.shown().exists();
            has_shown = has_shown || shows;
            match window.look() {
                Some(end) if end.is_success() || !has_shown => {
                    end_all(outputs);
                    return Ok(end.code());
                }
                Some(end) => {
                    if shows {
                        spoiled = if window.failures() > 1 { spoiled + 1 } else { 1 };
                    }
                    news.push(Line::Said(self.lose(&end, spoiled >= STUBBORN)));
                }
                None => {}
            }
            if window.is_due() {
                // There is none before the first time.
                let _ = std::fs::remove_file(self.folder.shown());
                match window.start(self.command(&self.window)) {
                    Ok(()) => {
                        // A new window knows nothing.
                        for post in &outputs {
                            window.say(&Line::Output { name: post.name.clone(), process: post.process() });
                        }
                        news.drain(..).for_each(|line| window.say(&line));
                    }
                    Err(error) if !has_shown => return Err(error),
                    Err(error) => eprintln!("deepfield: the window cannot be opened: {error}"),
                }
            }
            if has_shown {
                for (post, (_, arguments)) in outputs.iter_mut().zip(&self.outputs) {
                    news.extend(self.keep_open(post, arguments));
                }
                if window.process().is_some() {
                    news.drain(..).for_each(|line| window.say(&line));
                }
            }
            std::thread::sleep(LOOK);
        }
    }

    /// What is to be said when the window has failed; `anew`: the next one begins anew.
    fn lose(&self, end: &End, anew: bool) -> String {
        eprintln!("deepfield: the window has failed ({end}) and is opened again");
        let mut text = format!("this window has failed ({end}) and was opened again");
        if anew && std::fs::remove_file(self.folder.state()).is_ok() {
            text.push_str(", from the beginning: it failed again with what was shown");
        }
        text
    }

    /// Looks after the window of an output. What the presenter should know.
    fn keep_open(&self, post: &mut Post, arguments: &[OsString]) -> Vec<Line> {
        let mut news = Vec::new();
        let name = post.name.clone();
        if let Some(end) = post.look() {
            news.push(Line::Output { name: name.clone(), process: None });
            news.push(Line::Said(format!("{name}: its window has ended ({end}) and is opened again")));
        }
        if post.is_due() {
            match post.start(self.command(arguments)) {
                Ok(()) => news.push(Line::Output { name, process: post.process() }),
                Err(error) => news.push(Line::Said(format!("{name}: its window cannot be opened: {error}"))),
            }
        }
        news
    }
}

/// Ends the windows: by asking them, and by force where they do not hear.
fn end_all(mut posts: Vec<Post>) {
    posts.iter_mut().for_each(Post::ask_to_end);
    let asked = Instant::now();
    while asked.elapsed() < line::GRACE
        && posts.iter_mut().any(|post| post.look().is_none() && post.process().is_some())
    {
        std::thread::sleep(LOOK);
    }
    // Dropping the processes ends them.
}

#[cfg(all(test, unix))]
#[allow(clippy::unwrap_used, reason = "a failed helper fails its test")]
mod tests {
    use super::*;

    /// A program of a line of shell, which gets the run folder as `$2`.
    fn shell(script: &str) -> Vec<OsString> {
        ["-c", script, "sh"].map(OsString::from).to_vec()
    }

    fn plan(folder: &Path, window: &str, outputs: &[(&str, &str)]) -> ShowPlan {
        let outputs = outputs.iter().map(|(name, script)| ((*name).to_owned(), shell(script))).collect();
        ShowPlan { program: "/bin/sh".into(), window: shell(window), outputs, folder: RunFolder::at(folder) }
    }

    #[test]
    fn a_window_that_cannot_be_opened_is_not_tried_again() {
        let folder = tempfile::tempdir().unwrap();
        let plan = plan(folder.path(), "echo x >> \"$2/starts\"; exit 3", &[("left", "touch \"$2/left\"")]);
        assert_eq!(plan.carry_out().unwrap(), 3);
        assert_eq!(std::fs::read_to_string(folder.path().join("starts")).unwrap(), "x\n");
        assert!(!folder.path().join("left").exists(), "its outputs are not opened");
        let missing = ShowPlan { program: "/no/such/program".into(), ..plan };
        assert!(missing.carry_out().is_err());
    }

    #[test]
    fn a_window_that_fails_is_opened_again_and_told_why_and_outputs_stay() {
        let folder = tempfile::tempdir().unwrap();
        // It fails three times, as hard as it can, then keeps the lines that it hears until it has heard why, and is closed.
        let window = r#"echo x >> "$2/starts"; ls "$2/state.ron" >> "$2/states" 2>&1; touch "$2/shown" "$2/state.ron"
            if [ $(wc -l < "$2/starts") -lt 4 ]; then while [ ! -s "$2/left" ]; do sleep 0.02; done; kill -9 $$; fi
            while read line; do echo "$line" >> "$2/heard"; case "$line" in *failed*) break;; esac; done"#;
        // An output ends when its line does.
        let output = r#"echo $$ >> "$2/left"; cat > /dev/null; echo over > "$2/over""#;
        let plan = plan(folder.path(), window, &[("left", output)]);
        assert_eq!(plan.carry_out().unwrap(), 0);
        let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap_or_default();
        assert_eq!(read("starts").lines().count(), 4);
        assert_eq!(read("left").lines().count(), 1, "the output was never lost");
        assert_eq!(read("over"), "over\n", "it has ended with the window");
        let heard: Vec<Line> = read("heard").lines().filter_map(Line::decode).collect();
        let process: u32 = read("left").trim().parse().unwrap();
        assert!(heard.contains(&Line::Output { name: "left".into(), process: Some(process) }), "{heard:?}");
        assert!(heard.iter().any(|line| matches!(line, Line::Said(text) if text.contains("9"))), "{heard:?}");
        let went_on: Vec<bool> = read("states").lines().map(|line| !line.contains(':')).collect();
        assert_eq!(
            went_on,
            [false, true, true, false],
            "it goes on where it was until it has failed too often with that"
        );
    }

    #[test]
    fn a_window_that_cannot_draw_for_a_while_goes_on_where_it_was() {
        let folder = tempfile::tempdir().unwrap();
        // Once it has drawn, its adapter is gone for four attempts.
        let window = r#"echo x >> "$2/starts"; ls "$2/state.ron" >> "$2/states" 2>&1; starts=$(wc -l < "$2/starts")
            if [ $starts -eq 1 ]; then touch "$2/shown" "$2/state.ron"; sleep 0.2; fi
            if [ $starts -lt 5 ]; then exit 101; fi"#;
        assert_eq!(plan(folder.path(), window, &[]).carry_out().unwrap(), 0);
        let states = std::fs::read_to_string(folder.path().join("states")).unwrap();
        let went_on = states.lines().filter(|line| line.ends_with("state.ron") && !line.contains(':')).count();
        assert_eq!(went_on, 4, "{states}");
    }

    #[test]
    fn an_output_that_ends_is_opened_again_and_the_window_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let window = r#"touch "$2/shown"; while read line; do echo "$line" >> "$2/heard"; done &
            while [ $(cat "$2/left" 2> /dev/null | wc -l) -lt 2 ]; do sleep 0.02; done; sleep 0.2"#;
        let output = r#"echo x >> "$2/left"; if [ $(wc -l < "$2/left") -lt 2 ]; then exit 7; fi; cat > /dev/null"#;
        // A shell's jobs in the background hear nothing; this one asks for its line.
        let window = window.replace("while read line", "exec 3<&0; while read line").replace("done &", "done <&3 &");
        let plan = plan(folder.path(), &window, &[("left", output)]);
        assert_eq!(plan.carry_out().unwrap(), 0);
        let heard = std::fs::read_to_string(folder.path().join("heard")).unwrap();
        let said = |line: &str| matches!(Line::decode(line), Some(Line::Said(text)) if text.contains("left") && text.contains('7'));
        assert!(heard.lines().any(said), "{heard}");
    }

    #[test]
    fn a_window_finds_where_it_leads() {
        let folder = tempfile::tempdir().unwrap();
        let folder = RunFolder::at(folder.path());
        assert_eq!(folder.leads_at(), None);
        let address = "127.0.0.1:4711".parse().unwrap();
        folder.set_address(address).unwrap();
        assert_eq!(folder.leads_at(), Some(address));
    }
}
