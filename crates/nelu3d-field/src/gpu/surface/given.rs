//! A step on given rays.

use super::buffers::control;
use super::scene::TrainingReport;
use super::training::SurfaceTraining;
use crate::device::DeviceError;
use crate::surface::SurfaceBatch;

impl SurfaceTraining {
    /// Takes the first step on given rays in the place of drawn ones, to be compared with
    /// [`NeuralSurface::train_step`](crate::surface::NeuralSurface::train_step) in a test. Ray r belongs to pixel r of
    /// the scene, with its direction, mask, measured codeword and I_white; k is its number of channels, and the ambient
    /// network takes part. Intervals are as long as the scene's steps, and annealed as far as the batch says. Returns how it went and the gradients by the sums of the ambient network's output layer, `[ray][k]`.
    ///
    /// # Errors
    ///
    /// The device failed.
    ///
    /// # Panics
    ///
    /// If there is not enough room for the rays or their samples.
    #[doc(hidden)]
    pub fn step_on(&self, batch: &SurfaceBatch<'_>) -> Result<(TrainingReport, Vec<f32>), DeviceError> {
        let (gpu, n_rays, k) = (&self.gpu, batch.n_rays(), batch.k());
        let spans: Vec<[u32; 4]> = (0..n_rays)
            .map(|r| [batch.offsets[r] as u32, (batch.offsets[r + 1] - batch.offsets[r]) as u32, r as u32, 0])
            .collect();
        let points: Vec<[f32; 4]> = batch.points.iter().map(|p| [p[0], p[1], p[2], 0.0]).collect();
        let by_row = |values: &[f32], capacity: usize| {
            let mut out = vec![0.0; k * capacity];
            for (i, v) in values.iter().enumerate() {
                out[i % k * capacity + i / k] = *v;
            }
            out
        };
        gpu.submit(&[&self.calls.draw[..1]])?;
        let mut numbers = [0; 3];
        numbers[control::N_AT] = batch.points.len() as u32;
        let anneal = batch.intervals.map_or(1.0, |intervals| intervals.anneal);
        numbers[control::STEP_AT] = 1 + (anneal * self.anneal_steps as f32).round() as u32;
        numbers[control::RAYS_AT] = n_rays as u32;
        gpu.write(&self.buffers.control, &numbers);
        gpu.write(&self.buffers.rays, &spans);
        gpu.write(&self.net.points, &points);
        gpu.write(&self.buffers.colors, &by_row(batch.colors, self.net.capacity));
        gpu.write(&self.ambient.out, &by_row(batch.ambient, self.ambient.capacity));
        gpu.submit(&[&self.calls.step, &self.calls.record])?;
        let d_out = gpu.read(self.ambient.d_out(), k * self.ambient.capacity)?;
        let d_sums = (0..k * n_rays).map(|i| d_out[i % k * self.ambient.capacity + i / k]).collect();
        Ok((self.report()?, d_sums))
    }
}
