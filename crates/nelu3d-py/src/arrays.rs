//! Arrays: maps that go out and images that come in, neither with a copy.

use std::path::Path;

use nelu3d_scan::image::{Raw, RawData};
use nelu3d_scan::rig::StoredImage;
use numpy::ndarray::{ArrayView, IxDyn};
use numpy::{Element, PyArrayDescrMethods, PyArrayDyn, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods, dtype};
use pyo3::prelude::*;

use crate::error::Error;

/// Returns an array that looks at `data`, a part of the memory of `owner`, which it keeps alive. It cannot be written.
///
/// # Panics
///
/// If the shape has another number of values than the data.
pub(crate) fn view<'py, T: Element>(
    owner: Bound<'py, PyAny>,
    shape: &[usize],
    data: &[T],
) -> Bound<'py, PyArrayDyn<T>> {
    let values = ArrayView::from_shape(IxDyn(shape), data).expect("a map has its size");
    // SAFETY: owners are frozen classes, which never move or change what they hold, and the array keeps its owner.
    let array = unsafe { PyArrayDyn::borrow_from_array(&values, owner) };
    array.readwrite().make_nonwriteable();
    array
}

/// An image in the memory of a numpy array, whatever its strides.
pub(crate) struct ArrayImage {
    kind: Kind,
    data: *mut u8,
    width: usize,
    height: usize,
    channels: usize,
    /// Bytes from row to row, pixel to pixel, and channel to channel.
    strides: [isize; 3],
    /// The array, so that its memory stays.
    _array: Py<PyUntypedArray>,
}

/// What a value is stored as.
#[derive(Clone, Copy)]
enum Kind {
    U8,
    U16,
    F32,
}

// SAFETY: the memory is only read, and stays as long as the array that is held. Whoever writes into the array meanwhile
// may find a mixture of old and new codes in what is read, as with a file that is written while it is read.
unsafe impl Send for ArrayImage {}
// SAFETY: as above.
unsafe impl Sync for ArrayImage {}

impl ArrayImage {
    /// Takes anything that numpy understands as an image: `height × width` or `height × width × 3` values of type uint8,
    /// uint16, or float32. `path` is only for messages.
    ///
    /// # Errors
    ///
    /// It is of another shape or type.
    pub(crate) fn new(path: &Path, image: &Bound<'_, PyAny>) -> PyResult<Self> {
        let py = image.py();
        let array = py.import("numpy")?.call_method1("asarray", (image,))?;
        let array = array.cast::<PyUntypedArray>()?;
        let wrong = |what: String, remedy: &str| Error::new_err(format!("{}: {what}; {remedy}", path.display()));
        let kinds = [(dtype::<u8>(py), Kind::U8), (dtype::<u16>(py), Kind::U16), (dtype::<f32>(py), Kind::F32)];
        let found = array.dtype();
        let kind = kinds.into_iter().find(|(known, _)| known.is_equiv_to(&found)).map(|(_, kind)| kind);
        let kind = kind.ok_or_else(|| wrong(format!("is of type {found}"), "give uint8, uint16, or float32"))?;
        let (shape, strides) = (array.shape(), array.strides());
        let (channels, between) = match (shape, strides) {
            ([_, _], _) => (1, 0),
            ([_, _, 1], _) => (1, 0),
            ([_, _, 3], [.., between]) => (3, *between),
            _ => {
                let problem = format!("has the shape {shape:?}");
                return Err(wrong(problem, "give height × width values, or height × width × 3"));
            }
        };
        let data = match kind {
            Kind::U8 => array.cast::<PyArrayDyn<u8>>()?.data().cast(),
            Kind::U16 => array.cast::<PyArrayDyn<u16>>()?.data().cast(),
            Kind::F32 => array.cast::<PyArrayDyn<f32>>()?.data().cast(),
        };
        Ok(Self {
            kind,
            data,
            width: shape[1],
            height: shape[0],
            channels,
            strides: [strides[0], strides[1], between],
            _array: array.clone().unbind(),
        })
    }

    /// Returns the number of channels: 1 or 3.
    pub(crate) fn channels(&self) -> usize {
        self.channels
    }

    /// Returns the code that cannot be exceeded; 1 for floats.
    pub(crate) fn full_scale(&self) -> f64 {
        match self.kind {
            Kind::U8 => 255.0,
            Kind::U16 => 65535.0,
            Kind::F32 => 1.0,
        }
    }

    /// Copies the values.
    fn values<T: Copy>(&self) -> Vec<T> {
        let mut out = Vec::with_capacity(self.width * self.height * self.channels);
        let [row, pixel, channel] = self.strides;
        let packed = channel == size_of::<T>() as isize || self.channels == 1;
        for y in 0..self.height {
            let start = self.data.cast_const().wrapping_offset(y as isize * row);
            if packed && pixel == (self.channels * size_of::<T>()) as isize && start.cast::<T>().is_aligned() {
                // SAFETY: numpy promises that these values lie here, one after the other.
                out.extend_from_slice(unsafe {
                    std::slice::from_raw_parts(start.cast::<T>(), self.width * self.channels)
                });
                continue;
            }
            for (x, c) in (0..self.width).flat_map(|x| (0..self.channels).map(move |c| (x, c))) {
                let at = start.wrapping_offset(x as isize * pixel + c as isize * channel);
                // SAFETY: numpy promises that a value lies where its strides lead.
                out.push(unsafe { at.cast::<T>().read_unaligned() });
            }
        }
        out
    }
}

impl StoredImage for ArrayImage {
    fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    fn raw(&self) -> Raw {
        let data = match self.kind {
            Kind::U8 => RawData::U8(self.values()),
            Kind::U16 => RawData::U16(self.values()),
            Kind::F32 => RawData::Float(self.values()),
        };
        Raw { width: self.width, height: self.height, channels: self.channels, data }
    }
}
