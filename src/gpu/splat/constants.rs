//! What Rust and the shaders both need, written as a shader module: one source, and constants that a shader's compiler
//! sees. (A software driver fetches a uniform for each lane every time that it is used.)

use super::layout::{RECONSTRUCTION, TILE, reconstruction_window};
use super::profile::Profile;
use crate::cpu::kernel_products::HeightMoments;
use crate::model::Kernel;
use bevy::shader::ShaderDefVal;

/// Path of the module among the shaders.
pub const PATH: &str = "lib/constants.wgsl";

/// The definition that selects a kernel's constants and code; the cubic spline, which has none, is what shaders are built with that
/// have no kernel.
pub fn kernel_defs(kernel: Kernel) -> Vec<ShaderDefVal> {
    definition(kernel).map(ShaderDefVal::from).into_iter().collect()
}

/// Its name.
fn definition(kernel: Kernel) -> Option<&'static str> {
    match kernel {
        Kernel::CubicSpline => None,
        Kernel::Poly6 => Some("POLY6"),
        Kernel::QuarticSpline => Some("QUARTIC_SPLINE"),
        Kernel::QuinticSpline => Some("QUINTIC_SPLINE"),
        Kernel::WendlandC2 => Some("WENDLAND_C2"),
        Kernel::WendlandC4 => Some("WENDLAND_C4"),
        Kernel::WendlandC6 => Some("WENDLAND_C6"),
    }
}

/// The module `deepfield::constants`.
pub fn wgsl() -> String {
    let mut text = String::from("#define_import_path deepfield::constants\n");
    for (index, weights) in reconstruction_window().iter().enumerate() {
        line(&mut text, &format!("WINDOW_{index}"), weights);
    }
    let (low, high) = RECONSTRUCTION.split_at(4);
    line(&mut text, "TAPS_LOW", low);
    line(&mut text, "TAPS_HIGH", high);
    text += &format!("const TILE: u32 = {TILE}u;\n");
    let mut before = "#ifdef ";
    for kernel in Kernel::ALL {
        if let Some(definition) = definition(kernel) {
            text += &format!("{before}{definition}\n");
            profile(&mut text, kernel);
            before = "#else ifdef ";
        }
    }
    text += "#else\n";
    profile(&mut text, Kernel::CubicSpline);
    text += "#endif\n";
    text
}

/// A constant of one to four numbers.
fn line(text: &mut String, name: &str, values: &[f32]) {
    let literals = values.iter().map(|value| format!("{value:e}")).collect::<Vec<_>>().join(", ");
    *text += &match values.len() {
        1 => format!("const {name}: f32 = {literals};\n"),
        n => format!("const {name}: vec{n}<f32> = vec{n}<f32>({literals});\n"),
    };
}

/// A kernel's coefficients.
fn profile(text: &mut String, kernel: Kernel) {
    let profile = Profile::of(kernel);
    let curvature = profile.curvature();
    for (name, rows) in [("PROFILE", &profile.profile), ("LAPLACIAN", &profile.laplacian), ("CURVATURE", &curvature)] {
        line(text, &format!("{name}_A"), &rows[0]);
        line(text, &format!("{name}_B"), &rows[1]);
        line(text, &format!("{name}_C"), &rows[2][..2]);
    }
    let moments = HeightMoments::of(kernel);
    let whole = [&profile.first, &profile.second, &moments.mass, &moments.mean, &moments.square];
    for (name, all) in ["FIRST", "SECOND", "MASS", "MEAN", "SQUARE"].into_iter().zip(whole) {
        let (low, high) = all.split_at(4);
        line(text, &format!("{name}_A"), low);
        line(text, &format!("{name}_B"), high);
    }
    for (name, rows) in [("SHEAR", &profile.shear), ("BEND", &profile.bend)] {
        line(text, &format!("{name}_A"), &rows[0]);
        line(text, &format!("{name}_B"), &rows[1]);
    }
}
