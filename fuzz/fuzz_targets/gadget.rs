//! Gadget 1 and 2.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| deepfield_fuzz::import("Gadget", bytes));
