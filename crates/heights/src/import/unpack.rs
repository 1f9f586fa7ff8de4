//! Compressed samples, unpacked once: never to more bytes than are asked for, and not into memory where these are many.

use super::content::Content;
use super::raw::{Layout, RawSamples};
use deepfield_data::import::ImportError;
use deepfield_data::model::ReadFile;
use std::io::{ErrorKind, Read, Write};

/// As much as deflate can expand; what is said to be more is wrong before anything is unpacked.
const MOST_EXPANSION: u64 = 1040;

/// Up to this size they are held in memory, else in a temporary file.
const IN_MEMORY: u64 = 32 << 20;

/// The most bytes that so many compressed ones can be.
pub(super) fn expanded(packed: u64) -> u64 {
    packed.saturating_mul(MOST_EXPANSION)
}

/// What was unpacked.
pub(super) enum Unpacked {
    /// Bytes in memory.
    Memory(Vec<u8>),
    /// A file without a name.
    File(ReadFile),
}

impl Unpacked {
    /// The samples that lie in it.
    ///
    /// # Errors
    /// Where there are fewer bytes than the layout has.
    pub(super) fn samples(self, content: &Content, field: &str, layout: Layout) -> Result<RawSamples, ImportError> {
        match self {
            Unpacked::Memory(bytes) => RawSamples::in_memory(content, field, layout, bytes),
            Unpacked::File(file) => RawSamples::unpacked(content, field, layout, file),
        }
    }

    /// All bytes.
    ///
    /// # Errors
    /// Where they cannot be read back.
    pub(super) fn bytes(self, content: &Content, field: &str) -> Result<Vec<u8>, ImportError> {
        let io = |source| ImportError::io(&content.path, field, source);
        match self {
            Unpacked::Memory(bytes) => Ok(bytes),
            Unpacked::File(file) => {
                let mut bytes = vec![0; file.file().metadata().map_err(io)?.len() as usize];
                file.read_exact_at(&mut bytes, 0).map_err(io)?;
                Ok(bytes)
            }
        }
    }
}

/// Unpacks a reader to its end, which is behind exactly `bytes` bytes; `seen` gets them piece by piece. `field` names them in messages, and `asked`
/// what asks for so many.
///
/// # Errors
/// Where there are fewer or more, or they are damaged: how many bytes there are, and how many are asked for.
pub(super) fn unpacked(
    content: &Content,
    field: &str,
    mut reader: impl Read,
    bytes: u64,
    asked: &str,
    mut seen: impl FnMut(&[u8]),
) -> Result<Unpacked, ImportError> {
    let wrong = |found: String| content.malformed(field, found, format!("{bytes} ({asked})"));
    let io = |source| ImportError::io(&content.path, "temporary file", source);
    let mut memory = Vec::new();
    let mut file = if bytes > IN_MEMORY { Some(tempfile::tempfile().map_err(io)?) } else { None };
    let mut buffer = vec![0; 1 << 16];
    let mut total = 0;
    loop {
        let read = match reader.read(&mut buffer) {
            Ok(0) => break,
            Ok(read) => read,
            Err(error) if error.kind() == ErrorKind::Interrupted => continue,
            Err(error) => return Err(wrong(format!("{total} bytes and then {error}"))),
        };
        total += read as u64;
        if total > bytes {
            return Err(wrong(format!("more than {bytes} bytes")));
        }
        let piece = buffer.get(..read).unwrap_or_default();
        seen(piece);
        match &mut file {
            Some(file) => file.write_all(piece).map_err(io)?,
            None => memory.extend_from_slice(piece),
        }
    }
    if total < bytes {
        return Err(wrong(format!("{total} bytes")));
    }
    Ok(match file {
        Some(file) => Unpacked::File(ReadFile::new(file, content.options.read)),
        None => Unpacked::Memory(memory),
    })
}
