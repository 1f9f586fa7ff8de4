//! Commands around measured heights: what is made up, what is damaged, and options and commands that heights have no use for.

use super::{array, misused, refused, waves, written};
use crate::support::{json, ok, run};

#[test]
fn synthetic_surfaces_and_bad_input() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let fbm = ["synth", "surface", "--shape", "fbm", "--size", "300x200", "--type", "i16", "--seed", "5", "-o"];
    ok(folder, &[&fbm[..], &["a.npy"]].concat());
    ok(folder, &[&fbm[..], &["b.npy"]].concat());
    assert!(std::fs::read(folder.join("a.npy")).unwrap() == std::fs::read(folder.join("b.npy")).unwrap());
    ok(folder, &["build", "a.npy", "-o", "a.df"]);
    let told = json(folder, &["info", "a.df", "--json"]);
    assert!(
        told["bytes_per_sample"].as_f64().unwrap() < 3.0 && told["notes"].to_string().contains("--spacing"),
        "{told:#}"
    );
    let whole = std::fs::read(folder.join("a.npy")).unwrap();
    std::fs::write(folder.join("cut.npy"), &whole[..whole.len() / 2]).unwrap();
    refused(folder, &["info", "cut.npy"], "cut.npy: ");
    std::fs::write(folder.join("unknown"), [1_u8, 2, 3, 4, 5]).unwrap();
    refused(folder, &["info", "unknown"], "(images and volumes), sur, al3d");
    written(&folder.join("none.npy"), [8, 8], |_, _| f64::NAN);
    refused(folder, &["info", "none.npy"], "found 0 of 64");
    misused(folder, &["synth", "surface", "-o", "x.npy"], "--size: expected two numbers of samples");
    written(&folder.join("row.npy"), [9, 1], |_, _| 1.0);
    refused(folder, &["info", "row.npy"], "2 x 2");
    let damaged = folder.join("damaged.df");
    let sound = std::fs::read(folder.join("a.df")).unwrap();
    for place in (0..sound.len()).step_by(sound.len() / 40) {
        let mut bytes = sound.clone();
        bytes[place] ^= 1 << (place % 8);
        std::fs::write(&damaged, bytes).unwrap();
        assert_eq!(run(folder, &["verify", "damaged.df"]).status.code(), Some(1), "byte {place}");
        let drawn = run(folder, &["render", "damaged.df", "-o", "x.png", "--size", "64x64"]);
        assert!(matches!(drawn.status.code(), Some(0 | 1)));
    }
}

#[test]
fn options_of_particles_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    waves(folder);
    ok(folder, &["build", "waves.npy", "-o", "waves.df", "--spacing", "1,1"]);
    std::fs::write(folder.join("stars.csv"), "x,y,z\n1,2,3\n4,5,6\n").unwrap();
    let common: [&[&str]; 14] = [
        &["--sphere", "0,0,0,1"],
        &["--box", "0,0,0,1,1,1"],
        &["--region", "region.ron"],
        &["--where", "mass:1..2"],
        &["--family", "gas"],
        &["--at", "groups.hdf5#0"],
        &["--catalogue", "groups.hdf5"],
        &["--radius", "3"],
        &["--no-wrap"],
        &["--ids", "lab.ids"],
        &["--tracked-at", "1"],
        &["--selection", "a.scene.ron#halo"],
        &["--time", "1"],
        &["--interpolation", "hold"],
    ];
    let of_probes: [&[&str]; 5] =
        [&["--over-time"], &["--profile", "3"], &["--fields", "none"], &["--histogram", "mass"], &["--bins", "8"]];
    for name in ["waves.npy", "waves.df"] {
        let found = |option: &[&str]| format!("{name}: {}: found heights, expected particles", option[0]);
        for option in common.into_iter().chain([&["--frame", "physical"][..]]) {
            misused(folder, &[&["select", name, "-o", "x.csv"][..], option].concat(), &found(option));
        }
        for option in common.into_iter().chain(of_probes) {
            misused(folder, &[&["probe", name][..], option].concat(), &found(option));
        }
        for option in [
            &["--family", "gas"][..],
            &["--paths", "all"],
            &["--periodic", "wrapped"],
            &["--time", "1"],
            &["--interpolation", "hold"],
            &["--reference"],
            &["--overdraw", "o.png"],
        ] {
            misused(folder, &[&["render", name, "-o", "x.png"][..], option].concat(), &found(option));
        }
    }
    for option in [&["--family", "gas"][..], &["--attributes", "mass"], &["--smoothing", "knn:9"], &["--every", "2"]] {
        let found = format!("waves.npy: {}: found heights, expected particles", option[0]);
        misused(folder, &[&["build", "waves.npy", "-o", "x.df"][..], option].concat(), &found);
    }
    misused(
        folder,
        &["render", "waves.df", "--with", "waves.df@0,0,99", "-o", "x.png", "--family", "gas"],
        "waves.df: --family: found heights, expected particles",
    );
    misused(folder, &["render", "waves.df", "-o", "x.png", "--splats", "9"], "surface has no setting splats, expected");
    assert!(["x.csv", "x.png", "o.png"].iter().all(|name| !folder.join(name).exists()));
    // Among particles they are these particles', and the other way round it is the same.
    let among = ["render", "waves.df", "--with", "stars.csv", "-o", "x.png", "--family", "dark", "--size", "60x40"];
    ok(folder, &among);
    let rectangle = ["select", "stars.csv", "--rectangle", "0,0,9,9", "-o", "x.csv"];
    misused(folder, &rectangle, "stars.csv: --rectangle: found no heights, expected some");
    // A name that is mistyped has no settings either, but that is not what is wrong.
    refused(folder, &["render", "wave.npy", "-o", "x.png", "--set", "contours=5.0"], "wave.npy: No such file");
    // Nothing that is said or asked of heights is passed over where there are none.
    for option in [
        &["--point", "1,2"][..],
        &["--line", "0,0,1,1"],
        &["--form", "plane"],
        &["--l-filter", "2"],
        &["--nodata", "-1"],
        &["--spacing", "1,1"],
    ] {
        let found = format!("stars.csv: {}: found no heights, expected some", option[0]);
        misused(folder, &[&["probe", "stars.csv"][..], option].concat(), &found);
    }
    for command in [&["info"][..], &["build", "-o", "x.df"], &["render", "-o", "x.png"]] {
        let found = "stars.csv: --xy-unit: found no heights, expected some";
        misused(folder, &[command, &["stars.csv", "--xy-unit", "m"]].concat(), found);
    }
}

#[test]
fn commands_that_have_no_use_for_heights_name_them() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    waves(folder);
    ok(folder, &["build", "waves.npy", "-o", "waves.df", "--spacing", "1,1"]);
    ok(folder, &["select", "waves.df", "-o", "waves.asc"]);
    for name in ["waves.df", "waves.asc"] {
        let instead = "deepfield select FILE -o OUT.tif writes the samples of heights";
        let found = |expected: &str| format!("{name}: content: found heights, expected {expected}; {instead}");
        refused(folder, &["export", name, "-o", "x.ply"], &found("particles"));
        refused(folder, &["export", name, "-o", "x.ply", "--mode", "column-density"], &found("particles"));
        refused(folder, &["reconstruct", name, "-o", "x.npy"], &found("an image or a volume"));
        refused(folder, &["catalogue", name], &found("a catalogue of objects"));
        refused(folder, &["plot", name, "--histogram", "height", "-o", "x.svg"], &found("particles"));
        refused(folder, &["surface", name, "--isovalue", "1", "-o", "x.ply"], &found("particles or a volume"));
    }
    // An array is an image as well.
    ok(folder, &["reconstruct", "waves.npy", "-o", "x.npy", "--exact"]);
    let as_image = ["render", "waves.df", "-o", "x.png", "--kind", "image"];
    refused(folder, &as_image, "waves.df: --kind: found a file of heights");
    // Its pixels are particles where those are asked for; other formats have none.
    let drawn = ["-o", "x.png", "--size", "32x24", "--backend", "cpu"];
    let sums = [&drawn[..], &["--mode", "column-density"]].concat();
    ok(folder, &[&["render", "waves.npy"], &sums[..]].concat());
    ok(folder, &[&["render", "waves.npy", "--kind", "particles"], &drawn[..]].concat());
    let no_sums = "mode column-density does not draw heights, expected surface";
    refused(folder, &[&["render", "waves.asc"], &sums[..]].concat(), &format!("waves.asc: {no_sums}"));
    let as_heights = [&["render", "waves.npy", "--kind", "heights"], &sums[..]].concat();
    refused(folder, &as_heights, &format!("waves.npy: {no_sums}"));
    // What is no heights is named as what it is; what could be some says how.
    array(&folder.join("three.npy"), "<f4", "6, 5, 5", &[0; 600]);
    array(&folder.join("grey.npy"), "|u1", "16, 9", &[7; 144]);
    let drawn = |name: &str| {
        let output = run(folder, &["render", name, "-o", "x.png", "--mode", "surface"]);
        assert_eq!(output.status.code(), Some(1));
        String::from_utf8(output.stderr).unwrap()
    };
    assert_eq!(drawn("three.npy"), "deepfield: three.npy: mode surface draws heights, found a volume\n");
    let hint = "; --kind heights takes its values for heights";
    assert_eq!(drawn("grey.npy"), format!("deepfield: grey.npy: mode surface draws heights, found an image{hint}\n"));
    // Numbers below 0 reach whoever knows what is wrong with them.
    refused(
        folder,
        &["build", "waves.npy", "-o", "x.df", "--spacing", "-1,1"],
        "waves.npy: --spacing: found -1,1, expected two numbers above 0",
    );
    for option in ["--s-filter", "--l-filter", "--fov", "--ortho"] {
        let output = run(folder, &["probe", "waves.df", option, "-1"]);
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(2) && text.contains("expected a number greater than 0"), "{text}");
    }
    let help = String::from_utf8(ok(folder, &["--help"]).stdout).unwrap();
    assert!(help.contains("Formats of heights: sur, "), "{help}");
}
