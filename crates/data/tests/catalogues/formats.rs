//! FITS tables, VOTable and ECSV: the same stars in each, and what each of them says in its own way.

use super::{assert_same, bytes_of, data, file, gzip, ids_of, refused, values, zstandard};
use deepfield_data::import::{FieldKind, LoadOptions, grid_format, load, open, summarize};
use deepfield_data::model::FamilyName;
use std::path::Path;

/// Stars in the files that `make_catalogues.py` writes.
const ROWS: u64 = 200;

/// Looks whether a source holds the stars of `make_catalogues.py`; levels are `level` of a row.
fn holds_the_stars(path: &Path, format: &str, level: fn(u64) -> f64) {
    let source = open(path).unwrap();
    let about = source.description();
    assert_eq!((&*about.format, &*about.length_unit.0, about.families.len()), (format, "pc", 1), "{}", path.display());
    assert_eq!((about.families[0].name, about.families[0].count), (FamilyName::Stars, ROWS));
    let source = &*source;
    let none = f64::NAN;
    let parallax = |row: u64| if row == 7 { none } else { 2.0 + 0.25 * row as f64 };
    let ra = |row: u64| 1.75 * row as f64;
    let dec = |row: u64| -60.0 + 0.6 * row as f64;
    assert_same(&values(source, "ra"), (0..ROWS).map(ra), "ra");
    let written = values(source, "dec");
    assert!(written.iter().zip(0..).all(|(found, row)| (found - dec(row)).abs() < 1e-12), "dec");
    assert_same(&values(source, "parallax"), (0..ROWS).map(parallax), "parallax");
    assert_same(&values(source, "flag"), (0..ROWS).map(|row| [1.0, 0.0, none][row as usize % 3]), "flag");
    assert_same(&values(source, "level"), (0..ROWS).map(|row| if row % 10 == 9 { none } else { level(row) }), "level");
    for (row, position) in values(source, "position").as_chunks::<3>().0.iter().enumerate() {
        let (row, at) = (row as u64, glam::DVec3::from_array(*position));
        // Back from the position to the direction.
        let distance = 1000.0 / parallax(row);
        assert_eq!(at.is_finite(), row != 7);
        if row != 7 {
            let angles = [at.y.atan2(at.x).to_degrees().rem_euclid(360.0), (at.z / at.length()).asin().to_degrees()];
            assert!((at.length() / distance - 1.0).abs() < 1e-12 && (angles[0] - ra(row)).abs() < 1e-9, "{row}: {at}");
            assert!((angles[1] - dec(row)).abs() < 1e-9, "{row}: {at}");
        }
    }
    assert_eq!(load(path, &LoadOptions::default(), &()).unwrap().len() as u64, ROWS - 1);
    assert_eq!(summarize(path).unwrap().skipped[0].count, 1);
}

#[test]
fn stars_are_the_same_in_every_format_plain_and_compressed() {
    let level: fn(u64) -> f64 = |row| 10.0 + 0.5 * row as f64;
    // VOTable has no scale.
    let doubled: fn(u64) -> f64 = |row| 20.0 + row as f64;
    let folder = tempfile::tempdir().unwrap();
    holds_the_stars(&data("catalogue.ecsv.zst"), "ecsv", level);
    for (name, format, level) in [
        ("catalogue.fits", "fits", level),
        ("catalogue.vot", "votable", doubled),
        ("catalogue2.vot", "votable", doubled),
    ] {
        let plain = bytes_of(name);
        holds_the_stars(&data(name), format, level);
        holds_the_stars(&file(folder.path(), "packed.gz", &gzip(&plain)), format, level);
        holds_the_stars(&file(folder.path(), "packed.zst", &zstandard(&plain)), format, level);
        assert_eq!(grid_format(&data(name)).unwrap(), None, "{name} is no image");
    }
}

#[test]
fn columns_of_fits_are_read_exactly() {
    let source = open(&data("catalogue.fits")).unwrap();
    let family = &source.description().families[0];
    let ids = family.find(FieldKind::Id).unwrap();
    let expected: Vec<u64> = (0..ROWS).map(|row| (1 << 63) + (1 << 60) + row).collect();
    assert_eq!(ids_of(&data("catalogue.fits")), expected);
    let motion = (0..ROWS).flat_map(|row| [row as f64, -(row as f64), 0.5 * row as f64]);
    assert_same(&values(&*source, "pm"), motion, "pm");
    assert_same(&values(&*source, "bits"), (0..ROWS).map(|row| (row * 7 % 2048) as f64), "bits");
    let unit = |name: &str| family.fields[family.named(name).unwrap()].unit.0.clone();
    assert_eq!([unit("pm"), unit("level"), unit("flag")], ["mas/yr", "m", ""]);
    let told = source.description().notes.join("; ");
    assert!(told.contains("columns without numbers are left out: name, list, none"), "{told}");
    let folder = tempfile::tempdir().unwrap();
    let mut bytes = bytes_of("catalogue.fits");
    let parts = folder.path().join("parts");
    std::fs::create_dir(&parts).unwrap();
    file(&parts, "0.fits", &bytes);
    file(&parts, "1.fits", &bytes);
    assert_eq!(ids_of(&parts), [&expected[..], &expected[..]].concat());
    // What is missing is no id.
    let at = bytes.windows(8).position(|card| card == b"TNULL7  ").unwrap();
    let card = format!("TNULL1  = {:>20}", (1_i64 << 60) + 5);
    bytes[at..at + card.len()].copy_from_slice(card.as_bytes());
    let source = open(&file(folder.path(), "null.fits", &bytes)).unwrap();
    let error = source.read_ids(0, ids, 5..6, &mut [0]).unwrap_err().to_string();
    assert!(error.ends_with("id in row 6: found no number, expected whole numbers from 0"), "{error}");
    assert!(values(&*source, "id")[5].is_nan());
}

/// A VOTable of elements with positions.
pub(super) fn elements(rows: &str) -> String {
    format!(
        "<VOTABLE xmlns:v='u'><RESOURCE><v:TABLE name='t'><FIELD name='x' datatype='double' unit='kpc'/>\
         <FIELD name='y' datatype='float'/><FIELD name='z' datatype='int'><VALUES null='-1'/></FIELD>\
         <FIELD name='note' datatype='unicodeChar' arraysize='*'/>\
         <FIELD name='v' datatype='short' arraysize='2x1'/><DATA><TABLEDATA>{rows}</TABLEDATA></DATA></v:TABLE></RESOURCE></VOTABLE>"
    )
}

#[test]
fn elements_hold_numbers_and_what_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let rows = "<TR><TD>1e3</TD><TD> -2.5 </TD><TD>0x1f</TD><TD>a &lt; b</TD><TD>3 4</TD></TR>\n\
        <TR><TD>NaN</TD><TD/><TD>-1</TD><TD><![CDATA[<TD>]]></TD><TD></TD></TR>";
    let source = open(&file(folder.path(), "t.vot", elements(rows).as_bytes())).unwrap();
    assert_eq!(source.description().length_unit.0, "kpc");
    assert_same(&values(&*source, "position"), [1e3, -2.5, 31.0, f64::NAN, f64::NAN, f64::NAN].into_iter(), "position");
    assert_same(&values(&*source, "v"), [3.0, 4.0, f64::NAN, f64::NAN].into_iter(), "v");
    for (rows, expected) in [
        ("<TR><TD>1</TD></TR>", "row 1: found 1 values, expected 5"),
        ("<TR><TD>a</TD></TR>", "x in row 1: found a, expected a number"),
        ("<TR><TD>1</TD><TD>1</TD><TD>1</TD><TD/><TD>1</TD></TR>", "v in row 1: found 1, expected 2 numbers"),
        ("<TR><TD>1</TD><TD>1</TD><TD>1</TD><TD/><TD/><TD/></TR>", "row 1: found more values"),
        ("", "no particles"),
    ] {
        let told = refused(&file(folder.path(), "t.vot", elements(rows).as_bytes()));
        assert!(told.contains(expected), "{told}");
    }
}

#[test]
fn what_is_not_read_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let fields = "<FIELD name='ra' datatype='double'/><FIELD name='dec' datatype='double'/>";
    let table =
        |data: &str| format!("<VOTABLE><RESOURCE><TABLE>{fields}<DATA>{data}</DATA></TABLE></RESOURCE></VOTABLE>");
    for (text, expected) in [
        (table("<FITS><STREAM href='a.fits'/></FITS>"), "DATA: found FITS, expected TABLEDATA, BINARY or BINARY2"),
        (table("<BINARY><STREAM href='ftp://a'/></BINARY>"), "href of STREAM: found ftp://a"),
        (table("<BINARY><STREAM encoding='gzip'>AA</STREAM></BINARY>"), "encoding of STREAM: found gzip"),
        (table("<BINARY><STREAM encoding='base64'>AAAA</STREAM></BINARY>"), "row 1: found the end of STREAM"),
        (table("").replace("double", "quad"), "datatype of ra: found quad"),
        ("<VOTABLE><TABLE><FIELD name='a' datatype='int'/><TABLEDATA/></TABLE></VOTABLE>".into(), "in one of 1 tables"),
        ("# %ECSV 1.0\n# ---\nra dec\n1 2\n".into(), "datatype: missing"),
        (
            "# %ECSV 1.0\n# datatype:\n# - {name: ra, datatype: float64}\n# - {name: dec, datatype: float64}\nra de\n1 2\n".into(),
            "names of columns: found 2 (ra,de), expected those of the header, 2 (ra,dec)",
        ),
    ] {
        let told = refused(&file(folder.path(), "t", text.as_bytes()));
        assert!(told.contains(expected), "{told}");
    }
    let spaces = "# %ECSV 1.0\n# datatype:\n# - {name: ra, unit: hourangle, datatype: float64}\n\
        # - {name: dec, unit: deg, datatype: float64}\nra dec\n6 0\n";
    let source = open(&file(folder.path(), "t", spaces.as_bytes())).unwrap();
    assert!((values(&*source, "position")[1] - 1.0).abs() < 1e-15);
}
