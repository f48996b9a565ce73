//! Columns to sub-pixel, from the borders between them.

use rayon::prelude::*;

use super::bit::Bit;
use super::table::GrayTable;
use crate::captured::Captured;

/// Two columns further apart than this belong to different surfaces.
const MAX_STEP: i32 = 6;

/// Standard deviation of a zero crossing that noise does not explain, projector px: blur that is not symmetric,
/// curvature between two pixels.
const CROSSING_PX: f32 = 0.05;

/// Where on a scan line light comes from the border of two columns.
#[derive(Clone, Copy, Debug)]
pub struct Crossing {
    /// Position along the scan line, camera px.
    pub position: f32,
    /// The border of two columns, projector px: half a pixel more than the lower column.
    pub border: f32,
    /// Standard deviation of the crossing, projector px.
    pub sigma: f32,
}

/// Refines columns to sub-pixel, with their standard deviations.
pub(super) fn refine(
    captured: &Captured,
    table: &GrayTable,
    bits: &[Bit<'_>],
    columns: &[[u16; 2]],
) -> (Vec<f32>, Vec<f32>) {
    let (w, h) = (captured.width, captured.height);
    // Along camera rows or camera columns: whichever crosses more borders.
    let known = |i: usize| columns[i][0] <= columns[i][1];
    let steps = |stride: usize, last: &dyn Fn(usize) -> bool| -> u64 {
        (0..w * h - stride.min(w * h))
            .filter(|i| !last(*i) && known(*i) && known(i + stride))
            .map(|i| i32::from(columns[i][0]).abs_diff(i32::from(columns[i + stride][0])))
            .filter(|d| *d <= MAX_STEP as u32)
            .map(u64::from)
            .sum()
    };
    let along_rows = steps(1, &|i| i % w + 1 == w) >= steps(w, &|_| false);
    let (n_lines, length, stride) = if along_rows { (h, w, 1) } else { (w, h, w) };
    let mut at = vec![f32::NAN; n_lines * length];
    let mut sigma = vec![f32::NAN; n_lines * length];
    at.par_chunks_mut(length).zip(sigma.par_chunks_mut(length)).enumerate().for_each_init(
        Vec::<Crossing>::new,
        |crossings, (line, (at, sigma))| {
            let first = if along_rows { line * w } else { line };
            let pixel = |x: usize| first + x * stride;
            let mut x = 0;
            while x < length {
                if !known(pixel(x)) {
                    x += 1;
                    continue;
                }
                // A run of pixels on one surface.
                let start = x;
                crossings.clear();
                while x + 1 < length {
                    let (i, j) = (pixel(x), pixel(x + 1));
                    if !known(j) {
                        break;
                    }
                    let step = middle(columns[j]) - middle(columns[i]);
                    if step.abs() > MAX_STEP as f32 {
                        break;
                    }
                    if columns[i] != columns[j] {
                        crossings.extend(crossing(captured, table, bits, columns, [i, j], x as f32));
                    }
                    x += 1;
                }
                let end = x;
                fill(&mut at[start..=end], &mut sigma[start..=end], crossings, start, |x| columns[pixel(x)]);
                x = end + 1;
            }
        },
    );
    if along_rows { (at, sigma) } else { (transposed(&at, h, w), transposed(&sigma, h, w)) }
}

fn middle(c: [u16; 2]) -> f32 {
    0.5 * (f32::from(c[0]) + f32::from(c[1]))
}

/// Finds the crossing between two neighboring pixels of different columns, from the bits that change once between these
/// columns.
fn crossing(
    captured: &Captured,
    table: &GrayTable,
    bits: &[Bit<'_>],
    columns: &[[u16; 2]],
    [i, j]: [usize; 2],
    x: f32,
) -> Option<Crossing> {
    let (a, b) = (columns[i], columns[j]);
    let (low, high) = if a[0] < b[0] { (a[1], b[0]) } else { (b[1], a[0]) };
    let (mut sum, mut borders, mut n, mut slope) = (0.0, 0.0, 0.0f32, 0.0f32);
    for (k, bit) in bits.iter().enumerate() {
        let shift = bits.len() - 1 - k;
        let value = |u: u16| table.words[usize::from(u)] >> shift & 1;
        let mut changes = (low..high).filter(|u| value(*u) != value(u + 1));
        let (Some(border), None) = (changes.next(), changes.next()) else { continue };
        let (d, e) = (bit.at(i), bit.at(j));
        if (d > 0.0) == (e > 0.0) {
            continue;
        }
        sum += d / (d - e);
        borders += f32::from(border) + 0.5;
        slope += (d - e).abs();
        n += 1.0;
    }
    if n == 0.0 {
        return None;
    }
    // The noise of a zero crossing, in camera px, is that of the difference over its slope; then in projector px.
    let noise = bits[0].sigma(captured.variance(i, 0.5).sqrt()) / (slope / n).max(1e-3) / n.sqrt();
    let scale = (middle(b) - middle(a)).abs().max(0.5);
    let sigma = (noise * scale).hypot(CROSSING_PX).min(0.5 * scale);
    Some(Crossing { position: x + sum / n, border: borders / n, sigma })
}

/// Fills in the columns of a run's pixels, `at`, and their standard deviations, `sigma`, both projector px: linear
/// between crossings, the column's center outside of them. `crossings` are in the order of their positions, `start` is
/// the position of the first pixel, and `column` gives the first and last column that a position decoded to.
///
/// # Panics
///
/// If `sigma` is shorter than `at`.
pub fn fill(
    at: &mut [f32],
    sigma: &mut [f32],
    crossings: &[Crossing],
    start: usize,
    column: impl Fn(usize) -> [u16; 2],
) {
    let mut next = 0;
    for k in 0..at.len() {
        let x = (start + k) as f32;
        while next < crossings.len() && crossings[next].position < x {
            next += 1;
        }
        let c = column(start + k);
        let width = f32::from(c[1] - c[0]) + 1.0;
        // A uniform error over the column's width.
        (at[k], sigma[k]) = (middle(c), width / 12f32.sqrt());
        if next == 0 || next == crossings.len() {
            continue;
        }
        let (p, q) = (crossings[next - 1], crossings[next]);
        let span = q.position - p.position;
        if span <= 0.0 {
            continue;
        }
        let f = (x - p.position) / span;
        let value = p.border + f * (q.border - p.border);
        // A crossing that noise put wrong must not carry a pixel out of the column that it decoded to.
        if (value - middle(c)).abs() <= 0.5 * width + 0.5 {
            at[k] = value;
            sigma[k] = ((1.0 - f) * p.sigma).hypot(f * q.sigma);
        }
    }
}

/// Returns `height` rows of `width` values each as `width` rows of `height`.
pub fn transposed(v: &[f32], width: usize, height: usize) -> Vec<f32> {
    (0..v.len()).into_par_iter().map(|i| v[i % height * width + i / height]).collect()
}
