//! What the codes of leaves do to a picture of column density: its distance from the source's, and what the file says of that.

use crate::support::{draw_pages, draw_source, text};
use deepfield::build::{BuildOptions, build};
use deepfield::color::Accumulation;
use deepfield::cpu::Method;
use deepfield::store::PageFile;
use deepfield::synth::{clusters::Clusters, dataset};
use deepfield::view::{Projection, View};
use glam::DVec3;
use serde_json::Value;
use std::sync::Arc;

/// Root of the mean square of the difference over that of the picture.
fn distance(picture: &Accumulation, expected: &Accumulation) -> f64 {
    let pairs = picture.p.iter().zip(&expected.p);
    let squares = pairs.fold([0.0; 2], |sum, (&a, &b)| {
        [sum[0] + (f64::from(a) - f64::from(b)).powi(2), sum[1] + f64::from(b).powi(2)]
    });
    (squares[0] / squares[1]).sqrt()
}

#[test]
fn codes_of_leaves_hardly_change_column_densities() {
    let data = dataset(&Clusters::new(1, 200_000));
    let (center, size) = (data.bounds().center(), data.bounds().size().max_element());
    let projection = Projection::Orthographic { height: size };
    let view = View::look_at(center + size * DVec3::Z, center, DVec3::Y, projection, 1024, 1024).unwrap();
    let expected = draw_source(&data, "column-density", &view, Method::Pyramid);
    let folder = tempfile::tempdir().unwrap();
    let [plain, refined] = [false, true].map(|refined| {
        let path = folder.path().join(format!("{refined}.df"));
        let mut options = BuildOptions::default();
        options.octree.refined = refined;
        build(data.clone(), &options, &path, &()).unwrap();
        let file = Arc::new(PageFile::open(&path).unwrap());
        // So small an error that leaves are drawn.
        let distance = distance(&draw_pages(&file, "column-density", &view, 1e-3), &expected);
        let bytes = file.bytes() as f64 / data.families[0].len() as f64;
        println!("refined {refined}: {:.3} %, {bytes:.2} bytes a particle", 100.0 * distance);
        (file, distance, bytes)
    });
    assert!(refined.1 <= 3e-3 && 4.0 * refined.1 <= plain.1, "{} {}", refined.1, plain.1);
    // Half a byte, and a column of each codebook.
    assert!(refined.2 <= plain.2 + 0.6, "{} and {} bytes a particle", plain.2, refined.2);
    let told = refined.0.metadata().families[0].column_error.unwrap();
    println!("told {:.3} %", 100.0 * told);
    assert!((0.4..2.5).contains(&(told / refined.1)), "{told} told, {} found", refined.1);
    assert_eq!(plain.0.metadata().families[0].column_error, None);
    // What `info` says of a file: a percentage in its table, a number in its JSON, and nothing that was not measured.
    let said = |name: &str| {
        let table = text(folder.path(), &["info", name]);
        let line = table.lines().find(|line| line.contains("column density of the box at 1024 pixels"));
        let after = line.map(|line| line.split("about ").nth(1).unwrap());
        let percentage: Option<f64> = after.map(|after| after.split(" %").next().unwrap().parse().unwrap());
        let json: Value = serde_json::from_str(&text(folder.path(), &["info", name, "--json"])).unwrap();
        (percentage, json["families"][0]["column_error"].clone())
    };
    let (percentage, number) = said("true.df");
    assert!((percentage.unwrap() - 100.0 * told).abs() < 0.0051, "{percentage:?} % printed, {told} told");
    assert!((number.as_f64().unwrap() / told - 1.0).abs() < 1e-12, "{number} as JSON, {told} told");
    assert_eq!(said("false.df"), (None, Value::Null));
}
