#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use crate::import::tests::{file_of, heights, open, refusal};
use crate::import::{HeightOptions, height_format, summarize_heights};
use crate::model::Heights;

/// A square whose samples are their number, the first two not measured.
fn square(side: usize) -> Vec<u8> {
    let value = |place: usize| if place < 2 { i16::MIN } else { (place % 9000) as i16 };
    (0..side * side).flat_map(|place| value(place).to_be_bytes()).collect()
}

#[test]
fn squares_are_where_their_names_say() {
    for (name, side, origin) in [
        ("N39W106.hgt", 1201_usize, Some([-106.0, 40.0])),
        ("s01e010.hgt", 3601, Some([10.0, 0.0])),
        ("N39W106", 1201, Some([-106.0, 40.0])),
        ("N39W106.SRTMGL1.hgt", 1201, Some([-106.0, 40.0])),
        ("N99W106.hgt", 1201, None),
        ("tile.hgt", 1201, None),
    ] {
        // Samples of the larger one are not looked at.
        let bytes = if side == 1201 { square(side) } else { vec![0; 2 * side * side] };
        let (_folder, path) = file_of(name, &bytes);
        let source = open(&path);
        let grid = source.grid();
        assert_eq!((grid.columns, grid.rows), (side as u64, side as u64));
        assert_eq!(grid.origin, origin.unwrap_or([0.0, 1.0]), "{name}");
        let step = 1.0 / (side - 1) as f64;
        assert_eq!(grid.step, [step, -step]);
        assert_eq!((&*grid.xy_unit.0, &*grid.height_unit.0), ("deg", "m"));
        assert_eq!(origin.is_none(), source.description().notes.iter().any(|note| note.contains("name")), "{name}");
        if side == 1201 {
            let values = heights(&source);
            assert!(values[0].is_nan() && values[1].is_nan() && values[2] == 2.0 && values[8999] == 8999.0);
            assert_eq!(summarize_heights(&source).unwrap().invalid.no_data, 2);
        }
    }
    // Nothing but the exact sizes, and no other files of such a size.
    let text = refusal("N39W106.hgt", &square(1200), &HeightOptions::default());
    assert!(text.contains("2880000 bytes") && text.contains("2884802") && text.contains("25934402"), "{text}");
    let (_folder, path) = file_of("other", &square(1201));
    assert_eq!(height_format(&path).unwrap(), None);
}
