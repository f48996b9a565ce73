//! A color field on disk: one safetensors file that describes itself.
//!
//! Metadata key `nelu3d` holds JSON: format, frame, form, validity shape and [`FieldMetadata`]. Tensors: `coeffs` (f16, grid) or
//! `params` (f32, hash and frequency); `t_range` (f32, tiles × 2, mm along the ray); `lit` (u8, cells).

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use half::f16;
use nelu3d_scan::output::write_atomic;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};

use super::field::{ColorField, Form};
use super::frame::FieldFrame;
use super::frequency::{FrequencyForm, FrequencyShape};
use super::grid::Grid;
use super::hash::{HashForm, HashShape};
use super::metadata::FieldMetadata;
use super::validity::{Validity, ValidityShape};

/// Version of the layout.
const FORMAT: u32 = 2;
/// Oldest format whose hash tables are laid out as today's: by bricks.
const FIRST_WITH_BRICKS: u32 = 2;

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
    frame: FieldFrame,
    form: FormHeader,
    validity: ValidityShape,
    #[serde(rename = "about")]
    metadata: FieldMetadata,
}

#[derive(Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
enum FormHeader {
    Grid { cells: [usize; 3], k: usize },
    Hash(Box<HashShape>),
    Frequency(Box<FrequencyShape>),
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
                let finest = shape.config.encoding.finest_resolution;
                expect(shape.settings.finest() == finest, "its network is not of the size it states")?;
                (shape.settings.cells, shape.k)
            }
            FormHeader::Frequency(shape) => (shape.settings.cells, shape.k),
        };
        let about = &self.metadata;
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
                (FormHeader::Hash(Box::new(h.shape().clone())), "params", Dtype::F32, vec![params.len()], bytes)
            }
            Form::Frequency(f) => {
                let params = f.params();
                let bytes = bytemuck::cast_slice(params).to_vec();
                (FormHeader::Frequency(Box::new(f.shape().clone())), "params", Dtype::F32, vec![params.len()], bytes)
            }
        };
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
            FormHeader::Hash(_) if version.format < FIRST_WITH_BRICKS => {
                return Err(bad(
                    "its hash table is laid out as an earlier version of nelu3d did; calibrate again".into()
                ));
            }
            FormHeader::Hash(shape) => {
                let params = floats(tensor("params", Dtype::F32, &[shape.n_params()])?);
                let hash = HashForm::from_params(*shape, params);
                Form::Hash(Box::new(hash.ok_or_else(|| bad("its network and its parameters do not fit".into()))?))
            }
            FormHeader::Frequency(shape) => {
                let params = floats(tensor("params", Dtype::F32, &[shape.n_params])?);
                let form = FrequencyForm::from_params(*shape, params);
                Form::Frequency(Box::new(form.ok_or_else(|| bad("its network and its parameters do not fit".into()))?))
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
        Ok(Self { frame: header.frame, form, validity, metadata: header.metadata })
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};
    use nelu3d_scan::Camera;

    use super::super::frame::Center;
    use super::super::frequency::{FrequencySettings, Octaves};
    use super::super::hash::HashSettings;
    use super::super::metadata::Quality;
    use super::*;
    use crate::color_field::compatibility::camera_key;
    use crate::sensor::NoiseModel;

    /// A field of two channels for a camera of 20 × 12 px.
    fn field(form: Form) -> ColorField {
        let mut frame = FieldFrame::around(Point3::new(200.0, 0.0, 0.0), Point3::new(0.0, 0.0, 700.0), Vector3::x());
        frame.enclose(&Point3::new(-50.0, -40.0, 650.0));
        frame.enclose(&Point3::new(50.0, 40.0, 750.0));
        let mut validity = Validity::new(20, 12, 8, [2, 3, 2]);
        validity.add([3.0, 4.0], 690.0, [0.3, 0.4, 0.5]);
        validity.add([3.0, 4.0], 710.0, [0.3, 0.4, 0.6]);
        let about = FieldMetadata {
            version: "0".into(),
            rig: "r".into(),
            set: "s".into(),
            images: vec!["a.png".into(), "b.png".into()],
            mono: Vec::new(),
            channels: 1,
            center: Center::Light,
            source: "sweep".into(),
            camera: camera_key(&Camera::pinhole(20, 12, 30.0, 30.0, 9.5, 5.5)),
            noise: NoiseModel { read: 1e-6, gain: 1e-4 },
            dark: Vec::new(),
            crosstalk: None,
            cells_per_pixel: 1,
            step_mm: 5.0,
            // What was never measured is NaN, and JSON has none.
            quality: Some(Quality {
                held_out: vec!["3".into()],
                n: 0,
                psnr_db: f64::INFINITY,
                psnr_all_db: 30.0,
                ceiling_db: 40.0,
                depth_mm: f64::NAN,
            }),
            settings: serde_json::json!({ "seed": 1 }),
        };
        ColorField { frame, form, validity, metadata: about }
    }

    fn grid() -> ColorField {
        let mut grid = Grid::new([3, 4, 2], 2);
        grid.coeffs.iter_mut().enumerate().for_each(|(i, c)| *c = (i % 8) as f32 / 8.0);
        field(Form::Grid(grid))
    }

    fn hash() -> ColorField {
        let settings = HashSettings {
            cells: [8, 8, 2],
            n_levels: 2,
            log2_hashmap_size: 4,
            width: 8,
            coarsening: 2,
            epochs: 1.0,
            batch: 1,
        };
        field(Form::Hash(Box::new(HashForm::new(settings, 2, 1))))
    }

    fn frequency() -> ColorField {
        let settings = FrequencySettings::for_cells([4, 4, 2], Octaves::Supervised);
        field(Form::Frequency(Box::new(FrequencyForm::new(settings, 2, 1))))
    }

    fn bytes(field: &ColorField) -> Vec<u8> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("f");
        field.save(&path).unwrap();
        std::fs::read(&path).unwrap()
    }

    fn load(bytes: &[u8]) -> Result<ColorField, CheckpointError> {
        ColorField::from_bytes(Path::new("some/field.safetensors"), bytes)
    }

    /// The file with its description changed, and its length told anew.
    fn described(bytes: &[u8], change: impl Fn(&mut serde_json::Value)) -> Vec<u8> {
        let n = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        let mut outer: serde_json::Value = serde_json::from_slice(&bytes[8..8 + n]).unwrap();
        let mut inner = serde_json::from_str(outer["__metadata__"]["nelu3d"].as_str().unwrap()).unwrap();
        change(&mut inner);
        outer["__metadata__"]["nelu3d"] = inner.to_string().into();
        let mut header = outer.to_string().into_bytes();
        header.resize(header.len().next_multiple_of(8), b' ');
        let mut out = (header.len() as u64).to_le_bytes().to_vec();
        out.extend_from_slice(&header);
        out.extend_from_slice(&bytes[8 + n..]);
        out
    }

    #[test]
    fn a_field_is_read_back_as_it_was() {
        for original in [grid(), hash(), frequency()] {
            let back = load(&bytes(&original)).unwrap();
            assert_eq!(back.frame, original.frame);
            assert_eq!(back.validity, original.validity);
            assert_eq!(back.metadata.camera, original.metadata.camera);
            match (&back.form, &original.form) {
                (Form::Grid(a), Form::Grid(b)) => assert_eq!(a, b),
                (Form::Hash(a), Form::Hash(b)) => assert_eq!((a.shape(), a.params()), (b.shape(), b.params())),
                (Form::Frequency(a), Form::Frequency(b)) => {
                    assert_eq!((a.shape(), a.params()), (b.shape(), b.params()));
                }
                _ => panic!("another form"),
            }
            let quality = back.metadata.quality.unwrap();
            assert!(quality.depth_mm.is_nan() && quality.ceiling_db == 40.0);
        }
    }

    #[test]
    fn a_field_of_format_1_is_read_unless_its_hash_table_was_laid_out_otherwise() {
        let older = |field: &ColorField| described(&bytes(field), |json| json["format"] = 1.into());
        assert!(load(&older(&grid())).is_ok());
        let refused = load(&older(&hash())).unwrap_err().to_string();
        assert!(refused.contains("some/field.safetensors") && refused.contains("calibrate again"), "{refused}");
    }

    #[test]
    fn absurd_descriptions_are_refused() {
        let huge = u64::MAX / 2;
        type Change = Box<dyn Fn(&mut serde_json::Value)>;
        let set = |pointer: &'static str, value: serde_json::Value| -> Change {
            Box::new(move |json| *json.pointer_mut(pointer).unwrap_or_else(|| panic!("no {pointer}")) = value.clone())
        };
        let mut cases: Vec<(ColorField, Change)> = Vec::new();
        for value in [0.into(), huge.into(), u64::MAX.into(), (1u64 << 32).into(), (-1).into(), 2.5.into()] {
            let value: serde_json::Value = value;
            for pointer in ["/form/cells/0", "/form/cells/2", "/form/k"] {
                cases.push((grid(), set(pointer, value.clone())));
            }
            for pointer in ["/form/k", "/form/n_params", "/form/settings/cells/1", "/form/config/width"] {
                cases.push((hash(), set(pointer, value.clone())));
            }
            for pointer in ["/form/k", "/form/n_params", "/form/settings/cells/1", "/form/config/width"] {
                cases.push((frequency(), set(pointer, value.clone())));
            }
            for pointer in ["/form/config/encoding/log2_hashmap_size", "/form/config/encoding/n_levels"] {
                cases.push((hash(), set(pointer, value.clone())));
            }
            for pointer in ["/validity/tiles/0", "/validity/cells/1", "/validity/tile_px", "/about/channels"] {
                cases.push((grid(), set(pointer, value.clone())));
            }
            cases.push((grid(), set("/about/camera/0", value)));
        }
        cases.push((grid(), set("/frame/hi/1", serde_json::json!(-1e9))));
        cases.push((grid(), set("/frame/lo/0", serde_json::Value::Null)));
        cases.push((grid(), set("/frame/kappa", serde_json::json!("x"))));
        cases.push((grid(), set("/about/camera", serde_json::json!([20, 12]))));
        cases.push((grid(), set("/about/images", serde_json::json!(["a.png"]))));
        cases.push((grid(), set("/about/noise/read", serde_json::json!(-1.0))));
        cases.push((grid(), set("/form", serde_json::json!({ "kind": "table" }))));
        for (i, (field, change)) in cases.iter().enumerate() {
            let e = load(&described(&bytes(field), change)).expect_err(&format!("case {i}")).to_string();
            assert!(e.starts_with("some/field.safetensors: ") && e.contains("nelu3d calibrate"), "case {i}: {e}");
        }
        let newer = load(&described(&bytes(&grid()), set("/format", (FORMAT + 1).into()))).unwrap_err().to_string();
        assert!(newer.contains("update nelu3d"), "{newer}");
    }

    #[test]
    fn values_that_no_field_has_are_refused() {
        let Form::Grid(mut coeffs) = grid().form else { unreachable!("made as a grid") };
        coeffs.coeffs[7] = f32::NAN;
        let mut near = grid();
        near.validity.t_range[1] = [f32::NAN, 700.0];
        let mut behind = grid();
        behind.validity.t_range[1] = [-3.0, 700.0];
        for field in [field(Form::Grid(coeffs)), near, behind] {
            assert!(load(&bytes(&field)).is_err());
        }
    }

    /// Whatever is in the file, reading it ends with a field that can be used or with an error that names the file.
    #[test]
    fn damaged_files_never_panic() {
        let mut state = 99u64;
        let mut below = |n: usize| {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 33) as usize % n
        };
        let mut refused = 0;
        for good in [bytes(&grid()), bytes(&hash()), bytes(&frequency())] {
            let header = 8 + u64::from_le_bytes(good[..8].try_into().unwrap()) as usize;
            for round in 0..400 {
                let mut bad = good.clone();
                match round % 4 {
                    // Damage anywhere, in the description, in the length, and a cut.
                    0 => (0..=below(8)).for_each(|_| bad[below(good.len())] = below(256) as u8),
                    1 => (0..=below(3)).for_each(|_| bad[below(header)] = b"0123456789-.,:[]{}\"e \\"[below(21)]),
                    2 => bad[below(8)] = below(256) as u8,
                    _ => bad.truncate(below(good.len())),
                }
                match load(&bad) {
                    Ok(field) => {
                        let mut c = vec![0.0; field.k()];
                        field.to_grid().eval([0.2, 0.5, 0.9], &mut c);
                        field.validity.range(19, 11);
                        field.validity.is_lit([0.2, 0.5, 0.9]);
                    }
                    Err(e) => {
                        refused += 1;
                        assert!(e.to_string().starts_with("some/field.safetensors: "), "{e}");
                    }
                }
            }
        }
        assert!(refused > 600, "only {refused} of 1200 were refused");
    }
}
