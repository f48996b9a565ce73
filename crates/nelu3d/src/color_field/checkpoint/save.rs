//! Writing a checkpoint.

use std::collections::HashMap;
use std::path::Path;

use half::f16;
use nelu3d_scan::output::write_atomic;
use safetensors::tensor::{Dtype, TensorView};

use super::checksum::{checksum, with_checksum};
use super::error::CheckpointError;
use super::header::{FORMAT, FormHeader, Header};
use crate::color_field::field::{ColorField, Form};

/// The tensor that holds a form's values.
struct ValueTensor {
    name: &'static str,
    dtype: Dtype,
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

impl ValueTensor {
    /// Returns the parameters of a network.
    fn params(params: &[f32]) -> Self {
        let bytes = bytemuck::cast_slice(params).to_vec();
        Self { name: "params", dtype: Dtype::F32, shape: vec![params.len()], bytes }
    }
}

/// Returns a form's description and values.
fn describe(form: &Form) -> (FormHeader, ValueTensor) {
    match form {
        Form::Grid(g) => {
            let half: Vec<f16> = g.coeffs.iter().map(|c| f16::from_f32(*c)).collect();
            let [na, nb, nw] = g.nodes();
            let bytes = bytemuck::cast_slice(&half).to_vec();
            let values = ValueTensor { name: "coeffs", dtype: Dtype::F16, shape: vec![nb, na, nw, g.k], bytes };
            (FormHeader::Grid { cells: g.cells, k: g.k }, values)
        }
        Form::Hash(h) => (FormHeader::Hash(Box::new(h.shape().clone())), ValueTensor::params(h.params())),
        Form::Frequency(f) => (FormHeader::Frequency(Box::new(f.shape().clone())), ValueTensor::params(f.params())),
        Form::Published(p) => (FormHeader::Published(Box::new(p.shape().clone())), ValueTensor::params(p.params())),
    }
}

impl ColorField {
    /// Writes the field to a checkpoint; the file is whole or absent.
    ///
    /// # Errors
    ///
    /// The file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), CheckpointError> {
        let (form, ValueTensor { name, dtype, shape, bytes }) = describe(&self.form);
        let header = Header {
            format: FORMAT,
            units: "mm".into(),
            frame: self.frame,
            form,
            validity: self.validity.shape,
            metadata: self.metadata.clone(),
        };
        let json = serde_json::to_string(&header).expect("plain data serializes");
        let t_range: &[u8] = bytemuck::cast_slice(&self.validity.t_range);
        let [ca, cb, cw] = self.validity.shape.cells;
        let malformed =
            |e: safetensors::SafeTensorError| CheckpointError::Malformed { path: path.into(), reason: e.to_string() };
        let (lit, positions) = (&self.validity.lit, &self.validity.positions);
        let mut tensors = vec![
            (name, TensorView::new(dtype, shape, &bytes).map_err(malformed)?),
            ("t_range", TensorView::new(Dtype::F32, vec![self.validity.t_range.len(), 2], t_range).map_err(malformed)?),
            ("lit", TensorView::new(Dtype::U8, vec![cb, ca, cw], lit).map_err(malformed)?),
        ];
        if !positions.is_empty() {
            tensors.push(("positions", TensorView::new(Dtype::U8, vec![cb, ca], positions).map_err(malformed)?));
        }
        let axes = &self.validity.axes;
        if !axes.is_empty() {
            tensors.push(("axes", TensorView::new(Dtype::U8, vec![axes.len()], axes).map_err(malformed)?));
        }
        let content = tensors.iter().map(|(name, tensor)| (*name, tensor.data()));
        let json = with_checksum(&json, &checksum(&json, content));
        let metadata = HashMap::from([("nelu3d".to_string(), json)]);
        let data = safetensors::serialize(tensors, Some(metadata)).map_err(malformed)?;
        Ok(write_atomic(path, |w| w.write_all(&data))?)
    }
}
