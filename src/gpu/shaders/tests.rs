//! Every shader, composed as Bevy composes it and validated by naga, for every set of definitions that a pipeline uses;
//! and what it reads, compared with what the program writes. No graphics adapter is needed.

mod layouts;

use super::SHADERS;
use super::check::{Composer, Variant, variants};
use layouts::buffers_are_laid_out_as_the_program_writes_them;
use std::collections::BTreeSet;
use std::sync::Arc;
use wgpu::naga::Module;

/// Every variant's module.
fn modules() -> Vec<(Variant, Arc<Module>)> {
    let mut composer = Composer::new(&super::check::texts(&[]));
    let build = |variant: Variant| match composer.compose(&variant) {
        Ok(module) => (variant, module),
        Err(error) => panic!("{} with {:?}: {error}", variant.path, variant.defs),
    };
    variants().into_iter().map(build).collect()
}

/// In one test, since nothing takes as long as to build every variant.
#[test]
fn every_variant_of_every_shader_is_valid_and_laid_out_as_the_program_writes() {
    let built = modules();
    every_entry_point_is_used(&built);
    buffers_are_laid_out_as_the_program_writes_them(&built);
}

fn every_entry_point_is_used(built: &[(Variant, Arc<Module>)]) {
    let mut seen: BTreeSet<&str> = built.iter().map(|(variant, _)| variant.path).collect();
    seen.extend(SHADERS.iter().map(|(path, _)| *path).filter(|path| path.starts_with("lib/")));
    assert_eq!(seen, SHADERS.iter().map(|(path, _)| *path).collect(), "a shader that no variant builds");
    for (variant, module) in built {
        let names: BTreeSet<&str> = module.entry_points.iter().map(|point| point.name.as_str()).collect();
        assert_eq!(
            names,
            variant.entries.iter().copied().collect(),
            "{}: an entry point that nothing uses",
            variant.path
        );
    }
}

#[test]
fn every_file_under_shaders_is_embedded() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("shaders");
    let mut found = BTreeSet::new();
    let mut folders = vec![root.clone()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                found.insert(path.strip_prefix(&root).unwrap().to_str().unwrap().replace('\\', "/"));
            }
        }
    }
    assert_eq!(found, SHADERS.iter().map(|(path, _)| (*path).to_owned()).collect());
}

#[test]
fn broken_shaders_are_found() {
    let breaks: [(&str, &str, &str); 5] = [
        ("splat/scan.wgsl", "var sum = 0u;", "var sum = 0u"),
        ("splat/scan.wgsl", "sum += starts[i];", "sum += 1.0;"),
        ("splat/accumulate.wgsl", "evaluate(profile, u_top)", "evaluate(u_top, profile)"),
        ("lib/kernel.wgsl", "return v * t;", "return v * w;"),
        ("lib/splat_view.wgsl", "deepfield::splat_view", "deepfield::elsewhere"),
    ];
    for (path, good, bad) in breaks {
        let mut texts = super::check::texts(&[]);
        let text = &mut texts.iter_mut().find(|(name, _)| *name == path).unwrap().1;
        assert!(text.contains(good), "{path} has no {good:?}");
        *text = text.replace(good, bad);
        let takes_it = |variant: &&Variant| path.starts_with("lib/") || variant.path == path;
        let mut composer = Composer::new(&texts);
        let is_found = variants().iter().filter(takes_it).any(|variant| composer.compose(variant).is_err());
        assert!(is_found, "{bad:?} in {path} goes unnoticed");
    }
}
