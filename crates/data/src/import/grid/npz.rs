//! NumPy's archives of arrays: the first that is a grid.

use super::content::{Content, filled, in_one_line};
use super::npy::Array;
use super::picture::seekable;
use super::{GridDescription, GridFormat, GridSource, choice};
use crate::import::ImportError;
use std::io::{BufReader, Read};
use zip::ZipArchive;

/// `.npz`, compressed or not.
pub(super) const NPZ: GridFormat = GridFormat {
    name: "npz",
    extensions: &["npz"],
    has_parts: true,
    detect: |content| {
        // A ZIP archive whose first file is an array.
        let name = content.head.get(30..30 + usize::from(content.head.get(26).copied().unwrap_or(0)));
        content.head.starts_with(b"PK\x03\x04") && name.is_some_and(|name| name.ends_with(b".npy"))
    },
    open,
};

fn open(content: &Content) -> Result<GridSource, ImportError> {
    let path = &*content.path;
    let wrong =
        |error: zip::result::ZipError| ImportError::malformed(path, "archive", in_one_line(&error), "a ZIP archive");
    let mut archive = ZipArchive::new(BufReader::new(seekable(content)?)).map_err(wrong)?;
    let mut refused = None;
    let mut left_out = Vec::new();
    let mut chosen = None;
    for index in 0..archive.len() {
        let mut member = archive.by_index(index).map_err(wrong)?;
        let name: String =
            member.name().map_err(wrong)?.chars().map(|c| if c.is_control() { '?' } else { c }).collect();
        let mut head = Vec::new();
        // What is damaged shows when the samples are read.
        let _ = (&mut member).take(super::content::LONGEST_HEADER as u64).read_to_end(&mut head);
        let plain = name.trim_end_matches(".npy");
        let is_meant = content.part.as_ref().is_none_or(|part| part.trim_end_matches(".npy") == plain);
        match Array::read(path, &head) {
            Ok(array) if is_meant && chosen.is_none() => chosen = Some((index, name, array)),
            Ok(_) => left_out.push(name),
            Err(error) => {
                refused = refused.or(Some(error).filter(|_| is_meant));
                left_out.push(name);
            }
        }
    }
    let missing = || match &content.part {
        None => ImportError::missing(path, "arrays", "one of 2 to 4 axes"),
        Some(part) => {
            let names: Vec<String> = left_out.iter().map(|name| name.trim_end_matches(".npy").to_owned()).collect();
            choice::missing(content, part, &names)
        }
    };
    let (index, name, array) = chosen.ok_or_else(|| refused.unwrap_or_else(missing))?;
    let mut member = archive.by_index(index).map_err(wrong)?;
    content.check_packed(member.compressed_size().min(content.most()), array.bytes, &array.grid)?;
    // Behind the header.
    let _ = std::io::copy(&mut (&mut member).take(array.start), &mut std::io::sink());
    let storage = filled(member, path, array.bytes, &array.grid)?;
    let layout = array.layout(0);
    let mut about = GridDescription::new(&content.named, NPZ.name, content.length, array.grid);
    about.notes.push(format!("array {}", name.trim_end_matches(".npy")));
    if !left_out.is_empty() {
        about.notes.push(format!("other arrays are left out: {}", left_out.join(", ")));
    }
    Ok(GridSource::new(about, storage, layout))
}
