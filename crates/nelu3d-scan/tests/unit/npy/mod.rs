mod header;

use std::path::Path;

use nelu3d_scan::npy::{Array, NpyError, read, write};

fn file(header: &str, data: &[u8]) -> Vec<u8> {
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    let padded = format!("{header:<117}\n");
    bytes.extend((padded.len() as u16).to_le_bytes());
    bytes.extend(padded.as_bytes());
    bytes.extend(data);
    bytes
}

fn read_bytes(bytes: &[u8]) -> Result<Array, NpyError> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.npy");
    std::fs::write(&path, bytes).unwrap();
    read(&path)
}

#[test]
fn arrays_round_trip() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.npy");
    for shape in [vec![2, 3], vec![6], vec![1, 2, 3], vec![0, 4]] {
        let n = shape.iter().product();
        let data: Vec<f32> = (0..n).map(|i| i as f32 * 0.3 - 1.0).collect();
        write(&path, &shape, &data).unwrap();
        assert_eq!(read(&path).unwrap(), Array { shape, data });
    }
    write(&path, &[2], &[f32::NAN, 1.0]).unwrap();
    assert!(read(&path).unwrap().data[0].is_nan());
}

#[test]
fn other_layouts_are_understood() {
    let fortran = "{'descr': '<f8', 'fortran_order': True, 'shape': (2, 3), }";
    let doubles: Vec<u8> = [1.0f64, 4.0, 2.0, 5.0, 3.0, 6.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let expected = Array { shape: vec![2, 3], data: vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0] };
    assert_eq!(read_bytes(&file(fortran, &doubles)).unwrap(), expected);
    let big = "{'descr': '>f4', 'fortran_order': False, 'shape': (2,), }";
    let floats: Vec<u8> = [1.5f32, -2.0].iter().flat_map(|v| v.to_be_bytes()).collect();
    assert_eq!(read_bytes(&file(big, &floats)).unwrap().data, [1.5, -2.0]);
}

#[test]
fn bad_files_are_named() {
    let good = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3), }";
    for (bytes, expected) in [
        (file(good, &[0; 23]), "no whole .npy file"),
        (file(&good.replace("(2, 3)", "(4294967296, 4294967296)"), &[0; 24]), "no whole .npy file"),
        (file(&good.replace("(2, 3)", "(9999999, 999)"), &[0; 24]), "no whole .npy file"),
        (file(&good.replace("<f4", "<i4"), &[0; 24]), "holds '<i4' values; save it as float32"),
        (file(&good.replace("<f4", "|O"), &[0; 24]), "a.npy"),
        (file("{'descr': [('a', '<f4')], 'fortran_order': False, 'shape': (2, 3), }", &[0; 24]), "values; save it"),
        (b"\x93NUMPY\x02\x00\xff\xff\xff\x7f{'descr'".to_vec(), "no whole .npy file (its header"),
        (b"hello".to_vec(), "no whole .npy file"),
        (Vec::new(), "no whole .npy file"),
    ] {
        let e = read_bytes(&bytes).unwrap_err().to_string();
        assert!(e.contains("a.npy") && e.contains(expected), "{e} instead of {expected}");
    }
    let whole = file(good, &[0; 24]);
    for n in 0..whole.len() {
        assert!(read_bytes(&whole[..n]).is_err(), "{n} bytes of {} are an array", whole.len());
    }
    assert!(read(Path::new("/no/such.npy")).unwrap_err().to_string().contains("/no/such.npy"));
}
