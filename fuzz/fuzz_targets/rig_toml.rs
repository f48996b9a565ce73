//! rig.toml.

#![no_main]

use std::path::Path;

use libfuzzer_sys::fuzz_target;
use nelu3d_scan::{Camera, Rig};

fuzz_target!(|bytes: &[u8]| {
    let camera = Camera::pinhole(64, 48, 50.0, 50.0, 32.0, 24.0);
    let _ = Rig::from_bytes(Path::new("rig"), bytes.to_vec(), camera, None);
});
