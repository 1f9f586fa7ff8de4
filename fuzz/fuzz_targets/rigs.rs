//! Rigs of projectors that others have measured, and warps.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| deepfield_fuzz::rigs(bytes));
