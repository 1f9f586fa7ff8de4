//! Tables in HDF5 whose rows are records, as other libraries write them.

use super::{assert_same, bytes_of, data, file, gzip, ids_of, refused, values};
use deepfield_data::import::{grid_format, open};

#[test]
fn members_are_columns_and_what_are_no_numbers_is_said() {
    let left_out = "columns without numbers are left out";
    for (name, notes) in [
        ("pandas-blocks.h5", ["table a/stars/table".to_owned(), format!("{left_out}: name, when")]),
        ("pandas-columns.h5", ["table a/stars/table".to_owned(), format!("{left_out}: name, when")]),
        ("tables.h5", ["table particles".to_owned(), format!("{left_out}: complex, inner, text, when")]),
        ("h5py-records.hdf5", ["table a group/stars".to_owned(), format!("{left_out}: note, inner, half")]),
    ] {
        let path = data("others").join(name);
        let source = open(&path).unwrap();
        assert_eq!(source.description().notes, notes, "{name}");
        // What PyTables keeps of indexes is no image, whatever its shape.
        assert_eq!(grid_format(&path).unwrap(), None, "{name}");
        // Any range of rows, across chunks of 7.
        let all = values(&*source, "position");
        let position = source.description().families[0].named("position").unwrap();
        for start in 0..24 {
            for end in start + 1..=24 {
                let mut some = vec![0.0; 3 * (end - start)];
                source.read(0, position, start as u64..end as u64, &mut some).unwrap();
                assert_eq!(some, all[3 * start..3 * end], "{name}");
            }
        }
    }
    let source = open(&data("others/h5py-records.hdf5")).unwrap();
    assert_same(&values(&*source, "axes"), (0..24).flat_map(|row| [-f64::from(row); 4]), "axes");
    let source = open(&data("others/tables.h5")).unwrap();
    assert_same(&values(&*source, "matrix"), (0..24).flat_map(|_| [0.0; 4]), "matrix");
}

#[test]
fn records_of_a_compressed_file_are_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let packed = file(folder.path(), "t.h5.gz", &gzip(&bytes_of("others/tables.h5")));
    assert_eq!(ids_of(&packed), ids_of(&data("others/tables.h5")));
}

#[test]
fn what_is_wrong_with_records_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = bytes_of("others/h5py-records.hdf5");
    let place = |text: &[u8]| bytes.windows(text.len()).position(|window| window == text).unwrap();
    // A member: its name filled up to sixteen bytes, and where it begins.
    let at = place(b"temperature\0") + 16;
    assert_eq!(bytes[at..at + 4], 53_u32.to_le_bytes());
    for (begin, is_wrong) in [(60_u32, false), (61, true), (5300, true), (u32::MAX, true)] {
        let mut damaged = bytes.clone();
        damaged[at..at + 4].copy_from_slice(&begin.to_le_bytes());
        let path = file(folder.path(), "damaged.h5", &damaged);
        if is_wrong {
            let told = refused(&path);
            let expected = format!(
                "a group/stars: temperature: found 1 x float32 from byte {begin} on, expected a place in the 64 of a record"
            );
            assert!(told.ends_with(&expected), "{told}");
        } else {
            open(&path).unwrap();
        }
    }
    // Without places a table is none of particles.
    let mut other = bytes.clone();
    let at = place(b"pos\0");
    other[at..at + 3].copy_from_slice(b"pro");
    let told = refused(&file(folder.path(), "other.h5", &other));
    assert!(
        told.contains("positions: missing, expected columns x, y, z, or ra, dec") && told.contains("2 tables"),
        "{told}"
    );
}
