//! Shaders composed as Bevy composes them and validated by naga: deepfield's own, and those of other crates by the same function.
//! No graphics adapter is needed.

use super::{ShaderFile, sources};
use crate::gpu::bloom;
use crate::gpu::front_to_back;
use crate::gpu::splat::compute::pipeline::project_defs;
use crate::gpu::splat::compute::sums::{accumulate_defs, slices_defs};
use crate::gpu::splat::layout::Shape;
use crate::gpu::splat::raster::pipeline::blend_defs;
use crate::gpu::surface;
use crate::gpu::target::target_defs;
use crate::gpu::tiles::constants::walk_defs;
use crate::gpu::tiles::pipelines as tiles;
use crate::gpu::volume::programs::{self as volume, Kind, Step};
use crate::model::Kernel;
use bevy::asset::{AssetId, uuid::Uuid};
use bevy::shader::{Shader, ShaderCache, ShaderCacheError, ShaderCacheSource, ShaderDefVal, ValidateShader};
use std::collections::BTreeSet;
use std::sync::Arc;
use wgpu::naga::Module;
use wgpu::naga::valid::{Capabilities, ValidationFlags, Validator};

/// One way to build a shader.
pub struct Variant {
    /// Its path or name.
    pub path: &'static str,
    /// Its definitions.
    pub defs: Vec<ShaderDefVal>,
    /// Whether it needs subgroups.
    pub subgroup: bool,
    /// Its entry points.
    pub entries: Vec<&'static str>,
}

/// The entry points of a volume shader.
fn entries_of(kind: Kind) -> Vec<&'static str> {
    Step::ALL.into_iter().filter(|step| step.kind() == kind).map(Step::entry).collect()
}

/// All that deepfield's pipelines are made of.
pub fn variants() -> Vec<Variant> {
    let plain = |path, defs, entries: Vec<&'static str>| Variant { path, defs, subgroup: false, entries };
    let mut all = vec![
        plain("splat/project.wgsl", project_defs(false), vec!["count", "place"]),
        plain("splat/project.wgsl", project_defs(true), vec!["count", "place"]),
        plain("splat/overdraw.wgsl", vec![], vec!["count"]),
        plain("splat/scan.wgsl", vec![], vec!["main"]),
        plain("layered/project.wgsl", vec![], vec!["count", "place"]),
        plain("layered/plan.wgsl", vec![], vec!["plan"]),
        plain("layered/blend.wgsl", vec![], vec!["blend"]),
        plain("splat/reconstruct.wgsl", vec![], vec!["main"]),
        plain("bloom/light.wgsl", bloom::defs(), vec!["light"]),
        plain("bloom/spread.wgsl", bloom::defs(), vec!["down", "up", "spread"]),
        plain("measure/reduce.wgsl", vec![], vec!["reduce"]),
        plain("integrals/integrate.wgsl", vec![], vec!["integrate"]),
        plain("splat/upsample.wgsl", vec![], vec!["vertex", "along_x", "along_y"]),
    ];
    for subgroup in [false, true] {
        all.push(plain("splat/slices.wgsl", slices_defs(subgroup), vec!["finish", "merge"]));
    }
    for encoded in [false, true] {
        for path in ["composite/composite.wgsl", "composite/light.wgsl"] {
            all.push(plain(path, target_defs(encoded), vec!["vertex", "fragment"]));
        }
    }
    for kind in tiles::Kind::ALL.into_iter().filter(|kind| *kind != tiles::Kind::Sort) {
        let steps = tiles::Step::ALL.map(tiles::Step::entry);
        let entries = steps.iter().filter(|(of, _)| *of == kind).map(|(_, entry)| *entry).collect();
        all.push(plain(kind.shader(), vec![], entries));
    }
    for path in ["sorted/arrange.wgsl", "over/arrange.wgsl", "spheres/arrange.wgsl"] {
        all.push(plain(path, vec![], vec!["arrange"]));
    }
    for globe in [false, true] {
        for filled in [false, true] {
            let defs = || surface::pipelines::Variant { globe, filled, ..Default::default() }.defs();
            all.push(plain("surface/visible.wgsl", defs(), vec!["cells", "fans", "large"]));
            all.push(plain("surface/raster.wgsl", defs(), vec!["cell", "fan", "point", "number"]));
            all.push(plain("surface/rays.wgsl", defs(), vec!["rays"]));
        }
        // What lies over holes is a membrane, or there are rims, or neither.
        for (filled, rims) in [(false, false), (true, false), (false, true)] {
            for (photo, walls) in [(false, false), (true, false), (false, true), (true, true)] {
                if !(globe && walls) {
                    let defs = surface::pipelines::Variant { globe, filled, photo, rims, walls }.defs();
                    all.push(plain("surface/resolve.wgsl", defs, vec!["resolve"]));
                }
            }
        }
    }
    all.push(plain("spheres/surface.wgsl", vec![], vec!["smooth_hits", "shade"]));
    for is_software in [false, true] {
        all.push(plain("spheres/nearest.wgsl", walk_defs(is_software), vec!["nearest"]));
        for kernel in Kernel::ALL {
            all.push(plain("sorted/blend.wgsl", front_to_back::blend_defs(kernel, is_software), vec!["blend"]));
        }
    }
    for kind in Kind::ALL {
        let mut built = Vec::new();
        let choices = Kernel::ALL.into_iter().flat_map(|kernel| (0..512).map(move |index| (kernel, index)));
        for (kernel, index) in choices {
            let variant = volume::Variant {
                kernel,
                attribute: index & 1 > 0,
                surfaces: index & 2 > 0,
                centered: index & 4 > 0,
                vectors: index & 8 > 0,
                field: index & 16 > 0,
                lit: index & 32 > 0,
                columns: index & 64 > 0,
                smooth: index & 128 > 0,
                covering: index & 256 > 0,
            };
            // Columns have values, and are no samples; surfaces are what is smoothed, or else covers particles' pictures.
            let keeps_none = variant.keeps_faces() && !variant.surfaces;
            let keeps_other = variant.covering && (variant.smooth || variant.field);
            if variant.columns && (variant.field || !variant.attribute) || keeps_none || keeps_other {
                continue;
            }
            let defs = kind.defs(variant);
            if !built.contains(&defs) {
                let subgroup = variant.vectors && kind.has_subgroups();
                all.push(Variant { path: kind.shader(), defs: defs.clone(), subgroup, entries: entries_of(kind) });
                built.push(defs);
            }
        }
    }
    let shapes = Kernel::ALL.into_iter().flat_map(|kernel| {
        [(false, false), (false, true), (true, false), (true, true)].map(|(oblique, ellipsoids)| Shape {
            kernel,
            oblique,
            ellipsoids,
        })
    });
    for shape in shapes {
        all.push(plain("splat/blend.wgsl", blend_defs(shape), vec!["vertex", "fragment"]));
        for (subgroup, layers) in [(false, false), (false, true), (true, false), (true, true)] {
            let defs = accumulate_defs(shape, subgroup, layers);
            all.push(Variant { path: "splat/accumulate.wgsl", defs, subgroup, entries: vec!["main"] });
        }
    }
    all
}

/// Composes shaders; what they import is composed once for all that import it with the same definitions.
pub struct Composer {
    paths: Vec<String>,
    /// Without subgroups, and with them.
    caches: [ShaderCache<Module, ()>; 2],
}

impl Composer {
    /// Of shaders with these paths and texts.
    pub fn new(shaders: &[(&str, String)]) -> Composer {
        let caches = [wgpu::Features::empty(), wgpu::Features::SUBGROUP].map(|features| {
            let mut cache = ShaderCache::new((), features, wgpu::DownlevelFlags::empty(), module_of);
            for (index, (path, text)) in shaders.iter().enumerate() {
                cache.set_shader(id_of(index), Shader::from_wgsl(text.clone(), *path));
            }
            cache
        });
        Composer { paths: shaders.iter().map(|(path, _)| (*path).to_owned()).collect(), caches }
    }

    /// The module of a shader, validated with the least that it may rely on.
    ///
    /// # Errors
    /// What is wrong, where naga knows the place with its file and line.
    pub fn compose(&mut self, variant: &Variant) -> Result<Arc<Module>, String> {
        let index = self.paths.iter().position(|path| path == variant.path);
        let id = id_of(index.ok_or_else(|| format!("no shader {}", variant.path))?);
        let cache = &mut self.caches[usize::from(variant.subgroup)];
        let module = cache.get(0, id, &variant.defs).map_err(|error| match error {
            ShaderCacheError::ProcessShaderError(error) => {
                one_line(&error.emit_to_string(&cache.composer), variant.path)
            }
            error => format!("{}: {error}", variant.path),
        })?;
        let capabilities = if variant.subgroup { Capabilities::SUBGROUP } else { Capabilities::empty() };
        let mut validator = Validator::new(ValidationFlags::all(), capabilities);
        validator.validate(&module).map_err(|error| format!("{}: {:?}", variant.path, error.into_inner()))?;
        for &entry in &variant.entries {
            if !module.entry_points.iter().any(|point| point.name == entry) {
                return Err(format!("{}: no entry point {entry}", variant.path));
            }
        }
        Ok(module)
    }
}

/// What a shader of a number is called among assets.
fn id_of(index: usize) -> AssetId<Shader> {
    AssetId::Uuid { uuid: Uuid::from_u128(index as u128) }
}

/// What is composed is all that is wanted.
fn module_of((): &(), source: ShaderCacheSource<'_>, _: &ValidateShader) -> Result<Module, ShaderCacheError> {
    match source {
        ShaderCacheSource::Naga(module) => Ok(module),
        _ => Err(ShaderCacheError::CreateShaderModule("not WGSL".to_owned())),
    }
}

/// `FILE:LINE:COLUMN: what is wrong` of a message about `path` that shows the place in the file; of some mistakes naga knows none.
fn one_line(message: &str, path: &str) -> String {
    let mut lines = message.lines().map(str::trim);
    let what = lines.next().unwrap_or_default().trim_start_matches("error:").trim();
    let place = message.lines().find_map(|line| line.split_once("\u{250c}\u{2500} ").map(|(_, place)| place.trim()));
    // Below the place stand what is meant and, last, why.
    let why: Vec<&str> = lines.filter_map(|line| line.split_once("= ").map(|(_, why)| why.trim())).collect();
    let what = [&[what], &why[..]].concat().join(": ");
    format!("{}: {what}", place.unwrap_or(path))
}

/// The texts of deepfield's shaders and of `files`.
pub fn texts(files: &[ShaderFile]) -> Vec<(&'static str, String)> {
    let own = sources().map(|(path, text)| (path, text.into_owned()));
    own.chain(files.iter().map(|file| (file.name, file.text.to_owned()))).collect()
}

/// Every way in which pipelines build one of `files`.
pub fn variants_of(files: &[ShaderFile]) -> Vec<Variant> {
    let of = |file: &ShaderFile| {
        let name = file.name;
        (file.variants)().into_iter().map(move |variant| Variant { path: name, ..variant })
    };
    files.iter().flat_map(of).collect()
}

/// Composes and validates shaders of another crate, among deepfield's, for every set of definitions that their pipelines use:
/// for a test in that crate.
///
/// # Errors
/// The first mistake; an entry point that no pipeline uses is one.
pub fn check(files: &[ShaderFile]) -> Result<(), String> {
    let mut composer = Composer::new(&texts(files));
    for variant in variants_of(files) {
        let module = composer.compose(&variant)?;
        let names: BTreeSet<&str> = module.entry_points.iter().map(|point| point.name.as_str()).collect();
        if names != variant.entries.iter().copied().collect() {
            return Err(format!("{}: entry points {names:?}, expected {:?}", variant.path, variant.entries));
        }
    }
    Ok(())
}
