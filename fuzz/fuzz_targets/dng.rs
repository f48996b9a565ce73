//! DNG and CinemaDNG. The size that the camera is said to have comes from the first two bytes.

#![no_main]

use std::path::Path;

use libfuzzer_sys::fuzz_target;
use nelu3d_scan::import::decode_dng;

fuzz_target!(|input: &[u8]| {
    if let [width, height, bytes @ ..] = input {
        let _ = decode_dng(Path::new("a.dng"), bytes.to_vec(), (usize::from(*width), usize::from(*height)));
    }
});
