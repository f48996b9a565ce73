//! Decoding a scene: search, interpolate, accept or reject, row by row.

use nelu3d_field::nearest::Hit;
use nelu3d_scan::Camera;
use rayon::prelude::*;

use super::interpolate::Interpolator;
use super::options::{Search, SearchSettings};
use super::search::Windows;
use super::table::Table;
use nelu3d::sensor::Measurements;
use nelu3d::surface::PixelStatus;

/// What a decoding found, for every pixel of the camera.
#[derive(Clone, Debug)]
pub struct LookupMaps {
    /// Camera z, mm; NaN where there is none.
    pub depth: Vec<f32>,
    /// 1σ of the depth, mm, from the noise of scene and table and the slope of the code; NaN where there is no depth.
    pub sigma: Vec<f32>,
    /// RMS of the difference to the table's codeword; NaN where there is no depth.
    pub residual: Vec<f32>,
    /// The status of every pixel.
    pub status: Vec<PixelStatus>,
    /// Nearest position per pixel of the table; `u32::MAX` where none was found.
    pub index: Vec<u32>,
    /// Pixels of the table whose window explained nothing, so that all positions were searched.
    pub n_fallbacks: usize,
}

/// Buffers that maps are made in. To touch fresh pages takes a system about as long as the search itself.
#[derive(Debug, Default)]
pub struct MapBuffers([Vec<f32>; 3]);

impl MapBuffers {
    /// Takes the buffers of what decoding does not look at: [`Measurements::surround`], `contrast` and `light` are
    /// empty after this.
    pub fn of(m: &mut Measurements) -> Self {
        Self([&mut m.surround, &mut m.contrast, &mut m.light].map(std::mem::take))
    }

    /// Makes maps in which nothing is found yet.
    fn maps(self, status: Vec<PixelStatus>) -> LookupMaps {
        let [depth, sigma, residual] = self.0.map(|mut map| {
            map.clear();
            map.resize(status.len(), f32::NAN);
            map
        });
        let index = vec![u32::MAX; status.len()];
        LookupMaps { depth, sigma, residual, status, index, n_fallbacks: 0 }
    }
}

/// Decodes a scene.
///
/// # Panics
/// If the scene has another size or other channels than the table.
pub fn decode(
    table: &Table,
    m: &Measurements,
    camera: &Camera,
    settings: &SearchSettings,
    buffers: MapBuffers,
) -> LookupMaps {
    let windows = match settings.search {
        Search::Brute => None,
        Search::CoarseToFine => Some(Windows::coarse_to_fine(table, &|i, q| query(table, m, i, q), settings)),
    };
    run(table, m, camera, settings, windows.as_ref(), buffers)
}

/// Decodes a frame of a sequence: around the depth of the frame before it, `previous` (mm, of every pixel of the
/// camera, NaN = none), and over all positions where that explains nothing.
///
/// # Panics
/// If the scene or `previous` has another size than the table was made for.
pub fn decode_near(
    table: &Table,
    m: &Measurements,
    camera: &Camera,
    settings: &SearchSettings,
    buffers: MapBuffers,
    previous: &[f32],
) -> LookupMaps {
    assert_eq!(previous.len(), m.n());
    let before = |pixel: usize| previous[pixel_of_camera(table, m, pixel)];
    let windows = Windows::near(table, &before, settings.window);
    run(table, m, camera, settings, Some(&windows), buffers)
}

/// Returns the camera's pixel that a pixel of the table is.
fn pixel_of_camera(table: &Table, m: &Measurements, pixel: usize) -> usize {
    let s = table.shape();
    if s.step == 1 {
        return pixel;
    }
    pixel / s.width * s.step * m.width + pixel % s.width * s.step
}

/// Writes the codeword that was measured at a pixel of the table; NaN where a channel is unusable.
fn query(table: &Table, m: &Measurements, pixel: usize, out: &mut [f32]) {
    let i = pixel_of_camera(table, m, pixel);
    let valid = m.status[i] == PixelStatus::Valid;
    for (j, q) in out.iter_mut().enumerate() {
        *q = if valid && m.inv_var[i * m.k + j] > 0.0 { m.p[i * m.k + j] } else { f32::NAN };
    }
}

fn run(
    table: &Table,
    m: &Measurements,
    camera: &Camera,
    settings: &SearchSettings,
    windows: Option<&Windows>,
    buffers: MapBuffers,
) -> LookupMaps {
    let shape = *table.shape();
    let sizes = [m.width, m.height].map(|n| n.div_ceil(shape.step));
    assert!(m.k == shape.k && sizes == [shape.width, shape.height], "a scene of another size than the table");
    let status = match shape.step {
        1 => m.status.clone(),
        _ => (0..shape.n_pixels()).map(|i| m.status[pixel_of_camera(table, m, i)]).collect(),
    };
    let mut maps = buffers.maps(status);
    let tasks = (
        maps.depth.par_chunks_mut(TASK),
        maps.sigma.par_chunks_mut(TASK),
        maps.residual.par_chunks_mut(TASK),
        maps.status.par_chunks_mut(TASK),
        maps.index.par_chunks_mut(TASK),
    );
    let decoder = || Decoder::new(table, m, settings, windows);
    maps.n_fallbacks = tasks
        .into_par_iter()
        .enumerate()
        .map_init(decoder, |decoder, (task, (depth, sigma, residual, status, index))| {
            decoder.decode(task * TASK, Part { depth, sigma, residual, status, index })
        })
        .sum();
    if shape.step > 1 { between(maps, table, m, camera) } else { maps }
}

/// Pixels of one task.
const TASK: usize = 32 * BLOCK;
/// Pixels that are searched, then interpolated, while their rows of the table are in the first cache.
const BLOCK: usize = 32;

/// LookupMaps of some neighboring pixels.
struct Part<'a> {
    depth: &'a mut [f32],
    sigma: &'a mut [f32],
    residual: &'a mut [f32],
    status: &'a mut [PixelStatus],
    index: &'a mut [u32],
}

/// What was found at a pixel.
struct Placed {
    depth: f32,
    sigma: f32,
    residual: f32,
    /// Whether noise explains the residual: if not, a window may have missed the position.
    explained: bool,
}

/// Standard deviations of the noise that a residual may have before all positions are searched.
const EXPLAINED: f32 = 6.0;

/// What one thread decodes with.
struct Decoder<'a> {
    table: &'a Table,
    m: &'a Measurements,
    windows: Option<&'a Windows>,
    /// Standard deviations of the noise that a residual may have.
    tau: f32,
    /// Largest RMS difference to the table's codeword.
    max_difference: f32,
    /// Variance of what the interpolation gets wrong.
    own: f32,
    interpolator: Interpolator<'a>,
    /// `[pixel of the block][channel]`
    queries: Vec<f32>,
    /// Variances of the queries.
    variances: Vec<f32>,
    hits: Vec<Hit>,
}

impl<'a> Decoder<'a> {
    fn new(table: &'a Table, m: &'a Measurements, settings: &SearchSettings, windows: Option<&'a Windows>) -> Self {
        let k = table.shape().k;
        Self {
            table,
            m,
            windows,
            tau: if settings.max_residual > 0.0 { settings.max_residual } else { f32::INFINITY },
            max_difference: if settings.max_difference > 0.0 { settings.max_difference } else { f32::INFINITY },
            own: settings.interpolation.error().powi(2),
            interpolator: Interpolator::new(table, settings.interpolation),
            queries: vec![0.0; BLOCK * k],
            variances: vec![0.0; BLOCK * k],
            hits: vec![Hit::NONE; BLOCK],
        }
    }

    /// Decodes the pixels of the table from `first` on, as many as there are in `out`, and counts those that fell back.
    /// Only valid ones are looked at.
    fn decode(&mut self, first: usize, out: Part<'_>) -> usize {
        let valid = |l: &PixelStatus| *l == PixelStatus::Valid;
        let (mut x, mut n_fallbacks) = (0, 0);
        while let Some(skipped) = out.status[x..].iter().position(valid) {
            x += skipped;
            let n = out.status[x..].iter().take(BLOCK).take_while(|l| valid(l)).count();
            self.search(first + x, n);
            for i in 0..n {
                let (hit, placed, fell_back) = self.place(first + x, i);
                out.index[x + i] = hit.index;
                n_fallbacks += usize::from(fell_back);
                match placed {
                    Some(p) => {
                        (out.depth[x + i], out.sigma[x + i], out.residual[x + i]) = (p.depth, p.sigma, p.residual)
                    }
                    None if hit.index == u32::MAX => out.status[x + i] = PixelStatus::OutsideVolume,
                    None => out.status[x + i] = PixelStatus::Ambiguous,
                }
            }
            x += n;
        }
        n_fallbacks
    }

    /// Loads a block of `n` pixels that are all valid, from `first` on, and finds their nearest positions.
    fn search(&mut self, first: usize, n: usize) {
        let k = self.m.k;
        let (queries, variances) = (&mut self.queries[..n * k], &mut self.variances[..n * k]);
        let load = |from: usize, queries: &mut [f32], variances: &mut [f32]| {
            let measured = self.m.p[from * k..].iter().zip(&self.m.inv_var[from * k..]);
            for ((q, v), (p, inverse)) in queries.iter_mut().zip(variances).zip(measured) {
                let usable = *inverse > 0.0;
                *q = if usable { *p } else { f32::NAN };
                *v = if usable { 1.0 / inverse } else { 0.0 };
            }
        };
        if self.table.shape().step == 1 {
            load(first, queries, variances);
        } else {
            for (x, (q, v)) in queries.chunks_exact_mut(k).zip(variances.chunks_exact_mut(k)).enumerate() {
                load(pixel_of_camera(self.table, self.m, first + x), q, v);
            }
        }
        let ranges = self.windows.map(|w| w.of(first, n));
        self.table.nearest(first, queries, ranges, &mut self.hits[..n]);
    }

    /// Places the `x`th pixel of the block that begins with `first`; whether its window had explained nothing.
    fn place(&mut self, first: usize, x: usize) -> (Hit, Option<Placed>, bool) {
        let (k, n_positions) = (self.m.k, self.table.shape().n_positions);
        let pixel = first + x;
        let hit = self.hits[x];
        let placed = self.accept(pixel, x, hit);
        if let Some([from, to]) = self.windows.map(|w| w.of(pixel, 1)[0])
            && (from > 0 || (to as usize) < n_positions)
            && (placed.as_ref().is_none_or(|p| !p.explained) || Windows::at_border([from, to], hit.index, n_positions))
        {
            let mut hit = [Hit::NONE];
            self.table.nearest(pixel, &self.queries[x * k..(x + 1) * k], None, &mut hit);
            return (hit[0], self.accept(pixel, x, hit[0]), true);
        }
        (hit, placed, false)
    }

    /// Places a pixel (the `x`th of the block) near a hit and decides whether to believe it.
    fn accept(&mut self, pixel: usize, x: usize, hit: Hit) -> Option<Placed> {
        if hit.index == u32::MAX {
            return None;
        }
        let k = self.m.k;
        let (query, variances) = (&self.queries[x * k..(x + 1) * k], &self.variances[x * k..(x + 1) * k]);
        // Variances of channels that were not measured are 0.
        let n_used = query.iter().filter(|q| !q.is_nan()).count() as f32;
        let noise = variances.iter().sum::<f32>() + n_used * (self.table.variance() + self.own);
        let found = self.interpolator.find(pixel, hit.index as usize, hit.distance, query, variances);
        let mut within = |tau: f32| {
            found.distance <= tau * tau * noise
                || found.distance.sqrt()
                    <= self.interpolator.slack(pixel, hit.index as usize, query).sqrt() + tau * noise.sqrt()
        };
        let explained = within(EXPLAINED.min(self.tau));
        let believed = self.tau == f32::INFINITY || within(self.tau);
        let residual = (found.distance / n_used).sqrt();
        let accepted = believed && residual <= self.max_difference && found.variance.is_finite();
        accepted.then(|| Placed { depth: found.depth, sigma: found.variance.sqrt(), residual, explained })
    }
}

/// Largest slope (depth per lateral mm) across which depth is interpolated between the table's pixels.
const MAX_SLOPE: f32 = 4.0;

/// Every pixel of the camera from every `step`th: bilinear in inverse depth inside of four that belong to one surface;
/// a pixel next to a rejected one is rejected for its reason, one between two surfaces as a depth discontinuity.
fn between(coarse: LookupMaps, table: &Table, m: &Measurements, camera: &Camera) -> LookupMaps {
    let s = *table.shape();
    let one = |i: usize| -> Result<Placed, PixelStatus> {
        if m.status[i] != PixelStatus::Valid {
            return Err(m.status[i]);
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
        let used = corners.iter().filter(|c| c.2 > 0.0).map(|&(x, y, weight)| (y * s.width + x, weight));
        let (mut inverse, mut variance, mut residual, mut near, mut far) = (0.0, 0.0, 0.0, f32::INFINITY, 0.0f32);
        for (c, weight) in used {
            if coarse.status[c] != PixelStatus::Valid {
                return Err(coarse.status[c]);
            }
            let depth = coarse.depth[c];
            inverse += weight / depth;
            variance += weight * coarse.sigma[c] * coarse.sigma[c];
            residual += weight * coarse.residual[c];
            (near, far) = (near.min(depth), far.max(depth));
        }
        if far - near > MAX_SLOPE * near * s.step as f32 / camera.fx.min(camera.fy) as f32 {
            return Err(PixelStatus::DepthDiscontinuity);
        }
        Ok(Placed { depth: 1.0 / inverse, sigma: variance.sqrt(), residual, explained: true })
    };
    let found: Vec<Result<Placed, PixelStatus>> = (0..m.n()).into_par_iter().map(one).collect();
    let map = |of: fn(&Placed) -> f32| found.iter().map(|f| f.as_ref().map_or(f32::NAN, of)).collect();
    LookupMaps {
        depth: map(|p| p.depth),
        sigma: map(|p| p.sigma),
        residual: map(|p| p.residual),
        status: found.iter().map(|f| f.as_ref().err().copied().unwrap_or(PixelStatus::Valid)).collect(),
        ..coarse
    }
}
