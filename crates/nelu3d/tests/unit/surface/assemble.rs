use nelu3d::surface::{PixelStatus, SurfaceMaps, assemble, image_plane, reject_small_components};
use nelu3d_scan::{Camera, Image};

#[test]
fn a_rejected_pixel_is_rejected_in_every_map() {
    let camera = Camera::pinhole(20, 10, 100.0, 100.0, 10.0, 5.0);
    let n = camera.n_pixels();
    let mut depth = vec![500.0; n];
    let mut status = vec![PixelStatus::Valid; n];
    depth[3] = f32::NAN;
    status[4] = PixelStatus::DepthDiscontinuity;
    depth[199] = 900.0;
    reject_small_components(&mut depth, &mut status, &camera, 5);
    let ones = vec![1.0; n];
    let maps = SurfaceMaps { depth, sigma: ones.clone(), status, residual: ones.clone(), ambient: ones };
    let r = assemble(maps, &camera, &image_plane(&camera), &Image::new(20, 10, 1));
    for (i, status) in
        [(3, PixelStatus::Ambiguous), (4, PixelStatus::DepthDiscontinuity), (199, PixelStatus::Ambiguous)]
    {
        assert_eq!(r.status[i], status);
        assert!(r.depth[i].is_nan() && r.sigma[i].is_nan() && r.residual[i].is_nan() && r.ambient[i].is_nan());
    }
    assert_eq!(r.n_valid(), n - 3);
    assert!(r.mesh.vertices.len() == n - 3 && r.normals[0][2] < -0.99);
}
