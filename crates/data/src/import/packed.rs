//! Compressed files, told by their first bytes: gzip (RFC 1952) and Zstandard (RFC 8878). Members and frames that follow each other are
//! read as one.

use flate2::read::MultiGzDecoder;
use std::io::{BufRead, Error, ErrorKind, Read, Result};
use zstd::stream::read::Decoder;

/// As much as deflate can expand; what is said to be more is wrong before anything is unpacked.
pub(super) const MOST_EXPANSION: u64 = 1040;

/// How a file is compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Packing {
    /// With gzip.
    Gzip,
    /// With Zstandard.
    Zstandard,
}

impl Packing {
    /// How compressed files usually end, without the dot.
    pub(super) const EXTENSIONS: [&str; 2] = ["gz", "zst"];

    /// How a file that begins so is compressed; `None` where it is not.
    pub(super) fn of(head: &[u8]) -> Option<Packing> {
        match head {
            [0x1f, 0x8b, ..] => Some(Packing::Gzip),
            // A frame, or one that holds no data, with which archives written in parallel begin.
            [0x28, 0xb5, 0x2f, 0xfd, ..] | [0x50..=0x5f, 0x2a, 0x4d, 0x18, ..] => Some(Packing::Zstandard),
            _ => None,
        }
    }

    /// Its name, and the command that unpacks a file and keeps it.
    pub(super) fn described(self) -> (&'static str, &'static str) {
        match self {
            Packing::Gzip => ("gzip", "gunzip -k"),
            Packing::Zstandard => ("Zstandard", "zstd -d"),
        }
    }

    /// What is in it.
    pub(super) fn unpacked<'a>(self, packed: impl BufRead + 'a) -> Box<dyn Read + 'a> {
        match self {
            Packing::Gzip => Box::new(MultiGzDecoder::new(packed)),
            Packing::Zstandard => Box::new(Zstandard::new(packed)),
        }
    }
}

/// The largest window of a frame, as a power of 2: what `zstd` unpacks without being asked for more.
const MOST_WINDOW: u32 = 27;

/// What is in an archive of Zstandard, or why it could not be begun.
struct Zstandard<R: BufRead>(Result<Decoder<'static, R>>);

impl<R: BufRead> Zstandard<R> {
    fn new(packed: R) -> Zstandard<R> {
        let begun = Decoder::with_buffer(packed);
        Zstandard(begun.and_then(|mut decoder| decoder.window_log_max(MOST_WINDOW).map(|()| decoder)))
    }
}

impl<R: BufRead> Read for Zstandard<R> {
    fn read(&mut self, out: &mut [u8]) -> Result<usize> {
        match &mut self.0 {
            Ok(decoder) => decoder.read(out).map_err(|error| match error.kind() {
                // The library has no kind for damage.
                ErrorKind::Other => Error::new(ErrorKind::InvalidData, error),
                _ => error,
            }),
            Err(error) => Err(Error::new(error.kind(), error.to_string())),
        }
    }
}
