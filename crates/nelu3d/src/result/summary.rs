//! `result.json`: the machine-readable description of a result folder.

use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

use nelu3d_scan::Camera;
use nelu3d_scan::camera::Distortion;
use nelu3d_scan::input::open_file;
use nelu3d_scan::statistics::percentile;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::progress::StageTime;
use crate::surface::{PixelStatus, Surface};
use crate::verdict::Judgment;

/// Version of the keys of `result.json`.
pub const FORMAT: u32 = 1;

/// The origin of a result, and its evaluation.
#[derive(Clone, Debug, Default)]
pub struct ResultMetadata {
    /// Folder of the rig.
    pub rig: PathBuf,
    /// Name of the rig.
    pub rig_name: String,
    /// Name of the scene.
    pub scene: String,
    /// Name of the pattern set.
    pub set: String,
    /// Files that were read.
    pub inputs: Vec<Input>,
    /// Whether to trust the surface.
    pub judgment: Judgment,
    /// Errors against the ground truth, if it was evaluated.
    pub metrics: Option<serde_json::Value>,
    /// Error against time, if it was traced.
    pub trace: Option<serde_json::Value>,
}

impl ResultMetadata {
    /// Adds errors against the ground truth and the error over time, which other crates compute.
    ///
    /// # Panics
    ///
    /// If they cannot be represented in JSON (a map with keys that are no strings).
    pub fn with_evaluation<M: Serialize, T: Serialize>(self, metrics: Option<&M>, trace: Option<&T>) -> Self {
        fn json(value: &impl Serialize) -> serde_json::Value {
            serde_json::to_value(value).expect("metrics are plain data")
        }
        Self { metrics: metrics.map(json), trace: trace.map(json), ..self }
    }
}

/// A file that was read.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Input {
    /// Path of the file as it was given.
    #[serde(serialize_with = "nelu3d_scan::path_text::serialize")]
    pub path: PathBuf,
    /// Size of the file, bytes.
    pub bytes: u64,
    /// SHA-256 of the file's content, hexadecimal.
    pub sha256: String,
}

impl Input {
    /// Hashes a file.
    pub fn of(path: &Path) -> std::io::Result<Self> {
        let (mut file, _) = open_file(path)?;
        let (mut hash, mut bytes) = (Sha256::new(), 0);
        // Piece by piece: lookup tables are larger than memory.
        let mut piece = vec![0; 1 << 20];
        loop {
            let n = match file.read(&mut piece) {
                Ok(0) => break,
                Ok(n) => n,
                Err(e) if e.kind() == ErrorKind::Interrupted => continue,
                Err(e) => return Err(e),
            };
            hash.update(&piece[..n]);
            bytes += n as u64;
        }
        let sha256 = hash.finalize().iter().map(|b| format!("{b:02x}")).collect();
        Ok(Self { path: path.to_owned(), bytes, sha256 })
    }
}

/// The content of `result.json`. Keys are stable: they are added to, never renamed, while `format` stays. Lengths are
/// mm, times s, fractions in [0, 1]; a number that does not exist is `null`.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// Version of these keys: 1.
    pub format: u32,
    /// Version of this library.
    pub version: String,
    /// Folder of the rig, as it was given.
    #[serde(serialize_with = "nelu3d_scan::path_text::serialize")]
    pub rig: PathBuf,
    /// Name of the rig.
    pub rig_name: String,
    /// Name of the scene.
    pub scene: String,
    /// Name of the pattern set.
    pub set: String,
    /// Whether to trust the surface, and what that rests on.
    #[serde(flatten)]
    pub judgment: Judgment,
    /// Intrinsics of the maps, in the form of `camera.json`.
    pub camera: CameraJson,
    /// Files that were read, with their SHA-256.
    pub inputs: Vec<Input>,
    /// Number of valid pixels, and why the others were rejected.
    pub pixels: PixelCounts,
    /// Range of the depth.
    pub depth_mm: DepthRange,
    /// Size of the surface.
    pub mesh: MeshSize,
    /// Diagnostics of the method: its settings, seed, losses, counts.
    pub method: serde_json::Value,
    /// Seconds of each stage, in order.
    pub stages: Vec<StageTime>,
    /// Elapsed time of all stages, s.
    pub wall_secs: f64,
    /// Processor time of all stages, all threads, s.
    pub cpu_secs: f64,
    /// Peak memory of the process; `null` where the system does not tell.
    pub peak_memory_bytes: Option<u64>,
    /// Machine that the result was computed on.
    pub machine: Machine,
    /// Errors against the ground truth; `null` when none was given.
    pub metrics: Option<serde_json::Value>,
    /// Errors of the intermediate surfaces, in order; `null` unless they were traced.
    pub trace: Option<serde_json::Value>,
}

/// Intrinsics in the form of `camera.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraJson {
    /// Width, px.
    pub resx: usize,
    /// Height, px.
    pub resy: usize,
    /// Camera matrix.
    #[serde(rename = "K")]
    pub k: [[f64; 3]; 3],
    /// OpenCV's distortion coefficients.
    pub dist_coeffs: Vec<f64>,
}

impl From<&Camera> for CameraJson {
    fn from(c: &Camera) -> Self {
        Self {
            resx: c.width,
            resy: c.height,
            k: [[c.fx, 0.0, c.cx], [0.0, c.fy, c.cy], [0.0, 0.0, 1.0]],
            dist_coeffs: c.distortion.coeffs().to_vec(),
        }
    }
}

impl CameraJson {
    /// Returns the camera; `None` if OpenCV knows no such list of coefficients.
    pub fn camera(&self) -> Option<Camera> {
        Some(Camera {
            width: self.resx,
            height: self.resy,
            fx: self.k[0][0],
            fy: self.k[1][1],
            cx: self.k[0][2],
            cy: self.k[1][2],
            distortion: Distortion::new(&self.dist_coeffs)?,
        })
    }
}

/// The number of valid pixels, and why the others were rejected.
#[derive(Clone, Debug, Serialize)]
pub struct PixelCounts {
    /// Number of all pixels.
    pub total: usize,
    /// Number of pixels with a depth.
    #[serde(rename = "kept")]
    pub valid: usize,
    /// Number of rejected pixels, by [`PixelStatus::key`].
    #[serde(rename = "left")]
    pub rejected: serde_json::Map<String, serde_json::Value>,
}

/// Range of the depth, mm; `null` when there is none.
#[derive(Clone, Debug, Serialize)]
pub struct DepthRange {
    /// Smallest depth, mm.
    pub min: f64,
    /// Median depth, mm.
    pub median: f64,
    /// Largest depth, mm.
    pub max: f64,
    /// Median standard deviation of the depth, mm.
    pub median_sigma: f64,
}

/// Size of the surface.
#[derive(Clone, Debug, Serialize)]
pub struct MeshSize {
    /// Number of vertices.
    pub vertices: usize,
    /// Number of triangles.
    pub faces: usize,
}

/// The machine that a result was computed on.
#[derive(Clone, Debug, Serialize)]
pub struct Machine {
    /// Operating system.
    pub os: &'static str,
    /// Processor architecture.
    pub arch: &'static str,
    /// Number of threads.
    pub threads: usize,
}

impl Summary {
    /// Makes the summary of a surface. `method` is the method's diagnostics, `stages` are its times.
    ///
    /// # Panics
    ///
    /// If `method` cannot be represented in JSON (a map with keys that are no strings).
    pub fn new(
        r: &Surface,
        method: &impl Serialize,
        stages: &[StageTime],
        camera: &Camera,
        metadata: &ResultMetadata,
    ) -> Self {
        let finite = |map: &[f32]| map.iter().filter(|v| v.is_finite()).map(|&v| f64::from(v)).collect::<Vec<_>>();
        let mut depth = finite(&r.depth);
        let counts = r.status_counts();
        let rejected = PixelStatus::ALL[1..].iter().map(|&s| (s.key().to_owned(), counts[s as usize].into())).collect();
        Self {
            format: FORMAT,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            rig: metadata.rig.clone(),
            rig_name: metadata.rig_name.clone(),
            scene: metadata.scene.clone(),
            set: metadata.set.clone(),
            judgment: metadata.judgment.clone(),
            camera: camera.into(),
            inputs: metadata.inputs.clone(),
            pixels: PixelCounts { total: r.depth.len(), valid: depth.len(), rejected },
            depth_mm: DepthRange {
                min: percentile(&mut depth, 0.0),
                max: percentile(&mut depth, 100.0),
                median: percentile(&mut depth, 50.0),
                median_sigma: percentile(&mut finite(&r.sigma), 50.0),
            },
            mesh: MeshSize { vertices: r.mesh.vertices.len(), faces: r.mesh.faces.len() },
            method: serde_json::to_value(method).expect("diagnostics are plain data"),
            stages: stages.to_vec(),
            wall_secs: stages.iter().map(|s| s.wall_secs).sum(),
            cpu_secs: stages.iter().map(|s| s.cpu_secs).sum(),
            peak_memory_bytes: peak_memory_bytes(),
            machine: Machine {
                os: std::env::consts::OS,
                arch: std::env::consts::ARCH,
                threads: rayon::current_num_threads(),
            },
            metrics: metadata.metrics.clone(),
            trace: metadata.trace.clone(),
        }
    }
}

/// Returns the peak memory of this process, bytes (`VmHWM` of Linux); `None` elsewhere.
pub fn peak_memory_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let kib: u64 =
        status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024)
}
