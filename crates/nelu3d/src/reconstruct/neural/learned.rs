//! Everything that a training of recipe `paper` changes.

use nelu3d_field::occupancy::OccupancyGrid;
use nelu3d_field::state::TrainingState;
use nelu3d_field::surface::{NeuralSurface, SurfaceConfig, SurfaceLoss};

use super::ambient::AmbientField;
use super::batch::TrainingPixels;
use super::config::{self, PUBLISHED_SHARPNESS};
use super::lookup_start::DecodedBody;
use super::options::{Background, PaperStart};
use super::start::Start;
use crate::reconstruct::options::ReconstructionOptions;
use crate::reconstruct::scene::Scene;

/// What is learned, and where it is looked for.
pub(super) struct Learned {
    /// The signed distance field.
    pub(super) surface: NeuralSurface,
    /// The ambient term.
    pub(super) ambient: AmbientField,
    /// The cells in which rays are sampled.
    pub(super) occupancy: OccupancyGrid,
}

impl Learned {
    /// Initializes the fields, the signed distance with random parameters: [`Self::start`] gives it its shape, or a
    /// checkpoint its state.
    pub(super) fn new(
        scene: &Scene<'_>,
        pixels: &TrainingPixels,
        opts: &ReconstructionOptions,
        n_steps: usize,
    ) -> Self {
        let settings = &opts.paper;
        let occupancy =
            OccupancyGrid::new(config::occupancy_config(n_steps), |q| pixels.reaches(scene.camera, &scene.rays, q));
        Self {
            surface: Start::Random.surface(surface_config(opts, n_steps), opts.seed),
            ambient: AmbientField::new(settings.ambient, scene.white.channels, n_steps, opts.seed),
            occupancy,
        }
    }

    /// Gives the signed distance its first shape. `decoded` is the depth map from which training starts, camera z in
    /// mm, if it does.
    pub(super) fn start(
        &mut self,
        scene: &Scene<'_>,
        pixels: &TrainingPixels,
        opts: &ReconstructionOptions,
        decoded: Option<&[f32]>,
    ) {
        let mut config = self.surface.config().clone();
        let body = decoded.and_then(|z| DecodedBody::new(scene.camera, pixels.bounds, &scene.rays.plane, z));
        self.surface = match body {
            Some(body) => {
                config.sharpness = opts.paper.sharpness.unwrap_or_else(|| body.sharpness());
                // Where the surface is known, what is left of the light is known to be little.
                self.ambient.darken();
                body.surface(config, opts.seed)
            }
            None => opts.paper.start.shape().unwrap_or_default().surface(config, opts.seed),
        };
    }

    /// Returns what a checkpoint holds, in its order.
    pub(super) fn parts(&self) -> [&dyn TrainingState; 3] {
        parts(&self.surface, &self.ambient, &self.occupancy)
    }

    /// Returns what a checkpoint holds, in its order, to be read.
    pub(super) fn parts_mut(&mut self) -> [&mut dyn TrainingState; 3] {
        [&mut self.surface, &mut self.ambient.field, &mut self.occupancy]
    }
}

/// Returns what a checkpoint holds, in its order.
pub(super) fn parts<'a>(
    surface: &'a NeuralSurface,
    ambient: &'a AmbientField,
    occupancy: &'a OccupancyGrid,
) -> [&'a dyn TrainingState; 3] {
    [surface, &ambient.field, occupancy]
}

/// Returns the signed distance field of a training of `n_steps` iterations.
fn surface_config(opts: &ReconstructionOptions, n_steps: usize) -> SurfaceConfig {
    let settings = &opts.paper;
    let loss = SurfaceLoss {
        lookup_loss_weight: settings.lookup_loss_weight,
        clamped_mask: settings.background != Background::Carve,
        ..SurfaceLoss::default()
    };
    let sharpness = settings.sharpness.unwrap_or(PUBLISHED_SHARPNESS);
    let mut config = SurfaceConfig { sharpness, ..config::surface_config(loss, n_steps) };
    config::hasten(&mut config, n_steps);
    if settings.start == PaperStart::Lookup {
        config::warm_up_longer(&mut config);
    }
    config
}
