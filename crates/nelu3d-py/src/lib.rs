//! The Python package `nelu3d`: the functions of the data path under their names, numpy arrays in and out; and the
//! program, which is the same code.
//!
//! Promises that hold everywhere here: work runs without the interpreter's lock and stops soon after Ctrl-C ([`work`]);
//! every error of the libraries becomes `nelu3d.Error` with the same sentence, and so does a panic ([`error`]); maps go
//! out without a copy, and images of [`rig`] come in without one ([`arrays`]). What people read in Python stands in
//! `python/nelu3d/__init__.pyi`, too.

mod arrays;
mod display;
mod error;
mod evaluate;
mod field;
mod json;
mod memory_rig;
mod patterns;
mod program;
mod reconstruct;
mod result;
mod rig;
mod sequence;
mod simulate;
mod work;

/// 3D scanning with a camera and any light source that throws a pattern, without a projector model.
#[pyo3::pymodule]
mod _nelu3d {
    #[pymodule_export]
    use crate::error::{Error, Refused, ScanWarning};
    #[pymodule_export]
    use crate::evaluate::evaluate;
    #[pymodule_export]
    use crate::field::{ColorField, calibrate};
    #[pymodule_export]
    use crate::patterns::patterns;
    #[pymodule_export]
    use crate::program::main;
    #[pymodule_export]
    use crate::reconstruct::{decode, reconstruct};
    #[pymodule_export]
    use crate::result::Reconstruction;
    #[pymodule_export]
    use crate::rig::Rig;
    #[pymodule_export]
    use crate::sequence::{Sequence, sequence};
    #[pymodule_export]
    use crate::simulate::simulate;

    /// Version of the package and of the program in it.
    #[allow(non_upper_case_globals, reason = "Python names it so")]
    #[pymodule_export]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
