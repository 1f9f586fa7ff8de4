//! Parquet, alone and as the partitions of the sky that HATS makes of it.

use super::{assert_same, bytes_of, data, file, ids_of, refused, values};
use deepfield_data::import::{Source, file_in, files_of, open};
use deepfield_data::model::FamilyName;

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
fn what_masks_of_astropy_hide_is_missing() {
    let ecsv = "# %ECSV 1.0\n# datatype:\n# - {name: id, datatype: int64}\n# - {name: id.mask, datatype: bool}\n\
        # - {name: x, datatype: float64}\n# - {name: y, datatype: float64}\n# - {name: z, datatype: float64}\n\
        # - {name: level, datatype: int16}\n# - {name: level.mask, datatype: bool}\n# - {name: own.mask, datatype: bool}\n\
        # meta: !!omap\n# - __serialized_columns__:\n#     level:\n#       mask: !astropy.table.SerializedColumn {name: level.mask}\n\
        id id.mask x y z level level.mask own.mask\n4 False 1 1 1 7 False True\n1152921504606846977 False 2 2 2 99 True False\n\
        6 True 3 3 3 9 False True\n";
    let folder = tempfile::tempdir().unwrap();
    for path in [data("masked.parquet"), file(folder.path(), "masked.ecsv", ecsv.as_bytes())] {
        let source = open(&path).unwrap();
        let none = f64::NAN;
        assert_same(&values(&*source, "level"), [7.0, none, 9.0].into_iter(), "level");
        assert_same(&values(&*source, "own.mask"), [1.0, 0.0, 1.0].into_iter(), "own.mask");
        // One that has none is no id.
        assert_same(&values(&*source, "id"), [4.0, (1_u64 << 60) as f64, none].into_iter(), "id");
        let about = source.description();
        assert_eq!(about.families[0].fields.len(), 4, "{}", path.display());
        let told = "id is no id, as it is not a whole number in every row";
        assert!(about.notes.iter().any(|note| note == told), "{:?}", about.notes);
    }
    // Parts in which nothing is hidden have no masks, be they the first or not.
    let plain = "# %ECSV 1.0\n# datatype:\n# - {name: id, datatype: int64}\n# - {name: x, datatype: float64}\n\
        # - {name: y, datatype: float64}\n# - {name: z, datatype: float64}\n# - {name: level, datatype: int16}\n\
        # - {name: own.mask, datatype: bool}\n\
        id x y z level own.mask\n4 1 1 1 7 True\n1152921504606846977 2 2 2 99 False\n6 3 3 3 9 True\n";
    let whole = [("parquet", bytes_of("unmasked.parquet")), ("ecsv", plain.into())];
    let hidden = [("parquet", bytes_of("masked.parquet")), ("ecsv", ecsv.into())];
    for ((ending, whole), (_, hidden)) in whole.into_iter().zip(hidden) {
        for order in ["ab", "ba"] {
            let folder = tempfile::tempdir().unwrap();
            for (name, bytes) in order.chars().zip([&hidden, &whole]) {
                file(folder.path(), &format!("{name}.{ending}"), bytes);
            }
            let source = open(folder.path()).unwrap();
            let masked = [7.0, f64::NAN, 9.0];
            let all = if order == "ab" { [masked, [7.0, 99.0, 9.0]] } else { [[7.0, 99.0, 9.0], masked] };
            assert_same(&values(&*source, "level"), all.into_iter().flatten(), "level");
            assert_same(&values(&*source, "own.mask"), [1.0, 0.0, 1.0, 1.0, 0.0, 1.0].into_iter(), "own.mask");
            assert_eq!(source.description().families[0].fields.len(), 4, "{order} {ending}");
        }
    }
    assert!(refused(&file(folder.path(), "cut.parquet", &bytes_of("masked.parquet")[..200])).contains("PAR1"));
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

/// One that LSDB wrote, with the orders of partitions mixed: each star is read once, whatever margins repeat of them.
#[test]
fn a_collection_of_another_library_holds_each_star_once() {
    let folder = data("hats_collection");
    let source = open(&folder).unwrap();
    let about = source.description();
    assert_eq!((&*about.format, about.files, about.particles(), &*about.length_unit.0), ("hats", 6, 60, "pc"));
    let told = |text: &str| about.notes.iter().any(|note| note.contains(text));
    assert!(told("left out: name") && !told("60 rows"), "{:?}", about.notes);
    // Partitions are in another order than the stars, which their ids tell.
    let stars: Vec<u64> = ids_of(&folder).into_iter().map(|id| (id - (1 << 60)) / 7).collect();
    let mut sorted = stars.clone();
    sorted.sort_unstable();
    assert!(sorted.into_iter().eq(0..60), "{stars:?}");
    let ra = |star: u64| 40.0 + (7 * star % 60) as f64 / 2.0;
    let dec = |star: u64| star as f64 / 2.0 - 15.0;
    assert_same(&values(&*source, "ra"), stars.iter().map(|star| ra(*star)), "ra");
    assert_same(&values(&*source, "dec"), stars.iter().map(|star| dec(*star)), "dec");
    let magnitude = stars.iter().map(|star| 10.0 + 0.125 * *star as f64);
    assert_same(&values(&*source, "magnitude"), magnitude, "magnitude");
    let places = values(&*source, "position");
    for (star, place) in stars.iter().zip(places.as_chunks::<3>().0) {
        let far = 1000.0 / (4 + star % 5) as f64;
        let (ra, dec) = (ra(*star).to_radians(), dec(*star).to_radians());
        let expected = far * glam::DVec3::new(dec.cos() * ra.cos(), dec.cos() * ra.sin(), dec.sin());
        assert!(glam::DVec3::from_array(*place).distance(expected) < 1e-9 * far, "{star}: {place:?}");
    }
}
