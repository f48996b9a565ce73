//! Where the light comes from, found from the sweep alone.
//!
//! Two board positions that the same ray of light meets show the same codeword. So the center of the light is the point
//! for which every sample of one position, carried along its ray of light to another position, finds its own codeword
//! there. It is searched for coarse to fine ([`search`]), then found by robust Gauss-Newton ([`refine`]) with lever arms
//! (distances between the two positions) that grow as the center gets better. No model of the projector is involved but
//! that its light is straight.

mod center;
mod refine;
mod search;
mod transport;

use nalgebra::{Point3, Vector3};
use nelu3d_scan::Camera;
use rayon::prelude::*;

use super::views::Views;
use crate::progress::Progress;
pub(super) use center::LightCenter;
use center::{Chart, HOME};
use refine::{Refined, refine};
use search::{search_levels, starts};
use transport::{Transport, disagreement, seeds};

/// Numbers of a sweep that the last refinement looks at: samples times channels.
const MEASUREMENTS: usize = 720_000;
/// Disagreement with the other positions beyond which a position has no consensus with them.
const NO_CONSENSUS: f64 = 0.75;

/// What the search found.
pub(super) struct FoundLight {
    pub(super) center: LightCenter,
    /// Positions of the sweep whose codewords do not fit the others': their poses are wrong, or something stood in the light.
    pub(super) without_consensus: Vec<usize>,
}

/// Finds the center of the light, or `None` when there are too few samples (or somebody stopped the work).
pub(super) fn find_center(mut views: Views, camera: &Camera, progress: &Progress) -> Option<FoundLight> {
    let all = seeds(camera, &views, &views.levels[0], 2000);
    if all.len() < 200 || views.len() < 2 {
        return None;
    }
    let mean = all.iter().map(|s| s.point.coords).sum::<Vector3<f64>>() / all.len() as f64;
    let chart = Chart::new(Point3::from(mean));
    let mut found = search(&Transport { camera, views: &views, chart: &chart }, progress)?;
    let outliers = without_consensus(&Transport { camera, views: &views, chart: &chart }, &found);
    let mut without_consensus = Vec::new();
    if outliers.iter().any(|o| *o) {
        without_consensus = (0..views.len()).filter(|i| outliers[*i]).map(|i| views.positions[i]).collect();
        let keep: Vec<bool> = outliers.iter().map(|o| !o).collect();
        views.retain(&keep);
        found = search(&Transport { camera, views: &views, chart: &chart }, progress)?;
    }
    let line = undetermined(&chart, &found);
    let center = LightCenter { line, ..chart.center(found.state) };
    tracing::debug!(position = ?center.position(), scale = found.scale, ?line, "light");
    Some(FoundLight { center, without_consensus })
}

/// Searches the center and refines the best of what was found, with lever arms that grow.
fn search(t: &Transport<'_>, progress: &Progress) -> Option<Refined> {
    let levels = search_levels(t);
    let finest = levels.first()?;
    let n = t.views.len();
    let last = (n / 3).max(3.min(n - 1));
    let mut candidates = starts(t, &levels);
    candidates.push(refine(t, finest.level, &finest.seeds, HOME, 1, 6).state);
    let scored = candidates.into_par_iter().map(|start| {
        let arms = [1, 2, 4].into_iter().filter(|arm| *arm <= last);
        let s = arms.fold(start, |s, arm| refine(t, finest.level, &finest.seeds, s, arm, 6).state);
        (t.score(finest.level, &finest.seeds, s, 2.min(last), finest.by_chance, 1.0), s)
    });
    let scored: Vec<_> = scored.collect();
    let (score, state) = scored.into_iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
    tracing::debug!(score, ?state, "best start of the light");
    let all = seeds(t.camera, t.views, finest.level, MEASUREMENTS / t.views.k.max(6));
    let (mut best, mut arm) = (Refined::at(state), 2);
    loop {
        if progress.cancelled() {
            return None;
        }
        // The longest arms decide; along what the patterns hardly tell, that takes more steps.
        best = refine(t, finest.level, &all, best.state, arm.min(last), if arm >= last { 20 } else { 6 });
        if arm >= last {
            break;
        }
        arm *= 2;
    }
    best.scale.is_finite().then_some(best)
}

/// Which views' codewords, carried to the other views, do not fit there, while those of most views do.
fn without_consensus(t: &Transport<'_>, found: &Refined) -> Vec<bool> {
    let (n, light) = (t.views.len(), t.chart.center(found.state));
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

/// The direction of the line on which the center lies, if the codes hardly tell where on it: a shift by a tenth of the
/// camera's distance changes them by less than a third of the residuals.
fn undetermined(chart: &Chart, found: &Refined) -> Option<Vector3<f64>> {
    let eigen = found.information.symmetric_eigen();
    let weakest = eigen.eigenvalues.imin();
    if 0.1 * eigen.eigenvalues[weakest].max(0.0).sqrt() > 0.3 * found.scale {
        return None;
    }
    let v = eigen.eigenvectors.column(weakest);
    let moved = |by: f64| chart.center([0, 1, 2].map(|i| found.state[i] + by * v[i])).position();
    let (a, b) = (moved(-1e-3)?, moved(1e-3)?);
    Some((b - a).normalize())
}
