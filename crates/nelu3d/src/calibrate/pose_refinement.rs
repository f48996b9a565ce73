//! Poses of a few boards, and their shape, refined on codewords.
//!
//! A board's corners tell its distance and tilt far less exactly than codewords do: at 3.4 m, with corners to 0.1 px,
//! its edge is off by a millimeter or two, while its samples agree with the field of the other boards to a tenth of
//! that once it is moved. So each board, held out in turn, is moved along the camera's rays, by a plane, to where the
//! others' field says it is; what all boards share stays as the corners have it. Nothing is taken that does not bring
//! held-out boards nearer to the field in depth. Decibels do not tell: where a code's edges are finer than the field's
//! cells, they are most of the error.
//!
//! Then so is the shape that all of them have in common ([`super::relief_fit`]).

use nalgebra::Isometry3;
use serde::Serialize;

use super::candidate::Candidate;
use super::error::CalibrationError;
use super::placed_sweep::{BoardPlane, PlacedSweep};
use super::relief::Relief;
use super::relief_fit::{self, FittedRelief, fit_relief};
use crate::color_field::fit::Smoothness;

/// Part of the mean square of what held-out boards are off by that motions must amount to for them to be tried, and
/// that they must take from it to be kept.
const MIN_GAIN: f64 = 0.15;
/// Held-out PSNR that must be gained, dB: it may not be lost where the light's center is determined. Where it is open
/// along a line, boards that move along with it agree as well, and decibels have to tell, too: of a real sweep,
/// held-out boards came 30 % nearer to each other in depth at 0.5 dB, and a scan got half as much error again.
const MIN_GAIN_DB: [f64; 2] = [-0.05, 1.0];
/// Largest number of times that poses are refined.
const MAX_ROUNDS: usize = 3;

/// How far boards were moved to where the field of the others says that they are.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PoseRefinement {
    /// Largest motion of a board's middle or corner off its plane, mm.
    pub largest_mm: f64,
    /// Root mean square motion of the boards' middles and corners off their planes, mm.
    pub rms_mm: f64,
    /// Root mean square of what held-out boards were off by in depth with the poses that the corners tell, mm.
    pub off_before_mm: f64,
    /// Root mean square of what held-out boards are off by in depth with the refined poses, mm.
    pub off_mm: f64,
    /// Held-out PSNR with the poses that the corners tell, dB.
    pub psnr_before_db: f64,
    /// How far the boards' surface is from flat or from its bend, where the codewords tell.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub relief: Option<ReliefReport>,
}

/// How far the surface of a sweep's board is from flat or from its bend.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ReliefReport {
    /// Largest height, mm; planes not counted.
    pub largest_mm: f64,
    /// Root mean square height, mm; planes not counted.
    pub rms_mm: f64,
}

/// Poses that were refined.
pub(super) struct RefinedPoses {
    /// What was gained.
    pub(super) report: PoseRefinement,
    /// Motions of the boards, by position.
    pub(super) motions: Vec<Isometry3<f64>>,
}

/// Moves the boards of `placed` to where they predict each other best, as long as `best`, the field in the light's
/// frame that was fitted to all but each of them, is replaced by a better one. `is_open` says whether the light's
/// center is open along a line; `fit` fits a field that is as smooth as given to boards where they stand: motions of
/// millimeters do not change what a code asks for. `None` where nothing was taken.
///
/// # Errors
///
/// Those of `fit`.
pub(super) fn refine_poses<'r>(
    placed: &mut PlacedSweep<'r>,
    best: &mut Candidate,
    is_open: bool,
    fit: impl Fn(&PlacedSweep<'r>, &Smoothness) -> Result<Candidate, CalibrationError>,
) -> Result<Option<RefinedPoses>, CalibrationError> {
    let n = placed.n_positions();
    let Some(off_before_mm2) = best.off_mm2.filter(|_| best.displacements.len() >= n) else { return Ok(None) };
    let (before, at_corners) = (best.quality.clone(), placed.boards.clone());
    let mut total = vec![Isometry3::identity(); n];
    let mut off_mm2 = off_before_mm2;
    // Fits a field to boards that were moved, and keeps both if it is better.
    let mut attempt = |placed: &mut PlacedSweep<'r>,
                       best: &mut Candidate,
                       step: &Step,
                       is_better: &dyn Fn(&PlacedSweep<'r>, &Candidate) -> bool|
     -> Result<bool, CalibrationError> {
        let stood = placed.boards.clone();
        placed.boards.iter_mut().zip(&step.motions).for_each(|(board, motion)| board.move_by(motion));
        placed.boards.iter_mut().zip(&step.reliefs).for_each(|(board, relief)| board.add_relief(relief));
        best.drop_bins();
        let candidate = fit(placed, &best.smooth)?;
        let gain_db = candidate.quality.psnr_db - best.quality.psnr_db;
        let now = candidate.off_mm2.unwrap_or(f64::INFINITY);
        tracing::debug!(off_mm = now.sqrt(), gain_db, "poses on codewords were tried");
        // What is no plane does not move along with the light.
        let is_as_good = gain_db >= MIN_GAIN_DB[usize::from(is_open && step.reliefs.is_empty())];
        if !is_as_good || !is_better(placed, &candidate) {
            placed.boards = stood;
            return Ok(false);
        }
        total.iter_mut().zip(&step.motions).for_each(|(total, motion)| *total = motion * *total);
        off_mm2 = now;
        *best = candidate;
        // What the corners' errors have in common stays, and is as large as they showed before.
        best.quality.pose_mm = before.pose_mm;
        best.quality.pose_covariance = before.pose_covariance;
        best.quality.depth_by_support = before.depth_by_support;
        Ok(true)
    };
    for round in 0..MAX_ROUNDS {
        let motions = motions(placed, best);
        let [_, rms_mm] = PoseRefinement::largest_and_rms_mm(&placed.boards, &motions);
        let off_mm2 = best.off_mm2.unwrap_or(off_before_mm2);
        tracing::debug!(round, off_mm = off_mm2.sqrt(), motions_mm = rms_mm, "poses on codewords");
        let is_nearer =
            |_: &PlacedSweep<'r>, now: &Candidate| now.off_mm2.is_some_and(|now| now <= (1.0 - MIN_GAIN) * off_mm2);
        let step = Step { motions, reliefs: Vec::new() };
        if rms_mm * rms_mm < MIN_GAIN * off_mm2 || !attempt(placed, best, &step, &is_nearer)? {
            break;
        }
    }
    let mut turned = (!placed.is_board_symmetric).then(|| vec![false; n]);
    for _ in 0..MAX_ROUNDS {
        let fitted = fit_relief(&placed.boards, turned.as_deref(), &best.squares);
        let Some(FittedRelief { reliefs, misfit, explained, floor_mm, turned: found }) = fitted else { break };
        turned = Some(found);
        // Part of what the others' reliefs explain that a field of boards with reliefs has to keep.
        const KEPT: f64 = 0.5;
        let is_better = |placed: &PlacedSweep<'r>, now: &Candidate| {
            let left = relief_fit::misfit(&placed.boards, &now.squares, floor_mm);
            tracing::debug!(left, misfit, "relief of the board was tried");
            left.is_some_and(|left| left < misfit - KEPT * explained)
        };
        // The poses stay as they are: what a curl had in them goes with it, and moving boards again makes scans worse.
        let step = Step { motions: vec![Isometry3::identity(); n], reliefs };
        if !attempt(placed, best, &step, &is_better)? {
            break;
        }
    }
    let [largest_mm, rms_mm] = PoseRefinement::largest_and_rms_mm(&at_corners, &total);
    let (off_before_mm, off_mm) = (off_before_mm2.sqrt(), off_mm2.sqrt());
    let relief = placed.boards[0].relief().map(|relief| {
        let [largest_mm, rms_mm] = relief.largest_and_rms_mm();
        ReliefReport { largest_mm, rms_mm }
    });
    let psnr_before_db = before.psnr_db;
    let report = PoseRefinement { largest_mm, rms_mm, off_before_mm, off_mm, psnr_before_db, relief };
    Ok((off_mm < off_before_mm || relief.is_some()).then_some(RefinedPoses { report, motions: total }))
}

/// What is done to the boards at once.
struct Step {
    /// Motions, position by position.
    motions: Vec<Isometry3<f64>>,
    /// Heights that are added to their surfaces; none, or position by position.
    reliefs: Vec<Relief>,
}

impl PoseRefinement {
    /// Returns the largest and the root mean square motion of the boards' middles and corners off their planes, mm.
    fn largest_and_rms_mm(boards: &[BoardPlane], motions: &[Isometry3<f64>]) -> [f64; 2] {
        let off = |(board, motion): (&BoardPlane, &Isometry3<f64>)| {
            board.middle_and_corners().map(|x| board.normal.dot(&(motion * x - x)))
        };
        let mm: Vec<f64> = boards.iter().zip(motions).flat_map(off).collect();
        let mean_square = mm.iter().map(|v| v * v).sum::<f64>() / mm.len().max(1) as f64;
        [mm.iter().fold(0.0, |max: f64, v| max.max(v.abs())), mean_square.sqrt()]
    }
}

/// The motions of the boards that their displacements from the fields of the others ask for. With n boards of which the
/// errors e add up to nothing, board b is displaced by e_b − mean of the others' e = e_b n/(n − 1).
fn motions(placed: &PlacedSweep<'_>, best: &Candidate) -> Vec<Isometry3<f64>> {
    let n = placed.n_positions();
    let part = (n - 1) as f64 / n as f64;
    let mut motions = vec![Isometry3::identity(); n];
    for d in &best.displacements {
        let mm = |[u, v]: [f64; 2]| -part * (d.plane[0] + d.plane[1] * u + d.plane[2] * v);
        motions[d.position] = placed.boards[d.position].motion_along_rays(mm);
    }
    motions
}
