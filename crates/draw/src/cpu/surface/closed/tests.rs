//! A field without its first column again, closed, against one with it.

use super::super::memory::MemorySurface;
use super::super::placed::Map;
use super::super::tests::hills;
use super::*;
use deepfield_data::model::Unit;
use deepfield_heights::model::{Globe, HeightField, HeightGrid};

#[test]
fn the_first_column_comes_again() {
    for columns in [48_usize, 320, 600] {
        let mut field = hills(130, columns, 0.0, 7);
        field.grid.step = [360.0 / columns as f64, 1.0];
        (field.grid.xy_unit, field.grid.origin) = (Unit::new("deg"), [0.0, -64.0]);
        let rows: Vec<f64> = field.stored.chunks(columns).flat_map(|row| row.iter().copied().chain([row[0]])).collect();
        let mut repeated = HeightField::of(columns as u64 + 1, 130, rows);
        repeated.grid = HeightGrid { columns: columns as u64 + 1, ..field.grid.clone() };
        let map = Map::Globe(Globe::sphere(1000.0));
        let [open, whole] = [&field, &repeated].map(|field| Placed::new(&field.grid, map, 1.0, 0.0));
        assert_eq!((open.around, open.samples), (whole.around, whole.samples));
        let [open_source, source] = [&field, &repeated].map(|field| MemorySurface::new(field, 1.0).unwrap());
        assert!(Closed::of(&source, &whole).is_none());
        let closed = Closed::of(&open_source, &open).unwrap();
        assert_eq!(closed.lattice(), source.lattice());
        for key in source.lattice().keys() {
            let [own, wanted] = [&closed as &dyn SurfaceNodes, &source].map(|nodes| nodes.samples(key).unwrap());
            assert_eq!((own.rows, own.columns, &own.heights), (wanted.rows, wanted.columns, &wanted.heights));
            let count = own.heights.len();
            assert!(own.normals.len() == count && [0, count].contains(&own.coverage.len()));
            assert!([0, count].contains(&own.ranges.len()));
            let [own, wanted] = [&closed as &dyn SurfaceNodes, &source].map(|nodes| nodes.facts(key).unwrap());
            assert!(own.delta >= wanted.delta && own.step >= wanted.step, "{key:?}");
            assert!(own.min <= wanted.min && own.max >= wanted.max);
        }
    }
}
