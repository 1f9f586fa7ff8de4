#![allow(clippy::unwrap_used, reason = "a failed helper fails its test")]

use crate::import::tests::hostile::hostile;
use crate::import::tests::{file_of, heights, open, refusal, same};
use crate::import::{HeightOptions, height_format, open_heights, summarize_heights};
use crate::model::{Heights, Window};
use deepfield_data::model::SampleType;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use proptest::prelude::*;
use std::io::Write;
use std::path::PathBuf;

/// A file that is written for tests.
#[derive(Clone, Debug)]
struct Written {
    is_big_endian: bool,
    is_big: bool,
    /// Columns and rows of tiles, else rows of strips.
    tile: Option<[usize; 2]>,
    strip: usize,
    /// 1, 8, 32773, 50000 or 34887.
    compression: u16,
    /// What packs LERC once more: 0, 1 or 2.
    outer: u16,
    predictor: u16,
    kind: SampleType,
    size: [usize; 2],
    values: Vec<f64>,
    /// Further entries: number, type, values' bytes in the file's order are made of these.
    doubles: Vec<(u16, Vec<f64>)>,
    shorts: Vec<(u16, Vec<u16>)>,
    texts: Vec<(u16, &'static str)>,
}

impl Written {
    fn new(kind: SampleType, size: [usize; 2], values: Vec<f64>) -> Written {
        Written {
            is_big_endian: false,
            is_big: false,
            tile: None,
            strip: 5,
            compression: 1,
            outer: 0,
            predictor: 1,
            kind,
            size,
            values,
            doubles: Vec::new(),
            shorts: Vec::new(),
            texts: Vec::new(),
        }
    }

    fn number(&self, value: u64, bytes: usize) -> Vec<u8> {
        let mut all = value.to_le_bytes()[..bytes].to_vec();
        if self.is_big_endian {
            all.reverse();
        }
        all
    }

    /// A sample's bytes, the least significant first.
    fn sample(&self, value: f64) -> Vec<u8> {
        match self.kind {
            SampleType::F32 => (value as f32).to_le_bytes().to_vec(),
            SampleType::F64 => value.to_le_bytes().to_vec(),
            kind => (value as i64).to_le_bytes()[..kind.size()].to_vec(),
        }
    }

    fn chunk(&self, [left, top]: [usize; 2], [wide, high]: [usize; 2]) -> Vec<u8> {
        let size = self.kind.size();
        let mut out = Vec::new();
        for row in top..top + high {
            // What is beyond the image is anything.
            let is_in = |column: usize| row < self.size[1] && column < self.size[0];
            let at = |column: usize| if is_in(column) { self.values[row * self.size[0] + column] } else { 77.0 };
            let mut samples: Vec<Vec<u8>> = (left..left + wide).map(|column| self.sample(at(column))).collect();
            match self.predictor {
                2 => {
                    let number =
                        |bytes: &Vec<u8>| bytes.iter().rev().fold(0_u64, |all, byte| all << 8 | u64::from(*byte));
                    let numbers: Vec<u64> = samples.iter().map(number).collect();
                    for column in (1..wide).rev() {
                        samples[column] =
                            numbers[column].wrapping_sub(numbers[column - 1]).to_le_bytes()[..size].to_vec();
                    }
                }
                3 => {
                    let planes: Vec<u8> =
                        (0..size).rev().flat_map(|byte| samples.iter().map(move |sample| sample[byte])).collect();
                    out.push(planes[0]);
                    out.extend(planes.windows(2).map(|two| two[1].wrapping_sub(two[0])));
                    continue;
                }
                _ => {}
            }
            for mut sample in samples {
                if self.is_big_endian && self.compression != 34887 {
                    sample.reverse();
                }
                out.append(&mut sample);
            }
        }
        let deflated = |bytes: &[u8]| {
            let mut packer = ZlibEncoder::new(Vec::new(), Compression::fast());
            packer.write_all(bytes).unwrap();
            packer.finish().unwrap()
        };
        let folded = |bytes: &[u8]| zstd::encode_all(bytes, 1).unwrap();
        match self.compression {
            8 => deflated(&out),
            50000 => folded(&out),
            34887 => {
                let blob = super::lerc::tests::plain(wide, high, self.kind, &out);
                [|blob: &[u8]| blob.to_vec(), deflated, folded][usize::from(self.outer)](&blob)
            }
            32773 => {
                let mut packed = Vec::new();
                let mut rest = &out[..];
                while let Some(first) = rest.first() {
                    let run = rest.iter().take(128).take_while(|byte| *byte == first).count();
                    if run > 2 {
                        packed.extend([(1 - run as i32) as u8, *first]);
                        rest = &rest[run..];
                    } else {
                        let count = rest.len().min(3);
                        packed.push(count as u8 - 1);
                        packed.extend_from_slice(&rest[..count]);
                        packed.push(128);
                        rest = &rest[count..];
                    }
                }
                packed
            }
            _ => out,
        }
    }

    fn bytes(&self) -> Vec<u8> {
        let [columns, rows] = self.size;
        let chunk = self.tile.unwrap_or([columns, self.strip]);
        let mut file = if self.is_big_endian { b"MM".to_vec() } else { b"II".to_vec() };
        file.extend(self.number(if self.is_big { 43 } else { 42 }, 2));
        if self.is_big {
            file.extend([self.number(8, 2), self.number(0, 2)].concat());
        }
        let link = file.len();
        let offset = if self.is_big { 8 } else { 4 };
        file.extend(vec![0; offset]);
        let (mut offsets, mut counts) = (Vec::new(), Vec::new());
        for top in (0..rows).step_by(chunk[1]) {
            for left in (0..columns).step_by(chunk[0]) {
                let high = if self.tile.is_some() { chunk[1] } else { chunk[1].min(rows - top) };
                let chunk = self.chunk([left, top], [chunk[0], high]);
                offsets.push(file.len() as u64);
                counts.push(chunk.len() as u64);
                file.extend(chunk);
                // Chunks need not follow each other.
                file.extend(vec![0; if self.tile.is_some() { 3 } else { 0 }]);
            }
        }
        let format = match self.kind {
            SampleType::F32 | SampleType::F64 => 3,
            kind if kind.name().starts_with('i') => 2,
            _ => 1,
        };
        // Number, type, and the bytes of values.
        let mut entries: Vec<(u16, u16, Vec<Vec<u8>>)> = Vec::new();
        let mut whole = |tag: u16, values: &[u64], bytes: usize| {
            let kind = match bytes {
                2 => 3,
                4 => 4,
                _ => 16,
            };
            entries.push((tag, kind, values.iter().map(|value| self.number(*value, bytes)).collect()));
        };
        whole(256, &[columns as u64], 4);
        whole(257, &[rows as u64], 2);
        whole(258, &[self.kind.size() as u64 * 8], 2);
        whole(259, &[self.compression.into()], 2);
        whole(262, &[1], 2);
        whole(277, &[1], 2);
        whole(317, &[self.predictor.into()], 2);
        whole(339, &[format], 2);
        if self.compression == 34887 {
            whole(50674, &[4, self.outer.into()], 4);
        }
        if self.tile.is_some() {
            whole(322, &[chunk[0] as u64], 2);
            whole(323, &[chunk[1] as u64], 2);
        } else {
            whole(278, &[chunk[1] as u64], 4);
        }
        whole(if self.tile.is_some() { 324 } else { 273 }, &offsets, offset);
        whole(if self.tile.is_some() { 325 } else { 279 }, &counts, 4);
        for (tag, values) in &self.shorts {
            whole(*tag, &values.iter().map(|value| u64::from(*value)).collect::<Vec<_>>(), 2);
        }
        for (tag, values) in &self.doubles {
            entries.push((*tag, 12, values.iter().map(|value| self.number(value.to_bits(), 8)).collect()));
        }
        for (tag, text) in &self.texts {
            entries.push((*tag, 2, text.bytes().chain([0]).map(|byte| vec![byte]).collect()));
        }
        // The last entry of a number counts.
        entries.reverse();
        entries.sort_by_key(|(tag, ..)| *tag);
        entries.dedup_by_key(|(tag, ..)| *tag);
        let start = file.len();
        file[link..link + offset].copy_from_slice(&self.number(start as u64, offset));
        file.extend(self.number(entries.len() as u64, if self.is_big { 8 } else { 2 }));
        let mut behind = start + if self.is_big { 8 + 20 * entries.len() + 8 } else { 2 + 12 * entries.len() + 4 };
        let mut rest = Vec::new();
        for (tag, kind, values) in entries {
            file.extend(
                [self.number(tag.into(), 2), self.number(kind.into(), 2), self.number(values.len() as u64, offset)]
                    .concat(),
            );
            let mut bytes = values.concat();
            if bytes.len() > offset {
                file.extend(self.number(behind as u64, offset));
                behind += bytes.len();
                rest.append(&mut bytes);
            } else {
                bytes.resize(offset, 0);
                file.append(&mut bytes);
            }
        }
        file.extend(vec![0; offset]);
        file.append(&mut rest);
        file
    }
}

/// Values that a type holds.
fn values(kind: SampleType, count: usize, seed: u64) -> Vec<f64> {
    let mut state = seed | 1;
    (0..count)
        .map(|place| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let bits = (state >> 33) as u32;
            match kind {
                SampleType::I8 => f64::from(bits as i8),
                SampleType::U8 => f64::from(bits as u8),
                SampleType::I16 => f64::from(bits as i16),
                SampleType::U16 => f64::from(bits as u16),
                SampleType::I32 => f64::from(bits as i32),
                SampleType::U32 => f64::from(bits),
                // Runs of equal bytes, too.
                SampleType::F32 => f64::from(if place % 7 < 4 { 1.5 } else { bits as f32 / 1000.0 }),
                _ => (place / 5) as f64 + if place % 3 == 0 { 0.125 } else { 0.0 },
            }
        })
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]
    /// Every window of every kind of file is what was written.
    #[test]
    fn files_of_every_kind_are_read(
        is_big_endian: bool, is_big: bool, is_tiled: bool, compression in 0_usize..5, outer in 0_u16..3, predictor in 1_u16..4, kind in 0_usize..10,
        columns in 2_usize..60, rows in 2_usize..60, tile in (1_usize..40, 1_usize..40), at in (0.0..1.0, 0.0..1.0, 0.0..1.0, 0.0..1.0), seed: u64,
    ) {
        let kind = SampleType::ALL[kind];
        let kind = if matches!(kind, SampleType::I64 | SampleType::U64) { SampleType::F64 } else { kind };
        let values = values(kind, columns * rows, seed);
        let written = Written {
            is_big_endian,
            is_big,
            tile: is_tiled.then_some([tile.0, tile.1]),
            strip: tile.1.min(rows),
            compression: [1, 8, 32773, 50000, 34887][compression],
            outer,
            predictor: match predictor {
                _ if compression == 4 => 1,
                3 if !kind.is_float() => 2,
                predictor => predictor,
            },
            ..Written::new(kind, [columns, rows], values.clone())
        };
        let (_folder, path) = file_of("a.tif", &written.bytes());
        let source = open_heights(&path, &HeightOptions { is_asked: true, ..HeightOptions::default() }).unwrap_or_else(|error| panic!("{error}"));
        prop_assert_eq!(source.grid().sample_type, kind);
        prop_assert!(same(&heights(&source), &values, 0.0));
        let part = |count: usize, at: f64, size: f64| {
            let first = (count as f64 * at) as u64;
            (first, 1 + ((count as u64 - first - 1) as f64 * size) as u64)
        };
        let ((row, high), (column, wide)) = (part(rows, at.0, at.1), part(columns, at.2, at.3));
        for _ in 0..2 {
            let mut out = vec![0.0; (high * wide) as usize];
            source.heights(Window { row, column, rows: high, columns: wide }, &mut out).unwrap();
            for (line, row) in out.chunks(wide as usize).zip(row as usize..) {
                prop_assert_eq!(line, &values[row * columns + column as usize..][..wide as usize]);
            }
        }
    }
}

/// Files of another program's writer.
#[test]
fn packed_files_of_another_writer_are_read() {
    use tiff::encoder::compression::DeflateLevel;
    use tiff::encoder::{Compression, Predictor, TiffEncoder, colortype};
    let (columns, rows) = (700_u32, 500_u32);
    // Smooth, so that codes grow long, and noise, so that the table is filled and cleared.
    let at = |place: u32| {
        (place / 3 % 1000) as u16
            ^ if place % 5000 < 2500 { 0 } else { (place.wrapping_mul(2_654_435_761) >> 20) as u16 }
    };
    let numbers: Vec<u16> = (0..columns * rows).map(at).collect();
    let floats: Vec<f32> = numbers.iter().map(|number| f32::from(*number) / 8.0).collect();
    for (name, compression) in [
        ("LZW", Compression::Lzw),
        ("Deflate", Compression::Deflate(DeflateLevel::Balanced)),
        ("PackBits", Compression::Packbits),
        ("none", Compression::Uncompressed),
    ] {
        for predictor in [Predictor::None, Predictor::Horizontal] {
            let mut bytes = std::io::Cursor::new(Vec::new());
            let mut encoder =
                TiffEncoder::new(&mut bytes).unwrap().with_compression(compression).with_predictor(predictor);
            encoder.write_image::<colortype::Gray16>(columns, rows, &numbers).unwrap();
            let (_folder, path) = file_of("a.tif", bytes.get_ref());
            let expected: Vec<f64> = numbers.iter().map(|number| f64::from(*number)).collect();
            assert!(same(&heights(&open(&path)), &expected, 0.0), "{name}");
        }
        let mut bytes = std::io::Cursor::new(Vec::new());
        let mut encoder = TiffEncoder::new_big(&mut bytes).unwrap().with_compression(compression);
        encoder.write_image::<colortype::Gray32Float>(columns, rows, &floats).unwrap();
        let (_folder, path) = file_of("a.tif", bytes.get_ref());
        let expected: Vec<f64> = floats.iter().map(|number| f64::from(*number)).collect();
        let source = open(&path);
        assert!(same(&heights(&source), &expected, 0.0), "{name}");
        assert!(
            !source.description().has_spacing
                && source.description().notes.iter().any(|note| note.contains("--spacing"))
        );
    }
}

#[test]
fn places_units_and_no_data_are_told() {
    let values = vec![1.0, -9999.0, 3.0, 4.0, 5.0, 6.0];
    let plain = Written::new(SampleType::F32, [3, 2], values);
    let read = |written: &Written| {
        let (_folder, path) = file_of("a.tif", &written.bytes());
        open(&path)
    };
    let scale = (33550, vec![0.5, 0.25, 0.0]);
    let tie = (33922, vec![1.0, 0.0, 0.0, 100.0, 50.0, 0.0]);
    let keys = |more: &[[u16; 4]]| {
        vec![(34735, [vec![[1, 1, 0, more.len() as u16]], more.to_vec()].concat().into_flattened())]
    };
    let geographic = [[1024, 0, 1, 2], [1025, 0, 1, 1], [2048, 0, 1, 4326], [4099, 0, 1, 9001]];

    // Areas: the tie is the corner of pixel (1, 0).
    let area = Written {
        doubles: vec![scale.clone(), tie.clone()],
        shorts: keys(&geographic),
        texts: vec![(42113, "-9999 ")],
        ..plain.clone()
    };
    let source = read(&area);
    let grid = source.grid();
    assert_eq!((grid.origin, grid.step), ([99.75, 49.875], [0.5, -0.25]));
    assert_eq!((&*grid.xy_unit.0, &*grid.height_unit.0, grid.crs.as_deref()), ("deg", "m", Some("EPSG:4326")));
    assert!(same(&heights(&source), &[1.0, f64::NAN, 3.0, 4.0, 5.0, 6.0], 0.0));
    // Points: its middle.
    let mut points = geographic;
    points[1][3] = 2;
    let grid = read(&Written { shorts: keys(&points), ..area.clone() }).grid().clone();
    assert_eq!((grid.origin, grid.step), ([99.5, 50.0], [0.5, -0.25]));
    // A matrix without turns, in millimetres of the file's own.
    let matrix =
        |turn: f64| (34264, vec![2.0, turn, 0.0, 10.0, 0.0, 3.0, 0.0, 20.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
    let mut projected = Written {
        doubles: vec![matrix(0.0), (34736, vec![1e-3])],
        shorts: keys(&[
            [1024, 0, 1, 1],
            [1025, 0, 1, 2],
            [3072, 0, 1, 32767],
            [3076, 0, 1, 32767],
            [3077, 34736, 1, 0],
        ]),
        texts: vec![(
            42112,
            "<GDALMetadata><Item name=\"OFFSET\" sample=\"0\" role=\"offset\">100</Item><Item name=\"SCALE\" sample=\"0\" role=\"scale\">0.1</Item>\
             <Item name=\"UNITTYPE\" sample=\"0\" role=\"unittype\">\u{b5}m</Item></GDALMetadata>",
        )],
        ..plain.clone()
    };
    let source = read(&projected);
    let grid = source.grid();
    assert_eq!((grid.origin, grid.step, &*grid.xy_unit.0), ([10.0, 20.0], [2.0, 3.0], "mm"));
    assert_eq!((grid.scale.slope, grid.scale.intercept, grid.crs.clone()), (0.1, 100.0, None));
    projected.doubles[0] = matrix(0.5);
    let text = refusal("a.tif", &projected.bytes(), &HeightOptions::default());
    assert!(text.contains("ModelTransformation: found a rotated"), "{text}");
    // No data of single precision with few digits, and none that is a number.
    for (text, no_data) in [
        ("-3.40282e+38", f64::from(f32::MIN)),
        ("-3.4028234663852886e+38", f64::from(f32::MIN)),
        ("0.1", f64::from(0.1_f32)),
    ] {
        let mut written = Written { texts: vec![(42113, text)], ..plain.clone() };
        written.values[4] = no_data;
        let found = heights(&read(&written));
        assert!(found[4].is_nan() && found.iter().filter(|height| height.is_nan()).count() == 1, "{text}: {found:?}");
    }
    assert!(
        heights(&read(&Written { texts: vec![(42113, "nan")], ..plain.clone() })).iter().all(|height| !height.is_nan())
    );
}

#[test]
fn chunks_that_the_file_leaves_out_have_no_data() {
    let mut written = Written { strip: 1, ..Written::new(SampleType::I16, [3, 3], (1..10).map(f64::from).collect()) };
    written.texts = vec![(42113, "-5")];
    let mut bytes = written.bytes();
    // The size of the second strip, whose list is the last one of LONGs with these values.
    let list: Vec<u8> = [6_u32; 3].iter().flat_map(|size| size.to_le_bytes()).collect();
    let at = bytes.windows(12).position(|part| part == list).unwrap();
    bytes[at + 4] = 0;
    let (_folder, path) = file_of("a.tif", &bytes);
    let none = f64::NAN;
    assert!(same(&heights(&open(&path)), &[1.0, 2.0, 3.0, none, none, none, 7.0, 8.0, 9.0], 0.0));
}

#[test]
fn what_is_not_read_is_named() {
    let plain = Written::new(SampleType::U16, [4, 4], (0..16).map(f64::from).collect());
    let options = HeightOptions::default();
    for (tag, value, expected) in [
        (277, 3, "SamplesPerPixel: found 3"),
        (262, 2, "RGB"),
        (262, 3, "palette"),
        (259, 34925, "LZMA"),
        (259, 50001, "WebP"),
        (317, 3, "Predictor"),
        (339, 5, "complex"),
        (258, 12, "of 12 bits"),
        (257, 0, "ImageLength"),
        (278, 0, "size of a strip"),
    ] {
        let text = refusal("a.tif", &Written { shorts: vec![(tag, vec![value])], ..plain.clone() }.bytes(), &options);
        assert!(text.contains(expected) && text.starts_with("a.tif: ") && text.contains("expected"), "{text}");
    }
    // More than the file can hold, before anything is allocated.
    for (tag, value) in [(257, 60000), (256, 60000)] {
        let text = refusal("a.tif", &Written { shorts: vec![(tag, vec![value])], ..plain.clone() }.bytes(), &options);
        assert!(text.contains("found") && text.contains("expected"), "{text}");
    }
    let packed = Written { compression: 8, shorts: vec![(257, vec![60000]), (278, vec![60000])], ..plain };
    let text = refusal("a.tif", &packed.bytes(), &options);
    assert!(text.contains("at most") && text.contains("4 x 60000"), "{text}");
}

#[test]
fn real_files_are_as_stated() {
    let Some(folder) = std::env::var_os("DEEPFIELD_DATA") else { return };
    let path = PathBuf::from(folder).join("heightfields/elev_luxembourg.tif");
    if !path.is_file() {
        return;
    }
    let source = open(&path);
    let found = summarize_heights(&source).unwrap();
    assert_eq!((found.columns, found.rows, found.valid, found.invalid.no_data), (95, 90, 95 * 90 - 3942, 3942));
    assert_eq!((found.min, found.max), (141.0, 547.0));
    assert!((found.mean - 348.3366).abs() < 1e-4, "{}", found.mean);
    let step = 0.008_333_333_333_333_33;
    assert!((found.spacing[0] - step).abs() < 1e-8 && (found.spacing[1] + step).abs() < 1e-8);
    assert!(
        (found.origin[0] - (5.741_667 + step / 2.0)).abs() < 1e-5
            && (found.origin[1] - (50.19167 - step / 2.0)).abs() < 1e-5
    );
    assert_eq!((found.format.as_str(), &*found.xy_unit.0), ("geotiff", "deg"));
    assert!(height_format(&path).unwrap().unwrap().is_sure);
}

#[test]
fn damage_is_an_answer_or_one_line() {
    let mut whole: Vec<Vec<u8>> = Vec::new();
    for compression in [1, 8, 32773, 50000, 34887] {
        let values = values(SampleType::I16, 40 * 30, 9);
        let written = Written {
            compression,
            predictor: if compression == 34887 { 1 } else { 2 },
            is_big: compression == 8,
            tile: (compression == 8).then_some([16, 16]),
            doubles: vec![(33550, vec![0.5, 0.25, 0.0]), (33922, vec![0.0; 6])],
            texts: vec![(42113, "-5")],
            ..Written::new(SampleType::I16, [40, 30], values)
        };
        whole.push(written.bytes());
    }
    if let Some(folder) = std::env::var_os("DEEPFIELD_DATA") {
        whole.push(std::fs::read(PathBuf::from(folder).join("heightfields/elev_luxembourg.tif")).unwrap());
    }
    let seeds = whole.iter().map(|bytes| {
        // The directory is where the first bytes say, behind the samples or before them.
        let head = &bytes[..16];
        let at = if head[2] == 43 {
            u64::from_le_bytes(head[8..].try_into().unwrap())
        } else {
            u32::from_le_bytes(head[4..8].try_into().unwrap()).into()
        };
        ("hostile.tif", &bytes[..], at as usize..bytes.len().min(at as usize + 1000))
    });
    hostile(&seeds.collect::<Vec<_>>(), true);
}
