//! Ground truth: depth, mask and mesh of a scene.

use nelu3d_scan::Mesh;
use nelu3d_scan::camera::Camera;
use rayon::prelude::*;

use crate::light::LightSource;
use crate::scene::{PrintedBoard, VirtualScene};
use crate::spec::Spec;
use crate::staging::{light_motion, stage};

/// The ground truth of a scene, exact but for rounding to `f32`.
#[derive(Clone, Debug, PartialEq)]
pub struct GroundTruth {
    /// `height × width`: camera-frame z of the first surface at the pixel's center, mm; NaN where there is none.
    pub depth: Vec<f32>,
    /// `height × width`: whether depth is finite and the light source's pattern and flash reach the point.
    pub mask: Vec<bool>,
    /// All surfaces, in the camera's frame.
    pub mesh: Mesh,
}

impl GroundTruth {
    /// Computes the ground truth of what a camera sees.
    pub(crate) fn new(camera: &Camera, scene: &VirtualScene, light: &LightSource) -> Self {
        let w = camera.width;
        let pixels: Vec<(f32, bool)> = (0..camera.n_pixels())
            .into_par_iter()
            .map(|i| match scene.hit(&camera.ray([(i % w) as f64, (i / w) as f64])) {
                None => (f32::NAN, false),
                Some(hit) => {
                    let sample = light.sample(&hit.point, &hit.shading_normal, &|to| scene.is_visible_from(&hit, to));
                    (hit.point.z as f32, light.illuminates(&sample))
                }
            })
            .collect();
        let (depth, mask) = pixels.into_iter().unzip();
        Self { depth, mask, mesh: scene.mesh() }
    }

    /// Returns the ground truth of scene `index` of a spec.
    ///
    /// # Panics
    ///
    /// If the spec does not pass [`Spec::check`] (which reads the files it names) or has no such scene.
    pub fn of_scene(spec: &Spec, index: usize) -> Self {
        let camera = spec.camera.optics().expect("checked with the spec");
        let scene = &spec.scenes[index];
        // What the light source shows, and the print of a board, do not matter for where it reaches.
        let staged = stage(spec, scene, &PrintedBoard::of_spec(spec).expect("checked with the spec"));
        let mut light = LightSource::new(spec, &[]);
        light.move_by(&light_motion(spec, scene));
        Self::new(&camera, &staged.expect("checked with the spec"), &light)
    }
}
