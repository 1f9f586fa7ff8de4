//! Photos over fields by an adapter's passes.

use super::*;
use covered::{Covered, Pixels};
use deepfield::heights::model::{HeightError, HeightGrid, Heights, PhotoAbout, PhotoPlace, PhotoRows, Window};

#[path = "../../support/covered.rs"]
mod covered;

/// A field under a photo of waves and a little noise, several pixels to a sample, over all of it or somewhere.
fn covered(mut field: HeightField, place: Option<PhotoPlace>) -> Covered {
    (field.planes, field.grid.planes) = (Vec::new(), Vec::new());
    let (rows, columns) = (1100, 1500);
    let mut random = Random(5);
    let values = (0..rows * columns * 3).map(|at| {
        let (x, y) = ((at / 3 % columns) as f64, (at / 3 / columns) as f64);
        let wave = (x / (110.0 + 40.0 * (at % 3) as f64) + (y / 160.0).cos()).sin();
        (128.0 + 105.0 * wave + 12.0 * random.next()) as u8
    });
    let values = values.collect();
    let (place, size) = (place.unwrap_or(PhotoPlace::whole(&field.grid)), [rows as u64, columns as u64]);
    let about = PhotoAbout { path: "p".into(), format: "png".into(), bytes: 0, size, is_grey: false, place };
    Covered { field, photo: Pixels { about, values } }
}

#[test]
fn an_adapter_draws_photos() {
    let folder = tempfile::tempdir().unwrap();
    let part = PhotoPlace { rows: [100.0, 330.0], columns: [-40.0, 420.0] };
    // Over the seam of a globe.
    let beyond = PhotoPlace { rows: [100.0, 430.0], columns: [450.0, 800.0] };
    let all = PhotoPlace { rows: [-0.5, 529.5], columns: [-0.5, 619.5] };
    let near = Wanted { eye: Some([310.0, 200.0, 40.0]), target: Some([500.0, 350.0, -20.0]), ..PLAIN };
    let above_all = Wanted {
        eye: Some([310.0, 265.0, 900.0]),
        target: Some([310.0, 265.5, 0.0]),
        ortho: Some(40.0),
        settings: &[("technique", name("triangles"))],
        ..PLAIN
    };
    let flat = [
        ("far", Wanted { attribute: Some("texture"), ..PLAIN }),
        ("near", Wanted { settings: &[("light", name("eye"))], ..near }),
        ("lines", Wanted { settings: &[("contours", number(8.0))], ..near }),
        ("pixels of the photo", above_all),
    ];
    let target = Some([0.0; 3]);
    let high = [("exaggeration", number(3000.0)), ("light", name("eye"))];
    let round = [
        ("the seam", Wanted { eye: above(180.0, 10.0, 2e7), target, settings: &high, ..PLAIN }),
        ("a pole", Wanted { eye: above(30.0, 88.0, 8e6), target, settings: &high[1..], ..PLAIN }),
    ];
    let fields = [
        ("lakes", covered(hills(SIZE, Holes::Lakes), None), &flat[..], 0.01),
        ("a part", covered(hills(SIZE, Holes::None), Some(part)), &flat[1..2], 0.01),
        ("globe", covered(world(Holes::None), Some(all)), &round[..], 0.01),
        // Its edge is moved by parts of a pixel, as lines are.
        ("a part of a globe", covered(world(Holes::None), Some(beyond)), &round[..1], 0.02),
    ];
    for (field, covered, pictures, most) in &fields {
        let path = built(folder.path(), covered);
        let mut processor = session(&path, Backend::Cpu);
        let expected: Vec<_> = pictures.iter().map(|(_, wanted)| wanted.draw(&mut processor).1).collect();
        // A photo is the same function of what is seen, whatever found that: parts are drawn by one of them.
        let backends = [(Backend::Compute, "compute"), (Backend::Raster, "raster")];
        for (backend, passes) in backends.into_iter().take(pictures.len()) {
            let mut adapter = session(&path, backend);
            for ((what, wanted), expected) in pictures.iter().zip(&expected) {
                let (picture, found) = wanted.draw(&mut adapter);
                assert_eq!(picture.drawn_by[0], passes, "{field}, {what}");
                let (share, mean) = differences(&found, expected);
                println!("{field}, {what}, {passes}: {share:.4} of the pixels beyond 4 of 255, mean {mean:.3}");
                assert!(share <= *most && mean < 1.0, "{field}, {what}, {passes}: {share} {mean}");
                // What is kept draws the same.
                assert!(*what != "near" || wanted.draw(&mut adapter).1 == found, "{field}, {what}, {passes}");
            }
        }
    }
}
