//! Right checksums for changed page files, shared with the fuzz targets: without them no change gets past the first check.

use deepfield::store::layout::PAGE_ENTRY_LEN;

/// Gives the header, the footer and every page inside the file the checksums that their bytes have, as somebody who means harm
/// would.
pub fn correct(bytes: &mut [u8]) {
    let word = |bytes: &[u8], at: usize| {
        bytes.get(at..at + 4).and_then(|word| word.try_into().ok()).map_or(0, |word| u32::from_le_bytes(word) as usize)
    };
    let footer = word(bytes, 24);
    if bytes.len() < 64 || footer > bytes.len() {
        return;
    }
    for entry in (0..word(bytes, 44)).map(|page| footer + page * PAGE_ENTRY_LEN) {
        if entry + PAGE_ENTRY_LEN > bytes.len() {
            break;
        }
        let (offset, len) = (word(bytes, entry), word(bytes, entry + 8));
        if let Some(page) = offset.checked_add(len).and_then(|end| bytes.get(offset..end)) {
            let crc = crc32c::crc32c(page);
            bytes[entry + 20..entry + 24].copy_from_slice(&crc.to_le_bytes());
        }
    }
    let crc = crc32c::crc32c(&bytes[footer..]);
    bytes[40..44].copy_from_slice(&crc.to_le_bytes());
    let crc = crc32c::crc32c(&bytes[..60]);
    bytes[60..64].copy_from_slice(&crc.to_le_bytes());
}
