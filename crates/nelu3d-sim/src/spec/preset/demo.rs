//! Small scanners that render quickly: `demo`, `shapes` and `color`.

use super::parts::{IDENTITY, MIDDLE_MM, charuco_board, marker_board, mixed_patterns, vase};
use crate::spec::{
    AlbedoSpec, BlackImage, CameraSpec, FilmSpec, InterreflectionSpec, LightSpec, ObjectSpec, ProjectorSpec, SceneSpec,
    ShapeSpec, Spec, SweepSpec,
};

/// Returns a scanner with a mono camera and a projector, and a vase.
pub(super) fn demo() -> Spec {
    Spec {
        name: "demo".into(),
        seed: 1,
        supersampling: 3,
        ambient: 0.015,
        interreflection: InterreflectionSpec::OFF,
        camera: CameraSpec {
            width: 320,
            height: 240,
            fx: 900.0,
            fy: 899.0,
            cx: 161.2,
            cy: 118.9,
            distortion: vec![-0.08, 0.06, 0.0005, -0.0008, 0.0],
            channels: "mono".into(),
            bits: 12,
            black_level: 64.0,
            full_well_electrons: 10_000.0,
            read_noise_electrons: 6.0,
            psf_sigma_px: 0.4,
            gain: 1.0,
            electrons_per_sec: 800_000.0.into(),
            exposure_secs: 0.01,
            dark_electrons_per_sec: 0.0,
            shutter_samples: 1,
            vignetting: 0.0,
            color_mixing: IDENTITY,
            mono_images: Vec::new(),
        },
        light: LightSpec::Projector(ProjectorSpec {
            width: 640,
            height: 400,
            fx: 1250.0,
            fy: 1249.0,
            cx: 322.0,
            cy: 203.0,
            distortion: vec![-0.03, 0.02, 0.0004, -0.0003, 0.0],
            position_mm: [190.0, -25.0, 20.0],
            target_mm: [0.0, 0.0, MIDDLE_MM],
            roll: 0.0,
            reference_mm: MIDDLE_MM,
            fill_factor: 1.0,
            focus_mm: MIDDLE_MM,
            focus_tilt: [0.0; 2],
            sharp_sigma_px: 0.6,
            aperture_mm: 10.0,
            vignetting: 4.0,
            black_leak: 0.004,
            gamma: 1.0.into(),
            primaries: IDENTITY,
            black: BlackImage::Off,
        }),
        pattern_sets: vec![mixed_patterns(640.0, 20.0, 7)],
        board: marker_board(5, 22.0, 31.0, 95.0, [100.0, 80.0]),
        board_albedo: [0.04, 0.85],
        sweep: SweepSpec::Stage {
            positions: 24,
            first_mm: MIDDLE_MM - 69.0,
            last_mm: MIDDLE_MM + 69.0,
            center_mm: [0.0, 0.0],
            slope: [0.004, -0.006],
            rotation: [0.03, -0.05, 0.01],
            step_error_mm: 0.02,
            tilt_jitter: 0.0,
            write_poses: false,
        },
        scenes: vec![SceneSpec::new("vase", vec![vase(AlbedoSpec::default())])],
        print_dpi: None,
        board_bend: None,
        board_curl: None,
        sequences: Vec::new(),
    }
}

/// Returns the scanner of [`demo`] with scenes whose depth has a simple closed form.
pub(super) fn shapes() -> Spec {
    Spec { name: "shapes".into(), scenes: shape_scenes(), ..demo() }
}

fn shape_scenes() -> Vec<SceneSpec> {
    let plane = |z, rotation| {
        let shape = ShapeSpec::Plane { width_mm: 150.0, height_mm: 130.0 };
        ObjectSpec { rotation, ..ObjectSpec::new(shape, [0.0, 0.0, z]) }
    };
    let ball = |z, radius_mm| ObjectSpec::new(ShapeSpec::Sphere { radius_mm }, [0.0, 0.0, z]);
    let jump = ShapeSpec::Step { width_mm: 150.0, height_mm: 130.0, jump_mm: 40.0 };
    let step = ObjectSpec { rotation: [0.05, 0.1, 0.0], ..ObjectSpec::new(jump, [5.0, 0.0, MIDDLE_MM - 20.0]) };
    vec![
        SceneSpec::new("plane", vec![plane(MIDDLE_MM, [0.2, -0.35, 0.0])]),
        SceneSpec::new("sphere", vec![ball(MIDDLE_MM, 50.0)]),
        SceneSpec::new("step", vec![step]),
        SceneSpec::new("occlusion", vec![ball(MIDDLE_MM - 20.0, 30.0), plane(MIDDLE_MM + 40.0, [0.0, 0.1, 0.0])]),
    ]
}

/// Returns a scanner with a color camera and film.
pub(super) fn color() -> Spec {
    let waves = AlbedoSpec::Waves { from: [0.85, 0.62, 0.40], to: [0.45, 0.70, 0.80], period_mm: 45.0 };
    let ball = ObjectSpec {
        rotation: [0.3, 0.2, 0.1],
        albedo: waves.clone(),
        ..ObjectSpec::new(ShapeSpec::Sphere { radius_mm: 48.0 }, [0.0, 0.0, MIDDLE_MM])
    };
    Spec {
        name: "color".into(),
        seed: 2,
        ambient: 0.0,
        camera: CameraSpec {
            channels: "rgb".into(),
            color_mixing: [[0.90, 0.08, 0.02], [0.07, 0.86, 0.07], [0.02, 0.10, 0.88]],
            ..demo().camera
        },
        light: LightSpec::Film(FilmSpec {
            position_mm: [170.0, -20.0, 60.0],
            target_mm: [0.0, 0.0, MIDDLE_MM],
            flash_offset_mm: [4.0, 0.0, 0.0],
            film_led: [1.0; 3],
            flash_led: [1.0; 3],
            image: None,
            reference_mm: MIDDLE_MM,
            film_mm: 40.0,
            lamp_sigma_mm: 0.05,
            film_half_size_mm: [12.0, 12.0],
            vignetting: 3.0,
            waves: 4,
            min_period_mm: 0.9,
            max_period_mm: 5.0,
            spread: 0.7,
            seed: 11,
        }),
        pattern_sets: Vec::new(),
        board: charuco_board(9, 7, 24.0),
        board_albedo: [0.3, 0.85],
        scenes: vec![
            SceneSpec { black: false, ..SceneSpec::new("vase", vec![vase(waves)]) },
            SceneSpec { black: false, ..SceneSpec::new("ball", vec![ball]) },
        ],
        ..demo()
    }
}
