//! Meshes in GLB files.

#![no_main]

use std::path::Path;

use libfuzzer_sys::fuzz_target;
use nelu3d_scan::Mesh;

fuzz_target!(|bytes: &[u8]| {
    if let Ok(mut mesh) = Mesh::from_bytes(Path::new("a.glb"), bytes) {
        mesh.compute_normals();
    }
});
