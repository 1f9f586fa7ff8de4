//! What a window hears from the process that keeps it open, on its standard input: a line of RON each.

use serde::{Deserialize, Serialize};
use std::io::BufRead;
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

/// Time in which a window ends that is asked to; then it is ended by force.
pub const GRACE: Duration = Duration::from_secs(3);

/// Something that a window should know.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Line {
    /// Something has failed: a sentence.
    Said(String),
    /// The window of an output has been opened, or is not there.
    Output {
        /// What the output is called.
        name: String,
        /// The number of its process.
        process: Option<u32>,
    },
}

impl Line {
    /// The line, with its end.
    pub fn encode(&self) -> Option<String> {
        let text = ron::to_string(self).ok()?;
        Some(text + "\n")
    }

    /// What a line says.
    pub fn decode(line: &str) -> Option<Line> {
        ron::from_str(line.trim()).ok()
    }
}

/// Hears lines on a thread of its own, and then nothing any more; `over` is called after [`GRACE`], for a window that does not end by
/// itself.
pub fn hear(input: impl BufRead + Send + 'static, over: impl FnOnce() + Send + 'static) -> Receiver<Line> {
    let (sender, receiver) = channel();
    std::thread::spawn(move || {
        for line in input.lines().map_while(Result::ok) {
            if let Some(line) = Line::decode(&line)
                && sender.send(line).is_err()
            {
                break;
            }
        }
        drop(sender);
        std::thread::sleep(GRACE);
        over();
    });
    receiver
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_come_as_they_were_said_until_they_end() {
        let lines = [
            Line::Said("left: its window has ended\n(\"signal: 9\") \u{fc}".into()),
            Line::Output { name: "left".into(), process: Some(7) },
            Line::Output { name: "a \"b\"".into(), process: None },
        ];
        let mut text: String = lines.iter().filter_map(Line::encode).collect();
        assert_eq!(text.lines().count(), 3);
        text.insert_str(0, "no line\n(((\n");
        let heard: Vec<Line> = hear(std::io::Cursor::new(text), || {}).iter().collect();
        assert_eq!(heard, lines);
    }
}
