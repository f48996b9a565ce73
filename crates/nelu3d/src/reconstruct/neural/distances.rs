//! Exact distances on a grid of cells.

/// Returns the signed distances from cells to the border of the marked ones, in cells, negative within; `size` is that
/// of the grid, the fastest axis first.
pub(super) fn signed_distances(marked: &[bool], size: &[usize]) -> Vec<f32> {
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

/// Writes min over j of (i − j)² + line[j]: the lower envelope of parabolas.
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

#[cfg(test)]
mod tests {
    use super::*;
    use rand::rngs::StdRng;
    use rand::{RngExt, SeedableRng};

    /// Against all pairs of cells.
    #[test]
    fn distances_are_those_of_all_pairs() {
        let mut rng = StdRng::seed_from_u64(1);
        for (size, share) in [([7usize, 5, 6], 0.1), ([9, 4, 1], 0.5), ([5, 5, 5], 0.95)] {
            let n = size.iter().product();
            let marked: Vec<bool> = (0..n).map(|_| rng.random::<f32>() < share).collect();
            let found = signed_distances(&marked, &size);
            let place = |i: usize| [i % size[0], i / size[0] % size[1], i / size[0] / size[1]];
            for i in 0..n {
                let square = |j: usize| (0..3).map(|a| (place(i)[a] as f32 - place(j)[a] as f32).powi(2)).sum::<f32>();
                let others = (0..n).filter(|&j| marked[j] != marked[i]);
                let nearest = others.map(square).fold(f32::INFINITY, f32::min).sqrt() - 0.5;
                let expected = if marked[i] { -nearest } else { nearest };
                assert!(found[i] == expected || (found[i] - expected).abs() < 1e-5, "{i}: {} {expected}", found[i]);
            }
        }
    }

    #[test]
    fn without_a_border_it_is_infinitely_far() {
        assert!(signed_distances(&[true; 4], &[2, 2]).iter().all(|d| *d == f32::NEG_INFINITY));
        assert!(signed_distances(&[false; 4], &[2, 2]).iter().all(|d| *d == f32::INFINITY));
    }
}
