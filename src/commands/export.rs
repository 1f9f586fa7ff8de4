//! `deepfield export`: clusters, or particles, in a form that other programs draw.

use super::arguments::{family_name, mode_name, transfer_named};
use super::heights;
use super::render_arguments::{Arguments as RenderArguments, setting_value, splat_count};
use super::request::{Request, open};
use super::{CommandResult, print_line};
use crate::color::transfer::TransferFunction;
use crate::mode::{Mode, SettingValue};
use crate::model::{FamilyName, When};
use std::path::PathBuf;

/// Writes clusters, or particles, as 3D Gaussian splats: a binary PLY file that viewers of such splats read.
///
/// Each splat has the second moments of its cluster, the colour that the transfer function gives it, and the opacity of its column as
/// render's `blend: over` has it. Automatic ranges are those of the picture that render draws. Positions are relative to the middle of
/// the data, which the file's header names.
#[derive(clap::Args, Debug)]
#[command(after_help = "Examples:
  deepfield build snap.hdf5 -o snap.df --hierarchy octree,pca
  deepfield export snap.df --levels clusters -o snap.ply                  the finest clusters
  deepfield export snap.df --splats 1e5 -o few.ply                        the 100 000 that show most
  deepfield export galaxy.df --levels splats --family stars -o stars.ply  every particle, round
  deepfield export galaxy.df --attribute temperature --transfer density-hue -o hot.ply")]
pub struct Arguments {
    /// The page file, source or run, or the URL of a built file.
    pub path: PathBuf,
    /// What is written: clusters with a shape of a file built with --hierarchy pca, or particles as round splats (splats).
    #[arg(long, value_name = "KIND", value_parser = ["clusters", "splats"], default_value = "clusters")]
    pub levels: String,
    /// Write at most N splats, those that show most of all the data [default: the finest].
    #[arg(long, value_name = "N", value_parser = splat_count)]
    pub splats: Option<f64>,
    /// Whose weight is shown; a mode of sums, as `deepfield modes` lists them [default: as render].
    #[arg(long, value_name = "NAME", value_parser = mode_name)]
    pub mode: Option<&'static Mode>,
    /// The family: gas, dark, type2, type3, stars or black-holes; all without it.
    #[arg(long, value_name = "NAME", value_parser = family_name)]
    pub family: Option<FamilyName>,
    /// The attribute that colours the splats.
    #[arg(long, value_name = "NAME")]
    pub attribute: Option<String>,
    /// What colours mean: a preset or a RON file like those in assets/transfer [default: the mode's].
    #[arg(long, value_name = "NAME|FILE.ron", value_parser = transfer_named)]
    pub transfer: Option<TransferFunction>,
    /// Settings in RON (see configs/picture.ron); options on the command line override them.
    #[arg(long, value_name = "FILE.ron")]
    pub config: Option<PathBuf>,
    /// A setting, its value in RON: representative=round. Can be given several times.
    #[arg(long, value_name = "NAME=VALUE", value_parser = setting_value)]
    pub set: Vec<(String, SettingValue)>,
    /// When, of a run: a time, step:12, z:1.5, a:0.4 or last [default: the first step].
    #[arg(long, value_name = "WHEN", allow_hyphen_values = true)]
    pub time: Option<When>,
    /// The file, .ply.
    #[arg(short, long, value_name = "OUT.ply")]
    pub out: PathBuf,
}

/// Exports.
///
/// # Errors
/// When the data cannot be read or has no clusters, or the file not be written.
pub fn run(arguments: &Arguments) -> CommandResult {
    let Arguments { path, levels, splats, mode, family, attribute, transfer, config, set, time, out } = arguments;
    heights::refuse(path, "particles")?;
    let extension = out.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    if !extension.eq_ignore_ascii_case("ply") {
        return Err(format!("{}: expected a name that ends in .ply", out.display()).into());
    }
    let request = RenderArguments {
        path: path.clone(),
        levels: Some(levels.clone()),
        splats: *splats,
        mode: *mode,
        family: *family,
        attribute: attribute.clone(),
        transfer: transfer.clone(),
        config: config.clone(),
        set: set.clone(),
        time: *time,
        ..RenderArguments::default()
    };
    let Request { members, shot, options } = request.request()?;
    // Those of a scene.
    members.iter().try_for_each(|member| heights::refuse(&member.path, "particles"))?;
    let mut session = open(&members, options, [&shot])?;
    let count = session.export_gaussian_splats(&shot, out)?;
    print_line(format_args!("{count} splats in {}", out.display()))?;
    Ok(())
}
