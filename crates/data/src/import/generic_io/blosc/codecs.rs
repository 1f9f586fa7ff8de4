//! What the streams of Blosc's blocks are compressed with.

use flate2::bufread::ZlibDecoder;
use std::io::Read;

/// A way to compress.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Codec {
    BloscLz,
    /// LZ4's blocks, by either of its compressors.
    Lz4,
    /// Snappy without frames.
    Snappy,
    Zlib,
    Zstandard,
}

/// As containers number them.
const CODECS: [Codec; 5] = [Codec::BloscLz, Codec::Lz4, Codec::Snappy, Codec::Zlib, Codec::Zstandard];

impl Codec {
    /// The codec of a container's number.
    pub(super) fn of(number: u8) -> Option<Codec> {
        CODECS.get(usize::from(number)).copied()
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Codec::BloscLz => "BloscLZ",
            Codec::Lz4 => "LZ4",
            Codec::Snappy => "Snappy",
            Codec::Zlib => "zlib",
            Codec::Zstandard => "Zstandard (0.8 or later)",
        }
    }

    /// Fills all of `out` from a stream; `None` where the stream is damaged, or has more or fewer bytes.
    pub(super) fn unpack(self, packed: &[u8], out: &mut [u8]) -> Option<()> {
        match self {
            Codec::BloscLz => blosclz(packed, out),
            Codec::Lz4 => (lz4_flex::block::decompress_into(packed, out).ok()? == out.len()).then_some(()),
            Codec::Snappy => (snap::raw::Decoder::new().decompress(packed, out).ok()? == out.len()).then_some(()),
            Codec::Zlib => fill(ZlibDecoder::new(packed), out),
            Codec::Zstandard => (zstd::bulk::decompress_to_buffer(packed, out).ok()? == out.len()).then_some(()),
        }
    }
}

/// Fills `out` with all that there is.
fn fill(mut content: impl Read, out: &mut [u8]) -> Option<()> {
    content.read_exact(out).ok()?;
    (content.read(&mut [0]).ok()? == 0).then_some(())
}

/// The distance from which on two further bytes tell it.
const FAR: usize = 8191;
/// Bytes of the shortest repetition.
const SHORTEST: usize = 3;

/// BloscLZ, of FastLZ's kin. A control byte below 32 has one byte more than it says behind it, which are copied. In any other the upper three
/// bits say how much is repeated, and the lower five and a further byte from how far back; 7 goes on in bytes that are added until one is not 255.
fn blosclz(packed: &[u8], out: &mut [u8]) -> Option<()> {
    let mut rest = packed;
    let mut filled = 0;
    // The first copies; its upper bits are a version.
    let mut control = next(&mut rest)? & 31;
    loop {
        if control < 32 {
            let copied = rest.split_off(..=control)?;
            out.get_mut(filled..filled + copied.len())?.copy_from_slice(copied);
            filled += copied.len();
        } else {
            let mut length = (control >> 5) - 1 + SHORTEST;
            if control >> 5 == 7 {
                loop {
                    let more = next(&mut rest)?;
                    length += more;
                    if more < 255 {
                        break;
                    }
                }
            }
            let mut distance = ((control & 31) << 8) | next(&mut rest)?;
            if distance == FAR {
                distance += (next(&mut rest)? << 8) | next(&mut rest)?;
            }
            repeat(out, filled, distance + 1, length)?;
            filled += length;
        }
        match next(&mut rest) {
            Some(byte) => control = byte,
            None => return (filled == out.len()).then_some(()),
        }
    }
}

fn next(rest: &mut &[u8]) -> Option<usize> {
    rest.split_off_first().map(|byte| usize::from(*byte))
}

/// Puts `length` bytes at `at`, each the same as that `distance` before it.
fn repeat(out: &mut [u8], at: usize, distance: usize, length: usize) -> Option<()> {
    let from = at.checked_sub(distance)?;
    let end = at.checked_add(length).filter(|end| *end <= out.len())?;
    let mut done = at;
    while done < end {
        // What is there already repeats itself.
        let count = (done - from).min(end - done);
        out.copy_within(from..from + count, done);
        done += count;
    }
    Some(())
}
