//! One iteration: draw rays from the camera (and the projector), look everything up, step all optimizers.

use nelu3d_field::HashField;
use nelu3d_field::occupancy::OccupancyGrid;
use nelu3d_field::state::TrainingState;
use nelu3d_field::surface::{NeuralSurface, RayGradient, RayLoss, RayScratch, SurfaceLoss, SurfaceLosses};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;

use super::blur::Blur;
use super::options::TurboSlOptions;
use super::ray::{self, Along, Gradient, Kind, Weights};
use super::scene::TurboSlScene;
use nelu3d::reconstruct::neural::config;
use nelu3d::reconstruct::neural::importance;
use nelu3d::reconstruct::neural::march::{March, RaySamples};
use nelu3d_field::volrend::midpoint::MidpointRay;

/// Everything that is learned.
pub(crate) struct Model {
    pub(super) surface: NeuralSurface,
    /// Per camera pixel, in [0, 1].
    pub(super) albedo: HashField<2>,
    /// Per camera pixel, in [0, 1].
    pub(super) ambient: HashField<2>,
    /// Along x and y of the projected image.
    pub(super) blur: [Blur; 2],
}

/// The rays of one iteration, and what is known of their samples.
struct Batch {
    samples: RaySamples,
    marches: Vec<March>,
    /// Camera rays come first.
    n_camera: usize,
    /// Masks of the camera rays, 0 or 1.
    masks: Vec<f32>,
    /// Unit directions to the light, per sample.
    light: Vec<[f32; 3]>,
    /// Per sample: blurred patterns (of camera rays) or captures (of projector rays), k values.
    values: Vec<f32>,
    /// Per sample of a camera ray: place in the projected image. Per sample of a projector ray: place in the camera's.
    places: Vec<[f32; 2]>,
    /// Per ray: captures (of camera rays) or blurred patterns (of projector rays), k values.
    wanted: Vec<f32>,
}

impl Model {
    /// Initializes everything that is learned.
    pub(super) fn new(scene: &TurboSlScene<'_>, opts: &TurboSlOptions) -> Self {
        let loss = SurfaceLoss { mask_weight: config::MASK_WEIGHT, ..SurfaceLoss::default() };
        let image_field = |seed| {
            let config = config::image_field_config(scene.n_channels, opts.steps);
            HashField::new(config, seed).expect("the published configuration is valid")
        };
        Self {
            surface: opts.start.surface(config::surface_config(loss, opts.steps), opts.seed),
            albedo: image_field(opts.seed.wrapping_add(1)),
            ambient: image_field(opts.seed.wrapping_add(2)),
            blur: [Blur::new(), Blur::new()],
        }
    }

    /// Returns what a checkpoint holds, in its order.
    pub(super) fn parts<'a>(&'a self, grid: &'a OccupancyGrid) -> [&'a dyn TrainingState; 6] {
        [&self.surface, &self.albedo, &self.ambient, &self.blur[0], &self.blur[1], grid]
    }

    /// Returns what a checkpoint holds, in its order, to be read.
    pub(super) fn parts_mut<'a>(&'a mut self, grid: &'a mut OccupancyGrid) -> [&'a mut dyn TrainingState; 6] {
        let [x, y] = &mut self.blur;
        [&mut self.surface, &mut self.albedo, &mut self.ambient, x, y, grid]
    }

    /// One step; half of the `n_rays` are the projector's unless `reverse` is `None`, and their image loss has that
    /// weight. A ray has at most `per_ray` samples; `None` marches. Returns the losses and the number of samples.
    pub(crate) fn step(
        &mut self,
        scene: &TurboSlScene<'_>,
        grid: &OccupancyGrid,
        n_rays: usize,
        per_ray: Option<usize>,
        reverse: Option<f32>,
        anneal: f32,
        seed: u64,
    ) -> (SurfaceLosses, usize) {
        let c = scene.n_channels;
        let blurred = scene.shown.blurred(&self.blur);
        let (batch, drawn) = draw(scene, grid, &self.surface, n_rays, per_ray, reverse.is_some(), &blurred, seed);

        // Albedo and ambient: of a camera ray's pixel, and of every sample of a projector ray.
        let first = batch.samples.offsets[batch.n_camera];
        let pixel = |i: usize| [(i % scene.camera.width) as f32, (i / scene.camera.width) as f32];
        let mut places: Vec<[f32; 2]> = drawn[..batch.n_camera].iter().map(|&i| scene.place(pixel(i))).collect();
        places.extend(batch.places[first..].iter().map(|&p| scene.place(p)));
        let (mut albedo, mut ambient) = (vec![0.0; places.len() * c], vec![0.0; places.len() * c]);
        self.albedo.query(&places, &mut albedo);
        self.ambient.query(&places, &mut ambient);

        let reverse = reverse.unwrap_or(0.0);
        let loss = Loss { scene, batch: &batch, albedo: &albedo, ambient: &ambient, reverse, anneal };
        let mut per_ray = vec![0.0; batch.marches.len() * loss.n_ray_outputs()];
        let mut per_sample = vec![0.0; batch.samples.t.len() * loss.n_sample_outputs()];
        let RaySamples { offsets, points, .. } = &batch.samples;
        let losses = self.surface.step(offsets, points, &loss, &mut per_ray, &mut per_sample);

        // Gradients of what belongs to pixels.
        let (n_ray, n_sample) = (loss.n_ray_outputs(), loss.n_sample_outputs());
        let gather = |of: usize, field: &mut HashField<2>| {
            let rays = per_ray.chunks_exact(n_ray).take(batch.n_camera);
            let mut d: Vec<f32> = rays.flat_map(|r| r[of * c..(of + 1) * c].iter().copied()).collect();
            let samples = per_sample.chunks_exact(n_sample).skip(first);
            d.extend(samples.flat_map(|s| s[of * c..(of + 1) * c].iter().copied()));
            field.descend(&places, &d);
        };
        gather(0, &mut self.albedo);
        gather(1, &mut self.ambient);

        // And of the blur, in a fixed order.
        let mut d_blurred: Vec<Vec<f32>> = blurred.iter().map(|line| vec![0.0; line.len()]).collect();
        for (place, d) in batch.places[..first].iter().zip(per_sample.chunks_exact(n_sample)) {
            for (j, d_blurred) in d_blurred.iter_mut().enumerate() {
                scene.shown.sample_backward(j, d_blurred, *place, d[j]);
            }
        }
        for (&i, d) in drawn.iter().zip(per_ray.chunks_exact(n_ray)).skip(batch.n_camera) {
            for (j, d_blurred) in d_blurred.iter_mut().enumerate() {
                d_blurred[scene.shown.index(j, i)] += d[2 * c + j];
            }
        }
        let settings = &self.albedo.config().training;
        let d = scene.shown.blur_backward(&self.blur, &d_blurred);
        for (blur, d) in self.blur.iter_mut().zip(&d) {
            blur.descend(d, settings.encoding_learning_rate, &settings.adam, &settings.schedule);
        }
        (losses, batch.samples.t.len())
    }
}

/// Draws rays and looks up what they see; also the pixels they belong to.
fn draw(
    scene: &TurboSlScene<'_>,
    grid: &OccupancyGrid,
    surface: &NeuralSurface,
    n_rays: usize,
    per_ray: Option<usize>,
    reverse: bool,
    blurred: &[Vec<f32>],
    seed: u64,
) -> (Batch, Vec<usize>) {
    let k = scene.k();
    let mut rng = StdRng::seed_from_u64(seed);
    let n_projector = if reverse && !scene.projected.is_empty() { n_rays / 2 } else { 0 };
    let n_camera = n_rays - n_projector;
    let mut of = |pixels: &[u32], n: usize| -> Vec<usize> {
        let mut places: Vec<usize> = (0..n).map(|_| rng.random_range(0..pixels.len())).collect();
        places.sort_unstable();
        places.into_iter().map(|p| pixels[p] as usize).collect()
    };
    let mut drawn = of(&scene.drawn, n_camera);
    drawn.extend(of(&scene.projected, n_projector));
    let mut marches: Vec<March> = drawn[..n_camera].iter().map(|&i| scene.camera_march(i, rng.random())).collect();
    marches.extend(drawn[n_camera..].iter().map(|&i| scene.projector_march(i, rng.random())));
    let samples = importance::sample(&marches, &scene.bounds, grid, surface, per_ray, rng.random());
    let n = samples.t.len();
    let first = samples.offsets[n_camera];

    let center = scene.projector.center();
    let mut light = vec![[0.0; 3]; n];
    let mut values = vec![0.0; n * k];
    let mut places = vec![[0.0; 2]; n];
    let each = light.par_iter_mut().zip(values.par_chunks_mut(k)).zip(&mut places).zip(&samples.points);
    each.enumerate().for_each(|(s, (((light, values), place), point))| {
        let x = scene.bounds.from_cube(*point);
        *light = (center - x).normalize().map(|v| v as f32).into();
        let seen = if s < first { scene.projector.project(&x) } else { scene.camera.project(&x) };
        // Behind either: nothing is seen there.
        *place = seen.map_or([-1e6; 2], |p| p.map(|v| v as f32));
        if s < first {
            for (j, (value, blurred)) in values.iter_mut().zip(blurred).enumerate() {
                *value = scene.shown.sample(j, blurred, *place);
            }
        } else {
            scene.captured_at(*place, values);
        }
    });
    let mut wanted = Vec::with_capacity(n_rays * k);
    drawn[..n_camera].iter().for_each(|&i| wanted.extend_from_slice(scene.wanted(i)));
    let masks = drawn[..n_camera].iter().map(|&i| f32::from(u8::from(scene.is_lit(i)))).collect();
    for &i in &drawn[n_camera..] {
        wanted.extend(blurred.iter().enumerate().map(|(j, blurred)| blurred[scene.shown.index(j, i)]));
    }
    (Batch { samples, marches, n_camera, masks, light, values, places, wanted }, drawn)
}

/// TurboSL's loss of a batch.
struct Loss<'a> {
    scene: &'a TurboSlScene<'a>,
    batch: &'a Batch,
    /// Of camera rays, then of projector rays' samples, per channel.
    albedo: &'a [f32],
    ambient: &'a [f32],
    /// Weight of the projector rays' image loss.
    reverse: f32,
    anneal: f32,
}

impl RayLoss for Loss<'_> {
    fn needs_gradients(&self) -> bool {
        true
    }

    fn n_ray_outputs(&self) -> usize {
        2 * self.scene.n_channels + self.scene.k()
    }

    fn n_sample_outputs(&self) -> usize {
        self.scene.k().max(2 * self.scene.n_channels)
    }

    fn ray(&self, r: usize, sdf: &[f32], gradients: &[[f32; 3]], inv_s: f64, _: &mut RayScratch, out: RayGradient<'_>) {
        let (batch, k, c) = (self.batch, self.scene.k(), self.scene.n_channels);
        let here = batch.samples.offsets[r]..batch.samples.offsets[r + 1];
        let samples = MidpointRay {
            sdf,
            gradients,
            lengths: &batch.samples.lengths[here.clone()],
            dir: batch.marches[r].dir.map(|v| v as f32).into(),
            anneal: self.anneal,
            inv_s: inv_s as f32,
        };
        let along = Along { ray: samples, light: &batch.light[here.clone()] };
        let values = &batch.values[here.start * k..here.end * k];
        let wanted = &batch.wanted[r * k..(r + 1) * k];
        let n_camera = batch.n_camera;
        let n_projector = batch.marches.len() - n_camera;
        let (kind, image, mask) = if r < n_camera {
            let own = r * c..(r + 1) * c;
            let (albedo, ambient) = (&self.albedo[own.clone()], &self.ambient[own]);
            let mask = (config::MASK_WEIGHT / n_camera as f64) as f32;
            let kind = Kind::Camera { mask: batch.masks[r], colors: values, albedo, ambient, measured: wanted };
            (kind, 1.0 / (n_camera * k) as f32, mask)
        } else {
            let before = n_camera + here.start - batch.samples.offsets[n_camera];
            let own = before * c..(before + here.len()) * c;
            let (albedo, ambient) = (&self.albedo[own.clone()], &self.ambient[own]);
            let kind = Kind::Projector { captured: values, albedo, ambient, pattern: wanted };
            (kind, self.reverse / (n_projector * k) as f32, 0.0)
        };
        let weights = Weights { l1: 1.0, l2: 10.0, image, mask };
        let gradient = Gradient { d_sdf: out.d_sdf, d_gradients: out.d_gradients, ray: out.ray, samples: out.samples };
        let losses = ray::ray(&along, &kind, weights, gradient);
        out.losses.image += f64::from(losses.image);
        if mask > 0.0 {
            out.losses.mask += f64::from(losses.mask) / n_camera as f64;
        }
        *out.d_inv_s += f64::from(losses.d_inv_s);
    }
}
