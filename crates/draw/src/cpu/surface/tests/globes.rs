//! Globes: what each technique and each kind of picture finds, the seam, the poles and the horizon.

use super::super::closed::Closed;
use super::super::look::{Attribute, Light, Look};
use super::super::memory::MemorySurface;
use super::super::placed::{Map, Placed};
use super::super::raster::{self, POLE, Shown, Visibility};
use super::super::select::Technique;
use super::super::sight::Sight;
use super::super::stitch::{Mesh, Scene};
use super::super::{SurfaceOptions, SurfacePicture, draw};
use super::techniques::{TECHNIQUES, check_places};
use super::{Random, hills, random_cut};
use crate::color::transfer::TransferFunction;
use crate::model::Unit;
use crate::view::{Cut, Panorama, Projection, Surround, View};
use deepfield_heights::model::{Globe, HeightField};
use glam::DVec3;

/// The whole globe, with samples in the middles of cells: half a spacing is left at each pole, and one at the seam.
fn world(columns: usize, seed: u64) -> HeightField {
    let rows = columns / 2;
    let mut field = hills(rows, columns, 0.0, seed);
    let step = 360.0 / columns as f64;
    field.grid.step = [step, -step];
    field.grid.origin = [-180.0 + 0.5 * step, 90.0 - 0.5 * step];
    (field.grid.xy_unit, field.grid.height_unit) = (Unit::new("deg"), Unit::new("m"));
    field
}

fn globes() -> [Globe; 2] {
    [Globe::sphere(20_000.0), Globe { equator: 20_000.0, pole: 19_000.0 }]
}

/// Heights along the row, the first column after the last.
fn t_height(field: &HeightField, row: f64, column: f64) -> f64 {
    let (columns, rows) = (field.grid.columns as usize, field.grid.rows as usize);
    let (r, c) = ((row as usize).min(rows - 2), (column as usize).min(columns - 1));
    let at = |row: usize, column: usize| field.stored[row * columns + column % columns];
    let cell = deepfield_heights::model::Cell([at(r, c), at(r, c + 1), at(r + 1, c), at(r + 1, c + 1)]);
    cell.height(column - c as f64, row - r as f64)
}

/// That each hit is on T, with the radius and at the place that it says, to a part of the globe's radius.
fn check_hits(field: &HeightField, globe: &Globe, sight: &Sight, picture: &SurfacePicture, most: f64) -> usize {
    let [width, _] = sight.size();
    let mut hits = 0;
    for (index, raw) in picture.raw.iter().enumerate() {
        let [depth, x, y, height, row, column, coverage] = *raw;
        if depth.is_nan() {
            continue;
        }
        hits += 1;
        let pixel = [index as f64 % f64::from(width), (index / width as usize) as f64].map(|at: f64| at.floor() + 0.5);
        let (origin, direction) = sight.ray(pixel).unwrap();
        let place = origin + depth * direction;
        let found = globe.place(x, y, height);
        let away = (DVec3::from(found) - place).length() / globe.equator;
        assert!(away < most, "{away} at {pixel:?}: {raw:?}");
        let off = (t_height(field, row, column) - height).abs() / globe.equator;
        assert!(off < most && coverage == 1.0, "{off} of {raw:?}");
    }
    hits
}

#[test]
fn rays_and_triangles_find_t_everywhere() {
    let field = world(96, 3);
    let source = MemorySurface::new(&field, 1.0).unwrap();
    let mut random = Random::new(8);
    for round in 0..12 {
        let globe = globes()[round % 2];
        let placed = Placed::new(&field.grid, Map::Globe(globe), 1.0, 0.0);
        let (longitude, latitude) = match round {
            // The seam, and each pole.
            0 | 1 => (180.0, 20.0),
            2 | 3 => (30.0, 89.0),
            4 | 5 => (30.0, -89.5),
            _ => (random.between(-180.0, 180.0), random.between(-90.0, 90.0)),
        };
        let away = random.between(1.3, 3.0) * globe.equator;
        let eye = away * DVec3::from(Globe::up(longitude, latitude));
        let projection = Projection::Perspective { fov_y: 0.7 };
        let view = View::look_at(eye, DVec3::ZERO, DVec3::new(0.3, 0.1, 1.0), projection, 96, 72).unwrap();
        let sight = Sight::Flat(view);
        let of = |technique: Technique| {
            let options = SurfaceOptions { technique, tau: 0.0, raw: true, look: None, ..SurfaceOptions::default() };
            draw(&source, &placed, &sight, &options)
        };
        let (rays, triangles) = (of(Technique::Rays), of(Technique::Triangles));
        let hits = check_hits(&field, &globe, &sight, &rays, 1e-9);
        check_hits(&field, &globe, &sight, &triangles, 1e-9);
        assert!(hits > 500);
        // They differ at the limb alone, and where a pole is open.
        let differ = rays.raw.iter().zip(&triangles.raw).filter(|(a, b)| a[0].is_nan() != b[0].is_nan()).count();
        assert!(differ < 40, "{differ} of {hits} in round {round}");
    }
}

/// A part of a globe, with its middle at longitude and latitude 0.
fn part_of_globe(mut field: HeightField, step: f64, middle: f64) -> HeightField {
    field.grid.step = [step, -step];
    field.grid.origin = [-middle * step, middle * step];
    (field.grid.xy_unit, field.grid.height_unit) = (Unit::new("deg"), Unit::new("m"));
    field
}

/// Where an error is allowed, T at the place that a pixel tells appears within it, as on flat fields.
#[test]
fn places_on_globes_are_within_the_error() {
    let field = part_of_globe(hills(1000, 1000, 0.0, 9), 0.05, 499.5);
    let source = MemorySurface::new(&field, 1.0).unwrap();
    let up = |longitude: f64, latitude: f64| DVec3::from(Globe::up(longitude, latitude));
    for globe in globes() {
        let placed = Placed::new(&field.grid, Map::Globe(globe), 5.0, 0.0);
        let mut coarse = 0;
        for (eye, target, fov_y) in [
            (1.3 * up(3.0, -2.0), up(0.0, 0.0), 0.1),
            (1.12 * up(-6.0, 5.0), up(4.0, 0.0), 0.1),
            (3.0 * up(10.0, -20.0), DVec3::ZERO, 0.4),
        ] {
            let projection = Projection::Perspective { fov_y };
            let [eye, target] = [eye, target].map(|place| globe.equator * place);
            let sight = Sight::Flat(View::look_at(eye, target, DVec3::Z, projection, 90, 70).unwrap());
            for (technique, tau) in TECHNIQUES.into_iter().flat_map(|one| [0.3, 2.0].map(|tau| (one, tau))) {
                let options = SurfaceOptions { technique, tau, raw: true, ..SurfaceOptions::default() };
                let picture = draw(&source, &placed, &sight, &options);
                let hits = check_places(&field, &placed, &sight, &picture, (technique, 1), tau);
                assert!(hits > 500, "{hits} hits");
                coarse += usize::from(picture.report.levels[1] > 0);
            }
        }
        assert!(coarse > 3, "{coarse}");
    }
}

/// What a level's flat triangles leave of a globe without heights is its outline to within the error: chords are below their arcs.
#[test]
fn outlines_are_within_the_error() {
    let side = 1024;
    // The middle is in the middle of a cell, and inside of one in each coarser level.
    let step = 1.0 / 15.0;
    let field = part_of_globe(HeightField::of(side, side, vec![0.0; (side * side) as usize]), step, 513.5);
    let source = MemorySurface::new(&field, 1.0).unwrap();
    for globe in globes() {
        let placed = Placed::new(&field.grid, Map::Globe(globe), 1.0, 0.0);
        // Along the ground at the middle; the coarsest level sinks by five pixels at most.
        let pixel = placed.sag(4.0, 4.0) / 5.0;
        let target = globe.equator * DVec3::X;
        let eye = target - 3.0 * globe.equator * DVec3::Y;
        let projection = Projection::Orthographic { height: 80.0 * pixel };
        let view = View::look_at(eye, target, DVec3::new(1.0, 0.0, 0.4), projection, 100, 80).unwrap();
        let sight = Sight::Flat(view);
        for (tau, level) in [(0.8, 0), (2.0, 1), (8.0, 2)] {
            for technique in TECHNIQUES {
                let options = SurfaceOptions { technique, tau, raw: true, ..SurfaceOptions::default() };
                let picture = draw(&source, &placed, &sight, &options);
                let mut worst = 0.0_f64;
                for (index, raw) in picture.raw.iter().enumerate() {
                    let (origin, _) = sight.ray([(index % 100) as f64 + 0.5, (index / 100) as f64 + 0.5]).unwrap();
                    // How far the ray passes above the ground, in pixels.
                    let above = (origin.x.hypot(origin.z * globe.equator / globe.pole) - globe.equator) / pixel;
                    if raw[0].is_nan() == (above < 0.0) {
                        worst = worst.max(above.abs());
                    }
                }
                let told = picture.report.error_px;
                assert_eq!(picture.report.levels, [level; 2], "{technique:?}, tau {tau}");
                assert!(told <= tau && worst <= told + 0.01, "{technique:?}, tau {tau}: {worst} px, told {told}");
                assert!(technique == Technique::Rays || worst > 0.2 * told, "{technique:?}: {worst} px of {told}");
            }
        }
    }
}

#[test]
fn raw_channels_around_the_eye() {
    let field = world(96, 4);
    let source = MemorySurface::new(&field, 1.0).unwrap();
    for globe in globes() {
        let placed = Placed::new(&field.grid, Map::Globe(globe), 1.0, 0.0);
        let eye = 1.2 * globe.equator * DVec3::from(Globe::up(175.0, 40.0));
        let view = View::look_at(eye, DVec3::ZERO, DVec3::Z, Projection::Perspective { fov_y: 0.7 }, 120, 60).unwrap();
        let panorama = Panorama::around(&view, Surround::Equirectangular).unwrap().unwrap();
        let sight = Sight::Around { panorama, eye, cut: Cut::NONE };
        let options = SurfaceOptions { raw: true, ..SurfaceOptions::default() };
        let picture = draw(&source, &placed, &sight, &SurfaceOptions { tau: 0.0, ..options });
        let hits = check_hits(&field, &globe, &sight, &picture, 1e-9);
        // Nothing of what is well within the globe's outline is missing.
        let missed = picture.raw.iter().enumerate().filter(|(index, raw)| {
            let pixel = [(index % 120) as f64 + 0.5, (index / 120) as f64 + 0.5];
            let (origin, direction) = sight.ray(pixel).unwrap();
            let nearest = origin - origin.dot(direction) / direction.length_squared() * direction;
            raw[0].is_nan() && origin.dot(direction) < 0.0 && nearest.length() < 0.93 * globe.equator
        });
        assert!(hits > 1000 && missed.count() == 0, "{hits}");
    }
}

/// From wherever one looks there is no gap, neither at the seam nor at poles nor anywhere else, and the far side is not read.
#[test]
fn no_gap_is_seen() {
    let fields = [world(96, 5), world(700, 6)];
    let sources = fields.each_ref().map(|field| MemorySurface::new(field, 1.0).unwrap());
    let mut random = Random::new(2);
    let mut fewer = 0;
    for round in 0..24 {
        let (field, source) = (&fields[round % 2], &sources[round % 2]);
        let globe = globes()[round / 2 % 2];
        let placed = Placed::new(&field.grid, Map::Globe(globe), 1.0, 0.0);
        assert!(placed.is_whole && placed.poles.iter().all(Option::is_some));
        let (longitude, latitude) = match round % 3 {
            0 => (180.0 + random.between(-3.0, 3.0), random.between(-80.0, 80.0)),
            1 => (random.between(-180.0, 180.0), 90.0 - random.between(0.0, 2.0)),
            _ => (random.between(-180.0, 180.0), -90.0 + random.between(0.0, 2.0)),
        };
        let eye = (1.1 + random.between(0.0, 1.0)) * globe.equator * DVec3::from(Globe::up(longitude, latitude));
        let projection = Projection::Perspective { fov_y: 0.3 };
        let up = DVec3::new(random.between(-1.0, 1.0), random.between(-1.0, 1.0), 0.3);
        let view = View::look_at(eye, DVec3::ZERO, up, projection, 112, 84).unwrap();
        let look = Look {
            attribute: Attribute::Height,
            transfer: TransferFunction::default(),
            range: [-100.0, 100.0],
            light: Light::Eye,
            ambient: 0.5,
            contours: None,
        };
        let technique = [Technique::Hybrid, Technique::Triangles, Technique::Rays][round / 4 % 3];
        let tau = [0.8, 8.0][round / 12 % 2];
        let options = SurfaceOptions { technique, tau, look: Some(look), samples: 1, ..SurfaceOptions::default() };
        let picture = draw(source, &placed, &Sight::Flat(view), &options);
        let gaps = picture.colors.rgba.iter().filter(|color| color[3] < 0.999).count();
        assert_eq!(gaps, 0, "round {round}, {technique:?}: from {longitude} {latitude}");
        fewer += usize::from(picture.report.samples_drawn < field.stored.len() as u64);
    }
    assert!(fewer > 5, "{fewer}");
}

/// The middle of a globe around which columns go, as many chunks as there are.
fn belt(columns: usize, seed: u64) -> HeightField {
    let rows = columns / 3;
    let mut field = hills(rows, columns, 0.0, seed);
    let step = 360.0 / columns as f64;
    field.grid.step = [step, -step];
    field.grid.origin = [-180.0 + 0.5 * step, 0.5 * step * (rows - 1) as f64];
    (field.grid.xy_unit, field.grid.height_unit) = (Unit::new("deg"), Unit::new("m"));
    field
}

/// From above a place near the seam, whole of the picture filled.
fn over_the_seam(globe: &Globe, random: &mut Random) -> View {
    let up = |longitude: f64, latitude: f64| DVec3::from(Globe::up(longitude, latitude));
    let (longitude, latitude) = (180.0 + random.between(-2.0, 2.0), random.between(-25.0, 25.0));
    let eye = (1.08 + random.between(0.0, 0.3)) * globe.equator * up(longitude, latitude);
    let target = globe.equator * up(180.0 + random.between(-1.0, 1.0), latitude + random.between(-1.0, 1.0));
    let aside = DVec3::new(random.between(-1.0, 1.0), random.between(-1.0, 1.0), 0.3);
    View::look_at(eye, target, aside, Projection::Perspective { fov_y: 0.4 }, 120, 90).unwrap()
}

/// The seam is closed whatever number of columns there is, and whatever levels meet at it.
#[test]
fn no_gap_is_seen_across_the_seam() {
    let mut random = Random::new(12);
    let mut joined = 0;
    for (number, columns) in [257_usize, 513, 500, 1537].into_iter().enumerate() {
        let field = belt(columns, 6);
        let memory = MemorySurface::new(&field, 1.0).unwrap();
        let globe = globes()[columns % 2];
        let placed = Placed::new(&field.grid, Map::Globe(globe), 1.0, 0.0);
        let closed = Closed::of(&memory, &placed).unwrap();
        // All of techniques, errors and budgets, each with some field.
        for round in 6 * number..6 * (number + 1) {
            let view = over_the_seam(&globe, &mut random);
            let sight = Sight::Flat(view);
            let technique = [Technique::Hybrid, Technique::Triangles, Technique::Rays][round % 3];
            let options = SurfaceOptions {
                technique,
                tau: [0.8, 8.0][round / 3 % 2],
                most_nodes: [1 << 14, 3, 9][round / 6 % 3],
                raw: true,
                ..SurfaceOptions::default()
            };
            let picture = draw(&memory, &placed, &sight, &options);
            let gaps = picture.raw.iter().filter(|raw| raw[0].is_nan()).count();
            assert_eq!(gaps, 0, "{columns} columns, round {round}, {technique:?}: {view:?}");
            let cut = random_cut(&closed, &placed, &sight, &mut random, 0);
            let scene = Scene::new(&closed, &placed, cut);
            let is_joined = |mesh: &&Mesh| {
                mesh.is_laid[2] && mesh.columns[0] == 0
                    || mesh.is_laid[3] && mesh.columns.last() == Some(&(columns as u64))
            };
            joined += scene.meshes.iter().filter(is_joined).count();
            let picture = Visibility::new([view.width, view.height]);
            raster::draw(&scene, &view, &picture, [1; 2]);
            let gaps = (0..picture.width * picture.height).filter(|index| picture.at(*index).is_none()).count();
            assert_eq!(gaps, 0, "{columns} columns, random cut {round}: {view:?}");
        }
    }
    assert!(joined > 5, "{joined}");
}

#[test]
fn what_a_pixel_shows_has_a_number_of_its_own() {
    let mut known = std::collections::HashSet::new();
    let mut check = |at: [usize; 2], slot: Option<usize>| {
        let shown = Shown { node: 9_000, at, slot };
        assert!(Shown::unpack(shown.pack()) == shown && known.insert(shown.pack()), "{shown:?}");
    };
    for column in 0..258 {
        (0..257).for_each(|row| check([row, column], None));
    }
    for column in 0..257 {
        (0..256).for_each(|row| (0..2).for_each(|slot| check([row, column], Some(slot))));
        (0..2).for_each(|end| check([0, column], Some(POLE + end)));
    }
}
