//! HDF5 snapshots.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| deepfield_fuzz::import("HDF5", bytes));
