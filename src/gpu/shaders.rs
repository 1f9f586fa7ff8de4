//! The shaders, embedded in the program so that an installed one needs no folder beside it.

use super::splat::constants;
use super::{surface, tiles, volume};
use bevy::asset::io::embedded::EmbeddedAssetRegistry;
use bevy::prelude::*;
use bevy::shader::Shader;
use std::borrow::Cow;
use std::path::{Path, PathBuf};

pub mod check;
#[cfg(test)]
mod tests;

pub use check::{Variant, check};

/// A shader of another crate.
#[derive(Clone, Copy, Debug)]
pub struct ShaderFile {
    /// The name that it is loaded by ([`load`]) and that messages call it, such as `my-mode/pass.wgsl`.
    pub name: &'static str,
    /// Its text.
    pub text: &'static str,
    /// Where that is written: the running window takes up what changes there.
    pub file: &'static str,
    /// All that its pipelines are made of; `path` says nothing there.
    pub variants: fn() -> Vec<Variant>,
}

/// The shaders of other crates in an application.
#[derive(Resource, Clone, Debug, Default)]
pub struct ShaderFiles(pub Vec<ShaderFile>);

/// Adds a shader of another crate to an application, for its plugin.
pub fn add(app: &mut App, file: ShaderFile) {
    embed(app, file.name, file.text.as_bytes().to_vec());
    let handle = load(app.world().resource::<AssetServer>(), file.name);
    app.world_mut().get_resource_or_init::<ShaderFiles>().0.push(file);
    app.world_mut().get_resource_or_init::<ShaderLibrary>().0.push(handle);
}

/// Puts a text among the embedded assets.
fn embed(app: &mut App, path: &str, text: Vec<u8>) {
    let full = Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders").join(path);
    let registry = app.world_mut().resource_mut::<EmbeddedAssetRegistry>();
    registry.insert_asset(full, &PathBuf::from("deepfield").join(path), text);
}

/// Every shader that is a file: its path under `shaders/` and its text.
pub const SHADERS: &[(&str, &str)] = &[
    ("lib/splat_view.wgsl", include_str!("../../shaders/lib/splat_view.wgsl")),
    ("lib/sample.wgsl", include_str!("../../shaders/lib/sample.wgsl")),
    ("lib/particle.wgsl", include_str!("../../shaders/lib/particle.wgsl")),
    ("lib/ellipsoid.wgsl", include_str!("../../shaders/lib/ellipsoid.wgsl")),
    ("lib/projection.wgsl", include_str!("../../shaders/lib/projection.wgsl")),
    ("lib/kernel.wgsl", include_str!("../../shaders/lib/kernel.wgsl")),
    ("lib/small_ellipse.wgsl", include_str!("../../shaders/lib/small_ellipse.wgsl")),
    ("splat/project.wgsl", include_str!("../../shaders/splat/project.wgsl")),
    ("lib/rectangle.wgsl", include_str!("../../shaders/lib/rectangle.wgsl")),
    ("splat/overdraw.wgsl", include_str!("../../shaders/splat/overdraw.wgsl")),
    ("splat/scan.wgsl", include_str!("../../shaders/splat/scan.wgsl")),
    ("splat/accumulate.wgsl", include_str!("../../shaders/splat/accumulate.wgsl")),
    ("splat/slices.wgsl", include_str!("../../shaders/splat/slices.wgsl")),
    ("splat/blend.wgsl", include_str!("../../shaders/splat/blend.wgsl")),
    ("splat/upsample.wgsl", include_str!("../../shaders/splat/upsample.wgsl")),
    ("splat/reconstruct.wgsl", include_str!("../../shaders/splat/reconstruct.wgsl")),
    ("lib/volume_view.wgsl", include_str!("../../shaders/lib/volume_view.wgsl")),
    ("lib/prefix.wgsl", include_str!("../../shaders/lib/prefix.wgsl")),
    ("volume/project.wgsl", include_str!("../../shaders/volume/project.wgsl")),
    ("volume/bin.wgsl", include_str!("../../shaders/volume/bin.wgsl")),
    ("volume/scan.wgsl", include_str!("../../shaders/volume/scan.wgsl")),
    ("volume/sort.wgsl", include_str!("../../shaders/volume/sort.wgsl")),
    ("volume/plan.wgsl", include_str!("../../shaders/volume/plan.wgsl")),
    ("volume/gather.wgsl", include_str!("../../shaders/volume/gather.wgsl")),
    ("lib/volume_bricks.wgsl", include_str!("../../shaders/lib/volume_bricks.wgsl")),
    ("lib/volume_cells.wgsl", include_str!("../../shaders/lib/volume_cells.wgsl")),
    ("volume/choose.wgsl", include_str!("../../shaders/volume/choose.wgsl")),
    ("volume/interpolate.wgsl", include_str!("../../shaders/volume/interpolate.wgsl")),
    ("volume/measure.wgsl", include_str!("../../shaders/volume/measure.wgsl")),
    ("volume/occlusion.wgsl", include_str!("../../shaders/volume/occlusion.wgsl")),
    ("volume/raycast.wgsl", include_str!("../../shaders/volume/raycast.wgsl")),
    ("volume/smooth.wgsl", include_str!("../../shaders/volume/smooth.wgsl")),
    ("lib/isosurface.wgsl", include_str!("../../shaders/lib/isosurface.wgsl")),
    ("volume/march.wgsl", include_str!("../../shaders/volume/march.wgsl")),
    ("lib/field_samples.wgsl", include_str!("../../shaders/lib/field_samples.wgsl")),
    ("lib/field_slope.wgsl", include_str!("../../shaders/lib/field_slope.wgsl")),
    ("volume/field.wgsl", include_str!("../../shaders/volume/field.wgsl")),
    ("volume/column.wgsl", include_str!("../../shaders/volume/column.wgsl")),
    ("integrals/integrate.wgsl", include_str!("../../shaders/integrals/integrate.wgsl")),
    ("lib/srgb.wgsl", include_str!("../../shaders/lib/srgb.wgsl")),
    ("lib/colored.wgsl", include_str!("../../shaders/lib/colored.wgsl")),
    ("lib/bloom.wgsl", include_str!("../../shaders/lib/bloom.wgsl")),
    ("bloom/light.wgsl", include_str!("../../shaders/bloom/light.wgsl")),
    ("bloom/spread.wgsl", include_str!("../../shaders/bloom/spread.wgsl")),
    ("lib/frame.wgsl", include_str!("../../shaders/lib/frame.wgsl")),
    ("composite/light.wgsl", include_str!("../../shaders/composite/light.wgsl")),
    ("measure/reduce.wgsl", include_str!("../../shaders/measure/reduce.wgsl")),
    ("lib/tile_view.wgsl", include_str!("../../shaders/lib/tile_view.wgsl")),
    ("lib/tile_walk.wgsl", include_str!("../../shaders/lib/tile_walk.wgsl")),
    ("lib/matter.wgsl", include_str!("../../shaders/lib/matter.wgsl")),
    ("sort/scan.wgsl", include_str!("../../shaders/sort/scan.wgsl")),
    ("tiles/gather.wgsl", include_str!("../../shaders/tiles/gather.wgsl")),
    ("tiles/plan.wgsl", include_str!("../../shaders/tiles/plan.wgsl")),
    ("tiles/pairs.wgsl", include_str!("../../shaders/tiles/pairs.wgsl")),
    ("sorted/arrange.wgsl", include_str!("../../shaders/sorted/arrange.wgsl")),
    ("over/arrange.wgsl", include_str!("../../shaders/over/arrange.wgsl")),
    ("sorted/blend.wgsl", include_str!("../../shaders/sorted/blend.wgsl")),
    ("lib/sphere_view.wgsl", include_str!("../../shaders/lib/sphere_view.wgsl")),
    ("spheres/arrange.wgsl", include_str!("../../shaders/spheres/arrange.wgsl")),
    ("spheres/nearest.wgsl", include_str!("../../shaders/spheres/nearest.wgsl")),
    ("spheres/surface.wgsl", include_str!("../../shaders/spheres/surface.wgsl")),
    ("lib/tile_reach.wgsl", include_str!("../../shaders/lib/tile_reach.wgsl")),
    ("lib/splat_pixel.wgsl", include_str!("../../shaders/lib/splat_pixel.wgsl")),
    ("lib/layer_view.wgsl", include_str!("../../shaders/lib/layer_view.wgsl")),
    ("lib/layer_group.wgsl", include_str!("../../shaders/lib/layer_group.wgsl")),
    ("lib/splat_bins.wgsl", include_str!("../../shaders/lib/splat_bins.wgsl")),
    ("layered/plan.wgsl", include_str!("../../shaders/layered/plan.wgsl")),
    ("layered/project.wgsl", include_str!("../../shaders/layered/project.wgsl")),
    ("layered/blend.wgsl", include_str!("../../shaders/layered/blend.wgsl")),
    ("lib/surface_view.wgsl", include_str!("../../shaders/lib/surface_view.wgsl")),
    ("lib/surface_seen.wgsl", include_str!("../../shaders/lib/surface_seen.wgsl")),
    ("lib/surface_ray.wgsl", include_str!("../../shaders/lib/surface_ray.wgsl")),
    ("lib/surface_levels.wgsl", include_str!("../../shaders/lib/surface_levels.wgsl")),
    ("lib/surface_globe.wgsl", include_str!("../../shaders/lib/surface_globe.wgsl")),
    ("lib/surface_point.wgsl", include_str!("../../shaders/lib/surface_point.wgsl")),
    ("lib/surface_cast.wgsl", include_str!("../../shaders/lib/surface_cast.wgsl")),
    ("lib/surface_cells.wgsl", include_str!("../../shaders/lib/surface_cells.wgsl")),
    ("lib/surface_blocks.wgsl", include_str!("../../shaders/lib/surface_blocks.wgsl")),
    ("lib/surface_margin.wgsl", include_str!("../../shaders/lib/surface_margin.wgsl")),
    ("lib/surface_look.wgsl", include_str!("../../shaders/lib/surface_look.wgsl")),
    ("lib/surface_photo.wgsl", include_str!("../../shaders/lib/surface_photo.wgsl")),
    ("lib/surface_rim.wgsl", include_str!("../../shaders/lib/surface_rim.wgsl")),
    ("lib/surface_wall.wgsl", include_str!("../../shaders/lib/surface_wall.wgsl")),
    ("lib/surface_light.wgsl", include_str!("../../shaders/lib/surface_light.wgsl")),
    ("surface/visible.wgsl", include_str!("../../shaders/surface/visible.wgsl")),
    ("surface/rays.wgsl", include_str!("../../shaders/surface/rays.wgsl")),
    ("surface/raster.wgsl", include_str!("../../shaders/surface/raster.wgsl")),
    ("surface/resolve.wgsl", include_str!("../../shaders/surface/resolve.wgsl")),
    ("composite/composite.wgsl", include_str!("../../shaders/composite/composite.wgsl")),
];

/// Every shader: those that are files, and the constants that Rust shares with them.
pub fn sources() -> impl Iterator<Item = (&'static str, Cow<'static, str>)> {
    let files = SHADERS.iter().map(|&(path, text)| (path, Cow::Borrowed(text)));
    let volume = (volume::constants::PATH, Cow::Owned(volume::constants::wgsl()));
    let tiles = (tiles::constants::PATH, Cow::Owned(tiles::constants::wgsl()));
    let surface = (surface::constants::PATH, Cow::Owned(surface::constants::wgsl()));
    files.chain([(constants::PATH, Cow::Owned(constants::wgsl())), volume, tiles, surface])
}

/// The shaders that others import; held, or the imports would never resolve.
#[derive(Resource, Default)]
struct ShaderLibrary(Vec<Handle<Shader>>);

/// Embeds all shaders and loads those that others import.
pub struct ShaderPlugin;

impl Plugin for ShaderPlugin {
    fn build(&self, app: &mut App) {
        for (path, text) in sources() {
            embed(app, path, text.into_owned().into_bytes());
        }
        let server = app.world().resource::<AssetServer>();
        let library =
            sources().filter(|(path, _)| path.starts_with("lib/")).map(|(path, _)| load(server, path)).collect();
        app.insert_resource(ShaderLibrary(library));
    }
}

/// The handle of an embedded shader by its path under `shaders/`.
pub fn load(server: &AssetServer, path: &str) -> Handle<Shader> {
    server.load(format!("embedded://deepfield/{path}"))
}
