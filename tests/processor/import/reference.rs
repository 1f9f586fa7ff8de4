//! The reference data, where it is there: counts, masses, boxes and field statistics that independent readers took.

use crate::support::in_reference_data;
use deepfield::import::{FamilySummary, LoadOptions, Statistic, Summary, load, summarize};
use serde_json::Value;

fn close(a: f64, b: f64, relative: f64) -> bool {
    (a - b).abs() <= relative * a.abs().max(b.abs())
}

#[test]
#[ignore = "needs the reference data: DEEPFIELD_DATA"]
fn every_expected_source_has_its_counts_masses_and_bounds() {
    let text = std::fs::read_to_string(in_reference_data("expected.json")).unwrap();
    let expected: Value = serde_json::from_str(&text).unwrap();
    let sources = expected["particles"].as_array().unwrap();
    assert!(sources.len() > 20);
    for source in sources {
        let name = source["path"].as_str().unwrap();
        let summary = summarize(&in_reference_data(name)).unwrap();
        assert_eq!(Some(summary.particles), source["particles"].as_u64(), "{name}");
        assert_eq!(Some(summary.about.format.as_str()), source["format"].as_str(), "{name}");
        assert!(summary.skipped.is_empty(), "{name}");
        for family in source["families"].as_array().unwrap() {
            let own = family_of(&summary, family["name"].as_str().unwrap());
            assert_eq!(Some(own.count), family["count"].as_u64(), "{name}");
            if let Some(mass) = family["mass"].as_f64() {
                assert!(close(own.mass, mass, 1e-9), "{name}: {} {mass}", own.mass);
            }
        }
        let bounds = summary.bounds.unwrap();
        for (own, side) in [(bounds.min, "min"), (bounds.max, "max")] {
            for (own, expected) in own.to_array().iter().zip(source["bounds"][side].as_array().unwrap()) {
                assert!(close(*own, expected.as_f64().unwrap(), 1e-15), "{name}: {own} {expected}");
            }
        }
        let loaded = load(&in_reference_data(name), &LoadOptions::default(), &()).unwrap();
        assert_eq!(loaded.len() as u64, summary.particles, "{name}");
        assert!(loaded.skipped.is_empty(), "{name}");
        assert_eq!(loaded.bounds(), bounds, "{name}");
        for family in source["families"].as_array().unwrap() {
            if let Some(h_max) = family["h_max"].as_f64() {
                let own =
                    loaded.families.iter().find(|own| Some(own.name.as_str()) == family["name"].as_str()).unwrap();
                let largest = own.smoothing_length.iter().copied().fold(0.0, f32::max);
                assert!(close(largest as f64, h_max, 1e-7), "{name}: {largest} {h_max}");
            }
        }
    }
}

fn family_of<'a>(summary: &'a Summary, name: &str) -> &'a FamilySummary {
    summary.families.iter().find(|family| family.name.as_str() == name).unwrap()
}

/// Source, family, field, and the minimum, maximum and mean of its first component as the data's description gives them.
const STATISTICS: &[(&str, &str, &str, f64, f64, f64)] = &[
    ("particles/galaxy_littleendian.dat", "dark", "id", 1.0, 40000.0, 20000.5),
    ("particles/gassphere_littleendian.dat", "gas", "internal-energy", 0.05, 0.05, 0.05),
    ("particles/pot_acc.format2.gadget2", "stars", "velocity", -7.248467, 6.573048, 4.912452e-5),
    ("particles/pot_acc.format2.gadget2", "stars", "potential", -47.40998, -8.609693, -28.61726),
    ("particles/pot_acc.format2.gadget2", "stars", "acceleration", -5279.13, 4022.174, 0.2742812),
    ("particles/run581.20000.tipsy", "dark", "velocity", -134.4456, 127.0838, 3.201691),
    ("particles/run581.20000.tipsy", "dark", "softening", 0.000368403, 0.01461331, 0.001975213),
    ("particles/run581.20000.tipsy", "stars", "potential", -26276.67, -20382.49, -24318.21),
    ("particles/adiabtophat_glass_28721.tipsy", "gas", "temperature", 0.05, 0.05, 0.05),
    ("particles/model3_child_compact.tipsy", "dark", "velocity", -6.444601, 6.372055, -5.288157e-8),
    ("particles/dm_halo.hdf5", "dark", "position", -0.09995781, 0.09998953, 0.004095005),
    ("particles/lcdm64_z0.hdf5", "dark", "density", 0.4065529, 1240589.0, 10694.2),
    ("particles/lcdm64_z0.hdf5", "dark", "smoothing-length", 0.04314021, 4.643542, 1.226415),
    ("particles/lcdm64_z0.hdf5", "dark", "velocity-dispersion", 30.05032, 1135.675, 248.2062),
    ("particles/lcdm64_z0.hdf5", "dark", "velocity", -1445.735, 1759.103, 0.02425312),
    ("particles/fire_galaxy_a.hdf5", "gas", "log10Density", -14.64249, 0.7423275, -8.1284),
    ("particles/fire_galaxy_a.hdf5", "gas", "log10Temperature", 0.687866, 6.98874, 4.507839),
    ("particles/fire_galaxy_a.hdf5", "stars", "AgeGyr", 0.0003674, 13.51919, 7.269535),
    ("particles/fire_galaxy_a.hdf5", "stars", "velocity", -887.1271, 878.0038, 1.299723),
    ("particles/lcdm64_z0_groups.hdf5", "dark", "GroupLen", 32.0, 3292.0, 86894.0 / 486.0),
    ("sequences/zeldovich_27000.csv.gz", "dark", "position", -5.966935, 5.33552, 0.0002297642),
    ("sequences/zeldovich_27000.csv.gz", "dark", "velocity", -0.1096512, 0.08623712, 2.297642e-5),
    ("stars/hipparcos_tycho_kstars.dat.gz", "stars", "ra", 0.003416667, 359.9824, 183.3701),
    ("stars/hipparcos_tycho_kstars.dat.gz", "stars", "dec", -89.83122, 89.44433, -1.524528),
    ("stars/hipparcos_tycho_kstars.dat.gz", "stars", "parallax", 0.0, 742.1, 9.333306),
    ("stars/hipparcos_tycho_kstars.dat.gz", "stars", "magnitude", -1.44, 8.99, 8.070074),
    ("stars/hipparcos_tycho_kstars.dat.gz", "stars", "color-index", -0.4, 5.46, 0.7325852),
    ("stars/hyg_mag65.csv", "stars", "position", -91628.22, 80809.24, -146.9018),
    ("stars/hyg_mag65.csv", "stars", "magnitude", -1.44, 6.5, 5.623395),
    ("stars/hyg_mag65.csv", "stars", "luminosity", 0.04051352, 4.092607e8, 1215223.0),
    ("stars/hyg_mag65.csv", "stars", "color-index", -0.31, 3.332, 0.6310479),
    ("stars/stars_mag6.geojson", "stars", "ra", -179.8148, 179.9871, 3.224913),
    ("stars/stars_mag6.geojson", "stars", "magnitude", -1.44, 6.0, 5.124607),
];

#[test]
#[ignore = "needs the reference data: DEEPFIELD_DATA"]
fn fields_have_their_known_statistics() {
    for (name, family, field, min, max, mean) in STATISTICS {
        let summary = summarize(&in_reference_data(name)).unwrap();
        let family = family_of(&summary, family);
        let own = family.fields.iter().find(|own| own.about.name == *field).unwrap_or_else(|| panic!("{name} {field}"));
        let first = |statistic: &Statistic| match statistic {
            Statistic::Scalar(value) => *value,
            Statistic::Vector(values) => values[0],
        };
        // The numbers are given to seven digits, and means of near zero suffer from cancellation in the readers' sums.
        for (own, expected) in [(first(&own.min), min), (first(&own.max), max), (first(&own.mean), mean)] {
            let scale = max.abs().max(min.abs());
            assert!(
                close(own, *expected, 2e-6) || (own - expected).abs() < 1e-9 * scale,
                "{name} {field}: {own} {expected}"
            );
        }
    }
}

#[test]
#[ignore = "needs the reference data: DEEPFIELD_DATA"]
fn stars_with_a_parallax_have_their_known_positions() {
    let summary = summarize(&in_reference_data("stars/hipparcos_tycho_kstars.dat.gz")).unwrap();
    assert_eq!(summary.particles, 125_982);
    assert_eq!(summary.skipped[0].count, 1374);
    let loaded = load(&in_reference_data("stars/hipparcos_tycho_kstars.dat.gz"), &LoadOptions::default(), &()).unwrap();
    assert_eq!(loaded.len(), 124_608);
    let positions = &loaded.families[0].positions;
    let mean = |axis: usize| positions.iter().map(|position| position[axis]).sum::<f64>() / positions.len() as f64;
    for (axis, expected) in [1.294371, 3.006821, -11.56301].into_iter().enumerate() {
        assert!(close(mean(axis), expected, 1e-6), "{} {expected}", mean(axis));
    }
    // A parallax of 40 mas is 25 pc to the last bit or so; those stars do not count as within.
    let near = positions.iter().filter(|[x, y, z]| (x * x + y * y + z * z).sqrt() < 25.0 - 1e-9).count();
    assert_eq!(near, 1422);
}
