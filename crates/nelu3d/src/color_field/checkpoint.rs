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
    /// The file could not be read.
    #[error("{path}: cannot be read: {source}; give the file that `nelu3d calibrate` wrote")]
    Read {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: std::io::Error,
    },
    /// The file could not be written; the message names it.
    #[error(transparent)]
    Write(#[from] std::io::Error),
    /// Not a whole checkpoint.
    #[error("{path}: is no readable color field ({reason}); it may be truncated: run `nelu3d calibrate` again")]
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

/// Most values per node of a grid or point of a field: far beyond any pattern set.
const MAX_K: usize = 4096;

/// Most nodes of the grid that a field is turned into, times k.
const MAX_NODES: usize = 1 << 28;

impl Header {
    /// What a damaged or foreign file could say that no field has.
    fn check(&self) -> Result<(), String> {
        let expect = |good: bool, what: &str| if good { Ok(()) } else { Err(what.to_owned()) };
        let (cells, k) = match &self.form {
            FormHeader::Grid { cells, k } => (*cells, *k),
            FormHeader::Hash(shape) => {
                let finest = shape.config.encoding.finest_resolution.map(|n| n as usize);
                expect(shape.settings.cells == finest, "its network is not of the size it states")?;
                (shape.settings.cells, shape.k)
            }
        };
        let about = &self.about;
        expect((1..=MAX_K).contains(&k), "its number of channels is impossible")?;
        expect(about.images.len().checked_mul(about.channels) == Some(k), "its images do not make its channels")?;
        let nodes = cells.iter().try_fold(k, |n, c| n.checked_mul(c.checked_add(3)?));
        let good = cells.iter().all(|c| *c > 0) && nodes.is_some_and(|n| n <= MAX_NODES);
        expect(good, "its number of cells is impossible")?;

        let f = &self.frame;
        let mut numbers = f.origin.iter().chain(f.axes.as_flattened()).chain(&f.lo).chain(&f.hi).chain([&f.kappa]);
        expect(numbers.all(|v| v.is_finite()), "its frame is not finite")?;
        expect((0..3).all(|i| f.lo[i] < f.hi[i]), "its volume is empty")?;

        expect(about.camera.len() >= 6 && about.camera.iter().all(|v| v.is_finite()), "its camera is incomplete")?;
        let [width, height] = [about.camera[0], about.camera[1]];
        let v = &self.validity;
        let sizes = [width, height].into_iter().zip(v.tiles);
        let good = v.tile_px > 0
            && v.cells.iter().all(|c| *c > 0)
            && sizes.into_iter().all(|(px, tiles)| px >= 1.0 && tiles == (px as usize).div_ceil(v.tile_px));
        expect(good, "its calibrated volume does not belong to its camera")?;
        let noise = about.noise;
        let good = noise.read.is_finite() && noise.gain.is_finite() && noise.read >= 0.0 && noise.gain >= 0.0;
        expect(good, "its noise is impossible")
    }
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
        Ok(write_atomic(path, |w| w.write_all(&data))?)
    }

    /// Reads a field.
    ///
    /// # Errors
    ///
    /// The file cannot be read, is damaged, contradicts itself, or was written by a newer program.
    pub fn load(path: &Path) -> Result<Self, CheckpointError> {
        let data = std::fs::read(path).map_err(|source| CheckpointError::Read { path: path.into(), source })?;
        Self::from_bytes(path, &data)
    }

    /// [`Self::load`] of a file's content; `path` is only for messages.
    fn from_bytes(path: &Path, data: &[u8]) -> Result<Self, CheckpointError> {
        let bad = |reason: String| CheckpointError::Malformed { path: path.into(), reason };
        let (_, metadata) = SafeTensors::read_metadata(data).map_err(|e| bad(e.to_string()))?;
        let tensors = SafeTensors::deserialize(data).map_err(|e| bad(e.to_string()))?;
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
        header.check().map_err(bad)?;
        // Sizes are compared with what is in the file before anything of that size is allocated.
        let tensor = |name: &str, dtype: Dtype, sizes: &[usize]| -> Result<Vec<u8>, CheckpointError> {
            let t = tensors.tensor(name).map_err(|e| bad(e.to_string()))?;
            let product = |sizes: &[usize]| sizes.iter().try_fold(1usize, |n, s| n.checked_mul(*s));
            if t.dtype() != dtype || product(sizes).is_none_or(|n| product(t.shape()) != Some(n)) {
                return Err(bad(format!("tensor {name} has another type or size than described")));
            }
            Ok(t.data().to_vec())
        };
        let floats = |bytes: Vec<u8>| -> Vec<f32> {
            bytes.chunks_exact(4).map(|c| f32::from_le_bytes([c[0], c[1], c[2], c[3]])).collect()
        };
        let form = match header.form {
            FormHeader::Grid { cells, k } => {
                let [a, b, w] = cells.map(|c| c.saturating_add(3));
                let coeffs: Vec<f32> = tensor("coeffs", Dtype::F16, &[b, a, w, k])?
                    .chunks_exact(2)
                    .map(|c| f16::from_le_bytes([c[0], c[1]]).to_f32())
                    .collect();
                if coeffs.iter().any(|c| !c.is_finite()) {
                    return Err(bad("its coefficients are not all finite".into()));
                }
                Form::Grid(Grid { cells, k, coeffs })
            }
            FormHeader::Hash(shape) => {
                let params = floats(tensor("params", Dtype::F32, &[shape.n_params()])?);
                let hash = HashForm::from_params(shape, params);
                Form::Hash(Box::new(hash.ok_or_else(|| bad("its network and its parameters do not fit".into()))?))
            }
        };
        let v = header.validity;
        let t_range = floats(tensor("t_range", Dtype::F32, &[v.tiles[0], v.tiles[1], 2])?);
        // An empty tile has near > far; any other lies before the camera.
        if t_range.chunks_exact(2).any(|r| !(r[0] > r[1] || (r[0] > 0.0 && r[0] <= r[1] && r[1].is_finite()))) {
            return Err(bad("its depth ranges make no sense".into()));
        }
        let validity = Validity {
            shape: v,
            t_range: t_range.chunks_exact(2).map(|c| [c[0], c[1]]).collect(),
            lit: tensor("lit", Dtype::U8, &v.cells)?,
        };
        Ok(Self { frame: header.frame, form, validity, about: header.about })
    }
}
