//! A result against ground truth.

use nelu3d_scan::statistics::percentile;
use nelu3d_scan::{Camera, Projector};
use rayon::prelude::*;

use crate::metrics::{Metrics, RegionMetrics, UncertaintyCalibration};
use crate::stats::ratio;
use crate::{ErrorStatistics, GroundTruth, Regions};

/// The maps of a result that is evaluated: `height × width` each, row by row.
#[derive(Clone, Copy, Debug)]
pub struct EvaluatedMaps<'a> {
    /// Depth (camera z), mm; NaN where there is none.
    pub depth: &'a [f32],
    /// Unit normals that face the camera.
    pub normals: Option<&'a [[f32; 3]]>,
    /// One standard deviation of the depth, mm.
    pub sigma: Option<&'a [f32]>,
}

/// Evaluates a result against ground truth. `regions` are [`GroundTruth::regions`] for the same camera; with a
/// projector, errors are measured in its columns, too.
///
/// # Panics
/// Panics when a map has another size than the ground truth.
pub fn evaluate(
    maps: &EvaluatedMaps<'_>,
    truth: &GroundTruth,
    regions: &Regions,
    camera: &Camera,
    projector: Option<&Projector>,
) -> Metrics {
    let n = truth.width * truth.height;
    assert_eq!(maps.depth.len(), n, "depth map and ground truth differ in size");
    assert!(maps.normals.is_none_or(|m| m.len() == n), "normal map and ground truth differ in size");
    assert!(maps.sigma.is_none_or(|m| m.len() == n), "sigma map and ground truth differ in size");
    assert_eq!((camera.width, camera.height), (truth.width, truth.height), "camera and ground truth differ in size");
    let columns = projector.map(|p| column_errors(maps.depth, truth, camera, p));
    let region = |inside: &[bool]| evaluate_region(maps, truth, regions, columns.as_deref(), inside);
    Metrics {
        whole: region(&truth.mask),
        body: region(&regions.body),
        grazing: region(&regions.grazing),
        n_outside_mask: (0..n).filter(|&i| !truth.mask[i] && maps.depth[i].is_finite()).count(),
    }
}

/// Evaluates the pixels of one region.
fn evaluate_region(
    maps: &EvaluatedMaps<'_>,
    truth: &GroundTruth,
    regions: &Regions,
    columns: Option<&[f64]>,
    inside: &[bool],
) -> RegionMetrics {
    let n_region = inside.iter().filter(|&&m| m).count();
    let pixels: Vec<usize> = (0..inside.len()).filter(|&i| inside[i] && maps.depth[i].is_finite()).collect();
    let error = |i: usize| f64::from(maps.depth[i]) - f64::from(truth.depth[i]);
    let fraction = |f: &dyn Fn(usize) -> bool| ratio(pixels.iter().filter(|&&i| f(i)).count(), pixels.len());
    let of_region = |f: &dyn Fn(usize) -> bool| ratio(pixels.iter().filter(|&&i| f(i)).count(), n_region);
    RegionMetrics {
        n_region,
        n: pixels.len(),
        coverage: ratio(pixels.len(), n_region),
        depth_mm: ErrorStatistics::of(pixels.iter().map(|&i| error(i)).collect()),
        under_half_mm: fraction(&|i| error(i).abs() < 0.5),
        under_1mm: fraction(&|i| error(i).abs() < 1.0),
        over_2mm: of_region(&|i| error(i).abs() >= 2.0),
        disparity_px: columns
            .map(|c| ErrorStatistics::of(pixels.iter().map(|&i| c[i]).filter(|e| e.is_finite()).collect())),
        normal_deg: maps.normals.map(|normals| {
            let angle = |i: usize| angle_deg(normals[i], regions.normals[i]);
            ErrorStatistics::of(pixels.iter().map(|&i| angle(i)).filter(|a| a.is_finite()).collect())
        }),
        sigma: maps.sigma.map(|sigma| UncertaintyCalibration {
            within_1: fraction(&|i| error(i).abs() <= f64::from(sigma[i])),
            within_2: fraction(&|i| error(i).abs() <= 2.0 * f64::from(sigma[i])),
            gross: of_region(&|i| error(i).abs() >= 2.0 && error(i).abs() > 10.0 * f64::from(sigma[i])),
            median_mm: percentile(&mut pixels.iter().map(|&i| f64::from(sigma[i])).collect::<Vec<_>>(), 50.0),
        }),
    }
}

/// Returns the projector column of the result's point minus that of the ground truth, px, for every pixel; NaN where
/// one of them is missing.
fn column_errors(depth: &[f32], truth: &GroundTruth, camera: &Camera, projector: &Projector) -> Vec<f64> {
    let column = |px: usize, z: f32| {
        let ray = camera.ray([(px % truth.width) as f64, (px / truth.width) as f64]);
        projector.project(&ray.at(f64::from(z) / ray.dir.z)).map_or(f64::NAN, |p| p[0])
    };
    let error = |i: usize| {
        let (found, expected) = (depth[i], truth.depth[i]);
        if found.is_finite() && expected.is_finite() { column(i, found) - column(i, expected) } else { f64::NAN }
    };
    (0..depth.len()).into_par_iter().map(error).collect()
}

/// Returns the angle between two vectors, degrees.
fn angle_deg(a: [f32; 3], b: [f32; 3]) -> f64 {
    let v = |n: [f32; 3]| nalgebra::Vector3::new(f64::from(n[0]), f64::from(n[1]), f64::from(n[2]));
    // atan2 keeps its precision at small angles, where acos of a dot product loses half the digits.
    v(a).cross(&v(b)).norm().atan2(v(a).dot(&v(b))).to_degrees()
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
        let maps = EvaluatedMaps { depth: &depth, normals: Some(&normals), sigma: Some(&sigma) };
        let m = evaluate(&maps, &truth, &regions, &camera, None).whole;
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
    fn gross_errors_are_large_in_mm_and_in_sigma() {
        let (truth, camera) = plane(40, 20);
        let regions = truth.regions(&camera);
        let mut depth = vec![500.0; 800];
        let mut sigma = vec![0.1; 800];
        depth[..400].fill(f32::NAN);
        depth[400..440].fill(503.0);
        depth[440..480].fill(497.0);
        sigma[440..480].fill(0.4);
        depth[480..500].fill(501.5);
        let maps = EvaluatedMaps { depth: &depth, normals: None, sigma: Some(&sigma) };
        let m = evaluate(&maps, &truth, &regions, &camera, None).whole;
        assert_eq!((m.over_2mm, m.sigma.unwrap().gross), (0.1, 0.05));
    }

    #[test]
    fn disparity_is_the_shift_along_the_projector_row() {
        let (truth, camera) = plane(40, 20);
        let regions = truth.regions(&camera);
        // A projector beside the camera, axes parallel: column = f (x + b) / z + c, so Δcolumn = f b (1/z' − 1/z)
        // plus f (x'/z' − x/z), which is zero along a camera ray.
        let projector = Projector { optics: camera.clone(), proj_from_cam: Isometry3::translation(100.0, 0.0, 0.0) };
        let depth = vec![510.0; 800];
        let maps = EvaluatedMaps { depth: &depth, normals: None, sigma: None };
        let m = evaluate(&maps, &truth, &regions, &camera, Some(&projector)).whole;
        let expected = 400.0 * 100.0 * (1.0 / 510.0 - 1.0 / 500.0);
        let d = m.disparity_px.unwrap();
        assert!((d.bias - expected).abs() < 1e-9 && (d.mae + expected).abs() < 1e-9);
    }

    #[test]
    fn body_excludes_silhouettes_and_jumps() {
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
        let maps = EvaluatedMaps { depth: &depth, normals: None, sigma: None };
        let m = evaluate(&maps, &truth, &regions, &camera, None);
        assert_eq!((m.whole.n, m.whole.coverage), (0, 0.0));
        assert!(m.whole.depth_mm.mae.is_nan() && m.grazing.coverage.is_nan());
        let json = serde_json::to_value(&m).unwrap();
        assert!(json["whole"]["depth_mm"]["mae"].is_null());
        assert!(m.to_string().contains("whole"));
    }
}
