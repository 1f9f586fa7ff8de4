//! Pictures in pieces are those of all chunks at once to the bit, within the room that there is.

use super::super::look::{Attribute, Contours, Light};
use super::super::paged::PagedSurface;
use super::super::picture::draw;
use super::super::placed::Map;
use super::super::tests::hills;
use super::*;
use crate::color::TransferFunction;
use crate::view::Projection;
use deepfield_data::model::ReadMethod;
use deepfield_heights::build::{HeightBuildOptions, HeightOrigin, build_heights};
use deepfield_heights::store::HeightFile;
use glam::DVec3;
use std::sync::Arc;

const ROWS: usize = 1400;
const COLUMNS: usize = 1170;
const ROOM: u64 = 12 << 20;
const SIZE: [u32; 2] = [200, 150];

#[test]
fn pieces_are_the_whole_to_the_bit_within_the_room() {
    let mut field = hills(ROWS, COLUMNS, 0.0, 3);
    for (index, height) in field.stored.iter_mut().enumerate() {
        let (row, column) = (index / COLUMNS, index % COLUMNS);
        // What is flat is drawn by coarse chunks, which fine ones are laid upon.
        if (200..1100).contains(&row) && (100..1100).contains(&column) {
            *height = 7.0;
        }
        if (row as f64 - 1150.0).hypot(column as f64 - 500.0) < 60.0 {
            *height = f64::NAN;
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("field.df");
    build_heights(&field, &HeightOrigin::default(), &HeightBuildOptions::default(), &path, &()).unwrap();
    let surface =
        |budget: u64| PagedSurface::new(Arc::new(HeightFile::open(&path, ReadMethod::default()).unwrap()), budget);
    let placed = Placed::new(&field.grid, Map::Plate, 1.0, 0.0);
    let look = Look {
        attribute: Attribute::Slope,
        transfer: TransferFunction::default(),
        range: [0.0, 60.0],
        light: Light::Sun { azimuth: 315.0, altitude: 45.0 },
        ambient: 0.25,
        contours: Some(Contours { interval: 20.0, base: 3.0, major: 5, width: 1.2, color: [0.0; 3], labels: None }),
    };
    let middle = DVec3::new(585.0, 700.0, 0.0);
    let views = [
        (DVec3::new(0.0, 1.0, 3000.0), Projection::Orthographic { height: 1500.0 }),
        (DVec3::new(200.0, -900.0, 500.0), Projection::Perspective { fov_y: 0.8 }),
    ];
    for (number, (away, projection)) in views.into_iter().enumerate() {
        let view = View::look_at(middle + away, middle, DVec3::Z, projection, SIZE[0], SIZE[1]).unwrap();
        let sight = Sight::Flat(view);
        // Lines, for which pieces look further around, and samples of pixels in the first; raw channels, too, in the second.
        let raw = number == 1;
        let look = Some(Look { contours: look.contours.filter(|_| !raw), ..look.clone() });
        let samples = if raw { 1 } else { 4 };
        let options = SurfaceOptions { tau: 0.0, raw, look, samples, ..SurfaceOptions::default() };
        let (ample, scant) = (surface(1 << 30), surface(ROOM));
        assert!(Pieces::of(&ample, &placed, &sight, &options).is_none(), "view {number}");
        let divided = Pieces::of(&scant, &placed, &sight, &options).unwrap();
        let levels: BTreeSet<u8> = divided.cut.nodes.iter().map(|node| node.key.level).collect();
        assert!(divided.pieces.len() > 1 && levels.len() > 1, "view {number}: {} pieces", divided.pieces.len());
        let pixels: usize = divided.pieces.iter().map(|piece| piece.pixels[0].len() * piece.pixels[1].len()).sum();
        assert_eq!(pixels, 200 * 150);
        let (whole, found) = (draw(&ample, &placed, &sight, &options), draw(&scant, &placed, &sight, &options));
        assert!(whole.colors == found.colors && whole.depth == found.depth, "view {number}");
        let bits = |raw: &[[f64; CHANNELS]]| raw.iter().map(|own| own.map(f64::to_bits)).collect::<Vec<_>>();
        assert!(bits(&whole.raw) == bits(&found.raw), "view {number}");
        let facts = |report: &SurfaceReport| {
            (report.error_px, report.is_converged, report.nodes_drawn, report.levels, report.covered)
        };
        assert_eq!(facts(&whole.report), facts(&found.report));
        assert!(whole.report.is_converged && whole.report.covered > 4_000.0);
        assert!(scant.held_bytes() <= ROOM);
    }
    // What may be wrong by a part of a pixel has fewer chunks, and all of the room.
    let view = View::look_at(middle + views[0].0, middle, DVec3::Z, views[0].1, SIZE[0], SIZE[1]).unwrap();
    let options = SurfaceOptions { look: Some(look), ..SurfaceOptions::default() };
    assert!(Pieces::of(&surface(ROOM), &placed, &Sight::Flat(view), &options).is_none());
}
