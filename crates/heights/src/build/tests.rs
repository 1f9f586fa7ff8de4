//! Files of random fields with random holes, against brute force.

use super::*;
use crate::hierarchy::chunks::coarse::normal_of;
use crate::hierarchy::chunks::{ChunkKey, ChunkNode, Coverage};
use crate::model::light;
use crate::model::{Cell, HeightField, Plane, facts_of};
use crate::store::{Chunk, HeightFile, verify_heights};
use deepfield_data::model::{ReadMethod, SampleType, Scale};
use proptest::prelude::*;
use std::io::{Seek, SeekFrom, Write};

/// Numbers of a seed.
pub(super) struct Noise(pub(super) u64);

impl Noise {
    pub(super) fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    /// From 0 to 1.
    pub(super) fn share(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// A rough field; `holes` is how it is broken.
fn field(rows: u64, columns: u64, sample_type: SampleType, holes: u32, planes: usize, seed: u64) -> HeightField {
    let mut noise = Noise(seed | 1);
    let lake =
        [noise.share() * rows as f64, noise.share() * columns as f64, noise.share() * rows.min(columns) as f64 * 0.7];
    let tilt = [noise.share() - 0.5, noise.share() - 0.5];
    let mut stored = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            let height = 60.0 + 20.0 * (tilt[0] * row as f64 + tilt[1] * column as f64).sin() + 8.0 * noise.share();
            let is_hole = match holes {
                0 => false,
                1 => noise.share() < 0.3,
                2 => (row as f64 - lake[0]).hypot(column as f64 - lake[1]) < lake[2],
                3 => (row + column) % 2 == 1,
                4 => noise.share() < 0.9,
                _ => row * columns + column != seed % (rows * columns),
            };
            let value = if sample_type.is_float() { height } else { height.round() };
            let value = if sample_type == SampleType::F32 { f64::from(value as f32) } else { value };
            stored.push(if is_hole { f64::NAN } else { value });
        }
    }
    // A field without a height is none.
    if stored.iter().all(|value| value.is_nan()) {
        stored[(seed % (rows * columns)) as usize] = 60.0;
    }
    let mut grid = HeightGrid::new(columns, rows, sample_type);
    grid.scale = Scale { slope: 0.5, intercept: 3.0 };
    grid.step = [2.0, -1.5];
    grid.planes = (0..planes).map(|number| Plane { name: format!("plane {number}") }).collect();
    let planes = (0..planes).map(|_| (0..rows * columns).map(|_| (noise.next() >> 40) as u8).collect()).collect();
    HeightField { grid, stored, planes }
}

fn built(field: &HeightField, side_bits: u32, rounded: Option<Rounded>, folder: &Path) -> (HeightFile, HeightAbout) {
    let lattice = Lattice { side_bits, ..Lattice::new(field.grid.rows, field.grid.columns) };
    let path = folder.join("field.df");
    let (origin, options) = (HeightOrigin::default(), HeightBuildOptions::default());
    let about = pass::build(field, &origin, &options, rounded, lattice, &path, &()).unwrap();
    (HeightFile::open(&path, ReadMethod::default()).unwrap(), about)
}

/// T of a field, as it is stored.
struct Truth<'a>(&'a HeightField);

impl Truth<'_> {
    fn at(&self, row: u64, column: u64) -> f64 {
        self.0.stored[(row * self.0.grid.columns + column) as usize]
    }

    fn cell(&self, row: u64, column: u64) -> Cell {
        Cell([self.at(row, column), self.at(row, column + 1), self.at(row + 1, column), self.at(row + 1, column + 1)])
    }

    fn height(&self, row: f64, column: f64) -> f64 {
        let (r, c) =
            ((row.floor() as u64).min(self.0.grid.rows - 2), (column.floor() as u64).min(self.0.grid.columns - 2));
        self.cell(r, c).height(column - c as f64, row - r as f64)
    }

    fn is_lone(&self, row: u64, column: u64) -> bool {
        let cells = [[0, 0], [0, 1], [1, 0], [1, 1]].into_iter().filter_map(|[up, left]| {
            let (r, c) = (row.checked_sub(up)?, column.checked_sub(left)?);
            (r + 1 < self.0.grid.rows && c + 1 < self.0.grid.columns).then(|| self.cell(r, c).measured())
        });
        !self.at(row, column).is_nan() && cells.into_iter().all(|measured| measured < 3)
    }
}

fn field_strategy() -> impl Strategy<Value = (HeightField, u32)> {
    let types = [SampleType::U8, SampleType::I16, SampleType::U16, SampleType::I32, SampleType::F32, SampleType::F64];
    (2_u64..40, 2_u64..40, 0..types.len(), 0_u32..6, 0_usize..3, 1_u32..4, any::<u64>()).prop_map(
        move |(rows, columns, kind, holes, planes, side_bits, seed)| {
            (field(rows, columns, types[kind], holes, planes, seed), side_bits)
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    #[test]
    fn files_hold_what_they_promise((field, side_bits) in field_strategy(), error in prop::option::of(0.05..8.0)) {
        let folder = tempfile::tempdir().unwrap();
        let rounded = rounded(&field.grid, &HeightOrigin::default(), error).unwrap();
        let (file, about) = built(&field, side_bits, rounded, folder.path());
        prop_assert_eq!(file.about(), &about);
        prop_assert_eq!(about.rounded, rounded);
        // All else is of the rounded samples, to the bit.
        let mut stored = field.stored.clone();
        about.values().round(&mut stored);
        let field = HeightField { stored, ..field };
        check_samples(&field, &file)?;
        verify_heights(file.path(), &()).map_err(|error| TestCaseError::fail(error.to_string()))?;
        for level in 0..file.lattice().levels() {
            let samples = check_chunks(&field, &file, level)?;
            if level > 0 {
                check_coverage(&field, &file, level, &samples)?;
                check_light(&field, &file, level, &samples)?;
            }
        }
    }
}

fn check_samples(field: &HeightField, file: &HeightFile) -> Result<(), TestCaseError> {
    let grid = &field.grid;
    let bits = |values: &[f64]| {
        values.iter().map(|value| if value.is_nan() { 1 } else { value.to_bits() }).collect::<Vec<_>>()
    };
    let mut back = vec![0.0; field.stored.len()];
    file.stored(Window::all(grid), &mut back).unwrap();
    prop_assert_eq!(bits(&back), bits(&field.stored));
    let window = Window {
        row: grid.rows / 3,
        column: grid.columns / 4,
        rows: grid.rows - grid.rows / 3,
        columns: grid.columns / 2,
    };
    let (mut part, mut expected) = (vec![0.0; window.samples() as usize], vec![0.0; window.samples() as usize]);
    file.stored(window, &mut part).unwrap();
    field.stored(window, &mut expected).unwrap();
    prop_assert_eq!(bits(&part), bits(&expected));
    for plane in 0..grid.planes.len() {
        let mut back = vec![0; field.stored.len()];
        file.plane(plane, Window::all(grid), &mut back).unwrap();
        prop_assert_eq!(&back, &field.planes[plane]);
    }
    let (own, expected) = (file.about().facts, facts_of(field).unwrap());
    prop_assert_eq!(
        (own.valid, own.lone, own.min, own.max),
        (expected.valid, expected.lone, expected.min, expected.max)
    );
    prop_assert!((own.mean - expected.mean).abs() < 1e-9);
    prop_assert_eq!(file.about().invalid.total(), grid.samples() - own.valid);
    prop_assert!(file.plane(grid.planes.len(), Window::all(grid), &mut vec![0; field.stored.len()]).is_err());
    let beyond = Window { row: 1, ..Window::all(grid) };
    prop_assert!(file.stored(beyond, &mut back).is_err());
    Ok(())
}

/// A level's samples.
struct Samples {
    columns: usize,
    stored: Vec<f64>,
    coverage: Vec<u8>,
    normals: Vec<[u8; 3]>,
    planes: Vec<Vec<u8>>,
}

/// Checks each chunk of a level, and that neighbours share their borders; gives the level's samples.
fn check_chunks(field: &HeightField, file: &HeightFile, level: u32) -> Result<Samples, TestCaseError> {
    let lattice = file.lattice();
    let [rows, columns] = lattice.samples_of(level).map(|count| count as usize);
    let len = rows * columns;
    let mut all = Samples {
        columns,
        stored: vec![f64::NAN; len],
        coverage: vec![0; len],
        normals: vec![[0; 3]; len],
        planes: vec![vec![0; len]; field.grid.planes.len()],
    };
    let mut seen = vec![false; len];
    let truth = Truth(field);
    for key in lattice.keys().filter(|key| u32::from(key.level) == level) {
        let node = *file.node(key).unwrap();
        let Some(chunk) = file.chunk(key).unwrap() else {
            prop_assert_eq!(node.coverage, Coverage::None);
            continue;
        };
        let part = chunk.part;
        for row in 0..part.rows {
            for column in 0..part.columns {
                let at = (part.row as usize + row) * columns + part.column as usize + column;
                let height = chunk.stored_at(row, column);
                let place = [(0, part.row + row as u64), (1, part.column + column as u64)]
                    .map(|(axis, index)| lattice.place(axis, level, index));
                let own = truth.at(place[0], place[1]);
                prop_assert!(own.is_nan() || own.to_bits() == height.to_bits(), "a measured sample keeps its height");
                let colours: Vec<u8> = chunk.planes.iter().map(|plane| plane[row * part.columns + column]).collect();
                if seen[at] {
                    // Another chunk's border.
                    prop_assert!(
                        all.stored[at].to_bits() == height.to_bits() || (height.is_nan() && all.stored[at].is_nan())
                    );
                    if level > 0 {
                        prop_assert_eq!(all.coverage[at], chunk.coverage_at(row, column));
                        prop_assert_eq!(all.normals[at], chunk.normal_at(row, column));
                    }
                    prop_assert!(all.planes.iter().zip(&colours).all(|(plane, colour)| plane[at] == *colour));
                }
                seen[at] = true;
                all.stored[at] = height;
                if level > 0 {
                    all.coverage[at] = chunk.coverage_at(row, column);
                    all.normals[at] = chunk.normal_at(row, column);
                    prop_assert_eq!(all.coverage[at] == 0, height.is_nan());
                }
                all.planes.iter_mut().zip(colours).for_each(|(plane, colour)| plane[at] = colour);
            }
        }
        check_node(field, file, key, &node, &chunk)?;
    }
    Ok(all)
}

/// Checks a chunk's record by brute force.
fn check_node(
    field: &HeightField,
    file: &HeightFile,
    key: ChunkKey,
    node: &ChunkNode,
    chunk: &Chunk,
) -> Result<(), TestCaseError> {
    let (lattice, scale, truth, level) = (file.lattice(), field.grid.scale, Truth(field), u32::from(key.level));
    let place = |axis: usize, index: usize| {
        lattice.place(axis, level, [chunk.part.row, chunk.part.column][axis] + index as u64)
    };
    let is_aligned = |cell: usize, axis: usize| place(axis, cell + 1) - place(axis, cell) == 1 << level;
    // Distances at T's samples, and anywhere else; whether the largest is known exactly.
    let (mut at_samples, mut anywhere, mut is_exact) = (0.0_f64, 0.0_f64, level <= lattice.side_bits);
    let mut step = 0.0_f64;
    let (mut area, mut low, mut high) = (0, f64::INFINITY, f64::NEG_INFINITY);
    for row in 0..chunk.part.rows - 1 {
        for column in 0..chunk.part.columns - 1 {
            let cell = Cell(
                [[0, 0], [0, 1], [1, 0], [1, 1]].map(|[down, across]| chunk.stored_at(row + down, column + across)),
            );
            for triangle in cell.triangles() {
                let [a, b, c] = triangle.corners.map(|corner| cell.0[corner]);
                step = step.max((a - b).abs()).max((b - c).abs()).max((c - a).abs());
            }
            is_exact &= cell.measured() == 4 && is_aligned(row, 0) && is_aligned(column, 1);
            let [top, left] = [place(0, row), place(1, column)];
            let [tall, wide] = [place(0, row + 1) - top, place(1, column + 1) - left];
            for (down, across) in (0..=tall).flat_map(|down| (0..=wide).map(move |across| (down, across))) {
                let sample = truth.at(top + down, left + across);
                is_exact &= !sample.is_nan();
                if !sample.is_nan() {
                    (low, high) = (low.min(sample), high.max(sample));
                    let surface = cell.height(across as f64 / wide as f64, down as f64 / tall as f64);
                    at_samples = at_samples.max((sample - surface).abs());
                }
                if down < tall && across < wide {
                    area += truth.cell(top + down, left + across).triangles().count() as u64;
                }
            }
            if cell.measured() >= 3 {
                let steps = 24;
                for (down, across) in (0..=steps).flat_map(|down| (0..=steps).map(move |across| (down, across))) {
                    let (v, u) = (f64::from(down) / f64::from(steps), f64::from(across) / f64::from(steps));
                    let distance =
                        truth.height(top as f64 + v * tall as f64, left as f64 + u * wide as f64) - cell.height(u, v);
                    anywhere = if distance.is_nan() { anywhere } else { anywhere.max(distance.abs()) };
                }
            }
        }
    }
    let slope = scale.slope.abs();
    let most = slope * at_samples.max(anywhere);
    prop_assert!(most <= node.delta * (1.0 + 1e-9) + 1e-9, "level {level}: {most} above {}", node.delta);
    if is_exact {
        prop_assert!(
            (slope * at_samples - node.delta).abs() <= 1e-9,
            "level {level}: {} is not {}",
            slope * at_samples,
            node.delta
        );
    }
    prop_assert!(
        step * slope <= node.step + 1e-9 && (level > 0 || (step * slope - node.step).abs() < 1e-9 || !is_exact)
    );
    prop_assert_eq!(node.area, area);
    prop_assert!(low > high || (node.min <= scale.value(low) && node.max >= scale.value(high)));
    if level == 0 {
        prop_assert!((node.min, node.max) == (scale.value(low), scale.value(high)) || low > high);
        prop_assert_eq!(node.delta, 0.0);
    } else {
        let is_whole =
            (0..chunk.part.len()).all(|at| chunk.coverage_at(at / chunk.part.columns, at % chunk.part.columns) == 255);
        prop_assert_eq!(node.coverage == Coverage::Whole, is_whole);
    }
    Ok(())
}

/// Coverage is the share of T in what each sample stands for, and adds up to all of T.
fn check_coverage(field: &HeightField, file: &HeightFile, level: u32, samples: &Samples) -> Result<(), TestCaseError> {
    let (lattice, truth) = (file.lattice(), Truth(field));
    let (mut total, mut halves, mut slack) = (0.0, 0, 0.0);
    for (at, &coverage) in samples.coverage.iter().enumerate() {
        let (row, column) = ((at / samples.columns) as u64, (at % samples.columns) as u64);
        let [rows, columns] = [lattice.stands_for(0, level, row), lattice.stands_for(1, level, column)];
        let cells = lattice.cells(level, [row, column]);
        if cells == 0 {
            continue;
        }
        let (mut area, mut lone) = (0, false);
        for (r, c) in (rows[0]..rows[1]).flat_map(|r| (columns[0]..columns[1]).map(move |c| (r, c))) {
            area += truth.cell(r, c).triangles().count() as u64;
            lone |= truth.is_lone(r, c)
                || (r + 2 == field.grid.rows && truth.is_lone(r + 1, c))
                || (c + 2 == field.grid.columns && truth.is_lone(r, c + 1))
                || (r + 2 == field.grid.rows && c + 2 == field.grid.columns && truth.is_lone(r + 1, c + 1));
        }
        halves += area;
        let exact = area as f64 / 2.0;
        match coverage {
            255 => prop_assert_eq!(area, 2 * cells),
            // What was measured never vanishes, and nothing else is covered but samples that were measured themselves.
            0 => prop_assert!(area == 0 && !lone),
            _ => prop_assert!(area < 2 * cells && (area > 0 || lone)),
        }
        let told = f64::from(coverage) / 255.0 * cells as f64;
        prop_assert!((told - exact).abs() <= 2.001 * cells as f64 / 255.0 || area == 0);
        total += told;
        // Lone samples are covered by more than they are; else a row is off by one rounding.
        let whole = (1_u64 << (2 * level)) as f64;
        slack += if area == 0 { told } else { 0.0 } + if column == 0 { whole / 255.0 } else { 0.0 };
        if area > 0 && exact * 255.0 < 1.5 * cells as f64 {
            slack += cells as f64 / 255.0;
        }
    }
    prop_assert_eq!(halves, file.about().area);
    prop_assert!(
        (total - halves as f64 / 2.0).abs() <= slack + 1e-6,
        "{total} for {}: off by more than {slack}",
        halves as f64 / 2.0
    );
    Ok(())
}

/// Normals and colours are means over what each sample stands for.
fn check_light(field: &HeightField, file: &HeightFile, level: u32, samples: &Samples) -> Result<(), TestCaseError> {
    let (lattice, truth, slopes) = (file.lattice(), Truth(field), slopes(&field.grid));
    for at in 0..samples.coverage.len() {
        let (row, column) = ((at / samples.columns) as u64, (at % samples.columns) as u64);
        if lattice.cells(level, [row, column]) == 0 {
            continue;
        }
        let [rows, columns] = [lattice.stands_for(0, level, row), lattice.stands_for(1, level, column)];
        let (mut normal, mut count, mut weights, mut light_sum) = ([0.0; 3], 0.0, 0.0, vec![0.0; samples.planes.len()]);
        for (r, c) in (rows[0]..rows[1]).flat_map(|r| (columns[0]..columns[1]).map(move |c| (r, c))) {
            let cell = truth.cell(r, c);
            for triangle in cell.triangles() {
                let slope = [triangle.at[1] * slopes[0], triangle.at[2] * slopes[1]];
                let length = (1.0 + slope[0] * slope[0] + slope[1] * slope[1]).sqrt();
                normal.iter_mut().zip([-slope[0], -slope[1], 1.0]).for_each(|(sum, part)| *sum += part / length);
                count += 1.0;
            }
            // Quarters next to corners, in small squares.
            for (y, x) in (0..8).flat_map(|y| (0..8).map(move |x| (y, x))) {
                let (v, u) = ((f64::from(y) + 0.4) / 8.0, (f64::from(x) + 0.6) / 8.0);
                if !cell.height(u, v).is_nan() && x != y && x + y != 7 {
                    let corner = (r + u64::from(y > 3)) * field.grid.columns + c + u64::from(x > 3);
                    weights += 1.0;
                    for (sum, plane) in light_sum.iter_mut().zip(&field.planes) {
                        *sum += f64::from(light::table()[usize::from(plane[corner as usize])]);
                    }
                }
            }
        }
        if count > 0.0 {
            let told = normal_of(samples.normals[at]);
            for (told, sum) in told.into_iter().zip(normal) {
                prop_assert!((f64::from(told) - sum / count).abs() < 0.006, "{told} for {}", sum / count);
            }
            for (plane, sum) in samples.planes.iter().zip(light_sum) {
                // Lone samples count, too, by next to nothing.
                let (low, high) = (sum / weights * 0.985 - 40.0, sum / weights * 1.015 + 400.0);
                prop_assert!(
                    (light::value(low.max(0.0)).saturating_sub(1)..=light::value(high).saturating_add(1))
                        .contains(&plane[at])
                );
            }
        }
    }
    Ok(())
}

#[test]
fn the_same_bytes_with_any_threads_and_memory() {
    let folder = tempfile::tempdir().unwrap();
    let field = field(700, 900, SampleType::I16, 2, 1, 5);
    let mut files = Vec::new();
    for (threads, memory) in [(1, None), (2, None), (3, Some(64_u64 << 20)), (2, Some(4 << 30))] {
        let path = folder.path().join("field.df");
        let (threads, is_temporary) = (Some(threads), memory.is_some());
        let options = HeightBuildOptions { threads, memory, is_temporary, ..HeightBuildOptions::default() };
        build_heights(&field, &HeightOrigin::default(), &options, &path, &()).unwrap();
        files.push(std::fs::read(&path).unwrap());
    }
    assert!(files.iter().all(|file| *file == files[0]));
    let options = HeightBuildOptions { memory: Some(1 << 20), ..HeightBuildOptions::default() };
    let error =
        build_heights(&field, &HeightOrigin::default(), &options, &folder.path().join("other.df"), &()).unwrap_err();
    assert!(error.to_string().contains("memory"), "{error}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn heights_are_rounded_within_the_range_and_once() {
    let folder = tempfile::tempdir().unwrap();
    let field = field(60, 50, SampleType::F32, 2, 1, 3);
    let [path, again] = ["field.df", "again.df"].map(|name| folder.path().join(name));
    let origin = HeightOrigin { path: "dem.tif".into(), ..HeightOrigin::default() };
    let options = |error: f64| HeightBuildOptions { height_error: Some(error), ..HeightBuildOptions::default() };
    for (error, expected) in [
        (0.0, "found 0, expected a number above 0"),
        (-1.0, "found -1, expected a number above 0"),
        (f64::NAN, "found NaN, expected a number above 0"),
        (f64::INFINITY, "found inf, expected a number above 0"),
        (1000.0, "found 1000, expected at most the range of heights, "),
    ] {
        let refused = build_heights(&field, &origin, &options(error), &path, &()).unwrap_err().to_string();
        assert!(refused.starts_with(&format!("dem.tif: --height-error: {expected}")), "{refused}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
    build_heights(&field, &origin, &options(0.05), &path, &()).unwrap();
    let open = crate::OpenHeights::open(&path, &crate::import::HeightOptions::default()).unwrap();
    assert_eq!(open.height_error(), Some(0.05));
    // What a page file is built from stays as rounded as it is.
    open.build(&HeightBuildOptions::default(), &again, &()).unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), std::fs::read(&again).unwrap());
    let refused = open.build(&options(0.1), &again, &()).unwrap_err().to_string();
    assert!(refused.contains("--height-error: found 0.1 for a page file that is within 0.05"), "{refused}");
    // Nothing to round: the file is the same as without.
    build_heights(&field, &origin, &HeightBuildOptions::default(), &path, &()).unwrap();
    build_heights(&field, &origin, &options(1e-60), &again, &()).unwrap();
    assert_eq!(std::fs::read(&path).unwrap(), std::fs::read(&again).unwrap());
    // A level field has no range.
    let level = HeightField::of(20, 10, vec![1.5; 200]);
    let about = build_heights(&level, &origin, &options(10.0), &path, &()).unwrap();
    assert_eq!((about.facts.min, about.facts.max, about.rounded.map(|rounded| rounded.error)), (0.0, 0.0, Some(10.0)));
}

#[test]
fn every_flipped_bit_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let field = field(60, 50, SampleType::I16, 2, 1, 3);
    let rounded = rounded(&field.grid, &HeightOrigin::default(), Some(1.0)).unwrap();
    let (file, _) = built(&field, 4, rounded, folder.path());
    let bytes = std::fs::read(file.path()).unwrap();
    let path = folder.path().join("damaged.df");
    std::fs::write(&path, &bytes).unwrap();
    let mut damaged = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
    let mut put = |at: usize, byte: u8| {
        damaged.seek(SeekFrom::Start(at as u64)).unwrap();
        damaged.write_all(&[byte]).unwrap();
    };
    let mut noise = Noise(9);
    // Two or three bits of every byte of what the file says, each of the eight as often, and some of the zeros between.
    for flip in (0..8 * bytes.len()).step_by(3) {
        let (at, bit) = (flip / 8, flip % 8);
        let is_zero = bytes[at.saturating_sub(8)..(at + 8).min(bytes.len())].iter().all(|byte| *byte == 0);
        if is_zero && !noise.next().is_multiple_of(64) {
            continue;
        }
        put(at, bytes[at] ^ 1 << bit);
        assert!(verify_heights(&path, &()).is_err(), "bit {bit} of byte {at} of {}", bytes.len());
        put(at, bytes[at]);
    }
    assert!(verify_heights(&path, &()).is_ok());
    for len in [0, 1, 63, 64, 4096, bytes.len() / 2, bytes.len() - 1] {
        std::fs::write(&path, &bytes[..len]).unwrap();
        assert!(HeightFile::open(&path, ReadMethod::default()).is_err());
    }
}

#[test]
fn damage_behind_right_checksums_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let field = field(40, 45, SampleType::I16, 1, 1, 7);
    let path = folder.path().join("damaged.df");
    let files = [None, Some(2.0)].map(|error| {
        let rounded = rounded(&field.grid, &HeightOrigin::default(), error).unwrap();
        let bytes = std::fs::read(built(&field, 3, rounded, folder.path()).0.path()).unwrap();
        let footer = u64::from_le_bytes(bytes[24..32].try_into().unwrap()) as usize;
        (bytes, footer)
    });
    let mut noise = Noise(11);
    for case in 0..3000 {
        let (bytes, footer) = &files[case % 2];
        let mut damaged = bytes.clone();
        let at = footer + (noise.next() as usize % (bytes.len() - footer));
        damaged[at] = noise.next() as u8;
        let crc = crc32c::crc32c(&damaged[*footer..]);
        damaged[40..44].copy_from_slice(&crc.to_le_bytes());
        let crc = crc32c::crc32c(&damaged[..60]);
        damaged[60..64].copy_from_slice(&crc.to_le_bytes());
        std::fs::write(&path, &damaged).unwrap();
        // No panic, whatever it says.
        let _ = verify_heights(&path, &());
        if let Ok(file) = HeightFile::open(&path, ReadMethod::default()) {
            if file.about().grid.samples() < 1 << 20 {
                let mut out = vec![0.0; file.about().grid.samples() as usize];
                let _ = file.stored(Window::all(&file.about().grid.clone()), &mut out);
            }
            let _ = file.lattice().keys().take(200).try_for_each(|key| file.chunk(key).map(|_| ()));
        }
    }
}

#[test]
fn nothing_measured_is_no_field() {
    let folder = tempfile::tempdir().unwrap();
    let field = HeightField::of(3, 4, vec![f64::NAN; 12]);
    let path = folder.path().join("nothing.df");
    let error =
        build_heights(&field, &HeightOrigin::default(), &HeightBuildOptions::default(), &path, &()).unwrap_err();
    assert!(error.to_string().contains("12 of 12"), "{error}");
    assert!(!path.exists());
}
