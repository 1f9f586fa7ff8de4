//! Text between commas and blanks as other programs write it: truth values, exponents of Fortran, comments, names and texts that are not in
//! UTF-8. What is left out is told.

use super::{assert_same, file, values};
use deepfield_data::import::open;

#[test]
fn tables_of_other_programs_hold_what_they_say() {
    let folder = tempfile::tempdir().unwrap();
    let none = f64::NAN;
    let tables: [(&str, &[u8], &[f64]); 13] = [
        ("names in quotes", b"x,\"y\",z,\"name, full\",a\n1,2,3,\"Vega, Lyra\",5\n4,5,6,,7\n", &[5.0, 7.0]),
        ("the index of pandas", b",x,y,z,a\n0,1,2,3,5\n1,4,5,6,7\n", &[5.0, 7.0]),
        ("truth of pandas", b"x,y,z,a\n1,2,3,True\n4,5,6,False\n", &[1.0, 0.0]),
        ("truth of R and JSON", b"x,y,z,a\n1,2,3,TRUE\n4,5,6,false\n", &[1.0, 0.0]),
        ("truth between blanks", b"x y z a\n1 2 3 False\n4 5 6 True\n", &[0.0, 1.0]),
        ("Fortran", b"x,y,z,a\n1.0D0,2d+00,0.3D+01,1.5D-3\n4,5,6,-2D2\n", &[1.5e-3, -200.0]),
        ("Fortran between blanks", b"# x y z a\n1.0D0 2D+00 0.3D+01 1.5D-3\n4D0 5D0 6D0 -2D2\n", &[1.5e-3, -200.0]),
        ("what is missing", b"x,y,z,a\n1,2,3,<NA>\n4,5,6,\\N\n7,8,9,#N/A\n1,1,1,2\n", &[none, none, none, 2.0]),
        (
            "comments before names",
            b"# made in 2024, by hand\n# a, b, c, and more, of it\n\nx,y,z,a\n1,2,3,5\n4,5,6,7\n",
            &[5.0, 7.0],
        ),
        (
            "comments around names",
            b"# made by hand, twice\n#x,y,z,a\n# all in kpc, and s\n1,2,3,5\n4,5,6,7\n",
            &[5.0, 7.0],
        ),
        ("a mark of byte order", b"\xef\xbb\xbf# one, two\n\"x\",\"y\",\"z\",\"a\"\n1,2,3,5\n4,5,6,7\n", &[5.0, 7.0]),
        ("Latin-1", b"# Universit\xe4t K\xf6ln, 2024\nx,y,z,a,gr\xf6\xdfe\n1,2,3,5,1\n4,5,6,7,2\n", &[5.0, 7.0]),
        ("texts in Latin-1", b"x,y,z,a,name\n1,2,3,5,K\xf6ln\n4,5,6,7,Aachen\n", &[5.0, 7.0]),
    ];
    for (what, text, expected) in tables {
        let source = open(&file(folder.path(), "table", text)).unwrap_or_else(|error| panic!("{what}: {error}"));
        assert_same(&values(&*source, "a"), expected.iter().copied(), what);
        assert_eq!(values(&*source, "position")[..3], [1.0, 2.0, 3.0], "{what}");
        let family = &source.description().families[0];
        assert_eq!(family.named("column-1").is_some(), what == "the index of pandas", "{what}");
        assert_eq!(family.named("größe").is_some(), what == "Latin-1", "{what}");
    }
}

#[test]
fn directions_are_known_by_the_names_of_archives() {
    let folder = tempfile::tempdir().unwrap();
    for (names, row) in [
        ("RAJ2000,DEJ2000", "90,0"),
        ("RA_ICRS,DE_ICRS", "90,0"),
        ("_RAJ2000,_DEJ2000", "90,0"),
        // What VizieR adds comes after what a catalogue has.
        ("_RAJ2000,_DEJ2000,RA_ICRS,DE_ICRS", "45,45,90,0"),
        ("_RAJ2000,_DEJ2000,ra,dec", "06 00 00.0,+00 00 00,90,0"),
    ] {
        let text = format!("{names},Plx\n{row},500\n");
        let source = open(&file(folder.path(), "table", text.as_bytes())).unwrap_or_else(|error| panic!("{error}"));
        let place = values(&*source, "position");
        let is_near = place.iter().zip([0.0, 2.0, 0.0]).all(|(found, expected)| (found - expected).abs() < 1e-12);
        assert!(is_near && place.len() == 3, "{names}: {place:?}");
    }
}

#[test]
fn columns_of_one_name_are_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let text = b"x,y,z,vx,vy,vz,a,a,velocity\n1,2,3,0,0,1,5,6,7\n";
    let source = open(&file(folder.path(), "table", text)).unwrap();
    for (name, expected) in [("a", 5.0), ("a-2", 6.0), ("velocity-2", 7.0)] {
        assert_eq!(values(&*source, name), [expected], "{name}");
    }
    let notes = source.description().notes.join("\n");
    assert!(notes.contains("there is another a, called a-2\n"), "{notes}");
}

#[test]
fn names_in_a_comment_are_those_of_a_row_in_which_all_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let text = b"#name,x,y,z,a\nA,nan,nan,nan,nan\nB,1,2,3,5\n";
    let source = open(&file(folder.path(), "table", text)).unwrap();
    assert_same(&values(&*source, "a"), [f64::NAN, 5.0].into_iter(), "a");
}

#[test]
fn columns_that_are_left_out_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let header = "# %ECSV 1.0\n# datatype:\n# - {name: x, datatype: float64}\n# - {name: y, datatype: float64}\n\
        # - {name: z, datatype: float64}\n# - {name: name, datatype: string}\n# - {name: a, datatype: int32}\nx y z name a\n";
    for (text, expected) in [
        ("x,y,z,name,a\n1,2,3,,5\n4,5,6,Vega,1 000\n".to_owned(), Some("name, a (1 000 in line 3)")),
        ("x y z name a\n1 2 3 Vega 5\n4 5 6 Deneb 6\n".to_owned(), Some("name")),
        (format!("{header}1 2 3 7 5\n4 5 6 8 6\n"), Some("name")),
        ("x,y,z,a\n1,2,3,\n4,5,6,7\n".to_owned(), None),
    ] {
        let source = open(&file(folder.path(), "table", text.as_bytes())).unwrap();
        let told: Vec<&str> = source
            .description()
            .notes
            .iter()
            .filter_map(|note| note.strip_prefix("columns without numbers are left out: "))
            .collect();
        assert_eq!(told, expected.into_iter().collect::<Vec<&str>>(), "{text}");
    }
    // Places are numbers, whatever truth values are elsewhere.
    let told = super::refused(&file(folder.path(), "table", b"x,y,z\n1,2,True\n"));
    assert!(told.contains("z in line 2: found True, expected a number"), "{told}");
}

#[test]
fn thousands_of_names_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let names: Vec<String> =
        ["x", "y", "z"].map(str::to_owned).into_iter().chain((3..8000).map(|n| format!("column_{n:06}"))).collect();
    let row: Vec<String> = (0..8000).map(|n| format!("{n}.5")).collect();
    for (separator, format) in [(",", "csv"), (" ", "ascii")] {
        let text = [names.join(separator), row.join(separator), String::new()].join("\n");
        let source = open(&file(folder.path(), "wide", text.as_bytes())).unwrap();
        assert_eq!((&*source.description().format, source.description().families[0].count), (format, 1));
        assert_same(&values(&*source, "column_007999"), [7999.5].into_iter(), format);
    }
}
