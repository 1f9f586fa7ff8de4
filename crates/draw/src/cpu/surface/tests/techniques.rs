//! What each technique shows, against rays through T.

use super::super::look::{Attribute, Contours, Light, Look};
use super::super::picture::{SurfaceOptions, SurfacePicture, draw};
use super::super::select::Technique;
use super::*;
use crate::color::TransferFunction;

pub(super) fn view(eye: [f64; 3], target: [f64; 3], projection: Projection, size: [u32; 2]) -> Sight {
    let up = if eye[0] == target[0] && eye[1] == target[1] { DVec3::Y } else { DVec3::Z };
    Sight::Flat(View::look_at(DVec3::from(eye), DVec3::from(target), up, projection, size[0], size[1]).unwrap())
}

pub(super) fn raw(
    source: &MemorySurface,
    placed: &Placed,
    sight: &Sight,
    (technique, point): (Technique, u32),
    tau: f64,
) -> SurfacePicture {
    draw(source, placed, sight, &SurfaceOptions { technique, point, tau, raw: true, ..SurfaceOptions::default() })
}

pub(super) const TECHNIQUES: [Technique; 3] = [Technique::Hybrid, Technique::Triangles, Technique::Rays];

/// T at the place that a pixel tells appears within the error of the pixel's centre, for points within their pixel, which the error told
/// counts wider ones from; and depth, place and height agree. How many pixels show something.
pub(super) fn check_places(
    field: &HeightField,
    placed: &Placed,
    sight: &Sight,
    picture: &SurfacePicture,
    (technique, point): (Technique, u32),
    tau: f64,
) -> usize {
    let (mut hits, mut worst) = (0, 0.0_f64);
    for (index, channels) in picture.raw.iter().enumerate() {
        let [depth, x, y, height, row, column, coverage] = *channels;
        if depth.is_nan() {
            continue;
        }
        hits += 1;
        assert!(coverage > 0.0 && coverage <= 1.0 && [x, y] == field.grid.place(row, column));
        let width = sight.size()[0] as usize;
        let centre = [(index % width) as f64 + 0.5, (index / width) as f64 + 0.5];
        let shown = placed.world(row, column, height) - sight.eye();
        let (_, told) = sight.project(shown).unwrap();
        assert!((told - depth).abs() < 1e-6 * depth.abs(), "{told} {depth}");
        let true_height = t_height(field, row, column);
        if true_height.is_nan() {
            continue;
        }
        let place = placed.world(row, column, true_height) - sight.eye();
        let (at, _) = sight.project(place).unwrap();
        let is_point = row.fract() == 0.0 && column.fract() == 0.0;
        let slack = if is_point { 0.5_f64.sqrt() } else { 0.0 };
        let away = (at[0] - centre[0]).hypot(at[1] - centre[1]) - slack;
        worst = worst.max(away);
        let most = slack.mul_add(f64::from(point - 1), tau) + 0.01;
        assert!(away <= most, "{technique:?}, tau {tau}: {away} px at {centre:?}");
    }
    let told = picture.report.error_px;
    assert!(worst <= told + 0.01, "{technique:?}, tau {tau}: {worst} px, told {told}");
    hits
}

#[test]
fn places_are_within_the_error() {
    let perspective = Projection::Perspective { fov_y: 0.8 };
    for (holes, seed) in [(0.0, 1), (0.3, 2)] {
        let field = hills(700, 900, holes, seed);
        let source = MemorySurface::new(&field, 1.0).unwrap();
        for (exaggeration, base, point) in [(1.0, 0.0, 1), (3.0, 12.0, 3)] {
            let placed = Placed::new(&field.grid, Map::Plate, exaggeration, base);
            let ground = placed.lifted(t_height(&field, 300.0, 450.0).max(-60.0));
            for (sight, tau) in [
                (
                    view(
                        [450.0, 350.0, 900.0],
                        [450.0, 350.0, 0.0],
                        Projection::Orthographic { height: 800.0 },
                        [90, 70],
                    ),
                    0.8,
                ),
                (view([850.0, -200.0, 500.0], [450.0, 350.0, 0.0], perspective, [100, 70]), 2.0),
                (view([450.0, 300.0, ground + 3.0], [700.0, 500.0, -40.0], perspective, [100, 70]), 0.5),
                (view([450.0, 300.0, -400.0], [500.0, 360.0, 0.0], perspective, [60, 60]), 8.0),
            ] {
                for technique in TECHNIQUES {
                    let picture = raw(&source, &placed, &sight, (technique, point), tau);
                    let hits = check_places(&field, &placed, &sight, &picture, (technique, point), tau);
                    assert!(hits > 500, "{hits} hits");
                }
            }
        }
    }
}

/// From above, coverage adds up to the valid area at any distance.
#[test]
fn area_is_conserved() {
    let side = 700;
    let mut field = hills(side, side, 0.3, 6);
    let flat = field.stored.clone();
    // Lone samples have no area and fill a pixel.
    let valid = |r: i64, c: i64| {
        (0..side as i64).contains(&r) && (0..side as i64).contains(&c) && !flat[r as usize * side + c as usize].is_nan()
    };
    let mut area = 0.0;
    for (r, c) in (0..side as i64).flat_map(|r| (0..side as i64).map(move |c| (r, c))) {
        let measured =
            |r: i64, c: i64| [(0, 0), (0, 1), (1, 0), (1, 1)].iter().filter(|(i, j)| valid(r + i, c + j)).count();
        let is_used = (-1..=0).any(|i| (-1..=0).any(|j| measured(r + i, c + j) >= 3));
        if !is_used {
            field.stored[r as usize * side + c as usize] = f64::NAN;
        }
        area += [0.0, 0.0, 0.0, 0.5, 1.0]
            [if (r as usize) < side - 1 && (c as usize) < side - 1 { measured(r, c) } else { 0 }];
    }
    let (source, placed) = (MemorySurface::new(&field, 1.0).unwrap(), placed(&field));
    for (samples, point) in [(0.3_f64, 1), (1.0, 1), (10.0, 1), (40.0, 1), (40.0, 3)] {
        let high = 1.3 * side as f64;
        let pixels = (high / samples.sqrt()) as u32;
        let middle = side as f64 / 2.0;
        let (target, up) =
            (DVec3::new(middle + 0.123, middle + 0.377, 0.0), DVec3::new(0.35_f64.sin(), 0.35_f64.cos(), 0.0));
        let projection = Projection::Orthographic { height: high };
        let view = View::look_at(target + DVec3::Z * 900.0, target, up, projection, pixels, pixels).unwrap();
        let picture = raw(&source, &placed, &Sight::Flat(view), (Technique::Hybrid, point), 0.8);
        let found = picture.report.covered * (high / f64::from(pixels)).powi(2);
        // The finer the pixels, the more of them share in the error.
        let bar = 1.2 / (side as f64) * samples.max(1.0).sqrt().min(3.0);
        assert!((found / area - 1.0).abs() < bar, "{samples} samples a pixel: {found} of {area}");
    }
}

fn look(attribute: Attribute, light: Light) -> Look {
    let transfer = TransferFunction::parse(
        "(color_map: [(0.0, \"#402010\"), (0.5, \"#a0c040\"), (1.0, \"#f0f0ff\")], scale: linear)",
        "t.ron",
    )
    .unwrap();
    Look { attribute, transfer, range: [-120.0, 120.0], light, ambient: 0.2, contours: None }
}

/// All techniques look alike, pixel by pixel, in the mean and in bands, and the picture is the same for any number of threads.
#[test]
fn techniques_agree() {
    let field = hills(600, 700, 0.0, 8);
    let (source, placed) = (MemorySurface::new(&field, 1.0).unwrap(), placed(&field));
    let sun = Light::Sun { azimuth: 315.0, altitude: 45.0 };
    let sight = view([800.0, -300.0, 700.0], [350.0, 300.0, 0.0], Projection::Perspective { fov_y: 0.8 }, [150, 100]);
    for light in [Light::Eye, sun] {
        let draw_with = |technique: Technique| {
            let look = Some(look(Attribute::Height, light));
            draw(&source, &placed, &sight, &SurfaceOptions { technique, tau: 0.5, look, ..SurfaceOptions::default() })
        };
        let reference = draw_with(Technique::Rays).colors.image();
        for technique in [Technique::Hybrid, Technique::Triangles, Technique::Points] {
            let one = draw_with(technique);
            let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
            assert_eq!(pool.install(|| draw_with(technique)).colors, one.colors);
            let image = one.colors.image();
            let differ = |(a, b): (&[u8; 4], &[u8; 4])| (0..3).map(|k| a[k].abs_diff(b[k])).max().unwrap();
            let apart: Vec<u8> = image.rgba.iter().zip(&reference.rgba).map(differ).collect();
            let many = apart.iter().filter(|difference| **difference > 4).count();
            assert!(many * 100 <= apart.len(), "{technique:?}: {many} of {} pixels", apart.len());
            let pairs = || image.rgba.iter().zip(&reference.rgba).flat_map(|(a, b)| (0..3).map(move |k| (a[k], b[k])));
            let mean = pairs().map(|(a, b)| f64::from(a.abs_diff(b))).sum::<f64>() / pairs().count() as f64;
            assert!(mean < 0.5, "{technique:?}: {mean} in the mean");
            // Five rows of 150 pixels: where chunks of other levels begin there is no step.
            let brighter: Vec<f64> = pairs().map(|(a, b)| f64::from(a) - f64::from(b)).collect();
            for (number, band) in brighter.chunks(5 * 150 * 3).enumerate() {
                let mean = band.iter().sum::<f64>() / band.len() as f64;
                assert!(mean.abs() < 1.0, "{technique:?}: {mean} in band {number}");
            }
        }
    }
}

/// A line of a ramp is where it belongs and as wide as it is asked to be; so many that they cannot be told apart become their mean.
#[test]
fn contours_keep_their_width() {
    let heights = (0..200 * 200).map(|index| 0.1 * f64::from(index % 200)).collect();
    let field = HeightField::of(200, 200, heights);
    let (source, placed) = (MemorySurface::new(&field, 1.0).unwrap(), placed(&field));
    let sight =
        view([100.0, 100.0, 500.0], [100.0, 100.0, 0.0], Projection::Orthographic { height: 180.0 }, [360, 360]);
    let lines = |interval: f64| {
        let contours = Some(Contours { interval, base: 0.0, major: 0, width: 2.0, color: [0.0; 3], labels: None });
        let look = Some(Look { ambient: 1.0, contours, ..look(Attribute::Height, Light::Eye) });
        let options = SurfaceOptions { look, ..SurfaceOptions::default() };
        let plain =
            SurfaceOptions { look: Some(self::look(Attribute::Height, Light::Eye)), ..SurfaceOptions::default() };
        let plain = SurfaceOptions { look: plain.look.map(|look| Look { ambient: 1.0, ..look }), ..plain };
        let [with, without] = [options, plain].map(|options| draw(&source, &placed, &sight, &options).colors);
        let share = |(a, b): (&[f32; 4], &[f32; 4])| f64::from(1.0 - a[1] / b[1]);
        with.rgba.iter().zip(&without.rgba).map(share).collect::<Vec<f64>>()
    };
    let few = lines(5.0);
    // Lines at x = 50, 100, 150: columns of two pixels each, 2 px wide.
    let row = &few[180 * 360..181 * 360];
    assert!((row.iter().sum::<f64>() - 3.0 * 2.0).abs() < 0.05, "{}", row.iter().sum::<f64>());
    assert!(row[179] > 0.95 && row[180] > 0.95 && row[182] < 0.01);
    let many = lines(0.05);
    assert!(many.iter().all(|share| (share - 0.5).abs() < 0.02));
}

/// On a globe lines are where heights are theirs, as wide as elsewhere, whatever is drawn.
#[test]
fn lines_are_drawn_on_globes() {
    let mut field = hills(300, 400, 0.0, 4);
    field.stored.iter_mut().enumerate().for_each(|(index, height)| {
        let (x, y) = ((index % 400) as f64, (index / 400) as f64);
        *height = 6.0 * (x / 17.0).sin() * (y / 23.0).cos() + 0.01 * x;
    });
    (field.grid.origin, field.grid.step) = ([-40.0, -30.0], [0.2, 0.2]);
    field.grid.xy_unit = crate::model::Unit::new("deg");
    let placed = Placed::new(&field.grid, Map::Globe(deepfield_heights::model::Globe::sphere(1000.0)), 2.0, 0.0);
    let source = MemorySurface::new(&field, 1.0).unwrap();
    let size = [220, 160];
    for (height, technique) in
        [(900.0, Technique::Triangles), (900.0, Technique::Hybrid), (200.0, Technique::Triangles)]
    {
        let sight = view([3000.0, 0.0, 0.0], [0.0; 3], Projection::Orthographic { height }, size);
        let draw_with = |lines: bool| {
            let contours = Contours { interval: 4.0, base: 1.0, major: 0, width: 1.5, color: [0.0; 3], labels: None };
            let look = Look { ambient: 1.0, contours: lines.then_some(contours), ..look(Attribute::Level, Light::Eye) };
            draw(
                &source,
                &placed,
                &sight,
                &SurfaceOptions { technique, look: Some(look), raw: !lines, tau: 0.3, ..SurfaceOptions::default() },
            )
        };
        let (plain, lined) = (draw_with(false), draw_with(true));
        let at = |x: usize, y: usize| plain.raw[y * size[0] as usize + x][3];
        let (mut on, mut off) = (0, 0);
        for (x, y) in (2..size[1] as usize - 2).flat_map(|y| (2..size[0] as usize - 2).map(move |x| (x, y))) {
            let rise = [at(x + 1, y) - at(x - 1, y), at(x, y + 1) - at(x, y - 1)].map(|rise| 0.5 * rise);
            let steep = rise[0].hypot(rise[1]);
            let nearest = ((at(x, y) - 1.0) / 4.0).round() * 4.0 + 1.0;
            // Where lines are not close to each other, nor the surface almost level.
            if !(steep * 6.0 < 4.0 && steep > 0.02) {
                continue;
            }
            let away = (at(x, y) - nearest).abs() / steep;
            let [with, without] = [&lined, &plain].map(|picture| picture.colors.rgba[y * size[0] as usize + x]);
            let share = 1.0 - (0..3).map(|k| with[k]).sum::<f32>() / (0..3).map(|k| without[k]).sum::<f32>();
            let slack = if technique == Technique::Hybrid { 0.7 } else { 0.0 };
            if away < 0.3 - slack {
                on += 1;
                assert!(share > 0.5, "{share} at {x} {y}, {away} px from the line");
            } else if away > 2.0 + slack {
                off += 1;
                assert!(share < 0.05, "{share} at {x} {y}, {away} px from the line");
            }
        }
        assert!(off > 1000 && (on > 200 || technique == Technique::Hybrid), "{on} {off}");
    }
}

/// Walls reach from the surface to the base at the border and where a box cuts, and are no data.
#[test]
fn walls_close_the_sides() {
    let field = HeightField::of(101, 101, (0..101 * 101).map(|index| 10.0 + 0.1 * f64::from(index % 101)).collect());
    let (source, placed) = (MemorySurface::new(&field, 1.0).unwrap(), placed(&field));
    // From the right, so that the right side is seen: x = 100, or where the box ends.
    let projection = Projection::Orthographic { height: 60.0 };
    let Sight::Flat(whole) = view([400.0, 50.0, 10.0], [0.0, 50.0, 10.0], projection, [120, 60]) else {
        unreachable!()
    };
    for (end, technique) in [(100.0, Technique::Hybrid), (70.0, Technique::Triangles), (70.0, Technique::Rays)] {
        let mut cut = whole;
        if end < 100.0 {
            cut.cut.bounds = Bounds { min: DVec3::new(30.0, -1e9, -1e9), max: DVec3::new(end, 1e9, 1e9) };
        }
        let draw_with = |walls: Option<f64>| {
            let look = Some(look(Attribute::Height, Light::Eye));
            draw(
                &source,
                &placed,
                &Sight::Flat(cut),
                &SurfaceOptions { technique, look, walls, raw: true, ..SurfaceOptions::default() },
            )
        };
        let (open, closed) = (draw_with(None), draw_with(Some(4.0)));
        let bits =
            |picture: &SurfacePicture| picture.raw.iter().flatten().map(|value| value.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&open), bits(&closed));
        assert!(closed.report.covered <= open.report.covered + 1e-3);
        let top = 10.0 + 0.1 * end;
        for (index, color) in closed.colors.rgba.iter().enumerate() {
            // A pixel is a unit; the middle of the picture is at y = 50, z = 10.
            let (y, z) = ((index % 120) as f64 - 59.5, 10.0 - (index / 120) as f64 + 29.5);
            let is_wall = y.abs() < 49.0 && z > 4.6 && z < top - 0.6;
            let is_beside = y.abs() > 51.0 || z < 3.4 || z > top + 0.6;
            assert!(!is_wall || color[3] > 0.999, "{y} {z}: {color:?}");
            assert!(!is_beside || color[3] < 0.001, "{y} {z}: {color:?}");
        }
    }
}
