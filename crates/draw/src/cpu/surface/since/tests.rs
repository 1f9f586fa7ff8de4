//! Changes against the difference of both fields.

use super::super::tests::hills;
use super::*;
use deepfield_heights::build::{HeightBuildOptions, HeightOrigin, build_heights};
use deepfield_heights::measure::Difference;
use deepfield_heights::model::{HeightField, Heights, Window};
use std::path::Path;

fn built(folder: &Path, name: &str, field: &HeightField) -> Arc<HeightFile> {
    let path = folder.join(name);
    build_heights(field, &HeightOrigin::default(), &HeightBuildOptions::default(), &path, &()).unwrap();
    Arc::new(HeightFile::open(&path, Default::default()).unwrap())
}

/// The later field's chunks with changes since the earlier one, and these of every sample by formula: later minus earlier, on the later grid.
fn compared(folder: &Path, earlier: &HeightField, later: &HeightField) -> (PagedSurface, Arc<Since>, Vec<f64>) {
    let files = [built(folder, "earlier.df", earlier), built(folder, "later.df", later)];
    let alignment = Alignment::new(["later", "earlier"], &later.grid, &earlier.grid).unwrap();
    let since = Arc::new(Since::new(Arc::clone(&files[0]), alignment, 16 << 20));
    let mut nodes = PagedSurface::new(Arc::clone(&files[1]), 16 << 20);
    nodes.compare(Some(&since));
    let mut expected = vec![0.0; later.grid.samples() as usize];
    Difference::new(["later", "earlier"], later, earlier)
        .unwrap()
        .heights(Window::all(&later.grid), &mut expected)
        .unwrap();
    expected.iter_mut().for_each(|value| *value = -*value);
    (nodes, since, expected)
}

fn is_same(own: f32, expected: f64) -> bool {
    own.is_nan() && expected.is_nan() || (f64::from(own) - expected).abs() <= 1e-6 * (1.0 + expected.abs())
}

#[test]
fn samples_of_full_resolution_have_the_difference_of_both_fields() {
    let folder = tempfile::tempdir().unwrap();
    let later = hills(300, 420, 0.02, 3);
    // The same grid, a part of it, twice and half as far apart, turned around, and beside the samples.
    let cases = [
        ([0.0, 0.0], [1.0, 1.0], [300, 420]),
        ([37.0, 11.0], [1.0, 1.0], [200, 290]),
        ([0.0, 0.0], [2.0, 2.0], [150, 210]),
        ([0.0, 0.0], [0.5, 0.5], [500, 700]),
        ([400.0, 290.0], [-1.0, -2.0], [140, 380]),
        ([-20.3, 3.7], [1.1, 0.7], [310, 350]),
    ];
    for (place, every, [rows, columns]) in cases {
        let mut earlier = hills(rows, columns, 0.05, 8);
        let (origin, step) = (later.grid.origin, later.grid.step);
        earlier.grid.origin = [0, 1].map(|axis| origin[axis] + place[axis] * step[axis]);
        earlier.grid.step = [0, 1].map(|axis| every[axis] * step[axis]);
        let (nodes, _, expected) = compared(folder.path(), &earlier, &later);
        let lattice = nodes.lattice();
        let (mut known, mut unknown) = (0, 0);
        for key in lattice.keys().filter(|key| key.level == 0) {
            let samples = nodes.samples(key).unwrap();
            let [rows, columns] = [0, 1].map(|axis| lattice.places(key, axis));
            for (index, own) in samples.changes.iter().enumerate() {
                let [row, column] = [rows[index / columns.len()], columns[index % columns.len()]];
                let expected = expected[(row * lattice.samples[1] + column) as usize];
                assert!(is_same(*own, expected), "{place:?} {every:?} {row} {column}: {own} {expected}");
                if expected.is_nan() { unknown += 1 } else { known += 1 }
            }
        }
        assert!(known > 5000 && unknown > 100, "{known} {unknown}");
    }
}

#[test]
fn levels_are_subtracted_from_levels_and_what_lies_between_is_within_the_bound() {
    let folder = tempfile::tempdir().unwrap();
    let later = hills(600, 700, 0.0, 5);
    for (place, every, size) in
        [([0.0, 0.0], 1.0, [600, 700]), ([0.0, 0.0], 2.0, [301, 351]), ([-1.5, -2.5], 1.0, [610, 710])]
    {
        let mut earlier = hills(size[0], size[1], 0.0, 9);
        earlier.grid.origin = [0, 1].map(|axis| later.grid.origin[axis] + place[axis] * later.grid.step[axis]);
        earlier.grid.step = later.grid.step.map(|step| every * step);
        let (nodes, since, expected) = compared(folder.path(), &earlier, &later);
        let lattice = nodes.lattice();
        let at = |row: u64, column: u64| expected[(row * lattice.samples[1] + column) as usize];
        for key in lattice.keys().filter(|key| key.level > 0) {
            let samples = nodes.samples(key).unwrap();
            let [rows, columns] = [0, 1].map(|axis| lattice.places(key, axis));
            let bound = nodes.facts(key).unwrap().change;
            assert_eq!(bound, nodes.facts(key).unwrap().delta + since.unseen(&lattice, key));
            for (r, row) in rows.windows(2).enumerate() {
                for (c, column) in columns.windows(2).enumerate() {
                    let corner =
                        |down: usize, right: usize| f64::from(samples.changes[(r + down) * columns.len() + c + right]);
                    let middle = [row[0].midpoint(row[1]), column[0].midpoint(column[1])];
                    let share = [
                        (middle[0] - row[0]) as f64 / (row[1] - row[0]) as f64,
                        (middle[1] - column[0]) as f64 / (column[1] - column[0]) as f64,
                    ];
                    // Along the diagonal, which all levels have.
                    if share[0] == share[1] {
                        let between = corner(0, 0) + share[0] * (corner(1, 1) - corner(0, 0));
                        let away = (between - at(middle[0], middle[1])).abs();
                        assert!(away <= bound + 1e-4, "{place:?} {every} {key:?}: {away} {bound}");
                    }
                    if place == [0.0, 0.0] && size == [600, 700] {
                        assert!(is_same(corner(0, 0) as f32, at(row[0], column[0])), "nested levels");
                    }
                }
            }
        }
        assert!(nodes.facts(lattice.root()).unwrap().change.is_finite());
    }
}
