//! NumPy arrays on disk.

mod header;

pub use header::{Header, Number, NumberKind};

use std::io;
use std::path::{Path, PathBuf};

use crate::input::{MAX_DATA, read_file};
use crate::output::write_atomic;

/// Why a `.npy` file could not be used.
#[derive(Debug, thiserror::Error)]
pub enum NpyError {
    /// The file is missing, no regular file, too large, or the operating system would not let it be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what to do about it.
        source: io::Error,
    },
    /// Not an npy file, or a truncated one.
    #[error("{}: is no whole .npy file ({reason}); write it again with numpy.save", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What the decoder said.
        reason: String,
    },
    /// An array of something else.
    #[error("{}: holds {dtype} values; save it as float32: numpy.save(path, array.astype('float32'))", path.display())]
    Type {
        /// The file.
        path: PathBuf,
        /// What it holds.
        dtype: String,
    },
}

/// An array of floats in C order.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Lengths of the axes, as (height, width).
    pub shape: Vec<usize>,
    /// The values, last axis fastest.
    pub data: Vec<f32>,
}

/// Reads an array of float32 or float64 (rounded to float32), of either byte order, in C or Fortran order.
///
/// # Errors
///
/// The file cannot be read, is truncated, or holds another type.
pub fn read(path: &Path) -> Result<Array, NpyError> {
    let bytes = read_file(path, MAX_DATA).map_err(|source| NpyError::Io { path: path.to_path_buf(), source })?;
    from_bytes(path, &bytes)
}

/// Reads an array from the content of a file, as [`read`] does; `path` is only for messages.
///
/// # Errors
///
/// The content is truncated, or holds another type.
pub fn from_bytes(path: &Path, bytes: &[u8]) -> Result<Array, NpyError> {
    let damaged = |reason: String| NpyError::Damaged { path: path.to_path_buf(), reason };
    let mut rest = bytes;
    let header = Header::read(&mut rest).map_err(|e| damaged(e.to_string()))?;
    let number = match header.number() {
        Some(number) if number.kind == NumberKind::Float => number,
        _ => return Err(NpyError::Type { path: path.to_path_buf(), dtype: header.dtype }),
    };
    let shape: Vec<usize> = header.shape.iter().map(|&n| usize::try_from(n).unwrap_or(usize::MAX)).collect();
    // A damaged header must not make us ask for all memory there is.
    let n = header.len().filter(|n| n.checked_mul(number.size).is_some_and(|size| size <= rest.len()));
    let n = n.ok_or_else(|| damaged(format!("it has fewer values than its shape {shape:?} says")))?;
    let data: Result<Vec<f32>, io::Error> = (0..n).map(|_| number.read_f32(&mut rest)).collect();
    let data = data.map_err(|e| damaged(e.to_string()))?;
    let data = if header.fortran_order { from_fortran(&data, &shape) } else { data };
    Ok(Array { shape, data })
}

/// Writes an array as little-endian float32 in C order.
///
/// # Errors
///
/// The file cannot be written.
///
/// # Panics
///
/// If `data` has another length than `shape` says.
pub fn write(path: &Path, shape: &[usize], data: &[f32]) -> io::Result<()> {
    assert_eq!(data.len(), shape.iter().product::<usize>(), "array data of another shape");
    /// Values that are converted at a time: a map may be larger than what memory has left.
    const CHUNK: usize = 1 << 16;
    write_atomic(path, |w| {
        Header::new("<f4", shape).write(w)?;
        let mut bytes = Vec::with_capacity(4 * CHUNK);
        for values in data.chunks(CHUNK) {
            bytes.clear();
            bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
            w.write_all(&bytes)?;
        }
        Ok(())
    })
}

/// Rearranges values with the first axis fastest into values with the last axis fastest.
fn from_fortran(data: &[f32], shape: &[usize]) -> Vec<f32> {
    let mut index = vec![0usize; shape.len()];
    let mut out = Vec::with_capacity(data.len());
    for _ in 0..data.len() {
        let i = index.iter().zip(shape).rev().fold(0, |i, (&k, &n)| i * n + k);
        out.push(data[i]);
        for axis in (0..shape.len()).rev() {
            index[axis] += 1;
            if index[axis] < shape[axis] {
                break;
            }
            index[axis] = 0;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

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
}
