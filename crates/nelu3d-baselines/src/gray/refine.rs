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

/// Where light comes from the border of two columns: position along the scan line (camera px) and that border
/// (projector px).
#[derive(Clone, Copy)]
struct Crossing {
    position: f32,
    border: f32,
    sigma: f32,
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

/// Fills in the columns of a run's pixels: linear between crossings, the column's center outside of them.
fn fill(at: &mut [f32], sigma: &mut [f32], crossings: &[Crossing], start: usize, column: impl Fn(usize) -> [u16; 2]) {
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

fn transposed(v: &[f32], width: usize, height: usize) -> Vec<f32> {
    (0..v.len()).into_par_iter().map(|i| v[i % height * width + i / height]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sloped_run_is_exact_between_crossings() {
        // u = 0.37 x + 3.2: crossings where u = k + 1/2.
        let u = |x: f32| 0.37 * x + 3.2;
        let crossings: Vec<Crossing> = (4..14)
            .map(|k| Crossing { position: (k as f32 + 0.5 - 3.2) / 0.37, border: k as f32 + 0.5, sigma: 0.05 })
            .collect();
        let (mut at, mut sigma) = (vec![0.0; 30], vec![0.0; 30]);
        fill(&mut at, &mut sigma, &crossings, 0, |x| [u(x as f32).round() as u16; 2]);
        for x in 0..30 {
            if (crossings[0].position..crossings[9].position).contains(&(x as f32)) {
                assert!((at[x] - u(x as f32)).abs() < 1e-4 && sigma[x] < 0.06, "{x}");
            } else {
                assert!((at[x] - u(x as f32)).abs() <= 0.5 && (sigma[x] - 0.2887).abs() < 1e-3, "{x}");
            }
        }
    }

    #[test]
    fn transposing_goes_there_and_back() {
        let v: Vec<f32> = (0..12).map(|i| i as f32).collect();
        let t = transposed(&v, 4, 3);
        assert_eq!(t[..4], [0.0, 4.0, 8.0, 1.0]);
        assert_eq!(transposed(&t, 3, 4), v);
    }
}
