//! The samples of a sweep, ray of light by ray of light.

use crate::color_field::bins::Bins;
use crate::color_field::validity::Validity;

/// Weight of a ray's samples from which they are its codeword: a standard deviation of 0.1. Ink has less.
const MIN_WEIGHT: f32 = 100.0;

/// The bins of a field in the light's frame, averaged along the rays: one codeword per column. Columns are a pixel wide,
/// however many cells the field has: few boards leave most of finer ones empty.
pub(in crate::calibrate) struct Columns {
    /// Columns along a and b.
    pub(super) n: [usize; 2],
    /// Pattern channels.
    pub(super) k: usize,
    /// Codeword per column `[b][a][k]`; 0 where it is not known.
    pub(super) values: Vec<f32>,
    /// Where a column's samples are: a, b in columns, w in unit coordinates.
    pub(super) places: Vec<[f32; 3]>,
    /// Whether bright samples tell the codeword.
    pub(super) is_known: Vec<bool>,
}

impl Columns {
    /// Returns a volume of the shape of `all` that is lit all along the columns of which bright samples are in `bins`.
    pub(in crate::calibrate) fn lit_in(bins: &Bins, all: &Validity) -> Validity {
        let mut lit = Validity { lit: vec![0; all.lit.len()], axes: Vec::new(), positions: Vec::new(), ..all.clone() };
        for b in 0..bins.n_rows() {
            bins.for_each_in_row(b, |s| {
                if s.mean > MIN_WEIGHT {
                    lit.light(s.q);
                }
            });
        }
        lit.extend([0.0, 1.0]);
        lit.fill_holes();
        lit
    }

    /// Averages bins along the rays, `cells_per_pixel` of which lie side by side in a column.
    pub(super) fn new(bins: &Bins, validity: &Validity, cells_per_pixel: usize) -> Self {
        let [na, nb] = [0, 1].map(|i| (bins.counts()[i] / cells_per_pixel).max(1));
        let k = bins.k();
        let mut columns = Self {
            n: [na, nb],
            k,
            values: vec![0.0; na * nb * k],
            places: vec![[0.0; 3]; na * nb],
            is_known: vec![false; na * nb],
        };
        let [va, vb, vw] = validity.shape.cells;
        let (mut weights, mut omegas) = (vec![0.0f32; na * nb], vec![0.0f32; na * nb * k]);
        for row in 0..bins.n_rows() {
            bins.for_each_in_row(row, |s| {
                let [a, b] = [(s.q[0] * na as f32) as usize, (s.q[1] * nb as f32) as usize];
                let i = b.min(nb - 1) * na + a.min(na - 1);
                weights[i] += s.mean;
                let place = [s.q[0] * na as f32, s.q[1] * nb as f32, s.q[2]];
                columns.places[i].iter_mut().zip(place).for_each(|(sum, x)| *sum += s.mean * x);
                columns.values[i * k..][..k].iter_mut().zip(s.moments).for_each(|(sum, m)| *sum += m);
                omegas[i * k..][..k].iter_mut().zip(s.omegas).for_each(|(sum, w)| *sum += w);
            });
        }
        for i in 0..na * nb {
            let cell = (i / na * vb / nb) * va + i % na * va / na;
            let is_lit = validity.lit[cell * vw..][..vw].contains(&1);
            let of = &omegas[i * k..][..k];
            columns.is_known[i] = is_lit && weights[i] > MIN_WEIGHT && of.iter().all(|w| *w > 0.0);
            if columns.is_known[i] {
                columns.places[i] = columns.places[i].map(|x| x / weights[i]);
                columns.values[i * k..][..k].iter_mut().zip(of).for_each(|(v, w)| *v /= w);
            } else {
                columns.values[i * k..][..k].fill(0.0);
            }
        }
        columns
    }

    /// Returns the index of the column at a place, in columns; `None` outside.
    #[inline]
    pub(super) fn at(&self, [a, b]: [f32; 2]) -> Option<usize> {
        let [na, nb] = self.n;
        (a >= 0.0 && b >= 0.0 && (a as usize) < na && (b as usize) < nb).then(|| b as usize * na + a as usize)
    }

    /// Returns the middle of a column.
    #[inline]
    pub(super) fn middle(&self, i: usize) -> [f32; 2] {
        [(i % self.n[0]) as f32 + 0.5, (i / self.n[0]) as f32 + 0.5]
    }

    /// Returns the number of columns whose codeword is known.
    pub(super) fn n_known(&self) -> usize {
        self.is_known.iter().filter(|k| **k).count()
    }

    /// Returns the columns that are not known; of these, the ones that are lit in `within`, if that is given.
    pub(super) fn dark(&self, within: Option<&Validity>) -> Vec<usize> {
        let is_within = |i: usize| {
            within.is_none_or(|v| {
                let [na, nb] = self.n;
                let [va, vb, vw] = v.shape.cells;
                let cell = (i / na * vb / nb) * va + i % na * va / na;
                v.lit[cell * vw..][..vw].contains(&1)
            })
        };
        (0..self.is_known.len()).filter(|i| !self.is_known[*i] && is_within(*i)).collect()
    }

    /// Returns the number of columns between known ones of the same row that are not known, and none beside them is:
    /// samples lie a pixel apart, and where many boards were, one column or another is without any by chance.
    pub(super) fn n_between(&self) -> usize {
        let [na, nb] = self.n;
        let mut is_lit = vec![false; na * nb];
        for i in (0..na * nb).filter(|i| self.is_known[*i]) {
            let [a, b] = [i % na, i / na];
            for b in b.saturating_sub(1)..(b + 2).min(nb) {
                is_lit[b * na + a.saturating_sub(1)..b * na + (a + 2).min(na)].fill(true);
            }
        }
        let between = |row: &[bool]| {
            let first = row.iter().position(|l| *l)?;
            let last = row.iter().rposition(|l| *l)?;
            Some(row[first..=last].iter().filter(|l| !**l).count())
        };
        is_lit.chunks_exact(na).filter_map(between).sum()
    }
}
