use nelu3d::reconstruct::refine::interreflection::{GatherSurface, gather};
use nelu3d::reconstruct::refine::window::Window;

use crate::color_field::camera_rays::rays_without_field;
use crate::sensor::measurements::mid_gray;

/// Two walls that meet at a right angle in the line x = 0, z = 500, each 45° to the view: 1/z is linear on either
/// side. Above a point of one wall at distance d from the crease, the other wall, if it were endless, would cover
/// (1 − d/√(d² + L²)) / 2 of the cosine-weighted hemisphere for a wall of width L.
#[test]
fn a_corner_gathers_what_its_form_factors_say() {
    let (w, h, focal) = (242usize, 602usize, 600.0f32);
    let map: Vec<f32> = vec![1.0; (w - 2) * (h - 2)];
    let window = Window::around(&map, w - 2).unwrap();
    let active: Vec<bool> = (0..w * h).map(|i| !window.in_ring(i)).collect();
    let plane: Vec<[f32; 2]> = (0..map.len())
        .map(|i| [((i % (w - 2)) as f32 - 119.5) / focal, ((i / (w - 2)) as f32 - 299.5) / focal])
        .collect();
    // z = 500 − |x| seen at u = x/z: z = 500 / (1 + |u|).
    let inv_z: Vec<f32> = plane.iter().map(|p| (1.0 + p[0].abs()) / 500.0).collect();
    let slopes: Vec<[f32; 2]> = (0..w * h)
        .map(|i| {
            let du = if i % w <= 120 { -1.0 } else { 1.0 };
            [if active[i] { du / 500.0 / focal } else { 0.0 }, 0.0]
        })
        .collect();
    let rays = rays_without_field(focal, plane);
    let surface = GatherSurface::new(&window, &active, &rays, |i| inv_z[window.at(i)], |i| slopes[i]);
    // The left wall has codeword 0.2, the right wall 0.8; white is 1 everywhere.
    let mut m = mid_gray(w - 2, h - 2, 1);
    for i in 0..m.n() {
        m.p[i] = if i % (w - 2) < 120 { 0.2 } else { 0.8 };
    }
    let (got, _) = gather(&surface, &m, 1, focal, 4000);
    let far = surface.point(window_index(&window, 239, 299))[0] * 2f32.sqrt();
    for column in [130, 150, 180, 220] {
        let i = window_index(&window, column, 299);
        let d = surface.point(i)[0] * 2f32.sqrt();
        let expected = 0.5 * (1.0 - d / (d * d + far * far).sqrt());
        let fraction = got.per_albedo[i];
        assert!((fraction - expected).abs() < 0.06 * expected + 0.005, "{column}: {fraction} {expected}");
        assert!((got.codeword[i] - 0.2).abs() < 0.02, "{column}: {}", got.codeword[i]);
    }
    for column in [150, 200] {
        let (a, b) = (window_index(&window, column, 299), window_index(&window, 239 - column, 299));
        assert!((got.per_albedo[a] - got.per_albedo[b]).abs() < 0.02, "{column}");
        assert!((got.codeword[a] + got.codeword[b] - 1.0).abs() < 0.04, "{column}");
    }
}

fn window_index(window: &Window, column: usize, row: usize) -> usize {
    (row + 1) * window.w + column + 1
}
