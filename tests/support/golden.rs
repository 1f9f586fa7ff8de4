//! Golden images and what is near enough to them.

use super::in_repository;
use deepfield::color::composite::Image;
use deepfield::color::output::write_png;
use std::path::Path;

/// Mean difference of colour channels that is still the same picture, in 1/255. A changed kernel or transfer function
/// gives several times as much: see the last test.
pub const TOLERANCE: f64 = 0.15;

/// Mean absolute difference of the colour channels.
pub fn difference(a: &Image, b: &Image) -> f64 {
    assert_eq!((a.width, a.height), (b.width, b.height));
    let sum: u64 =
        a.rgba.as_flattened().iter().zip(b.rgba.as_flattened()).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
    sum as f64 / (3 * a.rgba.len()) as f64
}

/// A golden image.
pub fn golden(name: &str) -> Image {
    picture_at(&in_repository("tests/golden").join(name))
}

/// A picture in a file.
pub fn picture_at(path: &Path) -> Image {
    let decoder = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(path).unwrap()));
    let mut reader = decoder.read_info().unwrap();
    let mut rgba = vec![[0u8; 4]; (reader.info().width * reader.info().height) as usize];
    let info = reader.next_frame(rgba.as_flattened_mut()).unwrap();
    Image { width: info.width, height: info.height, rgba }
}

/// Compares a picture with its golden image, which `DEEPFIELD_BLESS=1` writes anew.
pub fn check(name: &str, image: &Image) {
    if std::env::var_os("DEEPFIELD_BLESS").is_some() {
        write_png(&in_repository("tests/golden").join(format!("{name}.png")), image).unwrap();
    }
    check_against(name, image);
}

/// Compares a picture with its mode's golden image, whoever drew it.
pub fn check_against(mode: &str, image: &Image) {
    let name = format!("{mode}.png");
    let found = difference(image, &golden(&name));
    if found > TOLERANCE {
        let seen = std::env::temp_dir().join(format!("deepfield-golden-{name}"));
        write_png(&seen, image).unwrap();
        panic!(
            "{name} differs by {found:.3}/255 a channel, tolerance {TOLERANCE}; the new picture is {}",
            seen.display()
        );
    }
}
