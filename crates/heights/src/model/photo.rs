//! A photo that lies over a height field.

use super::{HeightError, HeightGrid, units};
use std::path::PathBuf;

/// Where a photo's outer edges are, counted in rows and columns of the field's samples, with fractions. Its rows and columns run as the field's do;
/// its first row begins at `rows[0]`, its last ends at `rows[1]`, and so with columns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotoPlace {
    /// The upper and the lower edge, in ascending order.
    pub rows: [f64; 2],
    /// The left and the right edge, in ascending order.
    pub columns: [f64; 2],
}

impl PhotoPlace {
    /// From the field's first sample to its last, which are on the photo's edges.
    pub fn whole(grid: &HeightGrid) -> PhotoPlace {
        PhotoPlace { rows: [0.0, (grid.rows - 1) as f64], columns: [0.0, (grid.columns - 1) as f64] }
    }

    /// Whether it has an area, and numbers that can be counted with.
    pub fn is_sound(&self) -> bool {
        let [rows, columns] = [self.rows, self.columns];
        rows[0] < rows[1] && columns[0] < columns[1] && rows.iter().chain(&columns).all(|edge| edge.abs() < 1e15)
    }

    /// After how many columns a photo repeats: where columns are degrees of longitude, after 360 of them. Nothing where it does not, and where the
    /// field goes round many times, which is no globe.
    pub fn period(&self, grid: &HeightGrid) -> Option<f64> {
        let period = 360.0 / grid.step[0].abs();
        // Rounding of places may make a photo of the whole globe a little wider.
        let is_narrow = self.columns[1] - self.columns[0] <= period * (1.0 + 1e-9);
        let is_globe = units::is_degrees(&grid.xy_unit) && grid.columns as f64 <= 8.0 * period;
        (is_globe && is_narrow).then_some(period)
    }
}

/// What is known of a photo.
#[derive(Clone, Debug, PartialEq)]
pub struct PhotoAbout {
    /// The file that was named.
    pub path: PathBuf,
    /// The format's name: `jpeg`, `png`, ...
    pub format: String,
    /// Size of the file, bytes.
    pub bytes: u64,
    /// Rows and columns of its pixels; at least 1.
    pub size: [u64; 2],
    /// Whether it has one value a pixel in place of red, green and blue.
    pub is_grey: bool,
    /// Where it lies.
    pub place: PhotoPlace,
}

impl PhotoAbout {
    /// Values of a pixel.
    pub fn planes(&self) -> usize {
        if self.is_grey { 1 } else { 3 }
    }
}

/// A photo whose rows are read. Several threads may read at once.
pub trait PhotoRows: Send + Sync {
    /// What is known of it.
    fn about(&self) -> &PhotoAbout;

    /// Bytes of memory that it takes as long as it is open.
    fn memory_bytes(&self) -> u64;

    /// Reads `count` rows of pixels from row `first` on: [`PhotoAbout::planes`] values a pixel, 8 bits as pictures have them, side by side.
    /// `out` holds exactly as many.
    ///
    /// # Errors
    /// Where they cannot be read.
    fn rows(&self, first: u64, count: u64, out: &mut [u8]) -> Result<(), HeightError>;
}

impl<P: PhotoRows + ?Sized> PhotoRows for &P {
    fn about(&self) -> &PhotoAbout {
        (**self).about()
    }

    fn memory_bytes(&self) -> u64 {
        (**self).memory_bytes()
    }

    fn rows(&self, first: u64, count: u64, out: &mut [u8]) -> Result<(), HeightError> {
        (**self).rows(first, count, out)
    }
}
