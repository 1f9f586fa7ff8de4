//! Tables: positions from coordinates or the sky, columns in rows or in lines, plain or gzip.

use super::writers::file;
use super::{message, read_all};
use crate::support::gzip;
use deepfield::build::{BuildOptions, build_source};
use deepfield::import::{AttributeChoice, LoadOptions, load, open, summarize};
use deepfield::model::FamilyName;
use flate2::{Compression, write::GzEncoder};
use std::io::Write;

#[test]
fn coordinates_with_units_plain_and_gzip() {
    let text = "x [kpc],y,z,vx,vy,vz,mass,Name\n1,2,3,0,0,5,2.5,first\n-4,5e-1,6,3,4,0,1,\"se,cond\"\n";
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in [("plain", text.as_bytes().to_vec()), ("packed", gzip(text.as_bytes()))] {
        let path = file(folder.path(), name, &bytes);
        let source = open(&path).unwrap();
        let family = &source.description().families[0];
        assert_eq!((family.name, family.count), (FamilyName::Dark, 2));
        assert_eq!(source.description().length_unit.to_string(), "kpc");
        assert_eq!(read_all(source.as_ref(), 0, "position", 1), [1.0, 2.0, 3.0, -4.0, 0.5, 6.0]);
        assert_eq!(read_all(source.as_ref(), 0, "mass", 2), [2.5, 1.0]);
        assert!(family.named("Name").is_none());
        let loaded = load(&path, &LoadOptions::default(), &()).unwrap();
        assert_eq!(loaded.families[0].attribute("speed").unwrap().values, [5.0, 5.0]);
        let named = AttributeChoice::Named(vec!["velocity-y".into(), "mass".into()]);
        let loaded = load(&path, &LoadOptions { attributes: named, ..LoadOptions::default() }, &()).unwrap();
        assert_eq!(loaded.families[0].attribute("velocity-y").unwrap().values, [0.0, 4.0]);
    }
}

#[test]
fn parallaxes_become_distances_and_stars_without_are_left_out() {
    let text = "ra_deg,dec,plx,mag,bv\n0,0,100,1,0.5\n90,0,10,2,\n0,90,1000,3,0.1\n10,10,0,4,0.2\n";
    let folder = tempfile::tempdir().unwrap();
    let path = file(folder.path(), "stars", text.as_bytes());
    let summary = summarize(&path).unwrap();
    assert_eq!((summary.particles, summary.skipped[0].count), (4, 1));
    assert_eq!(summary.about.length_unit.to_string(), "pc");
    let loaded = load(&path, &LoadOptions::default(), &()).unwrap();
    let stars = loaded.family(FamilyName::Stars).unwrap();
    let expected = [[10.0, 0.0, 0.0], [0.0, 100.0, 0.0], [0.0, 0.0, 1.0]];
    for (position, expected) in stars.positions.iter().zip(expected) {
        assert!(position.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{position:?}");
    }
    assert_eq!(stars.attribute("magnitude").unwrap().values, [1.0, 2.0, 3.0]);
    assert!(stars.attribute("color-index").unwrap().values[1].is_nan());
}

#[test]
fn stars_at_negative_distances_do_not_stand_on_the_other_side_of_the_sky() {
    let folder = tempfile::tempdir().unwrap();
    let path = file(folder.path(), "stars", b"ra,dec,dist,mag\n0,0,10,1\n0,0,-10,2\n90,0,0,3\n");
    let summary = summarize(&path).unwrap();
    assert_eq!((summary.particles, summary.skipped[0].count), (3, 1));
    let loaded = load(&path, &LoadOptions::default(), &()).unwrap();
    assert_eq!(loaded.family(FamilyName::Stars).unwrap().positions, [[10.0, 0.0, 0.0], [0.0; 3]]);
}

#[test]
fn directions_without_distances_lie_on_the_unit_sphere() {
    let json = r#"{"type":"FeatureCollection","features":[
        {"type":"Feature","id":1,"properties":{"mag":5.7,"bv":"0.9"},"geometry":{"type":"Point","coordinates":[-90.0,0.0]}},
        {"type":"Feature","id":2,"properties":{"mag":1.5,"bv":""},"geometry":{"type":"Point","coordinates":[0.0,-90.0]}}]}"#;
    let folder = tempfile::tempdir().unwrap();
    let path = file(folder.path(), "sky", json.as_bytes());
    let source = open(&path).unwrap();
    let positions = read_all(source.as_ref(), 0, "position", 2);
    let expected = [0.0, -1.0, 0.0, 0.0, 0.0, -1.0];
    assert!(positions.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{positions:?}");
    assert_eq!(read_all(source.as_ref(), 0, "magnitude", 2), [5.7, 1.5]);
    assert!(source.description().notes[0].contains("unit sphere"));
}

#[test]
fn the_columns_of_kstars_are_where_they_are() {
    let text = "# comment\n#\n\
        064508.92 -164258.0 -000546.0-001223.100379.2 -1.4400.01A0 1            , alp CMa, Sirius\n\
        000000.00 +900000.0 -000546.0-001223.101000.0 12.00-0.50A0 1            ,\n";
    let folder = tempfile::tempdir().unwrap();
    let path = file(folder.path(), "stars.dat", &gzip(text.as_bytes()));
    let source = open(&path).unwrap();
    assert_eq!(source.description().format, "kstars");
    let ra = read_all(source.as_ref(), 0, "ra", 1);
    assert!((ra[0] - 101.287_166_666).abs() < 1e-6, "{ra:?}");
    assert!((read_all(source.as_ref(), 0, "dec", 1)[0] + 16.716_111_111).abs() < 1e-6);
    assert_eq!(read_all(source.as_ref(), 0, "parallax", 1), [379.2, 1000.0]);
    assert_eq!(read_all(source.as_ref(), 0, "magnitude", 1), [-1.44, 12.0]);
    assert_eq!(read_all(source.as_ref(), 0, "color-index", 1), [0.01, -0.5]);
    let position = read_all(source.as_ref(), 0, "position", 2);
    assert!((position[5] - 1.0).abs() < 1e-12, "{position:?}");
}

#[test]
fn a_line_for_each_column() {
    let folder = tempfile::tempdir().unwrap();
    let path = file(folder.path(), "lines", b"# x,y,z\n1,2,3,4\n5,6,7,8\n9,10,11,12\n");
    let source = open(&path).unwrap();
    assert_eq!(
        read_all(source.as_ref(), 0, "position", 4),
        [1.0, 5.0, 9.0, 2.0, 6.0, 10.0, 3.0, 7.0, 11.0, 4.0, 8.0, 12.0]
    );
}

#[test]
fn what_is_wrong_with_a_table_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let cases = [
        ("words", "x,y,z\n1,2,3\n1,two,3\n", "y in line 3: found two, expected a number"),
        ("short", "x,y,z,m\n1,2,3,4\n1,2\n", "line 3: found 2 values, expected 4"),
        ("no-positions", "a,b,c\n1,2,3\n", "expected columns x, y, z"),
        ("empty", "x,y,z\n", "no particles"),
        ("lines", "# x,y,z\n1,2,3,4\n5,6,7,8\n", "found 0 values, expected 4"),
        (
            "latitude",
            "{\"type\":\"FeatureCollection\",\"features\":[{\"geometry\":{\"coordinates\":[1.0]}}]}",
            "features[0]",
        ),
    ];
    for (name, text, expected) in cases {
        let path = file(folder.path(), name, text.as_bytes());
        let text = message(&open(&path).err().unwrap(), &path);
        assert!(text.contains(expected), "{text}");
    }
}

#[test]
fn a_file_that_expands_beyond_any_table_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(format!("x,y,z\n{}", "1,1,1\n".repeat(1_000_000)).as_bytes()).unwrap();
    let path = file(folder.path(), "bomb", &encoder.finish().unwrap());
    let text = message(&open(&path).err().unwrap(), &path);
    assert!(text.contains("expands more than"), "{text}");
}

/// Positions and smoothing lengths of a table, or the error.
fn table(text: &str) -> Result<(String, Vec<f64>), String> {
    let folder = tempfile::tempdir().unwrap();
    let path = file(folder.path(), "table", text.as_bytes());
    match open(&path) {
        Ok(source) => Ok((source.description().length_unit.to_string(), read_all(source.as_ref(), 0, "position", 1))),
        Err(error) => Err(message(&error, &path)),
    }
}

fn assert_close(found: &[f64], expected: &[f64]) {
    let scale = expected.iter().fold(0.0f64, |most, x| most.max(x.abs()));
    let close = found.len() == expected.len() && found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9 * scale);
    assert!(close, "{found:?} {expected:?}");
}

#[test]
fn units_that_say_where_things_are_must_be_known() {
    let cases = [
        ("x [furlong],y,z\n1,2,3\n", "unit of x: found \"furlong\", expected a length: pc, kpc"),
        ("x [kpc],y [ells],z\n1,2,3\n", "unit of y: found \"ells\", expected a length"),
        ("x [kpc],y [kpc/h],z\n1,2,3\n", "unit of y: found \"kpc/h\", expected one like kpc"),
        ("x [kpc],y,z,h [deg]\n1,2,3,4\n", "unit of h: found \"deg\", expected a length"),
        ("ra [gradian?],dec\n1,2\n", "unit of ra: found \"gradian?\", expected an angle: deg, h"),
        ("ra,dec [kpc]\n1,2\n", "unit of dec: found \"kpc\", expected an angle"),
        ("ra,dec,dist [furlong]\n1,2,3\n", "unit of dist: found \"furlong\", expected a length"),
        ("ra,dec,parallax [pc]\n1,2,3\n", "unit of parallax: found \"pc\", expected an angle"),
    ];
    for (text, expected) in cases {
        let found = table(text).unwrap_err();
        assert!(found.contains(expected) && found.contains("table"), "{found}");
    }
}

#[test]
fn units_that_are_known_are_converted() {
    assert_eq!(table("x [kpc],y [pc],z [Mpc]\n1,2000,3\n").unwrap(), ("kpc".into(), vec![1.0, 2.0, 3000.0]));
    assert_eq!(table("x_kpc,y_kpc,z_kpc\n1,2,3\n").unwrap(), ("kpc".into(), vec![1.0, 2.0, 3.0]));
    assert_eq!(table("x [code units],y,z\n1,2,3\n").unwrap(), ("code units".into(), vec![1.0, 2.0, 3.0]));
    let expected = [0.0, 5.0, 0.0];
    for header in ["ra [h],dec,dist [kpc]", "ra_h,dec (J2000),dist_kpc", "ra [hourangle],dec [rad],distance [kpc]"] {
        let (unit, position) = table(&format!("{header}\n6,0,5\n")).unwrap();
        assert_eq!(unit, "kpc");
        assert_close(&position, &expected);
    }
    let quarter = std::f64::consts::FRAC_PI_2;
    let (_, position) = table(&format!("ra [arcsec],dec [rad],dist\n0,{quarter},2\n")).unwrap();
    assert_close(&position, &[0.0, 0.0, 2.0]);
    for (header, value) in [("plx", 20.0), ("parallax [arcsec]", 0.02), ("parallax_mas", 20.0), ("plx [uas]", 2e4)] {
        let (unit, position) = table(&format!("ra,dec,{header}\n0,0,{value}\n")).unwrap();
        assert_eq!(unit, "pc");
        assert_close(&position, &[50.0, 0.0, 0.0]);
    }
}

#[test]
fn smoothing_lengths_take_the_unit_of_positions_and_attributes_keep_theirs() {
    let folder = tempfile::tempdir().unwrap();
    let path = file(folder.path(), "mixed", b"x [kpc],y,z,h [pc],temp [furlong],rho [stones/ell^3]\n1,2,3,500,6,7\n");
    let source = open(&path).unwrap();
    assert_close(&read_all(source.as_ref(), 0, "smoothing-length", 1), &[0.5]);
    let unit = |name: &str| {
        let info = &source.description().families[0];
        info.fields[info.named(name).unwrap()].unit.to_string()
    };
    assert_eq!(
        ["smoothing-length", "temperature", "density"].map(unit),
        ["kpc", "furlong", "stones/ell^3"].map(str::to_string)
    );
    assert!(source.description().notes.iter().any(|note| note == "h is converted from pc to kpc"));
}

#[test]
fn masses_and_lengths_that_single_precision_does_not_hold_are_not_taken_for_missing() {
    let folder = tempfile::tempdir().unwrap();
    let table = |rows: &[[&str; 2]]| {
        let rows = rows.iter().enumerate().map(|(row, [mass, length])| format!("{row},2,3,{mass},{length}\n"));
        let text = format!("x,y,z,mass,smoothing-length\n{}", rows.collect::<String>());
        file(folder.path(), "table.csv", text.as_bytes())
    };
    for (rows, field) in [
        ([["8e39", "0.1"], ["-1", "0.1"]], "mass of dark: found 8e39"),
        ([["1", "1e-60"], ["1", "0"]], "smoothing length of dark: found 1e-60"),
    ] {
        let path = table(&rows);
        for error in [load(&path, &LoadOptions::default(), &()).unwrap_err(), summarize(&path).unwrap_err()] {
            assert!(error.to_string().contains(field), "{error}");
        }
    }
    // So is an attribute that is asked for, and no other.
    let path = file(folder.path(), "lit.csv", b"x,y,z,glow\n1,2,3,0\n2,2,3,1e44\n");
    assert!(load(&path, &LoadOptions::default(), &()).is_ok());
    let named = LoadOptions { attributes: AttributeChoice::Named(vec!["glow".into()]), ..LoadOptions::default() };
    let error = load(&path, &named, &()).unwrap_err().to_string();
    assert!(error.contains("glow of dark: found 1e44"), "{error}");
    // Some that it does not hold are left out; without a positive one there are none.
    let summary = summarize(&table(&[["8e39", "0.1"], ["2", "0.1"]])).unwrap();
    assert_eq!((summary.families[0].mass, summary.skipped[0].count), (2.0, 1));
    let summary = summarize(&table(&[["-1", "0.1"], ["0", "0.1"]])).unwrap();
    assert_eq!(summary.families[0].mass, 2.0);
    let note = "dark: no mass is positive, each particle counts 1";
    assert!(summary.about.notes.iter().any(|said| said == note), "{:?}", summary.about.notes);
}

#[test]
fn a_build_keeps_attributes_by_their_names_and_by_the_sources_own() {
    let folder = tempfile::tempdir().unwrap();
    let path = file(folder.path(), "table.csv", b"x,y,z,temp\n1,2,3,5\n2,2,3,6\n");
    for name in ["temp", "temperature"] {
        let names = vec![name.to_owned()];
        let load = LoadOptions { attributes: AttributeChoice::Named(names.clone()), ..LoadOptions::default() };
        let options = BuildOptions { attributes: Some(names), ..BuildOptions::default() };
        let built = build_source(&path, &load, &options, &folder.path().join("table.df"), &()).unwrap();
        let kept = built.metadata.families[0].attributes.iter().map(|attribute| attribute.name.as_str());
        assert_eq!(kept.collect::<Vec<_>>(), ["temperature"], "{name}");
    }
}
