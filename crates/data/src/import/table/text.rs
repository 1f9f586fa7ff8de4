//! Text files, plain or compressed with gzip or Zstandard.

use crate::import::packed::Packing;
use crate::import::{HEAD, ImportError};
use std::fs::File;
use std::io::{BufRead, BufReader, Error, ErrorKind, Read};
use std::path::Path;

/// The most that a compressed table may expand by. Numbers as text shrink three to ten times; a file that expands far
/// more is no table.
pub(super) const MOST_EXPANSION: u64 = 256;

/// The beginning of a file's content from the file's first bytes, decompressed where needed.
pub(super) fn content(head: &[u8]) -> Vec<u8> {
    let Some(packing) = Packing::of(head) else { return head.to_vec() };
    let mut bytes = Vec::new();
    // The head ends in the middle of the stream, so an error after some text is no surprise.
    let _ = packing.unpacked(head).take(HEAD as u64).read_to_end(&mut bytes);
    bytes
}

/// The text of some bytes: what is not in UTF-8 is taken for Latin-1, as older programs write it.
pub(super) fn decoded(bytes: Vec<u8>) -> String {
    String::from_utf8(bytes).unwrap_or_else(|wrong| wrong.into_bytes().into_iter().map(char::from).collect())
}

/// Whether bytes that are not in UTF-8 may be text in Latin-1: few of them are no ASCII.
fn is_latin(bytes: &[u8]) -> bool {
    bytes.iter().filter(|byte| !byte.is_ascii()).count() <= bytes.len() / 8
}

/// The beginning of a text file from the file's first bytes, decompressed where needed; `None` if it is not text.
pub(in crate::import) fn head(head: &[u8]) -> Option<String> {
    let mut bytes = content(head);
    let fault = std::str::from_utf8(&bytes).err();
    match fault {
        None => {}
        // The last character may be cut in two.
        Some(error) if error.error_len().is_none() => bytes.truncate(error.valid_up_to()),
        Some(_) if is_latin(&bytes) => {}
        Some(_) => return None,
    }
    let text = decoded(bytes);
    let plain = text.chars().all(|letter| !letter.is_control() || matches!(letter, '\t' | '\r' | '\n'));
    (plain && !text.trim().is_empty()).then(|| text.trim_start_matches('\u{feff}').to_string())
}

/// Opens a text file for reading, decompressing where needed. Gives the file's size too.
pub(super) fn open(path: &Path) -> Result<(Box<dyn BufRead>, u64), ImportError> {
    let io = |source| ImportError::io(path, "file", source);
    let file = File::open(path).map_err(io)?;
    let length = file.metadata().map_err(io)?.len();
    let mut file = BufReader::new(file);
    let packing = Packing::of(file.fill_buf().map_err(io)?);
    if let Some(packing) = packing {
        let most = length.saturating_mul(MOST_EXPANSION);
        let text = Limited { inner: packing.unpacked(file), left: most };
        return Ok((Box::new(BufReader::new(text)), length));
    }
    Ok((Box::new(file), length))
}

/// Fails when more than `left` bytes come out of `inner`.
struct Limited<R> {
    inner: R,
    left: u64,
}

impl<R: Read> Read for Limited<R> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let read = self.inner.read(out)?;
        self.left = self.left.checked_sub(read as u64).ok_or_else(|| {
            Error::new(ErrorKind::InvalidData, format!("expands more than {MOST_EXPANSION} times, expected a table"))
        })?;
        Ok(read)
    }
}
