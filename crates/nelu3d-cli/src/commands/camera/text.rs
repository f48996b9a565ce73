//! The calibration of a camera in words.

use std::fmt::Write as _;

use nelu3d_scan::intrinsics::{IntrinsicsReport, MAP};

/// Names of distortion coefficients, in OpenCV's order.
const NAMES: [&str; 8] = ["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"];
/// Images that are listed at most, of those that are not good.
const MAX_VIEWS: usize = 12;

/// Returns the report for people.
pub(super) fn text(r: &IntrinsicsReport) -> String {
    let mut text = String::new();
    let [fx, fy, cx, cy] = r.pinhole_px;
    let [sx, sy, su, sv] = r.pinhole_sigma_px;
    let _ = writeln!(text, "focal     {fx:.2} ± {sx:.2}, {fy:.2} ± {sy:.2} px");
    let _ = writeln!(text, "center    {cx:.2} ± {su:.2}, {cy:.2} ± {sv:.2} px");
    let coefficients = NAMES.iter().zip(&r.distortion).zip(&r.distortion_sigma);
    let coefficients: Vec<String> = coefficients.map(|((name, k), s)| format!("{name} {k:.5} ± {s:.5}")).collect();
    let lens = if coefficients.is_empty() { "no distortion".to_owned() } else { coefficients.join(", ") };
    let _ = writeln!(text, "lens      {lens}");
    for m in &r.models {
        let held_out =
            m.held_out_px.map_or("too few images to leave any out".into(), |e| format!("held out {e:.4} px"));
        let bent = if m.bent { ", bent board" } else { "" };
        let chosen = if m.chosen { " ← used" } else { "" };
        let _ = writeln!(text, "model     {} coefficients{bent}: {held_out}, BIC {:.0}{chosen}", m.coefficients, m.bic);
    }
    let n = r.views.len();
    let all = r.corners + r.rejected;
    let _ = writeln!(text, "corners   {} of {all} in {n} images, {:.4} px RMS", r.corners, r.rms_px);
    let largest = r.sigma_px.iter().flatten().fold(0.0, |a: f64, b| a.max(*b));
    let residual = r.residual_px.iter().flatten().flatten().fold(0.0, |a: f64, b| a.max(b[0].hypot(b[1])));
    let _ = writeln!(text, "picture   distortion ± {largest:.3} px at worst; mean residual up to {residual:.3} px");
    let _ = writeln!(
        text,
        "coverage  of {} × {} parts of the picture (. none, + a few corners, # 10 or more)",
        MAP[0], MAP[1]
    );
    for row in &r.coverage {
        let row: Vec<&str> = row
            .iter()
            .map(|n| match n {
                0 => ".",
                1..10 => "+",
                _ => "#",
            })
            .collect();
        let _ = writeln!(text, "          {}", row.join(" "));
    }
    if let Some([scale, sigma]) = r.board_scale {
        let _ = writeln!(text, "board     {scale:.5} ± {sigma:.5} times as large as described, by the stage's step");
    }
    let odd: Vec<_> = r.views.iter().filter(|v| v.verdict != "good").collect();
    for v in odd.iter().take(MAX_VIEWS) {
        let _ = writeln!(text, "image     {}: {} ({} corners, {:.3} px)", v.name, v.verdict, v.corners, v.rms_px);
    }
    if odd.len() > MAX_VIEWS {
        let _ = writeln!(text, "image     {} more (--json lists all)", odd.len() - MAX_VIEWS);
    }
    for line in &r.advice {
        let _ = writeln!(text, "advice    {line}");
    }
    text
}
