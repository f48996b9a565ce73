use crate::check::uniform_f32;
use nelu3d_field::normal::{NodeStrides, Place, Weights, add_product, add_spread, reference};

/// Samples in the order of their cells, some of them several to a cell.
fn samples(cells: [usize; 3], k: usize, n: usize) -> (NodeStrides, Vec<Place>, usize) {
    let [na, nb, nw] = cells.map(|c| c + 3);
    let strides = NodeStrides { k, row: na * nw * k, column: nw * k };
    let numbers = uniform_f32(11, n * 5, 0.0, 1.0);
    let place = |(i, v): (usize, &[f32])| {
        let cell = i * cells.iter().product::<usize>() / n;
        let [w, a, b] = [cell % cells[2], cell / cells[2] % cells[0], cell / cells[2] / cells[0]];
        let base = (b * strides.row + a * strides.column + w * k) as u32;
        Place { base, position: [v[0], v[1], v[2]], spread: [0.25 * v[3], 0.25 * v[4]] }
    };
    (strides, numbers.chunks_exact(5).enumerate().map(place).collect(), na * nb * nw * k)
}

fn check_close(fast: &[f32], plain: &[f64], what: &str) {
    let scale = plain.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    assert!(scale > 0.1, "{what}");
    for (i, (a, b)) in fast.iter().zip(plain).enumerate() {
        assert!((f64::from(*a) - b).abs() < 2e-6 * scale, "{what}, {i}: {a} {b}");
    }
}

#[test]
fn the_fast_form_agrees_with_the_reference() {
    for k in [1, 2, 3, 4, 5, 6, 7, 10, 20, 31] {
        let (strides, places, n) = samples([5, 4, 2], k, 131);
        let (x, omegas) = (uniform_f32(1, n, -1.0, 1.0), uniform_f32(2, places.len() * k, 0.0, 2.0));
        let begin = uniform_f32(3, n, -1.0, 1.0);
        let plain = || begin.iter().map(|v| f64::from(*v)).collect::<Vec<_>>();
        let (mut fast, mut expected) = (begin.clone(), plain());
        add_product(strides, &places, &omegas, &x, &mut fast);
        reference::add_product(strides, &places, &omegas, &x, &mut expected);
        check_close(&fast, &expected, &format!("product of {k} channels"));
        for by in [Weights::Plain, Weights::Squared] {
            let (mut fast, mut expected) = (begin.clone(), plain());
            add_spread(strides, &places, &omegas, by, &mut fast);
            reference::add_spread(strides, &places, &omegas, by, &mut expected);
            check_close(&fast, &expected, &format!("{by:?} of {k} channels"));
        }
    }
}

#[test]
fn no_samples_add_nothing() {
    let (strides, _, n) = samples([3, 3, 1], 3, 1);
    let mut y = vec![1.0; n];
    add_product(strides, &[], &[], &vec![2.0; n], &mut y);
    assert!(y.iter().all(|y| *y == 1.0));
}

#[test]
#[should_panic(expected = "every run lies in x and y")]
fn a_place_beyond_the_nodes_is_an_error() {
    let (strides, mut places, n) = samples([3, 3, 1], 3, 5);
    places[4].base = n as u32;
    add_product(strides, &places, &[1.0; 15], &vec![0.0; n], &mut vec![0.0; n]);
}
