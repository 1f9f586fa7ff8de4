//! Folders of files: outputs of RAMSES and snapshots in the format nchilada.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| deepfield_fuzz::outputs(bytes));
