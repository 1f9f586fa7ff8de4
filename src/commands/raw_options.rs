//! What a file without a header holds, on the command line.

use crate::import::grid::RawGrid;
use crate::model::{SampleType, Unit};

/// Options of files that are samples and nothing else.
#[derive(clap::Args, Clone, Debug, Default, PartialEq)]
#[command(next_help_heading = "Samples without a header")]
pub struct RawOptions {
    /// Samples along each axis, the fastest first: W,H of an image or W,H,D of a volume [default: as FILE.ron says].
    #[arg(long, value_name = "W,H[,D]", value_delimiter = ',')]
    pub shape: Vec<u64>,
    /// How each sample is stored: i8, u8, i16, u16, i32, u32, i64, u64, f32 or f64.
    #[arg(long, value_name = "TYPE", requires = "shape")]
    pub r#type: Option<SampleType>,
    /// Distance of samples along each axis, of heights too [default: 1].
    #[arg(long, value_name = "X,Y[,Z]", value_delimiter = ',', allow_hyphen_values = true)]
    pub spacing: Vec<f64>,
    /// The most significant byte of a sample comes first.
    #[arg(long, requires = "shape")]
    pub big_endian: bool,
    /// Values of a sample, side by side.
    #[arg(long, value_name = "N", default_value_t = 1, requires = "shape")]
    pub channels: u64,
    /// Bytes before the first sample.
    #[arg(long, value_name = "BYTES", default_value_t = 0, requires = "shape")]
    pub skip: u64,
}

impl RawOptions {
    /// What they say; `None` without a shape.
    ///
    /// # Errors
    /// One line where the type is missing.
    pub fn grid(&self) -> Result<Option<RawGrid>, String> {
        if self.shape.is_empty() {
            return Ok(None);
        }
        let sample_type = self.r#type.ok_or("--type: missing, expected the type of the samples beside --shape")?;
        Ok(Some(RawGrid {
            shape: self.shape.clone(),
            sample_type,
            spacing: self.spacing.clone(),
            big_endian: self.big_endian,
            channels: self.channels,
            offset: self.skip,
            length_unit: Unit::default(),
        }))
    }
}
