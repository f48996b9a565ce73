use crate::check::{assert_close, assert_gradient, uniform, uniform_f32};
use nelu3d_field::adam::{AdamConfig, Schedule};
use nelu3d_field::encoding::hash_grid::HashGridConfig;
use nelu3d_field::field::{HashFieldConfig, TrainConfig};
use nelu3d_field::loss;
use nelu3d_field::surface::{
    Intervals, NeuralSurface, RayGradient, RayLoss, RayScratch, SurfaceBatch, SurfaceConfig, SurfaceLoss,
    SurfaceLosses, blocks, eikonal_samples, reference,
};

pub(crate) fn config(append_position: bool) -> SurfaceConfig {
    // 2^8 entries: the coarse level is dense, the finer ones hashed.
    let encoding = HashGridConfig {
        n_levels: 3,
        n_features_per_level: 2,
        log2_hashmap_size: 8,
        base_resolution: [3, 4, 3],
        finest_resolution: [12, 10, 15],
    };
    let schedule = Schedule { n_warmup_steps: 0, ..Schedule::default() };
    let field = HashFieldConfig {
        encoding,
        width: 12,
        append_position,
        training: TrainConfig { schedule, ..TrainConfig::default() },
        ..HashFieldConfig::small(1)
    };
    SurfaceConfig {
        field,
        extent: [2.0, 1.5, 3.0],
        sharpness: 0.15,
        sharpness_learning_rate: 1e-3,
        loss: SurfaceLoss { eikonal_every: 2, ..SurfaceLoss::default() },
    }
}

pub(crate) struct Rays {
    pub(crate) offsets: Vec<usize>,
    pub(crate) points: Vec<[f32; 3]>,
    pub(crate) colors: Vec<f32>,
    pub(crate) measured: Vec<f32>,
    pub(crate) white: Vec<f32>,
    pub(crate) ambient: Vec<f32>,
    pub(crate) mask: Vec<f32>,
    /// Lengths and directions of intervals around the samples, if they are midpoints.
    pub(crate) intervals: Option<(Vec<f32>, Vec<[f32; 3]>)>,
}

impl Rays {
    /// Rays along z with these numbers of samples.
    pub(crate) fn new(lengths: &[usize]) -> Self {
        const K: usize = 2;
        let n_rays = lengths.len();
        let mut offsets = vec![0];
        let mut points = Vec::new();
        for (r, &n) in lengths.iter().enumerate() {
            let xy = uniform_f32(100 + r as u64, 2, 0.05, 0.95);
            points.extend((0..n).map(|j| [xy[0], xy[1], (j as f32 + 0.37) / (n as f32 + 0.5)]));
            offsets.push(points.len());
        }
        Self {
            colors: uniform_f32(1, points.len() * K, 0.0, 1.0),
            measured: uniform_f32(2, n_rays * K, 0.0, 1.0),
            white: uniform_f32(3, n_rays * K, 0.2, 1.0),
            ambient: uniform_f32(4, n_rays * K, 0.0, 0.3),
            mask: (0..n_rays).map(|r| (r % 3 > 0) as u8 as f32).collect(),
            offsets,
            points,
            intervals: None,
        }
    }

    /// The samples as midpoints of intervals of different lengths, seen along different directions.
    pub(crate) fn with_intervals(mut self) -> Self {
        let lengths = uniform_f32(6, self.points.len(), 0.02, 0.3);
        let dirs = uniform_f32(7, 3 * self.mask.len(), -1.0, 1.0);
        let unit = |d: &[f32; 3]| d.map(|x| x / (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt());
        self.intervals = Some((lengths, dirs.as_chunks().0.iter().map(unit).collect()));
        self
    }

    pub(crate) fn batch(&self) -> SurfaceBatch<'_> {
        SurfaceBatch {
            offsets: &self.offsets,
            points: &self.points,
            colors: &self.colors,
            measured: &self.measured,
            white: &self.white,
            ambient: &self.ambient,
            mask: &self.mask,
            intervals: self.intervals.as_ref().map(|(lengths, dirs)| Intervals { lengths, dirs, anneal: 0.3 }),
        }
    }
}

/// Random values instead of ±1e-4 in the table, so that nothing is near zero.
pub(crate) fn surface(config: SurfaceConfig) -> NeuralSurface {
    let n = NeuralSurface::new(config.clone(), 1).unwrap().field().params().len();
    NeuralSurface::from_params(config, uniform_f32(5, n, -0.4, 0.4)).unwrap()
}

/// Gradients of the last step: after the first one the first moment is (1 − β1) g.
pub(crate) fn gradients(surface: &NeuralSurface) -> Vec<f32> {
    let moments = surface.field().moments().unwrap();
    let share = 1.0 - AdamConfig::default().beta1 as f32;
    moments.first.iter().map(|m| m / share).collect()
}

#[test]
fn reference_gradients_match_central_differences() {
    for (append, clamped_mask, midpoints) in
        [(false, true, false), (true, false, false), (true, true, true), (true, false, true)]
    {
        let mut config = config(append);
        config.loss.clamped_mask = clamped_mask;
        let (grid, network) = config.field.build().unwrap();
        let mut rays = Rays::new(&[7, 1, 5, 0, 9]);
        if midpoints {
            config.loss.eikonal_every = 1;
            rays = rays.with_intervals();
        }
        let params = uniform(5, grid.n_params() + network.n_params(), -0.4, 0.4);
        let ambient: Vec<f64> = rays.ambient.iter().map(|&a| a as f64).collect();
        let loss = |params: &[f64], v: f64, ambient: &[f64]| {
            reference::loss_and_gradient(&config, &grid, &network, params, v, ambient, &rays.batch()).0.total
        };
        let v = config.sharpness;
        let (_, gradient) = reference::loss_and_gradient(&config, &grid, &network, &params, v, &ambient, &rays.batch());
        // Steps small enough that no unit, clamp or absolute value changes sides.
        assert_gradient(&params, &gradient.params, 1e-6, |p| loss(p, v, &ambient));
        assert_gradient(&[v], &[gradient.sharpness], 1e-6, |v| loss(&params, v[0], &ambient));
        assert_gradient(&ambient, &gradient.ambient, 1e-6, |a| loss(&params, v, a));
    }
}

#[test]
fn a_step_follows_the_reference_gradient() {
    for append in [false, true] {
        for (every, midpoints) in [(0, false), (1, false), (2, false), (8, false), (1, true)] {
            let mut config = config(append);
            config.loss.eikonal_every = every;
            config.loss.clamped_mask = every == 1;
            // More than one chunk of eight blocks, rays longer than a block, empty ones and single samples.
            let lengths: Vec<usize> = (0..150).map(|r| [16, 1, 0, 7, 32][r % 5]).chain([300, 5, 97]).collect();
            let rays = Rays::new(&lengths);
            let rays = if midpoints { rays.with_intervals() } else { rays };
            let mut surface = surface(config.clone());
            let (grid, network) = config.field.build().unwrap();
            let params: Vec<f64> = surface.field().params().iter().map(|&p| p as f64).collect();
            let ambient: Vec<f64> = rays.ambient.iter().map(|&a| a as f64).collect();
            let v = config.sharpness as f32 as f64;
            let (slow, expected) =
                reference::loss_and_gradient(&config, &grid, &network, &params, v, &ambient, &rays.batch());
            let mut d_ambient = vec![0.0; rays.ambient.len()];
            let fast = surface.train_step(&rays.batch(), &mut d_ambient);
            for (a, b) in [
                (fast.total, slow.total),
                (fast.image, slow.image),
                (fast.mask, slow.mask),
                (fast.eikonal, slow.eikonal),
                (fast.sparsity, slow.sparsity),
            ] {
                assert!((a - b).abs() <= 1e-5 * b.abs(), "{fast:?} {slow:?}");
            }
            // A value passes three layers of sums of at most 13 terms and an interpolation of 8, and compositing
            // multiplies its rounding by inv_s = 4.5; a gradient is a sum over about 1500 samples of such values, whose
            // roundings average.
            let tolerance = f32::EPSILON * (3.0 * 13.0 + 8.0) * 4.5 * (1500f32).sqrt() / 30.0;
            let relative = |fast: &[f32], slow: &[f64]| {
                let error: f64 = fast.iter().zip(slow).map(|(&a, &b)| (a as f64 - b).powi(2)).sum();
                let norm: f64 = slow.iter().map(|b| b * b).sum();
                (error / norm).sqrt() as f32
            };
            let fast = gradients(&surface);
            let n_table = grid.n_params();
            for (part, name) in [(0..n_table, "table"), (n_table..fast.len(), "network")] {
                let error = relative(&fast[part.clone()], &expected.params[part]);
                assert!(
                    error <= tolerance,
                    "{name}: {error:e} of {tolerance:e}, every {every}, append {append}, midpoints {midpoints}"
                );
            }
            assert!(relative(&d_ambient, &expected.ambient) <= tolerance);
            let share = 1.0 - AdamConfig::default().beta1 as f32;
            assert!(relative(&[surface.sharpness_moments().first[0] / share], &[expected.sharpness]) <= tolerance);
        }
    }
}

#[test]
fn the_same_bits_on_any_number_of_threads() {
    let lengths: Vec<usize> = (0..400).map(|r| 3 + r % 30).collect();
    let rays = Rays::new(&lengths);
    let run = |n_threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
        pool.install(|| {
            let mut surface = surface(config(true));
            let losses: Vec<_> = (0..5).map(|_| surface.train_step(&rays.batch(), &mut [])).collect();
            (losses, surface.field().params().to_vec(), surface.inv_s())
        })
    };
    let one = run(1);
    for n_threads in [2, 3, 8] {
        assert_eq!(run(n_threads), one);
    }
}

#[test]
fn extremes_stay_finite() {
    let mut config = config(true);
    // inv_s = 1e4 and distances of up to a few units.
    config.sharpness = 1e4f64.ln() / 10.0;
    let mut surface = surface(config);
    let rays = Rays::new(&[0, 1, 2, 40, 0]);
    for _ in 0..20 {
        let losses = surface.train_step(&rays.batch(), &mut []);
        assert!(losses.total.is_finite(), "{losses:?}");
    }
    assert!(surface.field().params().iter().all(|p| p.is_finite()) && surface.inv_s().is_finite());
    // Rays without a single sample, and no rays at all.
    let nothing = Rays::new(&[0, 0]);
    assert!(surface.train_step(&nothing.batch(), &mut []).total.is_finite());
    let before = surface.field().params().to_vec();
    assert_eq!(surface.train_step(&Rays::new(&[]).batch(), &mut []), SurfaceLosses::default());
    assert_eq!(surface.field().params(), before);
}

#[test]
fn blocks_hold_whole_rays() {
    let offsets = [0, 50, 90, 100, 100, 300, 310];
    assert_eq!(blocks(&offsets).collect::<Vec<_>>(), [0..2, 2..4, 4..5, 5..6]);
    assert_eq!(eikonal_samples(&offsets, 40).collect::<Vec<_>>(), [0, 40, 80, 90, 100, 140, 180, 220, 260, 300]);
    assert_eq!(eikonal_samples(&offsets, 0).count(), 0);
    assert_eq!(blocks(&[0]).count(), 0);
}

/// A bumpy wall seen along z, from a plane as the start, by the codewords alone.
#[test]
fn finds_a_surface_from_codewords() {
    let mut config = config(true);
    config.extent = [1.0; 3];
    config.field.encoding = HashGridConfig {
        n_levels: 6,
        n_features_per_level: 2,
        log2_hashmap_size: 14,
        base_resolution: [4; 3],
        finest_resolution: [64; 3],
    };
    config.field.width = 32;
    config.sharpness = 0.35;
    let wall = |x: f32, y: f32| 0.5 + 0.04 * (5.0 * x).sin() * (4.0 * y).cos();
    let code = |z: f32| [0.5 + 0.5 * (8.0 * z).cos(), 0.5 + 0.5 * (8.0 * z + 2.0).cos()];
    let mut surface = NeuralSurface::new(config, 3).unwrap();
    for step in 0..200 {
        let points: Vec<[f32; 3]> = uniform_f32(step, 3 * 512, 0.0, 1.0).as_chunks().0.to_vec();
        let plane: Vec<f32> = points.iter().map(|p| 0.5 - p[2]).collect();
        surface.field_mut().train_step(&points, &plane, &[]);
    }
    for step in 0..300 {
        let mut rays = Rays::new(&[16; 128]);
        rays.ambient.clear();
        rays.mask.fill(1.0);
        let xy = uniform_f32(1000 + step, 256, 0.0, 1.0);
        for r in 0..128 {
            let (x, y) = (xy[2 * r], xy[2 * r + 1]);
            rays.measured[2 * r..][..2].copy_from_slice(&code(wall(x, y)));
            for j in 0..16 {
                let z = 0.4 + 0.2 * (j as f32 + 0.5) / 16.0;
                rays.points[16 * r + j] = [x, y, z];
                // The quadrature takes a sample's codeword for the interval behind it.
                rays.colors[2 * (16 * r + j)..][..2].copy_from_slice(&code(z + 0.2 / 32.0));
            }
        }
        surface.train_step(&rays.batch(), &mut []);
    }
    let xy: Vec<[f32; 2]> = uniform_f32(7, 400, 0.1, 0.9).as_chunks().0.to_vec();
    let points: Vec<[f32; 3]> = xy.iter().map(|&[x, y]| [x, y, wall(x, y)]).collect();
    let mut distance = vec![0.0; points.len()];
    surface.field().query(&points, &mut distance);
    let mean = distance.iter().map(|d| d.abs()).sum::<f32>() / 200.0;
    // The plane is off by 0.018 on average.
    assert!(mean < 0.003, "{mean}");
    assert_close(&[distance.iter().sum::<f32>() / 200.0], &[0.0], 0.002);
}

/// The eikonal loss, written as if it were an image formation's.
struct Unit {
    n: usize,
}

impl RayLoss for Unit {
    fn needs_gradients(&self) -> bool {
        true
    }

    fn n_ray_outputs(&self) -> usize {
        1
    }

    fn n_sample_outputs(&self) -> usize {
        2
    }

    fn ray(&self, r: usize, sdf: &[f32], g: &[[f32; 3]], _: f64, _: &mut RayScratch, out: RayGradient<'_>) {
        out.d_sdf.fill(0.0);
        for (j, g) in g.iter().enumerate() {
            let mut slope = [[0.0; 3]];
            let value = loss::cpu::eikonal(&[*g], &mut slope);
            out.losses.image += value / self.n as f64;
            out.d_gradients[j] = slope[0].map(|s| s / self.n as f32);
            out.samples[2 * j] = r as f32;
            out.samples[2 * j + 1] = sdf[j];
        }
        out.ray[0] = sdf.len() as f32;
    }
}

#[test]
fn a_loss_of_ones_own_sees_gradients_and_sends_them_back() {
    let lengths: Vec<usize> = (0..150).map(|r| [16, 1, 0, 7, 32][r % 5]).chain([300, 5, 97]).collect();
    let rays = Rays::new(&lengths);
    let n = rays.points.len();
    let mut config = config(true);
    // Nothing but L_eik, once as the engine's and once as a ray loss.
    config.loss = SurfaceLoss { eikonal_weight: 0.0, mask_weight: 0.0, sparsity_weight: 0.0, ..config.loss };
    config.loss.eikonal_every = 1;
    let mut own = surface(config.clone());
    let (mut per_ray, mut per_sample) = (vec![0.0; lengths.len()], vec![0.0; 2 * n]);
    let found = own.step(&rays.offsets, &rays.points, &Unit { n }, &mut per_ray, &mut per_sample);
    struct Nothing;
    impl RayLoss for Nothing {
        fn needs_gradients(&self) -> bool {
            false
        }
        fn n_ray_outputs(&self) -> usize {
            0
        }
        fn n_sample_outputs(&self) -> usize {
            0
        }
        fn ray(&self, _: usize, _: &[f32], _: &[[f32; 3]], _: f64, _: &mut RayScratch, out: RayGradient<'_>) {
            out.d_sdf.fill(0.0);
        }
    }
    config.loss.eikonal_weight = 1.0;
    let mut engine = surface(config);
    let expected = engine.step(&rays.offsets, &rays.points, &Nothing, &mut [], &mut []);
    assert!((found.image - expected.eikonal).abs() < 1e-6 * expected.eikonal, "{found:?} {expected:?}");
    assert_close(&gradients(&own), &gradients(&engine), 64.0 * f32::EPSILON);
    // What it sends back arrives where it belongs.
    for (r, n) in lengths.iter().enumerate() {
        assert_eq!(per_ray[r], *n as f32);
        assert!((rays.offsets[r]..rays.offsets[r + 1]).all(|j| per_sample[2 * j] == r as f32));
    }
    let mut sdf = vec![0.0; n];
    surface(engine.config().clone()).field().query(&rays.points, &mut sdf);
    let sent: Vec<f32> = per_sample.iter().skip(1).step_by(2).copied().collect();
    assert_close(&sent, &sdf, 64.0 * f32::EPSILON);
}
