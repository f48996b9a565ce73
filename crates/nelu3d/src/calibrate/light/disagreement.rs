//! Parts of single positions whose codewords do not fit those of the others: a hand before the board's edge, something
//! that stood in the light, a reflection.
//!
//! With the center of the light known, every block of pixels of one position has a partner in every other position that
//! its rays of light meet. What a hand shows is what the light throws on the hand, not on the plane of the board behind
//! it, so it disagrees with the others. A block is left out where more positions disagree with it than agree. Where
//! only two positions meet, and disagree, nobody knows which of them is right, and both are left out. What disagrees
//! goes on where no other position can tell: there it is taken to be about as long as where it is seen.

use rayon::prelude::*;

use super::super::excluded::ExcludedBlocks;
use super::super::views::Level;
use super::center::LightCenter;
use super::transport::{Seed, Transport, by_chance, seeds};

/// Most blocks across the image.
const MAX_ACROSS: usize = 200;
/// Squared difference of codewords, as a fraction of that of two samples drawn by chance, beyond which blocks disagree.
const DISAGREES: f32 = 0.03;
/// Squared difference of codewords, as a fraction of that of two samples drawn by chance, beyond which a block
/// disagrees that touches one which does: the tip of a finger is nearly in the plane of the board.
const DISAGREES_BESIDE: f32 = 0.01;
/// Radius over which differences are averaged, blocks: between the stripes of a code nothing differs.
const POOLED: usize = 3;
/// Difference of a channel that is not counted, beside what half a block's shift makes.
const TOLERANCE: f32 = 0.05;
/// Largest fraction of a position's blocks that may be left out: beyond, it is not a part that disagrees.
const MAX_SHARE: f64 = 0.4;

/// Returns, per view, the blocks that disagree with the other views, if there are any. None at all where so much
/// disagrees that it is the light which must be wrong.
pub(super) fn disagreeing_blocks(t: &Transport<'_>, light: &LightCenter) -> Vec<Option<ExcludedBlocks>> {
    let n = t.views.len();
    let none = || vec![None; n];
    let Some(level) = t.views.levels.iter().find(|l| l.width <= MAX_ACROSS) else { return none() };
    let all = seeds(t.camera, t.views, level, n * level.width * level.height);
    let chance = by_chance(t.views, level, &all) as f32;
    let judge = |view: usize| {
        let own: Vec<&Seed> = all.iter().filter(|s| s.view == view).collect();
        let votes = votes(t, level, light, view, &own, chance);
        let mut found: Vec<bool> = votes.iter().map(|v| 2 * v.disagree > v.of).collect();
        let beside: Vec<bool> = votes.iter().map(|v| 2 * v.disagree_beside > v.of).collect();
        spread(&mut found, &beside, |_| usize::MAX, level.width);
        let mut untold = vec![false; votes.len()];
        own.iter().for_each(|s| untold[s.index] = votes[s.index].of == 0);
        let as_long = |area: usize| (1.5 * (area as f64).sqrt()) as usize;
        spread(&mut found, &untold, as_long, level.width);
        (own.len(), found)
    };
    let judged: Vec<(usize, Vec<bool>)> = (0..n).into_par_iter().map(judge).collect();
    let share = |found: &[bool], of: usize| found.iter().filter(|f| **f).count() as f64 / of.max(1) as f64;
    let total = judged.iter().map(|(of, found)| share(found, *of)).sum::<f64>() / n as f64;
    tracing::debug!(?total, shares = ?judged.iter().map(|(of, f)| share(f, *of)).collect::<Vec<_>>(), "disagreeing");
    if total > 0.5 * MAX_SHARE {
        return none();
    }
    let exclude = |(of, found): (usize, Vec<bool>)| {
        let share = share(&found, of);
        (share > 0.0 && share <= MAX_SHARE).then(|| ExcludedBlocks {
            block: level.block,
            counts: [level.width, level.height],
            blocks: dilated(&found, level.width),
        })
    };
    judged.into_iter().map(exclude).collect()
}

/// How many views a block is compared with, and with how many it disagrees.
#[derive(Clone, Copy, Default)]
struct Votes {
    of: u16,
    disagree: u16,
    disagree_beside: u16,
}

/// Compares the blocks of `view` with every other view.
fn votes(t: &Transport<'_>, level: &Level, light: &LightCenter, view: usize, own: &[&Seed], chance: f32) -> Vec<Votes> {
    let (k, w, h) = (t.views.k, level.width, level.height);
    let image = &level.images[view];
    let tolerances: Vec<Vec<f32>> = own.iter().map(|s| tolerance(image, s.index, k, level)).collect();
    let mut votes = vec![Votes::default(); w * h];
    let mut r = vec![0.0; k];
    for to in (0..t.views.len()).filter(|to| *to != view) {
        let mut error = vec![f32::NAN; w * h];
        for (seed, tolerance) in own.iter().zip(&tolerances) {
            if t.carry(level, seed, light, to, &mut r) {
                let beyond = r.iter().zip(tolerance).map(|(r, t)| (r.abs() as f32 - t).max(0.0).powi(2));
                error[seed.index] = beyond.sum();
            }
        }
        for (i, vote) in votes.iter_mut().enumerate().filter(|(i, _)| error[*i].is_finite()) {
            let near = around(i, POOLED, w, h).filter(|j| error[*j].is_finite());
            let (sum, count) = near.fold((0.0, 0), |(s, n), j| (s + error[j], n + 1));
            let share = sum / (chance * count as f32);
            vote.of += 1;
            vote.disagree += u16::from(share > DISAGREES);
            vote.disagree_beside += u16::from(share > DISAGREES_BESIDE);
        }
    }
    votes
}

/// Returns, per channel, the difference that a shift of half a block and noise make.
fn tolerance(image: &[f32], i: usize, k: usize, level: &Level) -> Vec<f32> {
    let at = |i: usize| &image[i * (k + 1)..][..k + 1];
    let near: Vec<usize> =
        around(i, 1, level.width, level.height).filter(|j| at(*j)[k] >= level.min_validity).collect();
    let step = |c: usize| near.iter().map(|j| (at(*j)[c] - at(i)[c]).abs()).fold(0.0f32, f32::max);
    (0..k).map(|c| TOLERANCE + 0.5 * step(c)).collect()
}

/// The square of blocks around a block, itself included.
fn around(i: usize, radius: usize, w: usize, h: usize) -> impl Iterator<Item = usize> {
    let span = move |at: usize, n: usize| at.saturating_sub(radius)..(at + radius + 1).min(n);
    span(i / w, h).flat_map(move |y| span(i % w, w).map(move |x| y * w + x))
}

/// Lets every component of what was found go on into blocks of `into` that it touches, by as many steps as `steps`
/// gives for its number of blocks.
fn spread(found: &mut [bool], into: &[bool], steps: impl Fn(usize) -> usize, w: usize) {
    let h = found.len() / w;
    let mut seen = vec![false; found.len()];
    let seeds: Vec<usize> = (0..found.len()).filter(|i| found[*i]).collect();
    for seed in seeds {
        if std::mem::replace(&mut seen[seed], true) {
            continue;
        }
        let mut component = vec![seed];
        let mut next = 0;
        while let Some(i) = component.get(next).copied() {
            next += 1;
            component.extend(around(i, 1, w, h).filter(|j| found[*j] && !std::mem::replace(&mut seen[*j], true)));
        }
        let steps = steps(component.len());
        let mut front = component;
        let mut added = Vec::new();
        let mut taken = vec![false; found.len()];
        for _ in 0..steps.min(found.len()) {
            if front.is_empty() {
                break;
            }
            let mut reached = Vec::new();
            for i in &front {
                reached.extend(around(*i, 1, w, h).filter(|j| into[*j] && !std::mem::replace(&mut taken[*j], true)));
            }
            added.extend_from_slice(&reached);
            front = reached;
        }
        added.into_iter().for_each(|i| found[i] = true);
    }
}

/// Widens what was found by one block: a block is judged by its mean, and its neighbors may hold a part of the cause.
fn dilated(found: &[bool], w: usize) -> Vec<bool> {
    (0..found.len()).map(|i| around(i, 1, w, found.len() / w).any(|j| found[j])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_found_goes_on_into_what_it_touches() {
        // A row of blocks: found at 3, and 4 to 9 not told; 12 is not connected.
        let mut found: Vec<bool> = (0..14).map(|i| i == 3).collect();
        let into: Vec<bool> = (0..14).map(|i| (4..10).contains(&i) || i == 12).collect();
        spread(&mut found, &into, |_| 2, 14);
        let at: Vec<usize> = (0..14).filter(|i| found[*i]).collect();
        assert_eq!(at, [3, 4, 5]);
        spread(&mut found, &into, |_| usize::MAX, 14);
        assert_eq!(found.iter().filter(|f| **f).count(), 7);
    }
}
