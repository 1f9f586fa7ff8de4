//! Compressed files, told by their first bytes: gzip (RFC 1952) and Zstandard (RFC 8878). Members and frames that follow each other are
//! read as one.

use super::guarded::guarded;
use flate2::read::MultiGzDecoder;
use ruzstd::decoding::errors::{FrameDecoderError, ReadFrameHeaderError};
use ruzstd::decoding::{BlockDecodingStrategy, FrameDecoder};
use std::io::{BufRead, Error, ErrorKind, Read, Result};

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

/// What is in the frames of an archive.
struct Zstandard<R> {
    packed: R,
    decoder: FrameDecoder,
    is_in_frame: bool,
}

/// The header of a frame with the smallest window.
const SMALLEST: [u8; 6] = [0x28, 0xb5, 0x2f, 0xfd, 0, 0];

impl<R: BufRead> Zstandard<R> {
    fn new(packed: R) -> Zstandard<R> {
        let mut decoder = FrameDecoder::new();
        // The decoder holds as much as a frame's window, and only from its second frame on asks whether that is sensible (100 MiB).
        let _ = decoder.init(&SMALLEST[..]);
        Zstandard { packed, decoder, is_in_frame: false }
    }

    /// Begins the next frame with data in it; false at the end of the archive.
    fn begin(&mut self) -> Result<bool> {
        while !self.packed.fill_buf()?.is_empty() {
            match self.decoder.init(&mut self.packed) {
                Ok(()) => return Ok(true),
                Err(FrameDecoderError::ReadFrameHeaderError(ReadFrameHeaderError::SkipFrame { length, .. })) => {
                    let length = u64::from(length);
                    if std::io::copy(&mut (&mut self.packed).take(length), &mut std::io::sink())? < length {
                        return Err(ErrorKind::UnexpectedEof.into());
                    }
                }
                Err(error) => return Err(damaged(error)),
            }
        }
        Ok(false)
    }

    /// Decodes some of a frame; 0 at its end.
    fn decode(&mut self, out: &mut [u8]) -> Result<usize> {
        let decoder = &mut self.decoder;
        while decoder.can_collect() == 0 && !decoder.is_finished() {
            decoder.decode_blocks(&mut self.packed, BlockDecodingStrategy::UptoBlocks(1)).map_err(damaged)?;
        }
        let read = decoder.read(out)?;
        let stated = decoder.get_checksum_from_data().filter(|_| read == 0);
        if stated.is_some_and(|stated| decoder.get_calculated_checksum() != Some(stated)) {
            return Err(damaged("a frame that is not what its checksum says"));
        }
        Ok(read)
    }
}

impl<R: BufRead> Read for Zstandard<R> {
    fn read(&mut self, out: &mut [u8]) -> Result<usize> {
        while !out.is_empty() {
            if !self.is_in_frame && !guarded(|| self.begin()).unwrap_or_else(gave_up)? {
                return Ok(0);
            }
            self.is_in_frame = true;
            let read = guarded(|| self.decode(out)).unwrap_or_else(gave_up)?;
            if read > 0 {
                return Ok(read);
            }
            self.is_in_frame = false;
        }
        Ok(0)
    }
}

/// What a reader that panics says.
fn gave_up<T>() -> Result<T> {
    Err(damaged("a frame that its reader gave up on"))
}

fn damaged(why: impl ToString) -> Error {
    // Some errors list whole tables of codes.
    const LONGEST: usize = 200;
    let text = why.to_string();
    let line: String =
        text.chars().map(|letter| if letter.is_control() { ' ' } else { letter }).take(LONGEST).collect();
    Error::new(ErrorKind::InvalidData, line)
}
