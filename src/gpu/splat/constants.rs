//! What Rust and the shaders both need, written as a shader module: one source, and constants that a shader's compiler
//! sees. (A software driver fetches a uniform for each lane every time that it is used.)

use super::layout::{RECONSTRUCTION, SAMPLED_RADIUS, TILE, reconstruction_window};
use super::profile::Profile;
use crate::cpu::kernel_products::HeightMoments;
use crate::model::Kernel;
use bevy::shader::ShaderDefVal;

/// Path of the module among the shaders.
pub const PATH: &str = "lib/constants.wgsl";

/// The definition that selects a kernel's constants.
pub fn kernel_defs(kernel: Kernel) -> Vec<ShaderDefVal> {
    match kernel {
        Kernel::CubicSpline => vec![],
        Kernel::Poly6 => vec!["POLY6".into()],
    }
}

/// The module `deepfield::constants`.
pub fn wgsl() -> String {
    let mut text = String::from("#define_import_path deepfield::constants\n");
    line(&mut text, "SAMPLED_RADIUS", &[SAMPLED_RADIUS]);
    for (index, weights) in reconstruction_window().iter().enumerate() {
        line(&mut text, &format!("WINDOW_{index}"), weights);
    }
    let (low, high) = RECONSTRUCTION.split_at(4);
    line(&mut text, "TAPS_LOW", low);
    line(&mut text, "TAPS_HIGH", high);
    text += &format!("const TILE: u32 = {TILE}u;\n#ifdef POLY6\n");
    profile(&mut text, Kernel::Poly6);
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
