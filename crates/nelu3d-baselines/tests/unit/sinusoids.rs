//! Codes of phase shifting.

use nelu3d_baselines::code::{AxisCode, Line};
use nelu3d_scan::pattern::{Axis, Pattern, Sinusoid};

/// The code of phase-shifted sinusoids as 8-bit images: period and steps of each.
pub(crate) fn sinusoids(n: usize, parts: &[(f64, usize)]) -> AxisCode {
    let mut lines = Vec::new();
    for &(period_px, steps) in parts {
        let made = Pattern::Sinusoid(Sinusoid { axis: Axis::X, period_px, steps }).generate(n, 1).unwrap();
        for p in made.images {
            let values = p.image.data.iter().map(|v| (v * 255.0).round() / 255.0).collect();
            lines.push(Line { image: lines.len(), channel: 0, path: "p.png".into(), values });
        }
    }
    AxisCode { axis: Axis::X, lines }
}
