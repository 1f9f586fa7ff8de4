//! `deepfield synth surface`.

use crate::commands::CommandResult;
use crate::commands::arguments::{not_negative, positive};
use crate::commands::progress_bar::TerminalProgress;
use crate::heights::synth::{SurfaceOptions, SurfaceShape, write_surface};
use crate::model::{SampleType, Unit};
use std::path::Path;

/// What surface is made.
#[derive(clap::Args, Clone, Debug, Default)]
#[command(next_help_heading = "Height fields")]
pub struct SurfaceArguments {
    /// Its shape: sphere-cap, sines, step, plane, fbm (fractional Brownian motion) or holes [default: fbm].
    #[arg(long, value_name = "SHAPE")]
    pub shape: Option<SurfaceShape>,
    /// How samples are stored: i8, u8, i16, u16, i32, u32, f32 or f64 [default: f32].
    #[arg(long, value_name = "TYPE")]
    pub r#type: Option<SampleType>,
    /// From a column and a row to the next [default: 1,1].
    #[arg(long, value_name = "DX,DY", value_delimiter = ',', allow_hyphen_values = true)]
    pub spacing: Vec<f64>,
    /// Unit of places and heights: km, m, mm, um or nm; deg is of places alone [default: none].
    #[arg(long, value_name = "UNIT")]
    pub unit: Option<String>,
    /// The share of samples that were not measured, at random places [default: 0].
    #[arg(long, value_name = "SHARE", value_parser = share, allow_hyphen_values = true)]
    pub invalid: Option<f64>,
    /// Standard deviation of noise on every sample [default: 0].
    #[arg(long, value_name = "HEIGHT", value_parser = not_negative, allow_hyphen_values = true)]
    pub noise: Option<f64>,
    /// Hurst exponent of fbm and holes, between 0 and 1: small is rough [default: 0.8].
    #[arg(long, value_name = "H", value_parser = positive, allow_hyphen_values = true)]
    pub hurst: Option<f64>,
}

fn share(text: &str) -> Result<f64, String> {
    let share = text.parse().ok().filter(|share: &f64| (0.0..1.0).contains(share));
    share.ok_or_else(|| "expected a share from 0 to below 1".into())
}

impl SurfaceArguments {
    /// Whether anything is said.
    pub fn is_given(&self) -> bool {
        let SurfaceArguments { shape, r#type, spacing, unit, invalid, noise, hurst } = self;
        let numbers = [*invalid, *noise, *hurst];
        shape.is_some()
            || r#type.is_some()
            || !spacing.is_empty()
            || unit.is_some()
            || numbers.iter().any(Option::is_some)
    }
}

/// Writes a surface of so many columns and rows.
///
/// # Errors
/// When what is asked for cannot be, or the file cannot be written.
pub fn run(arguments: &SurfaceArguments, [columns, rows]: [u64; 2], seed: u64, output: &Path) -> CommandResult {
    let usual = SurfaceOptions::new(arguments.shape.unwrap_or(SurfaceShape::Fbm), columns, rows);
    let spacing = match arguments.spacing[..] {
        [] => usual.spacing,
        [x, y] => [x, y],
        _ => return Err("--spacing: expected two numbers, dx,dy".into()),
    };
    let options = SurfaceOptions {
        spacing,
        seed,
        unit: arguments.unit.clone().map_or(usual.unit, Unit::new),
        sample_type: arguments.r#type.unwrap_or(usual.sample_type),
        invalid: arguments.invalid.unwrap_or(usual.invalid),
        noise: arguments.noise.unwrap_or(usual.noise),
        hurst: arguments.hurst.unwrap_or(usual.hurst),
        ..usual
    };
    Ok(write_surface(&options, output, &TerminalProgress::new())?)
}
