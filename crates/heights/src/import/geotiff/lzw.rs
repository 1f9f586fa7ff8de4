//! TIFF's LZW: codes of 9 to 12 bits from the most significant bit on, whose width grows one entry early.

/// Codes that are no bytes.
const CLEAR: usize = 256;
const END: usize = 257;

/// The most codes.
const MOST: usize = 4096;

/// The first `most` bytes that are packed, or as many as there are before damage.
pub(super) fn unpack(packed: &[u8], most: usize) -> Vec<u8> {
    let mut out: Vec<u8> = Vec::with_capacity(most);
    // A code stands for bytes that were written before: where they begin, and how many they are.
    let mut table: Vec<(usize, usize)> = Vec::with_capacity(MOST);
    let mut last: Option<(usize, usize)> = None;
    let (mut bits, mut count, mut width) = (0_u32, 0_u32, 9_u32);
    for byte in packed {
        bits = bits << 8 | u32::from(*byte);
        count += 8;
        if count < width {
            continue;
        }
        count -= width;
        let code = (bits >> count) as usize & ((1 << width) - 1);
        if code == END {
            break;
        }
        if code == CLEAR {
            table.clear();
            (last, width) = (None, 9);
            continue;
        }
        let start = out.len();
        if code < CLEAR {
            out.push(code as u8);
        } else {
            // The newest entry is the last word and its successor's first byte, which may not be written yet.
            let found = table.get(code - END - 1).copied();
            let is_next = code - END - 1 == table.len();
            let Some((from, length)) = found.or(last.filter(|_| is_next).map(|(from, length)| (from, length + 1)))
            else {
                break;
            };
            // Byte by byte: the word may go on in itself.
            for place in from..from + length {
                out.push(out[place]);
            }
        }
        if let Some((from, length)) = last.filter(|_| table.len() + END + 1 < MOST) {
            table.push((from, length + 1));
        }
        last = Some((start, out.len() - start));
        // The encoder is one entry ahead.
        width = match table.len() + END + 2 {
            ..512 => 9,
            512..1024 => 10,
            1024..2048 => 11,
            _ => 12,
        };
        if out.len() >= most {
            break;
        }
    }
    out.truncate(most);
    out
}
