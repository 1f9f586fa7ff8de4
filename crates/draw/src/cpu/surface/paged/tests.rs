//! Page files of random fields against the same fields in memory, and against sums over the cells of T.

use super::super::look::{Attribute, Light, Look};
use super::super::memory::MemorySurface;
use super::super::picture::{SurfacePicture, draw};
use super::super::placed::Map;
use super::super::samples::SampleHeights;
use super::super::select::Technique;
use super::*;
use crate::color::TransferFunction;
use crate::view::{Projection, View};
use deepfield_data::model::{ReadMethod, SampleType, Scale, Unit};
use deepfield_data::store::{Disk, LocalFile};
use deepfield_heights::build::{HeightBuildOptions, HeightOrigin, build_heights};
use deepfield_heights::model::{Cell, HeightField, HeightGrid, Plane};
use glam::DVec3;
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::{Rng, SeedableRng};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};

/// Random numbers from 0 to 1.
struct Random(Pcg64Mcg);

impl Random {
    fn next(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// How a field is broken.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Holes {
    None,
    /// Lakes of several sizes.
    Lakes,
    /// A third of all samples.
    Random,
    /// Every other sample of a checkerboard in some places: samples in no triangle.
    Lone,
}

/// Hills of many sizes, with roughness from sample to sample.
fn field(
    rows: usize,
    columns: usize,
    holes: Holes,
    roughness: f64,
    planes: usize,
    sample_type: SampleType,
) -> HeightField {
    let mut random = Random(Pcg64Mcg::seed_from_u64((rows * 7919 + columns) as u64));
    let waves: Vec<[f64; 4]> = (0..7)
        .map(|k| {
            let (size, angle) = (300.0 / 1.6_f64.powi(k), 6.3 * random.next());
            [angle.cos() / size, angle.sin() / size, 6.3 * random.next(), 0.3 * size]
        })
        .collect();
    let lakes: Vec<[f64; 3]> = (0..9)
        .map(|k| [rows as f64 * random.next(), columns as f64 * random.next(), 90.0 / (1.0 + f64::from(k))])
        .collect();
    let mut grid = HeightGrid::new(columns as u64, rows as u64, sample_type);
    (grid.step, grid.origin) = ([1.5, -2.0], [1000.0, -200.0]);
    (grid.xy_unit, grid.height_unit) = (Unit::new("mm"), Unit::new("um"));
    grid.scale = Scale { slope: 500.0, intercept: 2000.0 };
    grid.planes = (0..planes).map(|number| Plane { name: format!("plane {number}") }).collect();
    let mut stored = Vec::with_capacity(rows * columns);
    for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
        let (y, x) = (row as f64, column as f64);
        let height: f64 = waves.iter().map(|[a, b, phase, size]| size * (a * x + b * y + phase).sin()).sum();
        let height = height + roughness * random.next();
        let is_hole = match holes {
            Holes::None => false,
            Holes::Lakes => lakes.iter().any(|[r, c, size]| (y - r).hypot(x - c) < *size),
            Holes::Random => random.next() < 0.33,
            Holes::Lone => lakes.iter().any(|[r, c, size]| (y - r).hypot(x - c) < *size) && (row + column) % 2 == 0,
        };
        let value = if sample_type.is_float() { f64::from(height as f32) } else { height.round() };
        stored.push(if is_hole { f64::NAN } else { value });
    }
    let shades = |plane: usize| {
        let shade = move |index: usize| {
            let (y, x) = ((index / columns) as f64, (index % columns) as f64);
            (128.0 + 120.0 * (x / (40.0 + 20.0 * plane as f64) + (y / 70.0).cos()).sin()) as u8
        };
        (0..rows * columns).map(shade).collect()
    };
    HeightField { planes: (0..planes).map(shades).collect(), stored, grid }
}

struct Built {
    folder: tempfile::TempDir,
}

impl Built {
    fn new(field: &HeightField) -> Built {
        let folder = tempfile::tempdir().unwrap();
        let origin = HeightOrigin::default();
        build_heights(field, &origin, &HeightBuildOptions::default(), &folder.path().join("field.df"), &()).unwrap();
        Built { folder }
    }

    fn path(&self) -> PathBuf {
        self.folder.path().join("field.df")
    }

    fn surface(&self, budget_bytes: u64) -> PagedSurface {
        PagedSurface::new(Arc::new(HeightFile::open(&self.path(), ReadMethod::default()).unwrap()), budget_bytes)
    }
}

const AMPLE: u64 = 1 << 30;

fn placed(field: &HeightField) -> Placed {
    Placed::new(&field.grid, Map::Plate, 1.0, 0.0)
}

fn bits(heights: &SampleHeights) -> Vec<u64> {
    heights.iter().map(|height| if height.is_nan() { 1 } else { height.to_bits() }).collect()
}

/// Fields of sizes that are no multiples of a chunk's, down to the least.
fn fields() -> Vec<HeightField> {
    vec![
        field(700, 530, Holes::Lakes, 0.3, 2, SampleType::F32),
        field(700, 530, Holes::Random, 2.0, 0, SampleType::I16),
        field(530, 301, Holes::Lone, 0.5, 1, SampleType::I32),
        field(601, 777, Holes::None, 1.0, 0, SampleType::I16),
        field(257, 513, Holes::None, 0.0, 3, SampleType::F32),
        field(2, 600, Holes::None, 0.5, 0, SampleType::F32),
        field(2, 2, Holes::None, 0.5, 1, SampleType::F32),
    ]
}

#[test]
fn leaves_are_those_of_memory_to_the_bit() {
    for field in fields() {
        let (memory, built) = (MemorySurface::new(&field, placed(&field).true_lift).unwrap(), Built::new(&field));
        let paged = built.surface(AMPLE);
        assert_eq!(paged.lattice(), memory.lattice());
        for key in paged.lattice().keys().filter(|key| key.level == 0) {
            let (own, expected) = (paged.samples(key).unwrap(), memory.samples(key).unwrap());
            assert_eq!((own.rows, own.columns), (expected.rows, expected.columns));
            assert_eq!(bits(&own.heights), bits(&expected.heights));
            assert_eq!(own.coverage, expected.coverage, "{key:?}");
            assert!(own.normals == expected.normals, "{key:?}");
            assert_eq!(own.planes, expected.planes);
        }
        assert!(paged.error().is_none());
        let beyond = ChunkKey { level: 70, row: 0, column: 0 };
        assert!(paged.samples(beyond).is_none() && paged.facts(beyond).is_none());
        paged.prefetch(&[beyond]);
    }
}

#[test]
fn facts_are_those_of_memory() {
    for field in fields() {
        let (memory, built) = (MemorySurface::new(&field, placed(&field).true_lift).unwrap(), Built::new(&field));
        let paged = built.surface(AMPLE);
        let is_whole = field.stored.iter().all(|height| !height.is_nan());
        for key in paged.lattice().keys() {
            let (own, expected) = (paged.facts(key).unwrap(), memory.facts(key).unwrap());
            let told = format!("{:?} {key:?}: {own:?}, in memory {expected:?}", field.grid.described());
            let small = 1e-9 * (expected.max - expected.min);
            assert_eq!(own.is_empty(), expected.is_empty(), "{told}");
            let [edges, pairs] = steps(&paged.samples(key).unwrap());
            assert!(edges <= own.step && own.step <= pairs, "{told}: {edges} {pairs}");
            if key.level == 0 || is_whole {
                assert_eq!((own.min, own.max), (expected.min, expected.max), "{told}");
                assert!(own.step <= expected.step, "{told}");
                // Memory also looks beside the diagonals of cells that are no squares.
                assert!(own.delta <= expected.delta + small, "{told}");
                let rectangle = paged.lattice().rectangle(key);
                let is_square = rectangle.iter().all(|[first, last]| (last - first).is_multiple_of(1 << key.level));
                assert!(!is_square || own.delta >= expected.delta - small, "{told}");
            } else {
                assert!(own.min <= expected.max && own.max >= expected.min, "{told}");
            }
            if key.level == 0 {
                assert_eq!((own.delta, own.deviation), (0.0, 0.0));
            }
            assert!(own.deviation >= expected.deviation - 0.05, "{told}");
        }
    }
}

/// The largest step along an edge of a chunk's triangles, and between any two corners of a cell.
fn steps(samples: &NodeSamples) -> [f64; 2] {
    let (mut edges, mut pairs) = (0.0_f64, 0.0_f64);
    for (row, column) in (0..samples.rows - 1).flat_map(|row| (0..samples.columns - 1).map(move |column| (row, column)))
    {
        let at = row * samples.columns + column;
        let cell = Cell([at, at + 1, at + samples.columns, at + samples.columns + 1].map(|at| samples.heights.at(at)));
        for triangle in cell.triangles() {
            let [a, b, c] = triangle.corners.map(|corner| cell.0[corner]);
            edges = [a - b, b - c, c - a].into_iter().fold(edges, |most, step| most.max(step.abs()));
        }
        let corners = cell.0.into_iter().filter(|height| !height.is_nan());
        let [low, high] =
            corners.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], height| [low.min(height), high.max(height)]);
        pairs = pairs.max(high - low);
    }
    [edges, pairs]
}

/// What the samples of coarse chunks say is what the cells of T say that they stand for.
#[test]
fn coarse_samples_are_means_over_cells() {
    for field in fields() {
        let built = Built::new(&field);
        let paged = built.surface(AMPLE);
        let lattice = *paged.file().lattice();
        let slope = [0, 1].map(|axis| placed(&field).true_lift / field.grid.step[axis]);
        let scale = field.grid.scale;
        let columns = field.grid.columns as usize;
        let height = |row: u64, column: u64| scale.value(field.stored[row as usize * columns + column as usize]);
        for key in paged.lattice().keys().filter(|key| key.level > 0) {
            let samples = paged.samples(key).unwrap();
            let part = lattice.part(key);
            for (row, column) in (0..samples.rows).flat_map(|row| (0..samples.columns).map(move |column| (row, column)))
            {
                let index = row * samples.columns + column;
                let [rows, across] = [(0, part.row + row as u64), (1, part.column + column as u64)]
                    .map(|(axis, index)| lattice.stands_for(axis, key.level.into(), index));
                let cells = (rows[1] - rows[0]) * (across[1] - across[0]);
                let (mut area, mut sum) = (0.0, [0.0; 3]);
                for (r, c) in (rows[0]..rows[1]).flat_map(|r| (across[0]..across[1]).map(move |c| (r, c))) {
                    let cell = Cell([height(r, c), height(r, c + 1), height(r + 1, c), height(r + 1, c + 1)]);
                    for triangle in cell.triangles() {
                        let [x, y] = [triangle.at[1] * slope[0], triangle.at[2] * slope[1]];
                        let length = (x * x + y * y + 1.0).sqrt();
                        area += 0.5;
                        (0..3).for_each(|k| sum[k] += 0.5 * [-x, -y, 1.0][k] / length);
                    }
                }
                let coverage = f64::from(samples.coverage_at(index)) / 255.0;
                assert_eq!(coverage > 0.0, !samples.heights.at(index).is_nan());
                if cells == 0 || area == 0.0 {
                    continue;
                }
                // A rounding, and what rounding left of the sample before it.
                let share = area / cells as f64;
                assert!(
                    (coverage - share).abs() <= 1.51 / 255.0,
                    "{key:?} {row} {column}: {coverage}, expected {share}"
                );
                for (found, sum) in samples.normals.at(index).into_iter().zip(sum) {
                    let found = f64::from(found);
                    // Both may make the same byte, from its ends.
                    assert!((found - sum / area).abs() <= 1.0 / 127.0 + 1e-3, "{key:?} {row} {column}: {found}");
                }
            }
        }
    }
}

/// On a surface that is smooth from sample to sample, both ways of taking means agree.
#[test]
fn coarse_samples_are_nearly_those_of_memory() {
    for holes in [Holes::None, Holes::Lakes] {
        let field = field(700, 530, holes, 0.0, 2, SampleType::F32);
        let (memory, built) = (MemorySurface::new(&field, placed(&field).true_lift).unwrap(), Built::new(&field));
        let paged = built.surface(AMPLE);
        for key in paged.lattice().keys().filter(|key| key.level > 0) {
            let (own, expected) = (paged.samples(key).unwrap(), memory.samples(key).unwrap());
            let (mut share, mut expected_share) = (0.0, 0.0);
            for index in 0..own.heights.len() {
                let (coverage, other) = (own.coverage_at(index), expected.coverage_at(index));
                share += f64::from(coverage);
                expected_share += f64::from(other);
                let is_rim = [index / own.columns, index / own.columns + 1].contains(&(own.rows - 1))
                    || [index % own.columns, index % own.columns + 1].contains(&(own.columns - 1));
                if coverage < u8::MAX || other < u8::MAX || is_rim {
                    continue;
                }
                for k in 0..3 {
                    assert!((own.normals.at(index)[k] - expected.normals.at(index)[k]).abs() < 0.01, "{key:?} {index}");
                }
                for (plane, other) in own.planes.iter().zip(&expected.planes) {
                    assert!((plane[index] - other[index]).abs() < 0.01);
                }
            }
            let all = 255.0 * own.heights.len() as f64;
            assert!((share - expected_share).abs() < 2e-3 * all, "{key:?}: {share} {expected_share}");
        }
    }
}

fn look(attribute: Attribute, range: [f64; 2]) -> Look {
    let light = Light::Sun { azimuth: 315.0, altitude: 45.0 };
    Look { attribute, transfer: TransferFunction::default(), range, light, ambient: 0.25, contours: None }
}

fn sights(field: &HeightField) -> Vec<Sight> {
    let placed = placed(field);
    let (columns, rows) = (field.grid.columns as f64, field.grid.rows as f64);
    let middle = placed.world(rows / 2.0, columns / 2.0, 2000.0);
    let size = placed.world(rows, columns, 0.0) - placed.world(0.0, 0.0, 0.0);
    let length = size.length();
    let view = |away: DVec3, projection: Projection| {
        let up = if away.x == 0.0 && away.y == 0.0 { DVec3::Y } else { DVec3::Z };
        Sight::Flat(View::look_at(middle + away, middle, up, projection, 160, 120).unwrap())
    };
    let perspective = Projection::Perspective { fov_y: 0.7 };
    vec![
        view(DVec3::new(0.0, 0.0, length), Projection::Orthographic { height: 0.8 * length }),
        view(DVec3::new(0.3, -0.8, 0.8) * length, perspective),
        view(DVec3::new(-0.05, 0.1, 0.12) * length, perspective),
    ]
}

/// The mean difference of pictures, in 255ths.
fn mean_difference(one: &SurfacePicture, other: &SurfacePicture) -> f64 {
    let bytes = |picture: &SurfacePicture| -> Vec<[f64; 4]> {
        let encode =
            |color: &[f32; 4]| [0, 1, 2, 3].map(|k| 255.0 * f64::from(crate::color::colors::to_encoded(color[k])));
        picture.colors.rgba.iter().map(encode).collect()
    };
    let (one, other) = (bytes(one), bytes(other));
    let sum: f64 = one.iter().zip(&other).map(|(a, b)| (0..4).map(|k| (a[k] - b[k]).abs()).sum::<f64>() / 4.0).sum();
    sum / one.len() as f64
}

#[test]
fn pictures_are_nearly_those_of_memory() {
    for (holes, seed_rows) in [(Holes::None, 700), (Holes::Lakes, 690), (Holes::Lone, 720)] {
        let field = field(seed_rows, 530, holes, 0.3, 3, SampleType::F32);
        let (memory, built) = (MemorySurface::new(&field, placed(&field).true_lift).unwrap(), Built::new(&field));
        let paged = built.surface(AMPLE);
        let placed = placed(&field);
        for (number, sight) in sights(&field).iter().enumerate() {
            for attribute in [Attribute::Slope, Attribute::Texture([0, 1, 2])] {
                let options = SurfaceOptions { look: Some(look(attribute, [0.0, 60.0])), ..SurfaceOptions::default() };
                let (own, expected) = (draw(&paged, &placed, sight, &options), draw(&memory, &placed, sight, &options));
                assert!(own.report.is_converged && own.report.covered > 1000.0);
                let difference = mean_difference(&own, &expected);
                assert!(difference < 1.0, "{holes:?}, view {number}, {attribute:?}: {difference} of 255");
            }
            // Without any error both are T.
            let options =
                SurfaceOptions { technique: Technique::Rays, tau: 0.0, raw: true, ..SurfaceOptions::default() };
            let (own, expected) = (draw(&paged, &placed, sight, &options), draw(&memory, &placed, sight, &options));
            for (own, expected) in own.raw.iter().zip(&expected.raw) {
                assert_eq!(own.map(f64::is_nan), expected.map(f64::is_nan));
                for (own, expected) in own.iter().zip(expected).filter(|(own, _)| !own.is_nan()) {
                    assert!((own - expected).abs() <= 1e-9 * expected.abs().max(1.0), "{own} {expected}");
                }
            }
        }
    }
}

/// What is far away is the mean of what it is near by, and as smooth as normals that nobody rounds to bytes make it.
#[test]
fn curvature_far_away_is_the_mean_of_that_near_by() {
    const SIDE: usize = 520;
    let wave = 2.0 * std::f64::consts::PI / 256.0;
    let height = |index: usize| {
        let [row, column] = [index / SIDE, index % SIDE].map(|at| (wave * at as f64).sin());
        f64::from((20.0 * row * column) as f32)
    };
    let field = HeightField::of(SIDE as u64, SIDE as u64, (0..SIDE * SIDE).map(height).collect());
    let (memory, built) = (MemorySurface::new(&field, 1.0).unwrap(), Built::new(&field));
    let (paged, placed) = (built.surface(AMPLE), placed(&field));
    let transfer = crate::modes::surface::usual_transfer(Attribute::Curvature);
    let range = [-20.0 * wave * wave, 20.0 * wave * wave];
    let look = Look { transfer, light: Light::Eye, ambient: 1.0, ..look(Attribute::Curvature, range) };
    // What is looked at is the same: what it looks like is of coarse levels where these are as fine as the picture.
    let options = SurfaceOptions { look: Some(look), tau: 0.0, ..SurfaceOptions::default() };
    let drawn = |source: &dyn SurfaceNodes, side: u32| {
        let middle = DVec3::new(260.0, 260.0, 0.0);
        let projection = Projection::Orthographic { height: 512.0 };
        let view = View::look_at(middle + 1000.0 * DVec3::Z, middle, DVec3::Y, projection, side, side).unwrap();
        draw(source, &placed, &Sight::Flat(view), &options)
    };
    let near = drawn(&paged, 512).colors.rgba;
    // Curvature is one number between four samples, and these may be beside a pixel's middle by half of their distance: the rest is that.
    for (parts, most) in [(4_usize, 1.0), (8, 1.8)] {
        let side = 512 / parts;
        let mean = |index: usize| {
            let inside = (0..parts * parts).map(|part| {
                let [row, column] = [index / side * parts + part / parts, index % side * parts + part % parts];
                near[512 * row + column]
            });
            let sum = inside.fold([0.0; 4], |sum: [f32; 4], color| [0, 1, 2, 3].map(|k| sum[k] + color[k]));
            sum.map(|sum| sum / (parts * parts) as f32)
        };
        let colors = crate::color::Colors { rgba: (0..side * side).map(mean).collect(), ..Default::default() };
        let expected = SurfacePicture { colors, ..SurfacePicture::default() };
        let (far, smooth) = (drawn(&paged, side as u32), drawn(&memory, side as u32));
        let found = [mean_difference(&far, &expected), mean_difference(&far, &smooth)];
        assert!(found[0] < most && found[1] < 0.2, "1/{parts}: {found:?} of 255");
    }
}

/// A file that counts what is read of it, and has one byte of it wrong.
#[derive(Debug)]
struct Watched {
    file: LocalFile,
    reads: AtomicU64,
    wrong: Mutex<Option<u64>>,
    /// How many reads fail from now on.
    failing: Mutex<u64>,
}

impl Disk for Watched {
    fn read_exact_at(&self, buffer: &mut [u8], offset: u64) -> std::io::Result<()> {
        if offset == 0 {
            // The header, which tells whether the file was rewritten.
            return self.file.read_exact_at(buffer, offset);
        }
        self.reads.fetch_add(1, Ordering::Relaxed);
        // Others come in meanwhile.
        std::thread::sleep(std::time::Duration::from_millis(5));
        {
            let mut failing = locked(&self.failing);
            if *failing > 0 {
                *failing -= 1;
                return Err(std::io::Error::other("not now"));
            }
        }
        self.file.read_exact_at(buffer, offset)?;
        let at = locked(&self.wrong).and_then(|wrong| wrong.checked_sub(offset));
        if let Some(byte) = at.and_then(|at| buffer.get_mut(at as usize)) {
            *byte ^= 4;
        }
        Ok(())
    }

    fn size(&self) -> std::io::Result<u64> {
        self.file.size()
    }

    fn change(&self) -> Option<deepfield_data::store::Change> {
        None
    }
}

fn watched(built: &Built, budget_bytes: u64) -> (Arc<Watched>, PagedSurface) {
    let file = LocalFile::open(&built.path(), ReadMethod::default()).unwrap().unwrap();
    let (wrong, failing) = (Mutex::new(None), Mutex::new(0));
    let disk = Arc::new(Watched { file, reads: AtomicU64::new(0), wrong, failing });
    let file = HeightFile::open_on(&built.path(), disk.clone()).unwrap();
    (disk, PagedSurface::new(Arc::new(file), budget_bytes))
}

#[test]
fn chunks_are_kept_within_the_budget_and_read_once_at_a_time() {
    let built = Built::new(&field(700, 1000, Holes::None, 3.0, 0, SampleType::F32));
    let chunk = 257 * 257 * 14 + size_of::<NodeSamples>() as u64;
    let (disk, paged) = watched(&built, 3 * chunk + 100);
    let key = |column: u32| ChunkKey { level: 0, row: 0, column };
    let reads = || disk.reads.swap(0, Ordering::Relaxed);
    reads();
    // Four threads want the same.
    let found: Vec<_> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..4).map(|_| scope.spawn(|| paged.samples(key(0)).unwrap())).collect();
        threads.into_iter().map(|thread| thread.join().unwrap()).collect()
    });
    assert!(found.iter().all(|samples| Arc::ptr_eq(samples, &found[0])));
    assert_eq!((reads(), paged.held_bytes()), (1, chunk));
    // What was used last stays.
    (1..3).for_each(|column| drop(paged.samples(key(column))));
    paged.samples(key(0)).unwrap();
    assert_eq!((reads(), paged.held_bytes()), (2, 3 * chunk));
    paged.samples(ChunkKey { level: 0, row: 1, column: 0 }).unwrap();
    assert_eq!((reads(), paged.held_bytes()), (1, 3 * chunk));
    paged.samples(key(0)).unwrap();
    assert_eq!(reads(), 0);
    paged.samples(key(1)).unwrap();
    assert_eq!(reads(), 1);
    // What does not fit is not read ahead, and what others hold stays theirs.
    let (disk, paged) = watched(&built, 2 * 257 * 257 * 15);
    disk.reads.store(0, Ordering::Relaxed);
    paged.prefetch(&[key(0), key(1), key(2)]);
    assert_eq!((disk.reads.load(Ordering::Relaxed), paged.held_bytes()), (2, 2 * chunk));
    let (_, paged) = watched(&built, 0);
    assert!(paged.samples(key(0)).is_some_and(|samples| samples.rows == 257));
    assert_eq!(paged.held_bytes(), 0);
}

/// Four threads that want everything, in a budget for few.
#[test]
fn any_number_of_threads_sees_the_same() {
    let built = Built::new(&field(700, 1000, Holes::Lakes, 1.0, 1, SampleType::I16));
    let (ample, scant) = (built.surface(AMPLE), built.surface(5_000_000));
    let keys: Vec<ChunkKey> = ample.lattice().keys().collect();
    std::thread::scope(|scope| {
        for thread in 0..4 {
            let (keys, ample, scant) = (&keys, &ample, &scant);
            scope.spawn(move || {
                for turn in 0..60 {
                    let key = keys[(turn * (2 * thread + 1) + thread) % keys.len()];
                    let (own, expected) = (scant.samples(key).unwrap(), ample.samples(key).unwrap());
                    assert!(bits(&own.heights) == bits(&expected.heights) && own.normals == expected.normals);
                }
            });
        }
    });
    let held: u64 = locked(&scant.cache).entries.iter().map(|(_, entry)| entry.bytes).sum();
    assert_eq!(held, scant.held_bytes());
    assert!(held <= 5_000_000);
}

/// Where a page is damaged, what it is part of stands in, and the first error is told.
#[test]
fn stand_ins_for_damaged_pages() {
    let field = field(700, 1000, Holes::None, 1.0, 0, SampleType::F32);
    let built = Built::new(&field);
    let (disk, paged) = watched(&built, AMPLE);
    let placed = placed(&field);
    let sight = &sights(&field)[0];
    let options = SurfaceOptions {
        tau: 0.0,
        raw: true,
        look: Some(look(Attribute::Height, [0.0, 1.0])),
        ..SurfaceOptions::default()
    };
    let key = ChunkKey { level: 0, row: 1, column: 1 };
    let page = paged.file().page_of(key).unwrap();
    let bytes = std::fs::read(built.path()).unwrap();
    let raw = paged.file().fetch(page).unwrap();
    let start = bytes.windows(raw.bytes.len()).position(|window| window == raw.bytes).unwrap();
    *locked(&disk.wrong) = Some(start as u64 + 100);
    assert!(paged.error().is_none() && paged.is_there(key));
    paged.prepare(&placed, sight, &options);
    let error = paged.error().unwrap();
    assert!(error.contains("field.df") && error.contains(&format!("page {}", page.0)), "{error}");
    assert!(!paged.is_there(key) && paged.samples(key).is_none());
    let picture = draw(&paged, &placed, sight, &options);
    assert!(!picture.report.is_converged && !picture.report.is_coarser);
    let whole = draw(&built.surface(AMPLE), &placed, sight, &options);
    assert!(whole.report.is_converged);
    let gaps = picture.raw.iter().zip(&whole.raw).filter(|(own, whole)| own[0].is_nan() != whole[0].is_nan()).count();
    assert_eq!(gaps, 0);
}

#[test]
fn what_the_disk_fails_to_give_is_asked_for_again() {
    let field = field(700, 1000, Holes::None, 1.0, 0, SampleType::F32);
    let built = Built::new(&field);
    let (disk, paged) = watched(&built, AMPLE);
    let placed = placed(&field);
    let sight = &sights(&field)[0];
    let options = SurfaceOptions { look: Some(look(Attribute::Height, [0.0, 1.0])), ..SurfaceOptions::default() };
    // A disk that fails once, in silence.
    *locked(&disk.failing) = 1;
    paged.prepare(&placed, sight, &options);
    assert_eq!((*locked(&disk.failing), paged.error()), (0, None));
    assert!(draw(&paged, &placed, sight, &options).report.is_converged);
    // What it goes on failing to give is told, until a later picture has it.
    let far = ChunkKey { level: 0, row: 2, column: 3 };
    let (disk, mut other) = watched(&built, AMPLE);
    *locked(&disk.failing) = u64::MAX;
    assert!(other.samples(far).is_none() && other.is_there(far));
    assert!(other.error().is_some_and(|error| error.contains("field.df") && error.contains("not now")));
    *locked(&disk.failing) = 0;
    other.place(&placed);
    assert!(other.error().is_none() && other.samples(far).is_some());
}

/// In another world normals turn, of leaves and of coarse chunks alike.
#[test]
fn normals_turn_to_the_world() {
    let mut field = field(300, 520, Holes::None, 0.0, 0, SampleType::F32);
    (field.grid.step, field.grid.origin) = ([0.01, -0.01], [10.0, 50.0]);
    (field.grid.xy_unit, field.grid.height_unit) = (Unit::new("deg"), Unit::new("m"));
    field.grid.scale = Scale { slope: 20.0, intercept: 0.0 };
    let built = Built::new(&field);
    let mut paged = built.surface(AMPLE);
    let radius = 6_371_008.8;
    let (leaf, root) = (ChunkKey { level: 0, row: 0, column: 0 }, paged.lattice().root());
    let earth = [leaf, root].map(|key| paged.samples(key).unwrap());
    for map in [Map::Globe(deepfield_heights::model::Globe::sphere(radius)), Map::Local { radius }] {
        paged.place(&Placed::new(&field.grid, map, 1.0, 0.0));
        assert!(
            [leaf, root].iter().zip(&earth).all(|(key, earth)| paged.samples(*key).unwrap().normals == earth.normals)
        );
    }
    // The same heights on a body of a third of the size: three times as steep.
    paged.place(&Placed::new(&field.grid, Map::Local { radius: radius / 3.0 }, 1.0, 0.0));
    for (key, earth) in [leaf, root].iter().zip(&earth) {
        let own = paged.samples(*key).unwrap();
        for (own, earth) in own.normals.iter().zip(earth.normals.iter()) {
            let (own, earth) = (&own, &earth);
            let lean = |normal: &[f32; 3], k: usize| f64::from(normal[k] / normal[2]);
            for k in 0..2 {
                let away = (lean(own, k) - 3.0 * lean(earth, k)).abs();
                assert!(away < 1e-3 * (1.0 + lean(own, k).abs()), "{key:?}: {own:?} {earth:?}");
            }
            let length = |normal: &[f32; 3]| normal.iter().map(|part| part * part).sum::<f32>().sqrt();
            assert!((length(own) - length(earth)).abs() < 1e-4);
        }
    }
}
