use nalgebra::{Isometry3, Vector3};
use nelu3d_evaluate::{EvaluatedMaps, GroundTruth, angle_deg, evaluate};
use nelu3d_scan::{Camera, Projector};

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
