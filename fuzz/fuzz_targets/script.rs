#![no_main]

libfuzzer_sys::fuzz_target!(|text: &str| supersigma_fuzz::script(text));
