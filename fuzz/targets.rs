//! What each target does with foreign bytes: libFuzzer searches for bytes that break it, and the test `fuzz` of
//! `nelu3d-cli` replays what is kept, with changes, in every test run.

use std::path::Path;

use nelu3d::color_field::ColorField;
use nelu3d_baselines::lookup3d::file;
use nelu3d_scan::camera::{camera_from_bytes, projector_from_bytes};
use nelu3d_scan::image::{Channels, decode_bytes};
use nelu3d_scan::import::decode_dng;
use nelu3d_scan::{Camera, Mesh, Rig, npy};

/// A reader of bytes; returns whether they were something that it reads.
pub(crate) type Target = fn(&[u8]) -> bool;

/// All targets by their names.
pub(crate) const TARGETS: [(&str, Target); 11] = [
    ("camera", camera),
    ("color_field", color_field),
    ("dng", dng),
    ("image", image),
    ("lookup_table", lookup_table),
    ("mesh_glb", mesh_glb),
    ("mesh_obj", mesh_obj),
    ("mesh_ply", mesh_ply),
    ("mesh_stl", mesh_stl),
    ("npy", npy),
    ("rig_toml", rig_toml),
];

/// Camera and projector files: JSON and YAML of three programs.
pub(crate) fn camera(bytes: &[u8]) -> bool {
    let projector = projector_from_bytes(Path::new("projector.json"), bytes).is_ok();
    camera_from_bytes(Path::new("camera.json"), bytes).is_ok() || projector
}

/// Color fields (safetensors).
pub(crate) fn color_field(bytes: &[u8]) -> bool {
    ColorField::from_bytes(Path::new("a.safetensors"), bytes).is_ok()
}

/// DNG and CinemaDNG. The size that the camera is said to have comes from the first two bytes.
pub(crate) fn dng(input: &[u8]) -> bool {
    let [width, height, bytes @ ..] = input else { return false };
    decode_dng(Path::new("a.dng"), bytes.to_vec(), (usize::from(*width), usize::from(*height))).is_ok()
}

/// PNG, TIFF and OpenEXR, through the reader of captures.
pub(crate) fn image(bytes: &[u8]) -> bool {
    let Ok(raw) = decode_bytes(Path::new("a.png"), bytes, None) else { return false };
    let channels = if raw.channels == 3 { Channels::Rgb } else { Channels::Bayer([0, 1, 1, 2]) };
    let _ = raw.linearize(Path::new("a.png"), channels, 0.0, 1.0);
    true
}

/// Lookup tables (npz and npy).
pub(crate) fn lookup_table(bytes: &[u8]) -> bool {
    let table = tempfile::NamedTempFile::new().expect("a temporary file");
    std::fs::write(table.path(), bytes).expect("a temporary file");
    file::read(table.path(), None).is_ok()
}

/// Meshes in GLB files.
pub(crate) fn mesh_glb(bytes: &[u8]) -> bool {
    mesh("a.glb", bytes)
}

/// Meshes in OBJ files.
pub(crate) fn mesh_obj(bytes: &[u8]) -> bool {
    mesh("a.obj", bytes)
}

/// Meshes in PLY files.
pub(crate) fn mesh_ply(bytes: &[u8]) -> bool {
    mesh("a.ply", bytes)
}

/// Meshes in STL files.
pub(crate) fn mesh_stl(bytes: &[u8]) -> bool {
    mesh("a.stl", bytes)
}

fn mesh(name: &str, bytes: &[u8]) -> bool {
    let Ok(mut mesh) = Mesh::from_bytes(Path::new(name), bytes) else { return false };
    mesh.compute_normals();
    true
}

/// NumPy arrays.
pub(crate) fn npy(bytes: &[u8]) -> bool {
    npy::from_bytes(Path::new("a.npy"), bytes).is_ok()
}

/// rig.toml.
pub(crate) fn rig_toml(bytes: &[u8]) -> bool {
    let camera = Camera::pinhole(64, 48, 50.0, 50.0, 32.0, 24.0);
    Rig::from_bytes(Path::new("rig"), bytes.to_vec(), camera, None).is_ok()
}
