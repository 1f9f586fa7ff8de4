//! How the buffers are laid out that shaders read, compared with the structures that the program writes.

use crate::gpu::integrals::layout::RaysUniform;
use crate::gpu::scene::{MOVING_WORDS, RAW_WORDS};
use crate::gpu::shaders::SHADERS;
use crate::gpu::shaders::check::Variant;
use crate::gpu::splat::layout::{Encoding, Level, PATCH_BYTES, PLACE_BYTES, SPLAT_BYTES};
use crate::gpu::tiles::layout::SPOT_BYTES;
use crate::gpu::volume::layout::{REACH_BYTES, TierPortion, TierUniform};
use std::collections::BTreeSet;
use std::sync::Arc;
use wgpu::naga::{AddressSpace, Handle, Module, ScalarKind, Type, TypeInner};
use written::written;

/// A field's scalars, where it is made of one kind.
trait Scalars {
    const KIND: Option<ScalarKind>;
}
impl Scalars for f32 {
    const KIND: Option<ScalarKind> = Some(ScalarKind::Float);
}
impl Scalars for i32 {
    const KIND: Option<ScalarKind> = Some(ScalarKind::Sint);
}
impl Scalars for u32 {
    const KIND: Option<ScalarKind> = Some(ScalarKind::Uint);
}
impl Scalars for Level {
    const KIND: Option<ScalarKind> = None;
}
impl Scalars for RaysUniform {
    const KIND: Option<ScalarKind> = None;
}
impl Scalars for TierUniform {
    const KIND: Option<ScalarKind> = None;
}
impl Scalars for TierPortion {
    const KIND: Option<ScalarKind> = None;
}
impl<T: Scalars, const N: usize> Scalars for [T; N] {
    const KIND: Option<ScalarKind> = T::KIND;
}

/// A member of a structure: name, offset, size, scalars.
#[derive(Clone, Debug, PartialEq)]
struct Member(String, usize, usize, Option<ScalarKind>);

/// A structure as the program writes it: bytes and members.
type Layout = (usize, Vec<Member>);

/// The layout of a Rust structure; all fields must be named, in their order. `unused` ones may differ.
macro_rules! layout {
    ($type:ident { $($field:ident),* $(,)? }) => {{
        fn field<S, F: Scalars>(_: fn(&S) -> &F) -> (usize, Option<ScalarKind>) {
            (size_of::<F>(), F::KIND)
        }
        // Fails to compile where a field is missing.
        let _ = |value: $type| { let $type { $($field: _),* } = value; };
        let mut members = Vec::new();
        $(
            let (size, kind) = field(|value: &$type| &value.$field);
            members.push(Member(stringify!($field).to_owned(), std::mem::offset_of!($type, $field), size, kind));
        )*
        members.retain(|member| !member.0.starts_with("unused"));
        (size_of::<$type>(), members)
    }};
}

// Below the macro that it uses.
mod written;

/// The scalars that a WGSL type is made of, where they are of one kind.
fn kind(module: &Module, ty: Handle<Type>) -> Option<ScalarKind> {
    match module.types[ty].inner {
        TypeInner::Scalar(scalar) | TypeInner::Vector { scalar, .. } | TypeInner::Atomic(scalar) => Some(scalar.kind),
        TypeInner::Array { base, .. } => kind(module, base),
        _ => None,
    }
}

/// The layout of a WGSL structure; one member without a name for any other type.
fn shader_layout(module: &Module, ty: Handle<Type>) -> Layout {
    let size = |ty: Handle<Type>| module.types[ty].inner.size(module.to_ctx()) as usize;
    let TypeInner::Struct { members, span } = &module.types[ty].inner else {
        return (size(ty), vec![Member(String::new(), 0, size(ty), kind(module, ty))]);
    };
    let members = members.iter().map(|member| {
        let name = member.name.clone().unwrap_or_default();
        Member(name, member.offset as usize, size(member.ty), kind(module, member.ty))
    });
    (*span as usize, members.filter(|member| !member.0.starts_with("unused")).collect())
}

/// What a buffer holds: the type itself, or an element of a run-time sized array.
fn element(module: &Module, ty: Handle<Type>) -> Handle<Type> {
    match module.types[ty].inner {
        TypeInner::Array { base, size: wgpu::naga::ArraySize::Dynamic, stride } => {
            assert_eq!(stride, module.types[base].inner.size(module.to_ctx()), "a gap between elements");
            base
        }
        _ => ty,
    }
}

/// The name in its own module of something that may have been imported.
fn plain_name(name: &str) -> &str {
    name.split("X_naga_oil").next().unwrap_or_default()
}

/// Every buffer of every variant, member by member.
pub(super) fn buffers_are_laid_out_as_the_program_writes_them(built: &[(Variant, Arc<Module>)]) {
    let mut compared = BTreeSet::new();
    for (variant, module) in built {
        for (_, variable) in module.global_variables.iter() {
            if !matches!(variable.space, AddressSpace::Uniform | AddressSpace::Storage { .. }) {
                continue;
            }
            let name = plain_name(variable.name.as_deref().unwrap_or_default());
            let place = format!("{name} of {} with {:?}", variant.path, variant.defs);
            let found = shader_layout(module, element(module, variable.ty));
            match (written(variant.path, name), name) {
                (Some(expected), _) => assert_eq!(found, expected, "{place}"),
                (None, "splats") => assert_eq!(found.0 as u64, SPLAT_BYTES, "{place}"),
                (None, "slices" | "tile_slices") => assert_eq!(found.0, 8, "{place}"),
                (None, "patches") => assert_eq!(64 * found.0 as u64, PATCH_BYTES, "{place}"),
                (None, "places") => assert_eq!(found.0 as u64, PLACE_BYTES, "{place}"),
                (None, "spots" | "arranged") => assert_eq!(found.0 as u64, SPOT_BYTES, "{place}"),
                (None, "hits" | "smoothed") => assert_eq!(found.0, 16, "{place}"),
                (None, "reaches") if variant.path == "volume/bin.wgsl" => {
                    assert_eq!(found.0 as u64, REACH_BYTES, "{place}");
                }
                // Two times 32 layers.
                (None, "reach") if variant.path == "volume/raycast.wgsl" => assert_eq!(found.0, 8, "{place}"),
                (None, "ranges" | "reaches") => assert_eq!(found.0, 8, "{place}"),
                (None, _) if !variant.path.starts_with("splat/") => assert_eq!(found.0, 4, "{place}"),
                _ => panic!("unknown: {place}"),
            }
            compared.insert(name.to_owned());
            if name == "view" {
                let TypeInner::Struct { members, .. } = &module.types[variable.ty].inner else { panic!("{place}") };
                let TypeInner::Array { base, stride, .. } = module.types[members.last().unwrap().ty].inner else {
                    panic!("{place}: levels")
                };
                let expected = layout!(Level {
                    width,
                    height,
                    pad,
                    first_cell,
                    tiles_x,
                    first_tile,
                    bins_x,
                    bins_y,
                    first_bin,
                    margin,
                    scale,
                    atlas_row,
                    ellipse_bins,
                    sampled_radius,
                    unused,
                });
                assert_eq!(shader_layout(module, base), expected, "{place}: levels");
                assert_eq!(stride as usize, expected.0, "{place}: levels");
            }
            if name == "integrals" {
                let TypeInner::Struct { members, .. } = &module.types[variable.ty].inner else { panic!("{place}") };
                let expected = layout!(RaysUniform { start, start_right, start_down, step, step_right, step_down });
                for name in ["samples", "world"] {
                    let rays = members.iter().find(|member| member.name.as_deref() == Some(name)).unwrap();
                    assert_eq!(shader_layout(module, rays.ty), expected, "{place}");
                }
            }
            let tiers = match name {
                "volume" => Some(layout!(TierUniform {
                    window,
                    ring,
                    first_brick,
                    first_slice,
                    first_level,
                    level_count,
                    unused,
                })),
                "portion" if variant.path.starts_with("volume/") => {
                    Some(layout!(TierPortion { origin, layers, nearest, farthest }))
                }
                _ => None,
            };
            if let Some(expected) = tiers {
                let TypeInner::Struct { members, .. } = &module.types[variable.ty].inner else { panic!("{place}") };
                let tiers = members.iter().find(|member| member.name.as_deref() == Some("tiers")).unwrap();
                let TypeInner::Array { base, stride, .. } = module.types[tiers.ty].inner else { panic!("{place}") };
                assert_eq!((shader_layout(module, base), stride as usize), (expected.clone(), expected.0), "{place}");
            }
        }
    }
    assert_eq!(compared.len(), 105, "{compared:?}");
}

#[test]
fn another_layout_is_found() {
    let breaks = [
        ("table: u32,\n    table_length: u32,", "table_length: u32,\n    table: u32,"),
        ("step: f32,", "step: u32,"),
        ("eye_rest: vec3<f32>,", "eye_rest: vec4<f32>,"),
        ("even: u32,", "even: u32,\n    odd: u32,"),
    ];
    for (good, bad) in breaks {
        let text = &SHADERS.iter().find(|(path, _)| *path == "lib/particle.wgsl").unwrap().1;
        let start = text.find("struct Node {").unwrap();
        let end = start + text[start..].find('}').unwrap();
        assert!(text[start..end].contains(good), "no {good:?}");
        let changed = text[start..end].replace(good, bad);
        let module = wgpu::naga::front::wgsl::parse_str(&format!("{changed}}}")).unwrap();
        let (node, _) = module.types.iter().find(|(_, ty)| ty.name.as_deref() == Some("Node")).unwrap();
        assert_ne!(
            Some(shader_layout(&module, node)),
            written("splat/project.wgsl", "nodes"),
            "{bad:?} goes unnoticed"
        );
    }
}

#[test]
fn encodings_have_the_same_numbers() {
    let text = &SHADERS.iter().find(|(path, _)| *path == "lib/particle.wgsl").unwrap().1;
    let constant = |name: &str| {
        let (_, rest) = text.split_once(&format!("const {name}: u32 = ")).unwrap();
        rest.split_once('u').unwrap().0.parse::<u32>().unwrap()
    };
    assert_eq!(constant("ENCODING_GRID"), Encoding::Grid as u32);
    assert_eq!(constant("ENCODING_LEAF"), Encoding::Leaf as u32);
    assert_eq!(constant("ENCODING_WORLD"), Encoding::World as u32);
    assert_eq!(constant("ENCODING_MOVING"), Encoding::Moving as u32);
    assert_eq!(constant("ENCODING_CLUSTERS"), Encoding::Clusters as u32);
    // Packed encodings come first.
    assert!((Encoding::Camera as u32) > (Encoding::World as u32) && (Encoding::World as u32) > (Encoding::Leaf as u32));
    assert_eq!(RAW_WORDS, 8, "`load_raw` reads two vectors a particle");
    assert_eq!(MOVING_WORDS, 24, "`load_moving` reads six vectors a particle");
}
