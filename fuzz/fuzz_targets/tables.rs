//! Tables: CSV, ECSV, ASCII, VOTable, FITS, Parquet, KStars, GeoJSON, XYZ and LAMMPS dumps, plain and compressed, and catalogues of haloes.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    for format in ["CSV", "ECSV", "ASCII", "VOTable", "FITS table", "Parquet", "KStars", "GeoJSON", "XYZ", "LAMMPS"] {
        deepfield_fuzz::import(format, bytes);
    }
    deepfield_fuzz::catalogue(bytes);
});
