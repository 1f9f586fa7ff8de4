//! A field without its first column again, closed, against T of one with it.

use super::super::memory::MemorySurface;
use super::super::placed::Map;
use super::super::tests::hills;
use super::*;
use deepfield_data::model::Unit;
use deepfield_heights::model::{Cell, Globe, HeightField};

/// A field around a globe, as even across its seam as elsewhere, and the same with its first column once more.
fn around(rows: usize, columns: usize, holes: f64) -> [HeightField; 2] {
    let mut field = hills(rows, columns, holes, 7);
    let mirrored = |index: usize| {
        let (row, column) = (index / columns, index % columns);
        field.stored[row * columns + column.min((columns - column) % columns)]
    };
    field.stored = (0..rows * columns).map(mirrored).collect();
    field.grid.step = [360.0 / columns as f64, 100.0 / rows as f64];
    (field.grid.xy_unit, field.grid.origin) = (Unit::new("deg"), [0.0, -50.0]);
    let stored: Vec<f64> = field.stored.chunks(columns).flat_map(|row| row.iter().copied().chain([row[0]])).collect();
    let mut repeated = HeightField::of(columns as u64 + 1, rows as u64, stored);
    (repeated.grid.step, repeated.grid.origin) = (field.grid.step, field.grid.origin);
    repeated.grid.xy_unit = field.grid.xy_unit.clone();
    [field, repeated]
}

#[test]
fn every_level_ends_with_the_last_column_and_the_first_one_again() {
    for columns in [48_usize, 257, 320, 513, 600] {
        let [field, repeated] = around(530, columns, 0.01);
        let map = Map::Globe(Globe::sphere(1000.0));
        let [open, whole] = [&field, &repeated].map(|field| Placed::new(&field.grid, map, 1.0, 0.0));
        assert_eq!((open.around, open.samples), (whole.around, whole.samples));
        let [source, other] = [&field, &repeated].map(|field| MemorySurface::new(field, 1.0).unwrap());
        assert!(Closed::of(&other, &whole).is_none());
        let closed = Closed::of(&source, &open).unwrap();
        let lattice = closed.lattice();
        assert_eq!((lattice.samples, lattice.top()), (other.lattice().samples, source.lattice().top()));
        for key in lattice.keys() {
            let samples = closed.samples(key).unwrap();
            let [rows, places] = [0, 1].map(|axis| lattice.places(key, axis));
            assert_eq!([samples.rows, samples.columns], [rows.len(), places.len()]);
            assert_eq!(
                lattice.rectangle(key),
                [[rows[0], rows[rows.len() - 1]], [places[0], places[places.len() - 1]]]
            );
            let is_last = key.column + 1 == lattice.chunks_of(key.level.into())[1];
            let ends = [columns as u64 - 1, columns as u64];
            assert_eq!(places.ends_with(&ends), is_last, "{key:?}: {places:?}");
            let count = samples.heights.len();
            assert!(samples.normals.len() == count && [0, count].contains(&samples.coverage.len()));
            assert!([0, count].contains(&samples.ranges.len()));
            for (index, height) in samples.heights.iter().enumerate() {
                let [row, column] = [rows[index / places.len()], places[index % places.len()]];
                let own = repeated.stored[row as usize * (columns + 1) + column as usize];
                assert!(own.is_nan() || own == height, "{key:?} {row} {column}");
                for (axis, place) in [(0, row), (1, column)] {
                    let found = lattice.sample_at(axis, key.level.into(), place).unwrap();
                    assert_eq!(lattice.place(axis, key.level.into(), found), place);
                }
            }
        }
    }
}

/// T between samples of the field that has the first column again.
fn t_height(field: &HeightField, row: f64, column: f64) -> f64 {
    let (columns, rows) = (field.grid.columns as usize, field.grid.rows as usize);
    let (r, c) = ((row as usize).min(rows - 2), (column as usize).min(columns - 2));
    let at = |row: usize, column: usize| field.stored[row * columns + column];
    Cell([at(r, c), at(r, c + 1), at(r + 1, c), at(r + 1, c + 1)]).height(column - c as f64, row - r as f64)
}

#[test]
fn what_lies_between_is_within_delta_and_no_more_is_refined_than_elsewhere() {
    for columns in [257_usize, 500] {
        let [field, repeated] = around(600, columns, 0.0);
        let source = MemorySurface::new(&field, 1.0).unwrap();
        let placed = Placed::new(&field.grid, Map::Globe(Globe::sphere(1000.0)), 1.0, 0.0);
        let closed = Closed::of(&source, &placed).unwrap();
        let lattice = closed.lattice();
        for key in lattice.keys().filter(|key| key.column + 1 == lattice.chunks_of(key.level.into())[1]) {
            let (samples, facts) = (closed.samples(key).unwrap(), closed.facts(key).unwrap());
            let rows = lattice.places(key, 0);
            let mut most = 0.0_f64;
            for (r, pair) in rows.windows(2).enumerate() {
                let first = (r + 1) * samples.columns - 2;
                let cell =
                    Cell([0, 1, samples.columns, samples.columns + 1].map(|next| samples.heights.at(first + next)));
                let heights = cell.0;
                assert!(heights.iter().all(|height| (facts.min..=facts.max).contains(height)));
                let diagonals = [
                    heights[1] - heights[0],
                    heights[3] - heights[2],
                    heights[3] - heights[0],
                    heights[2] - heights[1],
                ];
                assert!(diagonals.iter().all(|step| step.abs() <= facts.step));
                for (i, j) in (0..=8).flat_map(|i| (0..=40).map(move |j| (i, j))) {
                    let (u, v) = (f64::from(i) / 8.0, f64::from(j) / 40.0);
                    let row = pair[0] as f64 + v * (pair[1] - pair[0]) as f64;
                    let t = t_height(&repeated, row, columns as f64 - 1.0 + u);
                    assert!((facts.min - 1e-9..=facts.max + 1e-9).contains(&t));
                    most = most.max((cell.height(u, v) - t).abs());
                }
            }
            assert!(most <= facts.delta + 1e-9, "{key:?}: {most} {}", facts.delta);
            let own = source.facts(key).unwrap().delta.max(source.facts(ChunkKey { column: 0, ..key }).unwrap().delta);
            assert!(facts.delta <= 2.0 * own + 1e-9, "{key:?}: {} {own}", facts.delta);
        }
    }
}
