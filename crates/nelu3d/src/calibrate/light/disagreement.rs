//! Parts of single positions whose codewords do not fit those of the others: a hand before the board's edge, something
//! that stood in the light, a reflection.
//!
//! With the center of the light known, every block of pixels of one position has a partner in every other position that
//! its rays of light meet. What a hand shows is what the light throws on the hand, not on the plane of the board behind
//! it, so it disagrees with the others. A block is left out where more positions disagree with it than agree. Where
//! only two positions meet, and disagree, nobody knows which of them is right, and both are left out. What disagrees
//! goes on where no other position can tell: there it is taken to be about as long as where it is seen.

use nelu3d_scan::image::box_mean;
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
/// Most positions that one is compared with: further ones tell nothing new.
pub const MAX_COMPARED: usize = 12;
/// Largest fraction of a position's blocks that may be left out: beyond, it is not a part that disagrees.
const MAX_SHARE: f64 = 0.4;

/// Returns, per view, the blocks that disagree with the other views, if there are any. None at all where so much
/// disagrees that it is the light which must be wrong.
pub(super) fn disagreeing_blocks(t: &Transport<'_>, light: &LightCenter) -> Vec<Option<ExcludedBlocks>> {
    let n = t.views.count();
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

/// Compares the blocks of `view` with other views.
fn votes(t: &Transport<'_>, level: &Level, light: &LightCenter, view: usize, own: &[&Seed], chance: f32) -> Vec<Votes> {
    let (k, w, h) = (t.views.k, level.width, level.height);
    let image = &level.images[view];
    let tolerances: Vec<f32> = own.iter().flat_map(|s| tolerance(image, s.index, k, level)).collect();
    let mut votes = vec![Votes::default(); w * h];
    let mut r = vec![0.0; k];
    for to in compared_with(view, t.views.count()) {
        // Sums over the blocks that meet the other position, and how many these are, each as a mean of all around.
        let (mut error, mut hits) = (vec![0.0f32; w * h], vec![0.0f32; w * h]);
        let mut met = Vec::with_capacity(own.len());
        for (seed, tolerance) in own.iter().zip(tolerances.chunks_exact(k)) {
            if t.carry(level, seed, light, to, &mut r) {
                let beyond = r.iter().zip(tolerance).map(|(r, t)| (r.abs() as f32 - t).max(0.0).powi(2));
                (error[seed.index], hits[seed.index]) = (beyond.sum(), 1.0);
                met.push(seed.index);
            }
        }
        box_mean(&mut error, w, h, POOLED);
        box_mean(&mut hits, w, h, POOLED);
        for i in met {
            let (vote, share) = (&mut votes[i], error[i] / (chance * hits[i]));
            vote.of += 1;
            vote.disagree += u16::from(share > DISAGREES);
            vote.disagree_beside += u16::from(share > DISAGREES_BESIDE);
        }
    }
    votes
}

/// An even selection of the other views, of which there are `n` with this one: all of them where there are few.
pub fn compared_with(view: usize, n: usize) -> impl Iterator<Item = usize> {
    let count = (n - 1).min(MAX_COMPARED);
    (0..count).map(move |i| i * (n - 1) / count).map(move |i| if i < view { i } else { i + 1 })
}

/// Returns, per channel, the difference that a shift of half a block and noise make.
fn tolerance<'a>(image: &'a [f32], i: usize, k: usize, level: &'a Level) -> impl Iterator<Item = f32> + 'a {
    let at = move |i: usize| &image[i * (k + 1)..][..k + 1];
    let near = move || around(i, 1, level.width, level.height).filter(move |j| at(*j)[k] >= level.min_validity);
    let step = move |c: usize| near().map(|j| (at(j)[c] - at(i)[c]).abs()).fold(0.0f32, f32::max);
    (0..k).map(move |c| TOLERANCE + 0.5 * step(c))
}

/// The square of blocks around a block, itself included.
fn around(i: usize, radius: usize, w: usize, h: usize) -> impl Iterator<Item = usize> {
    let span = move |at: usize, n: usize| at.saturating_sub(radius)..(at + radius + 1).min(n);
    span(i / w, h).flat_map(move |y| span(i % w, w).map(move |x| y * w + x))
}

/// Lets every component of what was found go on into blocks of `into` that it touches, by as many steps as `steps`
/// gives for its number of blocks.
pub fn spread(found: &mut [bool], into: &[bool], steps: impl Fn(usize) -> usize, w: usize) {
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
