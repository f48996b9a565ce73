//! Measuring the projector's radiometric response.
//!
//! It is measured on the boards of the sweep, wherever an image with values between black and white was projected: the
//! computed projector pixel of a camera pixel says which value it saw, the normalized intensity how much light that
//! made. Only places count where the projected image is straight over a few pixels around, so that blur does not
//! matter.

use nalgebra::{Isometry3, Point3, Vector3};
use nelu3d::surface::PixelStatus;
use nelu3d_scan::pattern::Axis;
use nelu3d_scan::rig::{PatternSet, RigError, Shot};
use nelu3d_scan::statistics::percentile;
use nelu3d_scan::{Projector, Rig};

use crate::captured::{Captured, Images};
use crate::code::{Code, Line, ProjectedLight, value_at};
use crate::response::Response;

/// Bins of the projected value, 0 to 1.
pub const BINS: usize = 32;

/// Fewest samples of a bin.
const MIN_SAMPLES: usize = 50;

/// Board positions that are read.
const POSITIONS: usize = 4;

/// Samples within this many px on both sides must lie on a straight line, to this share of full scale.
const STRAIGHT: (f32, f32) = (5.0, 0.02);

/// Measures the response; `None` if the sweep has no image with values between black and white, or too little of one.
pub(super) fn measure_response(
    rig: &Rig,
    projector: &Projector,
    extent_mm: [f64; 4],
    positions: &[(usize, Isometry3<f64>)],
    shots: &[Shot],
) -> Result<Option<Response>, RigError> {
    let mut names: Vec<&String> = rig.pattern_sets.iter().flat_map(|s| &s.images).collect();
    names.sort();
    names.dedup();
    let at: Vec<&(usize, Isometry3<f64>)> =
        positions.iter().step_by(positions.len().div_ceil(POSITIONS).max(1)).collect();
    names.retain(|name| rig.projected(name).exists() && at.iter().all(|p| rig.has_image(&shots[p.0].dir.join(name))));
    // Only images of several values that one axis explains; what cannot be read is no reason to fail here.
    let set_of = |images: Vec<String>| PatternSet { name: "response".into(), images, inverse: Vec::new() };
    let size = Some([projector.optics.width, projector.optics.height]);
    let mut lines: Vec<(String, Axis, Line)> = Vec::new();
    for name in names {
        let Ok(code) = Code::read_sized(rig, &set_of(vec![name.clone()]), size, &ProjectedLight::Power(1.0)) else {
            continue;
        };
        let [axis] = &code.axes[..] else { continue };
        let between = axis.lines[0].values.iter().filter(|v| (0.1..0.9).contains(*v)).count();
        if !code.colored && between * 4 > axis.len() {
            lines.push((name.clone(), axis.axis, axis.lines[0].clone()));
        }
    }
    if lines.is_empty() {
        return Ok(None);
    }
    let set = set_of(lines.iter().map(|l| l.0.clone()).collect());
    let mut bins: Vec<Vec<f64>> = vec![Vec::new(); BINS];
    for (shot, pose) in at {
        let captured = Captured::new(&Images::read_position(rig, &shots[*shot], &set)?, rig, 0.1);
        let gray: Vec<_> = (0..lines.len()).map(|i| captured.gray(i, false)).collect();
        let normal = pose.rotation * Vector3::z();
        let offset = normal.dot(&pose.translation.vector);
        let [x0, y0, x1, y1] = extent_mm;
        for i in (0..captured.status.len()).step_by(3) {
            if captured.status[i] != PixelStatus::Valid {
                continue;
            }
            let ray = rig.camera.ray([(i % captured.width) as f64, (i / captured.width) as f64]);
            let point: Point3<f64> = ray.at(offset / normal.dot(&ray.dir));
            let on = pose.inverse() * point;
            let Some(px) = projector.project(&point) else { continue };
            if !((x0..x1).contains(&on.x) && (y0..y1).contains(&on.y)) {
                continue;
            }
            for ((_, axis, line), p) in lines.iter().zip(&gray) {
                let u = px[*axis as usize] as f32;
                let (reach, most) = STRAIGHT;
                if !(u > 2.0 * reach && u < line.values.len() as f32 - 2.0 * reach) {
                    continue;
                }
                let [a, v, b] = [u - reach, u, u + reach].map(|u| value_at(&line.values, u));
                if (0.5 * (a + b) - v).abs() < most && (a - b).abs() < 0.4 {
                    bins[((v * BINS as f32) as usize).min(BINS - 1)].push(f64::from(p[i] / v.max(1e-3)));
                }
            }
        }
    }
    let images = lines.into_iter().map(|l| l.0).collect();
    Ok(curve(bins, images))
}

/// Makes the response from samples of light per projected value, sorted into [`BINS`] bins by the value; `images` are
/// those that they were measured with. `None` if the samples cover too little of the range to call it a curve.
pub fn curve(bins: Vec<Vec<f64>>, images: Vec<String>) -> Option<Response> {
    let mut knots = Vec::new();
    for (k, mut bin) in bins.into_iter().enumerate() {
        let (n, value) = (bin.len(), (k as f64 + 0.5) / BINS as f64);
        // The ratio changes slowly within a bin, the light itself does not.
        if n >= MIN_SAMPLES {
            knots.push((value, percentile(&mut bin, 50.0) * value));
        }
    }
    // Enough of the range to call it a curve.
    if knots.len() < BINS / 2 || knots.first()?.0 > 0.25 || knots.last()?.0 < 0.75 {
        return None;
    }
    monotone(&mut knots);
    // The flash is what light is measured in. Black is what is left by going on from the first two knots.
    let (a, b) = (knots[0], knots[1]);
    let black = (a.1 - a.0 * (b.1 - a.1) / (b.0 - a.0)).clamp(0.0, a.1);
    let (mut value, mut light) = (vec![0.0f32], vec![black as f32]);
    for (v, l) in knots.iter().filter(|k| k.1 < 1.0) {
        value.push(*v as f32);
        light.push(*l as f32);
    }
    value.push(1.0);
    light.push(1.0);
    // Least squares of log light against log value, above what black leaks.
    let (mut xx, mut xy) = (0.0, 0.0);
    for (v, l) in knots.iter().filter(|k| k.0 > 0.1 && k.1 > black + 0.01) {
        let (x, y) = (v.ln(), ((l - black) / (1.0 - black)).ln());
        xx += x * x;
        xy += x * y;
    }
    Some(Response { value, light, gamma: if xx > 0.0 { xy / xx } else { 1.0 }, images })
}

/// Replaces the light of knots (value, light) by the nearest rising sequence in the sense of least squares (pool
/// adjacent violators).
pub fn monotone(knots: &mut [(f64, f64)]) {
    let mut pools: Vec<(f64, usize)> = Vec::new();
    for (_, l) in knots.iter() {
        pools.push((*l, 1));
        while let [.., a, b] = pools[..]
            && a.0 > b.0
        {
            pools.truncate(pools.len() - 2);
            let n = a.1 + b.1;
            pools.push(((a.0 * a.1 as f64 + b.0 * b.1 as f64) / n as f64, n));
        }
    }
    let levels = pools.into_iter().flat_map(|(l, n)| std::iter::repeat_n(l, n));
    knots.iter_mut().zip(levels).for_each(|(k, l)| k.1 = l);
}
