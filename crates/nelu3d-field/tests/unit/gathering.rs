use crate::check::uniform_f32;
use nelu3d_field::gathering::{Patches, Receiver, gather, reference};

fn patches(n: usize, values: usize, seed: u64) -> Patches {
    let list = |i: u64, lo: f64, hi: f64| uniform_f32(seed + i, n, lo, hi);
    let mut normal = [list(4, -1.0, 1.0), list(5, -1.0, 1.0), list(6, -1.0, -0.1)];
    for j in 0..n {
        let len = normal.iter().map(|v| v[j] * v[j]).sum::<f32>().sqrt();
        normal.iter_mut().for_each(|v| v[j] /= len);
    }
    Patches {
        center: [list(1, -50.0, 50.0), list(2, -50.0, 50.0), list(3, 600.0, 700.0)],
        normal,
        area: list(7, 0.1, 4.0),
        sent: (0..values as u64).map(|v| list(8 + v, 0.0, 1.0)).collect(),
    }
}

#[test]
fn the_fast_form_agrees_with_the_reference() {
    for (n, values, n_points) in [(1000, 4, 9), (7, 1, 4), (256, 12, 1), (0, 2, 3)] {
        let patches = patches(n, values, 3);
        let coordinates = uniform_f32(1, 6 * n_points, -1.0, 1.0);
        let points: Vec<Receiver> = coordinates
            .chunks_exact(6)
            .map(|c| {
                let len = (c[3] * c[3] + c[4] * c[4] + 1.0).sqrt();
                Receiver {
                    point: [40.0 * c[0], 40.0 * c[1], 650.0 + 60.0 * c[2]],
                    normal: [c[3] / len, c[4] / len, -1.0 / len],
                }
            })
            .collect();
        let mut out = vec![-1.0; n_points * values];
        gather(&patches, &points, &mut out);
        for (point, out) in points.iter().zip(out.chunks_exact(values)) {
            for (a, b) in out.iter().zip(reference::gather(&patches, point)) {
                assert!((f64::from(*a) - b).abs() <= 1e-4 * b.abs() + 1e-7, "{n} patches: {a} {b}");
            }
        }
    }
}

/// A small disc far away, both facing each other: cos cos A / (π r²).
#[test]
fn a_disc_far_away_has_its_solid_angle() {
    let one = |v: f32| vec![v];
    let patches = Patches {
        center: [one(0.0), one(0.0), one(100.0)],
        normal: [one(0.0), one(0.0), one(-1.0)],
        area: one(1.0),
        sent: vec![one(2.0)],
    };
    let mut out = [0.0];
    gather(&patches, &[Receiver { point: [0.0; 3], normal: [0.0, 0.0, 1.0] }], &mut out);
    let expected = 2.0 / (std::f32::consts::PI * 1e4);
    assert!((out[0] / expected - 1.0).abs() < 1e-3, "{} {expected}", out[0]);
    // From behind it is dark.
    gather(&patches, &[Receiver { point: [0.0; 3], normal: [0.0, 0.0, -1.0] }], &mut out);
    assert_eq!(out, [0.0]);
}
