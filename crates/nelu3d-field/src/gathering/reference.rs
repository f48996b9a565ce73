//! The plain form.

use super::{NEAR, Patches, Receiver};

/// Returns what arrives at a point, value by value.
pub fn gather(patches: &Patches, at: &Receiver) -> Vec<f64> {
    let mut out = vec![0.0; patches.sent.len()];
    for j in 0..patches.len() {
        let d = [0, 1, 2].map(|i| f64::from(patches.center[i][j]) - f64::from(at.point[i]));
        let r2 = d.iter().map(|v| v * v).sum::<f64>() + f64::from(NEAR);
        let here: f64 = (0..3).map(|i| d[i] * f64::from(at.normal[i])).sum();
        let there: f64 = (0..3).map(|i| -d[i] * f64::from(patches.normal[i][j])).sum();
        let area = f64::from(patches.area[j]);
        let factor = here.max(0.0) * there.max(0.0) * area / (r2 * (std::f64::consts::PI * r2 + area));
        for (out, sent) in out.iter_mut().zip(&patches.sent) {
            *out += factor * f64::from(sent[j]);
        }
    }
    out
}
