use nelu3d::surface::Links;
use nelu3d::surface::mesh::{normals_from_links, triangulate};
use nelu3d_scan::{Camera, Image};

fn scene(depth: impl Fn(f32, f32) -> f32) -> (Vec<f32>, Camera, Vec<[f32; 2]>) {
    let camera = Camera::pinhole(60, 40, 500.0, 500.0, 30.0, 20.0);
    let und: Vec<[f32; 2]> =
        (0..2400).map(|i| [(i % 60) as f32 / 500.0 - 0.06, (i / 60) as f32 / 500.0 - 0.04]).collect();
    let d = und.iter().map(|u| depth(u[0], u[1])).collect();
    (d, camera, und)
}

#[test]
fn a_tilted_plane_is_one_sheet_with_its_normal() {
    // z = 700 + 2 x  =>  z = 700 / (1 - 2 u): 63 degrees.
    let (d, camera, und) = scene(|u, _| 700.0 / (1.0 - 2.0 * u));
    let links = Links::new(&d, &camera, 3.0);
    let n = normals_from_links(&d, &links, &und, 60);
    let expect = [2.0 / 5f32.sqrt(), 0.0, -1.0 / 5f32.sqrt()];
    assert!(n.iter().all(|n| (0..3).all(|c| (n[c] - expect[c]).abs() < 1e-3)), "{:?}", n[70]);
    let m = triangulate(&d, &n, &links, &und, &Image::new(60, 40, 1));
    assert_eq!((m.vertices.len(), m.faces.len()), (2400, 2 * 59 * 39));
    // Counter-clockwise seen from the camera: the geometric normal faces it too.
    let [a, b, c] = m.faces[0].map(|i| m.vertices[i as usize]);
    let (u, v): (Vec<f32>, Vec<f32>) = (0..3).map(|i| (b[i] - a[i], c[i] - a[i])).unzip();
    assert!(u[0] * v[1] - u[1] * v[0] < 0.0, "winding");
}

#[test]
fn a_step_is_cut() {
    let (d, camera, und) = scene(|u, _| if u < 0.0 { 650.0 } else { 700.0 });
    let links = Links::new(&d, &camera, 3.0);
    let sizes = links.component_sizes(&d, 60);
    assert_eq!((sizes[0], sizes[59]), (30 * 40, 30 * 40));
    let n = normals_from_links(&d, &links, &und, 60);
    assert!(n.iter().all(|n| n[2] < -0.999));
}
