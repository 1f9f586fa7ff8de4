//! Where surfaces are, and which way they face.

use super::*;
use crate::color::transfer::Scale;
use crate::cpu::field::{Field, FieldBricks, ValueAxis};
use crate::cpu::volume::block::{BEFORE, Block, FRONT, Numbers, Place};
use crate::cpu::volume::bricks::{BORDER, BRICK, Slab};
use crate::cpu::volume::surface::{Crossings, gradient};
use crate::model::{Channel, Grid, SampleType, Unit};

#[test]
fn a_surface_is_where_the_field_has_its_value() {
    // A ball of one kernel: the surface of half its peak is a sphere. Lit from the eye without ambient light, its brightness
    // is the cosine.
    let mut cloud = Cloud::default();
    cloud.push([0.0; 3], 1.0, 1.0, 1.0);
    let peak = Kernel::CubicSpline.value(0.0);
    let radius = (1..1000).map(|i| f64::from(i) / 1000.0).find(|&r| Kernel::CubicSpline.value(r) < 0.5 * peak).unwrap();
    let surface = Surface { value: 0.5 * peak as f32, color: Some([1.0; 3]), opacity: 1.0 };
    for projection in [Projection::Orthographic { height: 1.6 }, Projection::Perspective { fov_y: 0.5 }] {
        for resolution in [1.0, 0.5] {
            let view = look(DVec3::new(0.0, 0.0, 3.2), projection, 101, 101);
            let mut scenery = scenery(RAMP, [1e-2, 10.0], 1.0, vec![surface]);
            scenery.volume = false;
            scenery.light = Some(Light { ambient: 0.0, specular: 0.0, shininess: 1.0 });
            let options = VolumeOptions { grid: GridOptions { resolution, lambda: true }, ..VolumeOptions::default() };
            let (colors, _) = draw(&view, &[cloud.batch()], &scenery, &options).unwrap();
            let (mut wrong, mut squares, mut lit) = (0, 0.0, 0);
            for (index, pixel) in colors.rgba.iter().enumerate() {
                let focal = view.focal_pixels();
                let [x, y] = [(index % 101) as f64 - 50.0, 50.0 - (index / 101) as f64].map(|at| at / focal);
                let (origin, ray) = match projection {
                    Projection::Orthographic { .. } => (DVec3::new(x, y, -3.2), DVec3::Z),
                    Projection::Perspective { .. } => (DVec3::new(0.0, 0.0, -3.2), DVec3::new(x, y, 1.0).normalize()),
                };
                let along = origin.dot(ray);
                let root = along * along - origin.length_squared() + radius * radius;
                wrong += u32::from((root > 0.0) != (pixel[3] > 0.5));
                if root > 0.04 && pixel[3] > 0.5 {
                    let normal = (origin + (-along - root.sqrt()) * ray) / radius;
                    squares += (normal.dot(ray).abs() - f64::from(pixel[0])).powi(2);
                    lit += 1;
                }
            }
            let error = (squares / f64::from(lit)).sqrt();
            assert!(wrong < 60 && lit > 1000 && error < 0.01, "{projection:?} {resolution}: {wrong} {lit} {error}");
        }
    }
}

#[test]
fn surfaces_of_samples_face_as_the_body_that_was_sampled() {
    // A ball in bytes, whose border is a few samples wide, in cells of two thirds of a sample.
    let (middle, radius) = (DVec3::new(31.3, 31.6, 31.1), 20.3);
    let value = |i: usize| {
        let at = DVec3::new((i % 64) as f64, (i / 64 % 64) as f64, (i / 4096) as f64);
        (255.0 / (1.0 + ((at.distance(middle) - radius) / 0.75).exp())).round() as f32
    };
    let samples = Grid::volume([64; 3], SampleType::U8, Channel::numbered(1));
    let values: Vec<f32> = (0..64 * 64 * 64).map(value).collect();
    let field = Field::new(&samples, vec![("value".into(), Unit::default(), values)], None);
    let axis = ValueAxis::new(Scale::Linear, [0.0, 255.0]);
    let surface = Surface { value: axis.place(127.5), color: None, opacity: 1.0 };
    let eye = middle + 80.0 * DVec3::new(0.3, 0.5, 0.8).normalize();
    for projection in [Projection::Orthographic { height: 52.0 }, Projection::Perspective { fov_y: 0.8 }] {
        let view = View::look_at(eye, middle, DVec3::Y, projection, 80, 80).unwrap();
        let grid = PerspectiveGrid::new(&view, [50.0, 110.0], &GridOptions::default()).unwrap();
        let brick_grid = BrickGrid::new(&grid);
        let mut bricks = FieldBricks::new(&field, axis, &view, &grid, &brick_grid);
        let (layers, _) = bricks.fill(0..brick_grid.bricks[2], &[]);
        let slab = Slab { first: 0, layers };
        let mut block = Block::default();
        // By samples, and by differences of cells: the angles' squares and the largest, degrees.
        let (mut squares, mut largest, mut found) = ([0.0f64; 2], [0.0f64; 2], 0u32);
        for index in (0..80 * 80).step_by(7) {
            let [i, j]: [usize; 2] = [index % 80, index / 80];
            for step in 2..brick_grid.slices - 1 {
                let around = [0, 1, 2, 3].map(|slice: usize| slab.at([i, j, step - 2 + slice], &brick_grid)[0]);
                let crossings = Crossings::find(around, &[surface]);
                let Some(at) = crossings.iter().next().map(|crossing| crossing.at) else { continue };
                let place = [i as f64 + 0.5, j as f64 + 0.5];
                let hit = world(&view, grid.to_camera([place[0], place[1], step as f64 - 0.5 + f64::from(at)]));
                let [x, y] = [i + BORDER, j + BORDER];
                let layer = ((step + 1) / BRICK).min(brick_grid.bricks[2] - 1);
                assert!(block.fill(&slab, &brick_grid, [x / BRICK, y / BRICK, layer], 0.0));
                let cell = Place { x: x % BRICK + BEFORE, y: y % BRICK + BEFORE, shares: [0.0; 2] };
                let away = [0, 1].map(|axis: usize| (place[axis] - grid.middle[axis]) as f32);
                let z = step + FRONT - layer * BRICK;
                let by_samples = bricks.slope(place, step, at, surface.value).unwrap();
                let by_cells = gradient((&block, Numbers::Surfaces), &brick_grid, &cell, away, step, z, at);
                for (k, slope) in [by_samples, by_cells].into_iter().enumerate() {
                    let slope = DVec3::from_array(slope.map(f64::from));
                    let slope = slope.x * view.right + slope.y * view.up + slope.z * view.forward;
                    let angle = slope.angle_between(middle - hit).to_degrees();
                    squares[k] += angle * angle;
                    largest[k] = largest[k].max(angle);
                }
                found += 1;
            }
        }
        let [by_samples, by_cells] = squares.map(|square| (square / f64::from(found)).sqrt());
        println!("{found} places: {by_samples:.3} and {by_cells:.3} degrees, at most {largest:.3?}");
        assert!(found > 400 && by_samples < 0.25 && largest[0] < 0.7, "{by_samples} {largest:?}");
        assert!(by_cells > 0.6 && largest[1] > 1.5, "{by_cells} {largest:?}");
    }
}
