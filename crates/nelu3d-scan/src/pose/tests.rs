use std::path::Path;
use std::time::Instant;

use super::*;
use crate::Rig;
use crate::board::Detector;

type Detections = Vec<(String, Result<Vec<crate::board::Corner>, String>)>;

/// A shared rig's detections, or `None` (loudly) where the shared data are not there.
fn detect_shared(name: &str) -> Option<(Rig, Detections)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data").join(name);
    if !root.exists() {
        eprintln!("SKIPPED: the shared rig {} is not there", root.display());
        return None;
    }
    let rig = Rig::open(&root).unwrap();
    let detector = Detector::new(rig.board.as_ref().unwrap()).unwrap().with_camera(&rig.camera);
    let mut detections = Vec::new();
    let mut seconds = 0.0;
    for shot in rig.positions().unwrap() {
        let white = rig.read_image(&shot.dir.join(&rig.white)).unwrap();
        let gray = white.to_gray();
        let start = Instant::now();
        let found = detector.detect(&gray, white.width, white.height).map_err(|e| e.to_string());
        seconds += start.elapsed().as_secs_f64();
        detections.push((shot.name, found));
    }
    eprintln!("{name}: {:.0} ms an image", 1e3 * seconds / detections.len() as f64);
    Some((rig, detections))
}

fn shared_rig(name: &str, n_positions: usize) {
    let Some((rig, detections)) = detect_shared(name) else { return };
    let free = Trajectory::fit(&detections, &rig.camera, TrajectoryModel::Free).unwrap();
    for p in &free.positions {
        let t = p.cam_from_board.translation;
        eprintln!(
            "{name} {}: {:.4} px, {} corners, {} rejected, z {:.3}",
            p.position,
            p.rms_px.unwrap(),
            p.n_corners,
            p.n_rejected,
            t.z
        );
    }
    let auto = Trajectory::fit(&detections, &rig.camera, TrajectoryModel::Auto).unwrap();
    eprintln!("{name}: {} because {}; {:?}", auto.model, auto.reason, auto.steps);
    for r in &auto.rejected {
        eprintln!("{name} {}: {}", r.position, r.reason);
    }
    assert_eq!(free.positions.len(), n_positions);
    assert_eq!(auto.positions.len(), n_positions);
    assert!(free.rms_px.unwrap() <= 0.05, "{:?}", free.rms_px);
    assert!(auto.rms_px.unwrap() <= 0.05, "{:?}", auto.rms_px);
}

#[test]
fn every_position_of_the_dlp_rig_is_found() {
    shared_rig("dlp", 34);
}

#[test]
fn every_position_of_the_film_rig_is_found() {
    shared_rig("film", 32);
}
