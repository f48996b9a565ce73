//! Camera and projector files: JSON and YAML of three programs.

#![no_main]

use std::path::Path;

use libfuzzer_sys::fuzz_target;
use nelu3d_scan::camera::{camera_from_bytes, projector_from_bytes};

fuzz_target!(|bytes: &[u8]| {
    let _ = camera_from_bytes(Path::new("camera.json"), bytes);
    let _ = projector_from_bytes(Path::new("projector.json"), bytes);
});
