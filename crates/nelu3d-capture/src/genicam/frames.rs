//! What is the same for every such camera while its frames are waited for.

use std::time::Duration;

use super::pixels::PixelFormat;
use crate::error::CaptureError;

/// Longest time without a frame.
pub(super) const PATIENCE: Duration = Duration::from_secs(20);
/// Time between two looks at whether to stop.
pub(super) const TICK: Duration = Duration::from_millis(100);
/// Frames that wait here while one is looked at; older ones would be late.
pub(super) const WAITING: usize = 3;

/// Returns the largest code of a pixel format.
pub(super) fn saturation(format: PixelFormat) -> f64 {
    f64::from((1u32 << format.bits) - 1)
}

/// Returns the error that `device` delivered no frame for too long; `incomplete` ones did not arrive whole.
pub(super) fn no_frame(device: &str, incomplete: u64) -> CaptureError {
    let problem = match incomplete {
        0 => "delivers no frame".into(),
        n => format!("delivers no whole frame ({n} incomplete)"),
    };
    CaptureError::Device {
        device: device.into(),
        problem,
        remedy: "see to its cable and that it is not set to wait for a trigger".into(),
    }
}

/// Returns the error that `device` delivered something that is not read.
pub(super) fn not_read(device: &str, bytes: usize, format: &dyn std::fmt::Display) -> CaptureError {
    CaptureError::Device {
        device: device.into(),
        problem: format!("delivered {bytes} bytes of {format}"),
        remedy: "set its pixel format to Mono8, Mono12 or BayerRG12".into(),
    }
}
