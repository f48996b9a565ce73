#![no_main]

#[path = "../targets.rs"]
#[allow(dead_code, reason = "one target is one program")]
mod targets;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    targets::npy(bytes);
});
