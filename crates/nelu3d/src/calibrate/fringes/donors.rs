//! Codewords of dark columns, from known columns on the same stripes.

use rayon::prelude::*;

use super::columns::Columns;
use super::direction::Axis;

/// Donors on either side.
const DONORS: usize = 3;
/// Known columns that are skipped where a stripe leaves the dark: they may see the ink's edge.
const SKIPPED: usize = 2;
/// Largest distance across the stripes at which a donor's value is compared with a known one, columns.
const SAME_STRIPE: f32 = 0.1;
/// Fewest comparisons that tell how good carried samples are, and how many are made at most.
const MIN_COMPARED: usize = 200;
const MAX_COMPARED: usize = 10_000;
/// How far beyond a way columns may be that are compared over it, columns.
const COMPARED_BEYOND: f32 = 40.0;

/// A known column on a stripe, and by how far its samples lie beside the stripe's middle line, columns.
#[derive(Clone, Copy)]
struct Donor {
    column: usize,
    beside: f32,
}

/// The donors of a dark column.
pub(super) struct Fill {
    column: usize,
    /// Per axis, the donors of one side or of both, nearest first; none where its stripe meets no known column.
    donors: Vec<Vec<Donor>>,
}

/// How far samples may be carried along the stripes of an axis, and how good they are then.
pub(super) struct Reach {
    /// Longest way, columns.
    pub(super) way: f32,
    /// Mean square error of each of the axis' channels, in their order.
    pub(super) variance: Vec<f32>,
}

/// Columns and the directions of their stripes.
pub(super) struct Known<'a> {
    columns: &'a Columns,
    axes: &'a [Axis],
    /// Indices of the columns that are known.
    known: Vec<usize>,
}

impl Fill {
    /// Returns the number of samples that it stands for.
    pub(super) fn samples(&self) -> usize {
        self.donors.iter().map(Vec::len).max().unwrap_or(0)
    }

    /// Returns whether the channels of an axis, by index, are carried there.
    pub(super) fn has(&self, axis: usize) -> bool {
        !self.donors[axis].is_empty()
    }

    /// Writes what is carried of the codeword of sample `i` to `values`, and returns its unit coordinates: where the
    /// stripes of its donors cross.
    pub(super) fn write(&self, columns: &Columns, axes: &[Axis], i: usize, values: &mut [f32]) -> [f32; 3] {
        let middle = columns.middle(self.column);
        let mut w = 0.0;
        let mut lines = Vec::with_capacity(2);
        let n_axes = self.donors.iter().filter(|donors| !donors.is_empty()).count();
        for (axis, donors) in axes.iter().zip(&self.donors).filter(|(_, donors)| !donors.is_empty()) {
            let donor = donors[i % donors.len()];
            for j in &axis.channels {
                values[*j] = columns.values[donor.column * columns.k + j];
            }
            w += columns.places[donor.column][2] / n_axes as f32;
            let [x, y] = axis.along(middle);
            lines.push(([-y, x], donor.beside));
        }
        let offset = match lines[..] {
            [(n, d), (m, e)] => {
                let det = n[0] * m[1] - n[1] * m[0];
                [(d * m[1] - e * n[1]) / det, (n[0] * e - m[0] * d) / det]
            }
            [(n, d)] => n.map(|n| n * d),
            _ => [0.0; 2],
        };
        let [na, nb] = columns.n.map(|n| n as f32);
        [(middle[0] + offset[0]) / na, (middle[1] + offset[1]) / nb, w]
    }
}

impl<'a> Known<'a> {
    /// Joins columns with the directions of their stripes.
    pub(super) fn new(columns: &'a Columns, axes: &'a [Axis]) -> Self {
        let known = (0..columns.is_known.len()).filter(|i| columns.is_known[*i]).collect();
        Self { columns, axes, known }
    }

    /// Finds donors for dark columns, no further away than each axis reaches, if it does at all; columns that have none
    /// along any axis are left out.
    pub(super) fn fill(&self, dark: Vec<usize>, reaches: &[Option<Reach>]) -> Vec<Fill> {
        dark.into_par_iter()
            .filter_map(|column| {
                let of_axis = |(axis, reach): (&Axis, &Option<Reach>)| -> Vec<Donor> {
                    let Some(Reach { way, .. }) = reach else { return Vec::new() };
                    let sides = [1.0, -1.0].map(|sense| self.donors(axis, column, sense, [0.0, *way]));
                    let nth = |i: usize| sides.iter().flatten().map(move |donors| donors[i]);
                    (0..DONORS).flat_map(nth).collect()
                };
                let donors: Vec<Vec<Donor>> = self.axes.iter().zip(reaches).map(of_axis).collect();
                donors.iter().any(|d| !d.is_empty()).then_some(Fill { column, donors })
            })
            .collect()
    }

    /// Walks along the stripe through the middle of a column, and returns the first known columns between `from` and `to`
    /// columns away; `None` if there are too few.
    fn donors(&self, axis: &Axis, column: usize, sense: f32, range: [f32; 2]) -> Option<Vec<Donor>> {
        let mut donors = Vec::with_capacity(DONORS);
        self.walk(axis, column, sense, range, |donor| {
            donors.push(donor);
            donors.len() == DONORS
        })
        .then_some(donors)
    }

    /// Walks along the stripe through the middle of a column and shows the known columns between `from` and `to` columns
    /// away, nearest first, until `is_last` holds for one; returns whether it did.
    fn walk(
        &self,
        axis: &Axis,
        column: usize,
        sense: f32,
        [from, to]: [f32; 2],
        mut is_last: impl FnMut(Donor) -> bool,
    ) -> bool {
        let (mut at, mut way) = (self.columns.middle(column), 0.0);
        let (mut passed, mut last) = (0, column);
        while way < to {
            let t = axis.along(at);
            at = [at[0] + sense * t[0], at[1] + sense * t[1]];
            way += 1.0;
            let Some(here) = self.columns.at(at) else { return false };
            if here == last || way <= from {
                continue;
            }
            last = here;
            if !self.columns.is_known[here] {
                passed = 0;
                continue;
            }
            passed += 1;
            if passed <= SKIPPED {
                continue;
            }
            let place = self.columns.places[here];
            let t = axis.along(at);
            let beside = t[0] * (place[1] - at[1]) - t[1] * (place[0] - at[0]);
            if is_last(Donor { column: here, beside }) {
                return true;
            }
        }
        false
    }

    /// Mean square error of samples carried along the stripes of an axis, per channel of the axis, measured on known
    /// columns from known columns `way` columns away and beyond. `None` where too few can be compared.
    pub(super) fn variance(&self, axis: &Axis, way: f32) -> Option<Vec<f32>> {
        let known = &self.known;
        let one = |i: usize| {
            let column = known[i * 7919 % known.len()];
            let own = self.columns.places[column];
            let middle = self.columns.middle(column);
            let t = axis.along(middle);
            let beside = t[0] * (own[1] - middle[1]) - t[1] * (own[0] - middle[0]);
            let sense = if i.is_multiple_of(2) { 1.0 } else { -1.0 };
            // The nearest may all lie half a column beside it: where stripes are nearly along the columns, and samples in
            // the middle of these.
            let mut donor = None;
            self.walk(axis, column, sense, [way, way + COMPARED_BEYOND], |at| {
                donor = Some(at).filter(|at| (at.beside - beside).abs() < SAME_STRIPE);
                donor.is_some()
            });
            let donor = donor?;
            let of = |column: usize, j: usize| f64::from(self.columns.values[column * self.columns.k + j]);
            Some(axis.channels.iter().map(|j| (of(donor.column, *j) - of(column, *j)).powi(2)).collect::<Vec<_>>())
        };
        let tests = if known.is_empty() { 0 } else { MAX_COMPARED.min(4 * known.len()) };
        let errors: Vec<Vec<f64>> = (0..tests).into_par_iter().filter_map(one).collect();
        if errors.len() < MIN_COMPARED {
            return None;
        }
        let mean = |c: usize| (errors.iter().map(|e| e[c]).sum::<f64>() / errors.len() as f64) as f32;
        Some((0..axis.channels.len()).map(mean).collect())
    }
}
