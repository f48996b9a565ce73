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
