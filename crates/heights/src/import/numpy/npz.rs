//! NumPy's archives: the largest array of two axes, and what the others say of its place.

use super::axes::{Axes, is_axis};
use super::{holds_heights, layout, numbers};
use crate::import::archive::Archive;
use crate::import::content::{Content, LONGEST_HEAD};
use crate::import::{HeightDescription, HeightFormat, HeightSource, NoData};
use deepfield_data::import::ImportError;
use deepfield_data::import::grid::NpyHeader;

/// `.npz`, compressed or not.
pub(in crate::import) const NPZ: HeightFormat = HeightFormat {
    name: "npz",
    extensions: &["npz"],
    is_sure: |content| arrays(content).is_ok_and(|(_, arrays)| is_sure(&arrays)),
    detect: |content| {
        // A ZIP archive whose first file is an array.
        let length = usize::from(content.head.get(26).copied().unwrap_or(0));
        let name = content.head.get(30..30 + length);
        content.head.starts_with(b"PK\x03\x04")
            && (content.has_extension("npz") || name.is_some_and(|name| name.ends_with(b".npy")))
    },
    open,
};

/// The most arrays of an archive that are looked at.
const MOST_ARRAYS: usize = 1000;

/// The most numbers that an axis has.
const LONGEST_AXIS: u64 = 1 << 21;

/// An array of the archive: its name, without the ending, and its header.
type Array = (String, NpyHeader);

/// The arrays of an archive; those that hold no numbers are left out.
fn arrays(content: &Content) -> Result<(Archive<'_>, Vec<Array>), ImportError> {
    let mut archive = Archive::open(content)?;
    let names: Vec<String> = archive.names().filter(|name| name.ends_with(".npy")).take(MOST_ARRAYS).collect();
    let mut arrays = Vec::new();
    for name in names {
        let head = archive.beginning(&name, LONGEST_HEAD as u64)?;
        if let Ok(header) = NpyHeader::read(&content.path, &head) {
            arrays.push((name.trim_end_matches(".npy").to_owned(), header));
        }
    }
    Ok((archive, arrays))
}

/// The largest array of two axes: of heights rather than of places, and the first of several.
fn largest(arrays: &[Array]) -> Option<&Array> {
    let samples = |(name, header): &Array| (!is_axis(name), header.sizes.iter().copied().fold(1, u64::saturating_mul));
    arrays.iter().rev().filter(|(_, header)| header.sizes.len() == 2).max_by_key(|array| samples(array))
}

/// Whether the archive can hold nothing but heights: one array of two axes that is no picture, and none of more.
fn is_sure(arrays: &[Array]) -> bool {
    let heights = arrays.iter().filter(|(name, header)| header.sizes.len() == 2 && !is_axis(name)).count();
    let is_flat = arrays.iter().all(|(_, header)| header.sizes.len() <= 2);
    is_flat && heights == 1 && largest(arrays).is_some_and(|(_, header)| holds_heights(header))
}

fn open(content: &Content) -> Result<HeightSource, ImportError> {
    let (mut archive, arrays) = arrays(content)?;
    let Some((name, header)) = largest(&arrays) else {
        let shown: Vec<String> =
            arrays.iter().take(8).map(|(name, header)| format!("{name} {}", header.shape)).collect();
        let found = if shown.is_empty() { "none".to_owned() } else { shown.join(", ") };
        return Err(content.malformed("arrays", found, "one of 2 axes: rows and columns of heights"));
    };
    let mut grid = super::grid_of(content, name, header)?;
    let size = [grid.columns, grid.rows];
    let bytes = header.start + grid.samples() * header.kind.size() as u64;
    let unpacked = archive.unpack(&format!("{name}.npy"), bytes, &grid.described(), |_| ())?;
    let samples = unpacked.samples(content, name, layout(header, size, header.start))?;

    let mut notes = vec![format!("array {name}")];
    let others = arrays.iter().filter(|(own, header)| own != name && header.sizes.len() > 1);
    let others: Vec<String> = others.take(8).map(|(name, header)| format!("{name} {}", header.shape)).collect();
    if !others.is_empty() {
        notes.push(format!("other arrays are left out: {}", others.join(", ")));
    }
    let mut axes = Axes::default();
    for (name, header) in &arrays {
        let count = header.sizes.iter().copied().fold(1, u64::saturating_mul);
        if !axes.wants(name, &header.sizes, size) || count > LONGEST_AXIS {
            continue;
        }
        let bytes = header.start + count * header.kind.size() as u64;
        let numbers = numbers(header, &archive.whole(&format!("{name}.npy"), bytes)?);
        if numbers.len() as u64 != count {
            return Err(content.malformed(name, format!("{} numbers", numbers.len()), format!("{count}")));
        }
        axes.put(name, numbers);
    }
    let has_spacing = axes.apply(content, &mut grid, &mut notes)?;
    let mut about = HeightDescription::new(content, NPZ.name, grid);
    (about.has_spacing, about.notes) = (has_spacing, notes);
    Ok(HeightSource::new(about, Box::new(samples), NoData::Nothing))
}
