//! The learned surface as the camera sees it.

use nelu3d::reconstruct::neural::view;
use nelu3d::surface::{PixelStatus, SurfaceMaps};
use nelu3d_field::occupancy::OccupancyGrid;

use super::scene::TurboSlScene;
use super::step::Model;
use crate::captured::Captured;

/// Renders what was learned from the camera.
pub(super) fn render_surface(
    scene: &TurboSlScene<'_>,
    model: &Model,
    grid: &OccupancyGrid,
    captured: &Captured,
) -> (SurfaceMaps, Vec<[f32; 3]>) {
    let n = scene.camera.n_pixels();
    let (k, c) = (scene.k(), scene.n_channels);
    let lit: Vec<usize> = scene.lit.iter().map(|&i| i as usize).collect();
    let marches: Vec<_> = lit.iter().map(|&i| scene.camera_march(i, 0.5)).collect();
    let seen = view::render(&model.surface, &scene.bounds, grid, &marches);
    let slopes = view::normals(&model.surface, &scene.bounds, &marches, &seen.t);
    let places: Vec<[f32; 2]> =
        lit.iter().map(|&i| scene.place([(i % scene.camera.width) as f32, (i / scene.camera.width) as f32])).collect();
    let (mut albedo, mut ambient) = (vec![0.0; lit.len() * c], vec![0.0; lit.len() * c]);
    model.albedo.query(&places, &mut albedo);
    model.ambient.query(&places, &mut ambient);
    let blurred = scene.shown.blurred(&model.blur);
    let mut maps = SurfaceMaps {
        depth: vec![f32::NAN; n],
        sigma: vec![f32::NAN; n],
        status: captured.status.clone(),
        residual: vec![f32::NAN; n],
        ambient: vec![f32::NAN; n],
    };
    let mut normals = vec![[f32::NAN; 3]; n];
    let center = scene.projector.center();
    for (r, &i) in lit.iter().enumerate() {
        if seen.t[r].is_nan() {
            maps.status[i] = PixelStatus::Ambiguous;
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
            let color = scene.shown.sample(j, &blurred[j], place);
            let (a, b) = (albedo[r * c + j % c], ambient[r * c + j % c]);
            ((a * shade * color + b - scene.measured(i)[j]) / captured.contrast[i].max(1e-4)).powi(2)
        };
        maps.residual[i] = ((0..k).map(square).sum::<f32>() / k as f32).sqrt();
        let white = captured.contrast[i] + captured.black[i];
        let mean = ambient[r * c..(r + 1) * c].iter().sum::<f32>() / c as f32;
        maps.ambient[i] = (mean / white.max(1e-4)).clamp(0.0, 1.0);
    }
    (maps, normals)
}
