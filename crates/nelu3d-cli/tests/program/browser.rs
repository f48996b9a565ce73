//! The report in a real browser: the script runs, the surface is drawn, nothing is fetched, and a phone need not scroll
//! sideways.
//!
//! Skipped, loudly, where there is no Chromium; `NELU3D_NEED_BROWSER=1` makes that a failure.

use std::path::Path;
use std::process::Command;

use super::common::{RigCopy, chromium, dom};

fn nelu3d(args: &[&str]) {
    let out = Command::new(env!("CARGO_BIN_EXE_nelu3d")).args(args).output().unwrap();
    assert!(out.status.success(), "nelu3d {args:?}: {}", String::from_utf8_lossy(&out.stderr));
}

/// What a page must be; the frame it is measured in has the width of a phone.
fn judge(chromium: &Path, page: &Path) {
    let html = std::fs::read_to_string(page).unwrap();
    for outside in ["http://", "https://", "src=\"/", "<link", "@import", "url("] {
        assert!(!html.contains(outside), "{} asks for something else: {outside}", page.display());
    }
    // Headless windows may be wider than asked for, so a frame of exactly 390 px holds the page; it says how wide it
    // became.
    let measured = page.with_file_name("framed.html");
    let measure = "<script>addEventListener('load',()=>document.documentElement.dataset.width=\
                   document.body.scrollWidth)</script></body>";
    let framed =
        html.replace("</body>", measure).replace("<html lang=\"en\">", "<html lang=\"en\" style=\"width:390px\">");
    std::fs::write(&measured, framed).unwrap();
    let dom = dom(chromium, &format!("file://{}", measured.display()));
    assert!(dom.contains("data-drawn=\"yes\""), "{}: the surface was not drawn", page.display());
    let width: u32 = dom.split("data-width=\"").nth(1).and_then(|s| s.split('"').next()).unwrap().parse().unwrap();
    assert_eq!(width, 390, "{}: a phone has to scroll sideways", page.display());
    std::fs::remove_file(measured).unwrap();
}

#[test]
fn reports_run_in_a_browser_and_fit_a_phone() {
    let Some(chromium) = chromium("no page was opened in a browser") else { return };
    let (dir, rig) = (tempfile::tempdir().unwrap(), RigCopy::new());
    let result = dir.path().join("result");
    nelu3d(&["--quiet", "reconstruct", rig.at("").to_str().unwrap(), "ball", "-o", result.to_str().unwrap()]);
    let path = |p: &Path| p.to_str().unwrap().to_owned();
    judge(&chromium, &result.join("report.html"));

    // Against its own surface: all of it lies on the mesh.
    let cad = dir.path().join("cad");
    let mesh = path(&result.join("mesh.ply"));
    nelu3d(&["--quiet", "evaluate", &path(&result), "--cad", &mesh, "--no-align", "-o", &path(&cad)]);
    let json: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(cad.join("alignment.json")).unwrap()).unwrap();
    assert!(json["metrics"]["part"]["distance_mm"]["rmse"].as_f64().unwrap() < 0.2, "{json}");
    for file in ["distances.npy", "error.ply", "histogram.svg"] {
        assert!(cad.join(file).is_file(), "{file}");
    }
    judge(&chromium, &cad.join("report.html"));

    let other = dir.path().join("other");
    nelu3d(&["--quiet", "evaluate", &path(&result), "--against", &path(&result), "-o", &path(&other)]);
    assert!(other.join("comparison.json").is_file());
    judge(&chromium, &other.join("report.html"));
}
