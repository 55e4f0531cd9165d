#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| isocortex_tests::fuzzed::surface(bytes));
