//! NumPy arrays.

use std::path::Path;

use nelu3d_scan::npy::{self, Array};
use proptest::collection::vec;
use proptest::prelude::*;

use super::mutation::{arbitrary, changes, damaged};
use super::{cases, watched};

fn written(shape: &[usize], data: &[f32]) -> Vec<u8> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.npy");
    npy::write(&path, shape, data).unwrap();
    std::fs::read(path).unwrap()
}

fn array() -> impl Strategy<Value = Array> {
    vec(0usize..6, 1..4).prop_flat_map(|shape| {
        let n = shape.iter().product::<usize>();
        vec(any::<f32>(), n).prop_map(move |data| Array { shape: shape.clone(), data })
    })
}

proptest! {
    #![proptest_config(cases(500))]

    #[test]
    fn arrays_round_trip_to_the_bit(array in array()) {
        let back = npy::from_bytes(Path::new("a.npy"), &written(&array.shape, &array.data)).unwrap();
        prop_assert_eq!(&back.shape, &array.shape);
        let bits = |a: &Array| a.data.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        prop_assert_eq!(bits(&back), bits(&array));
    }

    #[test]
    fn damaged_arrays_are_refused_or_read(array in array(), changes in changes()) {
        let file = damaged(&written(&array.shape, &array.data), &changes);
        let _ = watched(|| npy::from_bytes(Path::new("a.npy"), &file));
    }

    #[test]
    fn arbitrary_bytes_are_no_array(
        bytes in arbitrary(&[b"", b"\x93NUMPY\x01\0\x40\0", b"\x93NUMPY\x02\0\x40\0\0\0{'descr': "])
    ) {
        let _ = watched(|| npy::from_bytes(Path::new("a.npy"), &bytes));
    }
}
