//! Whether codewords repeat along the camera's rays within the volume: then a depth has a double.
//!
//! A single pixel's codeword may have a double by chance, which its neighbors tell apart; so patches of pixels are
//! compared, each with itself at every other depth.

use nelu3d_scan::Camera;
use rayon::prelude::*;

use crate::color_field::{CameraRays, ColorField};
use crate::verdict::{Code, Finding, Verdict};

/// Number of depths along a ray.
pub const DEPTHS: usize = 96;
/// Number of patches across the image.
const ACROSS: usize = 20;
/// Pixels of a patch, 3 × 3.
const PIXELS: usize = 9;
/// Distance between them, as a fraction of the image's width.
const PATCH: f64 = 0.015;
/// Mean square difference per channel, in units of the variance of a measured codeword's error, up to which two depths
/// look the same; and the multiple of it by which what lies between differs.
const SAME: f64 = 0.4;
const BETWEEN: f64 = 40.0;
/// Fraction of the rays that may have doubles.
const MAX_SHARE: f64 = 0.3;

/// Judges how often codewords repeat along the rays.
pub(super) fn judge(field: &ColorField, camera: &Camera) -> Option<Finding> {
    let (share, tried, apart) = repeats(field, camera);
    tracing::debug!(share, tried, apart, "codewords that repeat along rays");
    (tried >= 20 && share > MAX_SHARE).then(|| {
        let sentence = format!(
            "along {:.0} % of the camera's rays the codeword repeats within the calibrated volume, \
             typically {apart:.0} mm \
             apart, so that surfaces can come out at the wrong one of two depths",
            100.0 * share
        );
        let remedy = "add a coarse pattern to the set (`nelu3d patterns`), or sweep less depth than one period";
        Finding::new(Code::CodeRepeats, Verdict::Doubtful, sentence, remedy)
            .with("share_of_rays", share)
            .with("apart_mm", apart)
    })
}

/// Fraction of the rays with a double, number of rays that were tried, and the median distance of doubles, mm.
fn repeats(field: &ColorField, camera: &Camera) -> (f64, usize, f64) {
    let grid = field.to_grid();
    let (w, h, k) = (camera.width, camera.height, field.k());
    // What noise leaves open: a field that is worse than its noise has a warning of its own.
    let db = field.metadata.quality.as_ref().map_or(40.0, |q| q.ceiling_db);
    let variance = 10f64.powf(-db / 10.0).max(1e-5);
    let step = (w / ACROSS).max(1);
    let reach = ((w as f64 * PATCH) as usize).max(1);
    let along = |n: usize| (reach + step / 2..n.saturating_sub(reach)).step_by(step);
    let pixels: Vec<[usize; 2]> = along(h)
        .flat_map(|y| along(w).map(move |x| [x, y]))
        .flat_map(|[x, y]| (0..PIXELS).map(move |i| [x + i % 3 * reach - reach, y + i / 3 * reach - reach]))
        .collect();
    let rays = CameraRays::of_pixels(camera, field, &pixels);
    // Of a patch that can be tried, the distance of a double, if it has one.
    let double_of = |first: usize| {
        let patch = first..first + PIXELS;
        let [near, far] = rays.range[first + PIXELS / 2];
        if !patch.clone().all(|i| rays.range[i][0] < rays.range[i][1]) {
            return None;
        }
        let at = |n: usize| f64::from(near) + f64::from(far - near) * n as f64 / (DEPTHS - 1) as f64;
        let mut words = vec![0.0f32; DEPTHS * PIXELS * k];
        let mut lit = [true; DEPTHS];
        for n in 0..DEPTHS {
            for i in patch.clone() {
                let on = rays.in_frame(i).at(at(n));
                lit[n] &= field.validity.is_lit(on.q);
                grid.eval(on.q, &mut words[(n * PIXELS + i - first) * k..][..k]);
            }
        }
        let size = PIXELS * k;
        let difference = |a: usize, b: usize| {
            let (a, b) = (&words[a * size..][..size], &words[b * size..][..size]);
            a.iter().zip(b).map(|(a, b)| f64::from((a - b) * (a - b))).sum::<f64>() / size as f64 / variance
        };
        Some(double(&lit, difference).map(|(a, b)| at(b) - at(a)))
    };
    let patches: Vec<Option<f64>> =
        (0..pixels.len() / PIXELS).into_par_iter().filter_map(|patch| double_of(patch * PIXELS)).collect();
    let mut apart: Vec<f64> = patches.iter().flatten().copied().collect();
    apart.sort_by(f64::total_cmp);
    let share = apart.len() as f64 / patches.len().max(1) as f64;
    (share, patches.len(), apart.get(apart.len() / 2).copied().unwrap_or(0.0))
}

/// Two depths that look the same although what lies between does not.
pub fn double(lit: &[bool; DEPTHS], difference: impl Fn(usize, usize) -> f64) -> Option<(usize, usize)> {
    for a in (0..DEPTHS).filter(|a| lit[*a]) {
        let mut was_different = false;
        for b in (a + 1..DEPTHS).filter(|b| lit[*b]) {
            let d = difference(a, b);
            was_different |= d > BETWEEN * SAME;
            if was_different && d < SAME {
                return Some((a, b));
            }
        }
    }
    None
}
