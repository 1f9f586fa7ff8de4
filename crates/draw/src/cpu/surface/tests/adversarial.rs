//! Fields that surfaces are hard to draw of: steps, spikes, holes everywhere, a single sample, as few as there can be, and shapes that no camera fits.

use super::super::select::Technique;
use super::techniques::{TECHNIQUES, check_places, raw, view};
use super::*;

/// Heights of a wave along each axis.
fn waves(row: usize, column: usize, length: f64, height: f64) -> f64 {
    let turn = |at: usize| (std::f64::consts::TAU * at as f64 / length).sin();
    height * turn(row) * turn(column)
}

fn field(rows: usize, columns: usize, height: impl Fn(usize, usize) -> f64) -> HeightField {
    let heights = (0..rows * columns).map(|index| height(index / columns, index % columns)).collect();
    HeightField::of(columns as u64, rows as u64, heights)
}

/// Every second sample, of which no two are neighbours.
fn checker() -> HeightField {
    field(300, 400, |row, column| if (row + column) % 2 == 1 { f64::NAN } else { waves(row, column, 128.0, 5.0) })
}

fn single() -> HeightField {
    field(1000, 1000, |row, column| if [row, column] == [432, 567] { 3.0 } else { f64::NAN })
}

/// From above, from aside, grazing and from below, so that some of the field is seen whatever its shape is.
fn views(field: &HeightField, placed: &Placed) -> [Sight; 4] {
    let [first, last] = placed.corners();
    let (middle, half) = (0.5 * (first + last), 0.5 * (last - first).abs());
    let reach = half.x.min(50.0 * half.y).max(half.y.min(50.0 * half.x));
    let [_, high] = box_of(field);
    let from = |x: f64, y: f64, z: f64| [middle.x + x * reach, middle.y + y * reach, z * reach];
    let (at, perspective) = ([middle.x, middle.y, 0.0], Projection::Perspective { fov_y: 0.8 });
    let above = [middle.x, middle.y, high.z.max(0.0) + reach];
    let upright = Projection::Orthographic { height: 2.1 * reach };
    let eyes = [from(0.9, -1.2, 1.5), from(-1.2, -1.6, 0.105), from(0.3, 0.2, -2.0)];
    let [slant, grazing, below] = eyes.map(|eye| view(eye, at, perspective, [96, 64]));
    [view(above, at, upright, [96, 64]), slant, grazing, below]
}

#[test]
fn hard_fields_are_drawn_within_the_error() {
    let mut long = hills(300, 400, 0.0, 5);
    long.grid.step = [1.0, 100.0];
    let fields = [
        ("step", field(300, 400, |_, column| if column < 133 { 0.0 } else { 1000.0 })),
        ("spike", field(520, 700, |row, column| if [row, column] == [300, 350] { 1e6 } else { 0.0 })),
        ("checker", checker()),
        ("single", single()),
        ("least", field(2, 2, |row, column| (1 << row << column) as f64)),
        ("strip", field(2, 5000, |row, column| row as f64 + 5.0 * (0.1 * column as f64).sin())),
        ("long", long),
    ];
    for (name, field) in fields {
        let (source, placed) = (MemorySurface::new(&field, 1.0).unwrap(), placed(&field));
        for (number, technique) in TECHNIQUES.into_iter().enumerate() {
            let mut hits = 0;
            for (k, sight) in views(&field, &placed).iter().enumerate() {
                let tau = [0.5, 2.0, 8.0][(number + k) % 3];
                let picture = raw(&source, &placed, sight, (technique, 1), tau);
                hits += check_places(&field, &placed, sight, &picture, (technique, 1), tau);
            }
            assert!(hits > 0, "{name}, {technique:?}");
        }
    }
}

/// Samples in no triangle show near by, and never vanish from afar.
#[test]
fn lone_samples_never_vanish() {
    for field in [checker(), single()] {
        let (source, placed) = (MemorySurface::new(&field, 1.0).unwrap(), placed(&field));
        let columns = field.grid.columns as usize;
        let samples: Vec<DVec3> = (0..field.stored.len())
            .filter(|index| !field.stored[*index].is_nan())
            .map(|index| placed.world((index / columns) as f64, (index % columns) as f64, field.stored[index]))
            .collect();
        // No sample is on the border of two pixels.
        let middle = samples.iter().sum::<DVec3>() / samples.len() as f64 + DVec3::new(0.03, 0.04, 0.0);
        let covers = |size: [u32; 2], height: f64, technique: Technique, reach: usize| {
            let projection = Projection::Orthographic { height };
            let sight = view([middle.x, middle.y, 99.0], [middle.x, middle.y, 0.0], projection, size);
            let picture = raw(&source, &placed, &sight, (technique, 1), 0.8);
            let [width, high] = size.map(|side| side as usize);
            // How much of any pixel around a sample is covered at most.
            let cover = |sample: &DVec3| {
                let (at, _) = sight.project(*sample - sight.eye())?;
                let is_in = at[0] > 0.0 && at[1] > 0.0 && at[0] < width as f64 && at[1] < high as f64;
                let [x, y] = at.map(|at| at as usize);
                let around = |at: usize, end: usize| at.saturating_sub(reach)..(at + reach + 1).min(end);
                let pixels = around(y, high).flat_map(|y| around(x, width).map(move |x| y * width + x));
                is_in.then(|| pixels.map(|index| picture.raw[index][6]).fold(0.0, f64::max))
            };
            samples.iter().filter_map(cover).collect::<Vec<f64>>()
        };
        for technique in TECHNIQUES {
            let near = covers([240, 180], 22.5, technique, 0);
            assert!(!near.is_empty() && near.iter().all(|cover| *cover > 0.0), "{technique:?}: {near:?}");
        }
        let far = covers([90, 66], 1.1 * field.grid.rows as f64, Technique::Hybrid, 1);
        assert!(far.len() == samples.len() && far.iter().all(|cover| *cover >= 0.999 / 255.0), "{far:?}");
    }
}
