//! A training under way.

use super::super::Gpu;
use super::super::net::Net;
use super::super::program::Call;
use super::buffers::{Buffers, control};
use super::calls::Calls;
use super::scene::{RayScene, TrainingReport};
use crate::adam::MomentBuffers;
use crate::device::DeviceError;
use crate::field::HashField;
use crate::occupancy::OccupancyGrid;
use crate::surface::{NeuralSurface, SurfaceLosses};
use std::sync::Arc;

/// Steps after which the device is waited for.
const STEPS_AHEAD: usize = 8;

/// A training of a [`NeuralSurface`] under way on the device: rays, samples, codewords, ambient light, compositing, all
/// losses, both networks, the occupancy grid. Nothing goes over the bus from step to step.
#[derive(Debug)]
pub struct SurfaceTraining {
    pub(super) gpu: Arc<Gpu>,
    pub(super) net: Net,
    pub(super) ambient: Net,
    /// Steps done before this training, of the two fields.
    before: [u64; 2],
    done: usize,
    n_steps: usize,
    /// See [`RayScene::anneal_steps`].
    pub(super) anneal_steps: usize,
    /// Weights of the mask, eikonal and sparsity losses.
    weights: [f64; 3],
    /// Steps between two updates of the occupancy grid.
    every: u64,
    n_cells: usize,
    pub(super) buffers: Buffers,
    pub(super) calls: Calls,
}

impl SurfaceTraining {
    /// Puts everything on the device, for at most `n_steps` steps, with the [`RayScene::first_step`] that are done.
    ///
    /// # Errors
    ///
    /// It does not fit, or the device failed.
    ///
    /// # Panics
    ///
    /// If a length does not fit, not every sample is to be in the eikonal loss, or a field has fewer steps than are
    /// done.
    pub fn new(
        gpu: &Arc<Gpu>,
        surface: &NeuralSurface,
        ambient: &HashField<2>,
        occupancy: &OccupancyGrid,
        scene: &RayScene<'_>,
        n_steps: usize,
    ) -> Result<Self, DeviceError> {
        scene.check();
        assert_eq!(ambient.n_outputs(), scene.n_channels);
        assert_eq!(surface.config.loss.eikonal_every, 1, "alphas at midpoints need every gradient");
        let (config, settings) = (&surface.config, &surface.config.loss);
        // A quarter more than wanted: how many there will be is known when they are drawn.
        let net = Net::new(gpu, &surface.field, scene.n_samples + scene.n_samples / 4, true)?;
        let ambient_net = Net::new(gpu, ambient, scene.max_rays, true)?;
        let nets = [&net, &ambient_net];
        let buffers = Buffers::new(gpu, nets, surface, ambient, occupancy, scene, n_steps)?;
        let calls = Calls::new(gpu, nets, &buffers, config, occupancy, scene)?;
        Ok(Self {
            gpu: gpu.clone(),
            net,
            ambient: ambient_net,
            before: [surface.field.n_steps(), ambient.n_steps()].map(|n| n - scene.first_step as u64),
            done: scene.first_step,
            n_steps,
            anneal_steps: scene.anneal_steps,
            weights: [settings.mask_weight, settings.eikonal_weight, settings.sparsity_weight],
            every: occupancy.config.every,
            n_cells: occupancy.cells.len(),
            buffers,
            calls,
        })
    }

    /// Returns the number of steps done, with [`RayScene::first_step`].
    pub fn done(&self) -> usize {
        self.done
    }

    /// Trains until `until` steps are done, and reports how it went.
    ///
    /// # Errors
    ///
    /// The device failed; what it held is lost.
    pub fn run(&mut self, until: usize) -> Result<TrainingReport, DeviceError> {
        assert!(until <= self.n_steps && until > self.done);
        while self.done < until {
            // The grid counts its own steps; a training that goes on elsewhere looks at every cell again.
            let looks = (self.done as u64).is_multiple_of(self.every);
            let look: &[Call] = if looks { &self.calls.look } else { &[] };
            let record: &[Call] = if self.done + 1 == until { &self.calls.record } else { &[] };
            self.gpu.submit(&[look, &self.calls.draw, &self.calls.step, record])?;
            self.done += 1;
            if self.done.is_multiple_of(STEPS_AHEAD) {
                self.gpu.wait()?;
            }
        }
        self.report()
    }

    /// Reads the losses and counts of the last step that was the last of a [`Self::run`].
    ///
    /// # Errors
    ///
    /// The device failed.
    pub fn report(&self) -> Result<TrainingReport, DeviceError> {
        let b = &self.buffers;
        let [image, mask, eikonal, sparsity] = self.gpu.read(&b.losses, 1)?[0].map(f64::from);
        let [w_mask, w_eikonal, w_sparsity] = self.weights;
        let total = image + w_mask * mask + w_eikonal * eikonal + w_sparsity * sparsity;
        let numbers = self.gpu.read(&b.control, control::N)?;
        let occupied = self.gpu.read(&b.occupied, b.occupied.len())?;
        let n_occupied: u32 = occupied.iter().map(|w| w.count_ones()).sum();
        Ok(TrainingReport {
            losses: SurfaceLosses { total, image, mask, eikonal, sparsity },
            n_rays: numbers[control::RAYS_AT] as usize,
            n_samples: numbers[control::N_AT] as usize,
            inv_s: self.gpu.read(&b.sharpness, 4)?[3].into(),
            occupied: f64::from(n_occupied) / self.n_cells.max(1) as f64,
        })
    }

    /// Brings back what was trained, with the optimizers' state.
    ///
    /// # Errors
    ///
    /// The device failed; what was given may be changed in part.
    pub fn fetch(
        &self,
        surface: &mut NeuralSurface,
        ambient: &mut HashField<2>,
        occupancy: &mut OccupancyGrid,
    ) -> Result<(), DeviceError> {
        let (gpu, b) = (&self.gpu, &self.buffers);
        let steps = self.before.map(|before| before + self.done as u64);
        self.net.fetch(gpu, steps[0], &mut surface.field)?;
        self.ambient.fetch(gpu, steps[1], ambient)?;
        let [v, first, second, _]: [f32; 4] = gpu.read(&b.sharpness, 4)?.try_into().expect("four values");
        surface.sharpness = v;
        surface.sharpness_moments = MomentBuffers { first: vec![first], second: vec![second] };
        occupancy.values = gpu.read(&b.values, b.values.len())?;
        let words = gpu.read(&b.occupied, b.occupied.len())?;
        occupancy.occupied = words.chunks_exact(2).map(|w| u64::from(w[0]) | u64::from(w[1]) << 32).collect();
        Ok(())
    }
}
