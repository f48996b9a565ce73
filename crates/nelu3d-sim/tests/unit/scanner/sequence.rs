//! Moving scenes: where things are, when they are seen, and how far they smear.

use super::common::{edge_moments, image, middle_row, object, plane, rig, scene, spec};
use nelu3d_scan::pattern::{Axis, Pattern, Sinusoid};
use nelu3d_scan::rig::Need;
use nelu3d_scan::{Image, npy};
use nelu3d_sim::spec::{MotionSpec, MovingObjectSpec, ObjectSpec, SequenceSpec, ShapeSpec};
use nelu3d_sim::{GroundTruth, object_at};

fn waves() -> Vec<Pattern> {
    [20.0, 31.0].map(|period_px| Pattern::Sinusoid(Sinusoid { axis: Axis::X, period_px, steps: 1 })).to_vec()
}

fn sequence(objects: Vec<MovingObjectSpec>) -> SequenceSpec {
    SequenceSpec {
        name: "throw".into(),
        fps: 100.0,
        frames: 2,
        flash_delay_secs: 0.004,
        pattern_interval_secs: 0.001,
        pattern_set: None,
        black: true,
        objects,
    }
}

#[test]
fn motion_is_that_of_textbooks() {
    let start = ObjectSpec {
        rotation: [0.0, 0.0, std::f64::consts::FRAC_PI_2],
        ..object([1.0, 2.0, 700.0], ShapeSpec::Sphere { radius_mm: 5.0 })
    };
    let motion = MotionSpec {
        velocity_mm_per_sec: [100.0, -50.0, 0.0],
        acceleration_mm_per_sec2: [0.0, 9810.0, 20.0],
        angular_velocity: [0.0, 0.0, std::f64::consts::PI],
        ..MotionSpec::default()
    };
    let moving = MovingObjectSpec { object: start.clone(), motion };
    assert_eq!(object_at(&moving, 0.0).position_mm, start.position_mm);
    let later = object_at(&moving, 0.25);
    for (got, expected) in later.position_mm.iter().zip([26.0, 2.0 - 12.5 + 306.5625, 700.625]) {
        assert!((got - expected).abs() < 1e-9, "{got}, not {expected}");
    }
    // A quarter turn and an eighth of a turn about the same axis.
    for (got, expected) in later.rotation.iter().zip([0.0, 0.0, 0.75 * std::f64::consts::PI]) {
        assert!((got - expected).abs() < 1e-9, "{got}, not {expected}");
    }
    // About another axis the later turn comes on the left: x → y by the first, y → z by the second.
    let other = MotionSpec { angular_velocity: [std::f64::consts::FRAC_PI_2, 0.0, 0.0], ..MotionSpec::default() };
    let turned = object_at(&MovingObjectSpec { object: start, motion: other }, 1.0);
    let x = nalgebra::Rotation3::from_scaled_axis(nalgebra::Vector3::from(turned.rotation)) * nalgebra::Vector3::x();
    assert!((x - nalgebra::Vector3::z()).norm() < 1e-9, "{x}");
}

/// Waves run and swing, bends and twists swing.
#[test]
fn deformations_move_too() {
    use nelu3d_sim::spec::{AxisSpec, DeformationSpec};
    let at = |deformation, time_secs| {
        let plane = object([0.0, 0.0, 700.0], ShapeSpec::Plane { width_mm: 50.0, height_mm: 50.0 });
        let motion = MotionSpec { vibration_hz: 2.0, phase_per_sec: 3.0, ..MotionSpec::default() };
        let moving = MovingObjectSpec { object: ObjectSpec { deformation: Some(deformation), ..plane }, motion };
        object_at(&moving, time_secs).deformation.unwrap()
    };
    let wave = DeformationSpec::Wave { amplitude_mm: 4.0, wavelength_mm: 30.0, phase: 0.5, direction: [1.0, 0.0, 0.0] };
    let DeformationSpec::Wave { amplitude_mm, phase, .. } = at(wave, 0.25) else { panic!("a wave") };
    assert!((amplitude_mm + 4.0).abs() < 1e-9 && (phase - 1.25).abs() < 1e-9);
    let bend = DeformationSpec::Bend { curvature_per_mm: 0.01, axis: AxisSpec::Y };
    let DeformationSpec::Bend { curvature_per_mm, .. } = at(bend, 0.125) else { panic!("a bend") };
    assert!(curvature_per_mm.abs() < 1e-12);
    assert_eq!(at(bend, 0.5), bend);
}

/// Every image of a frame is that of a scene that stands still where the objects are at the image's own moment; the
/// truth is that of the first pattern's.
#[test]
fn images_and_truth_have_their_own_moments() {
    let mut spec = spec(waves());
    let ball = object([-20.0, 0.0, 680.0], ShapeSpec::Sphere { radius_mm: 18.0 });
    let motion = MotionSpec {
        velocity_mm_per_sec: [2000.0, 300.0, -500.0],
        angular_velocity: [0.0, 3.0, 0.0],
        ..MotionSpec::default()
    };
    let moving = MovingObjectSpec { object: ball, motion };
    let still = MovingObjectSpec { object: plane(760.0), motion: MotionSpec::default() };
    spec.sequences = vec![sequence(vec![moving.clone(), still.clone()])];
    // Pattern, second pattern and flash of frame 1.
    let moments = [0.010, 0.011, 0.014];
    spec.scenes = moments
        .iter()
        .enumerate()
        .map(|(i, &t)| scene(&format!("at{i}"), vec![object_at(&moving, t), object_at(&still, t)]))
        .collect();
    spec.check().unwrap();
    let (_dir, rig) = rig(&spec);
    let frames = rig.sequence("throw").unwrap();
    assert_eq!(frames.iter().map(|f| f.name.as_str()).collect::<Vec<_>>(), ["000", "001"]);
    let set = &rig.pattern_sets[0];
    assert!(rig.read_shot(&frames[0], set, Need::Scene).unwrap().black.is_some());
    let difference = |a: &Image, b: &Image| {
        a.data.iter().zip(&b.data).map(|(a, b)| f64::from((a - b).abs())).sum::<f64>() / a.data.len() as f64
    };
    for (file, moment) in [("sine_00.png", 0), ("sine_01.png", 1), ("white.png", 2)] {
        let got = image(&rig, &frames[1], file);
        let differences: Vec<f64> = (0..moments.len())
            .map(|i| difference(&got, &image(&rig, &rig.scene(&format!("at{i}")).unwrap(), file)))
            .collect();
        for (i, d) in differences.iter().enumerate() {
            // Only the jitter of the rays differs at the same moment.
            let same = i == moment;
            assert!(if same { *d < 5e-4 } else { *d > 10.0 * differences[moment] }, "{file}: {differences:?}");
        }
    }
    let depth = npy::read(&frames[1].dir.join("truth/depth.npy")).unwrap();
    let expected = GroundTruth::of_scene(&spec, 0);
    assert!(depth.data.iter().zip(&expected.depth).all(|(a, b)| a.to_bits() == b.to_bits()));
    assert_eq!(GroundTruth::of_frame(&spec, 0, 1).unwrap(), expected);
    assert_ne!(GroundTruth::of_frame(&spec, 0, 0).unwrap(), expected);
}

/// An edge that moves by a length d during the exposure gains the variance of its n moments, d² (1 − 1/n²) / 12.
#[test]
fn an_edge_smears_as_far_as_it_moves() {
    let mut spec = spec(waves());
    // A wall whose right edge is at x = 0 in the middle of the flash.
    let (speed, secs) = (3000.0, 0.01);
    spec.supersampling = 4;
    let wall = ObjectSpec { shape: ShapeSpec::Plane { width_mm: 400.0, height_mm: 400.0 }, ..plane(700.0) };
    let motion = MotionSpec { velocity_mm_per_sec: [speed, 0.0, 0.0], ..MotionSpec::default() };
    let mut object = wall;
    object.position_mm[0] = -200.0 - speed * 0.004;
    let moving = MovingObjectSpec { object, motion };
    spec.sequences = vec![SequenceSpec { frames: 1, ..sequence(vec![moving]) }];
    spec.camera.exposure_secs = secs;
    let mut moments = |shutter_samples: usize| {
        spec.camera.shutter_samples = shutter_samples;
        let (_dir, rig) = rig(&spec);
        let row = middle_row(&image(&rig, &rig.sequence("throw").unwrap()[0], "white.png"), 0);
        let at: Vec<f64> = (0..row.len()).map(|x| x as f64 - 119.5).collect();
        // The light falls off by the known square and cosine: (distance² / 700²)^(−3/2) in all.
        let fall_off = |x: f64| (1.0 + ((x - 60.0).powi(2) + 0.25) / 490_000.0).powf(-1.5);
        let flat: Vec<f64> = row.iter().zip(&at).map(|(v, x)| v / fall_off(*x)).collect();
        edge_moments(&at, &flat, -30.0, 30.0)
    };
    let (mean, frozen) = moments(1);
    assert!(mean.abs() < 0.05 && frozen < 0.3, "{mean}, {frozen}");
    for n in [2, 8] {
        let (mean, variance) = moments(n);
        // 700 px focal length at 700 mm: a pixel is a millimeter.
        let expected = (speed * secs).powi(2) * (1.0 - 1.0 / (n * n) as f64) / 12.0;
        assert!(mean.abs() < 0.05, "{n}: {mean}");
        assert!(((variance - frozen) / expected - 1.0).abs() < 0.01, "{n}: {} px², not {expected}", variance - frozen);
    }
}

#[test]
fn a_wrong_key_of_a_moving_object_is_named() {
    let text = "position_mm = [0.0, 0.0, 700.0]\nshape = { kind = \"sphere\", radius_mm = 5.0 }\n";
    let good: MovingObjectSpec = toml::from_str(text).unwrap();
    assert_eq!(good.motion, MotionSpec::default());
    for (extra, named) in [("colour = 3", "colour"), ("motion = { speed = 3.0 }", "speed")] {
        let message = toml::from_str::<MovingObjectSpec>(&format!("{text}{extra}\n")).unwrap_err().to_string();
        assert!(message.contains(named), "{message}");
    }
}
