//! Binary codes: Gray, binary, XOR or any other, whatever table the projected images spell.
//!
//! A bit is the sign of pattern − inverse, or of pattern − ½ (halfway between white and black) where there are no inverses.
//! A bit that the noise could have turned is uncertain. One uncertain bit is fine where both of its values name neighboring
//! columns, which in a Gray code is the edge between them; anything else leaves the pixel out.
//!
//! Columns are refined to sub-pixel: where neighboring pixels along the camera's row (or column, for a projector turned by a
//! right angle) decode to different columns, the bit that tells them apart changes sign between them, and the zero crossing
//! of the difference, found by linear interpolation, lies where the light comes from the border of two projector columns.
//! Between two such crossings the column is interpolated. Pixels before the first and behind the last crossing of a run keep
//! the center of their column, with the standard deviation of a uniform error over its width.

use std::collections::HashMap;

use nelu3d_scan::rig::PatternSet;
use rayon::prelude::*;

use super::captured::Captured;
use super::code::{AxisCode, Code};
use super::coordinates::{Coordinate, DecodedCoordinates};
use super::error::DecodeError;
use nelu3d::surface::PixelStatus;

/// A bit nearer to its threshold than this many standard deviations of the noise is uncertain.
const CERTAIN: f32 = 3.0;

/// A bit nearer to its threshold than this share of full contrast is uncertain: indirect light turns such bits.
const LEAST: f32 = 0.03;

/// Two columns further apart than this belong to different surfaces.
const MAX_STEP: i32 = 6;

/// Standard deviation of a zero crossing that noise does not explain, projector px: blur that is not symmetric, curvature
/// between two pixels.
const CROSSING_PX: f32 = 0.05;

/// A table from codewords to columns.
pub(crate) struct Table {
    /// First and last column of every codeword that occurs.
    columns: Columns,
    /// Codeword of every column.
    words: Vec<u32>,
}

enum Columns {
    /// Indexed by codeword; `first > last` where it does not occur.
    Dense(Vec<[u16; 2]>),
    Sparse(HashMap<u32, [u16; 2]>),
}

impl Table {
    /// The table of one axis.
    pub(crate) fn new(code: &AxisCode, set: &PatternSet) -> Result<Self, DecodeError> {
        let unsuited = |problem: String, remedy: &str| DecodeError::Unsuited {
            set: set.name.clone(),
            method: "gray",
            problem,
            remedy: remedy.into(),
        };
        let bits = code.lines.len();
        if bits > 32 || code.len() > usize::from(u16::MAX) {
            let problem = format!("it has {bits} images along one axis of {} px, and 32 bits are the most", code.len());
            return Err(unsuited(problem, "use --method zncc"));
        }
        if let Some(line) = code.lines.iter().find(|l| l.values.iter().any(|v| (0.1..0.9).contains(v))) {
            let problem = format!("{} has values between black and white", line.path.display());
            return Err(unsuited(problem, "use --method phase, mps or zncc"));
        }
        let words: Vec<u32> = (0..code.len())
            .map(|u| code.lines.iter().fold(0, |word, l| word << 1 | u32::from(l.values[u] > 0.5)))
            .collect();
        let mut columns =
            if bits <= 16 { Columns::Dense(vec![[1, 0]; 1 << bits]) } else { Columns::Sparse(HashMap::new()) };
        for (u, word) in words.iter().enumerate() {
            let u = u as u16;
            let known = match &mut columns {
                Columns::Dense(all) => &mut all[*word as usize],
                Columns::Sparse(all) => all.entry(*word).or_insert([1, 0]),
            };
            if known[0] > known[1] {
                *known = [u, u];
            } else if known[1] + 1 == u {
                known[1] = u;
            } else {
                let problem = format!("its columns {} and {u} have the same codeword", known[1]);
                return Err(unsuited(problem, "list the images of all bits in the set"));
            }
        }
        Ok(Self { columns, words })
    }

    /// First and last column of a codeword.
    fn get(&self, word: u32) -> Option<[u16; 2]> {
        let found = match &self.columns {
            Columns::Dense(all) => all[word as usize],
            Columns::Sparse(all) => *all.get(&word)?,
        };
        (found[0] <= found[1]).then_some(found)
    }
}

/// Decodes all axes of a code.
pub(crate) fn decode(captured: &Captured, code: &Code, set: &PatternSet) -> Result<DecodedCoordinates, DecodeError> {
    if code.colored {
        return Err(DecodeError::Unsuited {
            set: set.name.clone(),
            method: "gray",
            problem: "its images are colored".into(),
            remedy: "use --method zncc".into(),
        });
    }
    let mut status = captured.status.clone();
    let mut coordinates = Vec::new();
    for axis in &code.axes {
        let table = Table::new(axis, set)?;
        let bits: Vec<Bit<'_>> = axis.lines.iter().map(|l| Bit::new(captured, l.image)).collect();
        let columns = columns(captured, &table, &bits);
        for (l, c) in status.iter_mut().zip(&columns) {
            if *l == PixelStatus::Valid && c[0] > c[1] {
                *l = PixelStatus::Ambiguous;
            }
        }
        let (at, sigma) = refine(captured, &table, &bits, &columns);
        coordinates.push(Coordinate { axis: axis.axis, at, sigma });
    }
    Ok(DecodedCoordinates { coordinates, status })
}

/// One bit's difference from its threshold, in units of white − black: positive is bright.
struct Bit<'a> {
    p: std::borrow::Cow<'a, [f32]>,
    inverse: Option<std::borrow::Cow<'a, [f32]>>,
}

impl<'a> Bit<'a> {
    fn new(captured: &'a Captured, image: usize) -> Self {
        let has = captured.planes.iter().any(|p| p.image == image && !p.inverse.is_empty());
        Self { p: captured.gray(image, false), inverse: has.then(|| captured.gray(image, true)) }
    }

    #[inline]
    fn at(&self, i: usize) -> f32 {
        match &self.inverse {
            // Half of the difference, so that both kinds have the same scale.
            Some(inverse) => 0.5 * (self.p[i] - inverse[i]),
            None => self.p[i] - 0.5,
        }
    }

    /// Standard deviation of [`Self::at`] at a pixel whose normalized intensity has this one.
    fn sigma(&self, sigma: f32) -> f32 {
        if self.inverse.is_some() { sigma * std::f32::consts::FRAC_1_SQRT_2 } else { sigma }
    }
}

/// First and last column of every pixel's codeword; first > last where there is none.
fn columns(captured: &Captured, table: &Table, bits: &[Bit<'_>]) -> Vec<[u16; 2]> {
    const NONE: [u16; 2] = [1, 0];
    /// Pixels at a time: bit after bit, so that a pass over them is one over an image.
    const CHUNK: usize = 2048;
    let resolve = |word: u32, uncertain: u32| -> [u16; 2] {
        let Some(found) = table.get(word) else { return NONE };
        match uncertain.count_ones() {
            0 => found,
            1 => match table.get(word ^ uncertain) {
                Some(other) if other[0] == found[1] + 1 || found[0] == other[1] + 1 => found,
                // The other value does not occur: it cannot have been meant.
                None => found,
                Some(_) => NONE,
            },
            _ => NONE,
        }
    };
    let mut out = vec![NONE; captured.status.len()];
    out.par_chunks_mut(CHUNK).enumerate().for_each_init(
        || (vec![0.0f32; CHUNK], vec![0u32; CHUNK], vec![0u32; CHUNK]),
        |(limits, words, uncertain), (chunk, out)| {
            let (first, n) = (chunk * CHUNK, out.len());
            let kept = |k: usize| captured.status[first + k] == PixelStatus::Valid;
            for k in 0..n {
                let noise = if kept(k) { captured.variance(first + k, 0.5).sqrt() } else { 0.0 };
                limits[k] = (bits[0].sigma(noise) * CERTAIN).max(LEAST);
            }
            words.fill(0);
            uncertain.fill(0);
            for bit in bits {
                let mut add = |k: usize, d: f32| {
                    words[k] = words[k] << 1 | u32::from(d > 0.0);
                    uncertain[k] = uncertain[k] << 1 | u32::from(d.abs() < limits[k]);
                };
                let p = &bit.p[first..first + n];
                match &bit.inverse {
                    Some(inverse) => {
                        let inverse = &inverse[first..first + n];
                        (0..n).for_each(|k| add(k, 0.5 * (p[k] - inverse[k])));
                    }
                    None => (0..n).for_each(|k| add(k, p[k] - 0.5)),
                }
            }
            for k in (0..n).filter(|k| kept(*k)) {
                out[k] = resolve(words[k], uncertain[k]);
            }
        },
    );
    out
}

/// Where light comes from the border of two columns: position along the scan line (camera px) and that border (projector px).
#[derive(Clone, Copy)]
struct Crossing {
    position: f32,
    border: f32,
    sigma: f32,
}

/// Columns to sub-pixel, with their standard deviations.
fn refine(captured: &Captured, table: &Table, bits: &[Bit<'_>], columns: &[[u16; 2]]) -> (Vec<f32>, Vec<f32>) {
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

/// The crossing between two neighboring pixels of different columns, from the bits that change once between these columns.
fn crossing(
    captured: &Captured,
    table: &Table,
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

/// Columns of a run's pixels: linear between crossings, the column's center outside of them.
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
    use nelu3d_scan::pattern::{Axis, Gray, Pattern};

    fn gray_code(n: usize) -> AxisCode {
        let images = Pattern::Gray(Gray { axis: Axis::X, inverse: false }).generate(n, 1).unwrap().images;
        let line = |(image, p): (usize, nelu3d_scan::pattern::PatternImage)| crate::code::Line {
            image,
            channel: 0,
            path: "p.png".into(),
            values: p.image.data,
        };
        AxisCode { axis: Axis::X, lines: images.into_iter().enumerate().map(line).collect() }
    }

    fn set() -> PatternSet {
        PatternSet { name: "s".into(), images: Vec::new(), inverse: Vec::new() }
    }

    #[test]
    fn every_column_has_its_codeword() {
        let code = gray_code(600);
        let table = Table::new(&code, &set()).unwrap();
        for u in 0..600u16 {
            assert_eq!(table.get(table.words[usize::from(u)]), Some([u, u]));
        }
        // Without the finest bit, pairs of columns share one.
        let mut coarse = code.clone();
        coarse.lines.pop();
        let table = Table::new(&coarse, &set()).unwrap();
        assert_eq!(table.get(table.words[101]), Some([100, 101]));
        // Without the coarsest, distant columns do.
        let mut ambiguous = code;
        ambiguous.lines.remove(0);
        let error = Table::new(&ambiguous, &set()).err().unwrap().to_string();
        assert!(error.contains("same codeword"), "{error}");
    }

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
