//! A color field on disk: one safetensors file that describes itself.
//!
//! Metadata key `nelu3d` holds JSON: format, frame, form, validity shape and [`About`]. Tensors: `coeffs` (f16, grid) or
//! `params` (f32, hash); `t_range` (f32, tiles × 2, mm along the ray); `lit` (u8, cells).

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use half::f16;
use nelu3d_scan::output::write_atomic;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};

use super::frame::Frame;
use super::grid::Grid;
use super::hash::{HashForm, HashShape};
use super::validity::{Validity, ValidityShape};
use super::{About, ColorField, Form};

/// Version of the layout.
const FORMAT: u32 = 1;

/// Why a checkpoint could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// The file could not be read or written.
    #[error("{path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: std::io::Error,
    },
    /// Not a whole checkpoint.
    #[error("{path}: not a readable color field ({reason}); it may be truncated: run `nelu3d calibrate` again")]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// Made by a newer program.
    #[error("{path}: color field format {found} is newer than this program's {FORMAT}; update nelu3d")]
    Newer {
        /// The file.
        path: PathBuf,
        /// Its format.
        found: u32,
    },
}

#[derive(Serialize, Deserialize)]
struct Header {
    format: u32,
    units: String,
    frame: Frame,
    form: FormHeader,
    validity: ValidityShape,
    about: About,
}

#[derive(Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
enum FormHeader {
    Grid { cells: [usize; 3], k: usize },
    Hash(HashShape),
}

impl ColorField {
    /// Writes the field; the file is whole or absent.
    pub fn save(&self, path: &Path) -> Result<(), CheckpointError> {
        let (form, name, dtype, shape, bytes) = match &self.form {
            Form::Grid(g) => {
                let half: Vec<f16> = g.coeffs.iter().map(|c| f16::from_f32(*c)).collect();
                let [na, nb, nw] = g.nodes();
                let header = FormHeader::Grid { cells: g.cells, k: g.k };
                (header, "coeffs", Dtype::F16, vec![nb, na, nw, g.k], bytemuck::cast_slice(&half).to_vec())
            }
            Form::Hash(h) => {
                let params = h.params();
                let bytes = bytemuck::cast_slice(params).to_vec();
                (FormHeader::Hash(h.shape().clone()), "params", Dtype::F32, vec![params.len()], bytes)
            }
        };
        let header = Header {
            format: FORMAT,
            units: "mm".into(),
            frame: self.frame,
            form,
            validity: self.validity.shape,
            about: self.about.clone(),
        };
        let json = serde_json::to_string(&header).expect("plain data serializes");
        let t_range: &[u8] = bytemuck::cast_slice(&self.validity.t_range);
        let [ca, cb, cw] = self.validity.shape.cells;
        let malformed =
            |e: safetensors::SafeTensorError| CheckpointError::Malformed { path: path.into(), reason: e.to_string() };
        let tensors = [
            (name, TensorView::new(dtype, shape, &bytes).map_err(malformed)?),
            ("t_range", TensorView::new(Dtype::F32, vec![self.validity.t_range.len(), 2], t_range).map_err(malformed)?),
            ("lit", TensorView::new(Dtype::U8, vec![cb, ca, cw], &self.validity.lit).map_err(malformed)?),
        ];
        let metadata = HashMap::from([("nelu3d".to_string(), json)]);
        let data = safetensors::serialize(tensors, Some(metadata)).map_err(malformed)?;
        write_atomic(path, |w| w.write_all(&data)).map_err(|source| CheckpointError::Io { path: path.into(), source })
    }

    /// Reads a field.
    pub fn load(path: &Path) -> Result<Self, CheckpointError> {
        let data = std::fs::read(path).map_err(|source| CheckpointError::Io { path: path.into(), source })?;
        let bad = |reason: String| CheckpointError::Malformed { path: path.into(), reason };
        let (_, metadata) = SafeTensors::read_metadata(&data).map_err(|e| bad(e.to_string()))?;
        let tensors = SafeTensors::deserialize(&data).map_err(|e| bad(e.to_string()))?;
        let json = metadata
            .metadata()
            .as_ref()
            .and_then(|m| m.get("nelu3d"))
            .ok_or_else(|| bad("it has no nelu3d description".into()))?;
        #[derive(Deserialize)]
        struct Version {
            format: u32,
        }
        let version: Version = serde_json::from_str(json).map_err(|e| bad(e.to_string()))?;
        if version.format > FORMAT {
            return Err(CheckpointError::Newer { path: path.into(), found: version.format });
        }
        let header: Header = serde_json::from_str(json).map_err(|e| bad(e.to_string()))?;
        let tensor = |name: &str, dtype: Dtype, n: usize| -> Result<Vec<u8>, CheckpointError> {
            let t = tensors.tensor(name).map_err(|e| bad(e.to_string()))?;
            if t.dtype() != dtype || t.shape().iter().product::<usize>() != n {
                return Err(bad(format!("tensor {name} has another type or size than described")));
            }
            Ok(t.data().to_vec())
        };
        let floats = |bytes: Vec<u8>| -> Vec<f32> {
            bytes.chunks_exact(4).map(|c| f32::from_le_bytes([c[0], c[1], c[2], c[3]])).collect()
        };
        let form = match header.form {
            FormHeader::Grid { cells, k } => {
                let n = cells.iter().map(|c| c + 3).product::<usize>() * k;
                let coeffs = tensor("coeffs", Dtype::F16, n)?
                    .chunks_exact(2)
                    .map(|c| f16::from_le_bytes([c[0], c[1]]).to_f32())
                    .collect();
                Form::Grid(Grid { cells, k, coeffs })
            }
            FormHeader::Hash(shape) => {
                let params = floats(tensor("params", Dtype::F32, shape.n_params())?);
                let hash = HashForm::from_params(shape, params);
                Form::Hash(Box::new(hash.ok_or_else(|| bad("its network and its parameters do not fit".into()))?))
            }
        };
        let v = header.validity;
        let n_tiles = v.tiles[0] * v.tiles[1];
        let t_range = floats(tensor("t_range", Dtype::F32, n_tiles * 2)?);
        let validity = Validity {
            shape: v,
            t_range: t_range.chunks_exact(2).map(|c| [c[0], c[1]]).collect(),
            lit: tensor("lit", Dtype::U8, v.cells.iter().product())?,
        };
        Ok(Self { frame: header.frame, form, validity, about: header.about })
    }
}
