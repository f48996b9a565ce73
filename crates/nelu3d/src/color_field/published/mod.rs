//! Form `published`: the paper's own color field (Sec. 3.1), a multiresolution hash encoding and a small network in the
//! camera's frame, equally fine along every axis.
//!
//! 16 levels of 2 features in 2^19 entries, 16 to 2,048 cells along each side of the cube around the volume, the point
//! as 2x − 1 after the features, 2 × 64 ReLU with weight normalization, 5,000 iterations: 49 MB, as the paper says.
//! What the paper does not state is that of the signed distance field of the same kind in TurboSL's public code, from
//! which it derives; the learning rate and the number of samples are measured here.
//!
//! Its finest cells are far smaller than the distance between board positions, and nothing supervises them in between:
//! the form needs a dense sweep. So besides whole positions it also holds out random samples
//! ([`PixelQuality`]), which is what it is trained for.
//!
//! Recipe `paper` queries it directly (`PublishedForm::query`); for everything else it becomes a spline, as the other
//! networks do.

mod cube;
mod options;

use nalgebra::{Point3, Vector3};
use nelu3d_field::{HashField, HashFieldConfig};
use serde::{Deserialize, Serialize};

use super::bins::Bins;
use super::frame::FieldFrame;
use super::grid::Grid;
use super::metadata::PixelQuality;
use super::network::{NetworkForm, NetworkShape, SampleBatch, TrainingSamples};
use crate::progress::Progress;
pub use cube::FieldCube;
pub use options::PublishedOptions;

/// One sample in this many is held out, where samples are.
const HELD_OUT: usize = 50;

/// Settings of a [`PublishedForm`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PublishedSettings {
    /// Cells along a, b and w of the spline that it becomes for the stages that need one.
    pub cells: [usize; 3],
    /// The field's frame, in whose unit coordinates samples and that spline lie.
    pub frame: FieldFrame,
    /// The cube of the encoding.
    pub cube: FieldCube,
    /// Encoding, network and training.
    pub options: PublishedOptions,
}

impl PublishedSettings {
    /// Returns the settings of a field over the box of a frame.
    pub fn new(cells: [usize; 3], frame: FieldFrame, options: PublishedOptions) -> Self {
        Self { cells, frame, cube: FieldCube::around(&frame), options }
    }

    /// Returns the point of the cube with given unit coordinates of the frame.
    fn in_cube(&self, q: [f32; 3]) -> [f32; 3] {
        self.cube.to_unit(&self.frame.from_unit(q.map(f64::from)))
    }
}

/// The description of a [`PublishedForm`] in a checkpoint.
pub type PublishedShape = NetworkShape<PublishedSettings, HashFieldConfig<3>>;

/// A color field as published.
pub type PublishedForm = NetworkForm<PublishedSettings, HashField<3>>;

impl PublishedForm {
    /// Initializes a form.
    ///
    /// # Panics
    ///
    /// If [`PublishedOptions::check`] refuses the options.
    pub fn new(settings: PublishedSettings, k: usize, seed: u64) -> Self {
        let config = settings.options.config(k);
        Self::untrained(settings, config, k, seed)
    }

    /// Trains on the samples that the bins stand for, each weighed by its precision relative to the others.
    pub fn train(&mut self, bins: &Bins, seed: u64, progress: &Progress) {
        if let Some(samples) = self.samples(bins, seed) {
            self.train_on(samples, progress);
        }
    }

    /// Trains on the samples that the bins stand for but for a random fiftieth of them, and compares the field with
    /// these; `None` if there are too few.
    pub fn train_and_compare(&mut self, bins: &Bins, seed: u64, progress: &Progress) -> Option<PixelQuality> {
        let mut samples = self.samples(bins, seed)?;
        let held_out = samples.hold_out(HELD_OUT, seed);
        self.train_on(samples, progress);
        self.compare(&held_out)
    }

    /// Returns the samples that the bins stand for, in the cube.
    fn samples(&self, bins: &Bins, seed: u64) -> Option<TrainingSamples> {
        let settings = &self.shape().settings;
        TrainingSamples::new(bins, 1, seed).map(|samples| samples.at(|q| settings.in_cube(q)))
    }

    fn train_on(&mut self, mut samples: TrainingSamples, progress: &Progress) {
        if samples.len() == 0 {
            return;
        }
        let PublishedOptions { iterations, batch, .. } = self.shape().settings.options;
        let config = self.shape().config.clone();
        self.begin_training(config);
        let batch = batch.min(samples.len());
        self.train_on_cpu(&mut samples, batch, iterations, progress);
        self.finish_training();
    }

    /// Compares the field with samples that it was not trained on; those below the median precision are mostly noise
    /// and do not count.
    fn compare(&self, held_out: &SampleBatch) -> Option<PixelQuality> {
        let k = self.k();
        let mut values = vec![0.0; held_out.targets.len()];
        self.network().query(&held_out.points, &mut values);
        let (mut sum, mut n) = (0.0, 0);
        for (i, weight) in held_out.weights.iter().enumerate() {
            if *weight >= 1.0 {
                let pairs = values[i * k..][..k].iter().zip(&held_out.targets[i * k..][..k]);
                sum += pairs.map(|(c, l)| f64::from((c - l) * (c - l))).sum::<f64>();
                n += k;
            }
        }
        (n > 0).then(|| PixelQuality { n, psnr_db: -10.0 * (sum / n as f64).log10() })
    }

    /// Evaluates c at points of the camera's frame, mm, into `values` (`points × k`).
    pub fn query(&self, points: &[Point3<f64>], values: &mut [f32]) {
        let cube = &self.shape().settings.cube;
        let points: Vec<[f32; 3]> = points.iter().map(|x| cube.to_unit(x)).collect();
        self.network().query(&points, values);
    }

    /// Evaluates c and its derivative along a direction per point, 1/mm, into `values` and `slopes` (`points × k`).
    pub fn query_along(&self, points: &[Point3<f64>], dirs: &[Vector3<f64>], values: &mut [f32], slopes: &mut [f32]) {
        let cube = &self.shape().settings.cube;
        let points: Vec<[f32; 3]> = points.iter().map(|x| cube.to_unit(x)).collect();
        let mut jacobian = vec![[0.0; 3]; values.len()];
        self.network().query_with_jacobian(&points, values, &mut jacobian);
        let k = self.k();
        let scale = 1.0 / cube.side_mm;
        for (i, (slope, by_axis)) in slopes.iter_mut().zip(&jacobian).enumerate() {
            *slope = (0..3).map(|a| by_axis[a] * (dirs[i / k][a] * scale) as f32).sum();
        }
    }

    /// Returns the spline through the form's values at the corners of the volume's cells.
    pub fn to_grid(&self) -> Grid {
        let settings = &self.shape().settings;
        self.spline_at(settings.cells, |q| settings.in_cube(q))
    }
}
