use nelu3d_field::cost_volume::{
    DepthHypotheses, HypothesisLine, LitCells, OUTSIDE, PixelRay, Problem, RaySource, Winner, reference, winners,
};
use nelu3d_field::device::Device;
use nelu3d_field::lattice::{Lattice, ProjectiveFrame};
use rand::rngs::SmallRng;
use rand::{RngExt, SeedableRng};

/// What a [`Problem`] borrows.
struct TestImage {
    width: usize,
    height: usize,
    pixels: Vec<u32>,
    hypotheses: DepthHypotheses,
    words: [Vec<f32>; 3],
    cells: [usize; 3],
    k: usize,
    nodes: Vec<f32>,
    lit_cells: [usize; 3],
    lit: Vec<u8>,
}

/// Rays from depth 2 to 2.6 go from below the unit cube to above it, on a slant.
const FRAME: ProjectiveFrame = ProjectiveFrame { kappa: -0.2, lo: [0.0, 0.0, 0.03], scale: [1.0, 1.0, 1.0 / 0.62] };
const CENTER: [f64; 3] = [-1.2, 0.5, -2.0];

impl TestImage {
    /// A random lattice; rays that cross it on a slant and leave it; the codewords of a surface with a jump in it, and
    /// noise; holes in the image, and pixels all of whose hypotheses are outside.
    fn new(width: usize, height: usize, k: usize, count: usize, seed: u64) -> Self {
        let mut rng = SmallRng::seed_from_u64(seed);
        let (cells, lit_cells) = ([13, 9, 3], [6, 5, 2]);
        let nodes =
            (0..cells.iter().map(|c| c + 3).product::<usize>() * k).map(|_| rng.random_range(0.0..1.0)).collect();
        let lit = (0..lit_cells.iter().product()).map(|_| u8::from(rng.random_range(0.0..1.0) > 0.1)).collect();
        let n = width * height;
        let pixels: Vec<u32> = (0..n as u32).filter(|_| rng.random_range(0.0..1.0) > 0.07).collect();
        let first = 1.0 / 2.6;
        let hypotheses = DepthHypotheses { first, spacing: (0.5 - first) / count as f32, count };
        let mut image = Self {
            width,
            height,
            pixels,
            hypotheses,
            words: [vec![0.0; n * k], vec![0.0; n * k], vec![0.5; n * k]],
            cells,
            k,
            nodes,
            lit_cells,
            lit,
        };
        for pixel in &image.pixels {
            let mut c = vec![0.5; k];
            let line = image.ray(*pixel).line(&FRAME, CENTER, &hypotheses);
            if let Some(q) = reference::point(&line, f64::from(image.surface(*pixel))) {
                reference::spline(&image.problem().lattice, q, &mut c);
            }
            for j in 0..k {
                let i = *pixel as usize * k + j;
                // Some light of the surroundings, some noise, some channels that say nothing.
                image.words[0][i] = 0.95 * c[j] as f32 + 0.05 * 0.5 + rng.random_range(-0.02..0.02);
                image.words[1][i] =
                    if rng.random_range(0.0..1.0) > 0.05 { rng.random_range(500.0..3000.0) } else { 0.0 };
            }
        }
        image
    }

    /// The hypothesis at which a pixel sees the surface.
    fn surface(&self, pixel: u32) -> f32 {
        let x = pixel as usize % self.width;
        let l = if 2 * x < self.width { 0.3 } else { 0.6 } + 0.1 * x as f32 / self.width as f32;
        l * self.hypotheses.count as f32
    }

    fn problem(&self) -> Problem<'_> {
        Problem {
            width: self.width,
            height: self.height,
            pixels: &self.pixels,
            hypotheses: self.hypotheses,
            frame: FRAME,
            center: CENTER,
            rays: self,
            p: &self.words[0],
            inv_var: &self.words[1],
            surround: &self.words[2],
            lattice: Lattice { cells: self.cells, k: self.k, nodes: &self.nodes },
            lit: LitCells { cells: self.lit_cells, lit: &self.lit },
            prior: [1e12, 25.0],
            saturation: 9.0 * self.k as f32,
            step: 1.5,
            jump: 15.0,
        }
    }
}

impl RaySource for TestImage {
    fn ray(&self, pixel: u32) -> PixelRay {
        let [x, y] = [pixel as usize % self.width, pixel as usize / self.width].map(|v| v as f64);
        // Where the ray is at depth 2.
        let [a, b] = [0.1 + 0.3 * x / self.width as f64, 0.05 + 0.9 * y / self.height as f64];
        let slope = [(a - CENTER[0]) / 2.0, (b - CENTER[1]) / 2.0, 1.0];
        let length = slope.iter().map(|v| v * v).sum::<f64>().sqrt();
        let last = if pixel.is_multiple_of(41) { 0 } else { (self.hypotheses.count as u32).saturating_sub(pixel % 5) };
        PixelRay { dir: slope.map(|v| v / length), dir_z: (1.0 / length) as f32, range: [pixel % 3, last] }
    }
}

/// Returns the unit coordinates at a distance from the rays' common center.
fn point_on(ray: &PixelRay, distance: f32) -> [f32; 3] {
    let t = f64::from(distance);
    FRAME.to_unit(std::array::from_fn(|i| CENTER[i] + t * ray.dir[i]))
}

/// Asserts that winners are equal but for `rounding`, hypotheses, and for up to one pixel in a hundred: on random
/// codewords some pixels have two equally good hypotheses, and some points lie on the edge of a lit cell.
fn assert_agree(what: &str, found: &[Winner], expected: &[Winner], rounding: f32) {
    assert_eq!(found.len(), expected.len());
    let same =
        |(a, b): &(&Winner, &Winner)| (a.index - b.index).abs() < rounding || a.index.is_nan() && b.index.is_nan();
    let all = found.len();
    let pairs: Vec<(&Winner, &Winner)> = found.iter().zip(expected).filter(same).collect();
    assert!(pairs.len() + 1 + all / 100 >= all, "{what}: {} of {all}", pairs.len());
    // Between two hypotheses that are equally good, rounding chooses, and their rivals differ.
    let is_between = |w: &Winner| (w.index - w.index.round()).abs() > 0.5 - rounding;
    for (a, b) in pairs.into_iter().filter(|(a, b)| !is_between(a) && !is_between(b)) {
        let close = |a: f32, b: f32, e: f32| a == b || a.is_nan() && b.is_nan() || (a - b).abs() < e;
        assert!(close(a.margin, b.margin, 0.2 * rounding * b.margin.max(1.0)), "{what}: {a:?} {b:?}");
    }
}

/// Codeword lengths, numbers of hypotheses and sizes for which the fast forms are compared with the reference.
const CASES: [(usize, usize, [usize; 2]); 5] =
    [(1, 16, [30, 17]), (3, 300, [40, 21]), (6, 128, [29, 24]), (8, 140, [21, 32]), (13, 1, [9, 9])];

/// What sums in 16 bits move a winner by where costs hardly depend on depth, hypotheses: by a twentieth of a standard
/// deviation of what is measured.
const SIXTEEN_BITS: f32 = 5e-2;

#[test]
fn the_cpu_agrees_with_the_reference() {
    for (k, count, size) in CASES {
        let image = TestImage::new(size[0], size[1], k, count, k as u64);
        let expected = reference::winners::<f32>(&image.problem());
        assert_agree(&format!("k = {k}"), &winners(&Device::Cpu, &image.problem()).unwrap(), &expected, SIXTEEN_BITS);
    }
}

#[test]
fn hypotheses_are_those_whose_distances_are_in_range() {
    let hypotheses = DepthHypotheses { first: 0.4, spacing: 0.01, count: 11 };
    let all: Vec<f32> = (0..11).map(|l| hypotheses.distance(l, 0.8)).collect();
    assert!(all.is_sorted_by(|a, b| a > b));
    assert_eq!(hypotheses.range([all[7], all[2]], 0.8), [2, 8]);
    assert_eq!(hypotheses.range([0.0, 100.0], 0.8), [0, 11]);
    assert_eq!(hypotheses.range([50.0, 100.0], 0.8), [0, 0]);
    assert_eq!(hypotheses.range([0.0, 1.0], 0.8), [11, 11]);
}

#[test]
fn a_line_goes_through_the_points_of_its_ray() {
    let hypotheses = DepthHypotheses { first: 0.385, spacing: 0.001, count: 100 };
    let ray = PixelRay { dir: [0.6, 0.0, 0.8], dir_z: 0.8, range: [5, 90] };
    let line = ray.line(&FRAME, CENTER, &hypotheses);
    for l in 30..60 {
        let q = point_on(&ray, hypotheses.distance(l, ray.dir_z));
        let on_line = reference::point(&line, l as f64).expect("inside");
        assert!((0..3).all(|i| (f64::from(q[i]) - on_line[i]).abs() < 1e-6), "{q:?} {on_line:?}");
    }
}

#[test]
fn a_line_is_made_of_homogeneous_coordinates() {
    let h = |l: f64, base: [f64; 4], step: [f64; 4]| std::array::from_fn::<f64, 4, _>(|i| base[i] + l * step[i]);
    let (base, step) = ([0.1, 0.9, -0.1, 1.0], [0.004, -0.003, 0.006, 0.002]);
    for sign in [1.0, -1.0] {
        let (base, step) = if sign > 0.0 { (base, step) } else { (h(200.0, base, step), step.map(|v| -v)) };
        let line = HypothesisLine::new(base, step, [30, 180]);
        for l in [30.0, 77.0, 179.0] {
            let h = h(l, base, step);
            let q = reference::point(&line, l).unwrap();
            assert!((0..3).all(|i| (q[i] - h[i] / h[3]).abs() < 1e-6), "{q:?} {h:?}");
            let rounded = reference::point(&line, l as f32).unwrap();
            assert!((0..3).all(|i| (f64::from(rounded[i]) - q[i]).abs() < 3e-7), "{rounded:?} {q:?}");
        }
    }
    // A line through the pole has an inside on one side of it, one behind the pole has none.
    let line = HypothesisLine::new([0.5, 0.5, 0.5, 1.0], [0.0, 0.0, 0.0, -0.01], [0, 200]);
    assert!(reference::point(&line, 0.0f64).is_some() && reference::point(&line, 150.0f64).is_none());
    assert_eq!(HypothesisLine::new([0.5, 0.5, 0.5, -1.0], [0.0; 4], [0, 200]), HypothesisLine::NONE);
    assert_eq!(HypothesisLine::new([0.5, 0.5, 0.5, 1.0], [0.0; 4], [7, 7]), HypothesisLine::NONE);
}

/// Two pixels side by side are each other's only neighbors.
#[test]
fn sums_of_two_pixels_are_what_a_search_finds() {
    let image = TestImage::new(2, 1, 3, 30, 1);
    let image = TestImage { pixels: vec![0, 1], ..image };
    let problem = image.problem();
    let n = problem.hypotheses.count;
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
    let image = TestImage::new(40, 24, 3, 100, 3);
    let problem = image.problem();
    let costs = reference::costs::<f32>(&problem);
    let found = winners(&Device::Cpu, &problem).unwrap();
    let mut right = 0;
    for ((pixel, winner), costs) in image.pixels.iter().zip(&found).zip(costs.chunks_exact(problem.hypotheses.count)) {
        assert_eq!(winner.index.is_nan(), costs.iter().all(|c| *c == OUTSIDE));
        right += usize::from((winner.index - image.surface(*pixel)).abs() < 2.0);
    }
    assert!(found.iter().any(|w| w.index.is_nan()));
    assert!(right as f32 > 0.8 * found.len() as f32, "{right} of {}", found.len());
}

#[cfg(feature = "gpu")]
mod on_gpu {
    use super::*;
    use crate::gpu::test_device::{test_gpu, test_gpu_alone};
    use nelu3d_field::cost_volume::gpu;
    use nelu3d_field::device::DeviceError;

    #[test]
    fn agrees_with_the_reference() {
        // With subgroups, where the device has them, and without.
        let gpus: Vec<_> = [test_gpu(), test_gpu_alone()].into_iter().flatten().collect();
        for (gpu, (k, count, size)) in gpus.iter().flat_map(|gpu| CASES.map(|s| (gpu, s))) {
            let image = TestImage::new(size[0], size[1], k, count, k as u64);
            let expected = reference::winners::<f32>(&image.problem());
            let found = winners(&Device::Gpu(gpu.clone()), &image.problem()).unwrap();
            assert_agree(&format!("k = {k}"), &found, &expected, 1e-2);
        }
    }

    #[test]
    fn slabs_give_what_the_whole_gives() {
        let Some(gpu) = test_gpu() else { return };
        let image = TestImage::new(27, 24, 3, 60, 7);
        let problem = image.problem();
        let whole = gpu::winners(&gpu, &problem, gpu.max_buffer_bytes()).unwrap();
        // The widest row is 27 pixels of 60 hypotheses.
        for rows in [1, 4] {
            let max = 27 * 60 * 4 * rows;
            assert!(gpu::slabs(&problem, "", max).unwrap().len() > 24 / (2 * rows as usize));
            let cut = gpu::winners(&gpu, &problem, max).unwrap();
            let bits = |w: &[Winner]| w.iter().map(|w| [w.index.to_bits(), w.margin.to_bits()]).collect::<Vec<_>>();
            assert!(bits(&cut) == bits(&whole), "{rows} rows");
        }
        let e = gpu::winners(&gpu, &problem, 20 * 60 * 4).unwrap_err();
        assert!(matches!(&e, DeviceError::Memory { what, .. } if what.contains("row")), "{e}");
    }

    #[test]
    fn what_cannot_be_done_is_an_error() {
        let Some(gpu) = test_gpu() else { return };
        let image = TestImage::new(3, 2, 1, 5000, 7);
        let e = winners(&Device::Gpu(gpu.clone()), &image.problem()).unwrap_err();
        assert!(matches!(&e, DeviceError::Memory { .. }) && e.to_string().contains("5000 depth hypotheses"), "{e}");
        // It is none of the device's.
        gpu.check().unwrap();
        let empty = TestImage { pixels: vec![], ..TestImage::new(3, 2, 1, 20, 7) };
        assert_eq!(winners(&Device::Gpu(gpu), &empty.problem()).unwrap(), []);
        let Some(gpu) = test_gpu_alone() else { return };
        gpu.destroy();
        let image = TestImage::new(9, 8, 3, 20, 7);
        let e = winners(&Device::Gpu(gpu), &image.problem()).unwrap_err();
        assert!(matches!(e, DeviceError::Lost { .. }), "{e:?}");
    }
}
