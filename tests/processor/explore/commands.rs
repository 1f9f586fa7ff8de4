//! The commands, as a user calls them.

use super::particles::particles;
use crate::support::{error, program, run, text};
use serde_json::Value;
use std::fmt::Write as _;

/// A snapshot as a table, and its page file beside it.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut table = "id,x [kpc],y [kpc],z [kpc],vx,vy,vz,mass,h,temperature [K]\n".to_owned();
    for (i, p) in particles().iter().enumerate() {
        let (at, v) = (p.at, p.velocity);
        let _ = writeln!(
            table,
            "{i},{},{},{},{},{},{},{},{},{}",
            at.x, at.y, at.z, v.x, v.y, v.z, p.mass, p.h, p.temperature
        );
    }
    std::fs::write(folder.path().join("box.csv"), table).unwrap();
    std::fs::write(
        folder.path().join("named.csv"),
        "name,x,y,z,radius,mass\nSmall,10,20,30,5,1\nLarge,50,50,50,20,9\n",
    )
    .unwrap();
    text(folder.path(), &["build", "box.csv", "-o", "box.df"]);
    folder
}

#[test]
fn a_user_probes_selects_and_goes_back_in_time() {
    let folder = folder();
    let folder = folder.path();
    let json = |arguments: &[&str]| -> Value { serde_json::from_str(&text(folder, arguments)).unwrap() };
    let inside = |center: [f64; 3], radius: f64| {
        particles().iter().filter(|p| p.at.distance(center.into()) <= radius).count() as u64
    };
    let large = inside([50.0; 3], 20.0);

    let exact = json(&["probe", "box.csv", "--sphere", "50,50,50,20", "--json", "-"]);
    assert_eq!((exact["count"].as_u64(), exact["exact"].as_bool()), (Some(large), Some(true)));
    let coded = json(&["probe", "box.df", "--at", "named.csv#0", "--json", "-"]);
    let uncertain = coded["families"][0]["uncertain"]["count"].as_u64().unwrap();
    assert!(coded["count"].as_u64().unwrap().abs_diff(large) <= uncertain && coded["exact"] == false);
    let again = json(&["probe", "box.df", "--object", "large", "--catalogue", "named.csv", "--exact", "--json", "-"]);
    assert_eq!(again["families"], exact["families"]);
    let smaller = json(&["probe", "box.csv", "--at", "named.csv#Small", "--radius", "9", "--json", "-"]);
    assert_eq!(smaller["count"].as_u64(), Some(inside([10.0, 20.0, 30.0], 9.0)));

    let table = text(
        folder,
        &["probe", "box.csv", "--sphere", "50,50,50,20", "--profile", "4", "--where", "temperature:1e4.."],
    );
    for part in
        ["centre of mass", "velocity dispersion", "temperature", "profile: radii in kpc", "with temperature 10000.."]
    {
        assert!(table.contains(part), "{part} is not in {table}");
    }

    let counted = json(&[
        "probe",
        "box.df",
        "--histogram",
        "temperature",
        "--histogram",
        "temperature,mass",
        "--bins",
        "8",
        "--json",
        "-",
    ]);
    for histogram in counted["histograms"].as_array().unwrap() {
        let counts = histogram["counts"].as_array().unwrap().iter().map(|count| count.as_u64().unwrap());
        assert_eq!(counts.sum::<u64>(), particles().len() as u64);
    }
    assert!(
        text(folder, &["probe", "box.csv", "--histogram", "temperature"]).contains("histogram of temperature in K")
    );

    let said = text(folder, &["select", "box.df", "--at", "named.csv#0", "-o", "large.ids"]);
    assert!(said.starts_with(&format!("{large} particles")), "{said}");
    text(folder, &["select", "box.csv", "--ids", "large.ids", "-o", "large.csv"]);
    let rows = std::fs::read_to_string(folder.join("large.csv")).unwrap();
    assert_eq!(rows.lines().count() as u64, large + 1);
    let said = text(folder, &["probe", "box.csv", "--ids", "large.ids"]);
    assert!(said.contains(&format!("{large} particles with one of ")), "{said}");
    text(folder, &["select", "box.df", "--box", "-1,-1,-1,40,40,40", "--family", "dark", "-o", "corner.parquet"]);
    assert!(std::fs::read(folder.join("corner.parquet")).unwrap().ends_with(b"PAR1"));

    let list = text(folder, &["catalogue", "named.csv"]);
    assert!(list.find("Large").unwrap() < list.find("Small").unwrap(), "{list}");
    assert_eq!(json(&["catalogue", "named.csv", "--json", "-"])["objects"][0]["name"], "Large");
}

#[test]
fn a_page_file_without_its_source_says_so() {
    let folder = folder();
    let folder = folder.path();
    std::fs::remove_file(folder.join("box.csv")).unwrap();
    let output = run(folder, &["select", "box.df", "--sphere", "50,50,50,20", "-o", "large.csv"]);
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && said.contains("without ids"), "{said}");
    assert!(error(folder, &["select", "box.df", "-o", "all.ids"]).contains("its source box.csv: not there"));
    assert!(error(folder, &["probe", "box.df", "--exact"]).contains("its source box.csv: not there"));
    std::fs::write(folder.join("box.csv"), "id,x,y,z\n1,2,3,4\n").unwrap();
    assert!(error(folder, &["probe", "box.df", "--exact"]).contains("bytes"));
}

#[test]
fn what_is_wrong_is_named() {
    let folder = folder();
    let folder = folder.path();
    std::fs::write(folder.join("wrong.ron"), "(shapes: [Sphere(center: (0, 0, 0), radios: 1)])").unwrap();
    for (arguments, parts) in [
        (&["probe", "box.csv", "--where", "colour:1..2"][..], ["box.csv", "colour"]),
        (&["probe", "box.csv", "--region", "wrong.ron"], ["wrong.ron:1:", "radios"]),
        (&["probe", "box.csv", "--at", "named.csv#7"], ["named.csv", "#7"]),
        (&["probe", "box.csv", "--at", "named.csv#Nobody"], ["named.csv", "Nobody"]),
        (&["probe", "box.csv", "--at", "nowhere.csv#0"], ["nowhere.csv", "No such file"]),
        (&["probe", "box.csv", "--profile", "3"], ["profile", "sphere"]),
        (&["probe", "box.csv", "--radius", "3"], ["--radius", "--at"]),
        (&["select", "box.csv", "-o", "out.txt"], ["out.txt", ".parquet"]),
        (&["select", "box.csv", "--ids", "named.csv", "-o", "out.csv"], ["named.csv: line 1", "name"]),
        (&["select", "box.csv", "-o", "no/where.csv"], ["no/where.csv", "found no folder no,"]),
        (&["probe", "box.csv", "--family", "gaz"], ["box.csv", "gaz"]),
        (&["catalogue", "box.df"], ["box.df", ""]),
        (&["catalogue", "box.csv"], ["box.csv", "name"]),
    ] {
        let message = error(folder, arguments);
        assert!(parts.iter().all(|part| message.contains(part)), "{arguments:?}: {message}");
    }
    for wrong in [
        &["probe", "box.csv", "--sphere", "1,2,3"][..],
        &["probe", "box.csv", "--where", "mass"],
        &["probe", "box.csv", "--family", "Gaz"],
        &["probe", "box.csv", "--object", "Large"],
        &["select", "box.csv", "--ids", "a", "--sphere", "1,2,3,4", "-o", "b.csv"],
        &["select", "box.csv"],
    ] {
        assert_eq!(run(folder, wrong).status.code(), Some(2), "{wrong:?}");
    }
}

/// Without a display `view` writes a picture under a name that nobody has said.
#[test]
fn a_picture_without_a_name_replaces_no_image() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    std::fs::write(folder.join("stars.csv"), "x,y,z\n0,0,0\n1,2,3\n").unwrap();
    let said = |of: &[&str]| {
        let mut view = program();
        view.arg("view").args(of).args(["--backend", "cpu", "--size", "32x24"]).current_dir(folder);
        view.env("XDG_CACHE_HOME", folder).env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY");
        String::from_utf8(view.output().unwrap().stdout).unwrap()
    };
    let first = said(&["stars.csv"]);
    assert!(first.ends_with(": the picture is in stars.png\n"), "{first}");
    let image = std::fs::read(folder.join("stars.png")).unwrap();
    let second = said(&["stars.png"]);
    assert!(second.ends_with(": the picture is in stars.picture.png\n"), "{second}");
    assert!(folder.join("stars.picture.png").is_file());
    // Nor one that is laid over what is shown.
    std::fs::write(
        folder.join("dem.asc"),
        "ncols 3\nnrows 3\nxllcorner 0\nyllcorner 0\ncellsize 1\n1 2 1\n2 4 3\n1 2 2\n",
    )
    .unwrap();
    std::fs::copy(folder.join("stars.png"), folder.join("dem.png")).unwrap();
    let over = said(&["dem.asc", "--texture", "dem.png"]);
    assert!(over.ends_with(": the picture is in dem.picture.png\n"), "{over}");
    for kept in ["stars.png", "dem.png"] {
        assert_eq!(std::fs::read(folder.join(kept)).unwrap(), image, "{kept}");
    }
}

/// Who reads standard output may have seen enough of it: that is no failure, and no panic.
#[test]
#[cfg(unix)]
fn what_is_said_may_be_read_in_part() {
    let folder = tempfile::tempdir().unwrap();
    let mut table = "name,x,y,z\n".to_owned();
    (0..20_000).for_each(|i| _ = writeln!(table, "object {i},{i},0,0"));
    std::fs::write(folder.path().join("named.csv"), table).unwrap();
    for arguments in [&["catalogue", "named.csv", "--json", "-"][..], &["key", "show.key"]] {
        // Nobody reads from the beginning.
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let done = program().args(arguments).current_dir(folder.path()).stdout(writer).output().unwrap();
        let said = String::from_utf8_lossy(&done.stderr);
        assert!(done.status.success() && said.is_empty(), "{arguments:?}: {said}");
    }
}
