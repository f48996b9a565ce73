use nalgebra::Point3;
use nelu3d::reconstruct::neural::bounds::Bounds;
use nelu3d::reconstruct::neural::lookup_start::DecodedBody;
use nelu3d_scan::Camera;

/// A bump before a camera, on a part of the image.
#[test]
fn a_surface_starts_as_the_decoded_body() {
    let camera = Camera::pinhole(64, 48, 80.0, 80.0, 31.5, 23.5);
    let plane: Vec<[f32; 2]> =
        (0..64 * 48).map(|i| camera.undistort([(i % 64) as f64, (i / 64) as f64]).map(|v| v as f32)).collect();
    let depth: Vec<f32> = plane
        .iter()
        .map(|[u, v]| if u.hypot(*v) < 0.2 { 500.0 - 40.0 * (-60.0 * (u * u + v * v)).exp() } else { f32::NAN })
        .collect();
    let bounds = Bounds { center: Point3::new(0.0, 0.0, 490.0), unit_mm: 100.0 };
    let body = DecodedBody::new(&camera, bounds, &plane, &depth).unwrap();
    let mut config = nelu3d::reconstruct::neural::config::surface_config(Default::default(), 100);
    config.field.encoding.log2_hashmap_size = 14;
    let surface = body.surface(config, 3);
    let at = |i: usize, away: f64| bounds.to_cube(&Point3::from(body.dirs[i] * (f64::from(body.t[i]) + away)));
    let mut points = Vec::new();
    for &i in &body.lit {
        points.extend([at(i as usize, 0.0), at(i as usize, -6.0), at(i as usize, 6.0), at(i as usize, 50.0)]);
    }
    let mut found = vec![0.0; points.len()];
    let mut slopes = vec![[0.0; 3]; points.len()];
    surface.field().query_with_jacobian(&points, &mut found, &mut slopes);
    let n = body.lit.len() as f32;
    let mean = |k: usize| found.iter().skip(k).step_by(4).sum::<f32>() / n;
    let error = found.iter().step_by(4).map(|f| f.abs()).sum::<f32>() / n;
    // Units of 100 mm: half a millimeter on the surface, known on either side, free far behind.
    assert!(error < 0.005, "{error}");
    assert!((mean(1) - 0.057).abs() < 0.01 && (mean(2) + 0.057).abs() < 0.01, "{} {}", mean(1), mean(2));
    // The slopes before and on the surface, per unit: of length 1, as the eikonal loss asks for them.
    let lengths = slopes.chunks_exact(4).flat_map(|s| &s[..2]);
    let slope = lengths.map(|s| s.iter().map(|d| (d / 3.0).powi(2)).sum::<f32>().sqrt() - 1.0);
    let deviation = (slope.map(|d| d * d).sum::<f32>() / (2.0 * n)).sqrt();
    assert!(deviation < 0.25, "{deviation}");
    assert!(mean(3) > 0.1, "{}", mean(3));
    // Beside the object nothing is in the way.
    let beside: Vec<[f32; 3]> = (0..20).map(|j| [0.9, 0.5, j as f32 / 19.0]).collect();
    let mut found = vec![0.0; 20];
    surface.field().query(&beside, &mut found);
    assert!(found.iter().all(|f| *f > 0.1), "{found:?}");
    // And neither is there a pixel off the outline, where the training's black rays are.
    let outside = |i: &usize| (1.0..2.5).contains(&body.outline[*i]);
    let around: Vec<[f32; 3]> = (0..64 * 48)
        .filter(outside)
        .map(|i| bounds.to_cube(&Point3::from(body.dirs[i] * (505.0 / body.dirs[i].z))))
        .collect();
    let mut found = vec![0.0; around.len()];
    surface.field().query(&around, &mut found);
    let blocked = found.iter().filter(|f| **f < 0.0).count();
    assert!(around.len() > 50 && blocked * 20 < around.len(), "{blocked} of {}", around.len());
    assert!(DecodedBody::new(&camera, bounds, &plane, &vec![f32::NAN; 64 * 48]).is_none());
}
