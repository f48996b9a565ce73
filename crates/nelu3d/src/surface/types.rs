//! The maps of a surface, before and after it is assembled.

use nelu3d_scan::{Image, Mesh};

use super::PixelStatus;

/// The maps that a method finds, one value per pixel, row by row. Only `depth` and `status` decide which pixels are
/// valid: where either says that there is no depth, the other maps are taken for NaN.
#[derive(Clone, Debug)]
pub struct SurfaceMaps {
    /// Camera z, mm; NaN where there is none.
    pub depth: Vec<f32>,
    /// One standard deviation of the depth, mm.
    pub sigma: Vec<f32>,
    /// Status of each pixel. A pixel without a depth that is [`PixelStatus::Valid`] here becomes
    /// [`PixelStatus::Ambiguous`].
    pub status: Vec<PixelStatus>,
    /// RMS residual over the patterns, normalized intensity.
    pub residual: Vec<f32>,
    /// Fraction of ambient light, in [0, 1]; NaN for methods that do not estimate it.
    pub ambient: Vec<f32>,
}

/// A reconstructed surface in the camera's frame. Maps are `height × width`, row by row.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Width of the maps, pixels.
    pub width: usize,
    /// Height of the maps, pixels.
    pub height: usize,
    /// Camera z of the first surface at each pixel's center, mm; NaN where there is none.
    pub depth: Vec<f32>,
    /// Unit surface normals that face the camera; NaN where there is no depth.
    pub normals: Vec<[f32; 3]>,
    /// One standard deviation of the depth, mm; NaN where there is no depth.
    pub sigma: Vec<f32>,
    /// Status of each pixel.
    pub status: Vec<PixelStatus>,
    /// RMS over the patterns of the residual in normalized intensity; NaN where there is no depth.
    pub residual: Vec<f32>,
    /// Ambient fraction A in [0, 1]: `I_ambient = A · I_white`, mean over channels; NaN where there is none.
    pub ambient: Vec<f32>,
    /// The white (flash) image: texture and preview.
    pub white: Image,
    /// Triangles between neighboring pixels of one surface.
    pub mesh: Mesh,
}

impl Surface {
    /// Returns the number of pixels that have a depth.
    pub fn n_valid(&self) -> usize {
        self.depth.iter().filter(|z| z.is_finite()).count()
    }

    /// Returns the number of pixels of each status, in the order of [`PixelStatus::ALL`].
    pub fn status_counts(&self) -> [usize; 6] {
        let mut counts = [0; 6];
        for &status in &self.status {
            counts[status as usize] += 1;
        }
        counts
    }

    /// Replaces normals by those of a method that has better ones (the gradient of its distance field), where both the
    /// surface and `own` have one. `own` is empty or one per pixel.
    pub fn replace_normals(&mut self, own: &[[f32; 3]]) {
        for (normal, own) in self.normals.iter_mut().zip(own) {
            if normal[0].is_finite() && own[0].is_finite() {
                *normal = *own;
            }
        }
    }
}
