//! How strips and tiles are packed.

use super::directory::Directory;
use super::{lerc, tag};
use deepfield_data::import::{ByteOrder, ImportError};
use deepfield_data::model::SampleType;
use flate2::read::ZlibDecoder;
use std::io::Read;
use weezl::BitOrder;
use weezl::decode::Configuration;
use zstd::stream::read::Decoder;

/// How bytes are packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Packing {
    /// Not at all.
    None,
    /// TIFF's LZW.
    Lzw,
    /// zlib's deflate.
    Deflate,
    /// Runs of bytes.
    PackBits,
    /// Zstandard (RFC 8878).
    Zstd,
    /// LERC, which may be packed once more.
    Lerc(Outer),
}

/// What a LERC blob was packed by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Outer {
    /// Nothing.
    None,
    /// zlib's deflate.
    Deflate,
    /// Zstandard.
    Zstd,
}

/// What samples were replaced by before they were packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Predictor {
    /// Nothing.
    None,
    /// Differences of numbers.
    Numbers,
    /// Differences of the bytes of floats, the most significant ones of a row first.
    Floats,
}

/// Packing and all else that leads from bytes to samples.
#[derive(Clone, Copy, Debug)]
pub(super) struct Coding {
    /// How bytes are packed.
    pub packing: Packing,
    predictor: Predictor,
    order: ByteOrder,
    /// The type of samples.
    kind: SampleType,
}

impl Coding {
    /// What a directory says.
    ///
    /// # Errors
    /// Where it is nothing that is read: the message names it.
    pub(super) fn read(directory: &Directory, kind: SampleType) -> Result<Coding, ImportError> {
        let content = directory.content;
        let packing = match directory.number(tag::COMPRESSION)?.unwrap_or(1) {
            1 => Packing::None,
            5 => Packing::Lzw,
            8 | 32946 => Packing::Deflate,
            32773 => Packing::PackBits,
            50000 => Packing::Zstd,
            34887 => Packing::Lerc(outer(directory)?),
            other => {
                let name = match other {
                    2..=4 => "CCITT",
                    6 | 7 => "JPEG",
                    34712 => "JPEG 2000",
                    34925 => "LZMA",
                    50001 => "WebP",
                    _ => "unknown",
                };
                let found = format!("{other} ({name}), which is not supported");
                return Err(content.malformed("Compression", found, "none, LZW, Deflate, PackBits, ZSTD or LERC"));
            }
        };
        let predictor = match (directory.number(tag::PREDICTOR)?.unwrap_or(1), kind.is_float()) {
            (1, _) => Predictor::None,
            (2, _) => Predictor::Numbers,
            (3, true) => Predictor::Floats,
            (other, _) => {
                return Err(content.malformed("Predictor", format!("{other} of {kind}"), "1, 2, or 3 of floats"));
            }
        };
        if matches!(packing, Packing::Lerc(_)) && predictor != Predictor::None {
            return Err(content.malformed("Predictor", "one of LERC", "1"));
        }
        Ok(Coding { packing, predictor, order: directory.order, kind })
    }

    /// Whether samples lie in the file as they are.
    pub(super) fn is_plain(&self) -> bool {
        self.packing == Packing::None && self.predictor == Predictor::None
    }

    /// The most bytes that so many packed ones can become.
    pub(super) fn expanded(&self, packed: u64) -> u64 {
        packed.saturating_mul(match self.packing {
            Packing::None => 1,
            Packing::Lzw => 1400,
            Packing::Deflate => 1040,
            Packing::PackBits => 64,
            // A block of 128 KiB may be one byte, which is repeated.
            Packing::Zstd => 1 << 15,
            // Whatever its size, a chunk of equal samples is a header.
            Packing::Lerc(_) if packed < lerc::SHORTEST / 2 => 0,
            Packing::Lerc(_) => 1 << 20,
        })
    }

    /// The samples of a chunk, the least significant byte first, of which there are `bytes` in rows of `row`. Or what there is instead.
    pub(super) fn unpack(&self, packed: Vec<u8>, bytes: usize, row: usize) -> Result<Vec<u8>, String> {
        let size = self.kind.size();
        let mut out = match self.packing {
            Packing::None => {
                let mut packed = packed;
                packed.truncate(bytes);
                packed
            }
            Packing::Lzw => words(&packed, bytes),
            Packing::Deflate => inflated(&packed, bytes),
            Packing::PackBits => runs(&packed, bytes),
            Packing::Zstd => unfolded(&packed, bytes),
            Packing::Lerc(outer) => {
                // Samples that cannot be made less of are a little more as a blob.
                let most = 2 * bytes + (1 << 16);
                let blob = match outer {
                    Outer::None => packed,
                    Outer::Deflate => inflated(&packed, most),
                    Outer::Zstd => unfolded(&packed, most),
                };
                return lerc::unpack(&blob, [(row / size) as u64, (bytes / row) as u64], self.kind);
            }
        };
        if out.len() < bytes {
            return Err(format!("{} bytes", out.len()));
        }
        match self.predictor {
            Predictor::Floats => {
                let mut line = vec![0; row];
                out.chunks_exact_mut(row).for_each(|row| floats(row, &mut line, size));
            }
            Predictor::Numbers => {
                self.turn(&mut out);
                out.chunks_exact_mut(row).for_each(|row| sums(row, size));
            }
            Predictor::None => self.turn(&mut out),
        }
        Ok(out)
    }

    /// Puts the least significant bytes first.
    fn turn(&self, bytes: &mut [u8]) {
        if self.order == ByteOrder::Big && self.kind.size() > 1 {
            bytes.chunks_exact_mut(self.kind.size()).for_each(<[u8]>::reverse);
        }
    }
}

/// What LERC blobs of a file are packed by.
fn outer(directory: &Directory) -> Result<Outer, ImportError> {
    match directory.numbers(tag::LERC, 2)?.as_deref() {
        None | Some([] | [_] | [_, 0, ..]) => Ok(Outer::None),
        Some([_, 1, ..]) => Ok(Outer::Deflate),
        Some([_, 2, ..]) => Ok(Outer::Zstd),
        Some([_, other, ..]) => Err(directory.content.malformed(
            "LercParameters",
            format!("compression {other}"),
            "0, 1 (Deflate) or 2 (ZSTD)",
        )),
    }
}

/// The first `bytes` bytes of what zlib has packed, or as many as there are before damage.
fn inflated(packed: &[u8], bytes: usize) -> Vec<u8> {
    let mut out = Vec::with_capacity(bytes);
    let _ = ZlibDecoder::new(packed).take(bytes as u64).read_to_end(&mut out);
    out
}

/// The same of Zstandard.
fn unfolded(packed: &[u8], bytes: usize) -> Vec<u8> {
    let mut out = Vec::with_capacity(bytes);
    if let Ok(decoder) = Decoder::with_buffer(packed) {
        let _ = decoder.take(bytes as u64).read_to_end(&mut out);
    }
    out
}

/// TIFF's LZW, whose codes grow one entry early: the first `bytes` bytes, or as many as there are before damage.
fn words(packed: &[u8], bytes: usize) -> Vec<u8> {
    let mut out = vec![0; bytes];
    let mut decoder = Configuration::with_tiff_size_switch(BitOrder::Msb, 8).build();
    let (mut read, mut written) = (0, 0);
    while written < bytes {
        let step = decoder.decode_bytes(&packed[read..], &mut out[written..]);
        read += step.consumed_in;
        written += step.consumed_out;
        if step.status.is_err() || step.consumed_in == 0 && step.consumed_out == 0 {
            break;
        }
    }
    out.truncate(written);
    out
}

/// Runs of bytes: a count, and as many bytes or one that is repeated.
fn runs(packed: &[u8], bytes: usize) -> Vec<u8> {
    let mut out = Vec::with_capacity(bytes);
    let mut rest = packed;
    while let Some((&head, behind)) = rest.split_first() {
        let left = bytes - out.len();
        match head as i8 {
            -128 => rest = behind,
            count @ 0.. => {
                let count = (count as usize + 1).min(behind.len());
                out.extend_from_slice(&behind[..count.min(left)]);
                rest = &behind[count..];
            }
            count => {
                let Some((&byte, behind)) = behind.split_first() else { break };
                out.resize(out.len() + (1 - isize::from(count)).unsigned_abs().min(left), byte);
                rest = behind;
            }
        }
        if out.len() == bytes {
            break;
        }
    }
    out
}

/// Numbers from their differences along a row.
fn sums(row: &mut [u8], size: usize) {
    macro_rules! each {
        ($kind:ty, $size:literal) => {{
            let mut sum: $kind = 0;
            for bytes in row.as_chunks_mut::<$size>().0 {
                sum = sum.wrapping_add(<$kind>::from_le_bytes(*bytes));
                *bytes = sum.to_le_bytes();
            }
        }};
    }
    match size {
        1 => each!(u8, 1),
        2 => each!(u16, 2),
        4 => each!(u32, 4),
        _ => each!(u64, 8),
    }
}

/// Floats from the differences of their bytes: of all numbers of the row the most significant bytes, then the next, and
/// so on.
fn floats(row: &mut [u8], line: &mut [u8], size: usize) {
    let mut sum = 0_u8;
    for byte in row.iter_mut() {
        sum = sum.wrapping_add(*byte);
        *byte = sum;
    }
    line.copy_from_slice(row);
    let count = row.len() / size;
    for (number, bytes) in row.chunks_exact_mut(size).enumerate() {
        for (place, byte) in bytes.iter_mut().rev().enumerate() {
            *byte = line[place * count + number];
        }
    }
}
