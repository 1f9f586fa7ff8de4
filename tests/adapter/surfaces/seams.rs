//! Where levels meet, chosen at random, an adapter's passes leave no crack.

use super::*;
use deepfield::cpu::surface::select::{CutNode, Primitive, SurfaceCut};
use deepfield::cpu::surface::source::SurfaceNodes;
use deepfield::heights::hierarchy::chunks::ChunkKey;
use deepfield::model::Bounds;
use deepfield::view::Extent;

/// How an adapter draws. From the same place one after the other: an adapter in software compiles its shaders for each camera anew.
const WAYS: [(Passes, Technique); 3] =
    [(Passes::Compute, Technique::Hybrid), (Passes::Raster, Technique::Hybrid), (Passes::Compute, Technique::Rays)];

/// A random camera above a field that looks onto a place where chunks meet, so that nothing but the field is in the picture.
fn camera_over(field: &HeightField, random: &mut Random) -> View {
    let [columns, rows] = [field.grid.columns, field.grid.rows].map(|count| (count - 1) as f64);
    let high = field.stored.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let low = field.stored.iter().copied().fold(f64::INFINITY, f64::min);
    loop {
        let mut between = |low: f64, high: f64| low + (high - low) * random.next();
        let border = |at: f64| (at / 256.0).round() * 256.0;
        let target = DVec3::new(border(columns * between(0.1, 0.9)), border(rows * between(0.2, 0.8)), 0.0);
        let (angle, away, up) = (between(0.0, 6.3), between(1.0, 150.0), between(2.0, 250.0));
        let eye = target + DVec3::new(away * angle.cos(), away * angle.sin(), high + up);
        let projection = match between(0.0, 1.0) < 0.3 {
            true => Projection::Orthographic { height: between(20.0, 300.0) },
            false => Projection::Perspective { fov_y: between(0.2, 1.0) },
        };
        let Ok(view) = View::look_at(eye, target, DVec3::Z, projection, 120, 90) else { continue };
        // Where rays through the corners meet the lowest ground there may be.
        let is_over = [[0.0, 0.0], [120.0, 0.0], [0.0, 90.0], [120.0, 90.0]].into_iter().all(|corner| {
            let from = view.at_depth(corner, 0.0);
            let along = view.at_depth(corner, 1.0) - from;
            let at = from + (low - from.z) / along.z * along;
            from.z > high && along.z < 0.0 && at.x > 1.0 && at.y > 1.0 && at.x < columns - 1.0 && at.y < rows - 1.0
        });
        if is_over {
            return view;
        }
    }
}

/// Random chunks of all levels that cover a field, as points of so many pixels where these leave no gap.
fn random_cut(nodes: &PagedSurface, placed: &Placed, view: &View, random: &mut Random, point: u32) -> SurfaceCut {
    let lattice = nodes.lattice();
    let (mut waiting, mut chosen) = (vec![lattice.root()], Vec::new());
    while let Some(key) = waiting.pop() {
        // The root alone would meet nothing.
        if key.level > 0 && (key == lattice.root() || random.next() < 0.6) {
            let finer = [[0, 0], [0, 1], [1, 0], [1, 1]].map(|[row, column]| ChunkKey {
                level: key.level - 1,
                row: 2 * key.row + row,
                column: 2 * key.column + column,
            });
            waiting.extend(finer.into_iter().filter(|key| lattice.has(*key)));
            continue;
        }
        let facts = nodes.facts(key).unwrap();
        let ends = [0, 1].map(|axis| {
            let places = lattice.places(key, axis);
            [places[0], *places.last().unwrap()]
        });
        let corner = |k: usize| placed.world(ends[0][k] as f64, ends[1][k] as f64, [facts.min, facts.max][k]);
        // A globe's chunk may be anywhere on it.
        let corners =
            if placed.is_flat() { [0, 1].map(corner) } else { [-1.0, 1.0].map(|way| DVec3::splat(3e4 * way)) };
        let extent = Extent { bounds: Bounds::of(corners.map(|corner| corner.to_array())), margin: 0.0 };
        let whole = f64::from(1_u32 << key.level);
        let apart = view.error_pixels(&extent, whole.hypot(whole).hypot(facts.step));
        let primitive = if apart <= 0.999 * f64::from(point) { Primitive::Points } else { Primitive::Triangles };
        // What borders add is reckoned with by those who choose.
        let added = facts.max - facts.min;
        chosen.push(CutNode { key, facts, extent, primitive, error_px: 0.0, added });
    }
    SurfaceCut::new(chosen)
}

#[test]
fn nothing_shows_through_where_levels_meet() {
    let folder = tempfile::tempdir().unwrap();
    // Four levels, with borders along rows as well as along columns.
    let field = hills([1200, 1150], Holes::None);
    let file = HeightFile::open(&built(folder.path(), &field), ReadMethod::default()).unwrap();
    let nodes = PagedSurface::new(Arc::new(file), u64::MAX);
    let placed = Placed::new(&field.grid, Map::Plate, 1.0, 0.0);
    let look = Look {
        attribute: Attribute::Level,
        transfer: TransferFunction::preset("grey").unwrap(),
        range: [-1.0, 6.0],
        light: Light::Eye,
        ambient: 1.0,
        contours: None,
    };
    let mut random = Random(7);
    let mut adapter = Offscreen::preferred();
    let mut joined = 0;
    for place in 0..4 {
        let view = camera_over(&field, &mut random);
        let point = [1, 3][place % 2];
        for (passes, technique) in WAYS {
            let cut = random_cut(&nodes, &placed, &view, &mut random, point);
            let scene = Scene::new(&nodes, &placed, cut);
            joined += scene.meshes.iter().flat_map(|mesh| mesh.is_laid).filter(|is_laid| *is_laid).count();
            let job = AdapterSurface { technique, point, ..plain_job(scene, view, look.clone(), passes) };
            let AdapterValues::Light(colors, _) = adapter.surface(Arc::new(job)).unwrap().values else {
                panic!("sums")
            };
            let open = colors.rgba.iter().filter(|color| color[3] < 1.0).count();
            assert_eq!(open, 0, "{passes:?}, {technique:?}: {view:?}");
        }
    }
    assert!(joined > 50, "{joined} borders of levels");
}

#[test]
fn nothing_shows_through_where_levels_meet_on_a_globe() {
    let folder = tempfile::tempdir().unwrap();
    // The first column once more at the end, and rows at both poles: all around without help.
    let [columns, rows] = [2305, 1153];
    let mut field = hills([columns, rows], Holes::None);
    for row in 0..rows {
        field.stored[row * columns + columns - 1] = field.stored[row * columns];
    }
    for (row, beside) in [(0, 1), (rows - 1, rows - 2)] {
        let beside: f64 = field.stored[beside * columns..(beside + 1) * columns].iter().sum();
        field.stored[row * columns..(row + 1) * columns].fill(beside / columns as f64);
    }
    (field.grid.step, field.grid.origin) = ([0.15625, -0.15625], [-180.0, 90.0]);
    (field.grid.xy_unit, field.grid.height_unit) = (Unit::new("deg"), Unit::new("m"));
    let file = HeightFile::open(&built(folder.path(), &field), ReadMethod::default()).unwrap();
    let nodes = PagedSurface::new(Arc::new(file), u64::MAX);
    let globe = Globe { equator: 20_000.0, pole: 19_900.0 };
    let placed = Placed::new(&field.grid, Map::Globe(globe), 3.0, 0.0);
    let look = Look {
        attribute: Attribute::Level,
        transfer: TransferFunction::preset("grey").unwrap(),
        range: [-1.0, 6.0],
        light: Light::Eye,
        ambient: 1.0,
        contours: None,
    };
    let mut random = Random(14);
    let mut adapter = Offscreen::preferred();
    let mut joined = 0;
    for place in 0..4 {
        // Over the seam, over the poles, and anywhere; near by and far away.
        let (longitude, latitude) = match place {
            0 => (180.0, 120.0 * random.next() - 60.0),
            1 => (360.0 * random.next(), -89.9),
            2 => (360.0 * random.next(), 89.9),
            _ => (360.0 * random.next(), 120.0 * random.next() - 60.0),
        };
        let up = DVec3::from(Globe::up(longitude, latitude));
        let away = 20_000.0 + 600.0 + 4000.0 * random.next() * random.next();
        // Narrow enough to see nothing but the globe, though it looks aside.
        let limb = (19_700.0 / away).asin();
        let aside = 0.3 * limb * random.next();
        let level = up.any_orthonormal_vector();
        let target = away * up + away * (aside.sin() * level - aside.cos() * up);
        let projection = Projection::Perspective { fov_y: (0.6 * limb).min(1.0) };
        let view = View::look_at(away * up, target, level.cross(up), projection, 120, 90).unwrap();
        for (passes, technique) in WAYS {
            let cut = random_cut(&nodes, &placed, &view, &mut random, 1);
            let scene = Scene::new(&nodes, &placed, cut);
            joined += scene.meshes.iter().flat_map(|mesh| mesh.is_laid).filter(|is_laid| *is_laid).count();
            let job = AdapterSurface { technique, ..plain_job(scene, view, look.clone(), passes) };
            let AdapterValues::Light(colors, _) = adapter.surface(Arc::new(job)).unwrap().values else {
                panic!("sums")
            };
            let open = colors.rgba.iter().filter(|color| color[3] < 1.0).count();
            assert_eq!(open, 0, "{passes:?}, {technique:?}: at {longitude} {latitude} {away} {aside}");
        }
    }
    assert!(joined > 50, "{joined} borders of levels");
}
