//! Calibrates a rig, with positions left out, and reconstructs scenes into result folders: a bench for real sweeps.
//!
//! `scan_one RIG SET OUT LEFT_OUT[,…]|- SCENE…`

use nelu3d::result::{MeshFiles, ResultMetadata, Summary, write};
use nelu3d::{CalibrationOptions, Progress, ReconstructionOptions, Rig, calibrate, reconstruct};

struct Print;

impl nelu3d::Sink for Print {
    fn stage(&self, s: &str) {
        eprintln!("  {s}");
    }
    fn tick(&self, _: usize, _: usize) {}
    fn warn(&self, s: &str) {
        println!("warning: {s}");
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    tracing_subscriber::fmt().with_max_level(tracing::Level::DEBUG).with_writer(std::io::stderr).init();
    let args: Vec<String> = std::env::args().skip(1).collect();
    let rig = Rig::open(args[0].as_ref())?;
    let set = rig.pattern_set((args[1] != "-").then_some(args[1].as_str()))?;
    let out = std::path::PathBuf::from(&args[2]);
    let leave_out = args[3].split(',').filter(|n| *n != "-").map(String::from).collect();
    let progress = Progress::new(std::sync::Arc::new(Print), Default::default());
    let opts = CalibrationOptions { leave_out, ..Default::default() };
    let (field, report) = calibrate(&rig, set, &opts, &progress)?;
    let q = report.quality.clone();
    println!("{}; light {:?}; cells {:?}", report.frame, report.light_mm, report.cells);
    if let Some(q) = q {
        println!(
            "held out {:?}: {:.2} of {:.2} dB, all {:.2}, depth {:.3} mm, n {}",
            q.held_out, q.psnr_db, q.ceiling_db, q.psnr_all_db, q.depth_mm, q.n
        );
    }
    for s in &report.stages {
        eprintln!("  {s:?}");
    }
    std::fs::create_dir_all(&out)?;
    field.save(&out.join("field.safetensors"))?;
    for name in &args[4..] {
        let scene = rig.scene(name)?;
        let r = reconstruct(&rig, set, &scene, &field, &ReconstructionOptions::default(), &progress)?;
        let about = ResultMetadata { scene: scene.name, set: set.name.clone(), ..Default::default() };
        let summary = Summary::new(&r.surface, &r.diagnostics, &r.stages, &rig.camera, &about);
        println!("{name}: {} px, statuses {:?}", r.surface.n_valid(), r.surface.status_counts());
        compare(&r.surface, &scene.dir.join("truth/depth.npy"));
        write(&r.surface, &summary, MeshFiles::default(), &out.join(name))?;
    }
    Ok(())
}

/// Prints errors, and what tells right from wrong pixels.
fn compare(s: &nelu3d::Surface, truth: &std::path::Path) {
    let Ok(truth) = nelu3d_scan::npy::read(truth) else { return };
    let (mut all, mut valid, mut none) = (0, 0, 0);
    let (mut right, mut wrong): (Vec<[f32; 4]>, Vec<[f32; 4]>) = Default::default();
    let mut errors = Vec::new();
    for i in 0..s.depth.len() {
        let z = truth.data[i];
        all += usize::from(z.is_finite());
        if !s.depth[i].is_finite() {
            continue;
        }
        if !z.is_finite() {
            none += 1;
            continue;
        }
        valid += 1;
        let e = (s.depth[i] - z).abs();
        errors.push(e);
        let row = [s.residual[i], s.ambient[i], s.sigma[i], e / s.sigma[i]];
        if e < 0.005 * z { right.push(row) } else { wrong.push(row) }
    }
    errors.sort_by(f32::total_cmp);
    let n = errors.len().max(1);
    let at = |share: f64| errors.get((share * n as f64) as usize).copied().unwrap_or(f32::NAN);
    let mae = errors.iter().sum::<f32>() / n as f32;
    let rmse = (errors.iter().map(|e| e * e).sum::<f32>() / n as f32).sqrt();
    println!(
        "  coverage {:.1} %, no truth {none}, MAE {mae:.3}, median {:.3}, p95 {:.3}, RMSE {rmse:.3}, wrong (> 0.5 %) {:.2} %",
        100.0 * valid as f64 / all.max(1) as f64,
        at(0.5),
        at(0.95),
        100.0 * wrong.len() as f64 / n as f64
    );
    for (label, rows) in [("right", &mut right), ("wrong", &mut wrong)] {
        for (c, name) in ["residual", "ambient", "sigma", "error / sigma"].into_iter().enumerate() {
            rows.sort_by(|a, b| a[c].total_cmp(&b[c]));
            let q = |share: f64| rows.get((share * rows.len() as f64) as usize).map_or(f32::NAN, |r| r[c]);
            println!("    {label} {name}: {:.4} {:.4} {:.4} {:.4}", q(0.1), q(0.5), q(0.9), q(0.99));
        }
    }
}
