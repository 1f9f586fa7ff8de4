//! Differences and volumes.

use super::rays::{noisy, random};
use super::truth::{assert_near, height, of, sines, with_holes};
use crate::measure::{Difference, volumes};
use crate::model::{HeightField, Heights, Window};
use deepfield_data::model::Unit;

fn read(heights: &dyn Heights) -> Vec<f64> {
    let mut out = vec![0.0; heights.grid().samples() as usize];
    heights.heights(Window::all(heights.grid()), &mut out).unwrap();
    out
}

fn new<'a>(before: &'a HeightField, after: &'a HeightField) -> Difference<'a> {
    Difference::new(["a.asc", "b.asc"], before, after).unwrap()
}

#[test]
fn steps_have_their_volume() {
    let plane = of(500, 400, |row, column| 0.2 * row + 0.1 * column);
    let step = of(500, 400, |row, column| 0.2 * row + 0.1 * column + if column >= 333.0 { 1000.0 } else { 0.0 });
    let found = volumes(&new(&plane, &step)).unwrap();
    assert_near(found.volume_above, 1000.0 * 166.5 * 399.0, 1e-12, "above");
    assert!(found.volume_below < 1e-3 && found.valid == 200_000);
    let back = volumes(&new(&step, &plane)).unwrap();
    assert_near(back.volume_below, 1000.0 * 166.5 * 399.0, 1e-12, "below");
    let none = new(&step, &step);
    assert!(read(&none).iter().all(|height| *height == 0.0));
    assert_eq!(volumes(&none).unwrap().volume_above, 0.0);
}

#[test]
fn triangles_are_cut_at_zero() {
    // Against the sum over many small triangles of the same T.
    let field = with_holes(noisy(12, 9, 0.0, 3), 0.2, 1);
    let found = volumes(&field).unwrap();
    let parts = 200;
    let (mut above, mut below) = (0.0, 0.0);
    for row in 0..8 {
        for column in 0..11 {
            let cell = super::truth::cell(&field, row, column);
            for i in 0..parts * parts {
                let (u, v) =
                    (((i / parts) as f64 + 0.5) / f64::from(parts), ((i % parts) as f64 + 0.25) / f64::from(parts));
                let here = cell.height(u, v);
                if !here.is_nan() {
                    above += here.max(0.0) / f64::from(parts * parts);
                    below += (-here).max(0.0) / f64::from(parts * parts);
                }
            }
        }
    }
    assert_near(found.volume_above, above, 2e-3, "above");
    assert_near(found.volume_below, below, 2e-3, "below");
    // A tent of height 3 over -1: a pyramid cut at a third.
    let tent = HeightField::of(2, 2, vec![3.0, -1.0, f64::NAN, -1.0]);
    let tent = volumes(&tent).unwrap();
    assert_near(tent.volume_above, 0.5 * (0.75 * 0.75) * 3.0 / 3.0, 1e-15, "tip");
    assert_near(tent.volume_above - tent.volume_below, 0.5 / 3.0, 1e-15, "all");
}

#[test]
fn other_grids_are_sampled_on_t() {
    for (origin, step) in [([-3.25, 51.5], [0.5, -0.5]), ([2.1, 1.7], [3.3, 2.9]), ([60.0, 50.0], [-1.0, -1.0])] {
        let mut before = with_holes(sines(70, 50, 20.0, 3.0), 0.1, 2);
        (before.grid.origin, before.grid.step) = ([0.0, 49.0], [1.0, -1.0]);
        let mut after = noisy(40, 44, 0.1, 7);
        (after.grid.origin, after.grid.step) = (origin, step);
        let found = read(&new(&before, &after));
        for (n, found) in found.iter().enumerate() {
            let [x, y] = before.grid.place((n / 70) as f64, (n % 70) as f64);
            let [row, column] = after.grid.row_column([x, y]);
            let lone = || {
                let (r, c) = (row.round(), column.round());
                let is_in = (row - r).hypot(column - c) < 1e-6 && r >= 0.0 && c >= 0.0 && r < 44.0 && c < 40.0;
                if is_in { after.stored[(r * 40.0 + c) as usize] } else { f64::NAN }
            };
            let wanted = height(&after, row, column).unwrap_or_else(lone) - before.stored[n];
            assert!(found.is_nan() && wanted.is_nan() || (found - wanted).abs() < 1e-12, "{n}: {found}, not {wanted}");
        }
    }
}

#[test]
fn coinciding_grids_are_copied() {
    let mut before = noisy(30, 20, 0.2, 1);
    let mut after = noisy(25, 40, 0.2, 2);
    (before.grid.origin, before.grid.step) = ([0.1, 5.0], [0.1, -0.2]);
    (after.grid.origin, after.grid.step) = ([0.1 + 7.0 * 0.1, 5.0 + 3.0 * 0.2], [0.1, -0.2]);
    let difference = new(&before, &after);
    let found = read(&difference);
    let mut counted = 0;
    for row in 0..20_usize {
        for column in 0..30_usize {
            let inside = (7..32).contains(&column);
            let other = if inside { after.stored[(row + 3) * 25 + column - 7] } else { f64::NAN };
            let wanted = other - before.stored[row * 30 + column];
            let here = found[row * 30 + column];
            assert!(here == wanted || here.is_nan() && wanted.is_nan());
            counted += usize::from(!here.is_nan());
        }
    }
    assert!(counted > 200);
    // Windows are parts of the whole.
    let mut next = random(5);
    for _ in 0..50 {
        let (row, column) = ((next() * 19.0) as u64, (next() * 29.0) as u64);
        let window = Window { row, column, rows: 20 - row, columns: 30 - column };
        let mut part = vec![0.0; window.samples() as usize];
        difference.heights(window, &mut part).unwrap();
        assert_eq!(part[0].to_bits(), found[(row * 30 + column) as usize].to_bits());
    }
}

#[test]
fn units_are_converted_or_refused() {
    let with = |xy: &str, height: &str, size: f64, lift: f64| {
        let mut field = of(20, 20, |row, column| lift * (row + column));
        (field.grid.xy_unit, field.grid.height_unit, field.grid.step) =
            (Unit::new(xy), Unit::new(height), [size, size]);
        field
    };
    let before = with("mm", "um", 1.0, 1.0);
    let found = new(&before, &with("um", "nm", 1000.0, 3000.0)).heights_of();
    assert!(found.iter().enumerate().all(|(n, height)| (height - 2.0 * (n / 20 + n % 20) as f64).abs() < 1e-9));
    // 2 um times (row + column): the mean over 19 x 19 mm is 2 x 19 um, so 38e-3 x 361 mm^3.
    let volume = volumes(&new(&before, &with("mm", "um", 1.0, 3.0))).unwrap().volume_above;
    assert_near(volume, 38e-3 * 361.0, 1e-12, "volume");
    let message = |after: &HeightField| {
        let text = Difference::new(["a.asc", "b.asc"], &before, after).err().unwrap().to_string();
        assert!(text.starts_with("a.asc and b.asc: ") && !text.contains('\n'), "{text}");
        text
    };
    assert!(message(&with("deg", "um", 1.0, 1.0)).contains("found mm and deg, expected"));
    assert!(message(&with("mm", "", 1.0, 1.0)).contains("--height-unit"));
    let mut far = with("mm", "um", 1.0, 1.0);
    far.grid.origin = [1e4, 1e4];
    assert!(message(&far).contains("x 0 to 19, y 0 to 19 and x 10000 to 10019, y 10000 to 10019"));
    let (mut one, mut other) = (before.clone(), before.clone());
    (one.grid.crs, other.grid.crs) = (Some("EPSG:1".into()), Some("EPSG:2".into()));
    let text = Difference::new(["a", "b"], &one, &other).err().unwrap().to_string();
    assert!(text.contains("EPSG:1 and EPSG:2"), "{text}");
}

impl Difference<'_> {
    fn heights_of(&self) -> Vec<f64> {
        read(self)
    }
}
