//! What the stages of a job leave for one another.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| deepfield_fuzz::jobs(bytes));
