//! Scanners with a projector: a good one and a cheap one. The numbers and their sources are in docs/simulator.md.

use super::parts::{IDENTITY, MIDDLE_MM, marker_board, mixed_patterns, vase};
use crate::spec::{
    AlbedoSpec, BlackImage, CameraSpec, InterreflectionSpec, LightSpec, ObjectSpec, ProjectorSpec, SceneSpec,
    ShapeSpec, Spec, SweepSpec,
};

/// A machine-vision camera (Sony IMX273, 3.45 µm pixels) behind a 6 mm lens, cropped to 640 × 480.
fn camera() -> CameraSpec {
    CameraSpec {
        width: 640,
        height: 480,
        fx: 1739.0,
        fy: 1738.0,
        cx: 322.6,
        cy: 238.1,
        distortion: vec![-0.09, 0.11, 0.0004, -0.0006, 0.0],
        channels: "mono".into(),
        bits: 12,
        black_level: 64.0,
        full_well_electrons: 11_000.0,
        gain: 1.0,
        read_noise_electrons: 2.8,
        psf_sigma_px: 0.45,
        electrons_per_sec: 700_000.0.into(),
        exposure_secs: 1.0 / 60.0,
        dark_electrons_per_sec: 3.0,
        shutter_samples: 1,
        vignetting: 4.0,
        color_mixing: IDENTITY,
        mono_images: Vec::new(),
    }
}

/// A good projector, three patterns, forty positions.
pub(super) fn dlp() -> Spec {
    Spec {
        name: "dlp".into(),
        seed: 3,
        supersampling: 2,
        ambient: 0.01,
        interreflection: InterreflectionSpec::OFF,
        camera: camera(),
        light: LightSpec::Projector(ProjectorSpec {
            width: 1280,
            height: 800,
            fx: 2710.0,
            fy: 2708.0,
            cx: 648.0,
            cy: 405.0,
            distortion: vec![-0.02, 0.01, 0.0003, -0.0002, 0.0],
            position_mm: [210.0, -20.0, 10.0],
            target_mm: [0.0, 0.0, MIDDLE_MM],
            roll: 0.0,
            reference_mm: MIDDLE_MM,
            // 80 % of the area.
            fill_factor: 0.894,
            focus_mm: 730.0,
            focus_tilt: [0.0; 2],
            sharp_sigma_px: 0.5,
            aperture_mm: 8.0,
            vignetting: 4.0,
            black_leak: 0.002,
            gamma: 1.0.into(),
            primaries: IDENTITY,
            black: BlackImage::Darkest,
        }),
        pattern_sets: vec![mixed_patterns(1280.0, 32.0, 9)],
        board: marker_board(6, 20.0, 27.0, 108.0, [115.0, 85.0]),
        board_albedo: [0.05, 0.85],
        print_dpi: Some(600.0),
        board_bend: None,
        board_curl: None,
        sweep: SweepSpec::Stage {
            positions: 40,
            first_mm: MIDDLE_MM - 75.0,
            last_mm: MIDDLE_MM + 75.0,
            center_mm: [0.0, 0.0],
            slope: [0.003, -0.005],
            rotation: [0.02, -0.06, 0.008],
            step_error_mm: 0.01,
            tilt_jitter: 0.0002,
            write_poses: false,
        },
        scenes: scenes(),
        sequences: Vec::new(),
    }
}

/// A 50-dollar projector: everything that nobody wants to model.
pub(super) fn lcd() -> Spec {
    let dlp = dlp();
    let LightSpec::Projector(good) = dlp.light else { unreachable!("it has a projector") };
    Spec {
        name: "lcd".into(),
        seed: 4,
        ambient: 0.02,
        light: LightSpec::Projector(ProjectorSpec {
            width: 800,
            height: 480,
            fx: 1560.0,
            fy: 1548.0,
            cx: 412.0,
            cy: 256.0,
            distortion: vec![-0.18, 0.09, 0.003, -0.002, 0.0],
            // 60 % of the area.
            fill_factor: 0.775,
            focus_mm: 715.0,
            focus_tilt: [0.35, -0.2],
            sharp_sigma_px: 1.1,
            aperture_mm: 40.0,
            vignetting: 12.0,
            black_leak: 0.015,
            gamma: 2.2.into(),
            ..good
        }),
        pattern_sets: vec![mixed_patterns(800.0, 40.0, 9)],
        ..dlp
    }
}

fn scenes() -> Vec<SceneSpec> {
    let ball = |at: [f64; 3], radius_mm| ObjectSpec::new(ShapeSpec::Sphere { radius_mm }, at);
    let mut beside = vase(AlbedoSpec::default());
    beside.position_mm[0] = -38.0;
    beside.position_mm[2] += 15.0;
    vec![
        SceneSpec::new("sphere", vec![ball([0.0, 0.0, MIDDLE_MM], 60.0)]),
        SceneSpec::new("vase", vec![vase(AlbedoSpec::default())]),
        SceneSpec::new("two", vec![beside, ball([48.0, 30.0, MIDDLE_MM - 25.0], 34.0)]),
    ]
}
