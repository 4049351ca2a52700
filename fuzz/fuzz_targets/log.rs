#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| supersigma_fuzz::log(bytes));
