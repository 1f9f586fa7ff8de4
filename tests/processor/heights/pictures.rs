//! Pictures of measured heights show the surface and nothing but it.

use super::{AMPLITUDE, SIZE, doubles, height, refused, waves, written};
use crate::support::golden::{difference, picture_at};
use crate::support::{json, ok};
use deepfield::color::composite::Image;
use deepfield::color::output::write_png;
use serde_json::Value;

#[test]
fn pictures_show_the_surface_and_what_was_not_measured_stays_open() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    waves(folder);
    ok(folder, &["build", "waves.npy", "-o", "waves.df", "--spacing", "1,1"]);
    let camera =
        ["--eye", "165,145,400", "--target", "165,145,0", "--up", "0,1,0", "--ortho", "260", "--size", "240x160"];
    for technique in ["rays", "triangles", "hybrid"] {
        let setting = format!("technique={technique}");
        let arguments =
            ["render", "waves.df", "-o", "top.png", "--raw", "top.npy", "--json", "top.json", "--set", &setting];
        ok(folder, &[&arguments[..], &camera].concat());
        let channels = doubles(&folder.join("top.npy"));
        let (mut hits, mut holes) = (0, 0);
        for (index, [_, x, y, z, row, column, coverage]) in channels.as_chunks::<7>().0.iter().copied().enumerate() {
            // The camera looks straight down: what a pixel shows is below it.
            let [i, j] = [(index % 240) as f64 + 0.5, (index / 240) as f64 + 0.5];
            let at = [165.0 + (i - 120.0) * 260.0 / 160.0, 145.0 - (j - 80.0) * 260.0 / 160.0];
            let away = (at[0] - 150.0).hypot(at[1] - 120.0);
            if coverage > 0.0 {
                hits += 1;
                let reach = if technique == "hybrid" { 2.5 } else { 1.4 };
                assert!((x - at[0]).hypot(y - at[1]) < reach, "{technique}: {x}, {y} at {at:?}");
                assert!((row - y).abs() < 1e-9 && (column - x).abs() < 1e-9);
                assert!(z.abs() <= AMPLITUDE * 1.001);
                assert!(away > 38.0 || (x / 16.0).fract() < 1e-9, "{technique}: {at:?} was not measured");
            } else if away < 40.0 {
                holes += 1;
            }
        }
        assert!(hits > 30_000 && holes > 1000, "{technique}: {hits} pixels, {holes} in the hole");
        let told: Value = serde_json::from_slice(&std::fs::read(folder.join("top.json")).unwrap()).unwrap();
        assert!(told["converged"] == true && told["error_px"].as_f64().unwrap() <= 0.8, "{told:#}");
    }
    // What may take little memory is coarser, and says so.
    for (memory, is_converged) in [("64MiB", true), ("300000", false)] {
        let arguments =
            ["render", "waves.df", "-o", "x.png", "--json", "top.json", "--error-px", "0.01", "--memory", memory];
        ok(folder, &[&arguments[..], &camera].concat());
        let told: Value = serde_json::from_slice(&std::fs::read(folder.join("top.json")).unwrap()).unwrap();
        assert_eq!(told["converged"], is_converged, "{memory}: {told:#}");
    }
    // A dome from within, another colour, lines of equal height: each is a picture of something else.
    let pictures: Vec<Vec<[u8; 4]>> = [
        &["--attribute", "slope"][..],
        &["--set", "contours=5.0"],
        &["--set", "exaggeration=4.0", "--set", "light=eye"],
        &["--projection", "dome", "--eye", "165,145,60", "--target", "165,300,60", "--up", "0,0,-1"],
    ]
    .into_iter()
    .map(|more| {
        ok(folder, &[&["render", "waves.df", "-o", "x.png", "--size", "160x160"], more].concat());
        picture_at(&folder.join("x.png")).rgba
    })
    .collect();
    for (number, picture) in pictures.iter().enumerate() {
        let lit = picture.iter().filter(|pixel| pixel[..3].iter().any(|part| *part > 20)).count();
        assert!(lit > 4000, "picture {number}: {lit} pixels");
        assert!(pictures[..number].iter().all(|other| other != picture));
    }
    refused(
        folder,
        &["render", "waves.df", "-o", "x.png", "--mode", "volume"],
        "waves.df: mode volume does not draw heights, expected surface",
    );
    refused(folder, &["render", "waves.df", "-o", "x.png", "--attribute", "mass"], "attribute mass is not in the data");
    // Names that cannot be read are told before heights are: these are cut short, and others would be built first.
    let short = std::fs::read(folder.join("waves.npy")).unwrap()[..4000].to_vec();
    std::fs::write(folder.join("short.npy"), short).unwrap();
    std::fs::write(folder.join("towns.csv"), "town,east,north\nA,1,2\n").unwrap();
    refused(folder, &["render", "short.npy", "-o", "x.png", "--labels", "towns.csv"], "towns.csv: ");
}

/// A slab leaves out what lies beside it, and what is far fades, in each pixel, whatever is drawn.
#[test]
fn slabs_cut_surfaces_and_surfaces_fade() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    // As high as it is far to the right: from 400 above, depth is 400 - x.
    written(&folder.join("ramp.npy"), [81, 61], |column, _| column as f64);
    ok(folder, &["build", "ramp.npy", "-o", "ramp.df", "--spacing", "1,1"]);
    let camera = ["--eye", "40,30,400", "--target", "40,30,0", "--up", "0,1,0", "--ortho", "60", "--size", "80x60"];
    for (axis, low, high) in [("x", 20.0, 40.0), ("y", 6.0, 14.0), ("z", 40.0, 70.0)] {
        let (middle, thickness): (f64, f64) = (0.5 * (low + high), high - low);
        let slab = format!("slab: (axis: {axis}, middle: {middle:?}, thickness: {thickness:?})");
        let config = format!("(mode: \"surface\", cut: ({slab}, fade: (start: 340.0, length: 40.0)))");
        std::fs::write(folder.join("cut.ron"), config).unwrap();
        for technique in ["hybrid", "triangles", "rays"] {
            let setting = format!("technique={technique}");
            let arguments = ["render", "ramp.df", "--config", "cut.ron", "--set", &setting, "--backend", "cpu"];
            let files = ["-o", "top.png", "--raw", "top.npy", "--background", "transparent"];
            ok(folder, &[&arguments[..], &files, &camera].concat());
            let (picture, raw) = (picture_at(&folder.join("top.png")), doubles(&folder.join("top.npy")));
            // Not at the border, where other samples of a pixel may be beside the field.
            for (i, j) in (1..59).flat_map(|j| (1..79).map(move |i| (i, j))) {
                let (x, y) = (i as f64 + 0.5, 59.5 - j as f64);
                let is_kept = (low..=high).contains(if axis == "y" { &y } else { &x });
                let fades = (-(400.0 - x - 340.0).max(0.0) / 40.0).exp();
                let expected = if is_kept { 255.0 * fades } else { 0.0 };
                let (alpha, depth) = (f64::from(picture.rgba[j * 80 + i][3]), raw[7 * (j * 80 + i)]);
                assert!((alpha - expected).abs() < 1.0, "{technique}, {axis}: {alpha}, not {expected}, at {x}, {y}");
                assert_eq!(depth.is_nan(), !is_kept, "{technique}, {axis}: {depth} at {x}, {y}");
                assert!(!is_kept || (depth + x - 400.0).abs() < 0.01, "{technique}, {axis}: {depth} at {x}, {y}");
            }
        }
    }
}

/// What has changed since an earlier field is the colour of the later one, and nothing else of it changes.
#[test]
fn differences_lie_over_the_later_surface() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let rise = |column: usize| match column {
        0..100 => 4.0,
        100..230 => 0.0,
        _ => -4.0,
    };
    written(&folder.join("after.npy"), SIZE, |column, row| height(column, row) + rise(column));
    written(&folder.join("before.npy"), SIZE, |column, row| {
        let away = (column as f64 - 280.0).hypot(row as f64 - 60.0);
        if away < 20.0 { f64::NAN } else { height(column, row) }
    });
    for name in ["before", "after"] {
        let built = format!("{name}.df");
        ok(folder, &["build", &format!("{name}.npy"), "-o", &built, "--spacing", "1,1"]);
    }
    let camera =
        ["--eye", "165,145,400", "--target", "165,145,0", "--up", "0,1,0", "--ortho", "260", "--size", "240x160"];
    let drawn = |more: &[&str]| {
        let arguments = ["-o", "top.png", "--raw", "top.npy", "--json", "top.json", "--set", "ambient=1.0"];
        ok(folder, &[&["render"], more, &arguments, &camera].concat());
        let told: Value = serde_json::from_slice(&std::fs::read(folder.join("top.json")).unwrap()).unwrap();
        (picture_at(&folder.join("top.png")).rgba, std::fs::read(folder.join("top.npy")).unwrap(), told)
    };
    let (own, raw, _) = drawn(&["after.df"]);
    let (changed, same_raw, told) = drawn(&["after.df", "--before", "before.df"]);
    assert!(raw == same_raw && own != changed);
    assert_eq!(told["range"], serde_json::json!([-4.0, 4.0]));
    let at = |[column, row]: [f64; 2]| {
        let [x, y] = [120.0 + (column - 165.0) * 160.0 / 260.0, 80.0 - (row - 145.0) * 160.0 / 260.0];
        changed[y as usize * 240 + x as usize]
    };
    let ([higher, _, low, _], [blue, _, lower, _]) = (at([50.0, 145.0]), at([290.0, 145.0]));
    assert!(higher > low.saturating_add(60) && lower > blue.saturating_add(60), "{higher} {low}, {blue} {lower}");
    let [red, green, blue, _] = at([165.0, 145.0]);
    assert!(red.min(green).min(blue) > 200, "{red} {green} {blue}");
    let [red, green, blue, _] = at([280.0, 60.0]);
    assert!(red == green && green == blue && red < 180, "not known: {red} {green} {blue}");
    // A source, a scene and the attribute's name say the same.
    let scene = "(version: 1, datasets: [(path: \"after.df\", before: \"before.df\")])";
    std::fs::write(folder.join("change.scene.ron"), scene).unwrap();
    assert!(drawn(&["after.npy", "--before", "before.npy"]).0 == changed);
    assert!(drawn(&["after.df", "--before", "before.df", "--attribute", "difference"]).0 == changed);
    assert!(drawn(&["change.scene.ron", "--mode", "surface"]).0 == changed);
    assert!(drawn(&["after.df", "--before", "before.df", "--attribute", "height"]).0 == own);
    refused(
        folder,
        &["render", "after.df", "-o", "x.png", "--attribute", "difference"],
        "after.df: attribute difference: found no earlier heights to compare with, expected some (--before FILE)",
    );
    ok(folder, &["build", "before.npy", "-o", "degrees.df", "--xy-unit", "deg", "--spacing", "1,1"]);
    refused(
        folder,
        &["render", "after.df", "-o", "x.png", "--before", "degrees.df"],
        "after.df and degrees.df: unit of x and y: found no unit and deg",
    );
    // Spacings count in probes and lines as they do in builds.
    let told = json(folder, &["probe", "after.npy", "--spacing", "2,3", "--point", "40,30", "--json", "-"]);
    assert_eq!(told["height"].as_f64(), Some(height(20, 10) + 4.0));
}

/// An eye below ground is lifted and looks the same way, and one that is high enough stays.
#[test]
fn eyes_stay_above_ground() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    written(&folder.join("flat.npy"), [40, 30], |_, _| 7.0);
    ok(folder, &["build", "flat.npy", "-o", "flat.df", "--spacing", "1,1"]);
    let eye = |z: &str, settings: &[&str]| {
        let (eye, target) = (format!("20,15,{z}"), format!("20,25,{z}"));
        let arguments = ["render", "flat.df", "-o", "x.png", "--json", "-", "--eye", &eye, "--target", &target];
        json(folder, &[&arguments[..], &["--size", "60x40"], settings].concat())["eye"].clone()
    };
    assert_eq!(eye("-5", &["--set", "clearance=2.0"]), serde_json::json!([20.0, 15.0, 9.0]));
    let twice = ["--set", "clearance=2.0", "--set", "exaggeration=2.0"];
    assert_eq!(eye("-5", &twice), serde_json::json!([20.0, 15.0, 16.0]));
    assert!(eye("9.5", &["--set", "clearance=2.0"]).is_null() && eye("-5", &[]).is_null());
    // Pictures of numbers have the channels of what is seen, all around as well.
    for more in [["--fov", "40"], ["--projection", "dome"]] {
        let arguments =
            ["render", "flat.df", "-o", "x.exr", "--eye", "20,15,9", "--target", "20,25,7", "--size", "24x24"];
        ok(folder, &[&arguments[..], &more].concat());
        let bytes = std::fs::read(folder.join("x.exr")).unwrap();
        for name in ["R", "depth", "height", "coverage"] {
            assert!(
                bytes.windows(name.len() + 1).any(|part| part.strip_suffix(b"\0") == Some(name.as_bytes())),
                "{name} {more:?}"
            );
        }
    }
    // What is under a pixel is so of the same eye.
    let pixels =
        ["probe", "flat.df", "--pixel", "30,30", "--eye", "20,15,-5", "--target", "20,25,-5", "--size", "60x40"];
    std::fs::write(folder.join("c.ron"), "(mode: \"surface\", settings: {\"clearance\": 2.0})").unwrap();
    let told = json(folder, &[&pixels[..], &["--config", "c.ron", "--json", "-"]].concat());
    assert_eq!(told["picks"][0]["height"].as_f64(), Some(7.0), "{told:#}");
}

#[test]
fn photos_lie_over_surfaces() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    waves(folder);
    // Four squares: red and green in the first rows, blue and white in the last ones.
    let colors = [[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [255; 4]];
    let rgba = (0..64 * 64).map(|at| colors[at / 64 / 32 * 2 + at % 64 / 32]).collect();
    write_png(&folder.join("photo.png"), &Image { width: 64, height: 64, rgba }).unwrap();
    ok(folder, &["build", "waves.npy", "-o", "waves.df", "--spacing", "1,1", "--texture", "photo.png"]);
    ok(folder, &["verify", "waves.df"]);
    let told = json(folder, &["info", "waves.df", "--json"]);
    let corners = serde_json::json!([[0.0, 0.0], [330.0, 289.0]]);
    let plane =
        serde_json::json!({ "name": "texture", "columns": 64, "rows": 64, "source": "photo.png", "corners": corners });
    assert_eq!(told["planes"], serde_json::json!([plane]));
    let text = String::from_utf8(ok(folder, &["info", "waves.df"]).stdout).unwrap();
    assert!(text.contains("photo (texture): 64 x 64 pixels of photo.png, from 0, 0 to 330, 289"), "{text}");
    let camera = ["--eye", "165,145,400", "--target", "165,145,0", "--up", "0,1,0", "--ortho", "260"];
    let drawn = |more: &[&str]| {
        let arguments = ["-o", "top.png", "--size", "240x160", "--set", "ambient=1.0"];
        ok(folder, &[&["render"], more, &arguments, &camera].concat());
        picture_at(&folder.join("top.png")).rgba
    };
    let own = drawn(&["waves.df"]);
    // y goes up, and rows with it.
    for (at, expected) in [([60, 120], 0), ([180, 120], 1), ([60, 40], 2), ([180, 40], 3)] {
        assert_eq!(own[at[1] * 240 + at[0]][..3], colors[expected][..3], "{at:?}");
    }
    assert_eq!(drawn(&["waves.df", "--attribute", "texture"]), own);
    assert_eq!(drawn(&["waves.npy", "--texture", "photo.png"]), own);
    assert_ne!(drawn(&["waves.df", "--attribute", "height"]), own);
    let part = drawn(&["waves.npy", "--texture", "photo.png@165,0,331,145"]);
    assert_eq!([&part[120 * 240 + 60][..3], &part[40 * 240 + 60][..3]].concat(), [188; 6]);
    assert_eq!(part[150 * 240 + 130][..3], colors[0][..3]);
    // Another file of the built one has it, too.
    ok(folder, &["build", "waves.df", "-o", "again.df"]);
    assert_eq!(drawn(&["again.df"]), own);
    let build = ["build", "waves.npy", "-o", "x.df", "--texture"];
    refused(folder, &[&build[..], &["none.png"]].concat(), "none.png: ");
    refused(folder, &[&build[..], &["photo.png@900,0,950,10"]].concat(), "photo.png: --texture: found a rectangle");
    let again = ["build", "waves.df", "-o", "x.df", "--texture", "photo.png"];
    refused(folder, &again, "waves.df: --texture: found a page file");
    refused(folder, &["build", "photo.png", "-o", "x.df", "--texture", "photo.png"], "--texture: found no heights");
}

#[test]
fn depth_decides_among_heights_and_other_data() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let rows: Vec<String> = (0..19).map(|row| vec![(row * 100).to_string(); 37].join(" ")).collect();
    let head = "ncols 37\nnrows 19\nxllcenter -180\nyllcenter -90\ncellsize 10\n";
    std::fs::write(folder.join("globe.asc"), format!("{head}{}\n", rows.join("\n"))).unwrap();
    ok(folder, &["build", "globe.asc", "-o", "globe.df", "--xy-unit", "deg", "--height-unit", "m"]);
    let radius = 1_737_400.0;
    for (name, share) in [("behind.csv", 0.5), ("before.csv", -0.6)] {
        let [x, z] = [4.0 * share * radius, -1.5 * share * radius];
        std::fs::write(folder.join(name), format!("x [m],y [m],z [m],mag\n{x},0,{z},-1\n")).unwrap();
    }
    let eye = format!("{},0,{}", -4.0 * radius, 1.5 * radius);
    let camera = ["--eye", &eye, "--target", "0,0,0", "--map", "globe:moon", "--size", "240x160", "--backend", "cpu"];
    let picture = |more: &[&str]| {
        ok(folder, &[&["render", "globe.df", "-o", "a.png"][..], more, &camera].concat());
        picture_at(&folder.join("a.png"))
    };
    let plain = picture(&[]);
    let changed = |image: &deepfield::color::Image| {
        let differs = |(a, b): (&[u8; 4], &[u8; 4])| (0..3).any(|k| a[k].abs_diff(b[k]) > 1);
        image.rgba.iter().zip(&plain.rgba).filter(|pair| differs(*pair)).count()
    };
    assert_eq!(changed(&picture(&["--with", "behind.csv"])), 0);
    assert!((5..100).contains(&changed(&picture(&["--with", "before.csv"]))));
    // The other way round particles are what the picture is about; heights keep their settings.
    let set = ["--set", "exaggeration=3.0", "--set", "radius=4.0"];
    let what = ["render", "before.csv", "--with", "globe.df", "-o", "b.png", "--json", "b.json"];
    let more = [&what[..], &set, &camera];
    ok(folder, &more.concat());
    let told: Value = serde_json::from_slice(&std::fs::read(folder.join("b.json")).unwrap()).unwrap();
    assert_eq!((&told["mode"], &told["particles_drawn"]), (&"points".into(), &1.into()));
    assert!(told["surface"]["covered"].as_f64().unwrap() > 1000.0, "{told}");
    let cartesian = ["render", "globe.df", "--with", "behind.csv", "-o", "c.png", "--mode", "cartesian"];
    refused(folder, &[&cartesian[..], &camera].concat(), "mode: found cartesian");
}

/// On the way between two keyframes the light, the exaggeration and the lines change: each shows, and a frame is made again from its scene.
#[test]
fn tours_change_light_exaggeration_and_lines() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    written(&folder.join("waves.npy"), [81, 61], height);
    let tour = r#"(
    version: 1,
    dataset: (path: "waves.npy", xy_unit: "m", height_unit: "m"),
    size: (64, 48),
    rate: 4.0,
    keyframes: [
        (mode: "surface", around: (what: data, elevation: 45.0),
            settings: {"light": "sun", "azimuth": 300.0, "altitude": 40.0, "exaggeration": 1.0, "contours": 5.0}),
        (after: 1.0, easing: linear, settings: {"azimuth": 60.0, "altitude": 20.0, "exaggeration": 4.0, "contours": 10.0}),
    ],
)"#;
    std::fs::write(folder.join("waves.ron"), tour).unwrap();
    ok(folder, &["tour", "waves.ron", "--record", "frames"]);
    let scene = "frames/scenes/frame-00002.scene.ron";
    let text = std::fs::read_to_string(folder.join(scene)).unwrap();
    // Half-way, of what is a factor by equal factors.
    for setting in ["\"azimuth\": 180.0", "\"altitude\": 30.0", "\"exaggeration\": 2.0", "\"contours\": 7.5"] {
        assert!(text.contains(setting), "{setting}: {text}");
    }
    let again = |more: &[&str]| {
        ok(folder, &[&["render", scene, "--backend", "cpu", "-o", "again.png"][..], more].concat());
        picture_at(&folder.join("again.png"))
    };
    let frame = picture_at(&folder.join("frames/frame-00002.png"));
    assert!(again(&[]) == frame);
    for begins in ["azimuth=300.0", "altitude=40.0", "exaggeration=1.0", "contours=5.0"] {
        assert!(again(&["--set", begins]) != frame, "{begins}");
    }
}

/// x and y that look like degrees are so in pictures of a page file as in those of its source, and numbers are those of the file.
#[test]
fn page_files_without_a_unit_are_drawn_as_their_sources_are() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let (columns, rows) = (400, 300);
    let line = |row: usize| {
        let heights = (0..columns).map(|column| format!("{:.2}", 650.0 + 20.0 * height(column, row)));
        heights.collect::<Vec<_>>().join(" ")
    };
    let head = format!("ncols {columns}\nnrows {rows}\nxllcorner -84.41\nyllcorner 36.73\ncellsize {}", 1.0 / 1200.0);
    let lines: Vec<String> = (0..rows).map(line).collect();
    std::fs::write(folder.join("hills.asc"), format!("{head}\n{}\n", lines.join("\n"))).unwrap();
    ok(folder, &["build", "hills.asc", "-o", "hills.df"]);
    ok(folder, &["build", "hills.asc", "-o", "metres.df", "--xy-unit", "m"]);
    let drawn = |name: &str| {
        let size = ["--size", "80x60", "--attribute", "slope"];
        let output = ok(folder, &[&["render", name, "-o", "x.png"][..], &size].concat());
        (picture_at(&folder.join("x.png")), String::from_utf8(output.stderr).unwrap())
    };
    let [(source, told), (built, told_again), (metres, other)] = ["hills.asc", "hills.df", "metres.df"].map(drawn);
    let found = difference(&built, &source);
    assert!(found < 1.0, "{found} of 255");
    assert!(difference(&metres, &source) > 20.0);
    let taken = "heights 800.0 apart, and count as degrees in pictures: --xy-unit m if they are metres";
    let is_told = |told: &str, end: &str| told.contains(&format!("{taken}{end}\n")) && !told.contains("--xy-unit deg");
    assert!(is_told(&told, "") && is_told(&told_again, ", when it is built"), "{told}{told_again}");
    assert!(!other.contains("count as degrees"), "{other}");
    let [source, built] =
        ["hills.asc", "hills.df"].map(|name| json(folder, &["probe", name, "--point", "-84.3,36.9", "--json", "-"]));
    assert!(built["slope"].as_f64().unwrap() > 100.0, "{built}");
    assert_eq!((&source["height"], &source["slope"]), (&built["height"], &built["slope"]));
    let told = json(folder, &["info", "hills.df", "--json"]);
    assert_eq!(told["xy_unit"], "");
    assert!(told["notes"].to_string().contains("--xy-unit deg if these are degrees"), "{told}");
}
