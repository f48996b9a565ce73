//! The light's center from all views at once, against the field that they share.
//!
//! Codewords that are carried from view to view tell the center to the noise of single samples, in their differences
//! and in the slopes that these are multiplied with. A field that is constant along the rays of a light nearby has next
//! to none, and what is left of the samples beside it changes along the rays as the light's place asks for
//! ([`light_shift`]). Two strips of the field are enough, one along a and one along b.

use std::ops::Range;

use nalgebra::{Matrix3, Point3, Vector3};
use nelu3d_scan::camera::Ray;
use rayon::prelude::*;

use super::super::excluded::ExcludedBlocks;
use super::super::resolution::pitch;
use super::super::smoothing::{STIFFEST, smoothness};
use super::super::spline_fit::{Schedule, SplineFit};
use super::center::LightCenter;
use super::transport::Transport;
use crate::color_field::bins::Bins;
use crate::color_field::fit::light_shift;
use crate::color_field::fit::{NormalEquations, Smoothness};
use crate::color_field::frame::{Center, FieldFrame};
use crate::color_field::grid::Grid;
use crate::progress::Progress;

/// Fewest views that are refined on: both halves need two.
const MIN_VIEWS: usize = 4;
/// Cells that a strip is wide.
const WIDTH: usize = 32;
/// Side of the squares of samples that are looked at together.
const TILE: usize = 8;
/// Strength of smoothing across: that of fine codes, as the noise of a strip's slopes is small beside those of codes.
const ACROSS: f32 = 30.0;
/// Multiple of the median squared error from which a sample tells of something else: a hand, a reflection.
const FAR: f32 = 16.0;
/// Times that the center is moved, at most.
const MOVES: usize = 4;
/// Part of the squared error that the first move explains, below which a move is the last.
const SETTLED: f64 = 0.1;
/// How much the two halves of the views have to agree on where the light is instead (a cosine).
const AGREED: f64 = 0.6;

/// A sample: where it lies, mm, and its codeword.
type Sample<'a> = (Point3<f64>, &'a [f32]);

/// Returns the center that the samples of all views ask for, those in `excluded` (view by view) left out, as long as
/// every other view and those between ask for the same.
pub(super) fn refine_on_field(
    t: &Transport<'_>,
    found: LightCenter,
    excluded: &[Option<ExcludedBlocks>],
    progress: &Progress,
) -> LightCenter {
    if t.views.count() < MIN_VIEWS {
        return found;
    }
    let halves = samples(t, &found, excluded);
    let strips = Strips::of(t, &found, halves.iter().flatten());
    let halves = halves.map(|half| strips.near(half, progress));
    let of_halves = halves.each_ref().map(|half| strips.light_shift(half, progress));
    let agreement = light_shift::agreement(&of_halves, strips.cells);
    if agreement.is_none_or(|agreement| agreement < AGREED) {
        tracing::debug!(?agreement, "light on the field: left where it is");
        return found;
    }
    // Not the halves' sum: each half's field follows what the other one's boards would tell.
    let [mut samples, others] = halves;
    samples.extend(others);
    let (mut light, mut strips, mut gains) = (found, strips, Vec::new());
    for _ in 0..MOVES {
        let equations = strips.light_shift(&samples, progress);
        let Some(shift) = light_shift::solve(&equations, strips.cells) else { return found };
        light = light.moved(&strips.frame, strips.cells, &shift);
        gains.push(shift.dot(&equations.right));
        tracing::debug!(at = ?light.position(), ?shift, ?agreement, ?gains, "light on the field");
        // Slopes are noisy, and a first move may be too short.
        if gains.len() > 1 && gains[gains.len() - 1] < SETTLED * gains[0] {
            break;
        }
        strips = Strips::of(t, &light, samples.iter());
    }
    if progress.cancelled() { found } else { light }
}

/// A view's codewords at the finest level, and which are left out.
struct View<'a, 'r> {
    t: &'a Transport<'a>,
    view: usize,
    excluded: Option<&'a ExcludedBlocks>,
    /// The ray of every sample, the same in all views.
    rays: &'r [Ray],
}

impl<'a> View<'a, '_> {
    /// Where the sample at x, y lies on the board, mm; `None` where its ray does not meet it.
    fn point(&self, x: usize, y: usize) -> Option<Point3<f64>> {
        let ray = &self.rays[y * self.t.views.levels[0].width + x];
        let (normal, offset) = &self.t.views.planes[self.view];
        let at = offset / normal.dot(&ray.dir);
        (at > 0.0).then(|| ray.at(at))
    }

    /// The codeword at x, y, if it is usable.
    fn values(&self, x: usize, y: usize) -> Option<&'a [f32]> {
        let (level, k) = (&self.t.views.levels[0], self.t.views.k);
        let [px, py] = level.px(x, y).map(|v| v as usize);
        let sample = &level.images[self.view][(y * level.width + x) * (k + 1)..][..k + 1];
        let is_usable = sample[k] >= level.min_validity && !self.excluded.is_some_and(|blocks| blocks.contains(px, py));
        is_usable.then(|| &sample[..k])
    }

    /// The usable samples of every so many-th column and row.
    fn every(&self, step: usize) -> Vec<Sample<'a>> {
        let level = &self.t.views.levels[0];
        let places = (step / 2..level.height)
            .step_by(step)
            .flat_map(|y| (step / 2..level.width).step_by(step).map(move |x| (x, y)));
        places.filter_map(|(x, y)| Some((self.point(x, y)?, self.values(x, y)?))).collect()
    }

    /// The usable samples in strips, or near them.
    fn near(&self, strips: &Strips) -> Vec<Sample<'a>> {
        let level = &self.t.views.levels[0];
        let mut out = Vec::new();
        for top in (0..level.height).step_by(TILE) {
            for left in (0..level.width).step_by(TILE) {
                let (x, y) = ((left + TILE / 2).min(level.width - 1), (top + TILE / 2).min(level.height - 1));
                if !self.point(x, y).is_some_and(|x| strips.is_near(&x)) {
                    continue;
                }
                for y in top..(top + TILE).min(level.height) {
                    for x in left..(left + TILE).min(level.width) {
                        if let Some(values) = self.values(x, y) {
                            out.extend(self.point(x, y).map(|point| (point, values)));
                        }
                    }
                }
            }
        }
        out
    }
}

/// The usable samples of every other view, and of those between, that lie in the middle strips of a field in the frame
/// of the light, or near them.
fn samples<'a>(
    t: &'a Transport<'a>,
    light: &LightCenter,
    excluded: &'a [Option<ExcludedBlocks>],
) -> [Vec<Sample<'a>>; 2] {
    let level = &t.views.levels[0];
    let ray = |i: usize| t.camera.ray(level.px(i % level.width, i / level.width));
    let rays: Vec<Ray> = (0..level.width * level.height).into_par_iter().map(ray).collect();
    let view =
        |(view, blocks): (usize, &'a Option<ExcludedBlocks>)| View { t, view, excluded: blocks.as_ref(), rays: &rays };
    let views: Vec<View<'a, '_>> = excluded.iter().enumerate().map(view).collect();
    let few: Vec<Sample<'_>> = views.par_iter().flat_map_iter(|view| view.every(TILE)).collect();
    let strips = Strips::of(t, light, few.iter());
    [0, 1].map(|first| {
        let half: Vec<&View<'a, '_>> = views.iter().skip(first).step_by(2).collect();
        half.par_iter().flat_map_iter(|view| view.near(&strips)).collect()
    })
}

/// Two strips of a field in the frame of a light, one along a and one along b.
struct Strips {
    frame: FieldFrame,
    /// Cells of the field along a and b.
    cells: [usize; 2],
    /// Cells of each strip along a and b.
    windows: [[Range<usize>; 2]; 2],
    /// Pattern channels.
    k: usize,
}

impl Strips {
    /// Lays strips through the middle of what samples fill, with a cell per sample of the finest level.
    fn of<'a>(t: &Transport<'_>, light: &LightCenter, samples: impl Iterator<Item = &'a Sample<'a>>) -> Self {
        let mut frame = FieldFrame::new(light.origin, light.along, light.kappa, Vector3::x());
        samples.for_each(|(x, _)| frame.enclose(x));
        let level = &t.views.levels[0];
        let pitch = pitch(t.camera, light.origin, &frame).map(|mm| mm * level.block as f64);
        // A center that is far off may ask for any number of them.
        let most = (2 * level.width.max(level.height)).max(WIDTH);
        let cells = [0, 1].map(|i| (((frame.hi[i] - frame.lo[i]) / pitch[i]).ceil() as usize).clamp(WIDTH, most));
        let [middle_a, middle_b] = cells.map(|n| (n - WIDTH) / 2..(n + WIDTH) / 2);
        Self { frame, cells, windows: [[0..cells[0], middle_b], [middle_a, 0..cells[1]]], k: t.views.k }
    }

    /// Returns where a point is in a strip, in the strip's unit coordinates.
    fn place_in(&self, window: &[Range<usize>; 2], x: &Point3<f64>) -> Option<[f32; 3]> {
        let q = self.frame.to_unit(x)?;
        let [a, b] = [0, 1].map(|i| (q[i] * self.cells[i] as f32 - window[i].start as f32) / window[i].len() as f32);
        [a, b, q[2]].iter().all(|q| (0.0..=1.0).contains(q)).then_some([a, b, q[2]])
    }

    /// Returns whether a point is in a strip, or as near to one as a square of samples is large.
    fn is_near(&self, x: &Point3<f64>) -> bool {
        let Some(q) = self.frame.to_unit(x) else { return false };
        let is_near = |window: &[Range<usize>; 2]| {
            (0..2).all(|i| {
                // A light that moves takes strips along: with half the room, scans of 90 were 1.4 times as far off.
                let (at, room) = (q[i] * self.cells[i] as f32, 2.0 * TILE as f32);
                (window[i].start as f32 - room..=window[i].end as f32 + room).contains(&at)
            })
        };
        self.windows.iter().any(is_near)
    }

    /// Prepares to fit a strip to samples.
    fn fit(&self, window: &[Range<usize>; 2], samples: &[Sample<'_>]) -> SplineFit {
        let [na, nb] = [0, 1].map(|i| window[i].len());
        let (mut bins, ones) = (Bins::new([na, nb, 4], self.k), vec![1.0; self.k]);
        for (x, values) in samples {
            if let Some(q) = self.place_in(window, x) {
                bins.add(q, values, &ones);
            }
        }
        SplineFit::new(&bins, [na, nb, 1], Schedule::of(Center::Light, false))
    }

    /// How smooth strips are.
    fn smooth(&self) -> Smoothness {
        smoothness(Center::Light, vec![[ACROSS, ACROSS, STIFFEST]; self.k])
    }

    /// Returns the samples of the strips that are not far off.
    fn near<'a>(&self, samples: Vec<Sample<'a>>, progress: &Progress) -> Vec<Sample<'a>> {
        let of_strip = |window: &[Range<usize>; 2]| {
            let grid = self.fit(window, &samples).fit(&self.smooth(), progress);
            let mut c = vec![0.0; self.k];
            let off = |(i, (x, values)): (usize, &Sample<'a>)| {
                grid.eval(self.place_in(window, x)?, &mut c);
                Some((i, c.iter().zip(*values).map(|(c, v)| (c - v).powi(2)).sum::<f32>()))
            };
            let mut off: Vec<(usize, f32)> = samples.iter().enumerate().filter_map(off).collect();
            let middle = off.len() / 2;
            if middle > 0 {
                let most = FAR * off.select_nth_unstable_by(middle, |a, b| a.1.total_cmp(&b.1)).1.1;
                off.retain(|(_, off)| *off <= most);
            }
            off
        };
        let mut kept: Vec<usize> =
            self.windows.par_iter().flat_map_iter(|window| of_strip(window).into_iter().map(|(i, _)| i)).collect();
        kept.sort_unstable();
        kept.dedup();
        kept.into_iter().map(|i| samples[i]).collect()
    }

    /// Returns the equations of where the light is instead.
    fn light_shift(&self, samples: &[Sample<'_>], progress: &Progress) -> NormalEquations<3> {
        let of_strip = |window: &[Range<usize>; 2]| {
            let changes = |grid: &Grid| light_shift::changes(grid, [window[0].start, window[1].start], self.cells);
            self.fit(window, samples).equations_of(changes, &self.smooth(), progress)
        };
        let of_strips: Vec<NormalEquations<3>> = self.windows.par_iter().map(of_strip).collect();
        let mut equations = NormalEquations::none();
        of_strips.iter().for_each(|of_strip| equations.add(of_strip, &Matrix3::identity()));
        equations
    }
}
