//! What is in a file: its beginning, and the rest by offset.

use super::HeightOptions;
use deepfield_data::import::ImportError;
use deepfield_data::model::ReadFile;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The most of a file's beginning that is looked at, bytes.
pub(super) const LONGEST_HEAD: usize = 1 << 16;

/// A file's content.
pub(super) struct Content {
    /// The file.
    pub path: PathBuf,
    /// Its length, bytes.
    pub length: u64,
    /// Its first bytes, at most [`LONGEST_HEAD`].
    pub head: Vec<u8>,
    /// How it is opened.
    pub options: HeightOptions,
    file: Arc<ReadFile>,
}

impl Content {
    /// Looks into a file.
    ///
    /// # Errors
    /// When it cannot be read, or is none.
    pub(super) fn open(path: &Path, options: &HeightOptions) -> Result<Content, ImportError> {
        let io = |source| ImportError::io(path, "file", source);
        // A pipe would be waited for.
        if !std::fs::metadata(path).map_err(io)?.is_file() {
            return Err(ImportError::malformed(path, "file", "a folder or a pipe", "a file"));
        }
        let mut file = File::open(path).map_err(io)?;
        let length = file.metadata().map_err(io)?.len();
        let mut head = Vec::new();
        (&mut file).take(LONGEST_HEAD as u64).read_to_end(&mut head).map_err(io)?;
        let file = Arc::new(ReadFile::new(file, options.read));
        Ok(Content { path: path.into(), length, head, options: options.clone(), file })
    }

    /// A file beside this one, of the same name with another ending.
    ///
    /// # Errors
    /// When it cannot be read.
    pub(super) fn beside(&self, extension: &str) -> Result<Content, ImportError> {
        Content::open(&self.path.with_extension(extension), &self.options)
    }

    /// The file, to be read by offset by several threads at once.
    pub(super) fn file(&self) -> Arc<ReadFile> {
        self.file.clone()
    }

    /// The file once more, from its start on, for libraries that read one after the other.
    ///
    /// # Errors
    /// When it cannot be opened.
    pub(super) fn reopened(&self) -> Result<File, ImportError> {
        File::open(&self.path).map_err(|source| ImportError::io(&self.path, "file", source))
    }

    /// Fills `out` from byte `offset` on; `field` names what is there.
    ///
    /// # Errors
    /// Where the file ends before, or cannot be read.
    pub(super) fn read(&self, field: &str, offset: u64, out: &mut [u8]) -> Result<(), ImportError> {
        self.check(field, offset, out.len() as u64)?;
        self.file.read_exact_at(out, offset).map_err(|source| ImportError::io(&self.path, field, source))
    }

    /// So many bytes from byte `offset` on, which are allocated once the file is known to hold them.
    ///
    /// # Errors
    /// As [`Content::read`].
    pub(super) fn bytes(&self, field: &str, offset: u64, count: u64) -> Result<Vec<u8>, ImportError> {
        self.check(field, offset, count)?;
        let mut out = vec![0; count as usize];
        self.read(field, offset, &mut out)?;
        Ok(out)
    }

    /// Whether the file holds so many bytes from byte `offset` on.
    ///
    /// # Errors
    /// The message that it does not.
    pub(super) fn check(&self, field: &str, offset: u64, count: u64) -> Result<(), ImportError> {
        if offset.checked_add(count).is_some_and(|end| end <= self.length) {
            return Ok(());
        }
        let found = format!("{} bytes from byte {offset} on", self.length.saturating_sub(offset));
        Err(self.malformed(field, found, format!("{count}")))
    }

    /// Whether the name ends so, in any case.
    pub(super) fn has_extension(&self, extension: &str) -> bool {
        self.path.extension().is_some_and(|own| own.eq_ignore_ascii_case(extension))
    }

    /// The message that `field` holds what it should not, in one line.
    pub(super) fn malformed(&self, field: &str, found: impl ToString, expected: impl Into<String>) -> ImportError {
        ImportError::malformed(&self.path, in_one_line(&field), in_one_line(&found), in_one_line(&expected.into()))
    }

    /// The message that `field` is not there.
    pub(super) fn missing(&self, field: &str, expected: &str) -> ImportError {
        ImportError::missing(&self.path, in_one_line(&field), in_one_line(&expected))
    }
}

/// A text in one line that can be shown, at most some hundred letters of it.
pub(super) fn in_one_line(text: &impl ToString) -> String {
    let text = text.to_string();
    let mut shown: String = text.chars().take(300).map(|c| if c.is_control() { ' ' } else { c }).collect();
    if shown.len() < text.len() && text.chars().count() > 300 {
        shown.push_str("...");
    }
    shown
}

/// Latin-1 bytes up to the first 0, without blanks around.
pub(super) fn latin1(bytes: &[u8]) -> String {
    let text: String = bytes.iter().take_while(|byte| **byte != 0).map(|byte| char::from(*byte)).collect();
    text.trim().to_owned()
}

/// The `N` bytes at `at`; zeros past the end, which callers exclude.
pub(super) fn word<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    bytes.get(at..).and_then(|rest| rest.first_chunk()).copied().unwrap_or([0; N])
}
