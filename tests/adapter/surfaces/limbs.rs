//! The limbs of globes with holes by an adapter's passes: where a pixel's middle is beside a globe, the mean of the samples in the pixel is covered.

use super::*;
use deepfield::cpu::surface::picture::{SurfaceOptions, draw, scene};
use deepfield::cpu::surface::sight::Sight;
use std::f64::consts::TAU;

const GLOBE: Globe = Globe { equator: 20_000.0, pole: 19_500.0 };
/// Columns and rows of samples on it.
const ALL_AROUND: [usize; 2] = [300, 150];
/// The height in the middle of the field's.
const HEIGHT: f64 = 40.0;

/// A globe of which three of ten columns were not measured.
fn striped() -> HeightField {
    let [columns, rows] = ALL_AROUND;
    let height = |index: usize| {
        let (x, y) = ((index % columns) as f64, (index / columns) as f64);
        if index % columns % 10 > 2 { HEIGHT + 0.2 * ((y / 31.0).sin() + (x / 23.0).cos()) } else { f64::NAN }
    };
    let mut field = HeightField::of(columns as u64, rows as u64, (0..rows * columns).map(height).collect());
    let step = 360.0 / columns as f64;
    (field.grid.step, field.grid.origin) = ([step, -step], [-180.0 + 0.5 * step, 90.0 - 0.5 * step]);
    (field.grid.xy_unit, field.grid.height_unit) = (Unit::new("deg"), Unit::new("m"));
    field
}

/// All of the globe: over the seam, over a pole, in perspective, and so far away that a coarser level is drawn.
fn views() -> [View; 4] {
    // Longitude, latitude, samples a pixel in the middle of a picture in parallel, and whether it is in perspective.
    let places =
        [(170.0, 40.0, 10.0, false), (30.0, 85.0, 10.0, false), (20.0, -20.0, 10.0, true), (170.0, -5.0, 40.0, false)];
    places.map(|(longitude, latitude, samples, is_perspective): (f64, f64, f64, bool)| {
        let pixel = GLOBE.equator * TAU / ALL_AROUND[0] as f64 * samples.sqrt();
        let pixels = (2.1 * GLOBE.equator / pixel).ceil();
        let projection = match is_perspective {
            true => Projection::Perspective { fov_y: 0.75 },
            false => Projection::Orthographic { height: pixels * pixel },
        };
        let eye = 3.0 * GLOBE.equator * DVec3::from(Globe::up(longitude, latitude));
        let aside = DVec3::new(0.3, 0.1, 1.0);
        View::look_at(eye, DVec3::ZERO, aside, projection, pixels as u32, pixels as u32).unwrap()
    })
}

/// Whether the middle of a pixel is beside the globe: in a world in which that is a ball, with room for what stands on it.
fn is_beside(sight: &Sight, index: usize) -> bool {
    let width = sight.size()[0] as usize;
    let pixel = [(index % width) as f64 + 0.5, (index / width) as f64 + 0.5];
    let ball = DVec3::new(1.0, 1.0, GLOBE.equator / GLOBE.pole);
    let (origin, direction) = sight.ray(pixel).map(|(origin, direction)| (origin * ball, direction * ball)).unwrap();
    let nearest = origin - origin.dot(direction) / direction.length_squared() * direction;
    nearest.length() > 1.012 * GLOBE.equator
}

#[test]
fn an_adapter_covers_limbs_of_globes_as_the_processor_does() {
    let folder = tempfile::tempdir().unwrap();
    let field = striped();
    let file = HeightFile::open(&built(folder.path(), &field), ReadMethod::default()).unwrap();
    let nodes = PagedSurface::new(Arc::new(file), 1 << 30);
    let placed = Placed::new(&field.grid, Map::Globe(GLOBE), 3.0, 0.0);
    let look = Look {
        attribute: Attribute::Height,
        transfer: TransferFunction::preset("grey").unwrap(),
        range: [HEIGHT - 1.0, HEIGHT + 1.0],
        light: Light::Eye,
        ambient: 0.5,
        contours: None,
    };
    let options = SurfaceOptions { samples: 1, look: Some(look.clone()), ..SurfaceOptions::default() };
    let expected = views().map(|view| draw(&nodes, &placed, &Sight::Flat(view), &options).colors);
    let mut adapter = Offscreen::preferred();
    for passes in [Passes::Compute, Passes::Raster] {
        let (mut both, mut open, mut apart, mut lost, mut sums) = (0, 0, 0, 0, [0.0; 2]);
        for (view, expected) in views().into_iter().zip(&expected) {
            let sight = Sight::Flat(view);
            let scene = scene(&nodes, &placed, &sight, &options);
            let job = AdapterSurface { reference: HEIGHT, ..plain_job(scene, view, look.clone(), passes) };
            let AdapterValues::Light(found, _) = adapter.surface(Arc::new(job)).unwrap().values else { panic!("sums") };
            let pairs = found.rgba.iter().zip(&expected.rgba).map(|(found, expected)| [found[3], expected[3]]);
            for (_, pair) in pairs.enumerate().filter(|(index, _)| is_beside(&sight, *index)) {
                let hits = pair.iter().filter(|alpha| **alpha > 0.0).count();
                both += usize::from(hits == 2);
                lost += usize::from(hits == 1);
                open += usize::from(hits == 2 && pair[1] < 0.99);
                apart += usize::from(hits == 2 && (pair[0] - pair[1]).abs() > 0.01);
                (0..2).for_each(|k| sums[k] += f64::from(pair[k]));
            }
        }
        println!("{passes:?}: {apart} of {both} apart, {open} with holes, {lost} in one picture alone, {sums:?}");
        assert!(both > 50 && 2 * open > both, "{passes:?}: {open} of {both}");
        // Compute passes round places to 256ths of a pixel, and the processor more finely: of a hundred samples one is in the pixel beside.
        assert!(20 * apart <= both && 20 * lost <= both, "{passes:?}: {apart} and {lost} of {both}");
        assert!((sums[0] / sums[1] - 1.0).abs() < 0.02, "{passes:?}: {sums:?}");
    }
}
