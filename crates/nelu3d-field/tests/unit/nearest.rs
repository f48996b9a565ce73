use crate::check::uniform_f32;
use nelu3d_field::nearest::{Codes, Hit, LANES, Shape, cpu, reference};

const SHAPE: Shape = Shape { n_channels: 3, n_positions: 21, stride: 24 };
const N: usize = 200;

/// Queries of which some lack channels.
fn queries() -> Vec<f32> {
    let mut q = uniform_f32(1, N * SHAPE.n_channels, 0.0, 1.0);
    q.iter_mut().step_by(7).for_each(|q| *q = f32::NAN);
    q[..SHAPE.n_channels].fill(f32::NAN);
    q
}

fn ranges() -> Vec<[u32; 2]> {
    (0..N as u32).map(|n| [n % 13, (n % 13 + n % 9).min(SHAPE.n_positions as u32)]).collect()
}

fn assert_same(codes: Codes<'_>) -> Vec<Hit> {
    let queries = queries();
    let mut all = Vec::new();
    for ranges in [None, Some(&ranges()[..])] {
        let (mut fast, mut slow) = (vec![Hit::NONE; N], vec![Hit::NONE; N]);
        cpu::nearest(SHAPE, codes, &queries, ranges, &mut fast);
        reference::nearest(SHAPE, codes, &queries, ranges, &mut slow);
        assert_eq!(fast, slow);
        assert_eq!(fast[0], Hit::NONE);
        if let Some(ranges) = ranges {
            assert!(fast.iter().zip(ranges).all(|(h, r)| h.index == u32::MAX || (r[0]..r[1]).contains(&h.index)));
        } else {
            assert!(fast[1..].iter().all(|h| h.index < SHAPE.n_positions as u32 && h.distance.is_finite()));
        }
        all.extend(fast);
    }
    all
}

#[test]
fn the_fast_form_chooses_what_the_reference_chooses() {
    // A row is longer than its codes, the padding is not a number, and so are some candidates.
    let row_len = (SHAPE.n_channels + 1) * SHAPE.stride;
    let mut data = uniform_f32(2, N * row_len, 0.0, 1.0);
    for (i, c) in data.iter_mut().enumerate() {
        if i % SHAPE.stride >= SHAPE.n_positions || i % SHAPE.stride % 5 == 3 {
            *c = f32::NAN;
        }
    }
    let hits = assert_same(Codes::Full { data: &data, row_len });
    assert!(hits.iter().all(|h| h.index % 5 != 3 || h.index == u32::MAX));
}

#[test]
fn any_number_of_channels_and_positions_is_searched() {
    for n_channels in 1..7 {
        for n_positions in [1, 7, 8, 9, 34] {
            let shape = Shape { n_channels, n_positions, stride: n_positions.next_multiple_of(LANES) };
            let row_len = n_channels * shape.stride;
            // The padding would be the closest: it must not be chosen.
            let mut data = uniform_f32(5, N * row_len, 1.0, 2.0);
            data.iter_mut().enumerate().filter(|(i, _)| i % shape.stride >= n_positions).for_each(|(_, c)| *c = 0.5);
            let mut queries = uniform_f32(6, N * n_channels, 0.0, 1.0);
            queries[n_channels * 3] = f32::NAN;
            let codes = Codes::Full { data: &data, row_len };
            let (mut fast, mut slow) = (vec![Hit::NONE; N], vec![Hit::NONE; N]);
            cpu::nearest(shape, codes, &queries, None, &mut fast);
            reference::nearest(shape, codes, &queries, None, &mut slow);
            assert_eq!(fast, slow);
            assert!(fast.iter().enumerate().all(|(n, h)| (h.index == u32::MAX) == (n == 3 && n_channels == 1)));
        }
    }
}

#[test]
fn products_are_compared_as_the_entries_they_stand_for() {
    let rank = 4;
    let left = uniform_f32(3, N * (SHAPE.n_channels * rank + 2), -1.0, 1.0);
    let right = uniform_f32(4, SHAPE.n_channels * rank * SHAPE.stride, -1.0, 1.0);
    let row_len = SHAPE.n_channels * rank + 2;
    let products = assert_same(Codes::LowRank { left: &left, row_len, right: &right, rank });
    let mut data = Vec::new();
    for n in 0..N {
        for j in 0..SHAPE.n_channels {
            for p in 0..SHAPE.stride {
                let term = |i: usize| left[n * row_len + j * rank + i] * right[(j * rank + i) * SHAPE.stride + p];
                data.push((0..rank).fold(0.0, |sum, i| sum + term(i)));
            }
        }
    }
    let entries = assert_same(Codes::Full { data: &data, row_len: SHAPE.n_channels * SHAPE.stride });
    assert_eq!(products, entries);
}

#[test]
fn of_equal_candidates_the_first_is_chosen_and_of_none_none() {
    let shape = Shape { n_channels: 1, n_positions: 16, stride: 16 };
    let mut data = [1.0; 16];
    data[5] = 0.25;
    data[12] = 0.25;
    let mut hits = [Hit::NONE];
    cpu::nearest(shape, Codes::Full { data: &data, row_len: 16 }, &[0.0], None, &mut hits);
    assert_eq!(hits[0], Hit { index: 5, distance: 0.0625 });
    cpu::nearest(shape, Codes::Full { data: &[f32::NAN; 16], row_len: 16 }, &[0.0], None, &mut hits);
    assert_eq!(hits[0], Hit::NONE);
}
