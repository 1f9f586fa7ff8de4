//! Videos as Motion-JPEG in AVI (RIFF): every frame a JPEG picture, an index at the end.

use crate::annotate::overlay::read_png;
use crate::command_line::jpeg::jpeg;
use crate::model::new_file;
use rayon::prelude::*;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// A video that cannot be written.
#[derive(Debug, thiserror::Error)]
pub(super) enum AviError {
    /// A frame cannot be read.
    #[error(transparent)]
    Frame(#[from] crate::annotate::overlay::OverlayError),
    /// A frame cannot be encoded.
    #[error("{}: {message}", path.display())]
    Encode {
        /// The frame.
        path: PathBuf,
        /// What is wrong with it.
        message: String,
    },
    /// The file cannot be written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The video.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// It would be longer than the format allows.
    #[error("{}: the video would be longer than 4 GB, which AVI cannot hold; make it with ffmpeg (.mp4), or in parts", path.display())]
    TooLong {
        /// The video.
        path: PathBuf,
    },
}

/// JPEG quality: high, since dark skies show blocks.
const QUALITY: u8 = 93;
/// Frames that are encoded at a time.
const BATCH: usize = 16;
/// Bytes before the first frame: the headers below, whose lengths do not change.
const HEAD: usize = 12 + 12 + 64 + 12 + 64 + 48 + 12;

/// Writes PNG frames as a video, under another name first.
///
/// # Errors
/// [`AviError`].
pub(super) fn write(video: &Path, frames: &[PathBuf], rate: f64) -> Result<(), AviError> {
    let fail = |source| AviError::Io { path: video.to_owned(), source };
    let folder = video.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut file = new_file::builder().tempfile_in(folder).map_err(fail)?;
    let mut out = BufWriter::new(file.as_file_mut());
    out.write_all(&[0; HEAD]).map_err(fail)?;
    let mut index: Vec<[u32; 2]> = Vec::with_capacity(frames.len());
    // Offsets in the index count from the word "movi".
    let (mut at, mut largest, mut size) = (4u64, 0u32, (0, 0));
    for batch in frames.chunks(BATCH) {
        let encoded: Vec<Result<(Vec<u8>, (u32, u32)), AviError>> =
            batch.par_iter().map(|frame| encode(frame)).collect();
        for (frame, jpeg) in batch.iter().zip(encoded) {
            let (jpeg, found) = jpeg?;
            if index.is_empty() {
                size = found;
            } else if size != found {
                let message = format!("{}x{} pixels, the first frame has {}x{}", found.0, found.1, size.0, size.1);
                return Err(AviError::Encode { path: frame.clone(), message });
            }
            let padded = jpeg.len() as u64 + jpeg.len() as u64 % 2;
            let entries = 16 * (frames.len() as u64 + 1);
            if HEAD as u64 + at + 8 + padded + entries > u64::from(u32::MAX) {
                return Err(AviError::TooLong { path: video.to_owned() });
            }
            index.push([at as u32, jpeg.len() as u32]);
            largest = largest.max(jpeg.len() as u32);
            out.write_all(b"00dc").map_err(fail)?;
            out.write_all(&(jpeg.len() as u32).to_le_bytes()).map_err(fail)?;
            out.write_all(&jpeg).map_err(fail)?;
            out.write_all(&[0][..jpeg.len() % 2]).map_err(fail)?;
            at += 8 + padded;
        }
    }
    out.write_all(b"idx1").map_err(fail)?;
    out.write_all(&(16 * index.len() as u32).to_le_bytes()).map_err(fail)?;
    for [offset, length] in &index {
        out.write_all(b"00dc").map_err(fail)?;
        // Every frame stands for itself.
        for word in [0x10, *offset, *length] {
            out.write_all(&word.to_le_bytes()).map_err(fail)?;
        }
    }
    let total = out.stream_position().map_err(fail)?;
    out.seek(SeekFrom::Start(0)).map_err(fail)?;
    out.write_all(&head(index.len() as u32, size, rate, largest, at as u32, total as u32)).map_err(fail)?;
    out.flush().map_err(fail)?;
    drop(out);
    file.persist(video).map_err(|error| fail(error.error))?;
    Ok(())
}

fn encode(frame: &Path) -> Result<(Vec<u8>, (u32, u32)), AviError> {
    let image = read_png(frame)?;
    let fail = |message: String| AviError::Encode { path: frame.to_owned(), message };
    Ok((jpeg(&image, QUALITY).map_err(fail)?, (image.width, image.height)))
}

/// The headers: `RIFF`, the main and the stream's header, and the beginning of the list of frames, `movi` bytes long.
fn head(frames: u32, (width, height): (u32, u32), rate: f64, largest: u32, movi: u32, total: u32) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(HEAD);
    let mut words = |tag: &[u8], words: &[u32]| {
        bytes.extend_from_slice(tag);
        words.iter().for_each(|word| bytes.extend_from_slice(&word.to_le_bytes()));
    };
    // Rates such as 29.97 are fractions.
    let (numerator, denominator) = ((rate * 1000.0).round().max(1.0) as u32, 1000);
    let list = 4 + 64 + 12 + 64 + 48;
    words(b"RIFF", &[total - 8]);
    words(b"AVI LIST", &[list]);
    words(b"hdrl", &[]);
    let per_second = (f64::from(largest) * rate).min(f64::from(u32::MAX)) as u32;
    let microseconds = (1e6 / rate).round() as u32;
    // 0x10: there is an index.
    words(b"avih", &[56, microseconds, per_second, 0, 0x10, frames, 0, 1, largest, width, height, 0, 0, 0, 0]);
    words(b"LIST", &[4 + 64 + 48]);
    words(b"strl", &[]);
    words(b"strh", &[56]);
    words(b"vidsMJPG", &[0, 0, 0, denominator, numerator, 0, frames, largest, u32::MAX, 0, 0]);
    words(&[(width as u16).to_le_bytes(), (height as u16).to_le_bytes()].concat(), &[]);
    words(b"strf", &[40, 40, width, height, 1 | 24 << 16]);
    words(b"MJPG", &[width * height * 3, 0, 0, 0, 0]);
    words(b"LIST", &[movi]);
    words(b"movi", &[]);
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::Image;
    use crate::color::output::write_png;

    #[test]
    fn a_video_has_its_frames_where_its_index_says() {
        let folder = tempfile::tempdir().unwrap();
        let frames: Vec<PathBuf> = (0..5u8)
            .map(|i| {
                let path = folder.path().join(format!("{i}.png"));
                write_png(&path, &Image { width: 34, height: 18, rgba: vec![[50 * i, 0, 99, 255]; 34 * 18] }).unwrap();
                path
            })
            .collect();
        let video = folder.path().join("v.avi");
        write(&video, &frames, 24.0).unwrap();
        let bytes = std::fs::read(&video).unwrap();
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
        assert_eq!((&bytes[..4], word(4) as usize, &bytes[8..16]), (&b"RIFF"[..], bytes.len() - 8, &b"AVI LIST"[..]));
        // The lists follow one another.
        let movi = 12 + 8 + word(16) as usize;
        assert_eq!(
            (&bytes[movi..movi + 4], &bytes[movi + 8..movi + 12], movi + 12),
            (&b"LIST"[..], &b"movi"[..], HEAD)
        );
        let index = movi + 8 + word(movi + 4) as usize;
        assert_eq!((&bytes[index..index + 4], word(index + 4)), (&b"idx1"[..], 16 * 5));
        for i in 0..5 {
            let entry = index + 8 + 16 * i;
            let at = movi + 8 + word(entry + 8) as usize;
            assert_eq!(&bytes[at..at + 4], b"00dc");
            let length = word(entry + 12) as usize;
            assert_eq!(word(at + 4) as usize, length);
            assert_eq!(
                (&bytes[at + 8..at + 10], &bytes[at + 6 + length..at + 8 + length]),
                (&[0xff, 0xd8][..], &[0xff, 0xd9][..])
            );
        }
        assert!(write(&video, &[folder.path().join("none.png")], 24.0).unwrap_err().to_string().contains("none.png"));
    }
}
