//! Tables in several files.

use super::{assert_same, file, gzip, ids_of, values, zstandard};
use deepfield_data::import::{file_in, is_one_table, open};

#[test]
fn parts_of_a_table_are_one_source() {
    let folder = tempfile::tempdir().unwrap();
    let mut whole = "ra,dec,parallax,name\n".to_owned();
    for part in 0..3 {
        let mut text = "ra,dec,parallax,name\n".to_owned();
        for row in 0..50 {
            let line = format!("{},{},{},{}\n", row * 7, row - 20, 1 + part, if part == 1 { "Vega" } else { "3" });
            text.push_str(&line);
            whole.push_str(&line);
        }
        let bytes = match part {
            0 => text.into_bytes(),
            1 => gzip(text.as_bytes()),
            _ => zstandard(text.as_bytes()),
        };
        file(folder.path(), &format!("part_{part}"), &bytes);
    }
    let alone = tempfile::tempdir().unwrap();
    let whole = open(&file(alone.path(), "whole", whole.as_bytes())).unwrap();
    let parts = open(folder.path()).unwrap();
    let about = parts.description();
    assert_eq!((about.files, &*about.format, about.families[0].count), (3, "csv", 150));
    assert!(about.notes.contains(&"one table in 3 files".into()), "{:?}", about.notes);
    // A column that is text in one of them is none, and told.
    assert!(about.notes.contains(&"columns without numbers are left out: name".into()), "{:?}", about.notes);
    assert_eq!(about.families, whole.description().families);
    for name in ["position", "ra", "dec", "parallax"] {
        assert_same(&values(&*parts, name), values(&*whole, name).into_iter(), name);
    }
    // Another table beside them makes it a folder of several sources.
    file(folder.path(), "other.csv", b"x,y,z\n1,2,3\n");
    let told = file_in(folder.path(), &[]).unwrap_err().to_string();
    assert!(told.contains("other.csv") && told.contains("part_0"), "{told}");
}

/// A survey in the layout of Gaia's archive, whose 3386 files are some hundred here: all rows in the order of the files' names, none of which
/// stays open.
#[test]
fn hundreds_of_parts_are_one_source_and_no_file_stays_open() {
    const FILES: u64 = 300;
    const STARS: u64 = 7;
    let folder = tempfile::tempdir().unwrap();
    let columns = [
        ("solution_id", "int64"),
        ("designation", "string"),
        ("source_id", "int64"),
        ("ra", "float64"),
        ("dec", "float64"),
        ("parallax", "float64"),
        ("pmra", "float64"),
        ("phot_g_mean_mag", "float32"),
        ("has_xp_sampled", "bool"),
        ("phot_variable_flag", "string"),
    ];
    let mut head = "# %ECSV 1.0\n# ---\n# delimiter: ','\n# datatype:\n".to_owned();
    for (name, kind) in columns {
        head += &format!("# -\n#   name: {name}\n#   datatype: {kind}\n#   description: of {name}\n");
    }
    head += &columns.map(|(name, _)| name).join(",");
    head.push('\n');
    // Ids that doubles cannot hold.
    let id = |star: u64| (1_u64 << 62) + 1 + 2 * star;
    let parallax = |star: u64| if star % 5 == 3 { f64::NAN } else { 0.25 + star as f64 };
    // Written from the last to the first, so that folders list them in no order of their own.
    for number in (0..FILES).rev() {
        let mut text = head.clone();
        for star in number * STARS..(number + 1) * STARS {
            let (ra, dec) = (star as f64 * 0.17, (star % 170) as f64 - 85.0);
            let stated = if parallax(star).is_nan() { "null".to_owned() } else { parallax(star).to_string() };
            let line = format!("16367,Gaia {0},{0},{ra},{dec},{stated},null,12.5,True,NOT_AVAILABLE\n", id(star));
            text.push_str(&line);
        }
        let bytes = gzip(text.as_bytes());
        file(folder.path(), &format!("GaiaSource_{number:06}-{:06}.csv.gz", number + 1), &bytes);
    }
    // How many files the process has open, where the system tells.
    let are_open = || std::fs::read_dir("/proc/self/fd").map_or(0, Iterator::count);
    let before = are_open();
    // Though their names differ in numbers alone, as those of steps do.
    assert!(is_one_table(folder.path()).unwrap());
    let source = open(folder.path()).unwrap();
    assert!(are_open() < before + 100, "{} files are open, {before} were", are_open());
    let about = source.description();
    assert_eq!((about.files as u64, &*about.format, about.families[0].count), (FILES, "ecsv", FILES * STARS));
    assert_same(&values(&*source, "parallax"), (0..FILES * STARS).map(parallax), "parallax");
    assert!(ids_of(folder.path()).into_iter().eq((0..FILES * STARS).map(id)));
}
