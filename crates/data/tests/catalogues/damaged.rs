//! Files that are cut or changed anywhere: errors that name the file, or other tables.

use super::formats::elements;
use super::{bytes_of, file, gzip, refused, zstandard};
use deepfield_data::import::{LoadOptions, formats, load, open};
use deepfield_data::model::ReadMethod;
use proptest::prelude::*;

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
            let told = refused(&path);
            assert!(length > 0 || told.ends_with(": length: found 0 bytes, expected data"), "{told}");
        }
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

proptest! {
    #![proptest_config(ProptestConfig::with_cases(160))]

    /// Whatever is written over a file, it is an error of one line or another table, all of which can be read.
    #[test]
    fn damaged_catalogues_are_errors_or_other_catalogues(
        which in 0..10usize, packing in 0..3usize, cut in 0.3..1.5f64,
        changes in prop::collection::vec((0.0..1.0f64, 0.0..4.0f64, any::<u8>()), 1..12),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let parsed = ["catalogue.fits", "catalogue.vot", "catalogue2.vot", "catalogue.ecsv.zst", "others/astropy-vectors.ecsv"];
        let columns = ["table.parquet", "others/pyarrow-fixed.parquet", "others/pyarrow-plain.parquet"];
        let records = ["others/h5py-records.hdf5", "others/tables.h5"];
        let name = [&parsed[..], &columns[..], &records[..]].concat()[which];
        // Rows of some are read in place, and so is their damage found.
        let in_place = which >= parsed.len();
        let cut = if in_place { cut.max(1.0) } else { cut };
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
        for format in formats().into_iter().filter(|format| ["FITS table", "VOTable", "ECSV table", "Parquet table", "HDF5 snapshot"].contains(&format.name())) {
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
