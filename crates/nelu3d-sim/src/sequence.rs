//! Moving scenes: where things are at a moment, and what the camera collects while they move.

use std::path::Path;

use nalgebra::{UnitQuaternion, Vector3};
use nelu3d_scan::Image;

use crate::capture::VirtualCamera;
use crate::error::SimulationError;
use crate::ground_truth::GroundTruth;
use crate::light::{Illumination, LightSource};
use crate::scene::VirtualScene;

use crate::spec::{CameraSpec, DeformationSpec, MovingObjectSpec, ObjectSpec, SequenceSpec, Spec, SpecError};

/// Returns a moving object at a moment, seconds from the beginning of its sequence.
///
/// With p₀ and R₀ its position and rotation at the time 0: `p = p₀ + v t + ½ a t²`, `R = exp(ω t) R₀`.
pub fn object_at(moving: &MovingObjectSpec, time_secs: f64) -> ObjectSpec {
    let m = &moving.motion;
    let mut object = moving.object.clone();
    for (k, p) in object.position_mm.iter_mut().enumerate() {
        *p += m.velocity_mm_per_sec[k] * time_secs + 0.5 * m.acceleration_mm_per_sec2[k] * time_secs * time_secs;
    }
    if m.angular_velocity != [0.0; 3] {
        let turn = UnitQuaternion::from_scaled_axis(Vector3::from(m.angular_velocity) * time_secs);
        let rotation = turn * UnitQuaternion::from_scaled_axis(Vector3::from(object.rotation));
        object.rotation = rotation.scaled_axis().into();
    }
    let swing = (std::f64::consts::TAU * m.vibration_hz * time_secs).cos();
    match &mut object.deformation {
        Some(DeformationSpec::Wave { amplitude_mm, phase, .. }) => {
            *amplitude_mm *= swing;
            *phase += m.phase_per_sec * time_secs;
        }
        Some(DeformationSpec::Bend { curvature_per_mm, .. }) => *curvature_per_mm *= swing,
        Some(DeformationSpec::Curl { height_mm, .. }) => *height_mm *= swing,
        Some(DeformationSpec::Twist { rate_per_mm, .. }) => *rate_per_mm *= swing,
        None => {}
    }
    object
}

/// Returns the scene of a sequence at a moment, seconds.
fn scene_at(sequence: &SequenceSpec, time_secs: f64) -> Result<VirtualScene, SpecError> {
    let objects: Vec<ObjectSpec> = sequence.objects.iter().map(|o| object_at(o, time_secs)).collect();
    VirtualScene::new(&objects)
}

/// Returns the middle of the exposure of a frame's first pattern, seconds.
fn start_secs(sequence: &SequenceSpec, frame: usize) -> f64 {
    frame as f64 / sequence.fps
}

/// Captures the images of a frame, each at its own moment, writes them into the folder `dir` and returns the ground
/// truth of the moment of the first pattern.
pub(crate) fn capture_frame(
    camera: &VirtualCamera,
    sequence: &SequenceSpec,
    frame: usize,
    patterns: &[(Illumination, String)],
    shot: u64,
    dir: &Path,
) -> Result<GroundTruth, SimulationError> {
    let start = start_secs(sequence, frame);
    let flash = start + sequence.flash_delay_secs;
    let mut shots = vec![(Illumination::White, "white.png", flash)];
    if sequence.black {
        shots.push((Illumination::Black, "black.png", flash));
    }
    for (i, (show, file)) in patterns.iter().enumerate() {
        shots.push((*show, file, start + i as f64 * sequence.pattern_interval_secs));
    }
    let images =
        shots.iter().map(|(show, _, time)| expose(camera, sequence, *show, *time, shot)).collect::<Result<_, _>>()?;
    let files: Vec<&str> = shots.iter().map(|s| s.1).collect();
    camera.read_out(images, &files, shot, dir)?;
    Ok(GroundTruth::new(camera.renderer.camera(), &scene_at(sequence, start)?, camera.light))
}

/// Returns the light of an exposure about a moment: the mean over its parts, each frozen in its middle.
fn expose(
    camera: &VirtualCamera,
    sequence: &SequenceSpec,
    show: Illumination,
    time_secs: f64,
    shot: u64,
) -> Result<Image, SpecError> {
    let CameraSpec { shutter_samples: n, exposure_secs, .. } = camera.spec.camera;
    let mut sum: Option<Image> = None;
    for part in 0..n {
        let offset = ((part as f64 + 0.5) / n as f64 - 0.5) * exposure_secs;
        let scene = scene_at(sequence, time_secs + offset)?;
        // Each part samples its pixels anew.
        let shot_of_part = shot | (part as u64) << 48;
        let image =
            camera.renderer.render(&scene, camera.light, &[show], shot_of_part).pop().expect("an image per frame");
        match &mut sum {
            None => sum = Some(image),
            Some(sum) => sum.data.iter_mut().zip(&image.data).for_each(|(s, v)| *s += v),
        }
    }
    let mut mean = sum.expect("at least one part");
    mean.data.iter_mut().for_each(|v| *v /= n as f32);
    Ok(mean)
}

impl GroundTruth {
    /// Returns the ground truth of frame `frame` of sequence `index` of a spec, at the moment of its first pattern.
    ///
    /// # Panics
    ///
    /// If the spec does not pass [`Spec::check`] or has no such sequence.
    ///
    /// # Errors
    ///
    /// A file that an object names cannot be read.
    pub fn of_frame(spec: &Spec, index: usize, frame: usize) -> Result<Self, SpecError> {
        let sequence = &spec.sequences[index];
        let scene = scene_at(sequence, start_secs(sequence, frame))?;
        let camera = spec.camera.optics().expect("checked with the spec");
        Ok(Self::new(&camera, &scene, &LightSource::new(spec, &[])))
    }
}
