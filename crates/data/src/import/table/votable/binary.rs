//! The rows of a VOTable as bytes in base64, big-endian.

use super::field::VoField;
use super::markup::Markup;
use crate::import::ImportError;
use crate::import::grid::base64::Base64;
use crate::import::table::columns::shown;
use crate::import::table::store::{Store, StoreWriter};
use std::io::{BufRead, BufReader, ErrorKind, Read, Result as IoResult};
use std::path::Path;

/// Reads all rows, from the `STREAM` of a `BINARY` on, or of a `BINARY2`, whose rows begin with a flag for each column.
///
/// # Errors
/// When the rows are elsewhere or in another code, or are damaged.
pub(super) fn rows(
    path: &Path,
    fields: &[VoField],
    has_flags: bool,
    mut markup: Markup,
    mut writer: StoreWriter,
) -> Result<Store, ImportError> {
    if !markup.next(false)? || markup.name() != b"STREAM" || markup.is_end() {
        return Err(ImportError::missing(path, "STREAM", "the rows of the table"));
    }
    let encoding = markup.attribute("encoding").unwrap_or_default();
    if let Some(link) = markup.attribute("href") {
        return Err(ImportError::malformed(path, "href of STREAM", shown(&link), "rows in the file itself"));
    }
    if encoding.trim() != "base64" {
        return Err(ImportError::malformed(path, "encoding of STREAM", shown(&encoding), "base64"));
    }
    if markup.is_empty() {
        return writer.finish(|_| true);
    }
    let mut reader = BufReader::new(Base64::new(markup.into_reader()));
    let mut bytes = Vec::new();
    let mut flags = vec![0; if has_flags { fields.len().div_ceil(8) } else { 0 }];
    let mut row = Vec::with_capacity(writer.width());
    loop {
        let name = format!("row {}", writer.rows() + 1);
        let wrong = |error: std::io::Error| match error.kind() {
            ErrorKind::UnexpectedEof => {
                ImportError::malformed(path, &*name, "the end of STREAM", format!("{} columns", fields.len()))
            }
            ErrorKind::InvalidData => ImportError::malformed(path, &*name, error, "base64 of the rows"),
            _ => ImportError::io(path, &*name, error),
        };
        if reader.fill_buf().map_err(wrong)?.is_empty() {
            if !reader.get_ref().is_over() {
                return Err(ImportError::malformed(path, name, "the file's end", "the end of STREAM"));
            }
            return writer.finish(|_| true);
        }
        row.clear();
        read_row(&mut reader, fields, &mut flags, &mut bytes, &mut row).map_err(wrong)?;
        writer.push(&row)?;
    }
}

/// Reads one row; `flags` is as long as its flags are, `bytes` is room to work in.
fn read_row(
    reader: &mut impl Read,
    fields: &[VoField],
    flags: &mut [u8],
    bytes: &mut Vec<u8>,
    row: &mut Vec<f64>,
) -> IoResult<()> {
    reader.read_exact(flags)?;
    for (index, field) in fields.iter().enumerate() {
        match field.count {
            Some(count) => {
                // Not too many: that was compared when the header was read.
                bytes.resize(field.datatype.bytes(count).unwrap_or(0), 0);
                reader.read_exact(bytes)?;
                let is_missing = flags.get(index / 8).is_some_and(|flags| flags & (0x80 >> (index % 8)) != 0);
                if is_missing { field.push_none(row) } else { field.push_bytes(bytes, row) }
            }
            None => {
                let mut count = [0; 4];
                reader.read_exact(&mut count)?;
                let length =
                    usize::try_from(i32::from_be_bytes(count)).ok().and_then(|count| field.datatype.bytes(count));
                let length = length.ok_or_else(|| std::io::Error::new(ErrorKind::InvalidData, "a length below 0"))?;
                if std::io::copy(&mut reader.by_ref().take(length as u64), &mut std::io::sink())? < length as u64 {
                    return Err(ErrorKind::UnexpectedEof.into());
                }
            }
        }
    }
    Ok(())
}
