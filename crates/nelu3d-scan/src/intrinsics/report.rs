//! What was found, how sure it is, and what would make it surer.

use nalgebra::DMatrix;
use serde::Serialize;

use super::bundle::{Data, Fit};
use super::parameters::{Parameters, Shared, by_coefficients};
use crate::Camera;

/// Columns and rows of the maps over the picture.
pub const MAP: [usize; 2] = [8, 6];

/// A calibrated camera and what is known about it.
#[derive(Clone, Debug)]
pub struct Intrinsics {
    /// The camera.
    pub camera: Camera,
    /// All the rest.
    pub report: IntrinsicsReport,
}

/// How a camera was calibrated, and how well.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct IntrinsicsReport {
    /// Number of distortion coefficients.
    pub coefficients: usize,
    /// Focal lengths and principal point: fx, fy, cx, cy, px.
    pub pinhole_px: [f64; 4],
    /// Their standard deviations, px.
    pub pinhole_sigma_px: [f64; 4],
    /// The distortion, in OpenCV's order.
    pub distortion: Vec<f64>,
    /// Its standard deviations.
    pub distortion_sigma: Vec<f64>,
    /// Root mean square distance between seen and projected corners, px, over those used.
    pub rms_px: f64,
    /// Robust standard deviation of a corner's coordinate, px.
    pub corner_sigma_px: f64,
    /// Corners used.
    pub corners: usize,
    /// Corners rejected as outliers.
    pub rejected: usize,
    /// Every image: what was seen in it, and what it is worth.
    pub views: Vec<ViewReport>,
    /// The models that were tried.
    pub models: Vec<ModelReport>,
    /// Number of corners used, by cell of the picture, row by row.
    pub coverage: [[usize; MAP[0]]; MAP[1]],
    /// Mean residual (seen − projected) by cell of the picture, px; null where no corner is.
    pub residual_px: [[Option<[f64; 2]>; MAP[0]]; MAP[1]],
    /// Standard deviation of where the camera sees a direction, by cell of the picture, px: what principal point and
    /// distortion leave open, a turn of the camera apart.
    pub sigma_px: [[f64; MAP[0]]; MAP[1]],
    /// Sagitta of the board along its x and y, mm, if the images show that it is bent: the depth of its middle against
    /// its edges.
    pub bend_mm: Option<[f64; 2]>,
    /// The board's size over the one described and its standard deviation, where a stage told the scale.
    pub board_scale: Option<[f64; 2]>,
    /// What would make the calibration surer.
    pub advice: Vec<String>,
}

/// What an image is worth.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ViewReport {
    /// Its name.
    pub name: String,
    /// Corners used.
    pub corners: usize,
    /// Corners rejected as outliers.
    pub rejected: usize,
    /// Root mean square distance between seen and projected corners, px.
    pub rms_px: f64,
    /// Angle between the board's normal and the line of sight to its middle, degrees.
    pub tilt_deg: f64,
    /// Depth of the board's middle, mm.
    pub depth_mm: f64,
    /// The verdict: `good`, or what is wrong with it.
    pub verdict: String,
}

/// A model that was tried.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ModelReport {
    /// Number of distortion coefficients.
    pub coefficients: usize,
    /// Whether the board was allowed to be bent.
    pub bent: bool,
    /// Error of corners in images that were left out, px; null where there are too few images to leave any out.
    pub held_out_px: Option<f64>,
    /// Schwarz's information criterion.
    pub bic: f64,
    /// Whether it was chosen.
    pub chosen: bool,
}

/// Returns the standard deviations of the shared parameters.
pub(super) fn sigmas(fit: &Fit, covariance: &DMatrix<f64>, which: impl Fn(Shared) -> bool) -> Vec<f64> {
    let chosen = fit.free.iter().enumerate().filter(|(_, s)| which(**s));
    chosen.map(|(k, _)| covariance[(k, k)].max(0.0).sqrt()).collect()
}

/// Returns the middle of each cell of the picture.
fn cells(camera: &Camera) -> impl Iterator<Item = (usize, usize, [f64; 2])> {
    let size = [camera.width as f64, camera.height as f64];
    (0..MAP[1]).flat_map(move |row| {
        (0..MAP[0]).map(move |column| {
            let at = [column, row].map(|i| i as f64 + 0.5);
            (column, row, [0, 1].map(|k| at[k] * size[k] / MAP[k] as f64 - 0.5))
        })
    })
}

/// Returns the cell of a pixel.
fn cell(camera: &Camera, px: [f64; 2]) -> [usize; 2] {
    let size = [camera.width as f64, camera.height as f64];
    [0, 1].map(|k| (((px[k] + 0.5) / size[k] * MAP[k] as f64).max(0.0) as usize).min(MAP[k] - 1))
}

/// Counts corners by cell, and averages their residuals.
#[expect(clippy::type_complexity, reason = "two maps")]
pub(super) fn maps(data: &Data<'_>, fit: &Fit) -> ([[usize; MAP[0]]; MAP[1]], [[Option<[f64; 2]>; MAP[0]]; MAP[1]]) {
    let (mut counts, mut sums) = ([[0; MAP[0]]; MAP[1]], [[[0.0; 2]; MAP[0]]; MAP[1]]);
    for (i, view) in data.views.iter().enumerate() {
        for (c, _) in view.corners.iter().zip(&fit.used[i]).filter(|(_, u)| **u) {
            let Some(r) = data.residual(&fit.parameters, i, c) else { continue };
            let [column, row] = cell(&fit.parameters.camera, c.px);
            counts[row][column] += 1;
            (0..2).for_each(|k| sums[row][column][k] += r[k]);
        }
    }
    let mean = |row: usize, column: usize| {
        let n = counts[row][column];
        (n > 0).then(|| sums[row][column].map(|s: f64| s / n as f64))
    };
    (counts, std::array::from_fn(|row| std::array::from_fn(|column| mean(row, column))))
}

/// Returns the standard deviation of the pixel at which directions are seen, by cell. A turn of the camera, which poses
/// take up, and the focal length, which is told by itself, are left out: by weighted least squares over the cells, their
/// part is taken off every direction of uncertainty.
pub(super) fn sigma_map(fit: &Fit, covariance: &DMatrix<f64>) -> [[f64; MAP[0]]; MAP[1]] {
    let p: &Parameters = &fit.parameters;
    let camera = &p.camera;
    let n = 2 * MAP[0] * MAP[1];
    let mut by_shared = DMatrix::zeros(n, fit.free.len());
    // What is not distortion: shifts, magnification, and a turn about the axis.
    let mut harmless = DMatrix::zeros(n, 5);
    for (i, (_, _, px)) in cells(camera).enumerate() {
        let ideal = camera.undistort(px);
        let plane = camera.distortion.distort(ideal);
        let by_k = by_coefficients(&p.coefficients(), ideal);
        for k in 0..2 {
            let focal = [camera.fx, camera.fy][k];
            for (j, which) in fit.free.iter().enumerate() {
                by_shared[(2 * i + k, j)] = match *which {
                    Shared::Pinhole(m) if m == k => plane[k],
                    Shared::Pinhole(m) if m == k + 2 => 1.0,
                    Shared::Coefficient(m) => focal * by_k[m][k],
                    _ => 0.0,
                };
            }
            harmless[(2 * i + k, k)] = 1.0;
            harmless[(2 * i + k, 2 + k)] = plane[k];
            harmless[(2 * i + k, 4)] = [-plane[1], plane[0]][k];
        }
    }
    let mut left = by_shared.clone();
    if let Some(inverse) = (harmless.transpose() * &harmless).try_inverse() {
        left -= &harmless * (inverse * (harmless.transpose() * &by_shared));
    }
    let variance = &left * covariance * left.transpose();
    std::array::from_fn(|row| {
        std::array::from_fn(|column| {
            let i = row * MAP[0] + column;
            (variance[(2 * i, 2 * i)] + variance[(2 * i + 1, 2 * i + 1)]).max(0.0).sqrt()
        })
    })
}

/// Judges every image.
pub(super) fn views(data: &Data<'_>, fit: &Fit) -> Vec<ViewReport> {
    let norms = data.norms(&fit.parameters);
    let rms = |i: usize| {
        let used: Vec<f64> = norms[i].iter().zip(&fit.used[i]).filter(|(_, u)| **u).map(|(r, _)| r * r).collect();
        (used.iter().sum::<f64>() / used.len().max(1) as f64).sqrt()
    };
    let of = |i: usize| {
        let (view, pose) = (data.views[i], &fit.parameters.poses[i]);
        let corners = fit.used[i].iter().filter(|u| **u).count();
        let rejected = view.corners.len() - corners;
        let at = (pose * fit.parameters.on_board(data.middle.at, &data.middle).0).coords;
        let normal = pose.rotation * nalgebra::Vector3::z();
        let tilt_deg = (normal.dot(&at.normalize())).clamp(-1.0, 1.0).acos().to_degrees();
        let rms_px = rms(i);
        let verdict = if 3 * rejected > view.corners.len() {
            "many corners fit no flat board: it moved, is covered, or is bent".to_owned()
        } else if rms_px > 2.5 * std::f64::consts::SQRT_2 * fit.sigma_px {
            "fits worse than the others: blurred, moved, or unevenly lit".to_owned()
        } else if view.corners.len() < 8 {
            "shows little of the board".to_owned()
        } else {
            "good".to_owned()
        };
        ViewReport { name: view.name.clone(), corners, rejected, rms_px, tilt_deg, depth_mm: at.z, verdict }
    };
    (0..data.views.len()).map(of).collect()
}

/// Returns what to add: parts of the picture without corners, and angles.
pub(super) fn advice(report: &IntrinsicsReport) -> Vec<String> {
    let mut advice = Vec::new();
    let empty = |rows: std::ops::Range<usize>, columns: std::ops::Range<usize>| {
        let cells = rows.clone().flat_map(|r| columns.clone().map(move |c| (r, c)));
        let n = cells.clone().count();
        2 * cells.filter(|(r, c)| report.coverage[*r][*c] == 0).count() > n
    };
    let [w, h] = MAP;
    let parts = [
        ("top left", empty(0..h / 3, 0..w / 4)),
        ("top right", empty(0..h / 3, 3 * w / 4..w)),
        ("bottom left", empty(2 * h / 3..h, 0..w / 4)),
        ("bottom right", empty(2 * h / 3..h, 3 * w / 4..w)),
        ("middle", empty(h / 3..2 * h / 3, w / 4..3 * w / 4)),
    ];
    let parts: Vec<&str> = parts.iter().filter(|(_, e)| *e).map(|(name, _)| *name).collect();
    if !parts.is_empty() {
        advice.push(format!("no board was seen at the picture's {}: show it there", parts.join(", ")));
    }
    let tilted = report.views.iter().filter(|v| v.tilt_deg > 15.0).count();
    if tilted < 4 {
        advice.push(format!(
            "{tilted} of {} boards are tilted by more than 15 degrees: tilt it by 20 to 40 to all four sides",
            report.views.len()
        ));
    }
    if report.views.len() < 12 {
        advice.push(format!("{} images are few: 15 to 30 are usual", report.views.len()));
    }
    let worst = report.sigma_px.iter().flatten().fold(0.0, |a: f64, b| a.max(*b));
    if worst > 0.3 {
        advice.push(format!("at the picture's edge distortion is uncertain by {worst:.1} px: show the board there"));
    }
    if let Some([x, y]) = report.bend_mm {
        advice.push(format!("the board is bent by {x:.2} mm along x and {y:.2} mm along y: glue it to something flat"));
    }
    advice
}
