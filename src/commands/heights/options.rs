//! What the user says of a height field in place of its file, and which files are height fields.

use crate::commands::arguments::Given;
use crate::heights::model::{HeightError, HeightGrid, Lengths};
use crate::heights::{OpenHeights, is_heights};
use crate::import::ImportError;
use crate::look::{HeightsSaid, TakenFor};
use crate::model::{ReadMethod, Unit};
use crate::modes::surface::radius_of;
use std::path::Path;

/// What a file that could be several things is taken for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Kind {
    /// Particles.
    Particles,
    /// An image or a volume.
    Image,
    /// Measured heights.
    Heights,
}

/// Options of height fields.
#[derive(clap::Args, Clone, Debug, Default)]
#[command(next_help_heading = "Height fields")]
pub struct HeightsOptions {
    /// What the file holds, where its content leaves that open: an array or a grey picture is an image, or heights [default: arrays of
    /// more than 8 bits are heights].
    #[arg(long, value_name = "WHAT", value_enum)]
    pub kind: Option<Kind>,
    /// The stored value of samples that were not measured, in place of what the file says.
    #[arg(long, value_name = "VALUE", allow_hyphen_values = true)]
    pub nodata: Option<f64>,
    /// Unit of x and y: km, m, mm, um, nm or deg [default: the file's].
    #[arg(long, value_name = "UNIT")]
    pub xy_unit: Option<String>,
    /// Unit of heights: km, m, mm, um or nm [default: the file's].
    #[arg(long, value_name = "UNIT")]
    pub height_unit: Option<String>,
}

/// Distances of samples, of commands that read no other files without a header.
#[derive(clap::Args, Clone, Debug, Default)]
#[command(next_help_heading = "Height fields")]
pub struct SpacingOptions {
    /// Distances of columns and of rows, above 0 [default: the file's].
    #[arg(long, value_name = "DX,DY", value_delimiter = ',', allow_hyphen_values = true)]
    pub spacing: Vec<f64>,
}

impl HeightsOptions {
    /// Whether the file at `path` is taken for heights, built or not.
    pub fn takes(&self, path: &Path) -> bool {
        match self.kind {
            Some(Kind::Heights) => true,
            Some(Kind::Image | Kind::Particles) => false,
            None => is_heights(path),
        }
    }

    /// What no other data takes, and what of it is given.
    pub fn given(&self) -> [Given; 3] {
        [
            ("--nodata", self.nodata.is_some()),
            ("--xy-unit", self.xy_unit.is_some()),
            ("--height-unit", self.height_unit.is_some()),
        ]
    }

    /// What is said; `spacing` is what `--spacing` says.
    pub fn said(&self, spacing: &[f64]) -> HeightsSaid {
        let unit = |name: &Option<String>| name.clone().map(Unit::new);
        // What is not two numbers is refused with the option's name.
        let spacing = match *spacing {
            [] => None,
            [x, y] => Some([x, y]),
            _ => Some([f64::NAN; 2]),
        };
        HeightsSaid {
            taken_for: self.kind.map(|kind| match kind {
                Kind::Particles => TakenFor::Particles,
                Kind::Image => TakenFor::Image,
                Kind::Heights => TakenFor::Heights,
            }),
            nodata: self.nodata,
            spacing,
            xy_unit: unit(&self.xy_unit),
            height_unit: unit(&self.height_unit),
            texture: None,
            before: None,
            derive: Vec::new(),
        }
    }

    /// Opens the file.
    ///
    /// # Errors
    /// When it cannot be read, or what is said of it cannot be.
    pub fn open(&self, path: &Path, spacing: &[f64], read: ReadMethod) -> Result<OpenHeights, HeightError> {
        if let Some(kind @ (Kind::Particles | Kind::Image)) = self.kind {
            let found = if kind == Kind::Image { "image" } else { "particles" };
            return Err(ImportError::malformed(path, "--kind", found, "heights, as nothing else is asked for").into());
        }
        OpenHeights::open(path, &self.said(spacing).options(read))
    }
}

/// All that is said of heights where nothing is drawn or built.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct StatedOptions {
    /// What they are.
    #[command(flatten)]
    pub heights: HeightsOptions,
    /// How far their samples are apart.
    #[command(flatten)]
    pub spacing: SpacingOptions,
}

impl StatedOptions {
    /// Whether the file at `path` is taken for heights, built or not.
    pub fn takes(&self, path: &Path) -> bool {
        self.heights.takes(path)
    }

    /// What no other data takes, and what of it is given.
    pub fn given(&self) -> [Given; 4] {
        let [no_data, xy, height] = self.heights.given();
        [no_data, xy, height, ("--spacing", !self.spacing.spacing.is_empty())]
    }

    /// Opens the file.
    ///
    /// # Errors
    /// As [`HeightsOptions::open`].
    pub fn open(&self, path: &Path) -> Result<OpenHeights, HeightError> {
        self.heights.open(path, &self.spacing.spacing, ReadMethod::default())
    }

    /// Opens the file as pictures show it; with a note where that takes x and y for what they are not said to be.
    ///
    /// # Errors
    /// As [`OpenHeights::for_pictures`].
    pub fn open_for_pictures(&self, path: &Path) -> Result<(OpenHeights, Option<String>), HeightError> {
        OpenHeights::for_pictures(path, &self.heights.said(&self.spacing.spacing).options(ReadMethod::default()))
    }
}

/// Lengths of a grid whose degrees are those of the body that `--map` names, else of the Earth.
///
/// # Errors
/// A map that is not known, or does not fit the grid's units.
pub fn lengths(path: &Path, map: Option<&str>, grid: &HeightGrid) -> Result<Lengths, String> {
    let radius = map.map(|map| radius_of(map, grid)).transpose();
    let radius = radius.map_err(|why| format!("{}: {why}", path.display()))?.flatten();
    Ok(radius.map_or_else(|| Lengths::of(grid), |radius| Lengths::on(grid, radius)))
}
