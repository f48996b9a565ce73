use nelu3d::reconstruct::neural::distances::signed_distances;
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
