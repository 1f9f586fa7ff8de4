//! ZIP archives: their entries are unpacked once, never to more bytes than are asked for.

use super::content::{Content, in_one_line};
use super::unpack::{Unpacked, expanded, unpacked};
use deepfield_data::import::ImportError;
use std::fs::File;
use std::io::{BufReader, Read};
use zip::ZipArchive;
use zip::result::ZipError;

/// The archive that a file is.
pub(super) struct Archive<'c> {
    content: &'c Content,
    zip: ZipArchive<BufReader<File>>,
}

impl<'c> Archive<'c> {
    /// Opens it.
    ///
    /// # Errors
    /// When it cannot be read, or is damaged.
    pub(super) fn open(content: &'c Content) -> Result<Archive<'c>, ImportError> {
        let zip = ZipArchive::new(BufReader::new(content.reopened()?)).map_err(|error| wrong(content, &error))?;
        Ok(Archive { content, zip })
    }

    /// The names of its entries in one line each, in the order of the archive's directory.
    pub(super) fn names(&self) -> impl Iterator<Item = String> {
        let shown = |name: Result<std::borrow::Cow<str>, ZipError>| {
            name.map_or_else(|_| "?".to_owned(), |name| in_one_line(&name))
        };
        self.zip.file_names().map(shown)
    }

    /// The number of the entry that is called so, whatever the case, slashes or backslashes are.
    pub(super) fn named(&self, name: &str) -> Option<usize> {
        let plain = |name: &str| name.replace('\\', "/").trim_start_matches("./").to_lowercase();
        let asked = plain(name);
        self.names().position(|own| plain(&own) == asked)
    }

    /// The same.
    ///
    /// # Errors
    /// Where there is none that is called so.
    pub(super) fn found(&self, name: &str) -> Result<usize, ImportError> {
        let some: Vec<String> = self.names().take(8).collect();
        self.named(name)
            .ok_or_else(|| self.content.missing(name, &format!("an entry of the archive ({})", some.join(", "))))
    }

    /// What an entry begins with, at most `most` bytes. What is damaged shows when all of it is read.
    ///
    /// # Errors
    /// Where it is missing.
    pub(super) fn beginning(&mut self, name: &str, most: u64) -> Result<Vec<u8>, ImportError> {
        let content = self.content;
        let entry = self.found(name)?;
        let entry = self.zip.by_index(entry).map_err(|error| wrong(content, &error))?;
        let mut bytes = Vec::new();
        let _ = entry.take(most).read_to_end(&mut bytes);
        Ok(bytes)
    }

    /// An entry of at most `most` bytes.
    ///
    /// # Errors
    /// Where it is missing, larger, or damaged.
    pub(super) fn whole(&mut self, name: &str, most: u64) -> Result<Vec<u8>, ImportError> {
        let content = self.content;
        let entry = self.found(name)?;
        let entry = self.zip.by_index(entry).map_err(|error| wrong(content, &error))?;
        let mut bytes = Vec::new();
        let read = entry.take(most + 1).read_to_end(&mut bytes);
        read.map_err(|error| content.malformed(name, &error, "what its checksum says"))?;
        if bytes.len() as u64 > most {
            return Err(content.malformed(name, format!("more than {most} bytes"), "less"));
        }
        Ok(bytes)
    }

    /// An entry of exactly `bytes` bytes; `seen` gets them piece by piece.
    ///
    /// # Errors
    /// Where it is missing, damaged, shorter or longer: how many bytes there are, and how many `asked` asks for.
    pub(super) fn unpack(
        &mut self,
        name: &str,
        bytes: u64,
        asked: &str,
        mut seen: impl FnMut(&[u8]),
    ) -> Result<Unpacked, ImportError> {
        let content = self.content;
        let entry = self.found(name)?;
        let mut entry = self.zip.by_index(entry).map_err(|error| wrong(content, &error))?;
        let stated = entry.size();
        let expected = || format!("{bytes} ({asked})");
        if stated != bytes {
            return Err(content.malformed(name, format!("{stated} bytes"), expected()));
        }
        let most = expanded(entry.compressed_size().min(content.length));
        if most < bytes {
            return Err(content.malformed(name, format!("at most {most} bytes"), expected()));
        }
        unpacked(content, name, &mut entry, bytes, asked, &mut seen)
    }
}

/// What is wrong with an archive.
fn wrong(content: &Content, error: &ZipError) -> ImportError {
    content.malformed("archive", in_one_line(error), "an intact ZIP archive")
}
