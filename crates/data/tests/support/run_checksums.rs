//! Right checksums for changed run files, shared with the fuzz targets: without them no change gets past the first check.

/// Gives directory and header the checksums that their bytes have, as somebody who means harm would.
pub fn correct(bytes: &mut [u8]) {
    let word = |at: usize| bytes.get(at..at + 8).and_then(|word| word.try_into().ok()).map(u64::from_le_bytes);
    let place = |at: usize| word(at).and_then(|value| usize::try_from(value).ok());
    let range = place(24).zip(place(32)).and_then(|(offset, len)| Some(offset..offset.checked_add(len)?));
    let Some(directory) = range.and_then(|range| bytes.get(range)) else { return };
    let crc = crc32c::crc32c(directory);
    bytes[40..44].copy_from_slice(&crc.to_le_bytes());
    let crc = crc32c::crc32c(&bytes[..60]);
    bytes[60..64].copy_from_slice(&crc.to_le_bytes());
}
