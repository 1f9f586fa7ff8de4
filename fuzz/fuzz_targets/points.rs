//! Points: PLY, LAS, PHANTOM, VTK, GenericIO and GSD.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    for format in ["PLY", "LAS", "PHANTOM", "VTK", "GenericIO", "GSD"] {
        deepfield_fuzz::import(format, bytes);
    }
});
