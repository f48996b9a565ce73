//! What TurboSL knows of a scene: both cameras (one of them a projector), the captures, and which pixels matter.

use nalgebra::{Point3, Vector3};
use nelu3d_scan::{Camera, Image, Projector};

use super::projected::ProjectedPlanes;
use crate::captured::Captured;
use crate::error::DecodeError;
use nelu3d::reconstruct::neural::bounds::Bounds;
use nelu3d::reconstruct::neural::checkpoint::SceneDigest;
use nelu3d::reconstruct::neural::march::March;
use nelu3d::surface::PixelStatus;

/// The scene; maps are of the camera's pixels unless they say otherwise.
pub(crate) struct TurboSlScene<'a> {
    pub(super) camera: &'a Camera,
    pub(super) projector: &'a Projector,
    /// Undistorted image-plane coordinates.
    plane: &'a [[f32; 2]],
    /// Nearest and farthest depth, mm.
    depth: [f64; 2],
    pub(super) bounds: Bounds,
    /// Lit pixels, in the order of small tiles.
    pub(super) lit: Vec<u32>,
    /// Pixels that rays are drawn from: lit ones and dark ones, in the order of small tiles.
    pub(super) drawn: Vec<u32>,
    /// Which pixels are lit.
    is_lit: Vec<bool>,
    /// What a dark pixel should show: black, k values.
    black: Vec<f32>,
    /// All pixels of the projector, in the order of small tiles.
    pub(super) projected: Vec<u32>,
    /// Captured patterns, ambient light included, `[pixel][k]`.
    captured: Vec<f32>,
    /// What the projector showed, k planes.
    pub(super) shown: &'a ProjectedPlanes,
    /// Channels of the camera.
    pub(super) n_channels: usize,
}

impl<'a> TurboSlScene<'a> {
    pub(crate) fn new(
        camera: &'a Camera,
        projector: &'a Projector,
        plane: &'a [[f32; 2]],
        depth: [f64; 2],
        patterns: &[Image],
        captured: &Captured,
        shown: &'a ProjectedPlanes,
        unit_mm: Option<f64>,
    ) -> Result<Self, DecodeError> {
        let n_channels = captured.channels;
        let k = captured.planes.len();
        let is_lit: Vec<bool> = captured.status.iter().map(|l| *l == PixelStatus::Valid).collect();
        let mut lit: Vec<u32> = (0..is_lit.len()).filter(|&i| is_lit[i]).map(|i| i as u32).collect();
        in_tiles(&mut lit, camera.width);
        if lit.is_empty() {
            return Err(no_pixel());
        }
        // Clipped pixels show neither an object nor that there is none.
        let is_drawn = |i: &u32| captured.status[*i as usize] != PixelStatus::Saturated;
        let mut drawn: Vec<u32> = (0..is_lit.len() as u32).filter(is_drawn).collect();
        in_tiles(&mut drawn, camera.width);
        // The whole image, whatever the scene shows: the unit of the losses is that of the rig.
        let ends = plane.iter().flat_map(|xy| {
            let [x, y] = xy.map(f64::from);
            depth.map(|z| Point3::new(x * z, y * z, z))
        });
        let mut bounds = Bounds::around(ends).ok_or_else(no_pixel)?;
        if let Some(unit_mm) = unit_mm {
            bounds = bounds.with_unit(unit_mm);
        }
        let mut all = vec![0.0; is_lit.len() * k];
        for (i, out) in all.chunks_exact_mut(k).enumerate() {
            for (j, out) in out.iter_mut().enumerate() {
                *out = patterns[j / n_channels].data[i * n_channels + j % n_channels];
            }
        }
        let mut projected: Vec<u32> = (0..projector.optics.n_pixels() as u32).collect();
        in_tiles(&mut projected, projector.optics.width);
        Ok(Self {
            camera,
            projector,
            plane,
            depth,
            bounds,
            lit,
            drawn,
            is_lit,
            black: vec![0.0; k],
            projected,
            captured: all,
            shown,
            n_channels,
        })
    }

    /// Adds everything that the training sees to a digest.
    pub(super) fn digest(&self, digest: &mut SceneDigest) {
        let pose = self.projector.proj_from_cam.to_homogeneous();
        digest.floats(&self.captured).indices(&self.drawn).text(&self.is_lit).floats(self.plane.as_flattened());
        digest.text(&(&self.depth, self.bounds.unit_mm, pose.as_slice())).text(&format!("{:?}", self.camera));
        digest.text(&format!("{:?}", self.projector.optics));
        self.shown.digest(digest);
    }

    /// Returns the number of captures of a pixel.
    pub(crate) fn k(&self) -> usize {
        self.shown.len()
    }

    /// Returns whether a pixel is lit.
    pub(crate) fn is_lit(&self, i: usize) -> bool {
        self.is_lit[i]
    }

    /// Returns what a pixel's ray should show, k values: what was captured where it is lit, black elsewhere.
    pub(crate) fn wanted(&self, i: usize) -> &[f32] {
        if self.is_lit[i] { self.measured(i) } else { &self.black }
    }

    /// Returns what was captured at a pixel, k values.
    pub(crate) fn measured(&self, i: usize) -> &[f32] {
        &self.captured[i * self.k()..(i + 1) * self.k()]
    }

    /// Returns the ray of a camera pixel.
    pub(crate) fn camera_march(&self, i: usize, offset: f64) -> March {
        let [x, y] = self.plane[i].map(f64::from);
        let dir = Vector3::new(x, y, 1.0).normalize();
        March { origin: Point3::origin(), dir, range: self.depth.map(|z| z / dir.z), offset }
    }

    /// Returns the ray of a projector pixel.
    pub(crate) fn projector_march(&self, i: usize, offset: f64) -> March {
        let optics = &self.projector.optics;
        let [x, y] = optics.undistort([(i % optics.width) as f64, (i / optics.width) as f64]);
        let dir = self.projector.proj_from_cam.rotation.inverse() * Vector3::new(x, y, 1.0).normalize();
        March { origin: self.projector.center(), dir, range: [0.0, 1e9], offset }
    }

    /// Returns whether a ray of camera or projector may come near a point of the cube, and light and view reach it.
    pub(crate) fn reaches(&self, q: [f32; 3]) -> bool {
        let x = self.bounds.from_cube(q);
        let margin_mm = self.bounds.side_mm() / 64.0;
        let within = |camera: &Camera, p: &Point3<f64>| {
            let margin_px = margin_mm * camera.fx / p.z.max(1e-9);
            let inside = |p: f64, n: usize| p > -margin_px && p < n as f64 - 1.0 + margin_px;
            camera.project(p).is_some_and(|[u, v]| inside(u, camera.width) && inside(v, camera.height))
        };
        let [near, far] = self.depth;
        (near - margin_mm..=far + margin_mm).contains(&x.z)
            && within(self.camera, &x)
            && within(&self.projector.optics, &(self.projector.proj_from_cam * x))
    }

    /// What was captured around a point of the image, k values, bilinear; 0 outside of it.
    pub(crate) fn captured_at(&self, [u, v]: [f32; 2], out: &mut [f32]) {
        let k = self.k();
        out.fill(0.0);
        let (x, y) = (u.floor(), v.floor());
        for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let (px, py) = (x + dx, y + dy);
            if px < 0.0 || py < 0.0 || px >= self.camera.width as f32 || py >= self.camera.height as f32 {
                continue;
            }
            let weight = (1.0 - (u - px).abs()) * (1.0 - (v - py).abs());
            let i = py as usize * self.camera.width + px as usize;
            for (out, c) in out.iter_mut().zip(&self.captured[i * k..(i + 1) * k]) {
                *out += weight * c;
            }
        }
    }

    /// Returns where a camera pixel lies in the unit square.
    pub(crate) fn place(&self, [u, v]: [f32; 2]) -> [f32; 2] {
        [(u + 0.5) / self.camera.width as f32, (v + 0.5) / self.camera.height as f32]
    }
}

/// Returns the error of a scene without a lit pixel.
fn no_pixel() -> DecodeError {
    let problem = "leaves no pixel; check that white.png shows the scene lit".into();
    DecodeError::Setting { setting: "min_contrast", problem }
}

/// Sorts pixels so that neighbors are near each other.
fn in_tiles(pixels: &mut [u32], width: usize) {
    pixels.sort_by_key(|&i| (i as usize / width / 8, i as usize % width / 8, i));
}
