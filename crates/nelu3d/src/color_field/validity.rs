//! The validity volume: where samples were. Outside it nothing is reconstructed (paper, Fig. 8).

use std::borrow::Cow;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// The range of a tile in which nothing was.
const EMPTY: [f32; 2] = [f32::INFINITY, f32::NEG_INFINITY];

/// What part of space was calibrated: a range of distances per tile of camera pixels, the cells of the frame that were
/// ever lit, and how many board positions each column of cells rests on.
#[derive(Clone, Debug, PartialEq)]
pub struct Validity {
    /// Sizes.
    pub shape: ValidityShape,
    /// Per tile `[t_near, t_far]`, mm along the ray; an empty tile has `t_near > t_far`.
    pub t_range: Vec<[f32; 2]>,
    /// Per cell `[b][a][w]`: 1 where there were samples; where codewords are known along some axes of the code only,
    /// a bit per axis from 2 on; else 0.
    pub lit: Vec<u8>,
    /// Per column of cells `[b][a]`, number of positions that lit it, 255 at most; 0 where that is not known, as where
    /// codewords were carried from beside it. Empty in a field without a sweep, and in files of older versions.
    pub positions: Vec<u8>,
    /// Axis of the code, 0 or 1, along which each pattern channel varies; empty where no cell is known along some axes
    /// only.
    pub axes: Vec<u8>,
}

/// The axes of the code along which codewords are known somewhere: all of them, some, or none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KnownAxes(u8);

impl KnownAxes {
    /// No channel is known.
    pub const NONE: Self = Self(0);
    /// The whole codeword is known.
    pub const ALL: Self = Self(u8::MAX);

    /// The channels that vary along one axis of the code, 0 or 1, are known.
    pub fn only(axis: usize) -> Self {
        assert!(axis < 2, "codes have two axes at most");
        Self(1 << (axis + 1))
    }

    /// Reads the mark of a cell.
    fn of_cell(mark: u8) -> Self {
        if mark & WHOLE != 0 { Self::ALL } else { Self(mark) }
    }

    /// Returns whether nothing is known.
    pub fn is_none(self) -> bool {
        self == Self::NONE
    }

    /// Returns whether the whole codeword is known.
    pub fn is_all(self) -> bool {
        self == Self::ALL
    }

    /// Returns whether the channels of an axis are known.
    pub fn has(self, axis: u8) -> bool {
        self.0 & 1 << (axis + 1) != 0
    }

    /// Returns whether everything that `other` knows is known.
    pub fn covers(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Returns what both know.
    pub fn and(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }
}

/// The mark of a cell whose whole codeword is known.
const WHOLE: u8 = 1;

/// Sizes of a [`Validity`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ValidityShape {
    /// Side of a tile, px.
    pub tile_px: usize,
    /// Tiles across and down.
    pub tiles: [usize; 2],
    /// Cells along a, b and w.
    pub cells: [usize; 3],
}

impl Validity {
    /// An empty volume for a camera of the given size.
    pub fn new(width: usize, height: usize, tile_px: usize, cells: [usize; 3]) -> Self {
        let tiles = [width.div_ceil(tile_px), height.div_ceil(tile_px)];
        Self {
            shape: ValidityShape { tile_px, tiles, cells },
            t_range: vec![EMPTY; tiles[0] * tiles[1]],
            lit: vec![0; cells.iter().product()],
            positions: Vec::new(),
            axes: Vec::new(),
        }
    }

    /// Adds a sample: its pixel, distance along the ray and unit coordinates.
    pub fn add(&mut self, px: [f64; 2], t: f32, q: [f32; 3]) {
        let s = self.shape;
        let tile = |v: f64, n: usize| ((v.max(0.0) as usize) / s.tile_px).min(n - 1);
        let range = &mut self.t_range[tile(px[1], s.tiles[1]) * s.tiles[0] + tile(px[0], s.tiles[0])];
        *range = [range[0].min(t), range[1].max(t)];
        self.light(q);
    }

    /// Lights the cell at unit coordinates.
    pub fn light(&mut self, q: [f32; 3]) {
        if let Some(i) = self.cell(q) {
            self.lit[i] = WHOLE;
        }
    }

    /// Marks the cell at unit coordinates as known along some axes of the code, unless its whole codeword is known.
    pub fn light_along(&mut self, q: [f32; 3], known: KnownAxes) {
        if let Some(i) = self.cell(q)
            && self.lit[i] != WHOLE
        {
            self.lit[i] |= known.0;
        }
    }

    /// Joins what one more position has seen, which is a volume of the same shape, and counts it.
    pub fn add_position(&mut self, seen: &Self) {
        assert_eq!(self.shape, seen.shape);
        for (a, b) in self.t_range.iter_mut().zip(&seen.t_range) {
            *a = [a[0].min(b[0]), a[1].max(b[1])];
        }
        self.lit.iter_mut().zip(&seen.lit).for_each(|(a, b)| *a |= b);
        let [na, nb, nw] = self.shape.cells;
        self.positions.resize(na * nb, 0);
        for (count, column) in self.positions.iter_mut().zip(seen.lit.chunks_exact(nw)) {
            *count = count.saturating_add(u8::from(column.contains(&WHOLE)));
        }
    }

    /// Returns how many positions the field rests on along the ray of light at unit coordinates `q`, if that is known.
    pub fn positions_at(&self, q: [f32; 3]) -> Option<u8> {
        let column = self.cell(q)? / self.shape.cells[2];
        self.positions.get(column).copied().filter(|n| *n > 0)
    }

    /// Returns the fewest positions that have lit the ray of light at unit coordinates or one of the four beside it, 0
    /// outside of what was lit; `None` where positions were not counted.
    pub fn fewest_positions_at(&self, q: [f32; 3]) -> Option<u8> {
        if self.positions.is_empty() {
            return None;
        }
        let [nx, ny, nz] = self.shape.cells;
        let Some(column) = self.cell(q).map(|cell| cell / nz) else { return Some(0) };
        let (x, y) = (column % nx, column / nx);
        let around = [[x, y], [x.wrapping_sub(1), y], [x + 1, y], [x, y.wrapping_sub(1)], [x, y + 1]];
        let count = |[x, y]: [usize; 2]| if x < nx && y < ny { self.positions[y * nx + x] } else { 0 };
        around.into_iter().map(count).min()
    }

    /// Closes pinholes: an unlit cell between lit ones along w becomes lit (board positions may be farther apart than
    /// cells).
    pub fn close(&mut self) {
        for column in self.lit.chunks_exact_mut(self.shape.cells[2]) {
            let first = column.iter().position(|l| *l == WHOLE);
            let last = column.iter().rposition(|l| *l == WHOLE);
            if let (Some(first), Some(last)) = (first, last) {
                column[first..=last].fill(WHOLE);
            }
        }
    }

    /// Lights columns of cells that most of their eight neighbors surround: samples lie as far apart as pixels, and the
    /// field interpolates between them.
    pub fn fill_holes(&mut self) {
        let [na, nb, nw] = self.shape.cells;
        let is_lit = |a: usize, b: usize| self.lit[(b * na + a) * nw..][..nw].contains(&WHOLE);
        let lit: Vec<bool> = (0..na * nb).map(|i| is_lit(i % na, i / na)).collect();
        for i in (0..na * nb).filter(|i| !lit[*i]) {
            let (a, b) = (i % na, i / na);
            if a == 0 || b == 0 || a + 1 == na || b + 1 == nb {
                continue;
            }
            let around = [i - na - 1, i - na, i - na + 1, i - 1, i + 1, i + na - 1, i + na, i + na + 1];
            let of: Vec<usize> = around.into_iter().filter(|j| lit[*j]).collect();
            if of.len() < 5 {
                continue;
            }
            for w in 0..nw {
                let votes = of.iter().filter(|j| self.lit[**j * nw + w] == WHOLE).count();
                if 2 * votes > of.len() {
                    self.lit[i * nw + w] = WHOLE;
                }
            }
        }
    }

    /// Extends every column of cells that was lit anywhere along w to the part `w` of unit coordinates (first, last):
    /// the rays of light are known to be straight, and what a ray carries there is what it carries elsewhere. So does
    /// what is known of it along one axis of the code.
    pub fn extend(&mut self, [first, last]: [f32; 2]) {
        let n = self.shape.cells[2];
        let at = |w: f32| ((w * n as f32).floor().max(0.0) as usize).min(n - 1);
        for column in self.lit.chunks_exact_mut(n) {
            let mark = if column.contains(&WHOLE) { WHOLE } else { column.iter().fold(0, |all, mark| all | mark) };
            if mark != 0 {
                column[at(first)..=at(last)].fill(mark);
            }
        }
    }

    /// Finds the range of every tile anew, from the lit cells: `ray` gives a pixel's ray, which gives the unit
    /// coordinates at a distance along it, and `[near, far]` bounds the distances, mm.
    pub fn find_ranges<Ray: Fn(f64) -> [f32; 3]>(
        &mut self,
        [near, far]: [f64; 2],
        ray: impl Fn([f64; 2]) -> Ray + Sync,
    ) {
        const STEPS: usize = 256;
        let (tile, across) = (self.shape.tile_px, self.shape.tiles[0]);
        let step = (far - near) / STEPS as f64;
        let ranges: Vec<[f32; 2]> = (0..self.t_range.len())
            .into_par_iter()
            .map(|i| {
                let mut range = [f32::INFINITY, f32::NEG_INFINITY];
                for part in 0..9 {
                    let at = |tile_at: usize, part: usize| (tile_at * tile) as f64 + 0.5 * (part * (tile - 1)) as f64;
                    let ray = ray([at(i % across, part % 3), at(i / across, part / 3)]);
                    let t = |s: usize| near + s as f64 * step;
                    let is_known = |s: &usize| !self.known_at(ray(t(*s))).is_none();
                    if let (Some(first), Some(last)) = ((0..=STEPS).find(is_known), (0..=STEPS).rfind(is_known)) {
                        range = [range[0].min((t(first) - step) as f32), range[1].max((t(last) + step) as f32)];
                    }
                }
                [range[0].max(near as f32), range[1].min(far as f32)]
            })
            .collect();
        self.t_range = ranges.into_iter().map(|r| if r[0] < r[1] { r } else { EMPTY }).collect();
    }

    /// `[t_near, t_far]` of the calibrated part of a ray, mm, and the axes of the code that are known all along it:
    /// from the first point whose whole codeword is known to the last, of about 100 along its tile's range; where there
    /// is none, of those that are known along the same axes. `None` where nothing is. `unit` gives the unit coordinates
    /// at a distance.
    pub fn range_of_ray(&self, x: usize, y: usize, unit: impl Fn(f32) -> [f32; 3]) -> Option<([f32; 2], KnownAxes)> {
        const STEPS: usize = 96;
        let [near, far] = self.range(x, y)?;
        let step = (far - near) / STEPS as f32;
        let at = |s: usize| near + s as f32 * step;
        let known = |s: &usize| self.known_at(unit(at(*s)));
        // Mostly the whole codeword is known from near one end to near the other.
        let whole = (0..=STEPS).find(|s| known(s).is_all());
        let of_ray = match whole {
            Some(_) => KnownAxes::ALL,
            None => (0..=STEPS).map(|s| known(&s)).filter(|k| !k.is_none()).reduce(KnownAxes::and)?,
        };
        if of_ray.is_none() {
            return None;
        }
        let first = whole.or_else(|| (0..=STEPS).find(|s| known(s).covers(of_ray)))?;
        let last = (0..=STEPS).rfind(|s| known(s).covers(of_ray))?;
        // To a tenth of a step.
        let sharpen = |lit_at: f32, dark_at: f32| {
            let (mut a, mut b) = (lit_at, dark_at);
            for _ in 0..4 {
                let mid = 0.5 * (a + b);
                if self.known_at(unit(mid)).covers(of_ray) { a = mid } else { b = mid }
            }
            a
        };
        let first_t = if first > 0 { sharpen(at(first), at(first - 1)) } else { near };
        let last_t = if last < STEPS { sharpen(at(last), at(last + 1)) } else { far };
        (first_t < last_t).then_some(([first_t, last_t], of_ray))
    }

    #[inline]
    fn cell(&self, q: [f32; 3]) -> Option<usize> {
        let n = self.shape.cells;
        let mut c = [0; 3];
        for i in 0..3 {
            if !(0.0..=1.0).contains(&q[i]) {
                return None;
            }
            c[i] = ((q[i] * n[i] as f32) as usize).min(n[i] - 1);
        }
        Some((c[1] * n[0] + c[0]) * n[2] + c[2])
    }

    /// Returns along which axes of the code codewords are known around unit coordinates `q`.
    #[inline]
    pub fn known_at(&self, q: [f32; 3]) -> KnownAxes {
        self.cell(q).map_or(KnownAxes::NONE, |i| KnownAxes::of_cell(self.lit[i]))
    }

    /// Whether the field was supervised around unit coordinates `q`: the whole codeword is known.
    #[inline]
    pub fn is_lit(&self, q: [f32; 3]) -> bool {
        self.cell(q).is_some_and(|i| self.lit[i] == WHOLE)
    }

    /// Returns per cell whether anything is known there, 1 or 0.
    pub fn lit_at_all(&self) -> Cow<'_, [u8]> {
        if self.axes.is_empty() {
            Cow::Borrowed(&self.lit)
        } else {
            Cow::Owned(self.lit.iter().map(|mark| u8::from(*mark != 0)).collect())
        }
    }

    /// `[t_near, t_far]` at a pixel, mm along its ray; `None` where no board was ever seen.
    pub fn range(&self, x: usize, y: usize) -> Option<[f32; 2]> {
        let s = self.shape;
        let r = self.t_range[(y / s.tile_px).min(s.tiles[1] - 1) * s.tiles[0] + (x / s.tile_px).min(s.tiles[0] - 1)];
        (r[0] < r[1]).then_some(r)
    }
}
