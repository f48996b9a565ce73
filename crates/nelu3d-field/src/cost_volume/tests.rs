use super::*;
use rand::rngs::SmallRng;
use rand::{RngExt, SeedableRng};

/// What a [`Problem`] borrows.
struct Scene {
    width: usize,
    height: usize,
    pixels: Vec<u32>,
    labels: usize,
    rays: Vec<Ray>,
    words: [Vec<f32>; 3],
    cells: [usize; 3],
    k: usize,
    nodes: Vec<f32>,
    lit_cells: [usize; 3],
    lit: Vec<u8>,
}

impl Scene {
    /// A random lattice; rays that cross it on a slant and leave it; the codewords of a surface with a jump in it, and noise; holes in the
    /// image, and a pixel whose labels are all outside.
    fn new(width: usize, height: usize, k: usize, labels: usize, seed: u64) -> Self {
        let mut rng = SmallRng::seed_from_u64(seed);
        let (cells, lit_cells) = ([13, 9, 3], [6, 5, 2]);
        let nodes =
            (0..cells.iter().map(|c| c + 3).product::<usize>() * k).map(|_| rng.random_range(0.0..1.0)).collect();
        let lit = (0..lit_cells.iter().product()).map(|_| u8::from(rng.random_range(0.0..1.0) > 0.1)).collect();
        let n = width * height;
        let pixels: Vec<u32> = (0..n as u32).filter(|_| rng.random_range(0.0..1.0) > 0.07).collect();
        let ray = |i: u32| {
            let [x, y] = [i as usize % width, i as usize / width].map(|v| v as f64);
            let [x, y] = [x / width as f64, y / height as f64];
            // In homogeneous coordinates, with labels from 0 to 1.
            let base = [0.1 + 0.3 * x, 0.05 + 0.9 * y, -0.05, 1.0];
            let step = [0.5, 0.03 * x, 0.9, -0.2 - 0.1 * y].map(|v| v / labels as f64);
            let last = if i.is_multiple_of(41) { 0 } else { (labels as u32).saturating_sub(i % 5) };
            Ray::new(base, step, [i % 3, last])
        };
        let rays = pixels.iter().map(|i| ray(*i)).collect();
        let mut scene = Self {
            width,
            height,
            pixels,
            labels,
            rays,
            words: [vec![0.0; n * k], vec![0.0; n * k], vec![0.5; n * k]],
            cells,
            k,
            nodes,
            lit_cells,
            lit,
        };
        for (slot, pixel) in scene.pixels.iter().enumerate() {
            let x = *pixel as usize % width;
            let l = if 2 * x < width { 0.3 } else { 0.6 } + 0.1 * x as f64 / width as f64;
            let mut c = vec![0.5; k];
            if let Some(q) = reference::point(&scene.rays[slot], l * labels as f64) {
                reference::spline(&scene.problem().lattice, q, &mut c);
            }
            for j in 0..k {
                let i = *pixel as usize * k + j;
                // Some light of the surroundings, some noise, some channels that say nothing.
                scene.words[0][i] = 0.95 * c[j] as f32 + 0.05 * 0.5 + rng.random_range(-0.02..0.02);
                scene.words[1][i] =
                    if rng.random_range(0.0..1.0) > 0.05 { rng.random_range(500.0..3000.0) } else { 0.0 };
            }
        }
        scene
    }

    fn problem(&self) -> Problem<'_> {
        Problem {
            width: self.width,
            height: self.height,
            pixels: &self.pixels,
            labels: self.labels,
            rays: &self.rays,
            p: &self.words[0],
            inv_var: &self.words[1],
            surround: &self.words[2],
            lattice: Lattice { cells: self.cells, k: self.k, nodes: &self.nodes },
            lit: Lit { cells: self.lit_cells, lit: &self.lit },
            prior: [1e12, 25.0],
            saturation: 9.0 * self.k as f32,
            step: 1.5,
            jump: 15.0,
        }
    }
}

#[test]
fn a_ray_is_the_line_it_was_made_of() {
    let h = |l: f64, base: [f64; 4], step: [f64; 4]| std::array::from_fn::<f64, 4, _>(|i| base[i] + l * step[i]);
    let (base, step) = ([0.1, 0.9, -0.1, 1.0], [0.004, -0.003, 0.006, 0.002]);
    for sign in [1.0, -1.0] {
        let (base, step) = if sign > 0.0 { (base, step) } else { (h(200.0, base, step), step.map(|v| -v)) };
        let ray = Ray::new(base, step, [30, 180]);
        for l in [30.0, 77.0, 179.0] {
            let h = h(l, base, step);
            let q = reference::point(&ray, l).unwrap();
            assert!((0..3).all(|i| (q[i] - h[i] / h[3]).abs() < 1e-6), "{q:?} {h:?}");
            let rounded = reference::point(&ray, l as f32).unwrap();
            assert!((0..3).all(|i| (f64::from(rounded[i]) - q[i]).abs() < 3e-7), "{rounded:?} {q:?}");
        }
    }
    // A line through the pole has an inside on one side of it, one behind the pole has none.
    let ray = Ray::new([0.5, 0.5, 0.5, 1.0], [0.0, 0.0, 0.0, -0.01], [0, 200]);
    assert!(reference::point(&ray, 0.0f64).is_some() && reference::point(&ray, 150.0f64).is_none());
    assert_eq!(Ray::new([0.5, 0.5, 0.5, -1.0], [0.0; 4], [0, 200]), Ray::NONE);
    assert_eq!(Ray::new([0.5, 0.5, 0.5, 1.0], [0.0; 4], [7, 7]), Ray::NONE);
}

/// Two pixels side by side are each other's only neighbors.
#[test]
fn sums_of_two_pixels_are_what_a_search_finds() {
    let scene = Scene::new(2, 1, 3, 30, 1);
    let scene = Scene { pixels: vec![0, 1], rays: vec![scene.rays[0]; 2], ..scene };
    let problem = scene.problem();
    let n = problem.labels;
    let mut rng = SmallRng::seed_from_u64(2);
    let costs: Vec<f64> = (0..2 * n).map(|_| rng.random_range(0.0..40.0)).collect();
    let sums = reference::sums(&problem, &costs);
    for (here, there) in
        [(&costs[..n], &costs[n..]), (&costs[n..], &costs[..n])].into_iter().zip([0, n]).map(|(c, at)| {
            let (here, there) = c;
            let least = there.iter().copied().fold(f64::INFINITY, f64::min);
            let penalty = |d: usize| match d {
                0 => 0.0,
                1 => f64::from(problem.step),
                _ => f64::from(problem.jump),
            };
            let expected: Vec<f64> = (0..n)
                .map(|d| {
                    let best = (0..n).map(|e| there[e] + penalty(d.abs_diff(e))).fold(f64::INFINITY, f64::min);
                    8.0 * here[d] + best - least
                })
                .collect();
            (expected, sums[at..at + n].to_vec())
        })
    {
        assert!(here.iter().zip(&there).all(|(a, b)| (a - b).abs() < 1e-9));
    }
}

#[test]
fn the_surface_is_found_and_holes_are_none() {
    let scene = Scene::new(40, 24, 3, 100, 3);
    let problem = scene.problem();
    let costs = reference::costs::<f32>(&problem);
    let found = winners(&Device::Cpu, &problem).unwrap();
    let mut right = 0;
    for ((pixel, winner), costs) in scene.pixels.iter().zip(&found).zip(costs.chunks_exact(problem.labels)) {
        let x = *pixel as usize % scene.width;
        let label = 100.0 * (if 2 * x < scene.width { 0.3 } else { 0.6 } + 0.1 * x as f32 / scene.width as f32);
        assert_eq!(winner.label.is_nan(), costs.iter().all(|c| *c == OUTSIDE));
        right += usize::from((winner.label - label).abs() < 2.0);
    }
    assert!(found.iter().any(|w| w.label.is_nan()));
    assert!(right as f32 > 0.8 * found.len() as f32, "{right} of {}", found.len());
}

#[cfg(feature = "gpu")]
mod on_gpu {
    use super::*;
    use crate::gpu::{test_gpu, test_gpu_alone};

    #[test]
    fn agrees_with_the_reference() {
        // With subgroups, where the device has them, and without.
        let gpus: Vec<_> = [test_gpu(), test_gpu_alone()].into_iter().flatten().collect();
        let sizes = [(1, 16, [30, 17]), (3, 300, [40, 21]), (6, 128, [29, 24]), (8, 140, [21, 32]), (13, 1, [9, 9])];
        for (gpu, (k, labels, size)) in gpus.iter().flat_map(|gpu| sizes.map(|s| (gpu, s))) {
            let scene = Scene::new(size[0], size[1], k, labels, k as u64);
            let problem = scene.problem();
            let expected = reference::winners::<f32>(&problem);
            let found = winners(&Device::Gpu(gpu.clone()), &problem).unwrap();
            assert_eq!(found.len(), expected.len());
            let same =
                |(a, b): &(&Winner, &Winner)| (a.label - b.label).abs() < 0.5 || a.label.is_nan() && b.label.is_nan();
            let all = found.len();
            let pairs: Vec<(&Winner, &Winner)> = found.iter().zip(&expected).filter(same).collect();
            assert!(pairs.len() as f32 > 0.999 * all as f32, "k = {k}: {} of {all}", pairs.len());
            for (a, b) in pairs {
                let close = |a: f32, b: f32, e: f32| a == b || a.is_nan() && b.is_nan() || (a - b).abs() < e;
                assert!(close(a.label, b.label, 1e-2), "k = {k}: {a:?} {b:?}");
                assert!(close(a.margin, b.margin, 2e-3 * b.margin.max(1.0)), "k = {k}: {a:?} {b:?}");
            }
        }
    }

    #[test]
    fn slabs_give_what_the_whole_gives() {
        let Some(gpu) = test_gpu() else { return };
        let scene = Scene::new(27, 24, 3, 60, 7);
        let problem = scene.problem();
        let whole = gpu::winners(&gpu, &problem, gpu.most_buffer_bytes()).unwrap();
        // The widest row is 27 pixels of 60 labels.
        for rows in [1, 4] {
            let most = 27 * 60 * 4 * rows;
            assert!(gpu::slabs(&problem, "", most).unwrap().len() > 24 / (2 * rows as usize));
            let cut = gpu::winners(&gpu, &problem, most).unwrap();
            let bits = |w: &[Winner]| w.iter().map(|w| [w.label.to_bits(), w.margin.to_bits()]).collect::<Vec<_>>();
            assert!(bits(&cut) == bits(&whole), "{rows} rows");
        }
        let e = gpu::winners(&gpu, &problem, 20 * 60 * 4).unwrap_err();
        assert!(matches!(&e, DeviceError::Memory { what, .. } if what.contains("row")), "{e}");
    }

    #[test]
    fn what_cannot_be_done_is_an_error() {
        let Some(gpu) = test_gpu() else { return };
        let scene = Scene::new(3, 2, 1, 5000, 7);
        let e = winners(&Device::Gpu(gpu.clone()), &scene.problem()).unwrap_err();
        assert!(matches!(&e, DeviceError::Memory { .. }) && e.to_string().contains("5000 labels"), "{e}");
        // It is none of the device's.
        gpu.check().unwrap();
        let empty = Scene { pixels: vec![], rays: vec![], ..Scene::new(3, 2, 1, 20, 7) };
        assert_eq!(winners(&Device::Gpu(gpu), &empty.problem()).unwrap(), []);
        let Some(gpu) = test_gpu_alone() else { return };
        gpu.destroy();
        let scene = Scene::new(9, 8, 3, 20, 7);
        let e = winners(&Device::Gpu(gpu), &scene.problem()).unwrap_err();
        assert!(matches!(e, DeviceError::Lost { .. }), "{e:?}");
    }
}
