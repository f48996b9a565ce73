//! Maps of a result.

use nelu3d::result::picture::{DEPTH_COLORS, Picture, limits, map_color, status_color};
use nelu3d::{PixelStatus, Surface};
use nelu3d_evaluate::GroundTruth;
use nelu3d_scan::statistics::percentile;
use rayon::prelude::*;

use crate::html::{MAX_MAP_WIDTH, color_bar, figure, img, legend};

/// Shows depth, error, normals, uncertainty, residual, ambient fraction and pixel status.
pub(super) fn maps(surface: &Surface, truth: Option<&GroundTruth>) -> String {
    let r = surface;
    let (w, h) = (r.width, r.height);
    let mut maps: Vec<(&str, &str, Picture, String)> = Vec::new();
    // Drawn one after the other: each is as large as the sensor until it is reduced. Compressing them takes longest.
    let mut add =
        |name, note, picture: Picture, legend| maps.push((name, note, picture.at_most(MAX_MAP_WIDTH), legend));

    // Near is bright, as in the preview.
    let [near, far] = limits(&r.depth, 1.0, 99.0);
    let picture = Picture::from_fn(w, h, |i| map_color((near + far) as f32 - r.depth[i], [near, far], DEPTH_COLORS));
    add("Depth", "camera z", picture, color_bar(DEPTH_COLORS, [far, near], "mm"));

    if let Some(truth) = truth {
        let error: Vec<f32> =
            (0..w * h).map(|i| if truth.mask[i] { r.depth[i] - truth.depth[i] } else { f32::NAN }).collect();
        let mut magnitudes: Vec<f64> = error.iter().filter(|e| e.is_finite()).map(|&e| f64::from(e).abs()).collect();
        let p95 = percentile(&mut magnitudes, 95.0);
        let range = if p95 > 0.0 { [-p95, p95] } else { [-1.0, 1.0] };
        let picture = Picture::of_map(&error, w, h, range, colorous::RED_BLUE);
        add("Error", "depth − ground truth", picture, color_bar(colorous::RED_BLUE, range, "mm"));
    }

    let normals = Picture::from_fn(w, h, |i| {
        let [x, y, z] = r.normals[i];
        if x.is_finite() { [x, -y, -z].map(|c| ((c + 1.0) * 127.5) as u8) } else { [24, 26, 31] }
    });
    add("Normals", "red right, green up, blue towards the camera", normals, String::new());

    let scalar = [
        ("1σ of depth", "one standard deviation", &r.sigma, colorous::INFERNO, "mm"),
        (
            "Residual",
            "RMS of normalized intensity that the surface does not explain",
            &r.residual,
            colorous::INFERNO,
            "",
        ),
        ("Ambient", "ambient fraction: light that is not direct, as estimated", &r.ambient, colorous::CIVIDIS, ""),
    ];
    for (name, note, map, colors, unit) in scalar {
        let range = [0.0, limits(map, 1.0, 98.0)[1].max(1e-6)];
        add(name, note, Picture::of_map(map, w, h, range, colors), color_bar(colors, range, unit));
    }
    add("Pixel status", "valid, or why the pixel has no depth", Picture::of_status(&r.status, w, h), status_legend());
    let figure = |(name, note, picture, legend): &(&str, &str, Picture, String)| {
        figure(name, note, &(img(picture, name) + legend))
    };
    maps.par_iter().map(figure).collect()
}

/// Shows the colors of the pixel status.
fn status_legend() -> String {
    legend(&PixelStatus::ALL.map(|l| (status_color(l), l.label())))
}
