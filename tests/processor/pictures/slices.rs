//! Slices with lines and vectors by the program: of a volume, of particles from a page file and from their source.

use crate::support::golden::picture_at;
use crate::support::{json, ok, run};
use std::fmt::Write as _;
use std::path::Path;

fn told(folder: &Path, arguments: &[&str]) -> serde_json::Value {
    json(folder, &[&["render"][..], arguments, &["--json", "-"]].concat())
}

fn refused(folder: &Path, arguments: &[&str]) -> String {
    let output = run(folder, &[&["render"][..], arguments].concat());
    assert_eq!(output.status.code(), Some(1), "{arguments:?}");
    String::from_utf8(output.stderr).unwrap()
}

#[test]
fn a_volume_of_vectors_has_arrows_and_streaks() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // A turning disc, twice as fast as it is far from its middle.
    let mut values = String::new();
    for (y, x) in (0..40).flat_map(|at| (0..24).map(move |x| (at % 20, x))) {
        write!(values, "{} {} 0 ", 19 - 2 * y, 2 * x - 23).unwrap();
    }
    let text = format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"ImageData\" version=\"0.1\" byte_order=\"LittleEndian\">\n\
         <ImageData WholeExtent=\"0 23 0 19 0 1\" Origin=\"0 0 0\" Spacing=\"1 1 1\"><Piece Extent=\"0 23 0 19 0 1\"><PointData>\n\
         <DataArray type=\"Float32\" Name=\"wind\" NumberOfComponents=\"3\" format=\"ascii\">\n{values}\n</DataArray>\n\
         </PointData></Piece></ImageData></VTKFile>\n"
    );
    std::fs::write(folder.join("wind.vti"), text).unwrap();
    let slice = |out: &str, more: &[&str]| {
        let told = told(folder, &[&["wind.vti", "-o", out, "--mode", "slice", "--size", "240x200"][..], more].concat());
        (told, picture_at(&folder.join(out)))
    };
    let (told, plain) = slice("plain.png", &[]);
    assert!(told.get("arrows").is_none(), "{told}");
    let (told, arrows) = slice("arrows.png", &["--set", "vectors=arrows", "--set", "vector-spacing=20"]);
    let scale = told["arrows"]["scale"].as_f64().unwrap();
    // The fastest samples have 29.8.
    assert!(told["arrows"]["spacing"] == 20.0 && (20.0..30.0).contains(&scale), "{told}");
    let (_, streaks) = slice("streaks.png", &["--set", "vectors=lic", "--threads", "1"]);
    assert!(plain != arrows && plain != streaks && arrows != streaks);
    assert!(
        slice("again.png", &["--set", "vectors=lic", "--threads", "3"]).1 == streaks,
        "the same by any number of threads"
    );
    let field = ["--set", "vectors=lic", "--set", "vector-field=spin"];
    let why = refused(folder, &[&["wind.vti", "-o", "x.png", "--mode", "slice"][..], &field].concat());
    assert!(why.contains("wind.vti") && why.contains("vector-field is spin, expected one of wind"), "{why}");
}

#[test]
fn a_cross_section_has_the_vectors_that_its_file_has() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let done = |arguments: &[&str]| ok(folder, arguments);
    done(&["synth", "merger", "-n", "3000", "-o", "merger.g2"]);
    done(&["build", "merger.g2", "-o", "flow.df", "--attributes", "internal-energy,velocity-x,velocity-y,velocity-z"]);
    let view = ["--eye", "0,0,500", "--target", "0,0,0", "--ortho", "120", "--size", "120x100"];
    let flow = ["--mode", "cross-section", "--set", "through=[0,0,0]", "--set", "vectors=arrows"];
    for (data, more) in [("flow.df", &[][..]), ("merger.g2", &["--exact"])] {
        let told = told(folder, &[&[data, "-o", "flow.png", "--raw", "flow.npy"][..], &view, &flow, more].concat());
        assert_eq!(told["mode"], "cross-section");
        let raw = std::fs::read(folder.join("flow.npy")).unwrap();
        let header = String::from_utf8_lossy(&raw[..128]);
        assert!(header.contains("<f4") && header.contains("(100, 120"), "{header}");
        assert!(told["arrows"]["scale"].as_f64().unwrap() > 100.0, "km/s: {told}");
        assert!(told["grid"]["particles"].as_u64().unwrap() > 100, "{told}");
    }
    done(&["build", "merger.g2", "-o", "plain.df"]);
    let why = refused(folder, &[&["plain.df", "-o", "x.png"][..], &view, &flow].concat());
    assert!(why.contains("field velocity-x is not in the data") && why.contains("build --attributes"), "{why}");
    let why = refused(folder, &["plain.df", "-o", "x.png", "--attribute", "velocity-x"]);
    assert!(why.contains("attribute velocity-x is not in the data") && why.contains("build --attributes"), "{why}");
}
