//! Color fields (safetensors).

#![no_main]

use libfuzzer_sys::fuzz_target;
use nelu3d::color_field::ColorField;

fuzz_target!(|bytes: &[u8]| {
    let file = tempfile::NamedTempFile::new().expect("a temporary file");
    std::fs::write(file.path(), bytes).expect("a temporary file");
    let _ = ColorField::load(file.path());
});
