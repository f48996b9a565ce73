//! Codewords that a sweep's boards show, each at a known point.

use nelu3d_scan::Rig;
use nelu3d_scan::pose::Bend;
use nelu3d_scan::rig::PatternSet;

use super::board_poses::{SweepGeometry, places, solve_board_poses};
use super::error::CalibrationError;
use super::options::CalibrationOptions;
use super::placed_sweep::Seen;
use super::shared_displacement::Sample;
use super::views;
use crate::color_field::BoardPlace;
use crate::progress::{Progress, StageClock};
use crate::sensor::{Blur, DarkLevel, NoiseModel};

/// A pixel that sees a board of the sweep.
#[derive(Clone, Debug)]
pub(crate) struct BoardSample {
    /// Which of the positions it is from.
    pub(crate) position: usize,
    /// The square of pixels that it lies in, across and down.
    pub(crate) block: [usize; 2],
    /// The point of the board that it sees, mm, in the camera's frame.
    pub(crate) point: [f64; 3],
    /// Normalized intensity of every pattern channel.
    pub(crate) values: Vec<f32>,
    /// Variance that noise gives them, the mean of the channels.
    pub(crate) variance: f32,
}

/// The samples of all boards of a sweep.
pub(crate) struct BoardSamples {
    /// Well-lit pixels with all their channels, at most some hundred thousand, from positions all over the sweep.
    pub(crate) samples: Vec<BoardSample>,
    /// Number of positions that they are from.
    pub(crate) positions: usize,
    /// Noise of the sensor's pixels.
    pub(crate) noise: NoiseModel,
    /// Light that is there without the light source, channel by channel.
    pub(crate) dark: Vec<DarkLevel>,
    /// Blur of the camera.
    pub(crate) blur: Blur,
    /// Where the boards stood.
    pub(crate) boards: Vec<BoardPlace>,
    /// Bend of the board, where it was taken into account.
    pub(crate) bend: Option<Bend>,
}

/// Finds the boards of a sweep and draws samples from its positions, as [`super::calibrate`] does it.
///
/// # Errors
///
/// Those of [`solve_board_poses`]; an image cannot be read; the caller stopped the work.
pub(crate) fn board_samples(
    rig: &Rig,
    set: &PatternSet,
    progress: &Progress,
    clock: &mut StageClock<'_>,
) -> Result<BoardSamples, CalibrationError> {
    let SweepGeometry { mut placed, dark, trajectory, .. } =
        solve_board_poses(rig, set, &CalibrationOptions::default(), progress, clock)?;
    views::estimate_noise(&mut placed, rig, false, progress)?;
    let (mut samples, mut positions) = (Vec::new(), 0);
    for (p, drawn) in placed.drawn() {
        positions += 1;
        placed.for_each_drawn(p, drawn, |sample, Seen { dir, t }| {
            if sample.contrast.iter().any(|contrast| *contrast < drawn.lit) {
                return;
            }
            let contrast = |j: usize| sample.contrast[j % sample.contrast.len()];
            let of = |(j, v): (usize, &f32)| placed.noise.normalized_variance(v.clamp(0.0, 1.0), contrast(j), 0.0);
            let variance = sample.values.iter().enumerate().map(of).sum::<f32>() / sample.values.len() as f32;
            let (point, values) = ((dir * t).into(), sample.values.to_vec());
            let block = Sample::block_of(sample.pixel, placed.camera.width);
            samples.push(BoardSample { position: p, block, point, values, variance });
        });
    }
    Ok(BoardSamples {
        samples,
        positions,
        noise: placed.sensor_noise(),
        dark,
        blur: placed.sensor_blur,
        boards: places(&trajectory, &placed),
        bend: trajectory.bend().copied(),
    })
}
