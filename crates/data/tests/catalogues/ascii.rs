//! Tables of numbers between blanks: the same as the CSV of these numbers, whoever writes them, and damaged ones are errors or other tables.

use super::{assert_same, file, gzip, ids_of, refused, values, zstandard};
use deepfield_data::import::{formats, open};
use deepfield_data::model::ReadMethod;
use proptest::prelude::*;

/// A number as `%.18e` of numpy has it.
fn numpy(number: f64) -> String {
    match format!("{number:.18e}").split_once('e') {
        Some((digits, exponent)) => format!("{digits}e{:+03}", exponent.parse::<i32>().unwrap()),
        None => "nan".into(),
    }
}

/// Lines that may stand before rows of eight values, of which the last but one names them.
const HEADERS: [&str; 6] = [
    "# x y z vx vy vz mass ID\n",
    "x y z vx vy vz mass ID\n",
    "# made by a script, with 2 settings\n#\n\n#  x y z vx vy vz mass ID\n",
    "\u{feff}#x y z vx vy vz mass ID\n#a = 0.5\n# 1 2 3 4 5 6 7 8\n# one two three four five six seven eight\n",
    "# made by a script\n\n  x   y\tz vx vy vz mass ID\n# units are those of the code\n",
    "#x(1) y(2) z(3) vx(4) vy(5) vz(6) mass(7) ID(8)\n",
];

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn a_table_is_that_of_its_csv(
        rows in prop::collection::vec((prop::array::uniform7(prop_oneof![9 => -1e30..1e30_f64, 1 => Just(f64::NAN)]), any::<u64>()), 1..30),
        header in 0..HEADERS.len(), is_upper in any::<bool>(), has_units in any::<bool>(), packing in 0..3_usize,
        gaps in prop::collection::vec(prop::sample::select(vec![" ", "   ", " \t", "\t \t"]), 9),
        end in prop::sample::select(vec!["\n", "\r\n", " \n", "\t\n\n", " # a comment\n# 1 2 3\n"]),
    ) {
        let named = |text: &str| {
            let text = if is_upper && header != 5 { text.replace("vx vy vz mass", "VX VY VZ MASS") } else { text.to_owned() };
            if has_units { text.replace("mass ID", "mass [1e10 Msun / h] ID").replace("MASS ID", "MASS (1e10 Msun / h) ID") } else { text }
        };
        let (mut text, mut csv) = (named(HEADERS[header]), "x,y,z,vx,vy,vz,mass,ID\n".to_owned());
        if is_upper && header != 5 {
            csv = csv.replace("vx,vy,vz,mass", "VX,VY,VZ,MASS");
        }
        if has_units && header != 5 {
            csv = csv.replace("mass,", "mass [1e10 Msun / h],").replace("MASS,", "MASS [1e10 Msun / h],");
        }
        for (numbers, id) in &rows {
            let words: Vec<String> = numbers.iter().map(|number| numpy(*number)).chain([id.to_string()]).collect();
            text += gaps[8];
            text += &words.iter().zip(&gaps).map(|(word, gap)| format!("{word}{gap}")).collect::<String>();
            text += end;
            csv += &(words.join(",") + "\n");
        }
        let folder = tempfile::tempdir().unwrap();
        let bytes = [text.as_bytes().to_vec(), gzip(text.as_bytes()), zstandard(text.as_bytes())];
        let path = file(folder.path(), "table", &bytes[packing]);
        let csv = file(folder.path(), "table.csv", csv.as_bytes());
        let (found, expected) = (open(&path).unwrap(), open(&csv).unwrap());
        let formats = [&found, &expected].map(|source| source.description().format.clone());
        assert_eq!(formats.each_ref().map(|format| &**format), ["ascii", "csv"]);
        let [about, other] = [&found, &expected].map(|source| source.description());
        assert_eq!((&about.families, &about.length_unit, &about.mass_unit), (&other.families, &other.length_unit, &other.mass_unit));
        for field in &about.families[0].fields {
            assert_same(&values(&*found, &field.name), values(&*expected, &field.name).into_iter(), &field.name);
        }
        assert_eq!(ids_of(&path), ids_of(&csv));
        // Two of them are parts of one table.
        let parts = folder.path().join("parts");
        std::fs::create_dir(&parts).unwrap();
        (0..2).for_each(|part| drop(file(&parts, &format!("{part}.txt"), &bytes[packing])));
        assert_eq!(open(&parts).unwrap().description().families[0].count, 2 * rows.len() as u64);
    }

    /// Whatever is written over a file, and wherever it ends, it is an error of one line or another table, all of which can be read.
    #[test]
    fn damaged_tables_are_errors_or_other_tables(
        header in 0..HEADERS.len(), is_packed in any::<bool>(), cut in 0.0..1.3_f64,
        changes in prop::collection::vec((0.0..1.0_f64, any::<u8>()), 0..8),
    ) {
        let row = |row: u64| format!(" {row} 2.5e+00\t-3 nan 0 1 'two \"three' {row}\n");
        let text = HEADERS[header].to_owned() + &(0..20).map(row).collect::<String>();
        let mut bytes = if is_packed { gzip(text.as_bytes()) } else { text.into_bytes() };
        for (at, byte) in changes {
            let at = (at * bytes.len() as f64) as usize;
            bytes[at] = byte;
        }
        bytes.truncate((cut * bytes.len() as f64) as usize);
        let folder = tempfile::tempdir().unwrap();
        let path = file(folder.path(), "damaged", &bytes);
        let format = formats().into_iter().find(|format| format.name().starts_with("ASCII")).unwrap();
        for opened in [format.open(&path, ReadMethod::default()), open(&path)] {
            match opened {
                Ok(source) => {
                    for field in &source.description().families[0].fields {
                        values(&*source, &field.name);
                    }
                }
                Err(error) => {
                    let text = error.to_string();
                    assert!(!text.contains('\n') && text.contains("damaged"), "{text}");
                }
            }
        }
    }
}

#[test]
fn tables_of_others_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let comments = format!("#Units: Masses in Msun / h\n{}", "# a comment, as consistent-trees has many\n".repeat(200));
    for (name, text, position, other) in [
        // Names in a first comment, and more comments than are looked at to tell the format.
        (
            "rockstar",
            format!("#ID DescID Mvir Rvir X Y Z\n{comments}7 -1 1e12 300 1 2 3\n"),
            [1.0, 2.0, 3.0],
            ("Mvir", 1e12),
        ),
        // A tab behind each value, but none behind the last name.
        (
            "ahf",
            "#ID(1)\tMvir(2)\tXc(3)\tYc(4)\tZc(5)\tVXc(6)\tVYc(7)\tVZc(8)\n3\t1e9\t4\t5\t6\t7\t8\t9\t\n".into(),
            [4.0, 5.0, 6.0],
            ("Mvir", 1e9),
        ),
        // Two lines of counts before names, which are more than are looked at to tell the format.
        (
            "velociraptor",
            format!(
                "0\t1\n1\t1\nID(1) Mvir(2) Xc(3) Yc(4) Zc(5) {}\n7 1e12 1 2 3 {}\n",
                (6..506).map(|number| format!("other{number}({number}) ")).collect::<String>(),
                "0.5 ".repeat(500)
            ),
            [1.0, 2.0, 3.0],
            ("Mvir", 1e12),
        ),
        (
            "numpy",
            format!("# x, y, z, mass\n{} {} {} {}\n", numpy(1.0), numpy(-2e-300), numpy(3e10), numpy(5.0)),
            [1.0, -2e-300, 3e10],
            ("mass", 5.0),
        ),
        (
            "topcat",
            "# name  X    Y   Z  level\n  \"NGC 1\"  1.0  2.0 3.0  \"\"\n  M31  9 9 9  0.5\n".into(),
            [1.0, 2.0, 3.0],
            ("level", f64::NAN),
        ),
        ("units", "# x [kpc] y [pc] z[Mpc] t [1e3 s]\n1 2000 3 4\n".into(), [1.0, 2.0, 3000.0], ("t", 4.0)),
    ] {
        let source = open(&file(folder.path(), name, text.as_bytes())).unwrap();
        assert_eq!(source.description().format, "ascii", "{name}");
        assert_same(&values(&*source, "position")[..3], position.into_iter(), name);
        assert_same(&values(&*source, other.0)[..1], [other.1].into_iter(), name);
    }
    let source = open(&folder.path().join("ahf")).unwrap();
    assert_same(&values(&*source, "velocity"), [7.0, 8.0, 9.0].into_iter(), "velocity");
}

/// Tabs may have nothing between them in CSV.
#[test]
fn values_between_single_tabs_are_csv() {
    let folder = tempfile::tempdir().unwrap();
    let source = open(&file(folder.path(), "t", b"#x\ty\tz\tm\n1\t2\t3\t\n4\t5\t6\t7\n")).unwrap();
    assert_eq!(source.description().format, "csv");
    assert_same(&values(&*source, "mass"), [f64::NAN, 7.0].into_iter(), "mass");
}

#[test]
fn what_is_wrong_with_a_table_is_said() {
    let folder = tempfile::tempdir().unwrap();
    for (text, expected) in [
        (
            "1 2 3\n4 5 6\n",
            "names of columns: missing, expected a line such as # x y z mass before the rows, a name for each of their 3 values",
        ),
        ("# x y z\n1 2 3 4\n", "names of columns: missing"),
        ("# t px py\n1 2 3\n", "positions: missing, expected columns x, y, z"),
        ("# x y z\n", "no particles"),
        ("0 1\n2 2\nID(1) Xc(2) Yc(3) Zc(4)\n7 1 2 3\n8 4 5 z\n", "Zc in line 5: found z, expected a number"),
        (
            "# x y z m\n1 2 3 4\n\n# a comment\n1 2 3\n",
            "line 5: found 3 values, expected 4, as many as the header has names",
        ),
        ("x y z\n1 2 3\n4 five 6\n", "y in line 3: found five, expected a number"),
        ("# x [furlong] y z\n1 2 3\n", "unit of x: found \"furlong\""),
    ] {
        let told = refused(&file(folder.path(), "t", text.as_bytes()));
        assert!(told.contains(expected), "{told}");
    }
    let scene = file(folder.path(), "t.scene.ron", b"(version: 1, datasets: [(path: \"a.csv\")],\n size: (60,40))\n");
    let told = refused(&scene);
    assert!(told.contains("positions: missing, expected data in the place of a scene or a tour"), "{told}");
    let long = format!("# x y z\n1 2 3\n{}\n", "4 ".repeat(1 << 20));
    let told = refused(&file(folder.path(), "t", long.as_bytes()));
    assert!(told.contains("line 3: found 4 4 4") && told.contains("a line of fewer than 1048576 bytes"), "{told}");
}
