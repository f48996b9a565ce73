//! The narrow bands of all pixels: c across the surface along every ray, evaluated anew only where the surface has
//! moved.
//!
//! Along a ray, c is its value, slope and bend at the last place where it was looked up. As long as the surface stays
//! near it, and the band is narrow, a quadrature of that is exact to the third order; a wider band is sampled.

use nelu3d_field::bench::Demand;
use nelu3d_field::lattice::{CurvePoint, Lattice, ProjectiveLine};
use rayon::prelude::*;

use super::band::quadrature;
use crate::color_field::SplineEvaluator;

/// Distance from the last place, cells of the spline, beyond which c is evaluated anew.
const NEAR: f32 = 0.1;
/// Standard deviation of the band, cells of the spline, up to which c is a parabola across it.
const NARROW: f32 = 0.1;

/// A pixel's ray, and where c was evaluated on it.
#[derive(Clone, Copy, Default)]
struct Band {
    /// The ray by the unknown, from where the surface was at first.
    line: ProjectiveLine,
    /// The unknown there.
    begin: f32,
    /// The unknown where c was evaluated last; NaN before that.
    at: f32,
    /// Cells of the spline per unit of the unknown.
    speed: f32,
}

/// The bands of a window's active pixels, in their order: of a large window they may be a small part.
pub struct Bands {
    width: usize,
    k: usize,
    /// Where the bands of every row begin, and where those of the last end.
    starts: Vec<usize>,
    bands: Vec<Band>,
    /// Value, slope and bend of c by the unknown, `3 k` of every band.
    jets: Vec<f32>,
}

/// The bands of a row, and where they are rendered to.
struct RowOfBands<'a> {
    y: usize,
    bands: &'a mut [Band],
    jets: &'a mut [f32],
    out: &'a mut [f32],
}

impl Bands {
    /// Prepares the rays of the active pixels of a window of some width: `line` gives a pixel's by the unknown, from
    /// `x` on.
    pub fn new(
        width: usize,
        k: usize,
        active: &[bool],
        x: &[f32],
        line: impl Fn(usize) -> ProjectiveLine + Sync,
    ) -> Self {
        let on: Vec<usize> = (0..active.len()).filter(|i| active[*i]).collect();
        let band = |i: &usize| Band { line: line(*i), begin: x[*i], at: f32::NAN, speed: 0.0 };
        let bands: Vec<Band> = on.par_iter().with_min_len(width).map(band).collect();
        let starts = (0..=active.len() / width).map(|y| on.partition_point(|i| *i < y * width)).collect();
        let jets = vec![0.0; on.len() * 3 * k];
        Self { width, k, starts, bands, jets }
    }

    /// Forgets all bands.
    pub(super) fn clear(&mut self) {
        (self.bands, self.jets) = (Vec::new(), Vec::new());
        self.starts.fill(0);
    }

    /// Divides the bands, and what is rendered of every pixel, by rows.
    fn rows<'a>(&'a mut self, rendered: &'a mut [f32]) -> Vec<RowOfBands<'a>> {
        let k = self.k;
        let (mut bands, mut jets) = (&mut self.bands[..], &mut self.jets[..]);
        let mut rows = Vec::with_capacity(self.starts.len() - 1);
        for (y, out) in rendered.chunks_exact_mut(2 * k * self.width).enumerate() {
            let n = self.starts[y + 1] - self.starts[y];
            let (own_bands, own_jets);
            (own_bands, bands) = bands.split_at_mut(n);
            (own_jets, jets) = jets.split_at_mut(n * 3 * k);
            rows.push(RowOfBands { y, bands: own_bands, jets: own_jets, out });
        }
        rows
    }

    /// Renders the band of every active pixel into `rendered`, `n × 2 k`: c and its slope by the unknown. `spread`
    /// returns a pixel's width 1/inv_s along its ray, in units of the unknown. Returns what that asks of the machine.
    pub fn render(
        &mut self,
        spline: &SplineEvaluator<'_>,
        active: &[bool],
        x: &[f32],
        spread: impl Fn(usize) -> f32 + Sync,
        rendered: &mut [f32],
    ) -> Demand {
        let (w, k, lattice) = (self.width, self.k, spline.lattice());
        let quadrature = quadrature();
        let deviation = quadrature.iter().map(|(offset, weight)| weight * offset * offset).sum::<f32>().sqrt();
        let evaluated: usize = self
            .rows(rendered)
            .into_par_iter()
            .map_init(Row::default, |row, RowOfBands { y, bands, jets, out }| {
                row.clear();
                row.pixels.extend((y * w..(y + 1) * w).filter(|i| active[*i]));
                for (rank, band) in bands.iter_mut().enumerate() {
                    let i = row.pixels[rank];
                    let spread = spread(i);
                    row.variances.push((spread * deviation).powi(2));
                    row.look_up(rank, band, x[i], [spread, spread * deviation], &lattice);
                }
                row.evaluate(&lattice, jets);
                for ((i, variance), (band, jet)) in
                    row.pixels.iter().zip(&row.variances).zip(bands.iter().zip(jets.chunks_exact(3 * k)))
                {
                    let j = i - y * w;
                    integrate(band, jet, x[*i], *variance, &mut out[j * 2 * k..(j + 1) * 2 * k]);
                }
                row.looked_up.len() + row.sample_wide(&lattice, &quadrature, bands, x, y * w, out)
            })
            .sum();
        let (n, k) = (self.bands.len() as f64, k as f64);
        // Of every pixel its ray, its parabola, and what is rendered.
        let bytes = n * 4.0 * (10.0 + 3.0 * k + 2.0 * 2.0 * k);
        let flops = evaluated as f64 * lattice.flops_of_jet() + n * (30.0 + 8.0 * k);
        Demand { flops, bytes, ..Demand::default() }
    }
}

/// What is to be evaluated for the pixels of one row.
#[derive(Default)]
struct Row {
    /// The row's active pixels. They are told apart by their places among them.
    pixels: Vec<usize>,
    points: Vec<CurvePoint>,
    /// The pixels of the points.
    looked_up: Vec<usize>,
    jets: Vec<f32>,
    /// Variances of the bands of the row's active pixels, squared units of the unknown.
    variances: Vec<f32>,
    /// Pixels whose bands are wide, and their widths.
    wide: Vec<(usize, f32)>,
}

impl Row {
    fn clear(&mut self) {
        self.pixels.clear();
        self.points.clear();
        self.looked_up.clear();
        self.variances.clear();
        self.wide.clear();
    }

    /// Notes a pixel whose c is to be evaluated anew. `spread` is the width of its band, and the band's standard
    /// deviation.
    fn look_up(&mut self, rank: usize, band: &mut Band, x: f32, spread: [f32; 2], lattice: &Lattice<'_>) {
        if band.at.is_nan() {
            band.speed = cells_per_unit(&band.line.at(x - band.begin), lattice);
        }
        if spread[1] * band.speed > NARROW {
            self.wide.push((rank, spread[0]));
        } else if band.at.is_nan() || (x - band.at).abs() * band.speed > NEAR {
            let point = band.line.at(x - band.begin);
            (band.at, band.speed) = (x, cells_per_unit(&point, lattice));
            self.points.push(point);
            self.looked_up.push(rank);
        }
    }

    /// Evaluates c where it was noted.
    fn evaluate(&mut self, lattice: &Lattice<'_>, jets: &mut [f32]) {
        let n = 3 * lattice.k;
        self.jets.resize(self.points.len() * n, 0.0);
        lattice.eval_jets(&self.points, &mut self.jets);
        for (rank, jet) in self.looked_up.iter().zip(self.jets.chunks_exact(n)) {
            jets[rank * n..(rank + 1) * n].copy_from_slice(jet);
        }
    }

    /// Samples the wide bands, which were noted; returns the number of samples.
    fn sample_wide(
        &mut self,
        lattice: &Lattice<'_>,
        quadrature: &[(f32, f32)],
        bands: &[Band],
        x: &[f32],
        first: usize,
        out: &mut [f32],
    ) -> usize {
        let k = lattice.k;
        self.points.clear();
        for (rank, spread) in &self.wide {
            let (band, x) = (&bands[*rank], x[self.pixels[*rank]]);
            // Farther along the ray is a smaller inverse depth.
            let at = |offset: f32| band.line.at(x - band.begin - offset * spread);
            self.points.extend(quadrature.iter().map(|(offset, _)| at(*offset)));
        }
        self.jets.resize(self.points.len() * 3 * k, 0.0);
        lattice.eval_jets(&self.points, &mut self.jets);
        for ((rank, _), jets) in self.wide.iter().zip(self.jets.chunks_exact(quadrature.len() * 3 * k)) {
            let column = self.pixels[*rank] - first;
            let out = &mut out[column * 2 * k..(column + 1) * 2 * k];
            out.fill(0.0);
            for ((_, weight), jet) in quadrature.iter().zip(jets.chunks_exact(3 * k)) {
                out.iter_mut().zip(jet).for_each(|(out, v)| *out += weight * v);
            }
        }
        self.points.len()
    }
}

/// Integrates the parabola over a band, where there is one.
fn integrate(band: &Band, jet: &[f32], x: f32, variance: f32, out: &mut [f32]) {
    if band.at.is_nan() {
        return;
    }
    let (k, by) = (out.len() / 2, x - band.at);
    let (c, rest) = jet.split_at(k);
    let (d, e) = rest.split_at(k);
    let (value, slope) = out.split_at_mut(k);
    for j in 0..k {
        value[j] = c[j] + by * d[j] + 0.5 * (by * by + variance) * e[j];
        slope[j] = d[j] + by * e[j];
    }
}

/// Returns by how many cells of the spline the point moves per unit of the curve's parameter.
fn cells_per_unit(point: &CurvePoint, lattice: &Lattice<'_>) -> f32 {
    (0..3).map(|i| (point.dq[i] * lattice.cells[i] as f32).powi(2)).sum::<f32>().sqrt()
}
