use nelu3d_scan::pattern::{Axis, BitCode, SplitMix};

const CODES: [BitCode; 5] = [
    BitCode::Binary,
    BitCode::Gray,
    BitCode::Xor { base_bit: 0 },
    BitCode::Xor { base_bit: 1 },
    BitCode::Xor { base_bit: 4 },
];

#[test]
fn words_are_columns_and_back() {
    for code in CODES {
        for bits in [5, 11, 31, 32] {
            let mut seen = std::collections::HashSet::new();
            let last = u32::MAX >> (32 - bits);
            for u in (0..2000).map(|i| i * (last / 1999).max(1)).filter(|&u| u <= last) {
                let word = code.word(u, bits);
                assert!(word <= last && seen.insert(word), "{code:?}: word {word} of {u} twice");
                assert_eq!(code.column(word, bits), u, "{code:?} of {bits} bits");
            }
        }
    }
}

#[test]
fn captures_with_gain_offset_codes_and_noise_decode() {
    let mut random = SplitMix(7);
    for code in CODES {
        for (axis, n) in [(Axis::X, 1280), (Axis::Y, 801), (Axis::X, 33)] {
            let (w, h) = if axis == Axis::X { (n, 2) } else { (2, n) };
            let [mut images, mut inverse] = code.generate(axis, true, w, h);
            for image in images.iter_mut().chain(&mut inverse) {
                for v in &mut image.data {
                    let seen = 0.7 * f64::from(*v) + 0.15 + 0.05 * random.normal();
                    *v = ((seen * 255.0).round() / 255.0) as f32;
                }
            }
            for inverse in [inverse.as_slice(), &[]] {
                let got = code.decode_images(&images, inverse, 0.02);
                for (i, column) in got.iter().enumerate() {
                    let expected = if axis == Axis::X { i % w } else { i / w };
                    assert_eq!(*column, Some(expected as u32), "{code:?} of {n} along {axis:?}");
                }
            }
        }
    }
}

#[test]
fn weak_and_absent_bits_do_not_decode() {
    for code in CODES {
        let [mut images, _] = code.generate(Axis::X, false, 64, 1);
        images[2].data[10] = 0.55;
        images[4].data[11] = f32::NAN;
        let got = code.decode_images(&images, &[], 0.1);
        assert_eq!((got[9], got[10], got[11], got[12]), (Some(9), None, None, Some(12)));
    }
}
