//! The aggregation of costs along paths, on the CPU. The contract is that of [`super::reference::sums`].

use rayon::prelude::*;

/// A pixel without a place in the cost volume.
pub(super) const NO_SLOT: u32 = u32::MAX;

/// Semi-global matching over an image.
pub(super) struct Aggregation<'a> {
    pub(super) width: usize,
    pub(super) height: usize,
    /// The pixel of every slot, ascending.
    pub(super) pixels: &'a [u32],
    /// The slot of every pixel of the image; [`NO_SLOT`] where a path ends.
    pub(super) slots: &'a [u32],
    /// Depth hypotheses of a pixel, at least 2.
    pub(super) count: usize,
    /// Costs `[slot][hypothesis]`.
    pub(super) costs: &'a [f32],
    /// Cost of a step to the next hypothesis.
    pub(super) step: f32,
    /// Cost of any larger step.
    pub(super) jump: f32,
}

/// Path costs of one row of the image.
#[derive(Default)]
struct PathRow {
    /// The row's first slot and the one behind its last; equal if the row has no pixels.
    slots: [usize; 2],
    /// `[slot][hypothesis]`
    costs: Vec<f32>,
}

/// Returns the smaller value. Unlike `f32::min`, which has to think of NaN, this is a single instruction.
#[inline(always)]
fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// Returns the least of many values, in eight lanes.
#[inline(always)]
fn least(v: &[f32]) -> f32 {
    let (chunks, rest) = v.as_chunks::<8>();
    let mut lanes = [f32::INFINITY; 8];
    for c in chunks {
        for l in 0..8 {
            lanes[l] = min(c[l], lanes[l]);
        }
    }
    rest.iter().chain(&lanes).fold(f32::INFINITY, |a, b| min(*b, a))
}

impl Aggregation<'_> {
    /// Adds the path costs of one direction to `sums`, `[slot][hypothesis]`.
    pub(super) fn add(&self, sums: &mut [f32], [dx, dy]: [i32; 2]) {
        if dy == 0 { self.along_rows(sums, dx > 0) } else { self.across_rows(sums, dx as isize, dy > 0) }
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

    /// Writes the path costs of a pixel with costs `own` behind a pixel with path costs `before`.
    #[inline(always)]
    fn advance(&self, own: &[f32], before: Option<&[f32]>, out: &mut [f32]) {
        let Some(before) = before else {
            out.copy_from_slice(own);
            return;
        };
        let (count, step) = (self.count, self.step);
        let least = least(before);
        let far = least + self.jump;
        let (before, own, out) = (&before[..count], &own[..count], &mut out[..count]);
        let last = count - 1;
        if last == 0 {
            out[0] = own[0] + min(before[0], far) - least;
            return;
        }
        out[0] = own[0] + min(min(before[0], far), before[1] + step) - least;
        out[last] = own[last] + min(min(before[last], far), before[last - 1] + step) - least;
        // Slices of equal length and no branches: this loop runs as vectors.
        let (left, here, right) = (&before[..last - 1], &before[1..last], &before[2..]);
        for (((o, own), here), (l, r)) in
            out[1..last].iter_mut().zip(&own[1..last]).zip(here).zip(left.iter().zip(right))
        {
            *o = own + min(min(*here, far), min(*l, *r) + step) - least;
        }
    }

    fn costs_of(&self, slot: usize) -> &[f32] {
        &self.costs[slot * self.count..(slot + 1) * self.count]
    }

    /// Adds the paths within rows, which are independent of each other.
    fn along_rows(&self, sums: &mut [f32], forward: bool) {
        let mut rest = sums;
        let mut at = 0;
        let mut rows = Vec::new();
        for y in 0..self.height {
            if let Some([first, end]) = self.slots_of_row(y) {
                let (_, tail) = rest.split_at_mut((first - at) * self.count);
                let (own, tail) = tail.split_at_mut((end - first) * self.count);
                rows.push((y, first, own));
                rest = tail;
                at = end;
            }
        }
        rows.into_par_iter().for_each(|(y, first, sums)| self.along_row(y, first, sums, forward));
    }

    /// Adds the paths within one row to its sums, the first of which belongs to slot `first`.
    fn along_row(&self, y: usize, first: usize, sums: &mut [f32], forward: bool) {
        let (width, count) = (self.width, self.count);
        let (mut before, mut now) = (vec![0.0; count], vec![0.0; count]);
        let mut has_before = false;
        for i in 0..width {
            let x = if forward { i } else { width - 1 - i };
            let slot = self.slots[y * width + x];
            if slot == NO_SLOT {
                has_before = false;
                continue;
            }
            let slot = slot as usize;
            self.advance(self.costs_of(slot), has_before.then_some(&before[..]), &mut now);
            let sum = &mut sums[(slot - first) * count..][..count];
            sum.iter_mut().zip(&now).for_each(|(s, v)| *s += v);
            std::mem::swap(&mut before, &mut now);
            has_before = true;
        }
    }

    /// Adds the paths that go from row to row, `dx` to the right, row after row.
    fn across_rows(&self, sums: &mut [f32], dx: isize, down: bool) {
        let count = self.count;
        let (mut before, mut now) = (PathRow::default(), PathRow::default());
        for i in 0..self.height {
            let y = if down { i } else { self.height - 1 - i };
            let Some([first, end]) = self.slots_of_row(y) else {
                before.slots = [0; 2];
                continue;
            };
            now.slots = [first, end];
            now.costs.resize((end - first) * count, 0.0);
            let sums = sums[first * count..end * count].par_chunks_mut(count);
            // The pixels of a row are independent.
            let pixels = now.costs.par_chunks_mut(count).zip(sums).enumerate().with_min_len(32);
            pixels.for_each(|(j, (out, sum))| {
                let slot = first + j;
                let pixel = self.pixels[slot] as usize;
                // Pixels that no path passes keep their place.
                if self.slots[pixel] == NO_SLOT {
                    return;
                }
                let x = (pixel % self.width) as isize - dx;
                let neighbor =
                    (0..self.width as isize).contains(&x).then(|| self.path_at(&before, y, x as usize, down));
                self.advance(self.costs_of(slot), neighbor.flatten(), out);
                sum.iter_mut().zip(out.iter()).for_each(|(s, v)| *s += v);
            });
            std::mem::swap(&mut before, &mut now);
        }
    }

    /// Returns the path costs at column `x` of the row before row `y`; `None` if no path comes from there.
    fn path_at<'r>(&self, before: &'r PathRow, y: usize, x: usize, down: bool) -> Option<&'r [f32]> {
        let [first, end] = before.slots;
        if first == end {
            return None;
        }
        let y = if down { y - 1 } else { y + 1 };
        let slot = self.slots[y * self.width + x];
        let is_on_path = slot != NO_SLOT && (first..end).contains(&(slot as usize));
        is_on_path.then(|| &before.costs[(slot as usize - first) * self.count..][..self.count])
    }
}
