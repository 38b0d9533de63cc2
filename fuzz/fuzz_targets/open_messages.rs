#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| isobath_tests::fuzz::open_messages(data));
