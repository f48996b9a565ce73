//! TurboSL (Mirdehghan, Wu, Chen, Lindell & Kutulakos, "TurboSL: Dense, Accurate and Fast 3D by Neural Inverse Structured
//! Light", CVPR 2024): a signed distance field, an albedo, an ambient term and the projector's blur, trained so that the
//! captures are rendered from the patterns and, from iteration 1,000 on, the patterns from the captures.
//!
//! Settings are those of its public configuration; deviations: the first shape is a plane or a sphere, the blur is the same to
//! both sides, patterns change along one axis, rays are drawn from lit pixels only, and the depth is that of NeuS's own
//! quadrature at the end. `ray.rs` is the image formation, `scene.rs` what is known, `step.rs` one iteration.

mod blur;
mod ray;
mod scene;
mod step;

use nelu3d_field::HashField;
use nelu3d_field::occupancy::OccupancyGrid;
use nelu3d_field::surface::SurfaceLoss;
use nelu3d_scan::{Camera, Image, Projector};
use serde::{Deserialize, Serialize};
use serde_json::json;

use super::Error;
use super::captured::Captured;
use super::code::Code;
use crate::progress::Progress;
use crate::reconstruct::assemble::Maps;
use crate::result::Left;
use crate::sdf::{self, Start, view};
use blur::Blur;
use scene::Scene;
use step::Model;

/// Settings of TurboSL.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
#[cfg_attr(feature = "clap", command(next_help_heading = "TurboSL"))]
#[serde(default, deny_unknown_fields)]
pub struct Options {
    /// Iterations
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", default_value_t = 10_000))]
    pub steps: usize,
    /// Samples per iteration; the number of rays follows
    #[cfg_attr(feature = "clap", arg(long, value_name = "N", default_value_t = 262_144))]
    pub samples: usize,
    /// First shape of the signed distance field
    #[cfg_attr(feature = "clap", arg(long, value_enum, default_value_t = Start::Plane))]
    pub start: Start,
    /// Seed of everything random
    #[cfg_attr(feature = "clap", arg(long, default_value_t = 0))]
    pub seed: u64,
    /// Render from the camera only, never the patterns from the captures
    #[cfg_attr(feature = "clap", arg(long))]
    pub no_reverse: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { steps: 10_000, samples: 262_144, start: Start::Plane, seed: 0, no_reverse: false }
    }
}

/// A surface, and what the method wants to have on record.
pub(super) struct Found {
    pub(super) maps: Maps,
    /// Of the field itself; NaN where there is no depth.
    pub(super) normals: Vec<[f32; 3]>,
    pub(super) info: serde_json::Map<String, serde_json::Value>,
}

/// Decodes a scene between two depths, mm.
#[allow(clippy::too_many_arguments)]
pub(super) fn decode(
    camera: &Camera,
    projector: &Projector,
    plane: &[[f32; 2]],
    depth: [f64; 2],
    patterns: &[Image],
    captured: &Captured,
    code: &Code,
    opts: &Options,
    progress: &Progress,
) -> Result<Found, Error> {
    let scene = Scene::new(camera, projector, plane, depth, patterns, captured, code)?;
    let loss = SurfaceLoss { mask_weight: sdf::MASK_WEIGHT, ..SurfaceLoss::default() };
    let image_field = |seed| {
        let config = sdf::image_field_config(scene.n_channels, opts.steps);
        HashField::new(config, seed).expect("the published configuration is valid")
    };
    let mut model = Model {
        surface: opts.start.surface(sdf::surface_config(loss, opts.steps), opts.seed),
        albedo: image_field(opts.seed.wrapping_add(1)),
        ambient: image_field(opts.seed.wrapping_add(2)),
        blur: [Blur::new(), Blur::new()],
    };
    let mut grid = OccupancyGrid::new(sdf::occupancy_config(), |q| scene.reaches(q));
    // Of 10,000 iterations: from the 1,000th on; the cosine's annealing would take 20,000.
    let reverse_from = opts.steps / 10;
    let mut n_rays = sdf::FIRST_RAYS;
    let mut records = Vec::new();
    for step in 0..opts.steps {
        if progress.cancelled() {
            return Err(Error::Cancelled);
        }
        sdf::update_occupancy(&mut grid, &model.surface, step as u64, opts.seed);
        let reverse = !opts.no_reverse && step >= reverse_from;
        let anneal = step as f32 / (2 * opts.steps) as f32;
        let seed = opts.seed.wrapping_mul(0x9E37_79B9).wrapping_add(step as u64);
        let (losses, n_samples) = model.step(&scene, &grid, n_rays, reverse, anneal, seed);
        if step % 100 == 0 || step + 1 == opts.steps {
            let (inv_s, occupied) = (model.surface.inv_s(), grid.occupied_fraction());
            tracing::info!(?losses, inv_s, n_rays, n_samples, occupied, blur = ?model.blur[0].taps(), step);
            records.push(json!({
                "iteration": step + 1,
                "image": losses.image,
                "mask": losses.mask,
                "eikonal": losses.eikonal,
                "sparsity": losses.sparsity,
                "inv_s_per_mm": inv_s / scene.bounds.unit_mm,
                "rays": n_rays,
                "samples": n_samples,
                "occupied": occupied,
            }));
            if !losses.total.is_finite() {
                let problem = format!("led to a loss that is no number at iteration {}; try another", step + 1);
                return Err(Error::Setting { setting: "--seed", problem });
            }
        }
        n_rays = sdf::next_ray_count(n_rays, n_samples, opts.samples);
        progress.tick(step + 1, opts.steps);
    }
    let mut found = see(&scene, &model, &grid, captured);
    found.info.insert("losses".into(), records.into());
    found.info.insert("unit_mm".into(), json!(scene.bounds.unit_mm));
    found.info.insert("blur".into(), json!({ "x": model.blur[0].taps(), "y": model.blur[1].taps() }));
    Ok(found)
}

/// Renders what was learned from the camera.
fn see(scene: &Scene<'_>, model: &Model, grid: &OccupancyGrid, captured: &Captured) -> Found {
    let n = scene.camera.n_pixels();
    let (k, c) = (scene.k(), scene.n_channels);
    let lit: Vec<usize> = scene.lit.iter().map(|&i| i as usize).collect();
    let marches: Vec<_> = lit.iter().map(|&i| scene.camera_march(i, 0.5)).collect();
    let seen = view::view(&model.surface, &scene.bounds, grid, &marches);
    let slopes = view::normals(&model.surface, &scene.bounds, &marches, &seen.t);
    let places: Vec<[f32; 2]> =
        lit.iter().map(|&i| scene.place([(i % scene.camera.width) as f32, (i / scene.camera.width) as f32])).collect();
    let (mut albedo, mut ambient) = (vec![0.0; lit.len() * c], vec![0.0; lit.len() * c]);
    model.albedo.query(&places, &mut albedo);
    model.ambient.query(&places, &mut ambient);
    let blurred: Vec<Vec<f32>> =
        scene.lines.iter().map(|(axis, line)| model.blur[*axis as usize].apply(line)).collect();
    let mut maps = Maps {
        depth: vec![f32::NAN; n],
        sigma: vec![f32::NAN; n],
        left: captured.left.clone(),
        residual: vec![f32::NAN; n],
        ambient: vec![f32::NAN; n],
    };
    let mut normals = vec![[f32::NAN; 3]; n];
    let center = scene.projector.center();
    for (r, &i) in lit.iter().enumerate() {
        if seen.t[r].is_nan() {
            maps.left[i] = Left::Ambiguous;
            continue;
        }
        let dir = marches[r].dir;
        let x = marches[r].origin + dir * f64::from(seen.t[r]);
        maps.depth[i] = x.z as f32;
        maps.sigma[i] = seen.spread[r] * dir.z as f32;
        normals[i] = slopes[r];
        let to_light = (center - x).normalize();
        let shade = (0..3).map(|a| f64::from(slopes[r][a]) * to_light[a]).sum::<f64>() as f32;
        let place = scene.projector.project(&x).map_or([-1e6; 2], |p| p.map(|v| v as f32));
        // In units of the pixel's contrast, as every method's.
        let square = |j: usize| {
            let color = blur::sample(&blurred[j], place[scene.lines[j].0 as usize]);
            let (a, b) = (albedo[r * c + j % c], ambient[r * c + j % c]);
            ((a * shade * color + b - scene.measured(i)[j]) / captured.contrast[i].max(1e-4)).powi(2)
        };
        maps.residual[i] = ((0..k).map(square).sum::<f32>() / k as f32).sqrt();
        let white = captured.contrast[i] + captured.black[i];
        let mean = ambient[r * c..(r + 1) * c].iter().sum::<f32>() / c as f32;
        maps.ambient[i] = (mean / white.max(1e-4)).clamp(0.0, 1.0);
    }
    Found { maps, normals, info: serde_json::Map::new() }
}
