//! Where the frames of a trajectory lie: found in one pass from the beginning of the file to its end.

use super::cell::{Cell, Cells};
use super::columns::Layout;
use super::lines::{LONGEST, Lines};
use super::row::words;
use super::species::{Labels, Species};
use super::{Damage, Head, Stop, Text};
use crate::import::ImportError;
use std::fs::File;
use std::path::Path;
use std::sync::Arc;

/// Rows that are read at a time; it is known where each so many begin.
pub(super) const BLOCK: u64 = 1 << 14;

/// The most frames of a short file, and how many bytes each further one has at least.
pub(super) const MOST_FRAMES: u64 = 1 << 17;
const BYTES_OF_FRAME: u64 = 128;

/// A frame.
#[derive(Clone, Debug)]
pub(super) struct Frame {
    /// The byte at which it begins.
    pub start: u64,
    /// The bytes at which its blocks of [`BLOCK`] rows begin, and that after the last row.
    pub blocks: Vec<u64>,
    /// How many rows it has.
    pub count: u64,
    /// The number of the line of its first row, from 1.
    pub line: u64,
    /// What its rows hold.
    pub layout: Arc<Layout>,
    /// The time that it states.
    pub time: Option<f64>,
    /// The number of its time step.
    pub step: Option<f64>,
    /// Its cell.
    pub cell: Option<Cell>,
}

/// What the times of the frames of a file are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TimeOf {
    /// Times that they state.
    Stated,
    /// The numbers of their time steps.
    Step,
    /// Their own numbers.
    Frame,
    /// There is one frame, which states none.
    Nothing,
}

impl TimeOf {
    /// What to tell of it.
    pub(super) fn note(self) -> Option<&'static str> {
        match self {
            TimeOf::Step => Some("the number of the time step is taken for the time"),
            TimeOf::Frame => Some("frames state no time: their numbers are taken"),
            TimeOf::Stated | TimeOf::Nothing => None,
        }
    }
}

/// The frames of a file.
#[derive(Debug)]
pub(super) struct Index {
    /// Length of the file on disk.
    pub bytes: u64,
    /// The unpacked text of a compressed file.
    pub unpacked: Option<File>,
    /// The frames in their order; of one that is damaged, what is wrong.
    pub frames: Vec<Result<Frame, Damage>>,
    /// The names of kinds of particles.
    pub species: Species,
    /// What their cells are together.
    pub cells: Cells,
    /// What their times are.
    pub time_of: TimeOf,
}

impl Index {
    /// Reads the file once.
    ///
    /// # Errors
    /// When it cannot be read, or has no frame.
    pub(super) fn of(path: &Path, bytes: u64, text: &dyn Text) -> Result<Index, ImportError> {
        let mut lines = Lines::open(path)?;
        let mut scan = Scan { labels: Labels::default(), layout: None };
        let mut frames: Vec<Result<Frame, Damage>> = Vec::new();
        loop {
            // Frames take memory, and a file of nothing else might fill it.
            if frames.len() as u64 > MOST_FRAMES + lines.end / BYTES_OF_FRAME {
                let found = format!("{} in {} bytes", frames.len(), lines.end);
                return Err(ImportError::malformed(path, "frames", found, "fewer, with more in them"));
            }
            lines.too_long = None;
            let frame = scan.frame(&mut lines, text);
            let too_long = lines.too_long.map(|line| {
                Damage::new(format!("line {line}"), format!("more than {LONGEST} bytes"), "a shorter line")
            });
            match frame {
                Ok(None) => break,
                // All of its lines were counted, so the next frame is where it should be.
                Ok(Some(frame)) => frames.push(too_long.map_or(Ok(frame), Err)),
                Err(Stop::Unreadable(error)) => return Err(error),
                Err(Stop::Damaged(damage)) => {
                    frames.push(Err(too_long.unwrap_or(damage)));
                    if !next_begin(&mut lines, text)? {
                        break;
                    }
                }
            }
        }
        if frames.is_empty() {
            return Err(ImportError::malformed(path, "frames", "none", format!("a frame of {}", text.name())));
        }
        let good = || frames.iter().flatten();
        let cells =
            good().enumerate().fold(Cells::Open, |cells, (number, frame)| cells.with(number == 0, frame.cell.as_ref()));
        let time_of = if good().all(|frame| frame.time.is_some()) {
            TimeOf::Stated
        } else if good().all(|frame| frame.step.is_some()) {
            TimeOf::Step
        } else if frames.len() > 1 {
            TimeOf::Frame
        } else {
            TimeOf::Nothing
        };
        let unpacked = lines.into_copy()?;
        Ok(Index { bytes, unpacked, frames, species: scan.labels.species(), cells, time_of })
    }

    /// The time of a frame.
    pub(super) fn time(&self, number: usize) -> Option<f64> {
        let frame = self.frames.get(number)?.as_ref().ok()?;
        match self.time_of {
            TimeOf::Stated => frame.time,
            TimeOf::Step => frame.step,
            TimeOf::Frame => Some(number as f64),
            TimeOf::Nothing => None,
        }
    }

    /// Roughly how much memory it takes, in words.
    pub(super) fn weight(&self) -> usize {
        let frame = |frame: &Result<Frame, Damage>| 32 + frame.as_ref().map_or(16, |frame| frame.blocks.len());
        64 + self.frames.iter().map(frame).sum::<usize>()
    }
}

/// What is known so far.
struct Scan {
    labels: Labels,
    /// Of the frame before.
    layout: Option<Arc<Layout>>,
}

impl Scan {
    /// Looks through the next frame.
    fn frame(&mut self, lines: &mut Lines, text: &dyn Text) -> Result<Option<Frame>, Stop> {
        let before = lines.end;
        let Some(Head { count, layout, time, number, cell }) = text.head(lines, self.layout.as_ref())? else {
            return Ok(None);
        };
        self.layout = Some(Arc::clone(&layout));
        let start = before;
        let line = lines.number + 1;
        let mut blocks = vec![lines.end];
        let cut = |row: u64| Damage::new("rows", format!("the end after {row}"), format!("{count} rows"));
        // No row is shorter than a byte and the end of its line.
        if count > lines.most() {
            return Err(Damage::new("rows", count.to_string(), "as many as the file can hold").into());
        }
        for row in 0..count {
            if row > 0 && row % BLOCK == 0 {
                blocks.push(lines.end);
            }
            let Some(words_of) = lines.next()? else { return Err(cut(row).into()) };
            if text.begins(words_of) {
                lines.back();
                return Err(cut(row).into());
            }
            if let Some(label) = layout.label
                && let Some(word) = words(words_of).nth(label)
            {
                self.labels.add(word);
            }
            // The line in which a file ends may have been cut.
            let is_whole = words(words_of).nth(layout.words.len() - 1).is_some();
            if row + 1 == count && !lines.is_ended && !is_whole {
                return Err(cut(row).into());
            }
        }
        blocks.push(lines.end);
        Ok(Some(Frame { start, blocks, count, line, layout, time, step: number, cell }))
    }
}

/// Goes on to the next line that begins a frame; `false` where the format does not show one, or there is none.
fn next_begin(lines: &mut Lines, text: &dyn Text) -> Result<bool, ImportError> {
    loop {
        match lines.next() {
            Ok(Some(line)) if text.begins(line) => {
                lines.back();
                return Ok(true);
            }
            Ok(Some(_)) => {}
            Ok(None) | Err(Stop::Damaged(_)) => return Ok(false),
            Err(Stop::Unreadable(error)) => return Err(error),
        }
    }
}
