//! The aggregation of costs along paths, on the CPU. The contract is that of [`super::reference::sums`], in integers
//! of 16 bits: sums of integers are the same in every order, and vectors hold twice as many of them.
//!
//! Every pass reads the costs once: along the rows both ways, down the image in three directions together, and up
//! likewise.

use pulp::{Arch, Simd, WithSimd};
use rayon::prelude::*;

/// A pixel without a place in the cost volume.
pub(super) const NO_SLOT: u32 = u32::MAX;

/// A stored cost that stands for [`super::OUTSIDE`].
pub(super) const OUTSIDE: u16 = u16::MAX;

/// The largest stored cost of a path through hypotheses that are inside.
pub(super) const MAX_PATH: f32 = 65_000.0;

/// Hypotheses that a vector loop takes at a time; the rows of the volume are a multiple of it.
pub(super) const CHUNK: usize = 32;

/// Pixels of a row that one task takes at least.
const MIN_PIXELS: usize = 48;

/// Semi-global matching over an image.
pub(super) struct Aggregation<'a> {
    pub(super) width: usize,
    pub(super) height: usize,
    /// The pixel of every slot, ascending.
    pub(super) pixels: &'a [u32],
    /// The slot of every pixel of the image; [`NO_SLOT`] where a path ends.
    pub(super) slots: &'a [u32],
    /// Length of a row of the volume: the number of hypotheses, up to a multiple of [`CHUNK`].
    pub(super) stride: usize,
    /// Costs `[slot][hypothesis]`; [`OUTSIDE`] behind the last hypothesis.
    pub(super) costs: &'a [u16],
    /// Cost of a step to the next hypothesis.
    pub(super) step: u16,
    /// Cost of any larger step.
    pub(super) jump: u16,
}

/// The path costs of one pixel: the least of them, and all of them between two that are [`OUTSIDE`].
struct Path {
    least: u16,
    costs: Vec<u16>,
}

/// The path costs of one row of the image, of three directions.
#[derive(Default)]
struct PathRow {
    /// The row's first slot and the one behind its last; equal if the row has no pixels.
    slots: [usize; 2],
    /// The least cost of every path.
    least: Vec<[u16; 3]>,
    /// `[slot][direction][hypothesis]`, each path between two that are [`OUTSIDE`].
    costs: Vec<u16>,
}

impl Aggregation<'_> {
    /// Returns the sums of the path costs of all eight directions, `[slot][hypothesis]`, in two parts to be added.
    pub(super) fn sums(&self) -> [Vec<u16>; 2] {
        let mut first = vec![0u16; self.costs.len()];
        self.along_rows(&mut first);
        let mut second = vec![0u16; self.costs.len()];
        rayon::join(|| self.across_rows(&mut first, true, false), || self.across_rows(&mut second, false, true));
        [first, second]
    }

    /// Returns the first slot of an image row and the one behind its last; `None` if the row has no pixels on paths.
    ///
    /// Slots are in row order, so the pixels of one row own one contiguous part of the sums.
    fn slots_of_row(&self, y: usize) -> Option<[usize; 2]> {
        let mut filled = self.slots[y * self.width..(y + 1) * self.width].iter().filter(|s| **s != NO_SLOT);
        let first = *filled.next()? as usize;
        let last = filled.next_back().map_or(first, |s| *s as usize);
        Some([first, last + 1])
    }

    /// Writes the sums of the paths within rows, both ways.
    fn along_rows(&self, sums: &mut [u16]) {
        let mut rows = Vec::new();
        let (mut rest, mut at) = (sums, 0);
        for y in 0..self.height {
            if let Some([first, end]) = self.slots_of_row(y) {
                let (_, tail) = rest.split_at_mut((first - at) * self.stride);
                let (own, tail) = tail.split_at_mut((end - first) * self.stride);
                rows.push((y, first, own));
                rest = tail;
                at = end;
            }
        }
        rows.into_par_iter().for_each(|(y, first, sums)| {
            Arch::new().dispatch(AlongRow { of: self, y, first, sums });
        });
    }

    /// Adds the paths that go from row to row, straight and both diagonals, row after row; or writes their sums, if
    /// there are none yet.
    fn across_rows(&self, sums: &mut [u16], down: bool, is_first: bool) {
        let (mut before, mut now) = (PathRow::default(), PathRow::default());
        let path = self.stride + 2;
        for i in 0..self.height {
            let y = if down { i } else { self.height - 1 - i };
            let Some([first, end]) = self.slots_of_row(y) else {
                before.slots = [0; 2];
                continue;
            };
            now.slots = [first, end];
            now.costs.resize(((end - first) * 3 * path).max(now.costs.len()), OUTSIDE);
            now.least.resize((end - first).max(now.least.len()), [0; 3]);
            // The pixels of a row are independent.
            let n = end - first;
            now.costs[..n * 3 * path]
                .par_chunks_mut(MIN_PIXELS * 3 * path)
                .zip(now.least[..n].par_chunks_mut(MIN_PIXELS))
                .zip(sums[first * self.stride..end * self.stride].par_chunks_mut(MIN_PIXELS * self.stride))
                .enumerate()
                .for_each(|(part, ((costs, least), sums))| {
                    let first = first + part * MIN_PIXELS;
                    let (of, before) = (self, &before);
                    Arch::new().dispatch(AcrossRows { of, y, down, is_first, first, before, costs, least, sums });
                });
            std::mem::swap(&mut before, &mut now);
        }
    }

    /// Returns the place of the pixel at column `x` of the row before row `y` among that row's paths; `None` if no
    /// path comes from there.
    #[inline(always)]
    fn place_before(&self, before: &PathRow, y: usize, x: isize, down: bool) -> Option<usize> {
        let [first, end] = before.slots;
        if first == end || !(0..self.width as isize).contains(&x) {
            return None;
        }
        let y = if down { y - 1 } else { y + 1 };
        let slot = self.slots[y * self.width + x as usize];
        (slot != NO_SLOT && (first..end).contains(&(slot as usize))).then(|| slot as usize - first)
    }

    /// Writes the path costs of a pixel with costs `own` behind a pixel with path costs `before`, of which `least` is
    /// the least, and adds an eighth of them to `sum`, so that all eight fit; returns the least of them. Paths lie
    /// between two [`OUTSIDE`]. The first direction of all writes `sum`, which is never read before: memory that was
    /// only asked for is mapped twice, and every core told of it, if it is read first.
    #[inline(always)]
    fn advance(
        &self,
        own: &[u16],
        before: Option<(&[u16], u16)>,
        out: &mut [u16],
        sum: &mut [u16],
        is_first: bool,
    ) -> u16 {
        let n = self.stride;
        let (own, sum, out) = (&own[..n], &mut sum[..n], &mut out[1..n + 1]);
        let mut lowest = [OUTSIDE; CHUNK];
        match before {
            None => {
                for at in (0..n).step_by(CHUNK) {
                    let own: &[u16; CHUNK] = own[at..].first_chunk().expect("whole chunks");
                    *out[at..].first_chunk_mut::<CHUNK>().expect("whole chunks") = *own;
                    add(sum[at..].first_chunk_mut().expect("whole chunks"), own, &mut lowest, is_first);
                }
            }
            Some((before, least)) => {
                let (left, here, right) = (&before[..n], &before[1..n + 1], &before[2..n + 2]);
                let far = least.saturating_add(self.jump);
                for at in (0..n).step_by(CHUNK) {
                    let own: &[u16; CHUNK] = own[at..].first_chunk().expect("whole chunks");
                    let [left, here, right] =
                        [left, here, right].map(|v| v[at..].first_chunk::<CHUNK>().expect("whole chunks"));
                    let out: &mut [u16; CHUNK] = out[at..].first_chunk_mut().expect("whole chunks");
                    for l in 0..CHUNK {
                        let beside = left[l].min(right[l]).saturating_add(self.step);
                        out[l] = own[l].saturating_add(here[l].min(beside).min(far) - least);
                    }
                    add(sum[at..].first_chunk_mut().expect("whole chunks"), out, &mut lowest, is_first);
                }
            }
        }
        lowest.iter().fold(OUTSIDE, |a, b| a.min(*b))
    }
}

/// Adds an eighth of path costs to sums, or writes it if it is the first, and keeps the least of them, lane by lane.
#[inline(always)]
fn add(sum: &mut [u16; CHUNK], path: &[u16; CHUNK], lowest: &mut [u16; CHUNK], is_first: bool) {
    let before = if is_first { [0; CHUNK] } else { *sum };
    for l in 0..CHUNK {
        sum[l] = before[l] + (path[l].saturating_add(4) >> 3);
        lowest[l] = lowest[l].min(path[l]);
    }
}

/// The paths within one row, both ways; `first` is the slot of the first of its sums.
struct AlongRow<'a> {
    of: &'a Aggregation<'a>,
    y: usize,
    first: usize,
    sums: &'a mut [u16],
}

impl WithSimd for AlongRow<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { of, y, first, sums } = self;
        let (width, n) = (of.width, of.stride);
        let empty = || Path { least: 0, costs: vec![OUTSIDE; n + 2] };
        let (mut before, mut now) = (empty(), empty());
        for forward in [true, false] {
            let mut has_before = false;
            for i in 0..width {
                let slot = of.slots[y * width + if forward { i } else { width - 1 - i }];
                if slot == NO_SLOT {
                    has_before = false;
                    continue;
                }
                let slot = slot as usize;
                let sum = &mut sums[(slot - first) * n..][..n];
                let path = has_before.then_some((&before.costs[..], before.least));
                now.least = of.advance(&of.costs[slot * n..][..n], path, &mut now.costs, sum, forward);
                std::mem::swap(&mut before, &mut now);
                has_before = true;
            }
        }
    }
}

/// The paths from the row before to some pixels of a row, of which `first` is the first slot.
struct AcrossRows<'a> {
    of: &'a Aggregation<'a>,
    y: usize,
    down: bool,
    is_first: bool,
    first: usize,
    before: &'a PathRow,
    costs: &'a mut [u16],
    least: &'a mut [[u16; 3]],
    sums: &'a mut [u16],
}

impl WithSimd for AcrossRows<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { of, y, down, is_first, first, before, costs, least, sums } = self;
        let (n, path) = (of.stride, of.stride + 2);
        let pixels = costs.chunks_exact_mut(3 * path).zip(least).zip(sums.chunks_exact_mut(n));
        for (j, ((costs, least), sum)) in pixels.enumerate() {
            let slot = first + j;
            let pixel = of.pixels[slot] as usize;
            // Pixels that no path passes keep their place.
            if of.slots[pixel] == NO_SLOT {
                continue;
            }
            let x = (pixel % of.width) as isize;
            let own = &of.costs[slot * n..][..n];
            for (direction, out) in costs.chunks_exact_mut(path).enumerate() {
                let place = of.place_before(before, y, x + direction as isize - 1, down);
                let behind =
                    place.map(|p| (&before.costs[(3 * p + direction) * path..][..path], before.least[p][direction]));
                least[direction] = of.advance(own, behind, out, sum, is_first && direction == 0);
            }
        }
    }
}
