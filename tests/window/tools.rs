//! Tools of the window beside those of `looking`: lassos, boxes and named objects, selections alone and in Parquet, presets,
//! periodic boxes and number keys, driven as a user would under a virtual X server.

use super::desktop::{Desktop, Program, choose, click, columns, distance, keep, middle, point, repeat, repeat_flight};
use crate::support::{demo, in_repository};
use serde_json::Value;
use std::path::Path;
use std::time::Duration;

const CONTROL: u32 = 0xffe3;
/// Wide enough for both docks, and as high as they like it.
const SIZE: [u16; 2] = [960, 720];

/// A folder of assets of the test's own: what is saved there changes nothing in the repository.
fn copy_assets(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap().map(Result::unwrap) {
        let target = to.join(entry.file_name());
        match entry.file_type().unwrap().is_dir() {
            true => copy_assets(&entry.path(), &target),
            false => drop(std::fs::copy(entry.path(), target).unwrap()),
        }
    }
}

fn triple(value: &Value) -> [f64; 3] {
    [0, 1, 2].map(|k| value[k].as_f64().unwrap())
}

fn selections(status: &Value) -> usize {
    status["settings"]["selections"].as_array().map_or(0, Vec::len)
}

fn shapes(status: &Value, selection: usize) -> &Value {
    &status["settings"]["selections"][selection]["members"]["Region"]["shapes"][0]
}

#[test]
fn lassos_boxes_objects_presets_and_keys_do_what_they_say() {
    let folder = tempfile::tempdir().unwrap();
    let desktop = Desktop::with_screen(SIZE);
    copy_assets(&in_repository("assets"), &folder.path().join("assets"));
    let data = folder.path().join("box.hdf5");
    std::fs::copy(demo(), &data).unwrap();
    let names = folder.path().join("names.csv");
    std::fs::write(&names, "name,x,y,z,radius,mass\nGreat,29.16,35.0,27.36,1.5,9\nLesser,10,12,14,2,1\n").unwrap();
    let arguments = ["--backend", "cpu", "--labels", names.to_str().unwrap()];
    let variables = [("BEVY_ASSET_ROOT", folder.path())];
    let mut program = Program::open_with(&desktop, folder.path(), &data, SIZE, &arguments, &variables);
    let first = program.wait("a converged picture", |status| status["converged"] == true);
    desktop.focus(desktop.window().expect("a window of the size that was asked for"));
    let middle = middle(&first);
    let at = |x: i16, y: i16| [middle[0] + x, middle[1] + y];

    // The catalogue's objects are listed, narrowed by what is typed, probed and flown to.
    program.wait("the catalogue", |s| s["looking"]["objects"] == 2 && s["controls"]["object:1:fly"].is_array());
    keep(&desktop, "objects.png");
    let search = || {
        desktop.click(program.reveal(&desktop, "objects:search"));
        std::thread::sleep(Duration::from_millis(500));
        desktop.press_with(&[CONTROL], u32::from('a'));
        desktop.type_text("less");
    };
    repeat(&program, "a search", search, |s| {
        s["controls"]["object:0:fly"].is_array() && s["controls"]["object:1:fly"].is_null()
    });
    let probed = click(&program, &desktop, "object:0:probe", |s| s["looking"]["probe"]["sphere"][1] == 2.0);
    assert_eq!(triple(&probed["looking"]["probe"]["sphere"][0]), [10.0, 12.0, 14.0]);
    let fly = || desktop.click(program.reveal(&desktop, "object:0:fly"));
    repeat_flight(&program, "a flight", fly, |s| distance(point(s, "target"), [10.0, 12.0, 14.0]) < 1e-6);

    // The view is kept on a key, left with the key that shows all, and flown back to.
    let key = |held: &[u32], key: char| desktop.press_with(held, u32::from(key));
    let rest = || desktop.click(at(0, 0));
    rest();
    let kept = repeat(&program, "Ctrl+3", || key(&[CONTROL], '3'), |s| s["looking"]["bookmarks"][0][0] == 3);
    let eye = triple(&kept["looking"]["bookmarks"][0][1]);
    let away = |s: &Value| s["converged"] == true && distance(point(s, "eye"), eye) > 5.0;
    let home = || repeat_flight(&program, "the whole", || desktop.press(0xff50), away);
    home();
    repeat_flight(&program, "the key 3", || key(&[], '3'), |s| distance(point(s, "eye"), eye) < 1e-6);
    home();

    // A box and a lasso are drawn, and kept.
    click(&program, &desktop, "tool:Box", |s| s["looking"]["tool"] == "Box");
    let boxed = |s: &Value| s["looking"]["probe"].is_object() && s["looking"]["probe"]["sphere"].is_null();
    repeat(&program, "a box", || desktop.drag(middle, at(28, 0)), boxed);
    click(&program, &desktop, "keep", |s| selections(s) == 1);
    assert!(shapes(&program.status(), 0)["Box"].is_object(), "{:#}", program.status()["settings"]["selections"]);
    click(&program, &desktop, "clear-probe", |s| s["looking"]["probe"].is_null());
    click(&program, &desktop, "tool:Lasso", |s| s["looking"]["tool"] == "Lasso");
    let lasso = || desktop.stroke(&[at(-44, -34), at(40, -38), at(50, 34), at(-34, 44), at(-44, -34)]);
    let drawn = repeat(&program, "a lasso", lasso, |s| s["looking"]["probe"].is_object());
    let inside = drawn["looking"]["probe"]["count"].as_u64().unwrap();
    keep(&desktop, "lasso.png");
    click(&program, &desktop, "keep", |s| selections(s) == 2);
    assert!(shapes(&program.status(), 1)["Lasso"].is_object(), "{:#}", program.status()["settings"]["selections"]);

    // Its table is read back: every row is of the source, and seen inside the lasso.
    let written = click(&program, &desktop, "selection:1:Parquet", |s| s["looking"]["table"].is_object());
    let table = &written["looking"]["table"];
    let path = Path::new(table["path"].as_str().unwrap());
    let selected = deepfield::import::open(path).unwrap();
    let rows = selected.description().particles();
    assert_eq!(Some(rows), table["rows"].as_u64());
    assert!(rows.abs_diff(inside) <= 2 + inside / 500, "{rows} of {inside}");
    let dataset = deepfield::import::load(&data, &deepfield::import::LoadOptions::default(), &()).unwrap();
    let known: std::collections::HashSet<[u64; 3]> =
        dataset.families[0].positions.iter().map(|at| at.map(f64::to_bits)).collect();
    let mut positions = vec![0.0; 3 * rows as usize];
    selected.read(0, 0, 0..rows, &mut positions).unwrap();
    assert!(positions.as_chunks::<3>().0.iter().all(|at| known.contains(&at.map(f64::to_bits))));

    // Alone, nothing else is left of the picture.
    program.wait("a picture that rests", |s| s["converged"] == true);
    let alone = |s: &Value| s["settings"]["selections"][1]["show"] == "alone";
    let shown = choose(&program, &desktop, "selection:1:show", "selection:1:show:alone", alone);
    let left = columns(&shown);
    let beside = left.start + 40..left.start + 60;
    desktop.wait("only the selection", |screen| {
        screen.share(beside.clone(), |pixel| pixel.iter().all(|c| *c < 12)) > 0.98
    });
    keep(&desktop, "alone.png");
    let undo = || desktop.press_with(&[CONTROL], u32::from('z'));
    rest();
    repeat(&program, "undo", undo, |s| s["settings"]["selections"][1]["show"] == "highlighted");

    // The periodic box is drawn wrapped.
    let wrapped = |s: &Value| s["settings"]["cut"]["periodic"] == "wrapped";
    choose(&program, &desktop, "periodic-box", "periodic:wrapped", wrapped);

    // The colours are saved as a preset of another name.
    click(&program, &desktop, "preset:save-as", |s| s["controls"]["preset:name"].is_array());
    let enter = || {
        desktop.click(program.reveal(&desktop, "preset:name"));
        std::thread::sleep(Duration::from_millis(500));
        desktop.press_with(&[CONTROL], u32::from('a'));
        desktop.type_text("mine");
        std::thread::sleep(Duration::from_millis(500));
        desktop.click(program.reveal(&desktop, "preset:name:save"));
        std::thread::sleep(Duration::from_millis(1500));
        // A name of which a key was lost is another preset; one begins again.
        if program.status()["controls"]["preset:name"].is_null() {
            desktop.click(program.reveal(&desktop, "preset:save-as"));
            std::thread::sleep(Duration::from_millis(500));
        }
    };
    let preset = folder.path().join("assets/transfer/mine.ron");
    repeat(&program, "a preset", enter, |_| preset.is_file());
    let text = std::fs::read_to_string(&preset).unwrap();
    deepfield::color::transfer::TransferFunction::parse(&text, "mine.ron").unwrap();
    keep(&desktop, "tools.png");
}
