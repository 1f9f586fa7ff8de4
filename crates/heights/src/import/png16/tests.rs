#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use crate::import::tests::hostile::hostile;
use crate::import::tests::{file_of, heights, open, refusal, same};
use crate::import::{HeightOptions, height_format, open_heights};
use crate::model::Heights;
use deepfield_data::model::SampleType;
use png::{BitDepth, ColorType};

fn picture(color: ColorType, depth: BitDepth, data: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 5, 4);
    encoder.set_color(color);
    encoder.set_depth(depth);
    encoder.write_header().unwrap().write_image_data(data).unwrap();
    bytes
}

#[test]
fn grey_pictures_are_heights_where_asked_for() {
    let values: Vec<u16> = (0..20).map(|place| place * 3000 + 7).collect();
    let data: Vec<u8> = values.iter().flat_map(|value| value.to_be_bytes()).collect();
    let sixteen = picture(ColorType::Grayscale, BitDepth::Sixteen, &data);
    let (_folder, path) = file_of("a.png", &sixteen);
    let source = open(&path);
    assert_eq!(source.grid().sample_type, SampleType::U16);
    assert!(same(&heights(&source), &values.iter().map(|value| f64::from(*value)).collect::<Vec<_>>(), 0.0));
    assert!(!height_format(&path).unwrap().unwrap().is_sure);

    let eight = picture(ColorType::Grayscale, BitDepth::Eight, &data[..20]);
    let text = refusal("a.png", &eight, &HeightOptions::default());
    assert!(text.contains("--kind heights"), "{text}");
    let (_folder, path) = file_of("a.png", &eight);
    let asked = HeightOptions { is_asked: true, ..HeightOptions::default() };
    let source = open_heights(&path, &asked).unwrap();
    assert!(same(&heights(&source), &data[..20].iter().map(|value| f64::from(*value)).collect::<Vec<_>>(), 0.0));

    let text = refusal("a.png", &picture(ColorType::Rgb, BitDepth::Eight, &[7; 60]), &asked);
    assert!(text.contains("Rgb of 8 bits"), "{text}");
}

#[test]
fn damage_is_an_answer_or_one_line() {
    let sixteen = picture(ColorType::Grayscale, BitDepth::Sixteen, &[7; 40]);
    hostile(&[("hostile.png", &sixteen[..], 0..60)], false);
}
