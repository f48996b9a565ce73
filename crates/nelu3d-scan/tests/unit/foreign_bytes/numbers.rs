//! NumPy arrays.

use std::path::Path;

use nelu3d_scan::npy::{self, Array};
use rand::RngExt;
use rand::rngs::StdRng;
use rand::seq::IndexedRandom;

use super::mutation::{arbitrary, damaged};
use super::{cases, watched};

fn written(shape: &[usize], data: &[f32]) -> Vec<u8> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.npy");
    npy::write(&path, shape, data).unwrap();
    std::fs::read(path).unwrap()
}

/// Any bits, and more often than by chance those of numbers that are written in ways of their own.
fn float(rng: &mut StdRng) -> f32 {
    const SPECIAL: [f32; 8] = [0.0, -0.0, 1e-40, -1e-40, f32::MAX, f32::MIN_POSITIVE, f32::INFINITY, f32::NAN];
    if rng.random_range(0..8) == 0 { *SPECIAL.choose(rng).expect("some") } else { f32::from_bits(rng.random()) }
}

fn array(rng: &mut StdRng) -> Array {
    let shape: Vec<usize> = (0..rng.random_range(1..4)).map(|_| rng.random_range(0..6)).collect();
    let data = (0..shape.iter().product()).map(|_| float(rng)).collect();
    Array { shape, data }
}

#[test]
fn arrays_round_trip_to_the_bit() {
    cases(500, |rng| {
        let array = array(rng);
        let back = npy::from_bytes(Path::new("a.npy"), &written(&array.shape, &array.data)).unwrap();
        assert_eq!(back.shape, array.shape);
        let bits = |a: &Array| a.data.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&back), bits(&array));
    });
}

#[test]
fn damaged_arrays_are_refused_or_read() {
    cases(500, |rng| {
        let array = array(rng);
        let file = damaged(&written(&array.shape, &array.data), rng);
        let _ = watched(|| npy::from_bytes(Path::new("a.npy"), &file));
    });
}

#[test]
fn arbitrary_bytes_are_no_array() {
    cases(500, |rng| {
        let beginnings: [&[u8]; 3] = [b"", b"\x93NUMPY\x01\0\x40\0", b"\x93NUMPY\x02\0\x40\0\0\0{'descr': "];
        let bytes = arbitrary(&beginnings, rng);
        let _ = watched(|| npy::from_bytes(Path::new("a.npy"), &bytes));
    });
}
