//! What is in a file, unpacked where it is compressed with gzip or Zstandard, whatever its name says.

use super::super::ImportError;
use super::super::bytes::RangeFile;
pub(super) use super::super::packed::MOST_EXPANSION;
use super::super::packed::Packing;
use super::super::unpacking::unpacked_once;
use super::part_name;
use super::scratch::{Scratch, Storage};
use crate::model::{Grid, ReadMethod};
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// The longest header of text that is looked at, bytes.
pub(super) const LONGEST_HEADER: usize = 1 << 16;

const BUFFER: usize = 1 << 18;

/// A file's content.
pub(in crate::import) struct Content {
    /// The file.
    pub path: PathBuf,
    /// What was named: the file, or an array in it.
    pub named: PathBuf,
    /// The array that was named, of a file of several.
    pub part: Option<String>,
    /// Its length as it is stored, bytes.
    pub length: u64,
    /// Whether it is compressed.
    pub is_packed: bool,
    packing: Option<Packing>,
    /// The first bytes of what is in it, at most [`LONGEST_HEADER`].
    pub head: Vec<u8>,
    method: ReadMethod,
}

impl Content {
    /// Looks into a file, which is to be read in the way `method`; an array in it may be named behind it.
    ///
    /// # Errors
    /// When it cannot be read. What of it is compressed and damaged shows as a shorter head.
    pub(in crate::import) fn open(path: &Path, method: ReadMethod) -> Result<Content, ImportError> {
        Content::glance(path, method, LONGEST_HEADER as u64)
    }

    /// The same with only so many bytes of its head.
    ///
    /// # Errors
    /// As [`Content::open`].
    pub(super) fn glance(path: &Path, method: ReadMethod, most: u64) -> Result<Content, ImportError> {
        let named = path;
        let (path, part) = part_name::parts(named);
        let io = |source| ImportError::io(path, "file", source);
        let mut file = File::open(path).map_err(io)?;
        let length = file.metadata().map_err(io)?.len();
        let mut head = Vec::new();
        (&mut file).take(most).read_to_end(&mut head).map_err(io)?;
        let packing = Packing::of(&head);
        if let Some(packing) = packing {
            head.clear();
            file.seek(SeekFrom::Start(0)).map_err(io)?;
            // A damaged file keeps what came before the damage.
            let _ = packing.unpacked(BufReader::new(file)).take(most).read_to_end(&mut head);
        }
        let (path, named, part) = (path.into(), named.into(), part.map(str::to_owned));
        Ok(Content { path, named, part, length, is_packed: packing.is_some(), packing, head, method })
    }

    /// The file that a header names as that of its samples, in the entry `field`.
    ///
    /// # Errors
    /// When it cannot be read; the message names the header.
    pub(in crate::import) fn beside(&self, field: &str, name: &str) -> Result<Content, ImportError> {
        let path = self.path.parent().unwrap_or(Path::new("")).join(name);
        let why = |why: &dyn std::fmt::Display| {
            let found = format!("{} ({})", in_one_line(&name), in_one_line(&why));
            ImportError::malformed(&self.path, field, found, "a file that can be read")
        };
        // A pipe would be waited for.
        if path.exists() && !path.is_file() {
            return Err(why(&"no file"));
        }
        Content::open(&path, self.method).map_err(|error| match error {
            ImportError::Io { source, .. } => why(&source),
            other => other,
        })
    }

    /// The file as it is stored, for who unpacks it as the header says that named it.
    pub(super) fn stored(self) -> Content {
        Content { is_packed: false, packing: None, ..self }
    }

    /// What is in the file from byte `offset` on.
    ///
    /// # Errors
    /// When it cannot be read.
    pub(in crate::import) fn reader(&self, offset: u64) -> Result<Box<dyn Read>, ImportError> {
        let io = |source| ImportError::io(&self.path, "file", source);
        let mut file = File::open(&self.path).map_err(io)?;
        let Some(packing) = self.packing else {
            file.seek(SeekFrom::Start(offset)).map_err(io)?;
            return Ok(Box::new(BufReader::with_capacity(BUFFER, file)));
        };
        let mut reader = packing.unpacked(BufReader::with_capacity(BUFFER, file));
        // Where the content ends earlier there is nothing from `offset` on.
        let _ = std::io::copy(&mut (&mut reader).take(offset), &mut std::io::sink());
        Ok(Box::new(reader))
    }

    /// The file itself, or what is in it as a temporary one without a name, which is read by offset alone.
    ///
    /// # Errors
    /// When it cannot be read, or is damaged.
    pub(in crate::import) fn file(&self) -> Result<File, ImportError> {
        unpacked_once(&self.path)
    }

    /// All of it, where that is at most `most` bytes.
    ///
    /// # Errors
    /// When it cannot be read, is damaged or longer.
    pub(super) fn whole(&self, most: u64) -> Result<Vec<u8>, ImportError> {
        let mut bytes = Vec::new();
        let read = self.reader(0)?.take(most.saturating_add(1)).read_to_end(&mut bytes);
        read.map_err(|error| ImportError::io(&self.path, "data", error))?;
        if bytes.len() as u64 > most {
            return Err(ImportError::malformed(&self.path, "content", format!("more than {most} bytes"), "less"));
        }
        Ok(bytes)
    }

    /// The most bytes that can be in the file.
    pub(in crate::import) fn most(&self) -> u64 {
        if self.is_packed { self.length.saturating_mul(MOST_EXPANSION) } else { self.length }
    }

    /// The samples of `grid` that begin at byte `offset` and fill `bytes` bytes: in place, or unpacked once.
    ///
    /// # Errors
    /// Where there are fewer, or the file cannot be read.
    pub(super) fn samples(&self, offset: u64, bytes: u64, grid: &Grid) -> Result<Storage, ImportError> {
        if self.is_packed {
            self.check_packed(self.length, bytes, grid)?;
            return filled(self.reader(offset)?, &self.path, bytes, grid);
        }
        let found = self.length.saturating_sub(offset);
        if found < bytes {
            return Err(too_few(&self.path, &format!("{found} bytes"), bytes, grid));
        }
        Ok(Storage::File(RangeFile::open(&self.path, self.method)?))
    }

    /// Whether compressed data of `packed` bytes can hold `bytes` bytes of samples.
    ///
    /// # Errors
    /// The message that it cannot.
    pub(super) fn check_packed(&self, packed: u64, bytes: u64, grid: &Grid) -> Result<(), ImportError> {
        let most = packed.saturating_mul(MOST_EXPANSION);
        if most < bytes {
            return Err(too_few(&self.path, &format!("at most {most} bytes"), bytes, grid));
        }
        Ok(())
    }

    /// How the file is read.
    pub(in crate::import) fn method(&self) -> ReadMethod {
        self.method
    }
}

/// The message that samples are missing.
pub(super) fn too_few(path: &Path, found: &str, bytes: u64, grid: &Grid) -> ImportError {
    ImportError::malformed(path, "data", found, format!("{bytes} ({})", grid.described()))
}

/// The samples of `grid`, `bytes` bytes, from a reader that unpacks them. Never more than that are written, and the reader is
/// asked for one byte more, so that a checksum behind them is checked.
///
/// # Errors
/// Where there are fewer, or they are damaged.
pub(super) fn filled(mut reader: impl Read, path: &Path, bytes: u64, grid: &Grid) -> Result<Storage, ImportError> {
    let mut scratch = Scratch::new(path);
    let mut buffer = vec![0; BUFFER];
    let mut left = bytes;
    while left > 0 {
        let most = BUFFER.min(usize::try_from(left).unwrap_or(BUFFER));
        match reader.read(&mut buffer[..most]) {
            Ok(0) => return Err(too_few(path, &format!("{} bytes", bytes - left), bytes, grid)),
            Ok(read) => {
                scratch.write(&buffer[..read])?;
                left -= read as u64;
            }
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
            Err(error) => {
                let found = format!("{} bytes and then {}", bytes - left, in_one_line(&error));
                return Err(too_few(path, &found, bytes, grid));
            }
        }
    }
    match reader.take(1).read_to_end(&mut Vec::new()) {
        Ok(_) => scratch.into_storage(),
        Err(error) => Err(ImportError::malformed(path, "data", in_one_line(&error), "what its checksum says")),
    }
}

/// A text in one line that can be shown.
pub(super) fn in_one_line(text: &impl ToString) -> String {
    text.to_string().chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}
