//! Lookup tables (npz and npy).

#![no_main]

use libfuzzer_sys::fuzz_target;
use nelu3d_baselines::lookup3d::file;

fuzz_target!(|bytes: &[u8]| {
    let table = tempfile::NamedTempFile::new().expect("a temporary file");
    std::fs::write(table.path(), bytes).expect("a temporary file");
    let _ = file::read(table.path(), None);
});
