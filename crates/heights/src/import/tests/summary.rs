//! What `info` says of samples in memory.

use super::super::content::Content;
use super::super::in_memory::InMemory;
use super::super::source::MASKED;
use super::super::{HeightDescription, HeightOptions, HeightSource, HeightSummary, NoData, summarize_heights};
use super::file_of;
use crate::OpenHeights;
use crate::build::{HeightBuildOptions, HeightOrigin, build_heights};
use crate::model::{Cell, HeightGrid};
use deepfield_data::model::{SampleType, Scale};
use proptest::prelude::*;

/// A source of these samples.
fn source(columns: u64, samples: Vec<f64>, no_data: NoData, scale: Scale) -> HeightSource {
    let (_folder, path) = file_of("a.raw", b"");
    let content = Content::open(&path, &HeightOptions::default()).unwrap();
    let mut grid = HeightGrid::new(columns, samples.len() as u64 / columns, SampleType::F64);
    grid.scale = scale;
    let about = HeightDescription::new(&content, "raw", grid);
    HeightSource::new(about, Box::new(InMemory::new(columns, samples)), no_data)
}

fn summary(columns: u64, samples: Vec<f64>, no_data: NoData) -> HeightSummary {
    summarize_heights(&source(columns, samples, no_data, Scale::NONE)).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]
    #[test]
    fn counts_are_those_of_every_sample_and_cell(
        columns in 2_usize..7,
        rows in 2_usize..40,
        kinds in prop::collection::vec(0_u8..12, 280),
        slope in 0.5_f64..2.0,
    ) {
        let stored: Vec<f64> = kinds[..columns * rows].iter().enumerate().map(|(index, kind)| match kind {
            0 => f64::NAN,
            1 => f64::INFINITY,
            2 | 3 => -1.0,
            4 => MASKED,
            _ => index as f64 * 0.37,
        }).collect();
        let heights: Vec<f64> = stored.iter().map(|value| if value.is_finite() && *value != -1.0 { slope.mul_add(*value, 3.0) } else { f64::NAN }).collect();
        let scale = Scale { slope, intercept: 3.0 };
        let found = summarize_heights(&source(columns as u64, stored.clone(), NoData::Value(-1.0), scale));
        let valid: Vec<f64> = heights.iter().copied().filter(|height| !height.is_nan()).collect();
        let Ok(found) = found else {
            prop_assert!(valid.is_empty());
            return Ok(());
        };
        let kinds = kinds_of(&stored);
        let count = |of: u8| kinds.iter().filter(|kind| **kind == of).count() as u64;
        prop_assert_eq!((found.invalid.nan, found.invalid.infinite, found.invalid.no_data), (count(0), count(1), count(2)));
        prop_assert_eq!(found.valid, valid.len() as u64);
        prop_assert_eq!(found.min, valid.iter().copied().fold(f64::INFINITY, f64::min));
        prop_assert_eq!(found.max, valid.iter().copied().fold(f64::NEG_INFINITY, f64::max));
        prop_assert!((found.mean - valid.iter().sum::<f64>() / valid.len() as f64).abs() <= 1e-12 * found.max.abs());
        let mut used = vec![false; stored.len()];
        for row in 0..rows - 1 {
            for column in 0..columns - 1 {
                let first = row * columns + column;
                let corners = [first, first + 1, first + columns, first + columns + 1];
                for triangle in Cell(corners.map(|at| heights[at])).triangles() {
                    triangle.corners.iter().for_each(|corner| used[corners[*corner]] = true);
                }
            }
        }
        let lone = heights.iter().zip(&used).filter(|(height, used)| !height.is_nan() && !**used).count();
        prop_assert_eq!(found.lone, lone as u64);
    }
}

/// 0 for NaN, 1 for infinite, 2 for no data, 3 for others.
fn kinds_of(stored: &[f64]) -> Vec<u8> {
    let kind = |value: &f64| match *value {
        value if value.to_bits() == MASKED.to_bits() || value == -1.0 => 2,
        value if value.is_nan() => 0,
        value if value.is_infinite() => 1,
        _ => 3,
    };
    stored.iter().map(kind).collect()
}

#[test]
fn many_bands_are_as_one() {
    let (columns, rows) = (1000_u32, 3000_u32);
    let samples: Vec<f64> = (0..columns * rows)
        .map(|index| if index % 2 == (index / columns) % 2 { f64::NAN } else { f64::from(index % 1013) })
        .collect();
    let source = source(u64::from(columns), samples, NoData::Nothing, Scale::NONE);
    let whole = summarize_heights(&source).unwrap();
    assert_eq!((whole.valid, whole.lone, whole.invalid.nan), (1_500_000, 1_500_000, 1_500_000));
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(alone.install(|| summarize_heights(&source).unwrap()), whole);
}

#[test]
fn values_that_look_like_no_data_are_noted() {
    let with = |value: f64, every: usize| -> Vec<f64> {
        (0..10_000).map(|index| if index % every == 5 { value } else { (index % 100) as f64 }).collect()
    };
    for (value, shown) in [
        (-9999.0, "-9999"),
        (1e30, "1e30"),
        (-32768.0, "-32768"),
        (-3.402_823_466_385_288_6e38, "-3.4028234663852886e38"),
    ] {
        let found = summary(100, with(value, 99), NoData::Nothing);
        let expected = format!(
            "101 of 10000 samples are {shown}, far from all others, and count as heights: --nodata {shown} declares them as not measured"
        );
        assert_eq!(found.notes, [expected]);
        assert_eq!(found.valid, 10_000);
        // A page file keeps it, whatever is read at once, and one that is built from that tells it once.
        let source = source(100, with(value, 99), NoData::Nothing, Scale::NONE);
        let folder = tempfile::tempdir().unwrap();
        for memory in [None, Some(64 << 20)] {
            let (first, second) = (folder.path().join("a.df"), folder.path().join("b.df"));
            let options = HeightBuildOptions { memory, ..HeightBuildOptions::default() };
            let about = build_heights(&source, &HeightOrigin::of(&source), &options, &first, &()).unwrap();
            assert_eq!(about.notes.last(), found.notes.first());
            let open = OpenHeights::open(&first, &HeightOptions::default()).unwrap();
            let again = open.build(&options, &second, &()).unwrap();
            assert_eq!((open.summary().unwrap().notes, again.notes), (about.notes.clone(), about.notes));
        }
        assert!(summary(100, with(value, 99), NoData::Value(value)).notes.is_empty());
        // Ten of ten thousand are too few.
        assert!(summary(100, with(value, 1000), NoData::Nothing).notes.is_empty());
    }
    // Within the others' range, and not far from them.
    let near: Vec<f64> = (0..10_000).map(|index| -f64::from(index)).collect();
    assert!(summary(100, near, NoData::Nothing).notes.is_empty());
    // Many huge numbers are heights, and of two the one farther off is named with its own count.
    let strange: Vec<f64> = (0..10_000).map(|index| 1e30 * f64::from(index)).collect();
    assert!(summary(100, strange, NoData::Nothing).notes.is_empty());
    let two = (0..10_000).map(|index| match index % 100 {
        0 => 1e30,
        1 | 2 => -3e38,
        other => f64::from(other),
    });
    let found = summary(100, two.collect(), NoData::Nothing).notes;
    assert!(found.len() == 1 && found[0].starts_with("200 of 10000 samples are -3e38, far from"), "{found:?}");
}

#[test]
fn ends_of_a_type_are_noted_from_near_by() {
    // Three of ten samples are `value`, the others go from `low` to `high`.
    let notes = |value: f64, [low, high]: [f64; 2]| {
        let other = |index: u32| low + (high - low) * f64::from(index) / 9999.0;
        let samples = (0..10_000).map(|index| if index % 10 < 3 && index > 10 { value } else { other(index) });
        summary(100, samples.collect(), NoData::Nothing).notes
    };
    for (value, others) in [
        (-32768.0, [-10_000.0, 11_744.0]),
        (32767.0, [-30_000.0, 31_000.0]),
        (65535.0, [0.0, 60_000.0]),
        (-2_147_483_648.0, [-2e9, 2e9]),
        (2_147_483_647.0, [-2e9, 2e9]),
        (4_294_967_295.0, [0.0, 4e9]),
    ] {
        let found = notes(value, others);
        let expected = format!("2996 of 10000 samples are {value}, far from all others");
        assert!(found.len() == 1 && found[0].starts_with(&expected), "{value}: {found:?}");
        // Heights that go up to there do not look like that, nor do those that go beyond.
        let near = if value < 0.0 { [value + 1.0, others[1]] } else { [others[0], value - 1.0] };
        assert!(notes(value, near).is_empty(), "{value}");
        assert!(notes(value, [-5e9, 5e9]).is_empty(), "{value}");
    }
    // Other values have to be farther off than all others are apart.
    assert!(notes(-9999.0, [-4999.0, 5000.0]).is_empty());
    assert_eq!(notes(-9999.0, [-2999.0, 3000.0]).len(), 1);
}

#[test]
fn fields_without_a_valid_sample_are_refused() {
    let source = source(4, vec![f64::NAN; 16], NoData::Nothing, Scale::NONE);
    let text = summarize_heights(&source).unwrap_err().to_string();
    assert!(text.contains("found 0 of 16, expected at least one") && text.contains("16 NaN"), "{text}");
}

#[test]
fn json_has_the_names_that_are_documented() {
    let found = serde_json::to_value(summary(2, vec![1.0, 2.0, 3.0, f64::INFINITY], NoData::Nothing)).unwrap();
    assert_eq!(found["kind"], "heights");
    assert_eq!(found["sample_type"], "f64");
    assert_eq!((&found["valid"], &found["valid_share"]), (&serde_json::json!(3), &serde_json::json!(0.75)));
    assert_eq!(found["invalid"], serde_json::json!({ "no-data": 0, "nan": 0, "infinite": 1 }));
    assert_eq!((&found["origin"], &found["spacing"]), (&serde_json::json!([0.0, 0.0]), &serde_json::json!([1.0, 1.0])));
    assert_eq!(
        (&found["planes"], &found["crs"], &found["xy_unit"]),
        (&serde_json::json!([]), &serde_json::Value::Null, &serde_json::json!(""))
    );
}
