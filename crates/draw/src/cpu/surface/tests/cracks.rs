//! No pixel within a surface shows what is behind it, whatever levels meet, and whatever they are drawn as.

use super::super::raster::{self, Visibility};
use super::super::rays::Caster;
use super::super::select::{Choice, Technique, choose, looked};
use super::super::sight::Sight;
use super::super::stitch::Scene;
use super::*;

/// What is seen, with points so wide.
fn drawn(scene: &Scene, view: &View, point: u32) -> Visibility {
    let picture = Visibility::new([view.width, view.height]);
    raster::draw(scene, view, &picture, [point, 1]);
    picture
}

/// Pixels that show nothing, with points so wide.
fn holes(scene: &Scene, view: &View, point: u32) -> usize {
    let picture = drawn(scene, view, point);
    (0..picture.width * picture.height).filter(|index| picture.at(*index).is_none()).count()
}

/// Sides of chunks that lie on coarser ones, and corners that finer ones add.
fn joints(scene: &Scene) -> usize {
    let extras = scene.meshes.iter().flat_map(|mesh| mesh.extras.iter().flatten().map(Vec::len)).sum::<usize>();
    extras + scene.meshes.iter().flat_map(|mesh| mesh.is_laid).filter(|laid| *laid).count()
}

#[test]
fn random_cuts_have_none() {
    let field = hills(1400, 1170, 0.0, 4);
    let (source, placed) = (MemorySurface::new(&field, 1.0).unwrap(), placed(&field));
    let mut random = Random::new(11);
    let (mut joined, mut points) = (0, 0);
    for round in 0..60 {
        let view = camera_over(&field, &mut random, [120, 90]);
        let sight = Sight::Flat(view);
        let point = [1, 2, 5][round % 3];
        let cut = random_cut(&source, &placed, &sight, &mut random, point);
        points += cut.nodes.iter().filter(|node| node.primitive == Primitive::Points).count();
        let scene = Scene::new(&source, &placed, cut);
        joined += joints(&scene);
        assert_eq!(holes(&scene, &view, point), 0, "round {round}: {view:?}");
        if round % 6 == 0 {
            let picture = Visibility::new([120, 90]);
            Caster::new(&scene).draw(&sight, &picture);
            assert!((0..120 * 90).all(|index| picture.at(index).is_some()), "rays, round {round}: {view:?}");
        }
    }
    assert!(joined > 1000 && points > 5, "{joined} joints, {points} chunks of points");
}

/// Full resolution lies beside samples that are 64 apart, on either side of a border, in a thousand pictures.
#[test]
fn levels_six_apart_have_none() {
    const BORDER: u64 = 256 << 6;
    let mut field = hills(67, BORDER as usize + 513, 0.0, 13);
    field.stored.iter_mut().for_each(|height| *height *= 0.05);
    let (source, placed) = (MemorySurface::new(&field, 1.0).unwrap(), placed(&field));
    let (ground, about) = (box_of(&field), [[BORDER as f64 - 2.0, BORDER as f64 + 2.0], [20.0, 46.0]]);
    let mut random = Random::new(17);
    let mut camera = || camera_about(about, ground, &mut random, [64, 48]);
    // Down to the chunk of full resolution that holds a column.
    let scene = |column: u64, view: View, point: u32| {
        let holds = |key: ChunkKey| {
            let [_, [first, last]] = source.lattice().rectangle(key);
            (first..last).contains(&column)
        };
        Scene::new(&source, &placed, cut_where(&source, &placed, &Sight::Flat(view), point, holds))
    };
    let of_triangles = [BORDER - 1, BORDER].map(|column| scene(column, camera(), 0));
    let (mut apart, mut points) = (0, 0);
    for round in 0..3000 {
        let (view, side, point) = (camera(), round % 2, [1, 5][usize::from(round % 16 < 2)]);
        let with_points = (point > 1).then(|| scene(BORDER - 1 + side as u64, view, point));
        let scene = with_points.as_ref().unwrap_or(&of_triangles[side]);
        points += scene.cut.nodes.iter().filter(|node| node.primitive == Primitive::Points).count();
        let picture = match round % 100 {
            50 => {
                let picture = Visibility::new([64, 48]);
                Caster::new(scene).draw(&Sight::Flat(view), &picture);
                picture
            }
            _ => drawn(scene, &view, point),
        };
        let (mut finest, mut coarsest) = (u8::MAX, 0);
        for index in 0..picture.width * picture.height {
            let shown = picture.at(index).unwrap_or_else(|| panic!("round {round}: {view:?}"));
            let level = scene.cut.nodes[shown.node].key.level;
            (finest, coarsest) = (finest.min(level), coarsest.max(level));
        }
        apart += usize::from(coarsest - finest >= 6);
        if apart == 1000 {
            break;
        }
    }
    assert!(apart == 1000 && points > 5, "{apart} pictures, {points} chunks of points");
}

#[test]
fn chosen_cuts_have_none_within_any_budget() {
    let field = hills(1400, 1170, 0.0, 7);
    let (source, placed) = (MemorySurface::new(&field, 1.0).unwrap(), placed(&field));
    let mut random = Random::new(5);
    for round in 0..40 {
        let view = camera_over(&field, &mut random, [120, 90]);
        let technique = [Technique::Hybrid, Technique::Triangles][round % 2];
        let choice = Choice {
            tau: [0.5, 0.8, 2.0, 8.0][round % 4],
            technique,
            point: [1, 3][round / 2 % 2],
            reach: 0.0,
            looks: if round % 3 == 0 { looked(0.8) } else { f64::INFINITY },
            lines: f64::INFINITY,
            change: f64::INFINITY,
            spans: 0.0,
            walls: None,
            most: [1 << 14, 9][round / 20],
        };
        let cut = choose(&source, &placed, &Sight::Flat(view), &choice);
        assert_eq!(holes(&Scene::new(&source, &placed, cut), &view, choice.point), 0, "round {round}: {view:?}");
    }
}

/// Two meshes of the same levels with a coarser one between: without its finer corners a border would show.
#[test]
fn borders_of_a_place_are_equal_whoever_asks() {
    let field = hills(900, 1100, 0.1, 3);
    let (source, placed) = (MemorySurface::new(&field, 1.0).unwrap(), placed(&field));
    let view = camera_over(&hills(900, 1100, 0.0, 3), &mut Random::new(1), [64, 64]);
    let mut random = Random::new(9);
    for _ in 0..12 {
        let scene = Scene::new(&source, &placed, random_cut(&source, &placed, &Sight::Flat(view), &mut random, 0));
        let mut known = std::collections::HashMap::new();
        let mut shared = 0;
        for mesh in &scene.meshes {
            let (rows, columns) = (mesh.samples.rows, mesh.samples.columns);
            for (r, c) in (0..rows).flat_map(|r| (0..columns).map(move |c| (r, c))) {
                let height = mesh.height(r * columns + c);
                let is_border = r == 0 || c == 0 || r + 1 == rows || c + 1 == columns;
                if !is_border || height.is_nan() {
                    continue;
                }
                let before = known.insert((mesh.rows[r], mesh.columns[c]), height.to_bits());
                shared += usize::from(before.is_some());
                assert!(before.is_none_or(|before| before == height.to_bits()));
            }
            for &(row, column, height) in mesh.extras.iter().flatten().flatten() {
                let before = known.insert((row, column), height.to_bits());
                let own =
                    |before: u64| height.is_nan() || before == height.to_bits() || f64::from_bits(before).is_nan();
                assert!(before.is_none_or(own));
            }
        }
        assert!(shared > 0 || scene.meshes.len() == 1);
    }
}
