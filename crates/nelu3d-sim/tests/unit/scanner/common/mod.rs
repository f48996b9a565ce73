//! A small scanner without noise whose light source stands beside the camera and looks the same way, so that what it
//! throws where is a matter of similar triangles.

#![allow(dead_code, unreachable_pub, reason = "every test file uses a part of this")]

use nelu3d_scan::Image;
use nelu3d_scan::pattern::Pattern;
use nelu3d_scan::rig::{Rig, Shot};
use nelu3d_sim::spec::{
    AlbedoSpec, LightSpec, ObjectSpec, PatternSetSpec, ProjectorSpec, SceneSpec, ShapeSpec, SweepSpec,
};
use nelu3d_sim::{Spec, simulate};

/// Sideways from the camera to the light, mm.
pub const BASELINE_MM: f64 = 60.0;

/// Camera of 240 × 60 px with a focal length of 700 px, projector of 160 × 60 px with 300 px.
pub fn spec(patterns: Vec<Pattern>) -> Spec {
    let mut spec = Spec::preset("shapes").unwrap();
    spec.ambient = 0.0;
    spec.supersampling = 3;
    spec.scenes.clear();
    let c = &mut spec.camera;
    (c.width, c.height) = (240, 60);
    (c.fx, c.fy, c.cx, c.cy) = (700.0, 700.0, 119.5, 29.5);
    c.distortion.clear();
    (c.bits, c.black_level) = (16, 0.0);
    (c.full_well_electrons, c.read_noise_electrons, c.psf_sigma_px) = (1e9, 0.0, 0.0);
    (c.electrons_per_sec, c.exposure_secs) = (4e10.into(), 0.01);
    let SweepSpec::Stage { positions, .. } = &mut spec.sweep else { panic!("a stage") };
    *positions = 3;
    let p = projector(&mut spec);
    (p.width, p.height) = (160, 60);
    (p.fx, p.fy, p.cx, p.cy) = (300.0, 300.0, 79.5, 29.5);
    p.distortion.clear();
    p.position_mm = [BASELINE_MM, 0.0, 0.0];
    p.target_mm = [BASELINE_MM, 0.0, 700.0];
    (p.sharp_sigma_px, p.aperture_mm, p.vignetting, p.black_leak) = (0.3, 0.0, 0.0, 0.0);
    spec.pattern_sets = vec![PatternSetSpec { name: "set".into(), patterns }];
    spec
}

pub fn projector(spec: &mut Spec) -> &mut ProjectorSpec {
    let LightSpec::Projector(p) = &mut spec.light else { panic!("a projector") };
    p
}

/// A white plane that faces the camera.
pub fn plane(z_mm: f64) -> ObjectSpec {
    ObjectSpec {
        albedo: AlbedoSpec::Constant { rgb: [1.0; 3] },
        ..object([0.0, 0.0, z_mm], ShapeSpec::Plane { width_mm: 1000.0, height_mm: 1000.0 })
    }
}

pub fn object(position_mm: [f64; 3], shape: ShapeSpec) -> ObjectSpec {
    let text = format!("position_mm = {position_mm:?}\nshape = {{ kind = \"sphere\", radius_mm = 1.0 }}");
    ObjectSpec { shape, ..toml::from_str(&text).unwrap() }
}

pub fn scene(name: &str, objects: Vec<ObjectSpec>) -> SceneSpec {
    SceneSpec::new(name, objects)
}

/// Simulates into a temporary folder, which lives as long as the first of the pair.
pub fn rig(spec: &Spec) -> (tempfile::TempDir, Rig) {
    let dir = tempfile::tempdir().unwrap();
    simulate(spec, &dir.path().join("rig"), &|_, _, _| ()).unwrap();
    let rig = Rig::open(&dir.path().join("rig")).unwrap();
    (dir, rig)
}

pub fn image(rig: &Rig, shot: &Shot, file: &str) -> Image {
    rig.read_image(&shot.dir.join(file)).unwrap()
}

/// The row through the middle of an image's channel.
pub fn middle_row(image: &Image, channel: usize) -> Vec<f64> {
    (0..image.width).map(|x| f64::from(image.pixel(x, image.height / 2)[channel])).collect()
}

/// Mean and variance of where an edge is: of its derivative along `at`, between two places.
pub fn edge_moments(at: &[f64], values: &[f64], from: f64, to: f64) -> (f64, f64) {
    let (mut sum, mut first, mut second) = (0.0, 0.0, 0.0);
    for i in 1..at.len() {
        let middle = 0.5 * (at[i - 1] + at[i]);
        if middle > from && middle < to {
            let step = values[i] - values[i - 1];
            sum += step;
            first += step * middle;
            second += step * middle * middle;
        }
    }
    let mean = first / sum;
    (mean, second / sum - mean * mean)
}
