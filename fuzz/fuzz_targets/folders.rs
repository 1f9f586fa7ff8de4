//! Folders of two files: tables and snapshots in several files, and HATS catalogues.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| deepfield_fuzz::folders(bytes));
