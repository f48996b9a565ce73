use nelu3d_scan::pattern::{Axis, Hilbert, Pattern, SplitMix, hilbert_codewords, hilbert_point};

use super::images;

#[test]
fn the_curve_visits_every_point_once_by_single_steps() {
    for (k, bits) in [(2, 1), (2, 4), (3, 3), (4, 2), (5, 2)] {
        let all: Vec<Vec<u32>> = (0..1_u64 << (bits * k as u32)).map(|i| hilbert_point(i, k, bits)).collect();
        assert_eq!(all[0], vec![0; k]);
        let different: std::collections::HashSet<_> = all.iter().collect();
        assert_eq!(different.len(), all.len());
        assert!(all.iter().flatten().all(|&c| c < 1 << bits));
        for pair in all.windows(2) {
            let step: u32 = pair[0].iter().zip(&pair[1]).map(|(a, b)| a.abs_diff(*b)).sum();
            assert_eq!(step, 1, "{pair:?}");
        }
    }
}

#[test]
fn captures_decode_to_their_columns() {
    let mut random = SplitMix(1);
    for (n, k) in [(1280, 3), (1920, 4), (640, 5), (2, 2)] {
        let images = images(Pattern::Hilbert(Hilbert { axis: Axis::X, count: k }), n, 1).unwrap();
        let words = hilbert_codewords(n, k).unwrap();
        let n_bits = n.next_power_of_two().trailing_zeros();
        let step = 2.0_f64.powi(-(n_bits.div_ceil(k as u32) as i32));
        for u in 0..n {
            let seen: Vec<f32> = images
                .iter()
                .map(|i| (f64::from(i.data[u]) + 0.08 * step * random.normal()) as f32)
                .map(|v| (v * 255.0).round() / 255.0)
                .collect();
            assert_eq!(words.nearest(&seen).unwrap().0, u, "{n} columns in {k} images");
        }
    }
}

#[test]
fn values_are_those_of_lookup3d() {
    // 1280 columns in 3 images: b = ⌈10.3 / 3⌉ = 4, so 16 levels, (c + 1) · 16 − 1.
    let words = hilbert_codewords(1280, 3).unwrap();
    assert_eq!(words.word(0), [15.0 / 255.0; 3]);
    assert!(words.data.iter().all(|v| (v * 255.0 + 1.0) % 16.0 < 1e-3 && *v <= 1.0));
}

#[test]
fn too_few_images_are_refused() {
    assert!(hilbert_codewords(1280, 1).is_err());
    assert!(hilbert_codewords(70_000, 2).is_err());
    assert!(hilbert_codewords(64, 17).is_err());
}
