//! How far a result is from the truth, by region: the mean over a whole scene is ruled by a few percent of its pixels.
//!
//! Three [regions](Regions): everything that can be recovered (`whole`), what lies away from silhouettes and depth jumps
//! (`body`), and what is seen at more than 70° (`grazing`). In each: depth errors in mm, errors in projector columns
//! where a projector is known, angles between normals, and whether the 1σ that came with the depth is honest.

pub mod cad;
mod ground_truth;
mod jumps;
mod regions;
mod stats;
mod table;
mod trace;

pub use ground_truth::{GroundTruth, GroundTruthError};
pub use jumps::depth_jumps;
pub use regions::{BODY_MARGIN_PX, GRAZING_DEG, Regions, normals_from_depth};
pub use stats::Errors;
pub use trace::{Trace, TracePoint};

use nelu3d_scan::statistics::percentile;
use nelu3d_scan::{Camera, Projector};
use rayon::prelude::*;

/// A result to be judged. Maps are `height × width`, row by row.
#[derive(Clone, Copy, Debug)]
pub struct EvaluatedMaps<'a> {
    /// Camera z, mm; NaN where there is none.
    pub depth: &'a [f32],
    /// Unit normals.
    pub normals: Option<&'a [[f32; 3]]>,
    /// One standard deviation of the depth, mm.
    pub sigma: Option<&'a [f32]>,
}

/// Errors of a result, by region. A number that no pixel could give is NaN (`null` in JSON).
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Metrics {
    /// All pixels of the truth's mask.
    pub whole: RegionMetrics,
    /// The mask without [`BODY_MARGIN_PX`] pixels next to silhouettes, shadow borders and depth jumps.
    pub body: RegionMetrics,
    /// Pixels of the mask whose surface is seen at more than [`GRAZING_DEG`].
    pub grazing: RegionMetrics,
    /// Pixels that have a depth although the truth has no surface there, or the light source cannot see it.
    pub n_outside_mask: usize,
}

/// Errors in one region.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct RegionMetrics {
    /// Pixels of the region.
    pub n_region: usize,
    /// Pixels of the region that have a result: those the errors are taken over.
    pub n: usize,
    /// `n / n_region`.
    pub coverage: f64,
    /// Depth errors, ours − truth, mm.
    pub depth_mm: Errors,
    /// Share of the `n` pixels whose depth is off by less than 0.5 mm.
    pub under_half_mm: f64,
    /// Share of the `n` pixels whose depth is off by less than 1 mm.
    pub under_1mm: f64,
    /// Errors in projector columns, ours − truth, px: present when a projector was given.
    pub disparity_px: Option<Errors>,
    /// Angle between our normal and the one derived from the truth's depth, degrees: present when normals were given.
    pub normal_deg: Option<Errors>,
    /// Whether the 1σ is honest: present when a sigma was given.
    pub sigma: Option<SigmaCheck>,
}

/// How often errors stay within the uncertainty that was claimed. Gaussian errors would give 0.683 and 0.954.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct SigmaCheck {
    /// Share of pixels with |error| ≤ 1σ.
    pub within_1: f64,
    /// Share of pixels with |error| ≤ 2σ.
    pub within_2: f64,
    /// Median 1σ, mm.
    pub median_mm: f64,
}

/// Judges a result against the truth. `regions` are [`GroundTruth::regions`] with the same camera.
///
/// # Panics
/// When a map has another size than the truth.
pub fn evaluate(
    ours: &EvaluatedMaps<'_>,
    truth: &GroundTruth,
    regions: &Regions,
    camera: &Camera,
    projector: Option<&Projector>,
) -> Metrics {
    let n = truth.width * truth.height;
    assert_eq!(ours.depth.len(), n, "depth map and truth differ in size");
    assert!(ours.normals.is_none_or(|m| m.len() == n), "normal map and truth differ in size");
    assert!(ours.sigma.is_none_or(|m| m.len() == n), "sigma map and truth differ in size");
    assert_eq!((camera.width, camera.height), (truth.width, truth.height), "camera and truth differ in size");
    let columns = projector.map(|p| column_errors(ours.depth, truth, camera, p));
    let region = |inside: &[bool]| judge(ours, truth, regions, columns.as_deref(), inside);
    Metrics {
        whole: region(&truth.mask),
        body: region(&regions.body),
        grazing: region(&regions.grazing),
        n_outside_mask: (0..n).filter(|&i| !truth.mask[i] && ours.depth[i].is_finite()).count(),
    }
}

/// Differences of two depth maps, over the pixels that both have.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Comparison {
    /// Pixels that both have.
    pub n: usize,
    /// Pixels that only the first has.
    pub n_only_first: usize,
    /// Pixels that only the second has.
    pub n_only_second: usize,
    /// First − second, mm.
    pub depth_mm: Errors,
}

/// Compares two depth maps of the same size.
///
/// # Panics
/// When they differ in size.
pub fn compare(first: &[f32], second: &[f32]) -> Comparison {
    assert_eq!(first.len(), second.len(), "depth maps differ in size");
    let pairs = || first.iter().zip(second);
    let differences: Vec<f64> = pairs().map(|(&a, &b)| f64::from(a) - f64::from(b)).filter(|d| d.is_finite()).collect();
    Comparison {
        n: differences.len(),
        n_only_first: pairs().filter(|(a, b)| a.is_finite() && !b.is_finite()).count(),
        n_only_second: pairs().filter(|(a, b)| !a.is_finite() && b.is_finite()).count(),
        depth_mm: Errors::of(differences),
    }
}

fn judge(
    ours: &EvaluatedMaps<'_>,
    truth: &GroundTruth,
    regions: &Regions,
    columns: Option<&[f64]>,
    inside: &[bool],
) -> RegionMetrics {
    let n_region = inside.iter().filter(|&&m| m).count();
    let pixels: Vec<usize> = (0..inside.len()).filter(|&i| inside[i] && ours.depth[i].is_finite()).collect();
    let error = |i: usize| f64::from(ours.depth[i]) - f64::from(truth.depth[i]);
    let share = |f: &dyn Fn(usize) -> bool| ratio(pixels.iter().filter(|&&i| f(i)).count(), pixels.len());
    RegionMetrics {
        n_region,
        n: pixels.len(),
        coverage: ratio(pixels.len(), n_region),
        depth_mm: Errors::of(pixels.iter().map(|&i| error(i)).collect()),
        under_half_mm: share(&|i| error(i).abs() < 0.5),
        under_1mm: share(&|i| error(i).abs() < 1.0),
        disparity_px: columns.map(|c| Errors::of(pixels.iter().map(|&i| c[i]).filter(|e| e.is_finite()).collect())),
        normal_deg: ours.normals.map(|normals| {
            let angle = |i: usize| angle_deg(normals[i], regions.normals[i]);
            Errors::of(pixels.iter().map(|&i| angle(i)).filter(|a| a.is_finite()).collect())
        }),
        sigma: ours.sigma.map(|sigma| SigmaCheck {
            within_1: share(&|i| error(i).abs() <= f64::from(sigma[i])),
            within_2: share(&|i| error(i).abs() <= 2.0 * f64::from(sigma[i])),
            median_mm: percentile(&mut pixels.iter().map(|&i| f64::from(sigma[i])).collect::<Vec<_>>(), 50.0),
        }),
    }
}

/// Projector column of our point minus that of the truth's, px; NaN where one of them is missing.
fn column_errors(depth: &[f32], truth: &GroundTruth, camera: &Camera, projector: &Projector) -> Vec<f64> {
    let column = |px: usize, z: f32| {
        let ray = camera.ray([(px % truth.width) as f64, (px / truth.width) as f64]);
        projector.project(&ray.at(f64::from(z) / ray.dir.z)).map_or(f64::NAN, |p| p[0])
    };
    let error = |i: usize| {
        let (ours, theirs) = (depth[i], truth.depth[i]);
        if ours.is_finite() && theirs.is_finite() { column(i, ours) - column(i, theirs) } else { f64::NAN }
    };
    (0..depth.len()).into_par_iter().map(error).collect()
}

fn angle_deg(a: [f32; 3], b: [f32; 3]) -> f64 {
    let v = |n: [f32; 3]| nalgebra::Vector3::new(f64::from(n[0]), f64::from(n[1]), f64::from(n[2]));
    // atan2 keeps its precision at small angles, where acos of a dot product loses half the digits.
    v(a).cross(&v(b)).norm().atan2(v(a).dot(&v(b))).to_degrees()
}

fn ratio(a: usize, b: usize) -> f64 {
    if b == 0 { f64::NAN } else { a as f64 / b as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, Vector3};

    /// A plane at z = 500 that fills the image.
    fn plane(width: usize, height: usize) -> (GroundTruth, Camera) {
        let depth = vec![500.0; width * height];
        let mask = vec![true; width * height];
        let camera = Camera::pinhole(width, height, 400.0, 400.0, width as f64 / 2.0, height as f64 / 2.0);
        (GroundTruth { width, height, depth, mask }, camera)
    }

    #[test]
    fn errors_have_their_closed_form() {
        let (truth, camera) = plane(40, 20);
        let regions = truth.regions(&camera);
        // One half is off by +0.5 mm, the other by −1.25 mm, and four pixels have no result.
        let mut depth: Vec<f32> = (0..800).map(|i| if i % 2 == 0 { 500.5 } else { 498.75 }).collect();
        depth[..4].fill(f32::NAN);
        let sigma = vec![0.75; 800];
        let normals = vec![[0.0, -0.6, -0.8]; 800];
        let ours = EvaluatedMaps { depth: &depth, normals: Some(&normals), sigma: Some(&sigma) };
        let m = evaluate(&ours, &truth, &regions, &camera, None).whole;
        assert_eq!((m.n_region, m.n), (800, 796));
        assert_eq!(m.coverage, 796.0 / 800.0);
        assert_eq!(m.depth_mm.mae, 0.875);
        assert_eq!(m.depth_mm.bias, -0.375);
        assert_eq!(m.depth_mm.median, 0.875);
        assert_eq!(m.depth_mm.p95, 1.25);
        assert!((m.depth_mm.rmse - (0.5f64 * (0.25 + 1.5625)).sqrt()).abs() < 1e-12);
        assert_eq!((m.under_half_mm, m.under_1mm), (0.0, 0.5));
        let sigma = m.sigma.unwrap();
        assert_eq!((sigma.within_1, sigma.within_2, sigma.median_mm), (0.5, 1.0, 0.75));
        assert!((m.normal_deg.unwrap().mae - 0.6f64.asin().to_degrees()).abs() < 1e-5);
        assert!(m.disparity_px.is_none());
    }

    #[test]
    fn disparity_is_the_shift_along_the_projector_row() {
        let (truth, camera) = plane(40, 20);
        let regions = truth.regions(&camera);
        // A projector beside the camera, axes parallel: column = f (x + b) / z + c, so Δcolumn = f b (1/z' − 1/z)
        // plus f (x'/z' − x/z), which is zero along a camera ray.
        let projector = Projector { optics: camera.clone(), proj_from_cam: Isometry3::translation(100.0, 0.0, 0.0) };
        let depth = vec![510.0; 800];
        let ours = EvaluatedMaps { depth: &depth, normals: None, sigma: None };
        let m = evaluate(&ours, &truth, &regions, &camera, Some(&projector)).whole;
        let expected = 400.0 * 100.0 * (1.0 / 510.0 - 1.0 / 500.0);
        let d = m.disparity_px.unwrap();
        assert!((d.bias - expected).abs() < 1e-9 && (d.mae + expected).abs() < 1e-9);
    }

    #[test]
    fn body_leaves_out_silhouettes_and_jumps() {
        let (mut truth, camera) = plane(40, 20);
        // A step of 20 mm between columns 19 and 20, and no surface right of column 34.
        for y in 0..20 {
            for x in 0..40 {
                let i = y * 40 + x;
                if x >= 20 {
                    truth.depth[i] = 520.0;
                }
                if x >= 35 {
                    truth.depth[i] = f32::NAN;
                    truth.mask[i] = false;
                }
            }
        }
        let regions = truth.regions(&camera);
        let columns: Vec<usize> = (0..40).filter(|&x| regions.body[10 * 40 + x]).collect();
        let expected: Vec<usize> = (0..17).chain(23..32).collect();
        assert_eq!(columns, expected);
        assert!((0..40).all(|x| regions.body[x] == regions.body[10 * 40 + x]), "the image border is no silhouette");
    }

    #[test]
    fn slanted_planes_are_grazing_and_not_jumps() {
        let (width, height) = (60, 40);
        let camera = Camera::pinhole(width, height, 400.0, 400.0, 30.0, 20.0);
        for (slant_deg, is_grazing) in [(60.0f64, false), (80.0, true)] {
            let normal = Vector3::new(slant_deg.to_radians().sin(), 0.0, -slant_deg.to_radians().cos());
            let depth: Vec<f32> = (0..width * height)
                .map(|i| {
                    let ray = camera.ray([(i % width) as f64, (i / width) as f64]);
                    let t = normal.z * 500.0 / normal.dot(&ray.dir);
                    (t * ray.dir.z) as f32
                })
                .collect();
            let truth = GroundTruth { width, height, depth, mask: vec![true; width * height] };
            let regions = truth.regions(&camera);
            let center = 20 * width + 30;
            assert!(angle_deg(regions.normals[center], [normal.x as f32, 0.0, normal.z as f32]) < 0.1);
            assert_eq!(regions.grazing[center], is_grazing);
            assert!(regions.body.iter().all(|&b| b), "a plane at {slant_deg}° has no jumps");
        }
    }

    #[test]
    fn nothing_reconstructed_gives_no_numbers() {
        let (truth, camera) = plane(8, 8);
        let regions = truth.regions(&camera);
        let depth = vec![f32::NAN; 64];
        let ours = EvaluatedMaps { depth: &depth, normals: None, sigma: None };
        let m = evaluate(&ours, &truth, &regions, &camera, None);
        assert_eq!((m.whole.n, m.whole.coverage), (0, 0.0));
        assert!(m.whole.depth_mm.mae.is_nan() && m.grazing.coverage.is_nan());
        let json = serde_json::to_value(&m).unwrap();
        assert!(json["whole"]["depth_mm"]["mae"].is_null());
        assert!(m.to_string().contains("whole"));
    }

    #[test]
    fn comparison_counts_what_only_one_has() {
        let nan = f32::NAN;
        let c = compare(&[1.0, 2.0, nan, 4.0], &[0.5, nan, 3.0, 4.5]);
        assert_eq!((c.n, c.n_only_first, c.n_only_second), (2, 1, 1));
        assert_eq!((c.depth_mm.bias, c.depth_mm.mae), (0.0, 0.5));
    }
}
