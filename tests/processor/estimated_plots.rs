//! Histograms of a part of a page file: as near to those of all of it as is allowed, and from fewer pages where much is.

use crate::support::{Random, run};
use deepfield::build::{BuildOptions, build};
use deepfield::explore::{Binned, BinnedAxis, Data, Members, Plot, PlotOptions, Region, Weight, Work};
use deepfield::model::{Attribute, Dataset, Family, FamilyName, Kernel, Provenance, Unit};
use deepfield::store::PageFile;
use glam::DVec3;
use serde_json::Value;
use std::path::Path;

const EDGE: f64 = 100.0;

/// A box of close groups of eight, hotter to the right, as a file of hundreds of pages: merged particles stand for groups.
fn built(path: &Path) -> PageFile {
    let mut random = Random(3);
    let mut family = Family {
        name: FamilyName::Gas,
        positions: Vec::new(),
        mass: Vec::new(),
        smoothing_length: Vec::new(),
        density: Vec::new(),
        attributes: vec![Attribute { name: "temperature".into(), unit: Unit::new("K"), values: Vec::new() }],
    };
    for _ in 0..3000 {
        let middle = [(); 3].map(|()| EDGE * random.next());
        for _ in 0..8 {
            family.positions.push(middle.map(|x| x + 1e-4 * random.next()));
            family.mass.push((1.0 + random.next()) as f32);
            family.smoothing_length.push(0.5);
            family.density.push(1.0);
            let exponent = 3.0 + 3.0 * middle[0] / EDGE + 0.1 * random.next();
            family.attributes[0].values.push(10f64.powf(exponent) as f32);
        }
    }
    let dataset = Dataset {
        families: vec![family],
        length_unit: Unit::new("kpc"),
        mass_unit: Unit::new("Msun"),
        kernel: Kernel::CubicSpline,
        skipped: Vec::new(),
        provenance: Provenance::default(),
    };
    let mut options = BuildOptions { page_bytes: 2048, ..BuildOptions::default() };
    options.octree.leaf_capacity = 32;
    build(dataset, &options, path, &()).unwrap();
    PageFile::open(path).unwrap()
}

/// The histogram of four bins of a region, from as little as is allowed.
fn histogram(file: &PageFile, region: &Region, weight: &Weight, allowed: Option<f64>) -> Binned {
    let axis = BinnedAxis { field: "temperature".into(), bins: 4, logarithmic: Some(true), range: None };
    let options = PlotOptions::Binned { axes: vec![axis], weight: weight.clone(), allowed };
    let members = Members::Region(region.clone());
    match Plot::find(Data::Pages(file), &members, &options, None, Work::quiet()).unwrap() {
        Plot::Binned(found) => found,
        other => panic!("{other:?}"),
    }
}

#[test]
fn errors_of_parts_are_as_told_and_save_pages() {
    let folder = tempfile::tempdir().unwrap();
    let file = built(&folder.path().join("groups.df"));
    let ball = Region::sphere(DVec3::splat(0.5 * EDGE), 0.45 * EDGE).with_range("temperature", Some(1e3), Some(2e6));
    for region in [Region::whole(), ball] {
        for weight in [Weight::Mass, Weight::Count, Weight::Field("temperature".into())] {
            let of_all = histogram(&file, &region, &weight, None);
            assert!(of_all.estimate.is_none());
            assert_eq!(histogram(&file, &region, &weight, Some(0.0)), of_all);
            for allowed in [0.01, 0.1, 0.6] {
                let found = histogram(&file, &region, &weight, Some(allowed));
                let about = format!("{weight} within {allowed}: {:?}, expected {:?}", found.weights, of_all.weights);
                let share = 0.01 * of_all.total;
                // Three standard errors are what is told.
                let slack = if found.estimate.is_some() && allowed > 0.01 { 1.5 } else { 1.0 };
                let is_whole = region.shapes.is_empty();
                if is_whole {
                    assert_eq!(found.axes, of_all.axes);
                    for (one, all) in found.weights.iter().zip(&of_all.weights) {
                        assert!((one - all).abs() <= slack * allowed * all.max(share), "{about}");
                    }
                    // Of other weights than these numbers have no error of their own.
                    if !matches!(weight, Weight::Field(_)) {
                        let off = (found.count as f64 / of_all.count as f64 - 1.0).abs();
                        assert!(off <= slack * allowed, "{} of {} particles", found.count, of_all.count);
                    }
                } else {
                    // Axes reach over the whole file.
                    let off = (found.total / of_all.total - 1.0).abs();
                    assert!(off <= slack * allowed, "{about}");
                }
                if let Some(estimate) = &found.estimate {
                    assert!(
                        estimate.largest <= allowed && estimate.pages == u64::from(file.page_count()),
                        "{estimate:?}"
                    );
                    assert!(estimate.pages_read < estimate.pages && estimate.parts_read < estimate.parts);
                }
                if allowed > 0.5 && is_whole && !matches!(weight, Weight::Field(_)) {
                    assert!(found.estimate.is_some(), "{about}");
                }
            }
        }
    }
}

#[test]
fn an_estimate_says_so_in_every_output() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    built(&folder.join("groups.df"));
    let plot = |more: &[&str]| {
        let all = [&["plot", "groups.df", "--histogram", "temperature", "--bins", "4", "--log"][..], more].concat();
        run(folder, &all)
    };
    let output = plot(&["--error", "0.6", "-o", "part.csv", "--json", "part.json"]);
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && text.contains("an estimate from") && text.contains("standard errors"), "{text}");
    let answer: Value = serde_json::from_slice(&std::fs::read(folder.join("part.json")).unwrap()).unwrap();
    let errors = answer["estimate"]["errors"].as_array().unwrap();
    let table = std::fs::read_to_string(folder.join("part.csv")).unwrap();
    let lines: Vec<&str> = table.lines().collect();
    assert!(lines[0].starts_with("# an estimate from") && lines[1].contains("error of mass"), "{table}");
    for (line, error) in lines[2..].iter().zip(errors) {
        let cells: Vec<&str> = line.split(',').collect();
        assert_eq!((cells.len(), cells[3].parse::<f64>().unwrap()), (5, error.as_f64().unwrap()));
    }
    assert_eq!((lines.len(), errors.len()), (6, 4));
    assert_eq!(plot(&["--error", "0.1", "--exact", "-o", "x.csv"]).status.code(), Some(2));
    let scatter = ["plot", "groups.df", "--scatter", "density,temperature", "--error", "0.1", "-o", "x.csv"];
    assert_eq!(run(folder, &scatter).status.code(), Some(2));
}
