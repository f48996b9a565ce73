//! Means over squares.

use rayon::prelude::*;

/// Rows that are summed side by side: the sum of one row is a chain in which every addition waits for the one before it.
const ROWS: usize = 8;
/// Columns that are summed side by side, by one thread.
const COLUMNS: usize = 256;

/// In-place mean over a square of the given radius (zero outside), by running sums.
pub fn box_mean(v: &mut [f32], w: usize, h: usize, radius: usize) {
    if w == 0 || h == 0 {
        return;
    }
    let norm = 1.0 / (2 * radius + 1) as f32;
    v.par_chunks_mut(ROWS * w).for_each_init(|| vec![[0.0; ROWS]; w], |line, rows| along(rows, line, radius, norm));
    // Each thread has some columns of all rows.
    let mut strips: Vec<Vec<&mut [f32]>> = (0..w.div_ceil(COLUMNS)).map(|_| Vec::with_capacity(h)).collect();
    for row in v.chunks_exact_mut(w) {
        strips.iter_mut().zip(row.chunks_mut(COLUMNS)).for_each(|(strip, part)| strip.push(part));
    }
    strips.into_par_iter().for_each(|mut strip| down(&mut strip, radius, norm));
}

/// Takes the means of some rows along them, by way of `line`.
fn along(rows: &mut [f32], line: &mut [[f32; ROWS]], radius: usize, norm: f32) {
    let w = line.len();
    let n = rows.len() / w;
    for (j, row) in rows.chunks_exact(w).enumerate() {
        line.iter_mut().zip(row).for_each(|(l, v)| l[j] = *v);
    }
    let mut sums = [0.0f64; ROWS];
    for l in line.iter().take(radius) {
        (0..ROWS).for_each(|j| sums[j] += f64::from(l[j]));
    }
    for i in 0..w {
        if i + radius < w {
            let l = &line[i + radius];
            (0..ROWS).for_each(|j| sums[j] += f64::from(l[j]));
        }
        if i > radius {
            let l = &line[i - radius - 1];
            (0..ROWS).for_each(|j| sums[j] -= f64::from(l[j]));
        }
        for j in 0..n {
            rows[j * w + i] = sums[j] as f32 * norm;
        }
    }
}

/// Takes the means of some columns down all rows: rows that have been overwritten are still needed for a while.
fn down(rows: &mut [&mut [f32]], radius: usize, norm: f32) {
    let (w, h) = (rows[0].len(), rows.len());
    let mut sums = vec![0.0f64; w];
    let mut kept = vec![0.0f32; (radius + 1) * w];
    for row in rows.iter().take(radius) {
        sums.iter_mut().zip(row.iter()).for_each(|(s, v)| *s += f64::from(*v));
    }
    for y in 0..h {
        if y + radius < h {
            sums.iter_mut().zip(rows[y + radius].iter()).for_each(|(s, v)| *s += f64::from(*v));
        }
        let slot = y % (radius + 1) * w;
        if y > radius {
            sums.iter_mut().zip(&kept[slot..slot + w]).for_each(|(s, v)| *s -= f64::from(*v));
        }
        let row = &mut rows[y];
        kept[slot..slot + w].copy_from_slice(row);
        row.iter_mut().zip(&sums).for_each(|(v, s)| *v = *s as f32 * norm);
    }
}
