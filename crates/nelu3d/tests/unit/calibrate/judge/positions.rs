use nalgebra::{Matrix3, Vector3};
use nelu3d::calibrate::judge::positions::{PositionSums, exposure_scatter, standing_out, typical};
use nelu3d::verdict::Code;

/// What happens to a position's codeword, given the field's there and beside.
type Edit<'a> = dyn Fn(&mut [f32], &[Vec<f32>; 4]) + 'a;

/// Eight positions of three channels; position 5 is changed by `edit(v, c)`.
fn positions(edit: impl Fn(&mut [f32], &[Vec<f32>; 4])) -> Vec<PositionSums> {
    let at = |x: f32| vec![0.5 + 0.5 * x.sin(), 0.5 + 0.5 * (2.3 * x).cos(), 0.5 + 0.4 * (0.7 * x + 1.0).sin()];
    (0..8)
        .map(|p| {
            let mut s = PositionSums {
                p,
                n: 0,
                error: 0.0,
                of_samples: Vec::new(),
                channels: vec![[0.0; 5]; 3],
                cross: std::array::from_fn(|_| vec![0.0; 9]),
                shift: (Matrix3::zeros(), Vector3::zeros()),
            };
            for i in 0..2000 {
                let x = 0.05 * (i % 100) as f32 + 0.3 * (i / 100) as f32;
                let c = [at(x), at(x + 0.05), at(x + 0.01), at(x - 0.004)];
                let noise = |j: usize| 0.01 * (((i * 31 + j * 17 + p * 7) % 41) as f32 / 20.0 - 1.0);
                let mut v: Vec<f32> = (0..3).map(|j| c[0][j] + noise(j)).collect();
                if p == 5 {
                    edit(&mut v, &c);
                }
                s.add(&v, &c);
            }
            s
        })
        .collect()
}

#[test]
fn a_wrong_position_stands_out_and_is_explained() {
    let images = ["a.png".to_string(), "b.png".into(), "c.png".into()];
    let found = |edit: &Edit<'_>| {
        let all = positions(edit);
        let out = standing_out(&all);
        let typical = typical(&all);
        out.iter().map(|i| (*i, all[*i].finding("005", &images, typical))).collect::<Vec<_>>()
    };
    assert!(found(&|_, _| {}).is_empty());
    let cases: [(Code, &Edit<'_>); 5] = [
        (Code::PatternsSwapped, &|v, _| v.swap(0, 1)),
        (Code::ExposureJump, &|v, _| v.iter_mut().for_each(|v| *v /= 1.2)),
        (Code::ExposureJump, &|v, _| v[2] *= 0.8),
        (Code::PositionMoved, &|v, c| (0..3).for_each(|j| v[j] += 2.0 * (c[1][j] - c[0][j]))),
        (Code::PositionDisagrees, &|v, c| (0..3).for_each(|j| v[j] = if c[0][0] > 0.5 { 0.1 } else { 0.3 })),
    ];
    for (code, edit) in cases {
        let found = found(edit);
        assert_eq!(found.len(), 1, "{code:?}");
        assert_eq!((found[0].0, found[0].1.code), (5, code), "{}", found[0].1);
    }
    let white = found(&|v, _| v.iter_mut().for_each(|v| *v /= 1.2));
    assert!(white[0].1.sentence.contains("white is 20 % brighter"), "{}", white[0].1);
}

/// A hand over a twenty-fifth of a board, far off in all channels, does not make the position wrong; over a quarter it
/// does.
#[test]
fn a_hand_at_the_edge_of_a_board_is_not_a_wrong_position() {
    let held = |every: u32| {
        let n = std::cell::Cell::new(0u32);
        let all = positions(|v, c| {
            n.set(n.get() + 1);
            if n.get().is_multiple_of(every) {
                (0..3).for_each(|j| v[j] = 1.0 - c[0][j]);
            }
        });
        standing_out(&all)
    };
    assert!(held(25).is_empty());
    assert_eq!(held(4), [5]);
}

#[test]
fn exposure_that_changes_everywhere_is_told() {
    let mut all = positions(|_, _| {});
    assert!(exposure_scatter(&all, &[]).is_none());
    for (i, s) in all.iter_mut().enumerate() {
        // The second pattern darker or brighter by 8 %.
        let g = if i % 2 == 0 { 1.08 } else { 0.92 };
        let [_, v, cc, vv, e] = &mut s.channels[1];
        let both = 0.5 * (*cc + *vv - *e) * g;
        (*v, *vv) = (*v * g, *vv * g * g);
        *e = *cc + *vv - 2.0 * both;
    }
    let found = exposure_scatter(&all, &["a.png".into(), "b.png".into(), "c.png".into()]).unwrap();
    assert!(found.code == Code::ExposureJump && found.sentence.contains("b.png"), "{found}");
}
