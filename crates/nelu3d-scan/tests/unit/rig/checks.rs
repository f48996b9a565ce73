//! `check`: nothing on a good rig, and every kind of damage found, all at once.

use std::fs;
use std::path::Path;

use nelu3d_scan::rig::{Finding, Severity, check};
use nelu3d_scan::{Mesh, npy};

use super::*;

/// The finding about `file` that says `expected`.
fn find<'a>(findings: &'a [Finding], severity: Severity, file: &str, expected: &str) -> &'a Finding {
    let found = findings.iter().find(|f| {
        f.severity == severity
            && f.file.ends_with(file)
            && (f.problem.contains(expected) || f.remedy.contains(expected))
    });
    found.unwrap_or_else(|| {
        let all: Vec<String> = findings.iter().map(ToString::to_string).collect();
        panic!("no {severity:?} about {file} saying `{expected}` in:\n{}", all.join("\n"))
    })
}

/// Overwrites an image with one value.
fn flat(rig: &Rig, file: &Path, value: f32) {
    let image = Image { data: vec![value; W * H], ..Image::new(W, H, 1) };
    write_png16(file, &image, rig.black_level, rig.saturation).unwrap();
}

#[test]
fn a_good_rig_has_no_findings() {
    let dir = tempfile::tempdir().unwrap();
    let rig = whole_rig(dir.path());
    let truth = dir.path().join("scenes/cup/truth");
    fs::create_dir(&truth).unwrap();
    let mut depth = vec![400.0; W * H];
    depth[3] = f32::NAN;
    npy::write(&truth.join("depth.npy"), &[H, W], &depth).unwrap();
    nelu3d_scan::image::write_gray8(&truth.join("mask.png"), W, H, &[255; W * H]).unwrap();
    let mesh =
        Mesh { vertices: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], faces: vec![[0, 1, 2]], ..Mesh::default() };
    mesh.write(&truth.join("mesh.ply")).unwrap();
    assert_eq!(rig.check(), []);
    assert_eq!(check(&rig.root.join("rig.toml")), []);
}

#[test]
fn all_that_is_wrong_is_found_at_once() {
    let dir = tempfile::tempdir().unwrap();
    let root = dir.path();
    let rig = whole_rig(root);
    let at = |name: &str| root.join(name);

    fs::write(at("projector.json"), "{\"resx\": 3}").unwrap();
    fs::remove_file(at("calibration/1/black.png")).unwrap();
    fs::remove_file(at("calibration/2/b.png")).unwrap();
    flat(&rig, &at("calibration/10/white.png"), 0.03);
    write_rgb8(&at("scenes/cup/a.png"), W, H, &[9; W * H * 3]).unwrap();
    fs::write(at("scenes/cup/b.png"), b"no image").unwrap();
    write_png8(&at("scenes/cup/a_inv.png"), &Image::new(W, H, 1), 0.0, 255.0).unwrap();
    flat(&rig, &at("sequences/wave/000/white.png"), 1.0);
    flat(&rig, &at("sequences/wave/000/a.png"), 1.0);
    write_png16(&at("sequences/wave/001/b.png"), &Image::new(W, H + 1, 1), 0.0, 1.0).unwrap();
    fs::create_dir(at("sequences/still")).unwrap();
    fs::create_dir(at("scenes/cup/truth")).unwrap();
    npy::write(&at("scenes/cup/truth/depth.npy"), &[W, H], &[1.0; W * H]).unwrap();
    write_rgb8(&at("scenes/cup/truth/mask.png"), W, H, &[9; W * H * 3]).unwrap();
    fs::write(at("scenes/cup/truth/mesh.ply"), "ply\n").unwrap();

    let found = check(root);
    let error = |file: &str, expected: &str| find(&found, Severity::Error, file, expected);
    error("projector.json", "has no `resy`");
    error("calibration/1/black.png", "no such image");
    error("calibration/2/b.png", "no such image");
    error("calibration/10/white.png", "not brighter than black by 2 %");
    error("calibration", "only 0 of 3 positions");
    error("scenes/cup/a.png", "three channels");
    error("scenes/cup/b.png", "neither PNG, TIFF, OpenEXR nor JPEG");
    error("scenes/cup/a_inv.png", "is 8-bit, but white.png is 16-bit");
    error("sequences/wave/000/white.png", "clipped nearly everywhere");
    error("sequences/wave/000/a.png", "shorten the exposure");
    error("sequences/wave/001/b.png", "is 12x9 pixels, but its intrinsics say 12x8");
    error("sequences/still", "no frames");
    error("truth/depth.npy", "has the shape [12, 8], not (height, width) = [8, 12]");
    error("truth/mask.png", "three channels");
    error("truth/mesh.ply", "cannot be used as a mesh");
    assert_eq!(found, check(root), "the order is fixed");
    for f in &found {
        assert!(!f.problem.contains(&f.file.display().to_string()), "the file is said twice: {f}");
    }
}

#[test]
fn broken_descriptions_do_not_stop_the_check() {
    let dir = tempfile::tempdir().unwrap();
    let root = dir.path();
    whole_rig(root);
    let file = root.join("rig.toml");
    let good = fs::read_to_string(&file).unwrap();

    // Several wrong values and no intrinsics: all are listed, and the images are looked at as far as possible.
    let bad = good.replace("\"mono\"", "\"gray\"").replace("marker_mm = 15.0", "marker_mm = 99.0");
    fs::write(&file, bad.replace("saturation = 4095.0", "saturation = 1.0")).unwrap();
    fs::remove_file(root.join("camera.json")).unwrap();
    fs::write(root.join("scenes/cup/a.png"), "").unwrap();
    write_png16(&root.join("scenes/cup/b.png"), &Image::new(3, 3, 1), 0.0, 1.0).unwrap();
    let found = check(root);
    find(&found, Severity::Error, "rig.toml", "`camera.channels` is \"gray\"");
    find(&found, Severity::Error, "rig.toml", "`camera.saturation` is 1");
    find(&found, Severity::Error, "rig.toml", "`board.marker_mm` is 99");
    find(&found, Severity::Error, "camera.json", "there is no such file");
    find(&found, Severity::Error, "scenes/cup/a.png", "it is empty");
    find(&found, Severity::Error, "scenes/cup/b.png", "is 3x3 pixels, but white.png is 12x8");
    assert_eq!(found.len(), 6);

    for (text, expected) in
        [("format = 1\nfoo = 2", "unknown field `foo`"), ("format = 9", "update the program"), ("=", "line 1")]
    {
        fs::write(&file, text).unwrap();
        let found = check(root);
        assert_eq!(found.len(), 1);
        find(&found, Severity::Error, "rig.toml", expected);
    }
    fs::remove_file(&file).unwrap();
    assert!(check(root)[0].problem.contains("is no rig"));
    assert!(check(&root.join("nowhere"))[0].problem.contains("is no rig"));
}

#[test]
fn sweeps_are_judged() {
    let dir = tempfile::tempdir().unwrap();
    let rig = whole_rig(dir.path());
    fs::remove_dir_all(dir.path().join("calibration/10")).unwrap();
    let pose = KnownPose { position: "99".into(), cam_from_board: Isometry3::identity() };
    Rig { board: None, pattern_sets: vec![], ..rig.clone() }.save().unwrap();
    let found = check(dir.path());
    find(&found, Severity::Error, "calibration", "has 2 board positions");
    find(&found, Severity::Error, "rig.toml", "no [board]");
    find(&found, Severity::Error, "rig.toml", "no pattern set");

    Rig { poses: vec![pose], ..rig }.save().unwrap();
    fs::remove_dir_all(dir.path().join("calibration")).unwrap();
    let found = check(dir.path());
    find(&found, Severity::Warning, "calibration", "neither a calibration sweep nor a projector");
    find(&found, Severity::Warning, "rig.toml", "`99`, which has no folder");
    assert_eq!(found.len(), 2);
}

#[test]
fn shared_rigs_have_no_errors() {
    for root in shared_rigs() {
        let found = check(&root);
        let errors: Vec<String> =
            found.iter().filter(|f| f.severity == Severity::Error).map(ToString::to_string).collect();
        assert!(errors.is_empty(), "{}", errors.join("\n"));
    }
}
