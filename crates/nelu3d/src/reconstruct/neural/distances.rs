//! Exact distances on a grid of cells.

/// Returns the signed distances from cells to the border of the marked ones, in cells, negative within; `size` is that
/// of the grid, the fastest axis first.
pub fn signed_distances(marked: &[bool], size: &[usize]) -> Vec<f32> {
    let to = |which: bool| distances(&marked.iter().map(|m| *m == which).collect::<Vec<_>>(), size);
    // The border lies half way between the centers of two cells of different kind.
    let sides = to(true).into_iter().zip(to(false));
    sides.map(|(to_marked, to_free)| if to_marked > 0.0 { to_marked - 0.5 } else { 0.5 - to_free }).collect()
}

/// Returns the distances from the cells of a grid to the nearest of some cells, in cells: 0 at those, infinite if there
/// is none (Felzenszwalb & Huttenlocher 2012, *Distance Transforms of Sampled Functions*, Alg. 1, axis by axis).
fn distances(cells: &[bool], size: &[usize]) -> Vec<f32> {
    let mut squares: Vec<f32> = cells.iter().map(|c| if *c { 0.0 } else { f32::INFINITY }).collect();
    let mut stride = 1;
    for &n in size {
        let (mut line, mut out) = (vec![0.0; n], vec![0.0; n]);
        for first in (0..squares.len()).filter(|i| i / stride % n == 0) {
            for (j, v) in line.iter_mut().enumerate() {
                *v = squares[first + j * stride];
            }
            envelope(&line, &mut out);
            for (j, v) in out.iter().enumerate() {
                squares[first + j * stride] = *v;
            }
        }
        stride *= n;
    }
    squares.into_iter().map(f32::sqrt).collect()
}

/// Writes min over j of (i − j)² + `line[j]`: the lower envelope of parabolas.
fn envelope(line: &[f32], out: &mut [f32]) {
    // The parabolas of the envelope, and from where each is the lowest.
    let mut lowest: Vec<(usize, f32)> = Vec::with_capacity(line.len());
    for (j, &at) in line.iter().enumerate() {
        if at.is_infinite() {
            continue;
        }
        let mut from = f32::NEG_INFINITY;
        while let Some(&(k, k_from)) = lowest.last() {
            from = ((at - line[k]) + (j * j - k * k) as f32) / (2 * (j - k)) as f32;
            if from > k_from {
                break;
            }
            lowest.pop();
            from = f32::NEG_INFINITY;
        }
        lowest.push((j, from));
    }
    let mut at = 0;
    for (i, out) in out.iter_mut().enumerate() {
        while at + 1 < lowest.len() && lowest[at + 1].1 <= i as f32 {
            at += 1;
        }
        *out = lowest.get(at).map_or(f32::INFINITY, |&(j, _)| (i as f32 - j as f32).powi(2) + line[j]);
    }
}
