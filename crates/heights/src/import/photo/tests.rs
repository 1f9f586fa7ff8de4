//! Pictures of all kinds, laid over fields and maps.

use super::*;
use crate::export::{ExportOptions, export_heights};
use crate::model::{HeightField, Window};
use deepfield_data::model::Unit;

fn png(path: &Path, size: [u32; 2], color: png::ColorType, depth: png::BitDepth, values: &[u8]) {
    let mut encoder = png::Encoder::new(std::fs::File::create(path).unwrap(), size[0], size[1]);
    encoder.set_color(color);
    encoder.set_depth(depth);
    encoder.write_header().unwrap().write_image_data(values).unwrap();
}

fn grid() -> HeightGrid {
    HeightGrid::new(11, 21, SampleType::F32)
}

fn opened(path: &Path, rectangle: Option<[f64; 4]>, grid: &HeightGrid) -> Result<Photo, String> {
    let choice = PhotoChoice { path: path.into(), rectangle };
    Photo::open(&choice, grid, ReadMethod::default()).map_err(|error| error.to_string())
}

/// All pixels, read a row at a time.
fn pixels(photo: &Photo) -> Vec<u8> {
    let [rows, columns] = photo.about().size;
    let width = columns as usize * photo.about().planes();
    let mut out = vec![0; rows as usize * width];
    out.chunks_exact_mut(width).enumerate().for_each(|(row, out)| photo.rows(row as u64, 1, out).unwrap());
    let mut whole = vec![0; out.len()];
    photo.rows(0, rows, &mut whole).unwrap();
    assert_eq!(whole, out);
    out
}

#[test]
fn pictures_run_as_the_field_and_on_maps_have_north_at_the_top() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a@b.png");
    png(&path, [2, 3], png::ColorType::Rgb, png::BitDepth::Eight, &(0..18).collect::<Vec<u8>>());
    let photo = opened(&path, None, &grid()).unwrap();
    let about = photo.about();
    assert_eq!((about.size, about.is_grey, &*about.format), ([3, 2], false, "png"));
    assert_eq!(about.place, PhotoPlace { rows: [0.0, 20.0], columns: [0.0, 10.0] });
    assert_eq!(pixels(&photo), (0..18).collect::<Vec<u8>>());
    // Rows of a map that go from south to north, and columns from east to west.
    let turned = [15, 16, 17, 12, 13, 14, 9, 10, 11, 6, 7, 8, 3, 4, 5, 0, 1, 2];
    let map = HeightGrid { step: [-1.0, 1.0], xy_unit: Unit::new("deg"), ..grid() };
    assert_eq!(pixels(&opened(&path, None, &map).unwrap()), turned);
    let map = HeightGrid { step: [-1.0, 1.0], crs: Some("EPSG:32632".into()), ..grid() };
    assert_eq!(pixels(&opened(&path, None, &map).unwrap()), turned);
    let map = HeightGrid { step: [1.0, -1.0], ..map };
    assert_eq!(pixels(&opened(&path, None, &map).unwrap()), (0..18).collect::<Vec<u8>>());
}

#[test]
fn values_have_8_bits_and_no_photo_shows_through() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    let deep: Vec<u8> = [0_u16, 257, 65535, 32896].iter().flat_map(|value| value.to_be_bytes()).collect();
    png(&path, [2, 2], png::ColorType::Grayscale, png::BitDepth::Sixteen, &deep);
    let photo = opened(&path, None, &grid()).unwrap();
    assert_eq!((pixels(&photo), photo.about().is_grey), (vec![0, 1, 255, 128], true));
    let values = [9, 255, 9, 0, 200, 255, 255, 128];
    png(&path, [4, 1], png::ColorType::GrayscaleAlpha, png::BitDepth::Eight, &values);
    let found = pixels(&opened(&path, None, &grid()).unwrap());
    // Half of white and half of half the light is three quarters of it.
    assert_eq!(found, vec![9, light::NO_PHOTO, 200, light::value(0.7523 * f64::from(light::FULL))]);
}

#[test]
fn places_are_two_corners() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    png(&path, [1, 1], png::ColorType::Grayscale, png::BitDepth::Eight, &[7]);
    let field = HeightGrid { origin: [100.0, 50.0], step: [2.0, -5.0], ..grid() };
    let place = |rectangle| opened(&path, Some(rectangle), &field).map(|photo| photo.about().place);
    let expected = PhotoPlace { rows: [-1.0, 4.0], columns: [1.0, 20.0] };
    assert_eq!(place([102.0, 30.0, 140.0, 55.0]).unwrap(), expected);
    assert_eq!(place([140.0, 55.0, 102.0, 30.0]).unwrap(), expected);
    for wrong in [[121.0, 0.0, 130.0, 10.0], [100.0, 51.0, 110.0, 60.0], [100.0; 4], [f64::NAN, 0.0, 110.0, 10.0]] {
        let error = place(wrong).unwrap_err();
        let expected = "expected one with an area and a part in the field from 100, 50 to 120, -50";
        assert!(error.contains("--texture: found a rectangle from ") && error.ends_with(expected), "{error}");
    }
    // Degrees come round.
    let globe = HeightGrid { origin: [350.0, 10.0], step: [2.0, -1.0], xy_unit: Unit::new("deg"), ..grid() };
    assert!(opened(&path, Some([-5.0, 0.0, 5.0, 10.0]), &globe).is_ok());
    assert!(opened(&path, Some([15.0, 0.0, 25.0, 10.0]), &globe).is_err());
}

#[test]
fn photos_are_turned_as_the_camera_was_held() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.png");
    // Three columns, two rows.
    png(&path, [3, 2], png::ColorType::Grayscale, png::BitDepth::Eight, &[0, 1, 2, 3, 4, 5]);
    let expected: [&[u8]; 8] = [
        &[0, 1, 2, 3, 4, 5],
        &[2, 1, 0, 5, 4, 3],
        &[5, 4, 3, 2, 1, 0],
        &[3, 4, 5, 0, 1, 2],
        &[0, 3, 1, 4, 2, 5],
        &[3, 0, 4, 1, 5, 2],
        &[5, 2, 4, 1, 3, 0],
        &[2, 5, 1, 4, 0, 3],
    ];
    for (number, expected) in (1..).zip(expected) {
        let own = folder.path().join("head.jpg");
        std::fs::write(&own, orientation::tests::head(number, number % 2 == 0)).unwrap();
        let Orientation { is_transposed, is_turned } = Orientation::of_file(&own);
        let mut photo = opened(&path, None, &grid()).unwrap();
        (photo.is_transposed, photo.is_turned) = (is_transposed, is_turned);
        photo.about.size = if is_transposed { [3, 2] } else { [2, 3] };
        assert_eq!(pixels(&photo), expected, "{number}");
    }
    assert_eq!(Orientation::of_file(&path), Orientation::default());
    assert_eq!(Orientation::of_file(&folder.path().join("none.jpg")), Orientation::default());
}

#[test]
fn a_geotiff_lies_where_it_says() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ortho.tif");
    let utm = |grid: HeightGrid| HeightGrid { crs: Some("EPSG:32632".into()), xy_unit: Unit::new("m"), ..grid };
    // Four columns and three rows of half a metre, from north to south.
    let plain = HeightGrid { origin: [103.25, 47.75], step: [0.5, -0.5], ..HeightGrid::new(4, 3, SampleType::U8) };
    let stored: Vec<f64> = (0..12).map(f64::from).collect();
    let write = |grid: HeightGrid| {
        let field = HeightField { grid, stored: stored.clone(), planes: Vec::new() };
        let all = Window::all(&field.grid);
        export_heights(&field, all, &path, &ExportOptions { all_valid: Some(true) }, &()).unwrap();
    };
    write(utm(plain.clone()));
    let field = utm(HeightGrid { origin: [100.0, 50.0], step: [1.0, -1.0], ..grid() });
    let photo = opened(&path, None, &field).unwrap();
    // Its edges are half of its own pixels beside the middles of the outer ones.
    assert_eq!(photo.about().place, PhotoPlace { rows: [2.0, 3.5], columns: [3.0, 5.0] });
    assert_eq!(pixels(&photo), (0..12).collect::<Vec<u8>>());
    // The field's rows go from south to north, and its lengths are others.
    let other = HeightGrid { origin: [0.1, 0.03], step: [1e-3, 1e-3], xy_unit: Unit::new("km"), ..field.clone() };
    let photo = opened(&path, None, &other).unwrap();
    let PhotoPlace { rows, columns } = photo.about().place;
    for (found, expected) in rows.iter().chain(&columns).zip([16.5, 18.0, 3.0, 5.0]) {
        assert!((found - expected).abs() < 1e-9, "{rows:?} {columns:?}");
    }
    assert_eq!(pixels(&photo)[..4], [8, 9, 10, 11]);
    // Where it is said it lies there, and over a field that is no map all of it.
    assert_eq!(
        opened(&path, Some([100.0, 30.0, 110.0, 50.0]), &field).unwrap().about().place,
        PhotoPlace { rows: [0.0, 20.0], columns: [0.0, 10.0] }
    );
    assert_eq!(opened(&path, None, &grid()).unwrap().about().place, PhotoPlace::whole(&grid()));
    let degrees = HeightGrid { crs: Some("EPSG:4326".into()), xy_unit: Unit::new("deg"), ..field.clone() };
    let error = opened(&path, None, &degrees).unwrap_err();
    assert!(error.contains("--texture: found EPSG:32632, expected EPSG:4326, or the photo's edges"), "{error}");
    let far = HeightGrid { origin: [500.0, 50.0], ..field };
    assert!(opened(&path, None, &far).unwrap_err().contains("--texture: found a rectangle from 103, 48 to 105, 46.5"));
}

#[test]
fn what_is_no_photo_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let error = opened(&at("none.png"), None, &grid()).unwrap_err();
    assert!(error.contains("none.png") && !error.contains('\n'), "{error}");
    let mut array = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
    array.extend_from_slice(b"{'descr': '<f4', 'fortran_order': False, 'shape': (2, 2), }");
    array.resize(128, b' ');
    array.extend_from_slice(&[0; 16]);
    std::fs::write(at("a.npy"), array).unwrap();
    let error = opened(&at("a.npy"), None, &grid()).unwrap_err();
    assert!(error.contains("--texture: found image, 2 x 2 of float32, expected a picture of 8 or 16 bits"), "{error}");
    std::fs::write(at("a.jpg"), b"\xff\xd8\xff\xe0broken").unwrap();
    let error = opened(&at("a.jpg"), None, &grid()).unwrap_err();
    assert!(error.contains("a.jpg") && !error.contains('\n'), "{error}");
}

#[test]
fn files_may_have_the_sign_of_places_in_their_names() {
    let plain = |text: &str| PhotoChoice::parse(text).map(|choice| (choice.path, choice.rectangle));
    assert_eq!(plain("a.jpg"), Ok(("a.jpg".into(), None)));
    assert_eq!(plain("a@2x.png@-1,2,3.5,-4e1"), Ok(("a@2x.png".into(), Some([-1.0, 2.0, 3.5, -40.0]))));
    for wrong in ["a.jpg@1,2,3", "a.jpg@1,2,3,x", "a.jpg@1,2,3,4,5", "@1,2,3,4", "a.jpg@"] {
        assert!(plain(wrong).unwrap_err().ends_with("expected X0,Y0,X1,Y1"), "{wrong}");
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a@b.png");
    std::fs::write(&path, "").unwrap();
    assert_eq!(plain(&path.display().to_string()), Ok((path, None)));
}
