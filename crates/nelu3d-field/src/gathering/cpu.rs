//! The fast form: patches in lanes, a few points together, so that what was read of a patch serves all of them.

use pulp::{Arch, Simd, WithSimd};

use super::{NEAR, Patches, Receiver};

/// Points that are served together.
const POINTS: usize = 4;
/// Patches whose form factors are kept before they are multiplied with what patches send.
const BLOCK: usize = 256;
/// Patches side by side.
const LANES: usize = 16;

/// Writes what arrives at some points: as many values a point as patches send.
///
/// # Panics
///
/// If a length does not fit.
pub fn gather(patches: &Patches, points: &[Receiver], out: &mut [f32]) {
    patches.check();
    assert_eq!(out.len(), points.len() * patches.sent.len());
    if !patches.sent.is_empty() {
        Arch::new().dispatch(Gather { patches, points, out });
    }
}

struct Gather<'a> {
    patches: &'a Patches,
    points: &'a [Receiver],
    out: &'a mut [f32],
}

impl WithSimd for Gather<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { patches, points, out } = self;
        let n_values = patches.sent.len();
        out.fill(0.0);
        for (points, out) in points.chunks(POINTS).zip(out.chunks_mut(POINTS * n_values)) {
            // The last few points stand in for those that are missing.
            let mut some = [points[points.len() - 1]; POINTS];
            some[..points.len()].copy_from_slice(points);
            for first in (0..patches.len()).step_by(BLOCK) {
                let n = BLOCK.min(patches.len() - first);
                let mut factors = [[0.0f32; BLOCK]; POINTS];
                for (factors, at) in factors.iter_mut().zip(&some) {
                    form_factors(patches, first, n, at, factors);
                }
                for (value, sent) in patches.sent.iter().enumerate() {
                    let sums = products(&factors, &sent[first..first + n]);
                    for (point, out) in out.chunks_exact_mut(n_values).enumerate() {
                        out[value] += sums[point];
                    }
                }
            }
        }
    }
}

/// Writes the form factors of `n` patches from number `first` on.
#[inline(always)]
fn form_factors(patches: &Patches, first: usize, n: usize, at: &Receiver, out: &mut [f32; BLOCK]) {
    let of = first..first + n;
    let [px, py, pz] = [&patches.center[0][of.clone()], &patches.center[1][of.clone()], &patches.center[2][of.clone()]];
    let [nx, ny, nz] = [&patches.normal[0][of.clone()], &patches.normal[1][of.clone()], &patches.normal[2][of.clone()]];
    let (area, out) = (&patches.area[of], &mut out[..n]);
    let (p, m) = (at.point, at.normal);
    for j in 0..n {
        let d = [px[j] - p[0], py[j] - p[1], pz[j] - p[2]];
        let r2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2] + NEAR;
        let here = (d[0] * m[0] + d[1] * m[1] + d[2] * m[2]).max(0.0);
        let there = (d[0] * nx[j] + d[1] * ny[j] + d[2] * nz[j]).min(0.0);
        out[j] = -here * there * area[j] / (r2 * (std::f32::consts::PI * r2 + area[j]));
    }
}

/// Returns the sums over patches of form factors times what patches send, for every point.
#[inline(always)]
fn products(factors: &[[f32; BLOCK]; POINTS], sent: &[f32]) -> [f32; POINTS] {
    let mut sums = [[0.0f32; LANES]; POINTS];
    let whole = sent.len() / LANES * LANES;
    for at in (0..whole).step_by(LANES) {
        let sent: &[f32; LANES] = sent[at..].first_chunk().expect("whole lanes");
        for (sums, factors) in sums.iter_mut().zip(factors) {
            let factors: &[f32; LANES] = factors[at..].first_chunk().expect("whole lanes");
            for l in 0..LANES {
                sums[l] += factors[l] * sent[l];
            }
        }
    }
    let mut out = [0.0; POINTS];
    for point in 0..POINTS {
        let rest: f32 = factors[point][whole..sent.len()].iter().zip(&sent[whole..]).map(|(f, s)| f * s).sum();
        out[point] = rest + sums[point].iter().sum::<f32>();
    }
    out
}
