//! A spline along curves: its value, its slope, and its bend, for many points.

use pulp::{Arch, Simd, WithSimd};

use super::lanes::{
    LANES, Lanes, Place, SUMS, first_node, of_lane, offsets, place, slopes_of, store, sum_over_w, three_sums_over_ab,
    weights_of,
};
use super::many::{self, GROUP, Sums};
use super::view::Lattice;

/// A point of a curve through the unit cube, with its first two derivatives by the curve's parameter.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CurvePoint {
    /// Unit coordinates (clamped to the cube).
    pub q: [f32; 3],
    /// First derivative.
    pub dq: [f32; 3],
    /// Second derivative.
    pub ddq: [f32; 3],
}

/// A straight line through the unit cube as a projective map sees it: q(s) = origin + s · slope / (1 + s · bend), in
/// single precision without cancellation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ProjectiveLine {
    /// q at s = 0.
    pub origin: [f32; 3],
    /// Derivative of q by s there.
    pub slope: [f32; 3],
    /// Relative change of the projective denominator per s.
    pub bend: f32,
}

impl ProjectiveLine {
    /// Returns the line `s ↦ h_0..2 / h_3` with `h = base + s · step`. Where h_3 is not positive it is far outside.
    pub fn new(base: [f64; 4], step: [f64; 4]) -> Self {
        let pole = base[3].max(1e-6);
        let q: [f64; 3] = std::array::from_fn(|i| base[i] / pole);
        Self {
            origin: q.map(|v| v as f32),
            slope: std::array::from_fn(|i| ((step[i] - q[i] * step[3]) / pole) as f32),
            bend: (step[3] / pole) as f32,
        }
    }

    /// Returns the point at `s`.
    #[inline(always)]
    pub fn at(&self, s: f32) -> CurvePoint {
        let u = 1.0 / (1.0 + s * self.bend).max(1e-6);
        CurvePoint {
            q: std::array::from_fn(|i| self.origin[i] + s * u * self.slope[i]),
            dq: self.slope.map(|v| v * u * u),
            ddq: self.slope.map(|v| -2.0 * self.bend * v * u * u * u),
        }
    }
}

impl Lattice<'_> {
    /// Floating-point operations of [`Self::eval_jets`] for one point: weights of three axes, their products, three
    /// sums over the nodes, six along w.
    pub fn flops_of_jet(&self) -> f64 {
        let k = self.k as f64;
        3.0 * 85.0 + 16.0 * 10.0 + 3.0 * 128.0 * k + 6.0 * 8.0 * k
    }

    /// Evaluates the spline and its first two derivatives by the parameter of curves at their points, into `out`, `3 k`
    /// values a point: k values, k slopes, k bends.
    ///
    /// # Panics
    ///
    /// If a length does not fit.
    pub fn eval_jets(&self, points: &[CurvePoint], out: &mut [f32]) {
        self.check();
        assert_eq!(out.len(), points.len() * 3 * self.k);
        match self.k {
            1 => Arch::new().dispatch(Jets::<1> { lattice: *self, points, out }),
            2 => Arch::new().dispatch(Jets::<2> { lattice: *self, points, out }),
            3 => Arch::new().dispatch(Jets::<3> { lattice: *self, points, out }),
            4 => Arch::new().dispatch(Jets::<4> { lattice: *self, points, out }),
            5 => Arch::new().dispatch(Jets::<5> { lattice: *self, points, out }),
            6 => Arch::new().dispatch(Jets::<6> { lattice: *self, points, out }),
            _ => Arch::new().dispatch(ManyJets { lattice: *self, points, out }),
        }
    }

    /// Evaluates one point plainly; see [`Self::eval_jets`].
    pub fn eval_jet(&self, point: &CurvePoint, out: &mut [f32]) {
        let mut lanes = [[0.0; LANES]; 3];
        (0..3).for_each(|i| lanes[i][0] = point.q[i]);
        let places = [0, 1, 2].map(|i| place(&lanes[i], self.cells[i]));
        let first = first_node(self, places.each_ref(), 0);
        let [na, _, nw] = self.n_nodes();
        let [a, b, w] = [0, 1, 2].map(|i| {
            let [v, d, e] =
                AxisWeights::new(&places[i]).along(&[[point.dq[i]; LANES], [point.ddq[i]; LANES]], self.cells[i]);
            [0, 1, 2, 3].map(|n| [v[n][0], d[n][0], e[n][0]])
        });
        out.fill(0.0);
        for (j, b) in b.iter().enumerate() {
            for (i, a) in a.iter().enumerate() {
                for (l, w) in w.iter().enumerate() {
                    let value = a[0] * b[0] * w[0];
                    let slope = a[1] * b[0] * w[0] + a[0] * b[1] * w[0] + a[0] * b[0] * w[1];
                    let straight = a[2] * b[0] * w[0] + a[0] * b[2] * w[0] + a[0] * b[0] * w[2];
                    let mixed = a[1] * b[1] * w[0] + a[1] * b[0] * w[1] + a[0] * b[1] * w[1];
                    let node = &self.nodes[first + ((j * na + i) * nw + l) * self.k..][..self.k];
                    for (c, node) in node.iter().enumerate() {
                        out[c] += value * node;
                        out[self.k + c] += slope * node;
                        out[2 * self.k + c] += (straight + 2.0 * mixed) * node;
                    }
                }
            }
        }
    }
}

/// The weights of four nodes along one axis, with their derivatives by the position in the cell.
struct AxisWeights {
    value: [Lanes; 4],
    slope: [Lanes; 4],
    bend: [Lanes; 4],
}

impl AxisWeights {
    #[inline(always)]
    fn new(place: &Place) -> Self {
        let [slope, bend] = slopes_of(&place.position);
        Self { value: weights_of(&place.position), slope, bend }
    }

    /// Returns weights, and their first two derivatives by the parameter of curves with the given derivatives of q.
    #[inline(always)]
    fn along(&self, [dq, ddq]: &[Lanes; 2], cells: usize) -> [[Lanes; 4]; 3] {
        let (mut d, mut e) = ([[0.0; LANES]; 4], [[0.0; LANES]; 4]);
        let cells = cells as f32;
        for n in 0..4 {
            for l in 0..LANES {
                let speed = dq[l] * cells;
                d[n][l] = self.slope[n][l] * speed;
                e[n][l] = self.bend[n][l] * speed * speed + self.slope[n][l] * ddq[l] * cells;
            }
        }
        [self.value, d, e]
    }
}

struct Jets<'a, const K: usize> {
    lattice: Lattice<'a>,
    points: &'a [CurvePoint],
    out: &'a mut [f32],
}

impl<const K: usize> WithSimd for Jets<'_, K> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { lattice, points, out } = self;
        for (points, out) in points.chunks(LANES).zip(out.chunks_mut(LANES * 3 * K)) {
            some_jets::<S, K>(&lattice, points, out);
        }
    }
}

/// The weights of points side by side, with their first two derivatives along curves.
struct Weights {
    places: [Place; 3],
    /// Weights of the 16 rows of nodes, `[4 j + i]`.
    ab: [[Lanes; 16]; 3],
    /// Weights along w.
    w: [[Lanes; 4]; 3],
}

impl Weights {
    /// Returns the weights of at most [`LANES`] points.
    #[inline(always)]
    fn of(lattice: &Lattice<'_>, points: &[CurvePoint]) -> Self {
        let (mut q, mut dq, mut ddq) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3], [[0.0; LANES]; 3]);
        for (l, point) in points.iter().enumerate() {
            for i in 0..3 {
                q[i][l] = point.q[i];
                dq[i][l] = point.dq[i];
                ddq[i][l] = point.ddq[i];
            }
        }
        let places = [place(&q[0], lattice.cells[0]), place(&q[1], lattice.cells[1]), place(&q[2], lattice.cells[2])];
        let a = AxisWeights::new(&places[0]).along(&[dq[0], ddq[0]], lattice.cells[0]);
        let b = AxisWeights::new(&places[1]).along(&[dq[1], ddq[1]], lattice.cells[1]);
        let w = AxisWeights::new(&places[2]).along(&[dq[2], ddq[2]], lattice.cells[2]);
        let mut ab = [[[0.0; LANES]; 16]; 3];
        for j in 0..4 {
            for i in 0..4 {
                for l in 0..LANES {
                    ab[0][4 * j + i][l] = a[0][i][l] * b[0][j][l];
                    ab[1][4 * j + i][l] = a[1][i][l] * b[0][j][l] + a[0][i][l] * b[1][j][l];
                    ab[2][4 * j + i][l] =
                        a[2][i][l] * b[0][j][l] + 2.0 * a[1][i][l] * b[1][j][l] + a[0][i][l] * b[2][j][l];
                }
            }
        }
        Self { places, ab, w }
    }
}

/// Evaluates at most [`LANES`] points.
#[inline(always)]
fn some_jets<S: Simd, const K: usize>(lattice: &Lattice<'_>, points: &[CurvePoint], out: &mut [f32]) {
    let Weights { places, ab, w } = Weights::of(lattice, points);
    let offsets = offsets(lattice);
    let mut stored = [[[0.0f32; SUMS]; 3]; LANES];
    for l in 0..points.len() {
        let first = first_node(lattice, places.each_ref(), l);
        let sums = three_sums_over_ab::<S, K>(lattice.nodes, first, &offsets, &ab, l);
        for m in 0..3 {
            store(&sums[m], &mut stored[l][m]);
        }
    }
    for (l, out) in out.chunks_exact_mut(3 * K).enumerate() {
        let [v, d, e] = [of_lane(&w[0], l), of_lane(&w[1], l), of_lane(&w[2], l)];
        let [s, ds, dds] = &stored[l];
        let value = sum_over_w::<S, K>(s, v);
        let (d0, d1) = (sum_over_w::<S, K>(s, d), sum_over_w::<S, K>(ds, v));
        let (e0, e1, e2) = (sum_over_w::<S, K>(s, e), sum_over_w::<S, K>(ds, d), sum_over_w::<S, K>(dds, v));
        for c in 0..K {
            out[c] = value[c];
            out[K + c] = d0[c] + d1[c];
            out[2 * K + c] = e0[c] + 2.0 * e1[c] + e2[c];
        }
    }
}

/// Points with more than six channels.
struct ManyJets<'a> {
    lattice: Lattice<'a>,
    points: &'a [CurvePoint],
    out: &'a mut [f32],
}

impl WithSimd for ManyJets<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        let Self { lattice, points, out } = self;
        let k = lattice.k;
        let (offsets, mut sums) = (offsets(&lattice), Sums::<3>::default());
        sums.resize(k);
        let mut jet = vec![0.0; many::room(k)];
        for (points, out) in points.chunks(LANES).zip(out.chunks_mut(LANES * 3 * k)) {
            let Weights { places, ab, w } = Weights::of(&lattice, points);
            for begin in (0..points.len()).step_by(GROUP) {
                let group = begin..(begin + GROUP).min(points.len());
                for l in group.clone() {
                    let first = first_node(&lattice, places.each_ref(), l);
                    sums.set::<S>(l - begin, lattice.nodes, first, &offsets, &ab, l);
                }
                for l in group {
                    let [s, ds, dds] = [0, 1, 2].map(|m| sums.get(l - begin, m));
                    let [v, d, e] = [of_lane(&w[0], l), of_lane(&w[1], l), of_lane(&w[2], l)];
                    let (value, rest) = out[l * 3 * k..(l + 1) * 3 * k].split_at_mut(k);
                    let (slope, bend) = rest.split_at_mut(k);
                    many::sum_over_w::<S, _>(k, [(s, v)], &mut jet);
                    value.copy_from_slice(&jet[..k]);
                    many::sum_over_w::<S, _>(k, [(s, d), (ds, v)], &mut jet);
                    slope.copy_from_slice(&jet[..k]);
                    many::sum_over_w::<S, _>(k, [(s, e), (ds, d.map(|d| 2.0 * d)), (dds, v)], &mut jet);
                    bend.copy_from_slice(&jet[..k]);
                }
            }
        }
    }
}
