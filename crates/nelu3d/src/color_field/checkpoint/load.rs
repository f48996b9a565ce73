//! Reading a checkpoint.

use std::path::Path;

use half::f16;
use nelu3d_scan::input::{MAX_DATA, read_file};
use rayon::prelude::*;
use safetensors::tensor::{Dtype, SafeTensors};
use serde::Deserialize;

use super::checksum::{checksum, without_checksum};
use super::error::CheckpointError;
use super::header::{FIRST_WITH_BRICKS, FORMAT, FormHeader, Header};
use crate::color_field::field::{ColorField, Form};
use crate::color_field::frequency::FrequencyForm;
use crate::color_field::grid::Grid;
use crate::color_field::hash::HashForm;
use crate::color_field::published::PublishedForm;
use crate::color_field::validity::{Validity, ValidityShape};

/// The reason for rejecting parameters that do not belong to their network.
const NETWORK_MISMATCH: &str = "its network and its parameters do not fit";

/// A checkpoint in memory.
struct Checkpoint<'a> {
    /// The file, for messages.
    path: &'a Path,
    tensors: &'a SafeTensors<'a>,
}

impl Checkpoint<'_> {
    fn malformed(&self, reason: impl Into<String>) -> CheckpointError {
        malformed(self.path, reason)
    }

    /// Returns the bytes of a tensor. Sizes are compared with what is in the file before anything of that size is
    /// allocated.
    fn tensor(&self, name: &str, dtype: Dtype, sizes: &[usize]) -> Result<&[u8], CheckpointError> {
        let t = self.tensors.tensor(name).map_err(|e| self.malformed(e.to_string()))?;
        let product = |sizes: &[usize]| sizes.iter().try_fold(1usize, |n, s| n.checked_mul(*s));
        if t.dtype() != dtype || product(sizes).is_none_or(|n| product(t.shape()) != Some(n)) {
            return Err(self.malformed(format!("tensor {name} has another type or size than described")));
        }
        Ok(t.data())
    }

    /// Returns the values of a tensor of 32-bit floats.
    fn floats(&self, name: &str, sizes: &[usize]) -> Result<Vec<f32>, CheckpointError> {
        let bytes = self.tensor(name, Dtype::F32, sizes)?;
        Ok(bytes.as_chunks::<4>().0.iter().map(|c| f32::from_le_bytes(*c)).collect())
    }

    /// Reads the field's values.
    fn form(&self, header: FormHeader, format: u32) -> Result<Form, CheckpointError> {
        match header {
            FormHeader::Grid { cells, k } => {
                let [a, b, w] = cells.map(|c| c.saturating_add(3));
                let bytes = self.tensor("coeffs", Dtype::F16, &[b, a, w, k])?;
                let coeffs: Vec<f32> =
                    bytes.as_chunks::<2>().0.par_iter().map(|c| f16::from_le_bytes(*c).to_f32()).collect();
                if coeffs.par_iter().any(|c| !c.is_finite()) {
                    return Err(self.malformed("its coefficients are not all finite"));
                }
                Ok(Form::Grid(Grid { cells, k, coeffs }))
            }
            FormHeader::Hash(_) if format < FIRST_WITH_BRICKS => {
                Err(self.malformed("its hash table is laid out as an earlier version of nelu3d did; calibrate again"))
            }
            FormHeader::Hash(shape) => {
                let params = self.floats("params", &[shape.n_params])?;
                let form = HashForm::from_params(*shape, params).ok_or_else(|| self.malformed(NETWORK_MISMATCH))?;
                Ok(Form::Hash(Box::new(form)))
            }
            FormHeader::Frequency(shape) => {
                let params = self.floats("params", &[shape.n_params])?;
                let form =
                    FrequencyForm::from_params(*shape, params).ok_or_else(|| self.malformed(NETWORK_MISMATCH))?;
                Ok(Form::Frequency(Box::new(form)))
            }
            FormHeader::Published(shape) => {
                let params = self.floats("params", &[shape.n_params])?;
                let form =
                    PublishedForm::from_params(*shape, params).ok_or_else(|| self.malformed(NETWORK_MISMATCH))?;
                Ok(Form::Published(Box::new(form)))
            }
        }
    }

    /// Reads the calibrated volume.
    fn validity(&self, shape: ValidityShape, k: usize) -> Result<Validity, CheckpointError> {
        let ranges = self.floats("t_range", &[shape.tiles[0], shape.tiles[1], 2])?;
        let t_range = ranges.as_chunks::<2>().0.to_vec();
        // An empty tile has near > far; any other lies before the camera.
        if t_range.iter().any(|r| !(r[0] > r[1] || (r[0] > 0.0 && r[0] <= r[1] && r[1].is_finite()))) {
            return Err(self.malformed("its depth ranges make no sense"));
        }
        let lit = self.tensor("lit", Dtype::U8, &shape.cells)?.to_vec();
        // Earlier versions did not count positions, and there are none to count without a sweep.
        let counted = self.tensors.names().contains(&"positions");
        let positions =
            if counted { self.tensor("positions", Dtype::U8, &shape.cells[..2])?.to_vec() } else { Vec::new() };
        // Only a field that is known along some axes of its code somewhere has them.
        let axes = if self.tensors.names().contains(&"axes") {
            self.tensor("axes", Dtype::U8, &[k])?.to_vec()
        } else {
            Vec::new()
        };
        let highest = if axes.is_empty() { 1 } else { 7 };
        if axes.iter().any(|axis| *axis > 1) || lit.iter().any(|mark| *mark > highest) {
            return Err(self.malformed("its calibrated volume makes no sense"));
        }
        Ok(Validity { shape, t_range, lit, positions, axes })
    }
}

fn malformed(path: &Path, reason: impl Into<String>) -> CheckpointError {
    CheckpointError::Malformed { path: path.into(), reason: reason.into() }
}

/// The part of a description that every version has.
#[derive(Deserialize)]
struct Version {
    format: u32,
    /// What earlier versions did not write.
    sha256: Option<serde::de::IgnoredAny>,
}

impl ColorField {
    /// Reads a field from a checkpoint.
    ///
    /// # Errors
    ///
    /// The file cannot be read, is damaged, contradicts itself, or was written by a newer version.
    pub fn load(path: &Path) -> Result<Self, CheckpointError> {
        let data = read_file(path, MAX_DATA).map_err(|source| CheckpointError::Read { path: path.into(), source })?;
        Self::from_bytes(path, &data)
    }

    /// Reads a field from a checkpoint's content, as [`ColorField::load`] does; `path` is for messages alone.
    ///
    /// # Errors
    ///
    /// As [`ColorField::load`], but for what concerns the file itself.
    pub fn from_bytes(path: &Path, data: &[u8]) -> Result<Self, CheckpointError> {
        let bad = |reason: String| malformed(path, reason);
        let (_, metadata) = SafeTensors::read_metadata(data).map_err(|e| bad(e.to_string()))?;
        let tensors = SafeTensors::deserialize(data).map_err(|e| bad(e.to_string()))?;
        let json = metadata.metadata().as_ref().and_then(|m| m.get("nelu3d"));
        let json = json.ok_or_else(|| bad("it has no nelu3d description".into()))?;
        let version: Version = serde_json::from_str(json).map_err(|e| bad(e.to_string()))?;
        if version.format > FORMAT {
            return Err(CheckpointError::Newer { path: path.into(), found: version.format });
        }
        // Read while it is compared with its checksum, which decides first.
        let is_whole = || {
            let names = tensors.names();
            let content = names.iter().filter_map(|name| Some((*name, tensors.tensor(name).ok()?.data())));
            version.sha256.is_none()
                || without_checksum(json).is_some_and(|(json, sum)| checksum(&json, content) == sum)
        };
        let read = || {
            let header: Header = serde_json::from_str(json).map_err(|e| bad(e.to_string()))?;
            header.check().map_err(bad)?;
            let file = Checkpoint { path, tensors: &tensors };
            let form = file.form(header.form, version.format)?;
            let validity = file.validity(header.validity, form.k())?;
            Ok(Self { frame: header.frame, form, validity, metadata: header.metadata })
        };
        let (is_whole, field) = rayon::join(is_whole, read);
        if is_whole { field } else { Err(bad("it is not as it was written: its SHA-256 differs".into())) }
    }
}
