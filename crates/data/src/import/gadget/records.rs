//! The records of a Gadget file: each is its length, its bytes and its length again (Fortran's unformatted output).

use crate::import::ImportError;
use crate::import::bytes::{Order, RangeFile};

/// One data record.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Record {
    /// Its label in format 2, blanks trimmed.
    pub label: Option<String>,
    /// First byte of the data.
    pub offset: u64,
    /// Number of bytes.
    pub length: u64,
}

/// Length of a header, and of a label record's content.
pub(super) const HEADER: u32 = 256;
const LABEL: u32 = 8;

/// Byte order and format (1 or 2) of a file that begins with these bytes.
pub(super) fn recognise(head: &[u8]) -> Option<(Order, u32)> {
    Order::BOTH.into_iter().find_map(|order| match head.len() {
        4.. if order.u32(head, 0) == HEADER => Some((order, 1)),
        8.. if order.u32(head, 0) == LABEL && head.get(4..8) == Some(b"HEAD") => Some((order, 2)),
        _ => None,
    })
}

/// Every data record of the file, header first.
pub(super) fn scan(file: &RangeFile, order: Order, format: u32) -> Result<Vec<Record>, ImportError> {
    let mut records = Vec::new();
    let mut at = 0u64;
    while at < file.length {
        let name = |label: &Option<String>| match label {
            Some(label) => format!("block {label}"),
            None => format!("block {}", records.len()),
        };
        let mut label = None;
        if format == 2 {
            let (offset, length) = record(file, order, at, "block label")?;
            if length != LABEL as u64 {
                let found = format!("a record of {length} bytes at byte {at}");
                return Err(ImportError::malformed(&file.path, "block label", found, "a label record of 8 bytes"));
            }
            let mut text = [0u8; 4];
            file.read(offset, &mut text, "block label")?;
            label = Some(String::from_utf8_lossy(&text).trim_end_matches([' ', '\0']).to_string());
            at = offset + length + 4;
        }
        let (offset, length) = record(file, order, at, &name(&label))?;
        at = offset + length + 4;
        records.push(Record { label, offset, length });
    }
    Ok(records)
}

/// Offset and length of the data of the record that starts at byte `at`.
pub(in crate::import) fn record(
    file: &RangeFile,
    order: Order,
    at: u64,
    name: &str,
) -> Result<(u64, u64), ImportError> {
    let marker = |at: u64| -> Result<u32, ImportError> {
        let mut bytes = [0u8; 4];
        file.read(at, &mut bytes, name)?;
        Ok(order.u32(&bytes, 0))
    };
    let first = marker(at)?;
    let offset = at + 4;
    // The markers of records of 4 GiB and more hold the length modulo 2^32.
    let lengths = (0..).map(|wraps: u64| first as u64 + (wraps << 32));
    for length in lengths.take_while(|length| offset + length + 4 <= file.length) {
        if marker(offset + length)? == first {
            return Ok((offset, length));
        }
    }
    let found = format!("length {first} at byte {at}");
    let expected = format!("a length that is repeated after the data, within the {} bytes of the file", file.length);
    Err(ImportError::malformed(&file.path, name, found, expected))
}
