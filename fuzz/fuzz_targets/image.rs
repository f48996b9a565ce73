//! PNG, TIFF and OpenEXR, through the reader of captures.

#![no_main]

use std::path::Path;

use libfuzzer_sys::fuzz_target;
use nelu3d_scan::image::{Channels, decode_bytes};

fuzz_target!(|bytes: &[u8]| {
    if let Ok(raw) = decode_bytes(Path::new("a.png"), bytes, None) {
        let channels = if raw.channels == 3 { Channels::Rgb } else { Channels::Bayer([0, 1, 1, 2]) };
        let _ = raw.linearize(Path::new("a.png"), channels, 0.0, 1.0);
    }
});
