//! A sphere from end to end: simulate a scanner, calibrate it, reconstruct the sphere, evaluate the surface.
//!
//! ```text
//! cargo run --release -p nelu3d-cli --example sphere
//! ```

use anyhow::{Result, ensure};
use nelu3d::{CalibrationOptions, Progress, ReconstructionOptions, Rig, calibrate, reconstruct};
use nelu3d_evaluate::{EvaluatedMaps, GroundTruth, evaluate};
use nelu3d_sim::spec::{ObjectSpec, SceneSpec, ShapeSpec};
use nelu3d_sim::{Spec, simulate};

fn main() -> Result<()> {
    // A virtual scanner: the preset `demo` looks at a sphere.
    let dir = tempfile::tempdir()?;
    let sphere = ObjectSpec::new(ShapeSpec::Sphere { radius_mm: 50.0 }, [0.0, 0.0, 700.0]);
    let demo = Spec::preset("demo").expect("a preset");
    let spec = Spec { scenes: vec![SceneSpec::new("sphere", vec![sphere])], ..demo };
    simulate(&spec, &dir.path().join("rig"), &|_stage, _done, _total| ())?;

    // Once per rig: the board sweep becomes a color field.
    let rig = Rig::open(&dir.path().join("rig"))?;
    let (set, progress) = (rig.pattern_set(None)?, Progress::none());
    let (field, _report) = calibrate(&rig, set, &CalibrationOptions::default(), &progress)?;

    // Once per scene: the captures become a surface.
    let scene = rig.scene("sphere")?;
    let options = ReconstructionOptions::default();
    let surface = reconstruct(&rig, set, &scene, &field, &options, &progress)?.surface;

    // The simulator knows the ground truth.
    let truth = GroundTruth::read(&scene.dir.join("truth"), &rig.camera)?;
    let maps = EvaluatedMaps { depth: &surface.depth, normals: Some(&surface.normals), sigma: Some(&surface.sigma) };
    let metrics = evaluate(&maps, &truth, &truth.regions(&rig.camera), &rig.camera, None);
    let (median, coverage) = (metrics.body.depth_mm.median, metrics.whole.coverage);
    println!("body median error {median:.3} mm, coverage {:.1} %", 100.0 * coverage);
    ensure!(median < 0.1 && coverage > 0.9, "worse than this scanner can do: {metrics}");
    Ok(())
}
