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
    let (w, k, p) = (shape.width, shape.k, shape.n_positions);
    assert!(m.k == k && m.width.div_ceil(shape.step) == w && m.height.div_ceil(shape.step) == shape.height);
    let nothing = Pixel {
        depth: f32::NAN,
        sigma: f32::NAN,
        residual: f32::NAN,
        left: Left::Outside,
        index: u32::MAX,
        fell_back: false,
    };
    let mut pixels = vec![nothing; shape.n_pixels()];
    let tau = if settings.max_residual > 0.0 { settings.max_residual } else { f32::INFINITY };
    let own = settings.interpolation.error().powi(2);
    pixels.par_chunks_mut(w).enumerate().for_each_init(
        || (Interpolator::new(table, settings.interpolation), vec![0.0; w * k], vec![Hit::NONE; w], vec![0.0; k]),
        |(interpolator, queries, hits, variances), (y, row)| {
            let first = y * w;
            queries.chunks_exact_mut(k).enumerate().for_each(|(x, q)| query(table, m, first + x, q));
            table.nearest(first, queries, windows.map(|s| s.of(first, w)), hits);
            for (x, out) in row.iter_mut().enumerate() {
                let camera_pixel = pixel_of_camera(table, m, first + x);
                if m.left[camera_pixel] != Left::Kept {
                    out.left = m.left[camera_pixel];
                    continue;
                }
                let query = &queries[x * k..(x + 1) * k];
                let (mut n_used, mut noise) = (0, 0.0);
                for (j, v) in variances.iter_mut().enumerate() {
                    let inverse = m.inv_var[camera_pixel * k + j];
                    *v = if inverse > 0.0 { 1.0 / inverse } else { 0.0 };
                    if inverse > 0.0 {
                        n_used += 1;
                        noise += *v + table.variance() + own;
                    }
                }
                let mut judge = |hit: Hit, out: &mut Pixel| {
                    if hit.index == u32::MAX {
                        return false;
                    }
                    let found = interpolator.find(first + x, hit.index as usize, hit.distance, query, variances);
                    let most = found.slack.sqrt() + tau * noise.sqrt();
                    let good = found.distance.sqrt() <= most && found.variance.is_finite();
                    *out = Pixel {
                        depth: if good { found.depth } else { f32::NAN },
                        sigma: if good { found.variance.sqrt() } else { f32::NAN },
                        residual: if good { (found.distance / n_used as f32).sqrt() } else { f32::NAN },
                        left: if good { Left::Kept } else { Left::Ambiguous },
                        index: hit.index,
                        fell_back: out.fell_back,
                    };
                    good
                };
                let good = judge(hits[x], out);
                if let Some(range) = windows.map(|s| s.of(first + x, 1)[0])
                    && range != [0, p as u32]
                    && (!good || Windows::at_border(range, hits[x].index, p))
                {
                    let mut hit = [Hit::NONE];
                    table.nearest(first + x, query, None, &mut hit);
                    out.fell_back = true;
                    judge(hit[0], out);
                }
            }
        },
    );
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
