//! Tipsy: both byte orders, both headers; what `hsmooth` and `rho` mean.

use super::writers::{file, tipsy};
use super::{message, read_all};
use deepfield::import::{FieldKind, LoadOptions, load, open, summarize};
use deepfield::model::FamilyName;
use proptest::prelude::*;

fn records(width: usize) -> impl Strategy<Value = Vec<Vec<f32>>> {
    let number = (-800..800i32).prop_map(|eighths| eighths as f32 / 8.0);
    prop::collection::vec(prop::collection::vec(number, width), 0..6)
}

proptest! {
    #![proptest_config(crate::cases::cases(128))]

    #[test]
    fn what_is_written_comes_back(
        gas in records(12), dark in records(9), stars in records(11), big in any::<bool>(), padded in any::<bool>(), step in 1..4u64,
    ) {
        prop_assume!(gas.len() + dark.len() + stars.len() > 0);
        // Without padding, a first mass of 0 cannot be told from padding.
        let first = gas.iter().chain(&dark).chain(&stars).next().map_or(0.0, |record| record[0]);
        prop_assume!(padded || first != 0.0);
        let folder = tempfile::tempdir().unwrap();
        let path = file(folder.path(), "a.tipsy", &tipsy(big, padded, [&gas, &dark, &stars]));
        let source = open(&path).unwrap();
        prop_assert_eq!(source.description().time, Some(0.5));
        let present: Vec<_> = [(FamilyName::Gas, &gas), (FamilyName::Dark, &dark), (FamilyName::Stars, &stars)]
            .into_iter()
            .filter(|(_, records)| !records.is_empty())
            .collect();
        prop_assert_eq!(source.description().families.len(), present.len());
        for (family, (name, records)) in present.into_iter().enumerate() {
            let info = &source.description().families[family];
            prop_assert_eq!(info.name, name);
            let column = |from: usize, to: usize| -> Vec<f64> {
                records.iter().flat_map(|record| &record[from..to]).map(|value| *value as f64).collect()
            };
            prop_assert_eq!(read_all(source.as_ref(), family, "mass", step), column(0, 1));
            prop_assert_eq!(read_all(source.as_ref(), family, "position", step), column(1, 4));
            prop_assert_eq!(read_all(source.as_ref(), family, "velocity", step), column(4, 7));
            let last = records[0].len();
            prop_assert_eq!(read_all(source.as_ref(), family, "phi", step), column(last - 1, last));
            if name == FamilyName::Gas {
                let factor = if info.find(FieldKind::SmoothingLength).is_some() { 2.0 } else { 1.0 };
                let doubled: Vec<f64> = column(9, 10).iter().map(|h| factor * h).collect();
                prop_assert_eq!(read_all(source.as_ref(), family, "hsmooth", step), doubled);
            }
        }
    }

}

proptest! {
    // Each case tries every length of a file.
    #![proptest_config(crate::cases::cases(16))]

    #[test]
    fn a_shortened_file_is_an_error(dark in records(9), big in any::<bool>()) {
        prop_assume!(!dark.is_empty());
        let folder = tempfile::tempdir().unwrap();
        let whole = tipsy(big, true, [&[], &dark, &[]]);
        for length in 0..whole.len() {
            let path = file(folder.path(), "short", &whole[..length]);
            let text = message(&summarize(&path).err().unwrap(), &path);
            prop_assert!(text.contains("expected"), "{}", text);
        }
    }
}

fn gas(x: f32, rho: f32, hsmooth: f32) -> Vec<f32> {
    vec![1.0, x, 0.0, 0.0, 0.0, 0.0, 0.0, rho, 10.0, hsmooth, 0.0, 0.0]
}

#[test]
fn a_varying_hsmooth_is_half_the_support_radius() {
    let folder = tempfile::tempdir().unwrap();
    let records = [gas(0.0, 1.0, 0.5), gas(1.0, 2.0, 0.25)];
    let path = file(folder.path(), "varying", &tipsy(false, true, [&records, &[], &[]]));
    let loaded = load(&path, &LoadOptions::default(), &()).unwrap();
    assert_eq!(loaded.families[0].smoothing_length, [1.0, 0.5]);
    assert_eq!(loaded.families[0].density, [1.0, 2.0]);
    assert!(loaded.provenance.notes.iter().any(|note| note.contains("doubled")));
}

#[test]
fn a_constant_hsmooth_is_a_softening_and_a_constant_rho_a_placeholder() {
    let folder = tempfile::tempdir().unwrap();
    let records = [gas(0.0, 1.0, 0.5), gas(3.0, 1.0, 0.5)];
    let path = file(folder.path(), "constant", &tipsy(true, false, [&records, &[], &[]]));
    let loaded = load(&path, &LoadOptions::default(), &()).unwrap();
    assert_eq!(loaded.families[0].smoothing_length, [3.0, 3.0]);
    let center = 8.0 / std::f32::consts::PI / 27.0;
    assert!(loaded.families[0].density.iter().all(|rho| (rho / center - 1.0).abs() < 1e-6));
}
