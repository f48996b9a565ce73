use nelu3d::PixelStatus;
use nelu3d::progress::StageTime;
use nelu3d::result::ResultMetadata;
use nelu3d_evaluate::{EvaluatedMaps, evaluate};
use nelu3d_scan::{Camera, Mesh};

use super::*;

/// A ball of 100 mm before a wall, seen by a small camera, as its own ground truth plus a ripple of 0.2 mm.
pub(super) fn ball() -> (Surface, Camera, GroundTruth) {
    let (width, height) = (320, 240);
    let camera = Camera::pinhole(width, height, 400.0, 400.0, 159.5, 119.5);
    let n = width * height;
    let (mut depth, mut normals) = (vec![700.0; n], vec![[0.0, 0.0, -1.0]; n]);
    for i in 0..n {
        let dir = camera.ray([(i % width) as f64, (i / width) as f64]).dir;
        let center = nalgebra::Vector3::new(0.0, 0.0, 600.0);
        let (b, c) = (dir.dot(&center), center.norm_squared() - 100.0 * 100.0);
        if b * b > c {
            let p = dir * (b - (b * b - c).sqrt());
            let normal = (p - center) / 100.0;
            depth[i] = p.z as f32;
            normals[i] = [normal.x as f32, normal.y as f32, normal.z as f32];
        }
    }
    let truth = GroundTruth { width, height, depth: depth.clone(), mask: vec![true; n] };
    let mut status = vec![PixelStatus::Valid; n];
    for i in 0..n {
        depth[i] += 0.2 * ((i % width) as f32 * 0.2).sin();
        if i % width < 20 {
            status[i] = if i / width < 120 { PixelStatus::Underexposed } else { PixelStatus::DepthDiscontinuity };
            depth[i] = f32::NAN;
            normals[i] = [f32::NAN; 3];
        }
    }
    let vertices: Vec<[f32; 3]> = (0..n)
        .map(|i| {
            let ray = camera.ray([(i % width) as f64, (i / width) as f64]);
            let p = ray.at(f64::from(truth.depth[i]) / ray.dir.z);
            [p.x as f32, p.y as f32, p.z as f32]
        })
        .collect();
    let quads = (0..height - 1).flat_map(|y| (0..width - 1).map(move |x| (y * width + x) as u32));
    let w = width as u32;
    let faces = quads.flat_map(|i| [[i, i + w, i + 1], [i + 1, i + w, i + w + 1]]).collect();
    let white = Image {
        width,
        height,
        channels: 1,
        data: normals.iter().map(|n| if n[2].is_finite() { -0.8 * n[2] } else { 0.02 }).collect(),
    };
    let colors =
        (0..n as u32).map(|i| if (i / 16 + i / w / 16).is_multiple_of(2) { [230, 120, 60] } else { [70; 3] }).collect();
    let result = Surface {
        width,
        height,
        sigma: depth.iter().map(|z| 0.0002 * z).collect(),
        residual: depth.iter().map(|z| 0.01 + 0.0 * z).collect(),
        ambient: depth.iter().map(|z| 0.1 + 0.0 * z).collect(),
        depth,
        normals,
        status,
        white,
        mesh: Mesh { vertices, normals: Vec::new(), colors, faces },
    };
    (result, camera, truth)
}

#[test]
fn a_page_needs_nothing_else_and_is_small() {
    let (result, camera, truth) = ball();
    let maps = EvaluatedMaps { depth: &result.depth, normals: Some(&result.normals), sigma: Some(&result.sigma) };
    let metrics = evaluate(&maps, &truth, &truth.regions(&camera), &camera, None);
    let about = ResultMetadata { scene: "<ball>".to_owned(), ..ResultMetadata::default() };
    let losses: Vec<f64> = (0..200).map(|i| (-0.02 * f64::from(i)).exp()).collect();
    let method = serde_json::json!({ "seed": 7, "losses": { "image": losses } });
    let stages = [StageTime { name: "guess & <check>".to_owned(), wall_secs: 1.5, cpu_secs: 2.5 }];
    let summary = Summary::new(&result, &method, &stages, &camera, &about);
    let half = Image { data: result.white.data.iter().map(|v| 0.5 * v).collect(), ..result.white.clone() };
    let images = vec![("white.png".to_owned(), result.white.clone()), ("stripes.png".to_owned(), half)];
    let captures = Captures { images, black: None };
    let page = ResultReport {
        surface: &result,
        summary: &summary,
        metrics: Some(&metrics),
        trace: None,
        captures: &captures,
        truth: Some(&truth),
    };
    let html = page.html();
    for outside in ["http://", "https://", "@import", "src=\"/", "<link"] {
        assert!(!html.contains(outside), "{outside}");
    }
    assert!(!html.contains("{{") && !html.contains("<ball>") && html.contains("&lt;ball&gt;"));
    assert!(html.contains("guess &amp; &lt;check&gt;"));
    assert!(html.len() < 4_000_000, "{} bytes", html.len());
    for shown in [
        "Depth",
        "Error",
        "Normals",
        "1σ",
        "Residual",
        "Pixel status",
        "grazing",
        "white.png",
        "Normalized",
        "Loss",
        "calibrated",
        "Gaussian",
        "stripes.png",
    ] {
        assert!(html.contains(shown), "{shown}");
    }
}
