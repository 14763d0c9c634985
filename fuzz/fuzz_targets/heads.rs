#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| anyface_fuzz::heads(bytes));
