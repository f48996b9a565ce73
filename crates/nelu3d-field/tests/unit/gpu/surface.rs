use crate::check::assert_close;
use crate::gpu::test_device::{test_gpu, test_gpu_alone};
use crate::surface::{Rays, config, gradients, surface};
use nelu3d_field::field::{HashField, HashFieldConfig};
use nelu3d_field::gpu::{AmbientUse, Gpu, RayScene, ScenePixel, SurfaceTraining};
use nelu3d_field::lattice::{Lattice, ProjectiveFrame};
use nelu3d_field::mlp::Activation;
use nelu3d_field::occupancy::{OccupancyConfig, OccupancyGrid};
use nelu3d_field::surface::{NeuralSurface, SurfaceLosses};
use std::sync::Arc;

fn ambient_field() -> HashField<2> {
    let config = HashFieldConfig { output_activation: Activation::Sigmoid, ..HashFieldConfig::small(2) };
    HashField::new(config, 2).unwrap()
}

/// One step on given rays: losses, gradients of all parameters, of the sharpness, and of the ambient shares.
fn step(gpu: &Arc<Gpu>, start: &NeuralSurface, rays: &Rays) -> (SurfaceLosses, NeuralSurface, Vec<f32>) {
    let n_rays = rays.mask.len();
    let (lengths, dirs) = rays.intervals.as_ref().unwrap();
    let extent = start.config().extent;
    let pixel = |(&mask, dir): (&f32, &[f32; 3])| ScenePixel {
        dir: std::array::from_fn(|a| 0.7 * dir[a] / extent[a]),
        mask,
        ..Default::default()
    };
    let pixels: Vec<ScenePixel> = rays.mask.iter().zip(dirs).map(pixel).collect();
    let scene = RayScene {
        pixels: &pixels,
        origin: [0.0; 3],
        step: 1.0,
        measured: &rays.measured,
        white: &rays.white,
        n_channels: 2,
        lattice: Lattice { nodes: &[0.0; 4 * 4 * 4 * 2], cells: [1; 3], k: 2 },
        affine: [[0.0; 4]; 3],
        frame: ProjectiveFrame::UNIT,
        ambient: AmbientUse::Fraction,
        n_samples: rays.points.len(),
        first_step: 0,
        first_rays: n_rays,
        max_rays: n_rays,
        half_step: 0.5 * lengths[0],
        anneal_steps: 10,
        seed: 1,
    };
    let mut ambient = ambient_field();
    let mut occupancy = OccupancyGrid::new(OccupancyConfig { resolution: 8, ..Default::default() }, |_| true);
    let training = SurfaceTraining::new(gpu, start, &ambient, &occupancy, &scene, 1).unwrap();
    let (report, d_sums) = training.step_on(&rays.batch()).unwrap();
    let d_ambient = d_sums.iter().zip(&rays.ambient).map(|(d, a)| d / (a * (1.0 - a))).collect();
    let mut end = start.clone();
    training.fetch(&mut end, &mut ambient, &mut occupancy).unwrap();
    (report.losses, end, d_ambient)
}

#[test]
fn a_step_agrees_with_the_cpu() {
    let cases = [(true, true), (false, false), (true, false)];
    let gpus = [test_gpu(), test_gpu_alone(), test_gpu()];
    for (gpu, (append, clamped)) in gpus.into_iter().flatten().zip(cases) {
        let mut config = config(append);
        config.loss.eikonal_every = 1;
        config.loss.clamped_mask = clamped;
        config.field.training.weight_normalization = append;
        let lengths: Vec<usize> = (0..150).map(|r| [16, 1, 0, 7, 32][r % 5]).chain([300, 5, 97]).collect();
        let mut rays = Rays::new(&lengths).with_intervals();
        // Rays are marched there.
        rays.intervals.iter_mut().for_each(|(lengths, _)| lengths.fill(0.07));
        let start = surface(config);
        let mut slow = start.clone();
        let mut d_expected = vec![0.0; rays.ambient.len()];
        let expected = slow.train_step(&rays.batch(), &mut d_expected);
        let (losses, fast, d_ambient) = step(&gpu, &start, &rays);
        for (a, b) in [
            (losses.total, expected.total),
            (losses.image, expected.image),
            (losses.mask, expected.mask),
            (losses.eikonal, expected.eikonal),
            (losses.sparsity, expected.sparsity),
        ] {
            assert!((a - b).abs() <= 2e-5 * b.abs(), "{losses:?} {expected:?}");
        }
        let relative = |a: &[f32], b: &[f32]| {
            let norm = |v: &mut dyn Iterator<Item = f32>| v.map(|v| f64::from(v * v)).sum::<f64>().sqrt();
            norm(&mut a.iter().zip(b).map(|(a, b)| a - b)) / norm(&mut b.iter().copied())
        };
        let error = relative(&gradients(&fast), &gradients(&slow));
        assert!(error < 1e-4, "gradients differ by {error} ({append} {clamped})");
        let error = relative(&d_ambient, &d_expected);
        assert!(error < 1e-4, "gradients of the ambient shares differ by {error}");
        let v = |s: &NeuralSurface| s.sharpness_moments().first[0];
        assert!((v(&fast) - v(&slow)).abs() < 1e-4 * v(&slow).abs(), "{} {}", v(&fast), v(&slow));
        assert!((fast.inv_s() - slow.inv_s()).abs() < 1e-4 * slow.inv_s());
    }
}

/// A surface f = 3 (0.5 − z), to be trained for 120 steps.
fn plane() -> NeuralSurface {
    let mut settings = config(true);
    settings.extent = [3.0; 3];
    settings.sharpness = 0.3;
    settings.loss.eikonal_every = 1;
    settings.field.width = 16;
    settings.field.training.schedule.n_steps = 120;
    let mut surface = NeuralSurface::new(settings, 4).unwrap();
    for i in 0..400 {
        let p: Vec<[f32; 3]> = (0..512)
            .map(|j| {
                let at = |m: f32| ((i * 512 + j) as f32 * m).fract();
                [at(0.754_87), at(0.569_84), at(0.618_03)]
            })
            .collect();
        let targets: Vec<f32> = p.iter().map(|p| 3.0 * (0.5 - p[2])).collect();
        surface.field_mut().train_step(&p, &targets, &[]);
    }
    surface.field_mut().finish_training();
    surface
}

/// Rays along z through a lattice whose codewords tell z: a plane at 0.54 is seen where it is.
#[test]
fn a_training_finds_a_plane_and_goes_on_from_where_it_was() {
    let Some(gpu) = test_gpu() else { return };
    let mut surface = plane();
    let cells = [4usize, 4, 24];
    let [na, nb, nw] = cells.map(|c| c + 3);
    let node = |i: usize| {
        let w = (i % nw) as f32 / 24.0 - 1.0 / 24.0;
        [0.5 + 0.4 * (9.0 * w).sin(), 0.5 + 0.4 * (9.0 * w).cos()]
    };
    let nodes: Vec<f32> = (0..na * nb * nw).flat_map(node).collect();
    let (mut pixels, mut measured) = (Vec::new(), Vec::new());
    for i in 0..24 * 24 {
        let at = |v: usize| (v as f32 + 0.5) / 24.0;
        let slope = [at(i % 24) - 0.5, at(i / 24) - 0.5];
        pixels.push(ScenePixel {
            // From below the cube's middle, fanning out.
            dir: [0.2 * slope[0], 0.2 * slope[1], 0.5],
            near: 2.0,
            far: 4.0,
            place: [at(i % 24), at(i / 24)],
            mask: 1.0,
        });
        measured.extend([0.5 + 0.4 * (9.0f32 * 0.54).sin(), 0.5 + 0.4 * (9.0f32 * 0.54).cos()]);
    }
    let scene = RayScene {
        pixels: &pixels,
        origin: [0.5, 0.5, -1.0],
        step: 0.02,
        measured: &measured,
        white: &vec![0.8; pixels.len()],
        n_channels: 1,
        lattice: Lattice { nodes: &nodes, cells, k: 2 },
        affine: RayScene::CUBE,
        frame: ProjectiveFrame::UNIT,
        ambient: AmbientUse::Fraction,
        n_samples: 2000,
        first_step: 0,
        first_rays: 16,
        max_rays: 128,
        half_step: 0.015,
        anneal_steps: 240,
        seed: 3,
    };
    let config = HashFieldConfig { output_activation: Activation::Sigmoid, ..HashFieldConfig::small(1) };
    let mut ambient = HashField::<2>::new(config, 2).unwrap();
    let occupancy_config = OccupancyConfig { resolution: 12, n_warmup_steps: 32, ..Default::default() };
    let mut occupancy = OccupancyGrid::new(occupancy_config, |_| true);
    let depth = |surface: &NeuralSurface| {
        let mut out = [0.0; 2];
        surface.field().query(&[[0.4, 0.5, 0.52], [0.6, 0.5, 0.56]], &mut out);
        out
    };
    let (mut half, mut half_ambient, mut half_occupancy) = (surface.clone(), ambient.clone(), occupancy.clone());
    let mut training = SurfaceTraining::new(&gpu, &surface, &ambient, &occupancy, &scene, 120).unwrap();
    let early = training.run(40).unwrap();
    assert!(early.n_rays > 16 && early.n_samples > 700, "{early:?}");
    let late = training.run(120).unwrap();
    assert!(late.losses.image < 0.7 * early.losses.image, "{early:?} {late:?}");
    assert!(late.inv_s > early.inv_s && late.occupied < 1.0, "{early:?} {late:?}");
    training.fetch(&mut surface, &mut ambient, &mut occupancy).unwrap();
    let [before, behind] = depth(&surface);
    assert!(before > 0.0 && behind < 0.0, "{before} {behind}");
    assert_eq!((surface.field().n_steps(), ambient.n_steps()), (120, 120));
    assert!((occupancy.occupied_fraction() - late.occupied).abs() < 1e-9);
    assert!(occupancy.is_occupied([0.5, 0.5, 0.54]) && !occupancy.is_occupied([0.5, 0.5, 0.1]));
    // Stopped in the middle, it ends in the same way: draws, rates and the number of rays go on.
    let mut first = SurfaceTraining::new(&gpu, &half, &half_ambient, &half_occupancy, &scene, 120).unwrap();
    let middle = first.run(64).unwrap();
    first.fetch(&mut half, &mut half_ambient, &mut half_occupancy).unwrap();
    let wanted = middle.n_rays as f64 * (0.9 + 0.1 * scene.n_samples as f64 / middle.n_samples as f64);
    let rest = RayScene { first_step: 64, first_rays: wanted as usize, ..scene };
    let mut second = SurfaceTraining::new(&gpu, &half, &half_ambient, &half_occupancy, &rest, 120).unwrap();
    let end = second.run(120).unwrap();
    second.fetch(&mut half, &mut half_ambient, &mut half_occupancy).unwrap();
    assert_eq!((second.done(), half.field().n_steps(), half_ambient.n_steps()), (120, 120, 120));
    assert!(end.n_rays.abs_diff(late.n_rays) <= 2, "{late:?} {end:?}");
    assert_close(&[end.inv_s as f32, end.losses.image as f32], &[late.inv_s as f32, late.losses.image as f32], 0.02);
    assert_close(&depth(&half), &[before, behind], 0.02);
    // As if nothing had happened.
    let mut again = SurfaceTraining::new(&gpu, &surface, &ambient, &occupancy, &scene, 10).unwrap();
    let after = again.run(10).unwrap();
    assert!(after.losses.image < 2.0 * late.losses.image && again.done() == 10, "{late:?} {after:?}");
    assert_close(&[after.inv_s as f32], &[late.inv_s as f32], 0.2);
}
