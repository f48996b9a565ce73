//! The last step of every method: from per-pixel maps to a surface with normals and a mesh.

use nelu3d_scan::{Camera, Image};
use rayon::prelude::*;

use super::surface::{self, Links};
use crate::result::{Left, Reconstruction};

/// Slope (depth per lateral mm) up to which neighbors always belong together.
pub(crate) const MAX_SLOPE: f32 = 4.0;

/// What a method found, one value a pixel, row by row. Only `depth` and `left` decide what is kept: where either says that
/// there is no depth, the others are taken for NaN.
#[derive(Clone, Debug)]
pub struct Maps {
    /// Camera z, mm; NaN where there is none.
    pub depth: Vec<f32>,
    /// One standard deviation of the depth, mm.
    pub sigma: Vec<f32>,
    /// Why a pixel has no depth. A pixel without a depth that is [`Left::Kept`] here becomes [`Left::Ambiguous`].
    pub left: Vec<Left>,
    /// RMS over the patterns of what the surface leaves unexplained, normalized intensity.
    pub residual: Vec<f32>,
    /// Share of light that is ambient, in [0, 1]; NaN for methods that do not estimate it.
    pub ambient: Vec<f32>,
}

/// Undistorted image-plane coordinates (x/z, y/z) of every pixel, row by row.
pub fn image_plane(camera: &Camera) -> Vec<[f32; 2]> {
    let w = camera.width;
    (0..camera.n_pixels())
        .into_par_iter()
        .map(|i| camera.undistort([(i % w) as f64, (i / w) as f64]).map(|v| v as f32))
        .collect()
}

/// Leaves out connected pieces of surface smaller than `least` pixels, as [`Left::Ambiguous`].
pub fn drop_small(depth: &mut [f32], left: &mut [Left], camera: &Camera, least: usize) {
    let links = Links::new(depth, camera, MAX_SLOPE);
    let sizes = links.component_sizes(depth, camera.width);
    for i in 0..depth.len() {
        if depth[i].is_finite() && (sizes[i] as usize) < least {
            left[i] = Left::Ambiguous;
            depth[i] = f32::NAN;
        }
    }
}

/// Links neighbors, computes normals, builds the mesh. `plane` is [`image_plane`]'s; `info` what the method wants to have on
/// record. The stages are left empty: whoever has the clock fills them in.
///
/// # Panics
///
/// If a map has another size than the camera.
pub fn assemble(
    maps: Maps,
    camera: &Camera,
    plane: &[[f32; 2]],
    white: &Image,
    info: serde_json::Map<String, serde_json::Value>,
) -> Reconstruction {
    let Maps { mut depth, mut sigma, mut left, mut residual, mut ambient } = maps;
    let lengths = [depth.len(), sigma.len(), left.len(), residual.len(), ambient.len(), plane.len()];
    assert!(lengths.iter().all(|n| *n == camera.n_pixels()), "maps of {lengths:?} values");
    for i in 0..depth.len() {
        if depth[i].is_finite() && left[i] == Left::Kept {
            continue;
        }
        if left[i] == Left::Kept {
            left[i] = Left::Ambiguous;
        }
        [depth[i], sigma[i], residual[i], ambient[i]] = [f32::NAN; 4];
    }
    let links = Links::new(&depth, camera, MAX_SLOPE);
    let normals = surface::normals(&depth, &links, plane, camera.width);
    let mesh = surface::mesh(&depth, &normals, &links, plane, white);
    Reconstruction {
        width: camera.width,
        height: camera.height,
        depth,
        normals,
        sigma,
        left,
        residual,
        ambient,
        white: white.clone(),
        mesh,
        stages: Vec::new(),
        info,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_out_is_left_out_of_every_map() {
        let camera = Camera::pinhole(20, 10, 100.0, 100.0, 10.0, 5.0);
        let n = camera.n_pixels();
        let mut depth = vec![500.0; n];
        let mut left = vec![Left::Kept; n];
        depth[3] = f32::NAN;
        left[4] = Left::Edge;
        depth[199] = 900.0;
        drop_small(&mut depth, &mut left, &camera, 5);
        let ones = vec![1.0; n];
        let maps = Maps { depth, sigma: ones.clone(), left, residual: ones.clone(), ambient: ones };
        let r = assemble(maps, &camera, &image_plane(&camera), &Image::new(20, 10, 1), serde_json::Map::new());
        for (i, why) in [(3, Left::Ambiguous), (4, Left::Edge), (199, Left::Ambiguous)] {
            assert_eq!(r.left[i], why);
            assert!(r.depth[i].is_nan() && r.sigma[i].is_nan() && r.residual[i].is_nan() && r.ambient[i].is_nan());
        }
        assert_eq!(r.n_kept(), n - 3);
        assert!(r.mesh.vertices.len() == n - 3 && r.normals[0][2] < -0.99);
    }
}
