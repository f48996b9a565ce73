//! The depths that are tried, and where they lie in the lattice.

use crate::lattice::ProjectiveFrame;

/// Depth hypotheses, even in inverse depth: hypothesis l has the inverse depth `first + l · spacing`, so that
/// hypotheses with larger numbers are nearer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthHypotheses {
    /// Inverse depth of the first.
    pub first: f32,
    /// Difference between two neighbors.
    pub spacing: f32,
    /// How many there are.
    pub count: usize,
}

impl DepthHypotheses {
    /// Returns the inverse depth of a hypothesis.
    #[inline(always)]
    pub fn inverse_depth(&self, index: usize) -> f32 {
        self.first + index as f32 * self.spacing
    }

    /// Returns the distance of a hypothesis along a ray that gains `dir_z` of depth per unit of distance.
    #[inline(always)]
    pub fn distance(&self, index: usize, dir_z: f32) -> f32 {
        1.0 / (self.inverse_depth(index) * dir_z)
    }

    /// Returns the first hypothesis and the one behind the last whose distances lie in `[near, far]`.
    pub fn range(&self, [near, far]: [f32; 2], dir_z: f32) -> [u32; 2] {
        let first = self.partition_point(|l| self.distance(l, dir_z) > far);
        let end = self.partition_point(|l| self.distance(l, dir_z) >= near);
        [first as u32, end as u32]
    }

    /// Returns the first hypothesis for which `before`, which holds for those before it, no longer holds.
    fn partition_point(&self, before: impl Fn(usize) -> bool) -> usize {
        let (mut lo, mut hi) = (0, self.count);
        while lo < hi {
            let mid = (lo + hi) / 2;
            if before(mid) { lo = mid + 1 } else { hi = mid }
        }
        lo
    }
}

/// The rays of an image, computed when they are needed: a list of them would be large.
pub trait RaySource: Sync {
    /// Returns the ray of pixel `y · width + x`.
    fn ray(&self, pixel: u32) -> PixelRay;
}

/// The ray of a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PixelRay {
    /// Unit direction of the ray, along the frame's axes.
    pub dir: [f64; 3],
    /// Depth gained per unit of distance.
    pub dir_z: f32,
    /// The pixel's first hypothesis and the one behind its last; all others are outside.
    pub range: [u32; 2],
}

impl PixelRay {
    /// Returns the pixel's hypotheses as a line in unit coordinates: with v the inverse depth, a point at distance
    /// `1 / (v · dir_z)` is `v · dir_z · center + dir` in homogeneous coordinates, which is linear in v.
    pub fn line(&self, frame: &ProjectiveFrame, center: [f64; 3], hypotheses: &DepthHypotheses) -> HypothesisLine {
        let (base, step) = (frame.homogeneous(center, 1.0), frame.homogeneous(self.dir, 0.0));
        let v = |inverse_depth: f32| f64::from(inverse_depth) * f64::from(self.dir_z);
        let start = std::array::from_fn(|c| step[c] + v(hypotheses.first) * base[c]);
        HypothesisLine::new(start, base.map(|b| v(hypotheses.spacing) * b), self.range)
    }
}

/// A pixel's hypotheses in the unit cube: `q(l) = origin + (l − at) · slope / (1 + (l − at) · bend)`, in single
/// precision without cancellation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HypothesisLine {
    /// q of hypothesis `at`.
    pub origin: [f32; 3],
    /// A hypothesis, preferably one of the pixel's.
    pub at: f32,
    /// Derivative of q by the hypothesis there.
    pub slope: [f32; 3],
    /// Relative change per hypothesis of the projective denominator; where that is not positive is outside.
    pub bend: f32,
    /// The pixel's first hypothesis and the one behind its last.
    pub range: [u32; 2],
}

impl HypothesisLine {
    /// The line without hypotheses.
    pub const NONE: Self = Self { origin: [0.0; 3], at: 0.0, slope: [0.0; 3], bend: 0.0, range: [0; 2] };

    /// Returns the line `l ↦ h_0..2 / h_3` with `h = base + l · step`, for the given hypotheses: the first and the one
    /// behind the last. [`Self::NONE`] if there are none, or if all of them lie behind the pole, where h_3 is not
    /// positive.
    pub fn new(base: [f64; 4], step: [f64; 4], range: [u32; 2]) -> Self {
        if range[0] >= range[1] {
            return Self::NONE;
        }
        // From the end that is farther from the pole, numbers only get smaller.
        let denominator = |l: u32| base[3] + f64::from(l) * step[3];
        let [first, last] = [range[0], range[1] - 1];
        let at = if denominator(first) >= denominator(last) { first } else { last };
        let pole = denominator(at);
        if pole <= 0.0 || !pole.is_finite() {
            return Self::NONE;
        }
        let q: [f64; 3] = std::array::from_fn(|i| (base[i] + f64::from(at) * step[i]) / pole);
        Self {
            origin: q.map(|v| v as f32),
            at: at as f32,
            slope: std::array::from_fn(|i| ((step[i] - q[i] * step[3]) / pole) as f32),
            bend: (step[3] / pole) as f32,
            range,
        }
    }
}
