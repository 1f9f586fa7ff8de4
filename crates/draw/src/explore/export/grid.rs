//! Images and volumes as files of other programs: NumPy arrays, NRRD and PNG, each as the grid's samples are stored.

use crate::color::output::{OutputError, write_atomically};
use crate::import::grid::head::{npy_head, nrrd_head};
use crate::model::{Grid, SampleType};
use std::path::Path;

/// Samples are written in this machine's byte order.
const LITTLE: bool = cfg!(target_endian = "little");

/// What kind of file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GridFormat {
    /// A NumPy array of shape (y, x) or (z, y, x), and of several channels one axis more, the last.
    Npy,
    /// NRRD with its header, uncompressed, with axes and units.
    Nrrd,
    /// An image of 8 or 16 bits; of a volume its only layer.
    Png,
}

impl GridFormat {
    /// The format that a file's name asks for.
    pub fn of(path: &Path) -> Option<GridFormat> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "npy" => Some(GridFormat::Npy),
            "nrrd" => Some(GridFormat::Nrrd),
            "png" => Some(GridFormat::Png),
            _ => None,
        }
    }

    /// Why it cannot hold a grid; `None` where it can.
    pub fn lacks(self, grid: &Grid) -> Option<String> {
        let fits = self != GridFormat::Png
            || sides_of_layer(grid).is_some()
                && matches!(grid.sample_type, SampleType::U8 | SampleType::U16)
                && (1..=4).contains(&grid.channels.len());
        (!fits).then(|| {
            let expected = "expected an image or one layer of a volume, of uint8 or uint16 with 1 to 4 channels";
            format!("png: found {}, {expected}", grid.described())
        })
    }
}

/// The sides of an image, or of a volume that is one sample thick along an axis; `None` of every other volume. Samples lie in the same order in
/// both.
fn sides_of_layer(grid: &Grid) -> Option<[u64; 2]> {
    let [x, y, z] = grid.shape;
    match (x, y, z) {
        (_, _, 1) => Some([x, y]),
        (_, 1, _) => Some([x, z]),
        (1, _, _) => Some([y, z]),
        _ => None,
    }
}

/// Writes a grid. `samples` are those of all channels side by side, x fastest, in this machine's byte order.
///
/// # Errors
/// [`OutputError`] with the file named; then nothing is left behind.
pub fn write_grid(path: &Path, format: GridFormat, grid: &Grid, samples: &[u8]) -> Result<(), OutputError> {
    if let Some(reason) = format.lacks(grid) {
        return Err(OutputError::Encode { path: path.into(), message: reason });
    }
    let bytes = match format {
        GridFormat::Npy => [&npy_head(grid, LITTLE)[..], samples].concat(),
        GridFormat::Nrrd => [nrrd_head(grid, LITTLE).as_bytes(), samples].concat(),
        GridFormat::Png => png_bytes(grid, samples)
            .map_err(|error| OutputError::Encode { path: path.into(), message: error.to_string() })?,
    };
    write_atomically(path, &bytes)
}

fn png_bytes(grid: &Grid, samples: &[u8]) -> Result<Vec<u8>, png::EncodingError> {
    let [width, height] = sides_of_layer(grid).ok_or_else(|| std::io::Error::other("a volume of many layers"))?;
    let side = |side: u64| u32::try_from(side).map_err(|_| std::io::Error::other("an image too wide for PNG"));
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, side(width)?, side(height)?);
    encoder.set_color(match grid.channels.len() {
        1 => png::ColorType::Grayscale,
        2 => png::ColorType::GrayscaleAlpha,
        3 => png::ColorType::Rgb,
        _ => png::ColorType::Rgba,
    });
    let is_wide = grid.sample_type == SampleType::U16;
    encoder.set_depth(if is_wide { png::BitDepth::Sixteen } else { png::BitDepth::Eight });
    let mut writer = encoder.write_header()?;
    match is_wide {
        // PNG has the high byte first.
        true => {
            let big: Vec<u8> =
                samples.as_chunks().0.iter().flat_map(|pair| u16::from_ne_bytes(*pair).to_be_bytes()).collect();
            writer.write_image_data(&big)?;
        }
        false => writer.write_image_data(samples)?,
    }
    writer.finish()?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

    use super::*;
    use crate::import::{GridOptions, open_grid};
    use crate::model::Channel;
    use glam::{DAffine3, DMat3, DVec3};

    /// What is written is read again, bit for bit, and lies where it lay.
    #[test]
    fn grids_come_back() {
        let folder = tempfile::tempdir().unwrap();
        let turned = DMat3::from_rotation_z(0.5) * DMat3::from_diagonal(DVec3::new(1.0, 2.0, 3.5));
        for (name, dimensions, sample_type, channels) in [
            ("a.npy", 2, SampleType::U8, 1),
            ("b.npy", 3, SampleType::F64, 1),
            ("c.nrrd", 3, SampleType::I16, 1),
            ("d.nrrd", 3, SampleType::F32, 1),
            ("e.png", 2, SampleType::U8, 4),
            ("f.png", 2, SampleType::U16, 1),
        ] {
            let path = folder.path().join(name);
            let format = GridFormat::of(&path).unwrap();
            let mut grid = Grid::volume([5, 4, 6], sample_type, Channel::of_picture(channels));
            if format == GridFormat::Nrrd {
                grid.to_world = DAffine3::from_mat3_translation(turned, DVec3::new(1.0, -2.0, 0.25));
            }
            if dimensions == 2 {
                grid = Grid::image([5, 4], sample_type, grid.channels);
            }
            let len = grid.bytes().unwrap() as usize;
            let samples: Vec<u8> = (0..len).map(|i| (i * 37 % 251) as u8).collect();
            write_grid(&path, format, &grid, &samples).unwrap();
            let back = open_grid(&path, &GridOptions::default()).unwrap();
            let mut read = vec![0; len];
            back.read(&back.grid().region(), &mut read).unwrap();
            assert_eq!(
                (read, back.grid().shape, back.grid().sample_type),
                (samples, grid.shape, sample_type),
                "{name}"
            );
            if format == GridFormat::Nrrd {
                let apart = back.grid().to_world.matrix3 - grid.to_world.matrix3;
                assert!(apart.to_cols_array().iter().all(|value| value.abs() < 1e-12), "{name}");
            }
        }
        // A layer of a volume is an image, along whichever axis it is thin.
        for shape in [[5, 4, 1], [5, 1, 4], [1, 5, 4]] {
            let layer = Grid::volume(shape, SampleType::U16, Channel::numbered(1));
            let (path, samples) = (folder.path().join("layer.png"), (0..40).collect::<Vec<u8>>());
            assert_eq!(GridFormat::Png.lacks(&layer), None);
            write_grid(&path, GridFormat::Png, &layer, &samples).unwrap();
            let back = open_grid(&path, &GridOptions::default()).unwrap();
            let mut read = vec![0; 40];
            back.read(&back.grid().region(), &mut read).unwrap();
            assert_eq!((back.grid().shape, read), ([5, 4, 1], samples), "{shape:?}");
        }
        let volume = Grid::volume([2, 2, 2], SampleType::U8, Channel::numbered(1));
        let refused = write_grid(&folder.path().join("v.png"), GridFormat::Png, &volume, &[0; 8]).unwrap_err();
        assert!(refused.to_string().contains("found 2 x 2 x 2 of uint8, expected an image"), "{refused}");
    }
}
