//! `nelu3d table` and `nelu3d decode --method lookup3d`, on a small virtual scanner.

use std::path::Path;
use std::process::Command;

use nelu3d_scan::npy;
use serde_json::Value;

fn nelu3d(args: &[&str]) -> Result<Value, String> {
    let out = Command::new(env!("CARGO_BIN_EXE_nelu3d")).args(args).args(["--json", "-q"]).output().expect("it runs");
    let error = String::from_utf8_lossy(&out.stderr).into_owned();
    if out.status.success() { Ok(serde_json::from_slice(&out.stdout).expect("JSON")) } else { Err(error) }
}

/// A scanner without noise: a board every 8 mm, three shifted sines of less than a period over the depth.
fn rig(dir: &Path) -> String {
    let spec = dir.join("scanner.toml");
    std::fs::write(&spec, SPEC).unwrap();
    let rig = dir.join("rig").display().to_string();
    nelu3d(&["simulate", spec.to_str().unwrap(), "-o", &rig]).unwrap();
    rig
}

const SPEC: &str = include_str!("table.toml");

#[test]
fn tables_go_out_and_come_back_and_decode_the_same() {
    let dir = tempfile::tempdir().unwrap();
    let rig = rig(dir.path());
    let path = |name: &str| dir.path().join(name).display().to_string();
    let depth = |name: &str| npy::read(&dir.path().join(name).join("depth.npy")).unwrap().data;
    let truth = format!("{rig}/scenes/ball/truth");

    let exported = nelu3d(&["table", "export", &rig, "-o", &path("t.npy")]).unwrap();
    let array = npy::read(&dir.path().join("t.npy")).unwrap();
    let sizes = ["height", "width", "positions", "channels"].map(|key| exported[key].as_u64().unwrap() as usize);
    assert_eq!(array.shape, [sizes[0], sizes[1], sizes[2], sizes[3] + 1]);
    let info = nelu3d(&["table", "info", &path("t.npy")]).unwrap();
    assert_eq!((&info["kind"], &info["positions"]), (&"full".into(), &exported["positions"]));

    let decode = |out: &str, more: &[&str]| -> Value {
        let out = path(out);
        let mut args = vec!["decode", &rig, "ball", "--truth", &truth, "-o", &out];
        args.extend(more);
        nelu3d(&args).unwrap()["summary"].clone()
    };
    let body = |summary: &Value, key: &str| summary["metrics"]["body"]["depth_mm"][key].as_f64().unwrap();
    let own = decode("own", &["--method", "lookup3d"]);
    // Boards 8 mm apart: without interpolation a quarter of it is the median error, with it little is left.
    assert!(
        body(&own, "median") < 0.3 && own["metrics"]["body"]["coverage"].as_f64().unwrap() > 0.9,
        "{}",
        own["metrics"]
    );
    let nearest = decode("nearest", &["--method", "lookup3d", "--interpolation", "none", "--max-residual", "0"]);
    assert!((1.0..3.0).contains(&body(&nearest, "median")), "{}", nearest["metrics"]);

    // From the file: the same depths (what is left out depends on the noise, which a file does not tell).
    decode("file", &["--method", "lookup3d", "--table", &path("t.npy")]);
    let (a, b) = (depth("own"), depth("file"));
    let both = a.iter().zip(&b).filter(|(a, b)| a.is_finite() && b.is_finite());
    assert!(both.clone().count() * 10 > 9 * a.iter().filter(|z| z.is_finite()).count());
    assert!(both.clone().all(|(a, b)| (a - b).abs() < 1e-3));

    let fine = decode("fine", &["--method", "lookup3d", "--search", "coarse-to-fine"]);
    assert!((body(&fine, "median") - body(&own, "median")).abs() < 0.02);
    let again = decode("again", &["--method", "lookup3d", "--previous", &path("own")]);
    assert!((body(&again, "median") - body(&own, "median")).abs() < 0.02);
    let half = decode("half", &["--method", "lookup3d", "--stride", "2"]);
    assert!(body(&half, "median") < 2.0 * body(&own, "median") + 0.1, "{}", half["metrics"]);
    assert_eq!(half["method"]["table"]["stride"], 2);

    // Hardly any noise: by itself it would keep nearly every term.
    let low = nelu3d(&["table", "export", &rig, "--low-rank", "10", "-o", &path("t.npz")]).unwrap();
    assert_eq!(low["rank"], 10);
    let low = decode("low", &["--method", "lookup3d-lowrank", "--table", &path("t.npz")]);
    let here = decode("here", &["--method", "lookup3d-lowrank", "--rank", "10"]);
    assert!((body(&low, "median") - body(&own, "median")).abs() < 0.1, "{}", low["metrics"]);
    assert!((body(&here, "median") - body(&low, "median")).abs() < 0.02);
    assert!(low["method"]["table"]["bytes"].as_u64() < own["method"]["table"]["bytes"].as_u64());
}

#[test]
fn what_cannot_be_decoded_is_explained() {
    let dir = tempfile::tempdir().unwrap();
    let rig = rig(dir.path());
    let path = |name: &str| dir.path().join(name).display().to_string();
    let fails = |args: &[&str], why: &str| {
        let e = nelu3d(args).unwrap_err();
        assert!(e.contains(why) && e.trim().lines().count() == 1, "{e} instead of {why}");
    };
    fails(&["table", "export", &rig, "-o", &path("t.npz")], "ends in .npy");
    fails(&["table", "export", &rig, "--low-rank", "4", "-o", &path("t.npy")], "ends in .npz");
    fails(&["table", "export", &rig, "--stride", "0", "-o", &path("t.npy")], "--stride 0");
    fails(&["table", "info", &path("none.npy")], "none.npy");
    npy::write(&dir.path().join("small.npy"), &[2, 3, 2, 4], &[0.5; 48]).unwrap();
    let with = |table: &str| ["decode", &rig, "ball", "--method", "lookup3d", "--table", table, "-o"].map(String::from);
    let small = with(&path("small.npy"));
    let out = path("out");
    let mut args: Vec<&str> = small.iter().map(String::as_str).collect();
    args.push(&out);
    fails(&args, "3 × 2 pixels");
    fails(&["decode", &rig, "ball", "--method", "lookup3d", "--previous", &path("nowhere"), "-o", &out], "nowhere");
}
