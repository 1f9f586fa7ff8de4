//! What leader and followers of a show say to each other, after it has been decrypted.
#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| deepfield_fuzz::messages(bytes));
