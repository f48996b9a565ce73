use nelu3d::reconstruct::refine::smoothed_away::smoothed_away;
use nelu3d::reconstruct::refine::thin_plate::ThinPlatePrior;
use nelu3d::reconstruct::refine::uncertainty::{Information, Posterior};
use nelu3d_field::plate::PlateStop;
use nelu3d_field::plate::reference::solve;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};

/// A surface over the pixels of `active`, measured with noise of variance 1/h.
struct Measured {
    width: usize,
    active: Vec<bool>,
    expected: Vec<f32>,
    h: Vec<f32>,
}

impl Measured {
    fn new(width: usize, is_active: impl Fn(f32) -> bool, surface: impl Fn(f32) -> f32, h: f32) -> Self {
        let middle = (width / 2) as f32;
        let radius = |i: usize| ((i % width) as f32 - middle).hypot((i / width) as f32 - middle);
        let ring = |i: usize| [i % width, i / width].iter().any(|v| *v == 0 || v + 1 == width);
        let n = width * width;
        let active: Vec<bool> = (0..n).map(|i| !ring(i) && is_active(radius(i))).collect();
        let of = |i: usize, v: f32| if active[i] { v } else { 0.0 };
        let expected = (0..n).map(|i| of(i, surface(radius(i)))).collect();
        let h = (0..n).map(|i| of(i, h)).collect();
        Self { width, active, expected, h }
    }

    /// Returns the prior of the surface, and the solution under a noise.
    fn solved(&self, seed: u64) -> (ThinPlatePrior, Vec<f32>) {
        let n = self.active.len();
        let mut rng = rand::rngs::StdRng::seed_from_u64(seed);
        let noise: Vec<f32> = (0..n).map(|_| StandardNormal.sample(&mut rng)).collect();
        let g: Vec<f32> = (0..n).map(|i| -self.h[i] * self.expected[i] - self.h[i].sqrt() * noise[i]).collect();
        let mut prior = ThinPlatePrior::new(self.width, self.width, self.active.clone());
        let mut x = vec![0.0; n];
        // The prior takes its weights from the surface that it makes, as in the refinement.
        let until = PlateStop { reduction: 1e-5, settled: 0.0, iterations: 2000 };
        for _ in 0..4 {
            prior.reweight(&x, 0.1, 0.5, 3);
            x = solve(&prior.system(&self.h, &g), &vec![0.0; n], until).0.into_iter().map(|v| v as f32).collect();
        }
        (prior, x)
    }

    /// Returns the variance from noise of what is found to be smoothed away.
    fn noise(&self, prior: &ThinPlatePrior) -> Vec<f32> {
        let information: Vec<Information> = self.h.iter().map(|h| Information::plain(*h, 1.0)).collect();
        Posterior::new(prior, &information).smoothed_away
    }

    fn rms(&self, v: impl Fn(usize) -> f32, is_counted: impl Fn(f32) -> bool) -> f32 {
        let middle = (self.width / 2) as f32;
        let counted = |i: &usize| {
            let (x, y) = ((i % self.width) as f32 - middle, (i / self.width) as f32 - middle);
            self.active[*i] && is_counted(x.hypot(y))
        };
        let squares: Vec<f32> = (0..self.active.len()).filter(counted).map(|i| v(i).powi(2)).collect();
        (squares.iter().sum::<f32>() / squares.len() as f32).sqrt()
    }
}

/// Where a ball bends out of sight, part of what the prior takes is given back; in its middle nothing changes.
#[test]
fn a_ball_gets_back_where_it_bends_out_of_sight() {
    let ball = |r: f32| 0.6 * (51.0f32.powi(2) - r * r).max(0.0).sqrt();
    let measured = Measured::new(110, |r| r < 48.5, ball, 10.0);
    let (prior, x) = measured.solved(4);
    let away = smoothed_away(&prior, &measured.h, &x, &measured.noise(&prior));
    let (before, after) =
        (|i: usize| x[i] - measured.expected[i], |i: usize| x[i] + away.change[i] - measured.expected[i]);
    let edge = |r: f32| r > 43.0;
    let (at_edge, left) = (measured.rms(before, edge), measured.rms(after, edge));
    assert!(left < 0.9 * at_edge, "{at_edge} {left}");
    let inside = |r: f32| r < 35.0;
    let (middle, still) = (measured.rms(before, inside), measured.rms(after, inside));
    assert!((still / middle - 1.0).abs() < 0.03, "{middle} {still}");
    let [claimed, beside] =
        [measured.rms(|i| away.variance[i].sqrt(), edge), measured.rms(|i| away.variance[i].sqrt(), inside)];
    assert!(claimed > 5.0 * beside, "{claimed} {beside}");
}

/// Where a plane is measured with noise, nothing is given back: noise alone makes as much of a second smoothing.
#[test]
fn noise_is_not_given_back() {
    let measured = Measured::new(120, |_| true, |r| 0.0 * r, 2.0);
    let (prior, x) = measured.solved(8);
    let inside = |r: f32| r < 50.0;
    let all = smoothed_away(&prior, &measured.h, &x, &vec![0.0; x.len()]);
    let noise = measured.noise(&prior);
    let (found, expected) = (measured.rms(|i| all.change[i], inside), measured.rms(|i| noise[i].sqrt(), inside));
    assert!((found / expected - 1.0).abs() < 0.1, "{found} {expected}");
    let away = smoothed_away(&prior, &measured.h, &x, &noise);
    let (given_back, error) = (measured.rms(|i| away.change[i], inside), measured.rms(|i| x[i], inside));
    assert!(given_back < 0.1 * error, "{given_back} of {error}");
}
