//! Photos over planes and over fields with holes.

use super::super::look::{Attribute, Light, Look};
use super::super::paged::PagedSurface;
use super::super::picture::{self, SurfaceOptions, SurfacePicture, draw};
use super::super::placed::{Map, Placed};
use super::super::shade::Shader;
use super::super::sight::Sight;
use super::*;
use crate::color::TransferFunction;
use crate::color::colors::to_encoded;
use crate::view::{Projection, View};
use covered::{Covered, Pixels};
use deepfield_data::model::{ReadMethod, Unit};
use deepfield_heights::build::{HeightBuildOptions, HeightOrigin, Measured, build_heights};
use deepfield_heights::model::{Globe, HeightError, HeightField, HeightGrid, Heights, PhotoAbout, PhotoRows, Window};
use deepfield_heights::store::HeightFile;
use glam::DVec3;
use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::{Rng, SeedableRng};
use std::collections::BTreeSet;
use std::sync::Mutex;

#[path = "../../../../../../tests/support/covered.rs"]
mod covered;

impl Covered {
    /// Of `rows` x `columns` samples and `size` random pixels over all of them.
    fn new([rows, columns]: [u64; 2], size: [u64; 2], height: impl Fn(u64, u64) -> f64) -> Covered {
        let mut random = Pcg64Mcg::seed_from_u64(rows * 31 + size[0]);
        let heights = (0..rows * columns).map(|at| height(at / columns, at % columns)).collect();
        let field = HeightField::of(columns, rows, heights);
        let place = PhotoPlace::whole(&field.grid);
        let about = PhotoAbout { path: "p".into(), format: "png".into(), bytes: 0, size, is_grey: false, place };
        let values = (0..size[0] * size[1] * 3).map(|_| random.next_u64() as u8).collect();
        Covered { field, photo: Pixels { about, values } }
    }

    fn surface(&self) -> (PagedSurface, tempfile::TempDir) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("covered.df");
        build_heights(self, &HeightOrigin::default(), &HeightBuildOptions::default(), &path, &()).unwrap();
        let file = HeightFile::open(&path, ReadMethod::default()).unwrap();
        (PagedSurface::new(Arc::new(file), 64 << 20), folder)
    }

    fn placed(&self) -> Placed {
        Placed::new(&self.field.grid, Map::Plate, 1.0, 0.0)
    }

    fn light(&self, row: u64, column: u64) -> [f32; 3] {
        let at = (row * self.photo.about.size[1] + column) as usize * 3;
        std::array::from_fn(|k| to_linear(f32::from(self.photo.values[at + k]) / 255.0))
    }
}

/// From above, rows downwards, `high` of the field's units in so many pixels around a place.
fn from_above(middle: [f64; 2], high: f64, [width, height]: [u32; 2]) -> Sight {
    let target = DVec3::new(middle[0], middle[1], 0.0);
    let eye = target - 100.0 * DVec3::Z;
    let projection = Projection::Orthographic { height: high };
    // From below, so that columns go to the right and rows down.
    Sight::Flat(View::look_at(eye, target, -DVec3::Y, projection, width, height).unwrap())
}

fn picture(covered: &Covered, surface: &PagedSurface, sight: &Sight, samples: u32) -> SurfacePicture {
    let (attribute, transfer) = (Attribute::Photo, TransferFunction::default());
    let look = Look { attribute, transfer, range: [0.0, 1.0], light: Light::Eye, ambient: 1.0, contours: None };
    let options = SurfaceOptions { samples, look: Some(look), ..SurfaceOptions::default() };
    let placed = covered.placed();
    surface.prepare(&placed, sight, &options);
    draw(surface, &placed, sight, &options)
}

#[test]
fn a_photo_on_a_plane_shows_its_pixels() {
    // 8 pixels of the photo to a cell: the plane itself is never refined, as it is a plane at every level.
    let covered = Covered::new([300, 300], [2392, 2392], |_, _| 0.0);
    let (surface, _folder) = covered.surface();
    let own = picture(&covered, &surface, &from_above([150.0, 150.0], 16.0, [128, 128]), 1);
    assert!(own.report.is_converged);
    assert_eq!(own.report.levels, [1, 1]);
    // The picture's first pixel is number 1136 = (150 - 8) * 8 of the photo's.
    for (index, color) in own.colors.rgba.iter().enumerate() {
        let expected = covered.light(1136 + index as u64 / 128, 1136 + index as u64 % 128);
        assert_eq!(color[3], 1.0);
        (0..3).for_each(|k| assert!((color[k] - expected[k]).abs() < 1e-5, "{index}: {color:?} {expected:?}"));
    }
    // Nearer still: between the middles of pixels, which are 4 apart here.
    let near = picture(&covered, &surface, &from_above([150.0, 150.0], 4.0, [128, 128]), 1);
    let [one, other] = [covered.light(1190, 1190), covered.light(1190, 1191)];
    // Pixel (p, q) of the photo has its middle at 4 (p - 1184) + 2 of the picture.
    let at = |x: usize, y: usize| near.colors.rgba[y * 128 + x];
    for k in 0..3 {
        let below = covered.light(1191, 1190)[k];
        let beside = covered.light(1191, 1191)[k];
        // Half a pixel of the picture from the middle is an eighth of the way.
        let across = |left: f32, right: f32, share: f32| left + share * (right - left);
        let expected = across(across(one[k], other[k], 0.125), across(below, beside, 0.125), 0.125);
        assert!((at(26, 26)[k] - expected).abs() < 1e-5, "{} {expected}", at(26, 26)[k]);
    }
}

/// The mean of blocks of pixels, premultiplied.
fn shrunk(picture: &SurfacePicture, by: usize) -> Vec<[f32; 4]> {
    let (width, height) = (picture.colors.width as usize / by, picture.colors.height as usize / by);
    let mean = |at: usize| {
        let mut sum = [0.0_f32; 4];
        for (y, x) in (0..by).flat_map(|y| (0..by).map(move |x| (y, x))) {
            let own = picture.colors.rgba[(at / width * by + y) * width * by + at % width * by + x];
            (0..4).for_each(|k| sum[k] += own[k]);
        }
        sum.map(|sum| sum / (by * by) as f32)
    };
    (0..width * height).map(mean).collect()
}

/// The mean difference of what is shown, in 255ths, where at least half of a pixel shows something.
fn difference(far: &SurfacePicture, near: &[[f32; 4]]) -> f64 {
    let shown = |color: &[f32; 4]| [0, 1, 2].map(|k| color[k] / color[3]);
    let pairs = far.colors.rgba.iter().zip(near).filter(|(far, near)| far[3] >= 0.5 && near[3] >= 0.5);
    let pairs: Vec<([f32; 3], [f32; 3])> = pairs.map(|(far, near)| (shown(far), shown(near))).collect();
    let each = |(one, other): &([f32; 3], [f32; 3])| -> f64 {
        (0..3).map(|k| 255.0 * f64::from((to_encoded(one[k]) - to_encoded(other[k])).abs())).sum::<f64>() / 3.0
    };
    pairs.iter().map(each).sum::<f64>() / pairs.len() as f64
}

#[test]
fn far_photos_are_means_of_near_ones() {
    let hole = |row: u64, column: u64| (row / 9 + column / 13).is_multiple_of(5);
    let plane = Covered::new([260, 330], [720, 720], |_, _| 0.0);
    let mut holes = Covered::new([260, 330], [720, 720], |r, c| if hole(r, c) { f64::NAN } else { 0.0 });
    // What nobody sees is white, and would brighten means.
    for at in 0..720 * 720_u64 {
        let cell = |pixel: u64, last: f64| (((pixel as f64 + 0.5) / 720.0 * last) as u64, pixel);
        let ((row, _), (column, _)) = (cell(at / 720, 259.0), cell(at % 720, 329.0));
        if (row..row + 2).any(|r| (column..column + 2).any(|c| hole(r, c))) {
            holes.photo.values[at as usize * 3..][..3].fill(255);
        }
    }
    for (name, covered, bar) in [("plane", plane, 2.0), ("holes", holes, 3.0)] {
        let (surface, _folder) = covered.surface();
        let near = picture(&covered, &surface, &from_above([164.5, 129.5], 300.0, [960, 768]), 4);
        for by in [4, 8, 16] {
            let far = picture(&covered, &surface, &from_above([164.5, 129.5], 300.0, [960 / by, 768 / by]), 4);
            let off = difference(&far, &shrunk(&near, by as usize));
            println!("{name} 1/{by}: {off:.3}");
            assert!(off < bar, "{name} 1/{by}: {off}");
        }
    }
}

#[test]
fn beside_a_photo_a_surface_is_grey() {
    let mut covered = Covered::new([101, 201], [64, 32], |_, _| 0.0);
    covered.photo.about.place = PhotoPlace { rows: [20.0, 60.0], columns: [-30.0, 50.0] };
    covered.photo.values.fill(255);
    let (surface, _folder) = covered.surface();
    // A pixel a sample.
    let own = picture(&covered, &surface, &from_above([100.0, 50.0], 100.0, [200, 100]), 4);
    for (index, color) in own.colors.rgba.iter().enumerate() {
        let (x, y) = (index % 200, index / 200);
        let expected = if (20..60).contains(&y) && x < 50 { 1.0 } else { nothing()[0] };
        assert!((color[0] - expected).abs() < 1e-4 && color[3] == 1.0, "{x} {y}: {color:?}");
    }
    // From so far that pixels have parts of both: as much white as there is.
    let far = picture(&covered, &surface, &from_above([100.0, 50.0], 150.0, [18, 9]), 4);
    let sum: f32 = far.colors.rgba.iter().map(|color| color[0] - nothing()[0] * color[3]).sum();
    let expected = 40.0 * 50.0 / (150.0 * 150.0 / 81.0) * (1.0 - nothing()[0]);
    assert!((sum / expected - 1.0).abs() < 0.1, "{sum} {expected}");
}

#[test]
fn photos_repeat_after_a_turn() {
    // From 20 degrees east to 380, and a photo from -180 to 180 whose columns are brighter to the east.
    let mut covered = Covered::new([19, 361], [8, 360], |_, _| 0.0);
    covered.field.grid.xy_unit = Unit::new("deg");
    covered.field.grid.origin = [20.0, 0.0];
    covered.photo.about.place = PhotoPlace { rows: [0.0, 18.0], columns: [-200.0, 160.0] };
    for (index, values) in covered.photo.values.chunks_exact_mut(3).enumerate() {
        values.fill((index % 360 / 2) as u8);
    }
    let (surface, _folder) = covered.surface();
    let own = picture(&covered, &surface, &from_above([200.0, 9.0], 18.0, [360, 18]), 1);
    for (index, color) in own.colors.rgba.iter().enumerate() {
        let column = (index % 360 + 200) % 360;
        let expected = to_linear((column / 2) as f32 / 255.0);
        assert!(
            (color[0] - expected).abs() < 1e-4 || column.abs_diff(359) < 1 || column == 0,
            "{index}: {color:?} {expected}"
        );
    }
}

#[test]
fn damaged_tiles_have_coarser_ones_in_their_place() {
    let covered = Covered::new([33, 33], [600, 600], |_, _| 0.0);
    let (surface, folder) = covered.surface();
    let whole = from_above([16.0, 16.0], 32.0, [600, 600]);
    let sound = picture(&covered, &surface, &whole, 1);
    assert!(surface.error().is_none());
    let path = folder.path().join("covered.df");
    let bytes = std::fs::read(&path).unwrap();
    let at = bytes.windows(4).enumerate().skip(4096).filter(|(_, bytes)| *bytes == b"DFhe").nth(1).unwrap().0;
    let mut damaged = bytes.clone();
    damaged[at + 5000] ^= 1;
    std::fs::write(&path, damaged).unwrap();
    let file = HeightFile::open(&path, ReadMethod::default()).unwrap();
    let surface = PagedSurface::new(Arc::new(file), 64 << 20);
    let own = picture(&covered, &surface, &whole, 1);
    assert!(surface.error().unwrap().contains("page"));
    let changed = |x: usize, y: usize| own.colors.rgba[y * 600 + x] != sound.colors.rgba[y * 600 + x];
    let count = (0..600 * 600).filter(|at| changed(at % 600, at / 600)).count();
    assert!(count > 50_000 && count < 100_000, "{count}");
    assert!(own.colors.rgba.iter().all(|color| color[3] == 1.0));
}

/// The tiles of a photo, and which of them were asked for.
struct Asked<'a> {
    tiles: &'a PagedSurface,
    keys: Mutex<BTreeSet<TileKey>>,
}

impl PhotoTiles for Asked<'_> {
    fn laid(&self) -> Option<Laid> {
        self.tiles.laid()
    }

    fn tile(&self, key: TileKey) -> Option<Arc<Tile>> {
        self.keys.lock().unwrap().insert(key);
        PhotoTiles::tile(self.tiles, key)
    }
}

#[test]
fn tiles_that_a_picture_needs_are_known_before_it_is_shaded() {
    let hills = |row: u64, column: u64| 6.0 * ((row as f64 / 9.0).sin() + (column as f64 / 14.0).cos());
    let mut covered = Covered::new([260, 330], [2600, 3300], hills);
    for (place, world) in [(None, "flat"), (Some(-60.0), "globe")] {
        if let Some(first) = place {
            covered.field.grid.xy_unit = Unit::new("deg");
            (covered.field.grid.origin, covered.field.grid.step) = ([-180.0, 89.0], [1.0, -0.5]);
            // Over the first columns and over the last ones.
            covered.photo.about.place = PhotoPlace { rows: [-20.0, 240.0], columns: [first, first + 330.0] };
        }
        let (surface, _folder) = covered.surface();
        let globe = Globe { equator: 1000.0, pole: 990.0 };
        let map = if place.is_some() { Map::Globe(globe) } else { Map::Plate };
        let placed = Placed::new(&covered.field.grid, map, 1.0, 0.0);
        let cameras = match place {
            None => [
                (DVec3::new(20.0, 30.0, 40.0), DVec3::new(120.0, 110.0, 0.0)),
                (DVec3::new(160.0, 130.0, 300.0), DVec3::new(165.0, 135.0, 0.0)),
                (DVec3::new(160.0, -300.0, 90.0), DVec3::new(165.0, 135.0, 0.0)),
            ],
            Some(_) => [
                (1300.0 * DVec3::from(Globe::up(-150.0, 20.0)), DVec3::ZERO),
                (3000.0 * DVec3::from(Globe::up(90.0, 40.0)), DVec3::ZERO),
                (1100.0 * DVec3::from(Globe::up(30.0, 0.0)), 1000.0 * DVec3::from(Globe::up(60.0, 10.0))),
            ],
        };
        for (eye, target) in cameras {
            let projection = Projection::Perspective { fov_y: 0.7 };
            let sight = Sight::Flat(View::look_at(eye, target, DVec3::Z, projection, 160, 120).unwrap());
            let (attribute, transfer) = (Attribute::Photo, TransferFunction::default());
            let look = Look { attribute, transfer, range: [0.0, 1.0], light: Light::Eye, ambient: 1.0, contours: None };
            let options = SurfaceOptions { look: Some(look.clone()), ..SurfaceOptions::default() };
            surface.prepare(&placed, &sight, &options);
            let scene = picture::scene(&surface, &placed, &sight, &options);
            let fine = sight.refined(2);
            let Sight::Flat(view) = fine else { panic!("a flat picture") };
            let asked = Asked { tiles: &surface, keys: Mutex::default() };
            let (seen, _) = picture::visible(&scene, &fine, &options, 2);
            Shader::new(&scene, &fine, &look, PhotoLook::new(&asked, &placed), 2).shade(&seen, [160, 120]);
            let cut = PhotoCut::new(&surface, &scene, &view).unwrap();
            assert_eq!(cut.levels(), 13);
            let known: BTreeSet<TileKey> = cut.tiles.iter().map(|tile| tile.key).collect();
            let asked = asked.keys.into_inner().unwrap();
            let missed = asked.difference(&known).count();
            println!("{world}: {} of {} tiles, {missed} missed", known.len(), asked.len());
            assert!(50 * missed <= asked.len(), "{missed} of {}", asked.len());
            assert!(known.len() <= 8 * asked.len() + 100, "{} for {}", known.len(), asked.len());
        }
    }
}

#[test]
fn the_finest_levels_are_left_out_where_there_is_no_room() {
    let covered = Covered::new([65, 65], [1024, 1024], |_, _| 0.0);
    let (surface, _folder) = covered.surface();
    let sight = from_above([32.0, 32.0], 64.0, [1024, 1024]);
    let (attribute, transfer) = (Attribute::Photo, TransferFunction::default());
    let look = Look { attribute, transfer, range: [0.0, 1.0], light: Light::Eye, ambient: 1.0, contours: None };
    let options = SurfaceOptions { samples: 1, look: Some(look), ..SurfaceOptions::default() };
    let scene = picture::scene(&surface, &covered.placed(), &sight, &options);
    let Sight::Flat(view) = sight else { panic!("a flat picture") };
    let cut = PhotoCut::new(&surface, &scene, &view).unwrap();
    // 16, 4 and 1 tiles, and 8 levels above.
    assert_eq!((cut.tiles.len(), cut.levels(), cut.above.texels.len()), (21, 11, 21_845));
    for (most, expected) in [(21, 21), (20, 5), (5, 5), (4, 1), (1, 1), (0, 0)] {
        assert_eq!(cut.within(most).len(), expected, "{most}");
    }
}
