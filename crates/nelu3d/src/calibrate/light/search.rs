//! Where the light might be: an exhaustive search, coarse to fine.
//!
//! Averaged over blocks of pixels, a codeword keeps what changes slowly over the board: the coarse bits of a binary
//! code, the long waves of a phase code. That is enough to tell roughly where a ray of light meets another board, from
//! any start, and what is found there is sharpened level by level. How far a center may be off at a level is read from
//! the images: from how far a sample's neighbors still have its codeword. A code without anything coarse has small
//! basins, and more centers are tried.

use rayon::prelude::*;

use super::super::views::Level;
use super::center::State;
use super::refine::{Steps, refine};
use super::transport::{DISAGREEMENT, PULL, Seed, Transport, by_chance, hash, partner, seeds};

/// Most centers that are tried.
const MAX_TRIED: usize = 40_000;
/// Largest tangent of the angle between the light's direction and the camera's.
const MAX_TANGENT: f64 = 1.1;
/// Largest inverse distance: the light is no nearer to the volume than a third of the camera's distance.
const MAX_KAPPA: f64 = 3.0;
/// Part of the codewords' variance that a level must keep.
const MIN_SIGNAL: f64 = 0.15;
/// Seeds of a level.
const SEEDS: usize = 1500;
/// Levels that are searched, the coarsest useful ones.
const SEARCHED_LEVELS: usize = 3;
/// Disagreement beyond which a center is not looked at further.
const HOPELESS: f64 = 0.85;
/// Centers that are refined at the level they were found at.
const REFINED: usize = 64;
/// Starts of a level that are followed down to the finest.
const STARTS: usize = 6;

/// A level, ready to be searched.
pub(super) struct SearchLevel<'a> {
    pub(super) level: &'a Level,
    pub(super) seeds: Vec<Seed>,
    pub(super) by_chance: f64,
}

impl SearchLevel<'_> {
    /// Typical standard deviation of a channel.
    pub(super) fn spread(&self, k: usize) -> f64 {
        (0.5 * self.by_chance / k as f64).sqrt()
    }

    /// Steps of a refinement from afar.
    pub(super) fn steps(&self, k: usize, arm: usize) -> Steps {
        Steps { arm, count: 6, min_scale: 0.3 * self.spread(k), pull: PULL, far: true, held: None }
    }
}

/// Samples of every level, the finest first, as far as there are enough.
pub(super) fn search_levels<'a>(t: &Transport<'a>) -> Vec<SearchLevel<'a>> {
    let with_seeds = |level: &'a Level| {
        let mut seeds = seeds(t.camera, t.views, level, SEEDS);
        seeds.sort_by_key(hash);
        let by_chance = by_chance(t.views, level, &seeds);
        SearchLevel { level, seeds, by_chance }
    };
    t.views.levels.iter().map(with_seeds).take_while(|l| l.seeds.len() >= 100).collect()
}

/// The best starts of several levels, refined at every level from the one they were found at down to the finest.
pub(super) fn starts(t: &Transport<'_>, levels: &[SearchLevel<'_>]) -> Vec<State> {
    let arm = (t.views.count() / 4).max(1);
    let signal = |l: usize| levels[l].by_chance / levels[0].by_chance;
    let useful = (0..levels.len()).rev().filter(|l| signal(*l) >= MIN_SIGNAL);
    let mut found = Vec::new();
    for l in useful.filter(|l| basin_px(t, &levels[*l]) > 0.0).take(SEARCHED_LEVELS).collect::<Vec<_>>() {
        let basin = basin_px(t, &levels[l]);
        let (states, steps) = grid(t, &levels[l], arm, basin);
        let n = states.len();
        let best = best_of(t, &levels[l], arm, states, steps);
        tracing::debug!(level = l, signal = signal(l), basin, tried = n, best = best[0].0, "search for the light");
        found.extend(best.into_iter().map(|(_, s)| (l, s)));
    }
    let mut states: Vec<State> = Vec::new();
    for (l, level) in levels.iter().enumerate().rev() {
        states.extend(found.iter().filter(|(first, _)| *first == l).map(|(_, s)| *s));
        let refined = |s| refine(t, level.level, &level.seeds, s, level.steps(t.views.k, arm)).state;
        states = different(states.into_par_iter().map(refined).collect());
    }
    states
}

/// Returns those of some states that differ from all before them: most starts end in the same place.
pub fn different(states: Vec<State>) -> Vec<State> {
    /// Largest difference of what is the same.
    const SAME: f64 = 1e-3;
    let mut kept: Vec<State> = Vec::new();
    for s in states {
        if kept.iter().all(|k| (0..3).any(|i| (k[i] - s[i]).abs() > SAME)) {
            kept.push(s);
        }
    }
    tracing::debug!(states = ?kept, "starts of the light");
    kept
}

/// The best of many centers: all are scored with a few seeds, a promising part is refined at this level and scored
/// again, and of what lies closer together than `steps` one is kept.
fn best_of(
    t: &Transport<'_>,
    level: &SearchLevel<'_>,
    arm: usize,
    states: Vec<State>,
    steps: State,
) -> Vec<(f64, State)> {
    let score =
        |s: State, n: usize, give_up| (t.score(level.level, &level.seeds[..n], s, arm, level.by_chance, give_up), s);
    let few = level.seeds.len().min(200);
    let mut scored: Vec<(f64, State)> = states.into_par_iter().map(|s| score(s, few, Some(HOPELESS))).collect();
    scored.sort_by(|a, b| a.0.total_cmp(&b.0));
    scored.truncate(REFINED);
    let some = &level.seeds[..level.seeds.len().min(500)];
    let refined =
        scored.into_par_iter().map(|(_, s)| refine(t, level.level, some, s, level.steps(t.views.k, arm)).state);
    let mut scored: Vec<(f64, State)> = refined.map(|s| score(s, level.seeds.len(), None)).collect();
    scored.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut best: Vec<(f64, State)> = Vec::new();
    for (score, s) in scored {
        let is_new = |(_, b): &(f64, State)| (0..3).any(|i| (b[i] - s[i]).abs() > 0.5 * steps[i]);
        if best.len() < STARTS && best.iter().all(is_new) {
            best.push((score, s));
        }
    }
    best
}

/// How far apart samples may be, in pixels, and still have much the same codeword.
fn basin_px(t: &Transport<'_>, level: &SearchLevel<'_>) -> f64 {
    let (k, l) = (t.views.k, level.level);
    let far = |d: usize, step: usize| {
        let (mut sum, mut n) = (0.0, 0usize);
        for seed in &level.seeds {
            let image = &l.images[seed.view];
            let there = seed.index + d * step;
            let same_row = step > 1 || seed.index % l.width + d < l.width;
            if same_row && there < l.width * l.height && image[there * (k + 1) + k] >= l.min_validity {
                let at = |i: usize, c: usize| f64::from(image[i * (k + 1) + c]);
                sum += (0..k).map(|c| (at(there, c) - at(seed.index, c)).powi(2)).sum::<f64>();
                n += 1;
            }
        }
        n < 20 || sum / n as f64 > 0.7 * DISAGREEMENT * level.by_chance
    };
    let reach = (1..24).take_while(|d| !far(*d, 1) && !far(*d, l.width)).count();
    reach as f64 * l.block as f64
}

/// Centers so close that one of them is within the basin, as far as they are not too many; and their distances.
fn grid(t: &Transport<'_>, level: &SearchLevel<'_>, arm: usize, basin_px: f64) -> (Vec<State>, State) {
    let n = level.seeds.len() as f64;
    // Mean distance between boards that are compared, and spread of the samples across.
    let apart = |s: &Seed| {
        let (normal, offset) = t.views.planes[partner(s, arm, t.views.count())];
        let dir = s.point.coords.normalize();
        (offset / normal.dot(&dir) - s.point.coords.norm()).abs()
    };
    let lever = level.seeds.iter().map(apart).sum::<f64>() / n;
    let spread = (level.seeds.iter().map(|s| (s.point - t.chart.origin).norm_squared()).sum::<f64>() / n).sqrt();
    let px_per_radian = t.camera.fx * lever / t.chart.scale;
    let angle = (basin_px / px_per_radian.max(1e-9)).min(0.14);
    let kappa = (basin_px * t.chart.scale / (px_per_radian * spread).max(1e-9)).clamp(0.15, 0.6);
    let count = std::f64::consts::PI * (MAX_TANGENT / angle).powi(2) * (MAX_KAPPA / kappa + 1.0);
    let angle = angle * (count / MAX_TRIED as f64).max(1.0).sqrt();
    let (na, nk) = ((MAX_TANGENT / angle) as i32, (MAX_KAPPA / kappa).ceil() as i32);
    let mut out = Vec::new();
    for i in -na..=na {
        for j in -na..=na {
            for l in 0..=nk {
                let s = [f64::from(i) * angle, f64::from(j) * angle, f64::from(l) * kappa];
                if s[0].hypot(s[1]) < MAX_TANGENT {
                    out.push(s);
                }
            }
        }
    }
    (out, [angle, angle, kappa])
}
