//! Decoding a scene: search, interpolate, judge, row by row.

use nelu3d_field::nearest::Hit;
use nelu3d_scan::Camera;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::Table;
use super::interpolate::Interpolator;
use super::search::Windows;
use crate::reconstruct::measure::Measurements;
use crate::result::Left;

/// Which positions are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Search {
    /// All of them.
    Brute,
    /// All for a part of the pixels, for the others those around what these found; all where that explains nothing.
    CoarseToFine,
}

/// How the depth between positions is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Interpolation {
    /// Not at all: the depth of the nearest position, as in the LookUp3D tools.
    None,
    /// Lowest point of the parabola through the squared distances at the nearest position and its neighbors.
    Parabola,
    /// Closest point of the polyline through the codewords, over inverse depth.
    Linear,
    /// Closest point of the cubic through the four codewords around a segment, over inverse depth.
    Cubic,
}

/// Settings of a decoding.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// Which positions of the lookup table are compared
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = Search::Brute))]
    pub search: Search,
    /// How the depth between positions of the lookup table is found
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = Interpolation::Cubic))]
    pub interpolation: Interpolation,
    /// Residual above which a pixel is left out, in standard deviations of the noise (0: keep all)
    #[cfg_attr(feature = "clap", arg(long, value_name = "SIGMAS", default_value_t = 6.0))]
    pub max_residual: f32,
    /// Coarse to fine: every Nth pixel and row is decoded first
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", default_value_t = 4))]
    pub coarse: usize,
    /// Coarse to fine, and with an earlier result: positions on either side of the expected ones
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", default_value_t = 2))]
    pub window: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self { search: Search::Brute, interpolation: Interpolation::Cubic, max_residual: 6.0, coarse: 4, window: 2 }
    }
}

impl Interpolation {
    /// What it gets wrong itself, in normalized intensity: on `dlp` the held-out positions are met to 0.022 linearly and to
    /// 0.008 cubically. Without interpolation, the steps between codewords stand for it.
    fn error(self) -> f32 {
        match self {
            Interpolation::None | Interpolation::Parabola => 0.005,
            Interpolation::Linear => 0.02,
            Interpolation::Cubic => 0.01,
        }
    }
}

/// What a decoding found, for every pixel of the camera.
#[derive(Clone, Debug)]
pub struct Maps {
    /// Camera z, mm; NaN where there is none.
    pub depth: Vec<f32>,
    /// 1σ of the depth, mm, from the noise of scene and table and the slope of the code; NaN where there is no depth.
    pub sigma: Vec<f32>,
    /// RMS of the difference to the table's codeword; NaN where there is no depth.
    pub residual: Vec<f32>,
    /// Why a pixel has no depth.
    pub left: Vec<Left>,
    /// Nearest position per pixel of the table; `u32::MAX` where none was found.
    pub index: Vec<u32>,
    /// Pixels of the table whose window explained nothing, so that all positions were searched.
    pub n_fallbacks: usize,
}

/// Decodes a scene.
///
/// # Panics
/// If the scene has another size or other channels than the table.
pub fn decode(table: &Table, m: &Measurements, camera: &Camera, settings: &Settings) -> Maps {
    let windows = match settings.search {
        Search::Brute => None,
        Search::CoarseToFine => Some(Windows::coarse_to_fine(table, &|i, q| query(table, m, i, q), settings)),
    };
    run(table, m, camera, settings, windows.as_ref())
}

/// Decodes a frame of a sequence: around the depth of the frame before it, `previous` (mm, of every pixel of the camera, NaN
/// = none), and over all positions where that explains nothing.
///
/// # Panics
/// If the scene or `previous` has another size than the table was made for.
pub fn decode_near(table: &Table, m: &Measurements, camera: &Camera, settings: &Settings, previous: &[f32]) -> Maps {
    assert_eq!(previous.len(), m.n());
    let before = |pixel: usize| previous[pixel_of_camera(table, m, pixel)];
    let windows = Windows::near(table, &before, settings.window);
    run(table, m, camera, settings, Some(&windows))
}

/// The camera's pixel that a pixel of the table is.
fn pixel_of_camera(table: &Table, m: &Measurements, pixel: usize) -> usize {
    let s = table.shape();
    pixel / s.width * s.step * m.width + pixel % s.width * s.step
}

/// The codeword that was measured at a pixel of the table; NaN where a channel is unusable.
fn query(table: &Table, m: &Measurements, pixel: usize, out: &mut [f32]) {
    let i = pixel_of_camera(table, m, pixel);
    let kept = m.left[i] == Left::Kept;
    for (j, q) in out.iter_mut().enumerate() {
        *q = if kept && m.inv_var[i * m.k + j] > 0.0 { m.p[i * m.k + j] } else { f32::NAN };
    }
}

#[derive(Clone, Copy)]
struct Pixel {
    depth: f32,
    sigma: f32,
    residual: f32,
    left: Left,
    index: u32,
    fell_back: bool,
}

fn run(table: &Table, m: &Measurements, camera: &Camera, settings: &Settings, windows: Option<&Windows>) -> Maps {
    let shape = *table.shape();
    let sizes = [m.width, m.height].map(|n| n.div_ceil(shape.step));
    assert!(m.k == shape.k && sizes == [shape.width, shape.height], "a scene of another size than the table");
    let nothing = Pixel {
        depth: f32::NAN,
        sigma: f32::NAN,
        residual: f32::NAN,
        left: Left::Outside,
        index: u32::MAX,
        fell_back: false,
    };
    let mut pixels = vec![nothing; shape.n_pixels()];
    let decoder = || Decoder::new(table, m, settings, windows);
    pixels.par_chunks_mut(TASK).enumerate().for_each_init(decoder, |decoder, (task, pixels)| {
        for (block, pixels) in pixels.chunks_mut(BLOCK).enumerate() {
            decoder.decode(task * TASK + block * BLOCK, pixels);
        }
    });
    let index = pixels.iter().map(|p| p.index).collect();
    let n_fallbacks = pixels.iter().filter(|p| p.fell_back).count();
    if shape.step > 1 {
        pixels = between(&pixels, table, m, camera, nothing);
    }
    Maps {
        depth: pixels.iter().map(|p| p.depth).collect(),
        sigma: pixels.iter().map(|p| p.sigma).collect(),
        residual: pixels.iter().map(|p| p.residual).collect(),
        left: pixels.iter().map(|p| p.left).collect(),
        index,
        n_fallbacks,
    }
}

/// Pixels of one task.
const TASK: usize = 32 * BLOCK;
/// Pixels that are searched, then judged, while their rows of the table are in the first cache.
const BLOCK: usize = 32;

/// What one thread decodes with.
struct Decoder<'a> {
    table: &'a Table,
    m: &'a Measurements,
    windows: Option<&'a Windows>,
    /// Standard deviations of the noise that a residual may have.
    tau: f32,
    /// Variance of what the interpolation gets wrong.
    own: f32,
    interpolator: Interpolator<'a>,
    /// `[pixel of the block][channel]`
    queries: Vec<f32>,
    hits: Vec<Hit>,
    variances: Vec<f32>,
}

impl<'a> Decoder<'a> {
    fn new(table: &'a Table, m: &'a Measurements, settings: &Settings, windows: Option<&'a Windows>) -> Self {
        let k = table.shape().k;
        Self {
            table,
            m,
            windows,
            tau: if settings.max_residual > 0.0 { settings.max_residual } else { f32::INFINITY },
            own: settings.interpolation.error().powi(2),
            interpolator: Interpolator::new(table, settings.interpolation),
            queries: vec![0.0; BLOCK * k],
            hits: vec![Hit::NONE; BLOCK],
            variances: vec![0.0; k],
        }
    }

    /// Decodes the pixels of the table from `first` on, at most a block of them.
    fn decode(&mut self, first: usize, out: &mut [Pixel]) {
        let k = self.m.k;
        let n_positions = self.table.shape().n_positions;
        let queries = &mut self.queries[..out.len() * k];
        for (x, q) in queries.chunks_exact_mut(k).enumerate() {
            query(self.table, self.m, first + x, q);
        }
        let ranges = self.windows.map(|w| w.of(first, out.len()));
        self.table.nearest(first, queries, ranges, &mut self.hits[..out.len()]);
        for (x, out) in out.iter_mut().enumerate() {
            out.left = self.m.left[pixel_of_camera(self.table, self.m, first + x)];
            if out.left != Left::Kept {
                continue;
            }
            let hit = self.hits[x];
            let good = self.judge(first + x, x, hit, out);
            if let Some([from, to]) = ranges.map(|r| r[x])
                && (from > 0 || (to as usize) < n_positions)
                && (!good || Windows::at_border([from, to], hit.index, n_positions))
            {
                let mut hit = [Hit::NONE];
                self.table.nearest(first + x, &self.queries[x * k..(x + 1) * k], None, &mut hit);
                self.judge(first + x, x, hit[0], out);
                out.fell_back = true;
            }
        }
    }

    /// Places a pixel (the `x`th of the block) near a hit and decides whether to believe it.
    fn judge(&mut self, pixel: usize, x: usize, hit: Hit, out: &mut Pixel) -> bool {
        let k = self.m.k;
        if hit.index == u32::MAX {
            out.left = Left::Outside;
            return false;
        }
        let camera_pixel = pixel_of_camera(self.table, self.m, pixel);
        let (mut n_used, mut noise) = (0, 0.0);
        for (v, inverse) in self.variances.iter_mut().zip(&self.m.inv_var[camera_pixel * k..]) {
            *v = 0.0;
            if *inverse > 0.0 {
                *v = 1.0 / inverse;
                n_used += 1;
                noise += *v + self.table.variance() + self.own;
            }
        }
        let query = &self.queries[x * k..(x + 1) * k];
        let found = self.interpolator.find(pixel, hit.index as usize, hit.distance, query, &self.variances);
        out.index = hit.index;
        let good = found.distance.sqrt() <= found.slack.sqrt() + self.tau * noise.sqrt() && found.variance.is_finite();
        (out.depth, out.sigma, out.residual, out.left) = if good {
            (found.depth, found.variance.sqrt(), (found.distance / n_used as f32).sqrt(), Left::Kept)
        } else {
            (f32::NAN, f32::NAN, f32::NAN, Left::Ambiguous)
        };
        good
    }
}

/// Largest slope (depth per lateral mm) across which depth is interpolated between the table's pixels.
const MAX_SLOPE: f32 = 4.0;

/// Every pixel of the camera from every `step`th: bilinear in inverse depth inside of four that belong to one surface; a
/// pixel next to one that was left out is left out for its reason, one between two surfaces as an edge.
fn between(coarse: &[Pixel], table: &Table, m: &Measurements, camera: &Camera, nothing: Pixel) -> Vec<Pixel> {
    let s = *table.shape();
    let one = |i: usize| {
        if m.left[i] != Left::Kept {
            return Pixel { left: m.left[i], ..nothing };
        }
        let (x, y) = (i % m.width, i / m.width);
        let (cx, cy) = (x / s.step, y / s.step);
        let (fx, fy) = ((x % s.step) as f32 / s.step as f32, (y % s.step) as f32 / s.step as f32);
        let (nx, ny) = ((cx + 1).min(s.width - 1), (cy + 1).min(s.height - 1));
        let corners = [
            (cx, cy, (1.0 - fx) * (1.0 - fy)),
            (nx, cy, fx * (1.0 - fy)),
            (cx, ny, (1.0 - fx) * fy),
            (nx, ny, fx * fy),
        ];
        let used = corners.iter().filter(|c| c.2 > 0.0).map(|&(x, y, w)| (coarse[y * s.width + x], w));
        let (mut inverse, mut variance, mut residual, mut near, mut far) = (0.0, 0.0, 0.0, f32::INFINITY, 0.0f32);
        for (p, weight) in used {
            if p.left != Left::Kept {
                return Pixel { left: p.left, ..nothing };
            }
            inverse += weight / p.depth;
            variance += weight * p.sigma * p.sigma;
            residual += weight * p.residual;
            (near, far) = (near.min(p.depth), far.max(p.depth));
        }
        if far - near > MAX_SLOPE * near * s.step as f32 / camera.fx.min(camera.fy) as f32 {
            return Pixel { left: Left::Edge, ..nothing };
        }
        Pixel { depth: 1.0 / inverse, sigma: variance.sqrt(), residual, left: Left::Kept, ..nothing }
    };
    (0..m.n()).into_par_iter().map(one).collect()
}
