//! The last step of every method: from per-pixel maps to a surface with normals and a mesh.

use nelu3d_scan::{Camera, Image};
use rayon::prelude::*;

use super::links::Links;
use super::mesh::{normals_from_links, triangulate};
use super::{PixelStatus, Surface, SurfaceMaps};

/// Slope (depth per lateral distance, both mm) up to which neighboring pixels always belong to one surface.
pub const MAX_SLOPE: f32 = 4.0;

/// Returns the undistorted image-plane coordinates (x/z, y/z) of every pixel, row by row.
pub fn image_plane(camera: &Camera) -> Vec<[f32; 2]> {
    let w = camera.width;
    (0..camera.n_pixels())
        .into_par_iter()
        .map(|i| camera.undistort([(i % w) as f64, (i / w) as f64]).map(|v| v as f32))
        .collect()
}

/// Rejects connected components of fewer than `min_size` pixels as [`PixelStatus::Ambiguous`].
pub fn reject_small_components(depth: &mut [f32], status: &mut [PixelStatus], camera: &Camera, min_size: usize) {
    let links = Links::new(depth, camera, MAX_SLOPE);
    let sizes = links.component_sizes(depth, camera.width);
    for i in 0..depth.len() {
        if depth[i].is_finite() && (sizes[i] as usize) < min_size {
            status[i] = PixelStatus::Ambiguous;
            depth[i] = f32::NAN;
        }
    }
}

/// Links neighbors, computes normals and builds the mesh. `plane` is that of [`image_plane`].
///
/// # Panics
///
/// If a map has another size than the camera.
pub fn assemble(maps: SurfaceMaps, camera: &Camera, plane: &[[f32; 2]], white: &Image) -> Surface {
    let SurfaceMaps { mut depth, mut sigma, mut status, mut residual, mut ambient } = maps;
    let lengths = [depth.len(), sigma.len(), status.len(), residual.len(), ambient.len(), plane.len()];
    assert!(lengths.iter().all(|n| *n == camera.n_pixels()), "maps of {lengths:?} values");
    for i in 0..depth.len() {
        if depth[i].is_finite() && status[i] == PixelStatus::Valid {
            continue;
        }
        if status[i] == PixelStatus::Valid {
            status[i] = PixelStatus::Ambiguous;
        }
        [depth[i], sigma[i], residual[i], ambient[i]] = [f32::NAN; 4];
    }
    let links = Links::new(&depth, camera, MAX_SLOPE);
    let normals = normals_from_links(&depth, &links, plane, camera.width);
    let mesh = triangulate(&depth, &normals, &links, plane, white);
    let (width, height, white) = (camera.width, camera.height, white.clone());
    Surface { width, height, depth, normals, sigma, status, residual, ambient, white, mesh }
}
