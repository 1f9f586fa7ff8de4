//! A text line by line, with the byte at which each begins; a compressed one is copied as it is unpacked.

use super::{Damage, Stop};
use crate::import::ImportError;
use crate::import::packed::Packing;
use std::fs::File;
use std::io::{BufRead, BufReader, BufWriter, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

/// The longest line that is read, bytes.
pub(super) const LONGEST: u64 = 1 << 20;

/// The most that a compressed text may expand by, as of tables.
const MOST_EXPANSION: u64 = 256;

const BUFFER: usize = 1 << 18;

/// The lines of a text.
pub(super) struct Lines {
    path: PathBuf,
    reader: Box<dyn BufRead>,
    /// Where an unpacked text goes.
    copy: Option<BufWriter<File>>,
    most: u64,
    line: Vec<u8>,
    /// Whether the last line has an end.
    pub is_ended: bool,
    /// The number of the first line that was too long, and of which only the beginning was given, since this was set to `None`.
    pub too_long: Option<u64>,
    is_back: bool,
    /// The byte at which the last line begins.
    pub start: u64,
    /// The byte after it.
    pub end: u64,
    /// Its number, from 1.
    pub number: u64,
}

impl Lines {
    /// The lines of a file, from its beginning.
    ///
    /// # Errors
    /// When the file cannot be opened, or a temporary file not be made.
    pub(super) fn open(path: &Path) -> Result<Lines, ImportError> {
        let io = |source| ImportError::io(path, "file", source);
        let file = File::open(path).map_err(io)?;
        let length = file.metadata().map_err(io)?.len();
        let mut file = BufReader::with_capacity(BUFFER, file);
        let packing = Packing::of(file.fill_buf().map_err(io)?);
        let (reader, copy, most): (Box<dyn BufRead>, _, _) = if let Some(packing) = packing {
            let unpacked = tempfile::tempfile().map_err(|error| ImportError::io(path, "unpacking", error))?;
            let reader = BufReader::with_capacity(BUFFER, packing.unpacked(file));
            let copy = BufWriter::with_capacity(BUFFER, unpacked);
            (Box::new(reader), Some(copy), length.saturating_mul(MOST_EXPANSION))
        } else {
            (Box::new(file), None, length)
        };
        let line = Vec::new();
        let path = path.to_owned();
        let (is_ended, is_back, too_long) = (true, false, None);
        Ok(Lines { path, reader, copy, most, line, is_ended, too_long, is_back, start: 0, end: 0, number: 0 })
    }

    /// The most bytes that the text can have.
    pub(super) fn most(&self) -> u64 {
        self.most
    }

    /// The next line without its end; `None` at the end of the text. Of one that is too long the beginning: it is noted in
    /// [`Self::too_long`], and the lines after it come as ever.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub(super) fn next(&mut self) -> Result<Option<&[u8]>, Stop> {
        if std::mem::take(&mut self.is_back) {
            return Ok(Some(trimmed(&self.line)));
        }
        self.start = self.end;
        self.number += 1;
        let mut line = std::mem::take(&mut self.line);
        line.clear();
        if self.read_part(&mut line)? {
            self.too_long = self.too_long.or(Some(self.number));
            let mut rest = Vec::new();
            while self.read_part(&mut rest)? {
                rest.clear();
            }
        }
        self.line = line;
        if self.line.is_empty() {
            self.is_ended = true;
            return Ok(None);
        }
        Ok(Some(trimmed(&self.line)))
    }

    /// Appends bytes up to the end of the line, at most [`LONGEST`]. Whether there is more of the line.
    fn read_part(&mut self, line: &mut Vec<u8>) -> Result<bool, Stop> {
        let from = line.len();
        let read = self.reader.by_ref().take(LONGEST).read_until(b'\n', line);
        let part = &line[from..];
        self.end += part.len() as u64;
        self.is_ended = part.ends_with(b"\n");
        if let Some(copy) = &mut self.copy {
            copy.write_all(part).map_err(|error| ImportError::io(&self.path, "unpacking", error))?;
        }
        let field = || format!("line {}", self.number);
        match read {
            Ok(_) => {}
            // A compressed file that ends too early, or is no such file.
            Err(error) if self.copy.is_some() && is_content(error.kind()) => {
                return Err(Damage::new(field(), error.to_string(), "more of the compressed text").into());
            }
            Err(error) => return Err(ImportError::io(&self.path, field(), error).into()),
        }
        if self.copy.is_some() && self.end > self.most {
            let found = format!("text that expands more than {MOST_EXPANSION} times");
            return Err(Stop::Unreadable(ImportError::malformed(&self.path, field(), found, "a trajectory")));
        }
        Ok(part.len() as u64 == LONGEST && !self.is_ended)
    }

    /// The last line comes again.
    pub(super) fn back(&mut self) {
        self.is_back = true;
    }

    /// The unpacked text, if the file was compressed.
    ///
    /// # Errors
    /// When it cannot be written.
    pub(super) fn into_copy(self) -> Result<Option<File>, ImportError> {
        let Lines { path, copy, .. } = self;
        let file = copy.map(|copy| copy.into_inner().map_err(|error| error.into_error())).transpose();
        file.map_err(|error| ImportError::io(&path, "unpacking", error))
    }
}

/// Whether an error says that the content is wrong, not the disk.
fn is_content(kind: ErrorKind) -> bool {
    matches!(kind, ErrorKind::UnexpectedEof | ErrorKind::InvalidData | ErrorKind::InvalidInput)
}

fn trimmed(line: &[u8]) -> &[u8] {
    let line = line.strip_suffix(b"\n").unwrap_or(line);
    line.strip_suffix(b"\r").unwrap_or(line)
}
