//! Tables: CSV, KStars, GeoJSON, plain and compressed.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    for format in ["CSV", "KStars", "GeoJSON"] {
        deepfield_fuzz::import(format, bytes);
    }
});
