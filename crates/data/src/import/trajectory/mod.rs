//! Trajectories: files with one frame or many.
//!
//! Frames of text are a count of rows and the rows. What differs from format to format is what stands before the rows ([`Text`]);
//! finding the frames ([`index`]) and reading rows by range ([`frame`]) is shared. A file is read once from its beginning to its end,
//! which gives the [`index::Index`]: where each frame and every so many rows begin. Compressed files are unpacked into a temporary
//! file without a name while that is done. Files of [`gsd`] are binary and have an index of their own.

mod cell;
mod columns;
mod elements;
mod frame;
mod gsd;
mod index;
mod known;
mod lammps;
mod lines;
mod row;
mod species;
mod xyz;
mod xyz_comment;

pub(super) use gsd::Gsd;
pub(super) use lammps::LammpsDump;
pub(super) use xyz::Xyz;

use super::{Format, ImportError, Source};
use crate::model::ReadMethod;
use cell::Cell;
use columns::Layout;
use lines::Lines;
use std::path::Path;
use std::sync::Arc;

/// A format of text with frames: what stands before a frame's rows.
trait Text: Sync {
    /// The format's name in `info`.
    fn name(&self) -> &'static str;

    /// Its name in messages.
    fn title(&self) -> &'static str;

    /// How its files usually end, without the dot.
    fn endings(&self) -> &'static [&'static str];

    /// Whether a file that begins so claims to be of this format.
    fn recognise(&self, head: &[u8]) -> bool;

    /// Reads what stands before the rows of the next frame; `None` at the end of the text. `before` is the last frame's layout,
    /// which this one's mostly is, too.
    ///
    /// # Errors
    /// What is wrong with this frame, or that the file cannot be read at all.
    fn head(&self, lines: &mut Lines, before: Option<&Arc<Layout>>) -> Result<Option<Head>, Stop>;

    /// Whether a line begins a frame, so that rows that are still missing when it comes are lost.
    fn begins(&self, _line: &[u8]) -> bool {
        false
    }

    /// Whether particles without ids stand in the same order in every frame.
    fn keeps_rows(&self) -> bool;
}

impl<T: Text> Format for T {
    fn name(&self) -> &'static str {
        self.title()
    }

    fn extensions(&self) -> &'static [&'static str] {
        self.endings()
    }

    fn recognise(&self, head: &[u8], _length: u64) -> bool {
        Text::recognise(self, head)
    }

    fn open(&self, path: &Path, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        frame::open(path, self, None, method)
    }

    fn steps(&self, path: &Path) -> Result<u64, ImportError> {
        frame::count(path, self)
    }

    fn open_step(&self, path: &Path, step: u64, method: ReadMethod) -> Result<Box<dyn Source>, ImportError> {
        frame::open(path, self, Some(step), method)
    }
}

/// What stands before the rows of a frame.
struct Head {
    /// How many rows follow.
    count: u64,
    /// What they hold.
    layout: Arc<Layout>,
    /// The time that is stated.
    time: Option<f64>,
    /// The number of the time step that is stated.
    number: Option<f64>,
    /// The cell that particles lie in.
    cell: Option<Cell>,
}

/// What is wrong with one frame.
#[derive(Clone, Debug, PartialEq)]
struct Damage {
    /// The line, or what is in it.
    field: String,
    found: String,
    expected: String,
}

impl Damage {
    fn new(field: impl Into<String>, found: impl Into<String>, expected: impl Into<String>) -> Damage {
        Damage { field: field.into(), found: found.into(), expected: expected.into() }
    }

    /// As the error of frame `number` of a file.
    fn error(&self, path: &Path, number: usize) -> ImportError {
        let field = format!("frame {number}: {}", self.field);
        ImportError::malformed(path, field, &self.found, &*self.expected)
    }
}

/// Why a frame could not be looked through.
enum Stop {
    /// It is damaged.
    Damaged(Damage),
    /// The file cannot be read.
    Unreadable(ImportError),
}

impl From<Damage> for Stop {
    fn from(damage: Damage) -> Stop {
        Stop::Damaged(damage)
    }
}

impl From<ImportError> for Stop {
    fn from(error: ImportError) -> Stop {
        Stop::Unreadable(error)
    }
}

/// What to tell where the first of several steps was opened; `is_named`: because it was named.
fn first_of(steps: u64, is_named: bool) -> Option<String> {
    let last = steps.saturating_sub(1);
    (last > 0 && !is_named)
        .then(|| format!("{steps} steps are in this file; this is the first, #0 to #{last} behind its name is any"))
}

/// Text as it stands in a message: short, and without control characters.
fn quoted(text: &[u8]) -> String {
    let text = String::from_utf8_lossy(&text[..text.len().min(160)]);
    let shown: String = text.chars().map(|letter| if letter.is_control() { ' ' } else { letter }).take(40).collect();
    format!("{:?}", shown.trim())
}
