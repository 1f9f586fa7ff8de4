//! Rays through page files against the same fields in memory.

use super::rays::{noisy, random, rays};
use crate::build::{HeightBuildOptions, HeightOrigin, build_heights};
use crate::codec::values::Values;
use crate::hierarchy::chunks::{ChunkNode, Coverage, Lattice, Part};
use crate::measure::ray::MinMax;
use crate::measure::{PagedPyramid, Pick, Pyramid, Ray, Rise, Stands, cast_all, pick, pick_all};
use crate::model::{Cell, HeightError, HeightField, HeightGrid, Heights, Invalid, Plane, Window, facts_of};
use crate::store::{HeightAbout, HeightFile, HeightFileWriter, chunk};
use deepfield_data::model::{ReadMethod, SampleType, Scale};
use proptest::prelude::*;
use std::path::Path;

/// A file of a field with chunks of any size, whose coarse chunks have no samples.
fn written(field: &HeightField, side_bits: u32, path: &Path) -> HeightFile {
    let grid = &field.grid;
    let lattice = Lattice { side_bits, ..Lattice::new(grid.rows, grid.columns) };
    let mut writer = HeightFileWriter::create(path, lattice, grid.planes.len()).unwrap();
    for key in lattice.keys() {
        let part = lattice.part(key);
        let (mut node, bytes) = if key.level == 0 {
            let held = lattice.ringed(part);
            let window = |part: &Part| Window {
                row: part.row,
                column: part.column,
                rows: part.rows as u64,
                columns: part.columns as u64,
            };
            let mut stored = vec![0.0; held.len()];
            field.stored(window(&held), &mut stored).unwrap();
            let planes: Vec<Vec<u8>> = (0..grid.planes.len()).map(|_| vec![7; part.len()]).collect();
            let mut own = vec![0.0; part.len()];
            field.heights(window(&part), &mut own).unwrap();
            let mut node = ChunkNode::default();
            for height in own.iter().filter(|height| !height.is_nan()) {
                (node.min, node.max) = (node.min.min(*height), node.max.max(*height));
            }
            for row in 0..part.rows - 1 {
                for first in row * part.columns..(row + 1) * part.columns - 1 {
                    let cell =
                        Cell([first, first + 1, first + part.columns, first + part.columns + 1].map(|at| own[at]));
                    node.area += cell.measured().saturating_sub(2) as u64;
                }
            }
            (node, chunk::encode_leaf(&Values::all(grid.sample_type), &stored, held.columns, &planes, part.columns))
        } else {
            let mut node = ChunkNode::default();
            for child in lattice.children(key) {
                let child = *writer.node(child).unwrap();
                (node.min, node.max, node.area) =
                    (node.min.min(child.min), node.max.max(child.max), node.area + child.area);
            }
            // Rays do not ask for its samples.
            (node, vec![0])
        };
        node.coverage = if node.min <= node.max { Coverage::Partial } else { Coverage::None };
        if node.coverage != Coverage::None {
            writer.chunk(key, &bytes).unwrap();
        }
        *writer.node(key).unwrap() = node;
    }
    let about = HeightAbout {
        source: "field".into(),
        format: "test".into(),
        source_bytes: 0,
        has_spacing: false,
        notes: Vec::new(),
        grid: grid.clone(),
        facts: facts_of(field).unwrap(),
        invalid: Invalid::default(),
        area: 0,
        slopes: [1.0; 2],
        levels: Vec::new(),
        rounded: None,
        photo: None,
    };
    writer.complete(about).unwrap().0.persist().unwrap();
    HeightFile::open(path, ReadMethod::default()).unwrap()
}

/// A field of a type with holes of a kind: none, at random, or a lake with measured samples in it that are in no triangle, far beyond all others.
fn field(columns: u64, rows: u64, sample_type: SampleType, holes: u32, seed: u64) -> HeightField {
    let mut next = random(seed);
    let mut field = noisy(columns, rows, [0.0, 0.2, 0.7, 0.95, 0.0][holes as usize], seed);
    let lake = [next() * rows as f64, next() * columns as f64, next() * rows.min(columns) as f64 * 0.7];
    for (at, value) in field.stored.iter_mut().enumerate() {
        let place = [(at as u64 / columns) as f64, (at as u64 % columns) as f64];
        let height = 60.0 + 20.0 * (0.3 * place[0]).sin() * (0.2 * place[1]).cos() + 8.0 * *value;
        let height = if sample_type.is_float() { f64::from(height as f32) } else { height.round() };
        let is_in = (place[0] - lake[0]).hypot(place[1] - lake[1]) < lake[2];
        *value = if holes == 4 && is_in { f64::NAN } else { height };
        if holes == 4 && is_in && at % 97 == 0 && (at as u64 / columns).is_multiple_of(2) {
            *value = if at % 2 == 0 { 0.0 } else { 120.0 };
        }
    }
    field.grid = HeightGrid {
        sample_type,
        origin: [3.25, -2.0],
        step: [0.7, -1.5],
        scale: Scale { slope: -0.5, intercept: 3.0 },
        ..field.grid
    };
    field
}

/// Every range and cell against the samples themselves.
fn check_ranges(field: &HeightField, file: &HeightFile) -> Result<(), TestCaseError> {
    let mut paged = PagedPyramid::new(file);
    let [rows, columns] = [field.grid.rows, field.grid.columns];
    let at = |row: u64, column: u64| field.grid.scale.value(field.stored[(row * columns + column) as usize]);
    let cell = |row: u64, column: u64| {
        Cell([at(row, column), at(row, column + 1), at(row + 1, column), at(row + 1, column + 1)])
    };
    let bits = |cell: Cell| cell.0.map(|height| if height.is_nan() { 1 } else { height.to_bits() });
    for row in 0..rows - 1 {
        for column in 0..columns - 1 {
            prop_assert_eq!(bits(paged.cell(row, column).unwrap()), bits(cell(row, column)));
        }
    }
    let cells = (rows - 1).max(columns - 1);
    prop_assert!(1 << paged.top() >= cells && (paged.top() == 0 || 1 << (paged.top() - 1) < cells));
    for level in paged.finest()..=paged.top() {
        for block_row in 0..=(rows - 2) >> level {
            for block_column in 0..=(columns - 2) >> level {
                let mut wanted: Option<[f64; 2]> = None;
                for row in block_row << level..((block_row + 1) << level).min(rows - 1) {
                    for column in block_column << level..((block_column + 1) << level).min(columns - 1) {
                        let cell = cell(row, column);
                        for height in cell.0.iter().filter(|height| cell.measured() >= 3 && !height.is_nan()) {
                            wanted =
                                Some(wanted.map_or([*height; 2], |[low, high]| [low.min(*height), high.max(*height)]));
                        }
                    }
                }
                let found = paged.range(level, block_row, block_column).unwrap();
                match (found, wanted) {
                    (Some(found), Some(wanted)) => {
                        prop_assert!(
                            found[0] <= wanted[0] && found[1] >= wanted[1],
                            "{found:?} is not all of {wanted:?}"
                        );
                        let is_exact = level < file.lattice().side_bits || level == paged.top();
                        prop_assert!(!is_exact || found == wanted, "level {level}: {found:?}, not {wanted:?}");
                    }
                    _ => prop_assert_eq!(found, wanted),
                }
            }
        }
    }
    Ok(())
}

fn check_picks(field: &HeightField, file: &HeightFile, rise: Rise, rays: &[Ray]) -> Result<usize, TestCaseError> {
    let pyramid = Pyramid::read(field).unwrap();
    let all = pick_all(file.path(), file, Some(file), &Stands::Flat(rise), rays).unwrap();
    let read = pick_all(file.path(), field, None, &Stands::Flat(rise), rays).unwrap();
    let mut paged = PagedPyramid::new(file);
    let mut hits = 0;
    for ((ray, all), read) in rays.iter().zip(&all).zip(&read) {
        let wanted = pick(&mut &pyramid, rise, ray).unwrap();
        prop_assert_eq!(pick(&mut paged, rise, ray).unwrap(), wanted, "{:?}", ray);
        prop_assert_eq!(*all, wanted);
        prop_assert_eq!(*read, wanted);
        hits += usize::from(matches!(wanted, Pick::Hit(_)));
    }
    Ok(hits)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    #[test]
    fn picks_are_those_in_memory(
        columns in 2_u64..70, rows in 2_u64..70, side_bits in 1_u32..9, holes in 0_u32..5, seed in any::<u64>(), planes in 0_usize..2,
        sample_type in prop_oneof![Just(SampleType::U8), Just(SampleType::I16), Just(SampleType::I32), Just(SampleType::F32), Just(SampleType::F64)],
        exaggeration in prop_oneof![Just(1.0), Just(10.0), Just(-2.0)],
    ) {
        let mut field = field(columns, rows, sample_type, holes, seed);
        field.grid.planes = (0..planes).map(|_| Plane { name: "grey".into() }).collect();
        field.planes = vec![vec![7; field.stored.len()]; planes];
        prop_assume!(field.stored.iter().any(|height| !height.is_nan()));
        let folder = tempfile::tempdir().unwrap();
        let file = written(&field, side_bits, &folder.path().join("field.df"));
        check_ranges(&field, &file)?;
        let rise = Rise::new(&field.grid, exaggeration, 0.3);
        check_picks(&field, &file, rise, &rays(&field, rise, 160, seed ^ 5))?;
    }
}

fn built(field: &HeightField, path: &Path) -> HeightFile {
    build_heights(field, &HeightOrigin::default(), &HeightBuildOptions::default(), path, &()).unwrap();
    HeightFile::open(path, ReadMethod::default()).unwrap()
}

#[test]
fn picks_through_built_files_with_several_levels() {
    let folder = tempfile::tempdir().unwrap();
    let mut hits = 0;
    for (number, (columns, rows, holes)) in [(1100, 530, 4), (515, 257, 1), (258, 900, 3)].into_iter().enumerate() {
        let field = field(columns, rows, SampleType::I16, holes, number as u64 + 1);
        let file = built(&field, &folder.path().join("field.df"));
        check_ranges(&field, &file).unwrap();
        for exaggeration in [0.2, 5.0] {
            let rise = Rise::new(&field.grid, exaggeration, 60.0);
            hits += check_picks(&field, &file, rise, &rays(&field, rise, 1000, 3)).unwrap();
        }
    }
    assert!(hits > 1000, "{hits} hits");
}

#[test]
fn clones_share_leaves_and_threads_change_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let field = field(800, 700, SampleType::F32, 1, 11);
    let file = built(&field, &folder.path().join("field.df"));
    let rise = Rise::new(&field.grid, 1.0, 0.0);
    let all = rays(&field, rise, 3000, 12);
    let wanted = pick_all(file.path(), &file, Some(&file), &Stands::Flat(rise), &all).unwrap();
    let paged = PagedPyramid::new(&file);
    for threads in [1, 4] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        assert_eq!(
            pool.install(|| pick_all(file.path(), &file, Some(&file), &Stands::Flat(rise), &all)).unwrap(),
            wanted
        );
        let mut hits = vec![None; all.len()];
        pool.install(|| cast_all(|| paged.clone(), rise, |number| all[number], &mut hits)).unwrap();
        for (hit, pick) in hits.iter().zip(&wanted) {
            assert_eq!(hit.map(Pick::Hit), Some(*pick).filter(|pick| matches!(pick, Pick::Hit(_))));
        }
    }
}

#[test]
fn damaged_pages_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let field = field(600, 520, SampleType::I16, 4, 5);
    let path = folder.path().join("field.df");
    drop(built(&field, &path));
    let bytes = std::fs::read(&path).unwrap();
    let rise = Rise::new(&field.grid, 1.0, 0.0);
    let all = rays(&field, rise, 300, 6);
    let (mut next, mut errors, mut opened) = (random(7), 0, 0);
    for _ in 0..60 {
        let mut damaged = bytes.clone();
        let at = (next() * bytes.len() as f64) as usize;
        let end = (at + 300).min(bytes.len());
        damaged[at..end].iter_mut().for_each(|byte| *byte = byte.wrapping_add(1));
        std::fs::write(&path, &damaged).unwrap();
        let Ok(file) = HeightFile::open(&path, ReadMethod::default()) else { continue };
        opened += 1;
        if let Err(error) = pick_all(&path, &file, Some(&file), &Stands::Flat(rise), &all) {
            let message = error.to_string();
            assert!(message.contains("field.df") && message.contains("page"), "{message}");
            // The same ray's error whatever is read first.
            let again = pick_all(&path, &file, Some(&file), &Stands::Flat(rise), &all).unwrap_err();
            assert_eq!(again.to_string(), message);
            errors += 1;
        }
    }
    assert!(opened > 30 && errors > 15, "{errors} errors of {opened} files");
}

#[test]
fn large_sources_are_refused_before_they_are_read() {
    struct Large(HeightGrid);
    impl Heights for Large {
        fn grid(&self) -> &HeightGrid {
            &self.0
        }
        fn stored(&self, _: Window, _: &mut [f64]) -> Result<(), HeightError> {
            panic!("read")
        }
        fn plane(&self, _: usize, _: Window, _: &mut [u8]) -> Result<(), HeightError> {
            panic!("read")
        }
    }
    let rise = Rise { zero: 0.0, lift: 1.0 };
    for grid in [HeightGrid::new(40_000, 40_000, SampleType::I16), HeightGrid::new(1 << 40, 1 << 40, SampleType::F64)] {
        let error =
            pick_all(Path::new("large.tif"), &Large(grid), None, &Stands::Flat(rise), &[]).unwrap_err().to_string();
        assert!(error.starts_with("large.tif: samples: found ") && error.contains("build"), "{error}");
    }
}
