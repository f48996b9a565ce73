//! Means over squares.

/// In-place mean over a square of the given radius (zero outside), by running sums.
pub fn box_mean(v: &mut [f32], w: usize, h: usize, radius: usize) {
    let norm = 1.0 / (2 * radius + 1) as f32;
    // Along the rows, some of them side by side: the sum of one row is a chain in which every addition waits for the one before it.
    const ROWS: usize = 8;
    let mut line = vec![[0.0f32; ROWS]; w];
    for rows in v.chunks_mut(ROWS * w) {
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
    // Down the columns, all of them at once: rows that have been overwritten are still needed for a while.
    let mut sums = vec![0.0f64; w];
    let mut kept = vec![0.0f32; (radius + 1) * w];
    for row in v.chunks_exact(w).take(radius) {
        sums.iter_mut().zip(row).for_each(|(s, v)| *s += f64::from(*v));
    }
    for y in 0..h {
        if y + radius < h {
            let row = &v[(y + radius) * w..][..w];
            sums.iter_mut().zip(row).for_each(|(s, v)| *s += f64::from(*v));
        }
        let slot = y % (radius + 1) * w;
        if y > radius {
            sums.iter_mut().zip(&kept[slot..slot + w]).for_each(|(s, v)| *s -= f64::from(*v));
        }
        let row = &mut v[y * w..(y + 1) * w];
        kept[slot..slot + w].copy_from_slice(row);
        row.iter_mut().zip(&sums).for_each(|(v, s)| *v = *s as f32 * norm);
    }
}
