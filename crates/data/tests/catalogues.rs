//! Catalogues as FITS tables, VOTable, ECSV and Parquet: files that were written from the standards byte by byte, or by another library, hold what
//! they should, plain and compressed, alone and as parts of one table, and damaged ones are errors that name the file.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use deepfield_data::import::{
    FieldKind, LoadOptions, Source, file_in, files_of, formats, grid_format, is_one_table, load, open, summarize,
};
use deepfield_data::model::{FamilyName, ReadMethod};
use flate2::{Compression, write::GzEncoder};
use proptest::prelude::*;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Stars in the files that `make_catalogues.py` writes.
const ROWS: u64 = 200;

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data").join(name)
}

fn bytes_of(name: &str) -> Vec<u8> {
    std::fs::read(data(name)).unwrap()
}

fn file(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// A frame of Zstandard whose blocks are the bytes themselves (RFC 8878, section 3.1.1).
fn zstandard(bytes: &[u8]) -> Vec<u8> {
    let mut frame = vec![0x28, 0xb5, 0x2f, 0xfd, 0, 0x58];
    let blocks = bytes.chunks(1 << 15);
    let last = blocks.len() - 1;
    for (number, block) in blocks.enumerate() {
        let header = u32::from(number == last) | (block.len() as u32) << 3;
        frame.extend(&header.to_le_bytes()[..3]);
        frame.extend(block);
    }
    frame
}

/// All values of a field, read some rows at a time.
fn values(source: &dyn Source, name: &str) -> Vec<f64> {
    let family = &source.description().families[0];
    let field = family.named(name).unwrap_or_else(|| panic!("no {name}"));
    let components = family.fields[field].components;
    let mut all = Vec::new();
    for start in (0..family.count).step_by(77) {
        let range = start..family.count.min(start + 77);
        let mut some = vec![0.0; (range.end - range.start) as usize * components];
        source.read(0, field, range, &mut some).unwrap();
        all.extend(some);
    }
    all
}

/// The ids of a source, read some rows at a time.
fn ids_of(path: &Path) -> Vec<u64> {
    let source = open(path).unwrap();
    let family = &source.description().families[0];
    let field = family.find(FieldKind::Id).unwrap_or_else(|| panic!("{} has no ids", path.display()));
    let mut all = Vec::new();
    for start in (0..family.count).step_by(7) {
        let range = start..family.count.min(start + 7);
        let mut some = vec![0; (range.end - range.start) as usize];
        source.read_ids(0, field, range, &mut some).unwrap();
        all.extend(some);
    }
    all
}

/// The message about a file, which is one line and names it.
fn refused(path: &Path) -> String {
    let text = open(path).err().unwrap_or_else(|| panic!("{} is opened", path.display())).to_string();
    assert!(!text.contains('\n') && text.contains(&*path.file_name().unwrap().to_string_lossy()), "{text}");
    text
}

/// Whether two lists are the same, where NaN stands for none.
fn assert_same(found: &[f64], expected: impl Iterator<Item = f64>, what: &str) {
    let expected: Vec<f64> = expected.collect();
    assert_eq!(found.len(), expected.len(), "{what}");
    for (row, (found, expected)) in found.iter().zip(expected).enumerate() {
        assert!(*found == expected || found.is_nan() && expected.is_nan(), "{what} {row}: {found}, {expected}");
    }
}

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

/// The value of a column of `make_parquet.py` in a row.
const PARQUET: [(&str, fn(u64) -> f64); 9] = [
    ("mass", |row| (1250 + row) as f64 / 1000.0),
    ("flag", |row| [1.0, 0.0, f64::NAN][row as usize % 3]),
    ("level", |row| if row % 10 == 9 { f64::NAN } else { (row % 4) as f64 - 1.0 }),
    ("half", |row| row as f64 / 4.0),
    ("count", |row| (4_000_000_000 + row) as f64),
    ("delta", |row| (row * row) as f64 - 100.0),
    ("split", |row| row as f64 / 3.0),
    ("position", |row| if row == 7 { f64::NAN } else { 0.1 * row as f64 }),
    ("id", |row| ((1_u64 << 63) + (1 << 60) + row) as f64),
];

/// Looks whether a source holds the rows of `table.parquet`, so many times.
fn holds_parquet(source: &dyn Source, times: u64) {
    let rows = || (0..times).flat_map(|_| 0..60_u64);
    let family = &source.description().families[0];
    assert_eq!((family.name, family.count, family.fields.len()), (FamilyName::Dark, 60 * times, PARQUET.len()));
    for (name, value) in PARQUET {
        let found = values(source, name);
        match name {
            "position" => {
                let expected = rows().flat_map(|row| [value(row), -0.5 * row as f64, 300.0 - 10.0 * row as f64]);
                assert_same(&found, expected, name);
            }
            _ => assert_same(&found, rows().map(value), name),
        }
    }
    assert!(ids_of(&source.description().path).into_iter().eq(rows().map(|row| (1 << 63) + (1 << 60) + row)));
}

#[test]
fn columns_of_parquet_are_read_exactly_whatever_they_are_coded_by() {
    let source = open(&data("table.parquet")).unwrap();
    holds_parquet(&*source, 1);
    let about = source.description();
    assert_eq!((&*about.format, &*about.length_unit.0, &*about.mass_unit.0), ("parquet", "kpc", "Msun"));
    let family = &about.families[0];
    assert_eq!(family.fields[family.named("level").unwrap()].unit.0, "m");
    assert_eq!(about.notes, ["columns without numbers are left out: name, list, pair, when"]);
    // A folder of such files is one table; what is said of them beside them is none.
    let folder = tempfile::tempdir().unwrap();
    let bytes = bytes_of("table.parquet");
    file(folder.path(), "part-0.parquet", &bytes);
    file(folder.path(), "part-1.parquet", &bytes);
    file(folder.path(), "_common_metadata", &bytes_of("hats/dataset/_common_metadata"));
    file(folder.path(), "_SUCCESS", b"");
    let parts = open(folder.path()).unwrap();
    assert_eq!((parts.description().files, parts.description().bytes), (2, 2 * bytes.len() as u64));
    holds_parquet(&*parts, 2);
    // A file that is another one by now is not read on.
    file(folder.path(), "part-1.parquet", &bytes[..bytes.len() - 9]);
    let error = parts.read(0, 0, 50..70, &mut [0.0; 60]).unwrap_err().to_string();
    assert!(error.contains("part-1.parquet: length: found"), "{error}");
    // One of encrypted columns says so.
    let told = refused(&file(folder.path(), "secret", b"PARE0123456789PARE"));
    assert!(told.contains("found PARE, which is encrypted, expected PAR1"), "{told}");
}

#[test]
fn partitions_on_the_sky_are_one_catalogue() {
    for name in ["hats", "hats/properties", "hats/dataset"] {
        let source = open(&data(name)).unwrap();
        let about = source.description();
        assert_eq!((&*about.format, about.files, &*about.length_unit.0), ("hats", 2, "pc"), "{name}");
        assert_eq!((about.families[0].name, about.families[0].count), (FamilyName::Stars, 50));
        assert_same(&values(&*source, "ra"), (0..50).map(|row| f64::from(row) * 7.0), "ra");
        let magnitude = (0..50).map(|row| f64::from(10 + row % 5));
        assert_same(&values(&*source, "magnitude"), magnitude, "magnitude");
        assert!(ids_of(&data(name)).into_iter().eq((0..50).map(|row| (1 << 62) + row)), "{name}");
        for (row, at) in values(&*source, "position").as_chunks::<3>().0.iter().enumerate() {
            let at = glam::DVec3::from_array(*at);
            let declination = (row as f64 - 25.0).to_radians();
            let is_there = (at.length() - 250.0).abs() < 1e-9 && (at.z - 250.0 * declination.sin()).abs() < 1e-9;
            assert!(if row == 40 { at.is_nan() } else { is_there }, "{row}: {at}");
        }
    }
    // Without the text the columns have to be called as usual.
    let folder = tempfile::tempdir().unwrap();
    let inner = folder.path().join("Norder=0/Dir=0");
    std::fs::create_dir_all(&inner).unwrap();
    let told = refused(folder.path());
    assert!(told.contains("partitions: missing"), "{told}");
    file(&inner, "Npix=4.parquet", &bytes_of("hats/dataset/Norder=0/Dir=0/Npix=4.parquet"));
    let told = refused(folder.path());
    assert!(told.contains("positions: missing"), "{told}");
    // A partition that is not there shows.
    file(folder.path(), "properties", &bytes_of("hats/properties"));
    let notes = open(folder.path()).unwrap().description().notes.join("; ");
    assert!(notes.contains("30 of the catalogue's 50 rows are there"), "{notes}");
}

#[test]
fn of_a_collection_of_catalogues_the_primary_one_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let inner = folder.join("inner/Norder=0/Dir=0");
    std::fs::create_dir_all(&inner).unwrap();
    std::fs::create_dir_all(folder.join("inner_margin/Norder=0")).unwrap();
    let partition = file(&inner, "Npix=4.parquet", &bytes_of("hats/dataset/Norder=0/Dir=0/Npix=4.parquet"));
    let properties = file(&folder.join("inner"), "properties", &bytes_of("hats/properties"));
    let collection = |primary: &str| {
        let text =
            format!("#HATS Collection\nobs_collection=c\nhats_primary_table_url={primary}\nall_margins=inner_margin\n");
        file(folder, "collection.properties", text.as_bytes())
    };
    let text = collection("inner");
    for path in [folder, text.as_path()] {
        let source = open(path).unwrap();
        let about = source.description();
        assert_eq!((&*about.format, about.files, about.particles()), ("hats", 1, 30), "{}", path.display());
    }
    assert_eq!(file_in(folder, &[]).unwrap(), folder.join("inner"));
    assert_eq!(files_of(folder).unwrap(), [&*partition, &*properties]);
    assert_eq!(files_of(&text).unwrap(), [&*partition, &*text, &*properties]);
    for primary in ["other", "inner_margin/Norder=0", "https://sky.example/inner"] {
        collection(primary);
        let told = refused(folder);
        let expected = format!(
            "collection.properties: hats_primary_table_url: found {primary}, expected the folder of a HATS catalogue"
        );
        assert!(told.ends_with(&expected), "{told}");
    }
}

/// A footer that differs in any one bit is an error, or that of another table, all of which is read or is an error.
#[test]
fn footers_of_parquet_with_any_bit_changed_are_errors_or_others() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = bytes_of("hats/dataset/Norder=0/Dir=0/Npix=4.parquet");
    let footer = bytes.len() - 8 - u32::from_le_bytes(bytes[bytes.len() - 8..][..4].try_into().unwrap()) as usize;
    let one_line = |error: &str| assert!(!error.contains('\n') && error.contains("damaged"), "{error}");
    std::fs::create_dir_all(folder.path().join("damaged/Norder=0/Dir=0")).unwrap();
    file(&folder.path().join("damaged"), "properties", &bytes_of("hats/properties"));
    for at in (0..bytes.len()).filter(|at| *at >= footer || at % 7 == 0) {
        let mut changed = bytes.clone();
        changed[at] ^= 1 << (at % 8);
        file(&folder.path().join("damaged/Norder=0/Dir=0"), "Npix=4.parquet", &changed);
        match open(&folder.path().join("damaged")) {
            Ok(source) => {
                let family = &source.description().families[0];
                for (index, field) in family.fields.iter().enumerate() {
                    let mut values = vec![0.0; family.count as usize * field.components];
                    let read = source.read(0, index, 0..family.count, &mut values);
                    let _ = read.map_err(|error| one_line(&error.to_string()));
                }
            }
            Err(error) => one_line(&error.to_string()),
        }
    }
}

/// A VOTable of elements with positions.
fn elements(rows: &str) -> String {
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

/// Every file that ends too early is an error, wherever it ends.
#[test]
fn files_that_are_cut_are_refused_wherever_they_end() {
    let folder = tempfile::tempdir().unwrap();
    let fits = bytes_of("catalogue.fits");
    let data_end = fits.len() - 2880;
    let vot = bytes_of("catalogue2.vot");
    let rows = "<TR><TD>1</TD><TD>2</TD><TD>3</TD><TD>n</TD><TD>1 2</TD></TR>";
    let text = elements(rows);
    let text_end = text.find("</TABLEDATA>").unwrap() + 11;
    let stream_end = vot.windows(9).position(|part| part == b"</STREAM>").unwrap();
    let ecsv = bytes_of("catalogue.ecsv.zst");
    // The bytes of each, where its headers end, and from where on it is whole; the first frame of the last is a table without rows.
    let parquet = bytes_of("table.parquet");
    let cases: [(&str, &[u8], usize, usize); 5] = [
        ("a.fits", &fits, 14_400, data_end),
        ("b.vot", &vot, 1500, stream_end),
        ("c.vot", text.as_bytes(), text_end, text_end),
        ("d.ecsv.zst", &ecsv, 1000, ecsv.len() - 1),
        ("e.parquet", &parquet, 100, parquet.len() - 1),
    ];
    for (name, bytes, header, end) in cases {
        let path = file(folder.path(), name, bytes);
        open(&path).unwrap();
        let cut = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
        // Headers at every byte, what follows at some.
        for length in (0..=end).rev().filter(|length| *length <= header || length % 37 == 0) {
            cut.set_len(length as u64).unwrap();
            refused(&path);
        }
    }
}

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
    // A column that is text in one of them is none.
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

proptest! {
    #![proptest_config(ProptestConfig::with_cases(160))]

    /// Whatever is written over a file, it is an error of one line or another table, all of which can be read.
    #[test]
    fn damaged_catalogues_are_errors_or_other_catalogues(
        which in 0..5usize, packing in 0..3usize, cut in 0.3..1.5f64,
        changes in prop::collection::vec((0.0..1.0f64, 0.0..4.0f64, any::<u8>()), 1..12),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let names = ["catalogue.fits", "catalogue.vot", "catalogue2.vot", "catalogue.ecsv.zst", "table.parquet"];
        let name = names[which];
        // Rows of one are read in place, and so is their damage found.
        let (in_place, cut) = (which == 4, if which == 4 { cut.max(1.0) } else { cut });
        let packing = if in_place { 0 } else { packing };
        let mut bytes = bytes_of(name);
        // Damage within what is compressed as well as of the compressed.
        let damage = |bytes: &mut Vec<u8>| {
            for (at, power, byte) in &changes {
                let at = (at.powf(1.0 + power) * bytes.len() as f64) as usize;
                bytes[at] = *byte;
            }
            bytes.truncate((cut * bytes.len() as f64) as usize);
        };
        match packing {
            1 => {
                damage(&mut bytes);
                bytes = zstandard(&bytes);
            }
            2 => {
                bytes = gzip(&bytes);
                damage(&mut bytes);
            }
            _ => damage(&mut bytes),
        }
        let path = file(folder.path(), "damaged", &bytes);
        let one_line = |error: String| assert!(!error.contains('\n') && error.contains("damaged"), "{error}");
        for format in formats().into_iter().filter(|format| ["FITS table", "VOTable", "ECSV table", "Parquet table"].contains(&format.name())) {
            match format.open(&path, ReadMethod::default()) {
                Ok(source) => {
                    let family = &source.description().families[0];
                    for (index, field) in family.fields.iter().enumerate() {
                        let mut values = vec![0.0; family.count as usize * field.components];
                        match source.read(0, index, 0..family.count, &mut values) {
                            Err(error) if in_place => one_line(error.to_string()),
                            read => read.unwrap(),
                        }
                    }
                }
                Err(error) => one_line(error.to_string()),
            }
        }
        let _ = load(&path, &LoadOptions::default(), &()).map_err(|error| one_line(error.to_string()));
    }
}

/// Bytes in base64 (RFC 4648).
fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let four = |three: &[u8]| -> String {
        let byte = |at: usize| three.get(at).map_or(0, |byte| u32::from(*byte));
        let bits = byte(0) << 16 | byte(1) << 8 | byte(2);
        let letter =
            |at: usize| if at > three.len() { '=' } else { LETTERS[(bits >> (18 - 6 * at)) as usize % 64] as char };
        (0..4).map(letter).collect()
    };
    bytes.chunks(3).map(four).collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Ids have all of their 64 bits however they are written, by whichever usual name, alone and in parts of one table.
    #[test]
    fn ids_keep_all_their_bits(
        name in prop::sample::select(vec!["id", "source_id", "objid", "OBJECT_ID", "objectId", "Source ID"]),
        ids in prop::collection::vec(prop_oneof![any::<u64>(), 0..9_u64, (1_u64 << 53) - 4..(1_u64 << 53) + 4], 5..40),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let signed: Vec<u64> = ids.iter().map(|id| id >> 1).collect();
        let rows = |ids: &[u64]| ids.iter().map(|id| format!("1,{id},2,3\n")).collect::<String>();
        let header = format!("x,{name},y,z\n");
        let parts = folder.join("parts");
        std::fs::create_dir(&parts).unwrap();
        file(&parts, "0.csv", (header.clone() + &rows(&ids[..3])).as_bytes());
        file(&parts, "1.csv.gz", &gzip((header.clone() + &rows(&ids[3..])).as_bytes()));
        // A line for each column.
        let ones = vec!["1"; ids.len()].join(",");
        let words = ids.iter().map(u64::to_string).collect::<Vec<_>>().join(",");
        let column = |name: &str, kind: &str| format!("# - {{name: '{name}', datatype: {kind}}}\n");
        let columns = [column("x", "float64"), column(name, "uint64"), column("y", "float64"), column("z", "float64")];
        let described = format!("# %ECSV 1.0\n# ---\n# delimiter: ','\n# datatype:\n{}", columns.concat());
        let places = ids.iter().map(|id| {
            format!("{{\"geometry\": {{\"coordinates\": [1, 2]}}, \"properties\": {{\"{name}\": {id}}}}}")
        });
        let places = places.collect::<Vec<_>>().join(",");
        let field = |name: &str, kind: &str| format!("<FIELD name='{name}' datatype='{kind}'/>");
        let fields = [field("x", "double"), field(name, "long"), field("y", "double"), field("z", "double")].concat();
        let votable =
            |data: &str| format!("<VOTABLE><RESOURCE><TABLE>{fields}<DATA>{data}</DATA></TABLE></RESOURCE></VOTABLE>");
        let cells = signed.iter().map(|id| match id % 3 {
            0 => format!("<TR><TD>1</TD><TD>{id:#x}</TD><TD>2</TD><TD>3</TD></TR>"),
            _ => format!("<TR><TD>1</TD><TD>{id}</TD><TD>2</TD><TD>3</TD></TR>"),
        });
        let bytes = signed.iter().flat_map(|id| [1_f64.to_bits(), *id, 0, 0].map(u64::to_be_bytes));
        let bytes = base64(&bytes.flatten().collect::<Vec<u8>>());
        let stream = format!("<BINARY><STREAM encoding='base64'>{bytes}</STREAM></BINARY>");
        let cases = [
            ("rows.csv", header.clone() + &rows(&ids), &ids),
            ("lines.csv", format!("{header}{ones}\n{words}\n{ones}\n{ones}\n"), &ids),
            ("rows.ecsv", described + &header + &rows(&ids), &ids),
            ("places.json", format!("{{\"type\": \"FeatureCollection\", \"features\": [{places}]}}"), &ids),
            ("cells.vot", votable(&format!("<TABLEDATA>{}</TABLEDATA>", cells.collect::<String>())), &signed),
            ("bytes.vot", votable(&stream), &signed),
        ];
        for (path, text, expected) in &cases {
            assert_eq!(&ids_of(&file(folder, path, text.as_bytes())), *expected, "{path}");
        }
        assert_eq!(ids_of(&parts), ids);
        // Where a row has none, rows cannot be asked for by them; the others are numbers all the same.
        let source = open(&file(folder, "gap.csv", format!("{header}{}1,,2,3\n", rows(&ids)).as_bytes())).unwrap();
        let about = source.description();
        assert_eq!(about.families[0].find(FieldKind::Id), None);
        let told = format!("{name} is no id, as it is not a whole number in every row");
        assert!(about.notes.contains(&told) && values(&*source, name)[0] == ids[0] as f64, "{:?}", about.notes);
    }
}
