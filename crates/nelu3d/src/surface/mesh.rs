//! Normals and triangles of a depth map.

use nelu3d_scan::statistics::order_statistic;
use nelu3d_scan::{Image, Mesh};

use super::links::Links;

/// Returns the camera-frame point of a pixel center at depth z.
fn point(dirs: &[[f32; 2]], i: usize, z: f32) -> [f32; 3] {
    [dirs[i][0] * z, dirs[i][1] * z, z]
}

/// Returns unit normals that face the camera, from the points of linked neighbors; NaN where there are too few.
pub fn normals_from_links(depth: &[f32], links: &Links, undistorted: &[[f32; 2]], width: usize) -> Vec<[f32; 3]> {
    let n = depth.len();
    let sub = |a: [f32; 3], b: [f32; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    (0..n)
        .map(|i| {
            if !depth[i].is_finite() {
                return [f32::NAN; 3];
            }
            let p = |j: usize| point(undistorted, j, depth[j]);
            let tangent = |before: Option<usize>, after: Option<usize>| match (before, after) {
                (Some(b), Some(a)) => Some(sub(p(a), p(b))),
                (Some(b), None) => Some(sub(p(i), p(b))),
                (None, Some(a)) => Some(sub(p(a), p(i))),
                (None, None) => None,
            };
            let x = i % width;
            let left = (x > 0 && links.right(i - 1)).then(|| i - 1);
            let right = links.right(i).then_some(i + 1);
            let up = (i >= width && links.down(i - width)).then(|| i - width);
            let down = links.down(i).then_some(i + width);
            let (Some(u), Some(v)) = (tangent(left, right), tangent(up, down)) else {
                return [f32::NAN; 3];
            };
            // v × u points to the camera for image axes x right, y down, z forward.
            let c = [v[1] * u[2] - v[2] * u[1], v[2] * u[0] - v[0] * u[2], v[0] * u[1] - v[1] * u[0]];
            let len = (c[0] * c[0] + c[1] * c[1] + c[2] * c[2]).sqrt();
            if len > 0.0 { c.map(|c| c / len) } else { [f32::NAN; 3] }
        })
        .collect()
}

/// Returns the triangles between linked pixels: one sheet, open at its border and at depth jumps.
pub fn triangulate(
    depth: &[f32],
    normals: &[[f32; 3]],
    links: &Links,
    undistorted: &[[f32; 2]],
    white: &Image,
) -> Mesh {
    let width = white.width;
    let mut out = Mesh::default();
    let mut index = vec![u32::MAX; depth.len()];
    let mut faces = Vec::new();
    for y in 0..white.height - 1 {
        for x in 0..width - 1 {
            let i = y * width + x;
            let [a, b, c, d] = [i, i + 1, i + width, i + width + 1];
            let (top, left, bottom, right) = (links.right(a), links.down(a), links.right(c), links.down(b));
            // All four sides: two triangles along the shorter diagonal. Two sides that meet: one.
            if top && left && bottom && right {
                if (depth[a] - depth[d]).abs() <= (depth[b] - depth[c]).abs() {
                    faces.extend([[a, d, b], [a, c, d]]);
                } else {
                    faces.extend([[a, c, b], [b, c, d]]);
                }
            } else if top && left {
                faces.push([a, c, b]);
            } else if top && right {
                faces.push([a, d, b]);
            } else if left && bottom {
                faces.push([a, c, d]);
            } else if bottom && right {
                faces.push([b, c, d]);
            }
        }
    }
    // The brightest percent may clip in the colors; the rest of the range shows the surface.
    let peak = {
        let mut v: Vec<f32> = (0..depth.len())
            .filter(|i| depth[*i].is_finite())
            .flat_map(|i| white.pixel(i % width, i / width).to_vec())
            .collect();
        let at = v.len().saturating_sub(1) * 99 / 100;
        if v.is_empty() { 1.0 } else { order_statistic(&mut v, at).max(1e-6) }
    };
    for f in &faces {
        for i in f {
            if index[*i] == u32::MAX {
                index[*i] = out.vertices.len() as u32;
                out.vertices.push(point(undistorted, *i, depth[*i]));
                out.normals.push(normals[*i]);
                let px = white.pixel(i % width, i / width);
                out.colors.push(std::array::from_fn(|c| {
                    ((px[c.min(px.len() - 1)] / peak).clamp(0.0, 1.0).powf(1.0 / 2.2) * 255.0).round() as u8
                }));
            }
        }
    }
    out.faces = faces.into_iter().map(|f| f.map(|i| index[i])).collect();
    out
}
