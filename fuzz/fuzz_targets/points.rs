//! Points: PLY, LAS, PHANTOM, VTK and GenericIO.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    for format in ["PLY", "LAS", "PHANTOM", "VTK", "GenericIO"] {
        deepfield_fuzz::import(format, bytes);
    }
});
