//! Places, velocities and others as one column of several numbers, in every format that has such.

use super::{assert_same, data, file, refused, values};
use deepfield_data::import::{FieldKind, Source, open};

/// Velocities of `make_others.py`, and other numbers in its files.
fn velocity(row: f64) -> [f64; 3] {
    [0.25 * row, -row, 3.0 - row]
}

fn left_out(source: &dyn Source) -> String {
    source.description().notes.join("; ")
}

#[test]
fn what_is_missing_in_vectors_of_astropy_is_missing_in_every_format() {
    let axes = |row: u64| {
        let row = row as f64;
        let place = [row, 2.0 * row % 7.0, 0.5 * row];
        std::array::from_fn::<f64, 3, _>(|axis| if place[axis] > 5.0 { f64::NAN } else { velocity(row)[axis] })
    };
    let level = |row: u64| if row % 4 == 3 { f64::NAN } else { 1.0 + (row % 4) as f64 };
    for ending in [".fits", ".ecsv", ".parquet", ".hdf5", "-tabledata.vot", "-binary2.vot"] {
        let source = open(&data(&format!("others/astropy-vectors{ending}"))).unwrap();
        assert_same(&values(&*source, "axes"), (0..24).flat_map(axes), ending);
        assert_same(&values(&*source, "level"), (0..24).map(level), ending);
        // Masks are no columns of their own.
        let family = &source.description().families[0];
        assert_eq!(family.fields.len(), 7, "{ending}: {:?}", family.fields);
        assert_eq!(family.fields[family.find(FieldKind::Velocity).unwrap()].stored_as, "velocity", "{ending}");
    }
}

#[test]
fn lists_of_parquet_are_vectors_where_they_are_of_one_length() {
    let axes = |row: u64| if row % 8 == 7 { [f64::NAN; 3] } else { velocity(row as f64) };
    // Any range of rows, groups of which end at 10 and 20, and pages, of some also within rows, after four numbers or some more.
    let holds = |source: &dyn Source, name: &str, expected: &dyn Fn(u64) -> [f64; 3]| {
        let field = source.description().families[0].named(name).unwrap();
        for start in 0..24 {
            for end in start + 1..=24 {
                let mut some = vec![0.0; 3 * (end - start) as usize];
                source.read(0, field, start..end, &mut some).unwrap();
                assert_same(&some, (start..end).flat_map(expected), name);
            }
        }
    };
    for name in ["others/pyarrow-fixed.parquet", "others/pyarrow-plain.parquet", "others/astropy-vectors.parquet"] {
        let source = open(&data(name)).unwrap();
        holds(&*source, "velocity", &|row| velocity(row as f64));
        if name.contains("fixed") {
            holds(&*source, "axes", &axes);
        }
    }
    // Of other names nothing says so.
    let source = open(&data("others/pyarrow-plain.parquet")).unwrap();
    assert_eq!(left_out(&*source), "columns without numbers are left out: axes");
    let source = open(&data("ragged.parquet")).unwrap();
    assert_eq!(left_out(&*source), "columns without numbers are left out: level");
    let none = f64::NAN;
    let velocities =
        [1.0, 2.0, 3.0, 4.0, none, 6.0, none, none, none, none, none, none, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0];
    assert_same(&values(&*source, "velocity"), velocities.into_iter(), "velocity");
    let position = source.description().families[0].find(FieldKind::Position).unwrap();
    let mut some = [0.0; 12];
    source.read(0, position, 2..6, &mut some).unwrap();
    assert_same(&some, (0..4).flat_map(|row| [7.0, 8.0, 9.0 + f64::from(row)]), "position");
    for (rows, count) in [(0..1, 2), (1..2, 4), (0..6, 2)] {
        let mut some = vec![0.0; 3 * (rows.end - rows.start) as usize];
        let told = source.read(0, position, rows, &mut some).unwrap_err().to_string();
        assert!(told.contains(&format!("a row of {count} values, not 3")) && !told.contains('\n'), "{told}");
    }
}

#[test]
fn arrays_of_ecsv_are_vectors() {
    let folder = tempfile::tempdir().unwrap();
    let table = |subtype: &str, place: &str, other: &str| {
        format!(
            "# %ECSV 1.0\n# datatype:\n# - {{name: pos_kpc, datatype: string, subtype: 'float64[3]'}}\n\
             # - {{name: m, datatype: string, subtype: '{subtype}'}}\npos_kpc m\n[1,-2.5,3e2] {other}\n{place} {other}\n"
        )
    };
    let opened = |text: String| open(&file(folder.path(), "t.ecsv", text.as_bytes())).unwrap();
    let source = opened(table("int8[2,2]", "[1,null,NaN]", "[[1,2],[3,4]]"));
    assert_eq!((&*source.description().length_unit.0, left_out(&*source)), ("kpc", String::new()));
    let none = f64::NAN;
    assert_same(&values(&*source, "position"), [1.0, -2.5, 300.0, 1.0, none, none].into_iter(), "position");
    assert_same(&values(&*source, "m"), [1.0, 2.0, 3.0, 4.0, 1.0, 2.0, 3.0, 4.0].into_iter(), "m");
    let source = opened(table("bool[2]", "\"\"", "[true,False]"));
    assert_same(&values(&*source, "position"), [1.0, -2.5, 300.0, none, none, none].into_iter(), "position");
    assert_same(&values(&*source, "m"), [1.0, 0.0, 1.0, 0.0].into_iter(), "m");
    for (subtype, other) in
        [("float64[null]", "[1,2]"), ("json", "{}"), ("float64[99]", "[]"), ("complex64[2]", "[1,2]")]
    {
        let source = opened(table(subtype, "[4,5,6]", other));
        assert_eq!(left_out(&*source), "columns without numbers are left out: m", "{subtype}");
    }
    for other in ["[1,2,3]", "[1]", "1", "[1,two]", "[]", "[1,2"] {
        let source = opened(table("float64[2]", "[4,5,6]", other));
        assert_eq!(left_out(&*source), "columns without numbers are left out: m", "{other}");
    }
    let told = refused(&file(folder.path(), "t.ecsv", table("int8[2]", "[4,5]", "[1,2]").as_bytes()));
    assert!(told.contains("pos_kpc in line 7: found [4,5], expected a number"), "{told}");
}

/// Columns of coordinates go before one of all, and that before directions.
#[test]
fn the_first_way_to_make_positions_counts() {
    let folder = tempfile::tempdir().unwrap();
    let names = |names: &[&str]| {
        let described = names.iter().map(|name| match *name {
            "pos" => "# - {name: pos, unit: pc, datatype: string, subtype: 'float64[3]'}\n".to_owned(),
            name => format!("# - {{name: {name}, datatype: float64}}\n"),
        });
        let row = names.iter().map(|name| if *name == "pos" { "[7,8,9]" } else { "1" });
        let (described, row) = (described.collect::<String>(), row.collect::<Vec<_>>().join(" "));
        let text = format!("# %ECSV 1.0\n# datatype:\n{described}{}\n{row}\n", names.join(" "));
        open(&file(folder.path(), "t.ecsv", text.as_bytes())).unwrap()
    };
    let source = names(&["ra", "dec", "pos"]);
    assert_eq!((&*source.description().length_unit.0, &*values(&*source, "position")), ("pc", &[7.0, 8.0, 9.0][..]));
    let source = names(&["pos", "x", "y", "z"]);
    assert_eq!((&*source.description().length_unit.0, &*values(&*source, "position")), ("", &[1.0; 3][..]));
    assert_eq!(values(&*source, "pos"), [7.0, 8.0, 9.0]);
}
