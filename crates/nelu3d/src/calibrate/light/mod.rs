//! Where the light comes from, found from the sweep alone.
//!
//! Two board positions that the same ray of light meets show the same codeword. So the center of the light is the point
//! for which every sample of one position, carried along its ray of light to another position, finds its own codeword
//! there. It is searched for coarse to fine (`search.rs`), then found by robust Gauss-Newton (`refine.rs`) with lever
//! arms (distances between the two positions) that grow as the center gets better, and at last from all positions
//! together, against the field that they share (`on_field.rs`). No model of the projector is involved but that its
//! light is straight.

#[doc(hidden)]
pub mod center;
#[doc(hidden)]
pub mod disagreement;
mod on_field;
mod refine;
#[doc(hidden)]
pub mod search;
#[doc(hidden)]
pub mod transport;

use nalgebra::{Const, Point3, SymmetricEigen, Vector3};
use nelu3d_scan::Camera;
use rayon::prelude::*;

use super::excluded::ExcludedBlocks;
use super::views::Views;
use crate::progress::Progress;
pub(super) use center::LightCenter;
use center::{Chart, HOME};
use disagreement::disagreeing_blocks;
use on_field::refine_on_field;
use refine::{Held, Refined, Steps, refine};
use search::{search_levels, starts};
use transport::{PULL, Seed, Transport, disagreement, seeds};

/// Numbers of a sweep that the last refinement looks at: samples times channels.
const MEASUREMENTS: usize = 720_000;
/// Samples that the refinements with shorter arms, before it, look at: every so many-th, but no fewer than these if
/// there are as many.
const FEWER: (usize, usize) = (4, 5000);
/// Factor by which residuals may rise where the center is moved along the line that codes of one axis leave open.
const MAX_WORSE: f64 = 1.02;
/// Disagreement with the other positions beyond which a position has no consensus with them.
const NO_CONSENSUS: f64 = 0.6;

/// What the search found.
pub struct FoundLight {
    /// The center of the light.
    pub center: LightCenter,
    /// Positions of the sweep whose codewords do not fit the others': their poses are wrong, or something stood in the
    /// light.
    pub without_consensus: Vec<usize>,
    /// Positions of the sweep, and the parts of their images whose codewords do not fit the others'.
    pub excluded: Vec<(usize, ExcludedBlocks)>,
}

/// Finds the center of the light, or `None` when there are too few samples (or somebody stopped the work).
pub fn find_center(mut views: Views, camera: &Camera, progress: &Progress) -> Option<FoundLight> {
    let all = seeds(camera, &views, &views.levels[0], 2000);
    if all.len() < 200 || views.count() < 2 {
        return None;
    }
    let mean = all.iter().map(|s| s.point.coords).sum::<Vector3<f64>>() / all.len() as f64;
    let chart = Chart::new(Point3::from(mean));
    let mut found = search(&Transport { camera, views: &views, chart: &chart }, progress)?;
    let outliers = without_consensus(&Transport { camera, views: &views, chart: &chart }, &found);
    let mut without_consensus = Vec::new();
    if outliers.iter().any(|o| *o) {
        without_consensus = (0..views.count()).filter(|i| outliers[*i]).map(|i| views.positions[i]).collect();
        let keep: Vec<bool> = outliers.iter().map(|o| !o).collect();
        views.retain(&keep);
        found = search(&Transport { camera, views: &views, chart: &chart }, progress)?;
    }
    let line = undetermined(&chart, &found);
    let center = LightCenter { line, ..chart.center(found.state) };
    tracing::debug!(position = ?center.position(), scale = found.scale, ?line, "light");
    let t = Transport { camera, views: &views, chart: &chart };
    let blocks = disagreeing_blocks(&t, &center);
    let center = refine_on_field(&t, center, &blocks, progress);
    let excluded = views.positions.iter().copied().zip(blocks).filter_map(|(p, b)| b.map(|b| (p, b))).collect();
    Some(FoundLight { center, without_consensus, excluded })
}

/// Searches the center and refines the best of what was found, with lever arms that grow.
fn search(t: &Transport<'_>, progress: &Progress) -> Option<Refined> {
    let levels = search_levels(t);
    let finest = levels.first()?;
    let (n, k) = (t.views.count(), t.views.k);
    let last = (n / 3).max(3.min(n - 1));
    let mut candidates = starts(t, &levels);
    candidates.push(HOME);
    let scored = candidates.into_par_iter().map(|start| {
        let arms = [1, 2, 4].into_iter().filter(|arm| *arm <= last);
        let s = arms.fold(start, |s, arm| refine(t, finest.level, &finest.seeds, s, finest.steps(k, arm)).state);
        (t.score(finest.level, &finest.seeds, s, 2.min(last), finest.by_chance, None), s)
    });
    let scored: Vec<_> = scored.collect();
    let (score, state) = scored.into_iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
    tracing::debug!(score, ?state, "best start of the light");
    let all = seeds(t.camera, t.views, finest.level, MEASUREMENTS / t.views.k.max(6));
    // What short arms find is where longer ones begin.
    let few: Vec<Seed> = all.iter().step_by((all.len() / FEWER.1).clamp(1, FEWER.0)).copied().collect();
    let how = Steps { arm: last, count: 12, min_scale: 0.1 * finest.spread(k), pull: PULL, far: false, held: None };
    let (mut best, mut arm) = (Refined::at(state), 2);
    loop {
        if progress.cancelled() {
            return None;
        }
        // The longest arms decide; along what the patterns hardly tell, that takes more steps.
        let (seeds, count) = if arm >= last { (&all, 12) } else { (&few, 6) };
        best = refine(t, finest.level, seeds, best.state, Steps { arm: arm.min(last), count, ..how });
        if arm >= last {
            break;
        }
        arm *= 2;
    }
    if let Some(nearer) =
        nearest_to_camera(t, &best, |held| refine(t, finest.level, &all, held.at, Steps { held: Some(held), ..how }))
    {
        best = nearer;
    }
    best.scale.is_finite().then_some(best)
}

/// Moves a center that codes along one axis leave open along its line, as near to the camera as the codewords do not
/// mind: anywhere on the line is as good, but what they leave open across it grows with the distance. `refine` refines
/// a state that is held along a direction. `None` where the codes tell the center, where it is near enough, or where
/// they do mind.
fn nearest_to_camera(t: &Transport<'_>, found: &Refined, refine: impl Fn(Held) -> Refined) -> Option<Refined> {
    /// How strongly.
    const STRENGTH: f64 = 3e-2;
    /// Part of the distance to the boards that is near enough.
    const NEAR: f64 = 0.1;
    let line = undetermined(t.chart, found)?;
    let from = t.chart.center(found.state).position()?;
    if line.dot(&from.coords).abs() < NEAR * t.chart.scale {
        return None;
    }
    // From the nearest point of the line outward.
    [1.0, 0.75, 0.5, 0.25].into_iter().find_map(|part| {
        let at = from - line * (part * line.dot(&from.coords));
        let (here, next) = (t.chart.state(&at)?, t.chart.state(&(at + line))?);
        let along = (Vector3::from(next) - Vector3::from(here)).normalize();
        let moved = refine(Held { at: here, along, strength: STRENGTH });
        tracing::debug!(part, state = ?moved.state, was = found.scale, scale = moved.scale, "nearer to the camera");
        (moved.scale <= MAX_WORSE * found.scale).then_some(moved)
    })
}

/// What the codes tell of the two tangents of the light's direction, whatever its distance.
fn of_tangents(found: &Refined) -> SymmetricEigen<f64, Const<2>> {
    let a = &found.information;
    let with_distance = a.fixed_view::<2, 1>(0, 2) * a.fixed_view::<1, 2>(2, 0) / a[(2, 2)].max(1e-12);
    (a.fixed_view::<2, 2>(0, 0) - with_distance).symmetric_eigen()
}

/// The direction of the state that codes along one axis leave open: the tangent that they hardly tell, and the inverse
/// distance that goes with it at equal codewords.
fn open_direction(found: &Refined) -> Vector3<f64> {
    let eigen = of_tangents(found);
    let v = eigen.eigenvectors.column(eigen.eigenvalues.imin());
    let a = &found.information;
    let kappa = -(a[(2, 0)] * v[0] + a[(2, 1)] * v[1]) / a[(2, 2)].max(1e-12);
    Vector3::new(v[0], v[1], kappa).normalize()
}

/// Ratio of the information on the light's two tangents below which the codes leave one of them open: its standard
/// deviation is more than three times the other's.
const MAX_OPEN_RATIO: f64 = 0.1;

/// Whether the codes vary along one axis only: of the light's direction, they hardly tell one tangent.
fn is_one_axis(found: &Refined) -> bool {
    let values = of_tangents(found).eigenvalues;
    tracing::debug!(?values, "information on the light's direction");
    values.min() < MAX_OPEN_RATIO * values.max()
}

/// Which views' codewords, carried to the other views, do not fit there, while those of most views do.
fn without_consensus(t: &Transport<'_>, found: &Refined) -> Vec<bool> {
    let (n, light) = (t.views.count(), t.chart.center(found.state));
    let levels = search_levels(t);
    let Some(finest) = levels.first() else { return vec![false; n] };
    let sums: Vec<Vec<(f64, usize)>> = (0..n)
        .into_par_iter()
        .map(|to| {
            let mut sums = vec![(0.0, 0); n];
            let mut r = vec![0.0; t.views.k];
            for seed in finest.seeds.iter().filter(|s| s.view != to) {
                if t.carry(finest.level, seed, &light, to, &mut r) {
                    let of = &mut sums[seed.view];
                    *of = (of.0 + disagreement(&r, finest.by_chance), of.1 + 1);
                }
            }
            sums
        })
        .collect();
    // Both ways; the half of the others that a view agrees with best.
    let pair = |i: usize, j: usize| {
        let (a, b) = (sums[i][j], sums[j][i]);
        (a.1 + b.1 >= 10).then(|| (a.0 + b.0) / (a.1 + b.1) as f64)
    };
    let scores: Vec<Option<f64>> = (0..n)
        .map(|i| {
            let mut of: Vec<f64> = (0..n).filter(|j| *j != i).filter_map(|j| pair(i, j)).collect();
            of.sort_by(f64::total_cmp);
            of.get(of.len().saturating_sub(1) / 2).copied()
        })
        .collect();
    let mut known: Vec<f64> = scores.iter().flatten().copied().collect();
    known.sort_by(f64::total_cmp);
    tracing::debug!(?scores, "agreement of positions");
    let consensus = known.get(known.len() * 2 / 3).is_some_and(|s| *s < 0.6 * NO_CONSENSUS);
    let outlier = |s: &Option<f64>| consensus && s.is_some_and(|s| s > NO_CONSENSUS);
    let outliers: Vec<bool> = scores.iter().map(outlier).collect();
    let left = outliers.iter().filter(|o| !**o).count();
    if left >= 3 { outliers } else { vec![false; n] }
}

/// The direction of the line on which the center lies, if the codes vary along one axis only and hardly tell where on
/// it.
fn undetermined(chart: &Chart, found: &Refined) -> Option<Vector3<f64>> {
    if !is_one_axis(found) {
        return None;
    }
    let open = open_direction(found);
    let moved = |by: f64| {
        let state = Vector3::from(found.state) + by * open;
        chart.center(state.into()).position()
    };
    let (a, b) = (moved(-1e-3)?, moved(1e-3)?);
    Some((b - a).normalize())
}
