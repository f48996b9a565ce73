//! From scene and light to the light every pixel collects, without noise.
//!
//! All images of a shot are rendered at once: what a ray meets does not depend on what the light source shows. Rays are
//! stratified over each pixel, and their results are filtered by the pixel's area and the lens's point spread function.

mod filter;
mod rays;
mod transport;

use nelu3d_scan::Image;
use nelu3d_scan::camera::Camera;
use nelu3d_scan::rig::Channels;
use rayon::prelude::*;

use crate::geometry::power;
use crate::light::{Illumination, LightSource};
use crate::random::{RandomPurpose, hash, mix};
use crate::scene::VirtualScene;
use crate::spec::{InterreflectionSpec, Spec};
pub use filter::PixelFilter;
pub use rays::RayGrid;
use transport::{LightTransport, RayId};

/// Rows rendered together. More rows repeat less of the filter's margin, fewer spread better over threads.
const BAND_ROWS: usize = 24;

/// A camera with its rays, ready to render scenes.
#[derive(Debug)]
pub(crate) struct Renderer {
    camera: Camera,
    channels: Channels,
    mixing: [[f32; 3]; 3],
    /// Power of the cosine to the optical axis.
    vignetting: f64,
    ambient: f32,
    interreflection: InterreflectionSpec,
    /// Sub-rows and sub-columns of a pixel.
    n: usize,
    seed: u64,
    filter: PixelFilter,
    rays: RayGrid,
}

impl Renderer {
    /// Prepares the camera of a checked spec.
    pub(crate) fn new(spec: &Spec) -> Self {
        let camera = spec.camera.optics().expect("checked with the spec");
        let filter = PixelFilter::new(spec.supersampling, spec.camera.psf_sigma_px);
        Self {
            rays: RayGrid::new(&camera, filter.margin_px()),
            camera,
            channels: spec.camera.channels().expect("checked with the spec"),
            mixing: spec.camera.color_mixing.map(|row| row.map(|v| v as f32)),
            vignetting: spec.camera.vignetting,
            ambient: spec.ambient as f32,
            interreflection: spec.interreflection,
            n: spec.supersampling,
            seed: spec.seed,
            filter,
        }
    }

    /// Returns the camera's optics.
    pub(crate) fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Returns the light that every pixel of every frame collects; 1: albedo 1, facing the flash at its reference
    /// distance. Images have the channels of the file: a mosaic is one channel. `shot` numbers the shot, for its random
    /// numbers.
    pub(crate) fn render(
        &self,
        scene: &VirtualScene,
        light: &LightSource,
        frames: &[Illumination],
        shot: u64,
    ) -> Vec<Image> {
        let (w, h) = (self.camera.width, self.camera.height);
        let bands: Vec<Vec<f32>> = (0..h.div_ceil(BAND_ROWS))
            .into_par_iter()
            .map(|band| {
                let rows = band * BAND_ROWS..((band + 1) * BAND_ROWS).min(h);
                self.render_rows(scene, light, frames, shot, rows)
            })
            .collect();
        let values = w * self.values_per_pixel();
        (0..frames.len())
            .map(|frame| {
                let mut all = Vec::with_capacity(values * h);
                for band in &bands {
                    let length = band.len() / frames.len();
                    all.extend_from_slice(&band[frame * length..(frame + 1) * length]);
                }
                self.to_file_channels(all)
            })
            .collect()
    }

    /// Returns the number of channels that are rendered: a mosaic's are picked at the end.
    fn values_per_pixel(&self) -> usize {
        self.channels.count()
    }

    /// Returns `frames × rows × width × values` of a band of rows.
    fn render_rows(
        &self,
        scene: &VirtualScene,
        light: &LightSource,
        frames: &[Illumination],
        shot: u64,
        rows: std::ops::Range<usize>,
    ) -> Vec<f32> {
        let (w, values, n) = (self.camera.width, self.values_per_pixel(), self.n as i64);
        let radius = self.filter.radius() as i64;
        let mut band = vec![0.0; frames.len() * rows.len() * w * values];
        // One line of subsamples per frame, with the filter's margin on both sides.
        let line_len = (w * self.n + 2 * self.filter.radius()) * values;
        let mut lines = vec![0.0; frames.len() * line_len];
        let mut filtered = vec![0.0; w * values];
        let frame_len = rows.len() * w * values;
        for sub_row in rows.start as i64 * n - radius..rows.end as i64 * n + radius {
            self.sample_line(scene, light, frames, shot, sub_row, &mut lines);
            for f in 0..frames.len() {
                self.filter.reduce_line(&lines[f * line_len..(f + 1) * line_len], values, &mut filtered);
                for y in rows.clone() {
                    let weight = self.filter.weight(sub_row - y as i64 * n);
                    if weight == 0.0 {
                        continue;
                    }
                    let at = f * frame_len + (y - rows.start) * w * values;
                    for (sum, v) in band[at..at + w * values].iter_mut().zip(&filtered) {
                        *sum += weight * v;
                    }
                }
            }
        }
        band
    }

    /// Writes the light along a line of subsamples to `lines`, for all frames.
    fn sample_line(
        &self,
        scene: &VirtualScene,
        light: &LightSource,
        frames: &[Illumination],
        shot: u64,
        sub_row: i64,
        lines: &mut [f32],
    ) {
        let (n, values) = (self.n as i64, self.values_per_pixel());
        let radius = self.filter.radius() as i64;
        let length = lines.len() / frames.len();
        let (y, sub_y) = (sub_row.div_euclid(n), sub_row.rem_euclid(n));
        let mut transport =
            LightTransport::new(scene, light, frames, self.ambient, self.interreflection, self.n * self.n);
        let row_hash = hash(self.seed, RandomPurpose::Pixels, [shot, sub_row as u64, 0]);
        let pixels_hash = hash(self.seed, RandomPurpose::Pixels, [shot, y as u64, 1]);
        for (i, sub_column) in (-radius..self.camera.width as i64 * n + radius).enumerate() {
            let (x, sub_x) = (sub_column.div_euclid(n), sub_column.rem_euclid(n));
            // Multi-jittered (Chiu, Shirley and Wang, Graphics Gems IV): the n² samples of a pixel also differ by 1/n²
            // in x and in y, so that an edge along rows or columns is located to 1/n² px.
            let bits = mix(row_hash ^ sub_column as u64);
            let [jx, jy] = [bits >> 40, (bits >> 16) & 0xff_ffff].map(|b| b as f64 / (1u64 << 24) as f64);
            let fx = (sub_x as f64 + (sub_y as f64 + jx) / n as f64) / n as f64;
            let fy = (sub_y as f64 + (sub_x as f64 + jy) / n as f64) / n as f64;
            let ray = self.rays.ray(x, y, fx, fy);
            let Some(hit) = scene.hit(&ray) else {
                for f in 0..frames.len() {
                    lines[f * length + i * values..][..values].fill(0.0);
                }
                continue;
            };
            let falloff = power(ray.dir.z, self.vignetting) as f32;
            let id = RayId { pixel: mix(pixels_hash ^ x as u64), sample: (sub_y * n + sub_x) as usize };
            for (f, radiance) in transport.radiance(&hit, &-ray.dir, id).iter().enumerate() {
                let radiance = radiance.map(|r| r * falloff);
                let out = &mut lines[f * length + i * values..][..values];
                if values == 1 {
                    out[0] = (radiance[0] + radiance[1] + radiance[2]) / 3.0;
                } else {
                    for (o, row) in out.iter_mut().zip(&self.mixing) {
                        *o = row[0] * radiance[0] + row[1] * radiance[1] + row[2] * radiance[2];
                    }
                }
            }
        }
    }

    /// Returns rendered channels as an image with the channels of the file.
    fn to_file_channels(&self, data: Vec<f32>) -> Image {
        let (width, height) = (self.camera.width, self.camera.height);
        let Channels::Bayer(cell) = self.channels else {
            return Image { width, height, channels: self.channels.in_file(), data };
        };
        let pick = |i: usize| {
            let (x, y) = (i % width, i / width);
            data[3 * i + usize::from(cell[(y % 2) * 2 + x % 2])]
        };
        Image { width, height, channels: 1, data: (0..width * height).map(pick).collect() }
    }
}
