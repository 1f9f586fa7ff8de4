//! What a folder of frames was recorded from: a recording goes on only with the same.

use super::Arguments;
use crate::color::output::write_atomically;
use crate::look::dataset::Fingerprint;
use crate::model::is_url;
use crate::tour::{Frames, Show};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The name of the manifest in the folder.
pub(super) const NAME: &str = "recording.ron";

/// Everything that frames depend on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Manifest {
    /// The program's version.
    deepfield: String,
    /// CRC-32C of the tour, as it was resolved, and of the fingerprints of files that it names beside the data.
    tour: u32,
    /// The data.
    data: Fingerprint,
    /// Pixels.
    size: (u32, u32),
    /// Frames per second.
    rate: f64,
    /// Number in the first frame's name.
    offset: u32,
    /// Names of frames.
    name: String,
    /// What they are written as.
    formats: Vec<String>,
    /// Whether each has a scene file.
    scenes: bool,
    /// What draws.
    backend: String,
    /// What `--memory` was, or is where it is not given, bytes, where frames are coarser since they do not fit into it; others do not depend on it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub memory: Option<u64>,
}

impl Manifest {
    /// What is to be recorded; no frame is coarser yet.
    ///
    /// # Errors
    /// When the data cannot be read.
    pub fn new(show: &Show, frames: &Frames, arguments: &Arguments) -> Result<Manifest, std::io::Error> {
        let name =
            |error: std::io::Error| std::io::Error::new(error.kind(), format!("{}: {error}", show.data.path.display()));
        let named = arguments.tour.as_ref().map(|file| show.tour.files(file)).unwrap_or_default();
        let beside = named.iter().filter(|path| **path != show.data.path && !is_url(path));
        // A logo that is exchanged after an interruption would be on a part of the frames.
        let tour = beside.filter_map(|path| Fingerprint::of(path).ok()).fold(
            crc32c::crc32c(show.tour.to_ron().as_bytes()),
            |crc, Fingerprint { bytes, crc32c }| {
                crc32c::crc32c_append(crc32c::crc32c_append(crc, &bytes.to_le_bytes()), &crc32c.to_le_bytes())
            },
        );
        Ok(Manifest {
            deepfield: env!("CARGO_PKG_VERSION").to_owned(),
            tour,
            data: Fingerprint::of(&show.data.path).map_err(name)?,
            size: show.tour.size,
            rate: frames.rate,
            offset: arguments.offset,
            name: arguments.name.to_string(),
            formats: arguments.format.iter().map(|format| format!("{format:?}").to_lowercase()).collect(),
            scenes: !arguments.no_scenes,
            backend: format!("{:?}", arguments.backend.unwrap_or(super::Backend::Cpu)).to_lowercase(),
            memory: None,
        })
    }

    /// The manifest of a folder; `None` where there is none.
    ///
    /// # Errors
    /// When it is there and cannot be read.
    pub fn read(folder: &Path) -> Result<Option<Manifest>, String> {
        let path = folder.join(NAME);
        let text = match std::fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(format!("{}: {error}", path.display())),
        };
        crate::model::ron_file::parse(&path.display().to_string(), &text).map(Some).map_err(|error| error.to_string())
    }

    /// Writes it into a folder.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&self, folder: &Path) -> Result<PathBuf, Box<dyn std::error::Error + Send + Sync>> {
        let path = folder.join(NAME);
        let text = ron::ser::to_string_pretty(self, ron::ser::PrettyConfig::new().struct_names(false))?;
        let text = format!("// What the frames in this folder were recorded from.\n{text}\n");
        write_atomically(&path, text.as_bytes())?;
        Ok(path)
    }

    /// What differs from another one, for which there is so much memory where that matters, with both values; `None` where nothing does.
    pub fn difference(&self, other: &Manifest, memory: Option<u64>) -> Option<String> {
        let data = |data: &Fingerprint| format!("{} bytes with checksum {:08x}", data.bytes, data.crc32c);
        let memory_of = |memory: Option<u64>| memory.map_or_else(String::new, |bytes| format!("{bytes} bytes"));
        let pairs = [
            ("the program's version", self.deepfield.clone(), other.deepfield.clone()),
            ("the data", data(&self.data), data(&other.data)),
            ("--size", format!("{:?}", self.size), format!("{:?}", other.size)),
            ("--fps", self.rate.to_string(), other.rate.to_string()),
            ("--offset", self.offset.to_string(), other.offset.to_string()),
            ("--name", self.name.clone(), other.name.clone()),
            ("--format", self.formats.join(","), other.formats.join(",")),
            ("scene files", self.scenes.to_string(), other.scenes.to_string()),
            ("--backend", self.backend.clone(), other.backend.clone()),
            ("the tour", format!("checksum {:08x}", self.tour), format!("checksum {:08x}", other.tour)),
            (
                "--memory, which some of its frames are coarser for,",
                memory_of(self.memory.or(memory)),
                memory_of(memory),
            ),
        ];
        let differing = pairs.into_iter().filter(|(_, own, others)| own != others);
        let texts: Vec<String> =
            differing.map(|(what, own, others)| format!("{what} was {own}, now {others}")).collect();
        (!texts.is_empty()).then(|| texts.join("; "))
    }
}
