//! Form `hash`: a multiresolution hash encoding and a small network over the unit cube of a
//! [`FieldFrame`](super::frame::FieldFrame).
//!
//! The published form uses isotropic levels up to 2048 cells in camera coordinates; levels finer than the sweep's step
//! are never supervised between board positions and put wiggles there. Here the levels are anisotropic and live in the
//! field's frame: fine across, and along w no finer than what the sweep supervises.

use nelu3d_field::device::Device;
use nelu3d_field::encoding::hash_grid::HashGridConfig;
use nelu3d_field::{HashField, HashFieldConfig};
use serde::{Deserialize, Serialize};

use super::bins::Bins;
use super::grid::Grid;
#[cfg(feature = "gpu")]
use super::network::SampleBatch;
use super::network::{NetworkForm, NetworkShape, TrainingSamples};
use crate::progress::Progress;

/// Number of neighboring samples that are drawn together, because they share cache lines of the table. More than two
/// are too alike for a batch to count as its size (groups of 8 cost 1 dB at the same number of samples on `dlp`).
const GROUP: usize = 2;
/// Length of a second training relative to the first: the parameters have to take up only what is new.
const AGAIN: f64 = 0.4;
/// Learning rates of a second training relative to the first.
const AGAIN_RATE: f64 = 0.3;
/// Fewest steps of a training: small volumes have few samples, and the network needs some time whatever they are.
const MIN_STEPS: usize = 1000;

/// Settings of a [`HashForm`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HashSettings {
    /// Cells of the volume along a, b and w.
    pub cells: [usize; 3],
    /// Cells of the volume per cell of the finest level, across: levels as fine as the samples learn their noise.
    pub coarsening: usize,
    /// Number of levels.
    pub n_levels: usize,
    /// log2 of the table's entries per level.
    pub log2_hashmap_size: u32,
    /// Number of units of a hidden layer.
    pub width: usize,
    /// Number of times that a training goes through the samples; it takes a thousand steps at least.
    pub epochs: f64,
    /// Number of points per step.
    pub batch: usize,
}

impl HashSettings {
    /// Returns the settings of a volume of that many cells.
    pub fn for_cells(cells: [usize; 3]) -> Self {
        Self { cells, coarsening: 2, n_levels: 8, log2_hashmap_size: 18, width: 32, epochs: 4.0, batch: 1 << 11 }
    }

    /// Returns the cells of the finest level along a, b and w.
    pub(super) fn finest(&self) -> [u32; 3] {
        let across = |cells: usize| cells.div_ceil(self.coarsening.max(1)) as u32;
        [across(self.cells[0]), across(self.cells[1]), self.cells[2] as u32]
    }

    fn config(&self, k: usize) -> HashFieldConfig<3> {
        let finest = self.finest();
        let mut config = HashFieldConfig::small(k);
        config.encoding = HashGridConfig {
            n_levels: self.n_levels,
            n_features_per_level: 2,
            log2_hashmap_size: self.log2_hashmap_size,
            base_resolution: [finest[0].min(16), finest[1].min(16), finest[2].min(2)],
            finest_resolution: finest,
        };
        config.width = self.width;
        config.training.encoding_learning_rate = 5e-3;
        config.training.schedule.final_factor = 0.01;
        config
    }
}

/// The description of a [`HashForm`] in a checkpoint.
pub type HashShape = NetworkShape<HashSettings, HashFieldConfig<3>>;

/// A color field as hash encoding and network.
pub type HashForm = NetworkForm<HashSettings, HashField<3>>;

impl HashForm {
    /// Initializes a form.
    pub fn new(settings: HashSettings, k: usize, seed: u64) -> Self {
        let config = settings.config(k);
        Self::untrained(settings, config, k, seed)
    }

    /// Trains on the samples that the bins stand for, in random order, each weighed by its precision relative to the
    /// others. A form that was trained before goes on from its parameters, with a shorter schedule and lower rates.
    ///
    /// If the device fails, training begins again on the CPU.
    pub fn train(&mut self, bins: &Bins, seed: u64, device: &Device, progress: &Progress) {
        let Some(mut samples) = TrainingSamples::new(bins, GROUP, seed) else { return };
        let s = &self.shape().settings;
        let n = samples.len();
        let batch = s.batch.clamp(GROUP, n.max(GROUP));
        let (length, rate) = if self.is_trained() { (AGAIN, AGAIN_RATE) } else { (1.0, 1.0) };
        let steps = (s.epochs * n as f64 / batch as f64).max(MIN_STEPS as f64) * length;
        let steps = steps.ceil() as usize;
        let mut config = self.shape().config.clone();
        config.training.schedule.n_steps = steps as u64;
        config.training.encoding_learning_rate *= rate;
        config.training.network_learning_rate *= rate;
        self.begin_training(config);
        match device {
            #[cfg(feature = "gpu")]
            Device::Gpu(gpu) => {
                // Every sample once in random order, and that order again and again.
                let mut all = SampleBatch::default();
                samples.draw(n, &mut all);
                let SampleBatch { points, targets, weights } = &all;
                let all = nelu3d_field::gpu::Samples { points, targets, weights };
                let go_on = |step: usize| {
                    progress.tick(step, steps);
                    !progress.cancelled()
                };
                if let Err(e) = self.network_mut().train_on(gpu, &all, batch, steps, go_on) {
                    progress.warn(format!("{e}; the field is trained on the CPU instead"));
                    return self.train(bins, seed, &Device::Cpu, progress);
                }
            }
            Device::Cpu => self.train_on_cpu(&mut samples, batch, steps, progress),
        }
        self.finish_training();
    }

    /// Returns the spline through the form's values at the corners of the volume's cells.
    pub fn to_grid(&self) -> Grid {
        self.spline(self.shape().settings.cells)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Fringes across, a slow change of their contrast along w.
    fn expected(q: [f32; 3]) -> [f32; 2] {
        let contrast = 0.25 + 0.1 * q[2];
        [0.5 + contrast * (30.0 * q[0] + 4.0 * q[1]).sin(), 0.5 + contrast * (25.0 * q[1]).cos()]
    }

    const CELLS: [usize; 3] = [48, 40, 4];

    /// Bins of samples on a lattice of planes of constant w, without those in `hole`.
    fn bins(hole: std::ops::Range<f32>) -> Bins {
        let mut bins = Bins::new([CELLS[0], CELLS[1], 12], 2);
        for w in (0..24).map(|i| (i as f32 + 0.5) / 24.0).filter(|w| !hole.contains(w)) {
            for b in 0..80 {
                for a in 0..96 {
                    let q = [(a as f32 + 0.5) / 96.0, (b as f32 + 0.5) / 80.0, w];
                    bins.add(q, &expected(q), &[1.0; 2]);
                }
            }
        }
        bins
    }

    fn rmse(form: &HashForm, w: std::ops::Range<f32>) -> f32 {
        let grid = form.to_grid();
        let (mut sum, mut n, mut v) = (0.0, 0, [0.0; 2]);
        for i in 0..4000 {
            let unit = |step: f32| (i as f32 * step).fract();
            let q = [
                0.03 + 0.94 * unit(0.618_034),
                0.03 + 0.94 * unit(0.754_878),
                w.start + (w.end - w.start) * unit(0.569_84),
            ];
            grid.eval(q, &mut v);
            for (v, t) in v.iter().zip(expected(q)) {
                sum += (v - t) * (v - t);
                n += 1;
            }
        }
        (sum / n as f32).sqrt()
    }

    #[test]
    fn it_interpolates_a_held_out_slab() {
        let mut form = HashForm::new(HashSettings::for_cells(CELLS), 2, 3);
        form.train(&bins(0.4..0.6), 3, &Device::Cpu, &Progress::none());
        let error = rmse(&form, 0.4..0.6);
        // 40 dB, where the signal's own deviation from its mean is about 0.2.
        assert!(error < 0.01, "{error}");
    }

    /// Training on a GPU, if there is one, interpolates as well as on the CPU.
    #[cfg(feature = "gpu")]
    #[test]
    fn it_interpolates_on_a_gpu_too() {
        use nelu3d_field::device::Choice;
        let Ok(gpu) = Device::open(Choice::Gpu) else {
            assert!(std::env::var_os("NELU3D_REQUIRE_GPU").is_none(), "no GPU, and NELU3D_REQUIRE_GPU is set");
            eprintln!("SKIPPED: the hash form on a GPU: no GPU and no software driver");
            return;
        };
        let settings = HashSettings { width: 16, n_levels: 4, batch: 512, ..HashSettings::for_cells([24, 20, 2]) };
        let error = |device: &Device| {
            let mut form = HashForm::new(settings.clone(), 2, 3);
            form.train(&bins(0.4..0.6), 3, device, &Progress::none());
            rmse(&form, 0.0..1.0)
        };
        let (gpu, cpu) = (error(&gpu), error(&Device::Cpu));
        assert!(gpu < 1.15 * cpu && cpu < 1.15 * gpu, "GPU {gpu}, CPU {cpu}");
    }

    #[test]
    fn a_second_training_takes_up_what_is_new_and_keeps_the_rest() {
        let mut form = HashForm::new(HashSettings::for_cells(CELLS), 2, 3);
        form.train(&bins(0.6..1.0), 3, &Device::Cpu, &Progress::none());
        let (known, unknown) = (rmse(&form, 0.05..0.4), rmse(&form, 0.85..1.0));
        let before = form.params().to_vec();
        form.train(&bins(0.0..0.0), 4, &Device::Cpu, &Progress::none());
        let (still_known, learned) = (rmse(&form, 0.05..0.4), rmse(&form, 0.85..1.0));
        let norm = |x: &mut dyn Iterator<Item = f32>| x.map(|x| x * x).sum::<f32>().sqrt();
        let change =
            norm(&mut before.iter().zip(form.params()).map(|(a, b)| a - b)) / norm(&mut before.iter().copied());
        assert!(known < 0.01 && still_known < 0.01, "{known} {still_known}");
        // Two fifths of the volume at once is far more than the positions held out of a sweep, and at its end.
        assert!(learned < 0.5 * unknown, "{unknown} {learned}");
        // Parameters drawn anew would be about as far away as they are large.
        assert!(change > 0.0 && change < 0.7, "{change}");
    }

    #[test]
    fn the_spline_passes_through_the_network_at_its_nodes() {
        let mut form = HashForm::new(HashSettings { epochs: 1.0, ..HashSettings::for_cells(CELLS) }, 2, 5);
        form.train(&bins(0.0..0.0), 5, &Device::Cpu, &Progress::none());
        let grid = form.to_grid();
        let (mut v, mut expected) = ([0.0; 2], [0.0; 2]);
        for (a, b, w) in (0..=48).flat_map(|a| (0..=40).step_by(5).flat_map(move |b| (0..=4).map(move |w| (a, b, w)))) {
            let q = [a as f32 / 48.0, b as f32 / 40.0, w as f32 / 4.0];
            grid.eval(q, &mut v);
            form.network().query(&[q], &mut expected);
            for (v, e) in v.iter().zip(expected) {
                assert!((v - e).abs() < 1e-5, "{q:?}: {v} {e}");
            }
        }
    }

    #[test]
    fn parameters_restore_the_form_and_nothing_else_does() {
        let form = HashForm::new(HashSettings::for_cells([20, 16, 1]), 3, 1);
        let again = HashForm::from_params(form.shape().clone(), form.params().to_vec()).unwrap();
        assert_eq!(form.to_grid(), again.to_grid());
        assert!(HashForm::from_params(form.shape().clone(), form.params()[1..].to_vec()).is_none());
        let shape = HashShape { k: 2, ..form.shape().clone() };
        assert!(HashForm::from_params(shape, form.params().to_vec()).is_none());
    }

    #[test]
    fn no_samples_leave_it_as_it_is() {
        let mut form = HashForm::new(HashSettings::for_cells(CELLS), 2, 1);
        let before = form.params().to_vec();
        form.train(&Bins::new([4, 4, 4], 2), 1, &Device::Cpu, &Progress::none());
        assert_eq!(before, form.params());
    }
}
