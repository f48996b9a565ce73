//! NumPy arrays.

#![no_main]

use std::path::Path;

use libfuzzer_sys::fuzz_target;
use nelu3d_scan::npy;

fuzz_target!(|bytes: &[u8]| {
    let _ = npy::from_bytes(Path::new("a.npy"), bytes);
});
