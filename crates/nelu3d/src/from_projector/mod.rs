//! A color field without a sweep, from a calibrated projector and the images that it projected.
//!
//! c(x) is then the pattern at the projector pixel that lights x, seen through the projector's optics (a blur) and its
//! response (a curve). Neither is in any calibration file, so both are estimated from the captures themselves: decode with
//! what is known, compare the captures with the patterns where they were found to come from, and repeat.

use std::path::PathBuf;

use nalgebra::{Point3, Vector3};
use nelu3d_scan::rig::{Need, PatternSet, Shot};
use nelu3d_scan::{Camera, Image, Projector, Rig};
use rayon::prelude::*;

use crate::calibrate::{CalibrationError, CalibrationReport};
use crate::color_field::camera_key;
use crate::color_field::frame::{Center, FieldFrame};
use crate::color_field::grid::Grid;
use crate::color_field::validity::Validity;
use crate::color_field::{ColorField, FieldMetadata, Form};
use crate::progress::Progress;
use crate::progress::StageClock;
use crate::reconstruct::{Codeword, decode_codewords};
use crate::sensor::{NoiseEstimator, quantization_step};

/// What the light does to a projected value v in `[0, 1]`: blur, then `offset + scale · v^gamma`.
#[derive(Clone, Copy, Debug, serde::Serialize)]
struct Response {
    /// Standard deviation of the blur, projector px.
    blur_px: f32,
    offset: f32,
    scale: f32,
    gamma: f32,
}

/// Settings of a field from a calibrated projector.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::Args))]
#[serde(default, deny_unknown_fields)]
pub struct FromProjectorOptions {
    /// Depth range of the field in mm, for --from-projector (default: where the light and the view overlap)
    #[cfg_attr(feature = "clap", arg(long, num_args = 2, value_names = ["NEAR", "FAR"]))]
    pub depth: Option<Vec<f64>>,
}

/// Computes a color field from the calibrated projector, its projected images, and the captures of up to four scenes,
/// which tell its blur and response.
///
/// # Errors
///
/// The projector or a projected image is missing or does not fit, an image cannot be read, no scene could be decoded, or
/// the caller stopped the work.
pub fn calibrate_from_projector(
    rig: &Rig,
    set: &PatternSet,
    opts: &FromProjectorOptions,
    progress: &Progress,
) -> Result<(ColorField, CalibrationReport), CalibrationError> {
    let mut clock = StageClock::new(progress);
    clock.begin("read the patterns");
    let fail = |path: PathBuf, reason: String| CalibrationError::Projector { path, reason };
    let projector = rig.projector.as_ref().ok_or_else(|| {
        fail(rig.root.join("projector.json"), "is missing; --from-projector needs a calibrated projector".into())
    })?;
    let channels = rig.channels.count();
    let mut patterns = Vec::new();
    for name in &set.images {
        let path = rig.root.join("patterns").join(name);
        let image = nelu3d_scan::image::read_any(&path).map_err(|e| fail(path.clone(), e.to_string()))?;
        let (w, h) = (projector.optics.width, projector.optics.height);
        if (image.width, image.height) != (w, h) {
            let reason = format!("is {} × {} px, but projector.json says {w} × {h}", image.width, image.height);
            return Err(fail(path, reason));
        }
        // One plane per channel of the camera; a gray pattern serves all of them.
        for c in 0..channels {
            let data = image.data.chunks_exact(image.channels).map(|p| p[c.min(p.len() - 1)]).collect();
            patterns.push(Image { width: w, height: h, channels: 1, data });
        }
    }
    let scenes = scenes(rig, set)?;
    let [near, far] = depth_range(rig, projector, opts)?;
    let Some(frame) = frame(&rig.camera, projector, near, far) else {
        let reason = format!(
            "its light and the camera's view do not overlap between {near:.0} and {far:.0} mm; check R and T, or give --depth NEAR FAR"
        );
        return Err(fail(rig.root.join("projector.json"), reason));
    };

    clock.begin("read the scenes");
    let mut sensor = NoiseEstimator::default();
    let mut captures = Vec::new();
    for shot in &scenes {
        let capture = rig.read_shot(shot, set, Need::Scene)?;
        sensor.add(&capture.white);
        capture.patterns.iter().for_each(|p| sensor.add(p));
        captures.push(capture);
    }
    let noise = sensor.finish(quantization_step(rig.black_level, rig.saturation));

    clock.begin("estimate blur and response");
    let validity = validity(&rig.camera, projector, &frame, near, far);
    let about = FieldMetadata {
        version: env!("CARGO_PKG_VERSION").into(),
        rig: rig.name.clone(),
        set: set.name.clone(),
        images: set.images.clone(),
        mono: Vec::new(),
        channels,
        center: Center::Light,
        source: "projector".into(),
        camera: camera_key(&rig.camera),
        noise,
        dark: Vec::new(),
        crosstalk: None,
        cells_per_pixel: 1,
        step_mm: 0.0,
        quality: None,
        settings: serde_json::Value::Null,
    };
    let build = |r: Response| {
        let form = Form::Grid(render(&patterns, projector, &frame, r));
        ColorField { frame, form, validity: validity.clone(), metadata: about.clone() }
    };
    let mut best: Option<(f64, Response, ColorField)> = None;
    // Projectors are linear in their codes or nearly sRGB; whichever explains the captures is refined.
    for gamma in [1.0, 2.2] {
        let mut response = Response { blur_px: 1.5, offset: 0.0, scale: 1.0, gamma };
        for round in 0..3 {
            if progress.cancelled() {
                return Err(CalibrationError::Cancelled);
            }
            let field = build(response);
            let mut seen = Vec::new();
            for capture in &captures {
                seen.extend(decode_codewords(capture, &rig.camera, &field));
            }
            if seen.len() < 500 {
                break;
            }
            let (fitted, residual) = fit_response(&patterns, projector, &seen);
            tracing::debug!(gamma, round, ?fitted, residual, pixels = seen.len(), "response");
            if best.as_ref().is_none_or(|b| residual < b.0) {
                best = Some((residual, fitted, build(fitted)));
            } else {
                break;
            }
            response = fitted;
        }
    }
    let Some((residual, response, mut field)) = best else {
        let reason = "no scene could be decoded, so blur and response stay unknown; check the projector's calibration, or give --depth NEAR FAR";
        return Err(fail(rig.root.join("scenes"), reason.into()));
    };
    field.metadata.settings = serde_json::json!({
        "options": opts, "response": response, "residual": residual, "depth_mm": [near, far],
    });
    let center = projector.center();
    let cells = match &field.form {
        Form::Grid(g) => g.cells,
        Form::Hash(_) | Form::Frequency(_) => unreachable!("a field from a projector is a grid"),
    };
    let report = CalibrationReport {
        trajectory: None,
        light_mm: Some([center.x, center.y, center.z]),
        quality: None,
        frame: format!(
            "light: the calibrated projector, blur {:.2} px, response {:.3} + {:.3} v^{:.2}, median misfit {residual:.3}",
            response.blur_px, response.offset, response.scale, response.gamma
        ),
        shortfall: None,
        cells,
        stages: clock.finish(),
    };
    Ok((field, report))
}

/// The scenes whose captures tell blur and response: up to four that have the set's images.
fn scenes(rig: &Rig, set: &PatternSet) -> Result<Vec<Shot>, CalibrationError> {
    let has_all = |s: &Shot| set.images.iter().chain([&rig.white]).all(|n| s.dir.join(n).exists());
    let found: Vec<Shot> = rig.scenes()?.into_iter().filter(has_all).take(4).collect();
    if found.is_empty() {
        let reason = format!(
            "holds no scene with the images of set `{}`; --from-projector estimates blur and response from captures",
            set.name
        );
        return Err(CalibrationError::Projector { path: rig.root.join("scenes"), reason });
    }
    Ok(found)
}

/// `[near, far]` depth, mm: as given, or around where the optical axes come closest.
fn depth_range(rig: &Rig, projector: &Projector, opts: &FromProjectorOptions) -> Result<[f64; 2], CalibrationError> {
    if let Some(range) = &opts.depth {
        if range.len() == 2 && range[0] > 0.0 && range[1] > range[0] {
            return Ok([range[0], range[1]]);
        }
        return Err(CalibrationError::Projector {
            path: rig.root.clone(),
            reason: "--depth needs two distances in mm, 0 < NEAR < FAR".into(),
        });
    }
    let z = crossing_depth(&rig.camera, projector);
    Ok([0.6 * z, 1.6 * z])
}

/// Mean depth of where the middle of the projected image meets the middle of the view, mm; 1000 where they never do.
pub fn crossing_depth(camera: &Camera, projector: &Projector) -> f64 {
    let center = projector.center();
    let o = &projector.optics;
    let [x, y] = o.undistort([o.width as f64 / 2.0, o.height as f64 / 2.0]);
    let light = projector.proj_from_cam.rotation.inverse() * Vector3::new(x, y, 1.0).normalize();
    let view = camera.ray([camera.width as f64 / 2.0, camera.height as f64 / 2.0]).dir;
    let (b, c) = (view.dot(&light), center.coords);
    let denominator = 1.0 - b * b;
    let t = if denominator > 1e-6 { (c.dot(&view) - b * c.dot(&light)) / denominator } else { 1000.0 };
    if t > 0.0 { t * view.z } else { 1000.0 }
}

/// A frame centered on the projector over what both see between two depths; `None` when that is nothing.
fn frame(camera: &Camera, projector: &Projector, near: f64, far: f64) -> Option<FieldFrame> {
    let mut seen = Vec::new();
    for y in (0..=camera.height).step_by((camera.height / 24).max(1)) {
        for x in (0..=camera.width).step_by((camera.width / 24).max(1)) {
            let dir = camera.ray([x as f64, y as f64]).dir;
            for i in 0..=24 {
                let z = near * (far / near).powf(f64::from(i) / 24.0);
                let p = Point3::from(dir * (z / dir.z));
                if in_image(projector, &p) {
                    seen.push(p);
                }
            }
        }
    }
    if seen.len() < 8 {
        return None;
    }
    let mean = seen.iter().map(|p| p.coords).sum::<Vector3<f64>>() / seen.len() as f64;
    let right = projector.proj_from_cam.rotation.inverse() * Vector3::x();
    let mut frame = FieldFrame::around(projector.center(), Point3::from(mean), right);
    seen.iter().for_each(|p| frame.enclose(p));
    for i in 0..3 {
        let margin = 0.03 * (frame.hi[i] - frame.lo[i]);
        frame.lo[i] -= margin;
        frame.hi[i] += margin;
    }
    Some(frame)
}

fn in_image(projector: &Projector, p: &Point3<f64>) -> bool {
    let (w, h) = (projector.optics.width as f64, projector.optics.height as f64);
    projector.project(p).is_some_and(|[x, y]| x >= 0.0 && y >= 0.0 && x <= w - 1.0 && y <= h - 1.0)
}

fn validity(camera: &Camera, projector: &Projector, frame: &FieldFrame, near: f64, far: f64) -> Validity {
    let mut v = Validity::new(camera.width, camera.height, 8, [96, 96, 4]);
    let [ca, cb, cw] = v.shape.cells;
    for b in 0..cb {
        for a in 0..ca {
            for w in 0..cw {
                let q = [(a as f64 + 0.5) / ca as f64, (b as f64 + 0.5) / cb as f64, (w as f64 + 0.5) / cw as f64];
                v.lit[(b * ca + a) * cw + w] = in_image(projector, &frame.from_unit(q)) as u8;
            }
        }
    }
    let tiles = v.shape.tiles;
    for ty in 0..tiles[1] {
        for tx in 0..tiles[0] {
            let dir = camera.ray([tx as f64 * 8.0 + 3.5, ty as f64 * 8.0 + 3.5]).dir;
            v.t_range[ty * tiles[0] + tx] = [(near / dir.z) as f32, (far / dir.z) as f32];
        }
    }
    v
}

/// The field: blurred patterns through the response, sampled at the nodes of a grid as fine as the projector's pixels.
fn render(patterns: &[Image], projector: &Projector, frame: &FieldFrame, r: Response) -> Grid {
    let blurred: Vec<Image> = patterns.iter().map(|p| blur(&curve(p, r.gamma), r.blur_px)).collect();
    // Projector pixels across the frame at its middle.
    let px = |q: [f64; 3]| projector.project(&frame.from_unit(q)).unwrap_or([0.0; 2]);
    let length = |p: [f64; 2], q: [f64; 2]| (p[0] - q[0]).hypot(p[1] - q[1]);
    let across = length(px([0.0, 0.5, 0.5]), px([1.0, 0.5, 0.5])).ceil().clamp(8.0, 2048.0) as usize;
    let down = length(px([0.5, 0.0, 0.5]), px([0.5, 1.0, 0.5])).ceil().clamp(8.0, 2048.0) as usize;
    let k = patterns.len();
    // Nothing changes along the projector's rays: one cell.
    let mut grid = Grid::new([across, down, 1], k);
    let [na, nb, nw] = grid.nodes();
    let mut values = vec![0.0f32; na * nb * nw * k];
    values.par_chunks_mut(na * nw * k).enumerate().for_each(|(b, row)| {
        for a in 0..na {
            let q = [(a as f64 - 1.0) / across as f64, (b as f64 - 1.0) / down as f64, 0.5];
            let at = projector.project(&frame.from_unit(q));
            for (j, image) in blurred.iter().enumerate() {
                let v = at.map_or(0.0, |at| bilinear(image, at));
                for w in 0..nw {
                    row[(a * nw + w) * k + j] = r.offset + r.scale * v;
                }
            }
        }
    });
    grid.interpolate(&values);
    grid
}

fn curve(image: &Image, gamma: f32) -> Image {
    Image { data: image.data.iter().map(|v| v.max(0.0).powf(gamma)).collect(), ..*image }
}

/// Gaussian blur with mirrored borders.
fn blur(image: &Image, sigma: f32) -> Image {
    if sigma < 0.05 {
        return image.clone();
    }
    let radius = (3.0 * sigma).ceil() as isize;
    let mut kernel: Vec<f32> = (-radius..=radius).map(|i| (-(i * i) as f32 / (2.0 * sigma * sigma)).exp()).collect();
    let sum: f32 = kernel.iter().sum();
    kernel.iter_mut().for_each(|k| *k /= sum);
    let (w, h) = (image.width as isize, image.height as isize);
    let mirror = |i: isize, n: isize| {
        let m = if i < 0 { -i } else { i };
        (if m >= n { 2 * n - 2 - m } else { m }).clamp(0, n - 1)
    };
    let pass = |src: &[f32], horizontal: bool| -> Vec<f32> {
        (0..w * h)
            .into_par_iter()
            .map(|i| {
                let (x, y) = (i % w, i / w);
                let tap = |o: isize| {
                    let (sx, sy) = if horizontal { (mirror(x + o, w), y) } else { (x, mirror(y + o, h)) };
                    src[(sy * w + sx) as usize]
                };
                kernel.iter().enumerate().map(|(k, weight)| weight * tap(k as isize - radius)).sum()
            })
            .collect()
    };
    Image { data: pass(&pass(&image.data, true), false), ..*image }
}

fn bilinear(image: &Image, [x, y]: [f64; 2]) -> f32 {
    let (w, h) = (image.width, image.height);
    let (x, y) = (x.clamp(0.0, w as f64 - 1.0), y.clamp(0.0, h as f64 - 1.0));
    let (x0, y0) = ((x as usize).min(w - 2), (y as usize).min(h - 2));
    let (fx, fy) = ((x - x0 as f64) as f32, (y - y0 as f64) as f32);
    let at = |dx: usize, dy: usize| image.data[(y0 + dy) * w + x0 + dx];
    (at(0, 0) * (1.0 - fx) + at(1, 0) * fx) * (1.0 - fy) + (at(0, 1) * (1.0 - fx) + at(1, 1) * fx) * fy
}

/// Blur and response that make the patterns look most like what was seen: for every blur and gamma the best affine map
/// (robust least squares), over a coarse and then a fine search. Returns the median absolute residual.
fn fit_response(patterns: &[Image], projector: &Projector, seen: &[Codeword]) -> (Response, f64) {
    let step = (seen.len() / 20_000).max(1);
    let at: Vec<([f64; 2], &[f32])> = seen
        .iter()
        .step_by(step)
        .filter_map(|s| Some((projector.project(&Point3::from(s.point))?, &s.intensities[..])))
        .collect();
    let score = |blur_px: f32, gamma: f32| -> (f64, f32, f32) {
        let images: Vec<Image> = patterns.iter().map(|p| blur(&curve(p, gamma), blur_px)).collect();
        let pairs: Vec<(f32, f32)> = at
            .iter()
            .flat_map(|(px, seen)| images.iter().zip(*seen).map(|(i, l)| (bilinear(i, *px), *l)))
            .filter(|(_, l)| l.is_finite())
            .collect();
        let (mut offset, mut scale) = (0.0f64, 1.0f64);
        let mut tolerance = 0.1f64;
        for _ in 0..8 {
            let (mut s, mut sx, mut sxx, mut sy, mut sxy) = (0.0, 0.0, 0.0, 0.0, 0.0);
            for (v, l) in &pairs {
                let (v, l) = (f64::from(*v), f64::from(*l));
                let r = l - offset - scale * v;
                let w = 1.0 / (1.0 + (r / tolerance).powi(2)).powi(2);
                s += w;
                sx += w * v;
                sxx += w * v * v;
                sy += w * l;
                sxy += w * v * l;
            }
            let det = s * sxx - sx * sx;
            if det > 1e-12 {
                offset = (sxx * sy - sx * sxy) / det;
                scale = (s * sxy - sx * sy) / det;
            }
            tolerance = (tolerance * 0.7).max(0.03);
        }
        let mut r: Vec<f64> =
            pairs.iter().map(|(v, l)| (f64::from(*l) - offset - scale * f64::from(*v)).abs()).collect();
        let mid = r.len() / 2;
        (*r.select_nth_unstable_by(mid, f64::total_cmp).1, offset as f32, scale as f32)
    };
    let search = |candidates: Vec<(f32, f32)>| {
        candidates
            .into_iter()
            .map(|(b, g)| (score(b, g), b, g))
            .min_by(|a, b| a.0.0.total_cmp(&b.0.0))
            .expect("there are candidates")
    };
    let blurs = [0.0, 0.7, 1.2, 1.7, 2.3, 3.2, 4.5];
    let coarse = search(blurs.iter().flat_map(|b| [0.8, 1.0, 1.3, 1.8, 2.2].map(|g| (*b, g))).collect());
    let fine = (-2i32..=2)
        .flat_map(|i| (-1i32..=1).map(move |j| (i, j)))
        .map(|(i, j)| ((coarse.1 + 0.2 * i as f32).max(0.0), coarse.2 * (1.0 + 0.1 * j as f32)))
        .collect();
    let ((residual, offset, scale), blur_px, gamma) = search(fine);
    (Response { blur_px, offset, scale, gamma }, residual)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Patterns seen through a known blur and response give them back.
    #[test]
    fn finds_blur_and_response() {
        let (w, h) = (400, 60);
        let mut data = vec![0.0f32; w * h];
        let mut state = 7u32;
        for x in 0..w {
            if x % 5 == 0 {
                state = state.wrapping_mul(1664525).wrapping_add(1013904223);
            }
            for y in 0..h {
                data[y * w + x] = (state >> 8) as f32 / (1 << 24) as f32;
            }
        }
        let pattern = Image { width: w, height: h, channels: 1, data };
        let projector = Projector {
            optics: Camera::pinhole(w, h, 500.0, 500.0, 200.0, 30.0),
            proj_from_cam: nalgebra::Isometry3::translation(-100.0, 0.0, 0.0),
        };
        let truth = Response { blur_px: 1.7, offset: 0.03, scale: 0.9, gamma: 1.3 };
        let image = blur(&curve(&pattern, truth.gamma), truth.blur_px);
        let seen: Vec<Codeword> = (0..4000)
            .map(|i| {
                let point = [100.0 + f64::from(i % 200 - 100) * 2.3, f64::from(i / 200 - 10) * 2.0, 650.0];
                let px = projector.project(&Point3::from(point)).unwrap();
                Codeword { point, intensities: vec![truth.offset + truth.scale * bilinear(&image, px)] }
            })
            .collect();
        let (found, residual) = fit_response(&[pattern], &projector, &seen);
        assert!(residual < 0.005, "{residual}");
        assert!((found.blur_px - truth.blur_px).abs() < 0.25 && (found.gamma - truth.gamma).abs() < 0.15, "{found:?}");
    }
}
