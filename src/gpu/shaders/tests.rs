//! Every shader, composed as Bevy composes it and validated by naga, for every set of definitions that a pipeline uses;
//! and what it reads, compared with what the program writes. No graphics adapter is needed.

use super::SHADERS;
use super::check::{Composer, Variant, variants};
use crate::gpu::bloom::levels::{Givers, LevelUniform, Takers};
use crate::gpu::composite::CompositeUniform;
use crate::gpu::integrals::layout::{IntegralUniform, RaysUniform};
use crate::gpu::layered::{LayerGroup, LayerUniform};
use crate::gpu::light::LightUniform;
use crate::gpu::matter::LookupUniform;
use crate::gpu::measure::Reduction;
use crate::gpu::over_splats::SplatLookUniform;
use crate::gpu::scene::{MOVING_WORDS, RAW_WORDS, RawParticle, TableEntry};
use crate::gpu::sorted_splats::SortedUniform;
use crate::gpu::spheres::SphereUniform;
use crate::gpu::splat::layout::{
    Block, Encoding, Level, Node, PATCH_BYTES, PLACE_BYTES, Pass, SPLAT_BYTES, SplatUniform,
};
use crate::gpu::surface::layout::{Draw, SurfaceStep, SurfaceUniform};
use crate::gpu::target::FrameUniform;
use crate::gpu::tiles::layout::{Portion as TilePortion, SPOT_BYTES, TileUniform};
use crate::gpu::volume::column::ColumnUniform;
use crate::gpu::volume::field::layout::{FieldLine, FieldUniform, SlopeUniform};
use crate::gpu::volume::layout::{Portion, REACH_BYTES, TierPortion, TierUniform, Turn, VolumeUniform};
use crate::gpu::volume::march::MarchUniform;
use std::collections::BTreeSet;
use std::sync::Arc;
use wgpu::naga::{AddressSpace, Handle, Module, ScalarKind, Type, TypeInner};

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

/// What the program writes into a buffer of that name; `None` if shaders alone write it.
fn written(path: &str, name: &str) -> Option<Layout> {
    let volume = path.starts_with("volume/");
    let plain = |size: usize, kind| (size, vec![Member(String::new(), 0, size, Some(kind))]);
    Some(match name {
        "view" => layout!(SplatUniform {
            right,
            up,
            forward,
            size,
            atlas,
            middle,
            tile_count,
            cell_count,
            focal,
            near,
            perspective,
            fixed_radius,
            slice,
            level_count,
            small_bin,
            everywhere_bin,
            bin_count,
            moment,
            faintest,
            peak,
            culling,
            cut,
            fade_start,
            fade_rate,
            clip_min,
            clip_max,
            fade_along,
            levels,
        }),
        "nodes" => {
            layout!(Node {
                eye_steps,
                step,
                eye_rest,
                growth,
                positions,
                codes,
                table,
                table_length,
                encoding,
                weight_scale,
                count,
                seed,
                scale,
                ranks,
                even,
                edge,
                corner,
                u
            })
        }
        "blocks" => layout!(Block { node, first, count, place }),
        "entries" => plain(size_of::<TableEntry>(), ScalarKind::Float),
        "vectors" => plain(size_of::<RawParticle>() / 2, ScalarKind::Float),
        "batch" => layout!(Pass { add, further, level, unused, source, unused_end }),
        "composite" => {
            layout!(CompositeUniform { lut_size, p_map, s_map, p_log, s_log, stride, share, high, unused })
        }
        "bloom" => layout!(LevelUniform {
            fine,
            coarse,
            givers,
            takers,
            fine_start,
            coarse_start,
            is_picture,
            own,
            coarser,
            strength,
            threshold,
            most_light,
        }),
        "givers" => layout!(Givers { pixels, weights }),
        "takers" => layout!(Takers { pixels, weights }),
        "lit" | "planes" | "points" | "tints" | "normals" | "flown" => plain(16, ScalarKind::Float),
        "frame" => layout!(FrameUniform { size, before_size, origin, share, unused }),
        "picture" => layout!(LightUniform { size }),
        "light" => plain(16, ScalarKind::Float),
        "volume" => layout!(VolumeUniform {
            window,
            middle,
            attribute_map,
            ring,
            slices,
            last_layer,
            tier_count,
            bin_count,
            perspective,
            surface_count,
            sigma,
            near,
            slice_rate,
            brick_room,
            least,
            faintest,
            termination,
            first_entry,
            last_entry,
            hues,
            attribute_log,
            lit,
            ambient,
            specular,
            shininess,
            plane,
            smallest,
            kernel_factor,
            stride,
            growth,
            columns_read,
            cells,
            tiers,
            levels,
            surfaces,
            colors,
        }),
        "tiles" => layout!(TileUniform {
            size,
            middle,
            planes,
            focal,
            perspective,
            least,
            density_scale,
            extent,
            lead,
            smallest,
            first_key,
            interval_shift,
            level_count,
            layers,
            layer_rate,
            spread,
            over,
            blur,
            column_factor,
            column_power,
            column_area,
            levels,
        }),
        "layered" => layout!(LayerUniform { termination, least, unused }),
        "layers" => layout!(LayerGroup { slab, slabs, first, layers, dispatch, dispatches, unused }),
        "caps" => plain(16, ScalarKind::Float),
        "portion" | "round" if !volume => {
            layout!(TilePortion { length, slab, first_block, most, intervals, at_once, unused })
        }
        "slabs" => plain(16, ScalarKind::Uint),
        "lookup" => {
            layout!(LookupUniform { attribute_map, attribute_log, first_entry, last_entry, hues, plane, unused })
        }
        "sorted" => layout!(SortedUniform { termination, unused }),
        "look" if path.starts_with("over/") => layout!(SplatLookUniform {
            column_map,
            attribute_map,
            size,
            column_log,
            attribute_log,
            has_hue,
            depth,
            unused,
        }),
        "spheres" => layout!(SphereUniform {
            near,
            smoothing,
            lit,
            ambient,
            specular,
            shininess,
            of_attribute,
            log_scale,
            color_map,
            last_color,
            unused,
        }),
        "surface" => layout!(SurfaceUniform {
            origin,
            focal,
            per_column,
            near,
            per_row,
            perspective,
            per_height,
            parts,
            eye,
            stride,
            right,
            spacing,
            up,
            fade_start,
            forward,
            fade_rate,
            world_right,
            clips,
            world_up,
            point_side,
            world_forward,
            lone_side,
            clip_min,
            colored_by,
            clip_max,
            ramp_last,
            sun,
            is_sun,
            contour_color,
            contour_major,
            size,
            middle,
            anchor,
            last,
            step,
            low,
            per,
            is_log,
            reference,
            ambient,
            steeper,
            true_lift,
            contour_interval,
            contour_base,
            contour_width,
            far,
            tree,
            top,
            has_form,
            pole_at,
            pole_height,
            pole_rows,
            turn,
            open,
            latitude,
            radius,
            lift,
            lengths,
            photo_size,
            photo_anchor,
            photo_at,
            photo_per,
            photo_rows,
            photo_columns,
            photo_period,
            photo_is_endless,
            photo_light,
            photo_table,
            photo_levels,
            rim_width,
            box_min,
            wall_base,
            box_max,
            spans,
            limb,
            limb_away,
        }),
        "draws" => layout!(Draw {
            start,
            rows,
            columns,
            level,
            key_row,
            key_column,
            flags,
            border,
            chain,
            chain_length,
            low,
            high,
            rows_at,
            columns_at,
            rims,
            fill,
            fans,
            row_length,
        }),
        "surface_step" => {
            layout!(SurfaceStep { is_second, first, count, counter, most, unused, unused_end })
        }
        "ramp" => plain(16, ScalarKind::Float),
        "gradient" => plain(16, ScalarKind::Float),
        "portion" => layout!(Portion {
            origin,
            first_pixel,
            behind_pixel,
            rows,
            brick_rows,
            first_layer,
            layers,
            first_step,
            behind_step,
            candidates,
            opening,
            bricks,
            unused,
            tiers,
        }),
        "rays_view" => layout!(MarchUniform {
            middle_place,
            right,
            down,
            along,
            along_right,
            along_down,
            low,
            high,
            rooms,
            least,
            middle,
            planes,
            size,
            cell,
            unused,
        }),
        "samples" => layout!(FieldUniform {
            right,
            up,
            world_right,
            world_up,
            clip,
            ends,
            shape,
            scale,
            blocks,
            is_log,
            low,
            per,
            unused,
        }),
        "lines" => layout!(FieldLine { start, world }),
        "slopes" => layout!(SlopeUniform { right, up, forward, start, shape, scale, slices, is_log, low, per }),
        "integrals" => layout!(IntegralUniform {
            samples,
            world,
            clip,
            ends,
            shape,
            scale,
            middle,
            planes,
            size,
            level,
            least_level,
            last_level,
            perspective,
            depth,
            pixel,
            slope,
            stride,
            unused,
        }),
        "reduction" => layout!(Reduction { size, reduced, stride, side, one, unused }),
        "turn" => layout!(Turn { number, unused }),
        "column" => layout!(ColumnUniform {
            role,
            reading,
            is_log,
            is_alone,
            low,
            per,
            filling,
            least_filled,
            point_count,
            unused,
            points,
        }),
        "spots" | "depths" | "rays" if volume => plain(16, ScalarKind::Float),
        "amounts" => plain(8, ScalarKind::Float),
        "places" if volume => plain(8, ScalarKind::Uint),
        "readers" => plain(8, ScalarKind::Sint),
        "table" if path != "volume/sort.wgsl" => plain(16, ScalarKind::Float),
        "words" | "lut" | "before" | "starts" | "bins" | "slice_count" | "dispatch" | "dispatches" => {
            plain(4, ScalarKind::Uint)
        }
        // Read back.
        "differences" => plain(4, ScalarKind::Sint),
        // Read back as pairs of P and P S.
        "cells" | "last_cells" | "reduced_cells" => plain(8, ScalarKind::Float),
        _ => return None,
    })
}

fn buffers_are_laid_out_as_the_program_writes_them(built: &[(Variant, Arc<Module>)]) {
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
                for rays in members.iter().take(2) {
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
