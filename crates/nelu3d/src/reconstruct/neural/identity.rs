//! What a checkpoint of recipe `paper` must have been made of to go on with it.

use super::batch::TrainingPixels;
use super::checkpoint::{Identity, SceneDigest};
use crate::color_field::Form;
use crate::reconstruct::options::ReconstructionOptions;
use crate::reconstruct::scene::Scene;

/// Returns the identity of a training of `n_steps` iterations.
pub(super) fn identity(
    scene: &Scene<'_>,
    pixels: &TrainingPixels,
    opts: &ReconstructionOptions,
    n_steps: usize,
) -> Identity {
    // However the number of iterations was given.
    let settings = ReconstructionOptions { steps: Some(n_steps), ..opts.clone() };
    let (m, rays, field) = (&scene.measurements, &scene.rays, scene.field);
    let mut digest = SceneDigest::default();
    digest.floats(&m.p).floats(&m.light).indices(&pixels.all).text(&pixels.is_lit);
    digest.floats(rays.plane.as_flattened()).floats(rays.range.as_flattened());
    digest.text(&[m.width, m.height, m.k]).text(&field.frame);
    match &field.form {
        Form::Published(form) => digest.floats(form.params()),
        _ => digest.floats(&scene.grid.coeffs),
    };
    Identity::new("recipe paper", &settings, digest)
}
