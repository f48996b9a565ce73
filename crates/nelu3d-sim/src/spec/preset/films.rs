//! Scanners with a film projector, one with a machine-vision and one with a high-speed camera. The numbers and their
//! sources are in docs/simulator.md.

use super::parts::{MIDDLE_MM, charuco_board, vase};
use crate::spec::{
    AlbedoSpec, CameraSpec, FilmSpec, InterreflectionSpec, LightSpec, MotionSpec, MovingObjectSpec, ObjectSpec,
    SceneSpec, SequenceSpec, ShapeSpec, Spec, SweepSpec,
};

/// A LUCID Triton with a Sony IMX273 (3.45 µm pixels), a 6 mm lens, cropped to 640 × 480.
pub(super) fn triton() -> Spec {
    Spec {
        name: "film-triton".into(),
        seed: 5,
        supersampling: 2,
        ambient: 0.0,
        interreflection: InterreflectionSpec::OFF,
        camera: CameraSpec {
            width: 640,
            height: 480,
            fx: 1739.0,
            fy: 1738.0,
            cx: 317.2,
            cy: 243.0,
            distortion: vec![-0.09, 0.11, 0.0004, -0.0006, 0.0],
            channels: "bayer-rggb".into(),
            bits: 10,
            black_level: 16.0,
            full_well_electrons: 11_000.0,
            gain: 1.0,
            read_noise_electrons: 2.8,
            psf_sigma_px: 0.5,
            electrons_per_sec: 4_000_000.0.into(),
            exposure_secs: 0.002,
            dark_electrons_per_sec: 3.0,
            shutter_samples: 4,
            vignetting: 4.0,
            color_mixing: [[0.86, 0.12, 0.02], [0.10, 0.80, 0.10], [0.03, 0.15, 0.82]],
            mono_images: Vec::new(),
        },
        light: LightSpec::Film(film()),
        pattern_sets: Vec::new(),
        board: charuco_board(10, 8, 20.0),
        board_albedo: [0.3, 0.85],
        print_dpi: Some(600.0),
        board_bend: None,
        board_curl: None,
        sweep: SweepSpec::Stage {
            positions: 40,
            first_mm: MIDDLE_MM - 75.0,
            last_mm: MIDDLE_MM + 75.0,
            center_mm: [0.0, 0.0],
            slope: [-0.004, 0.002],
            rotation: [-0.03, -0.05, 0.01],
            step_error_mm: 0.01,
            tilt_jitter: 0.0002,
            write_poses: false,
        },
        scenes: vec![
            SceneSpec { black: false, ..SceneSpec::new("vase", vec![vase(colors())]) },
            SceneSpec { black: false, ..SceneSpec::new("ball", vec![ball([0.0, 0.0, MIDDLE_MM])]) },
        ],
        // 400 images a second, pattern and flash in turns.
        sequences: vec![flying_ball(200.0, 0.0025)],
    }
}

/// A Kron Chronos 1.4 (LUX1310, 6.6 µm pixels), a 12 mm lens, cropped to 640 × 480, with little light.
pub(super) fn chronos() -> Spec {
    let triton = triton();
    Spec {
        name: "film-chronos".into(),
        seed: 6,
        camera: CameraSpec {
            fx: 1818.0,
            fy: 1816.0,
            cx: 324.0,
            cy: 236.5,
            distortion: vec![-0.05, 0.04, -0.0003, 0.0005, 0.0],
            channels: "bayer-gbrg".into(),
            bits: 12,
            black_level: 128.0,
            full_well_electrons: 15_000.0,
            gain: 4.0,
            read_noise_electrons: 25.0,
            psf_sigma_px: 0.45,
            electrons_per_sec: 6_500_000.0.into(),
            exposure_secs: 0.0004,
            dark_electrons_per_sec: 300.0,
            color_mixing: [[0.80, 0.16, 0.04], [0.14, 0.72, 0.14], [0.05, 0.20, 0.75]],
            ..triton.camera
        },
        // 1,000 images a second, pattern and flash one after the other, then a rest.
        sequences: vec![flying_ball(200.0, 0.001)],
        ..triton
    }
}

/// A strip of film 40 mm before an LED, another LED beside it for the flash.
fn film() -> FilmSpec {
    FilmSpec {
        position_mm: [180.0, -15.0, 40.0],
        target_mm: [0.0, 0.0, MIDDLE_MM],
        flash_offset_mm: [5.0, 0.0, 0.0],
        film_led: [1.0; 3],
        flash_led: [1.0, 0.95, 0.9],
        reference_mm: MIDDLE_MM,
        film_mm: 40.0,
        lamp_sigma_mm: 0.05,
        film_half_size_mm: [12.0, 12.0],
        vignetting: 3.0,
        image: None,
        waves: 4,
        min_period_mm: 0.8,
        max_period_mm: 5.0,
        spread: 0.5,
        seed: 21,
    }
}

fn colors() -> AlbedoSpec {
    AlbedoSpec::Waves { from: [0.85, 0.65, 0.45], to: [0.5, 0.7, 0.8], period_mm: 50.0 }
}

fn ball(at: [f64; 3]) -> ObjectSpec {
    let ball = ObjectSpec::new(ShapeSpec::Sphere { radius_mm: 45.0 }, at);
    ObjectSpec { rotation: [0.3, 0.2, 0.1], albedo: colors(), ..ball }
}

/// A thrown ball, 0.6 m/s sideways and 0.5 m/s nearer, that turns and falls; four frames.
fn flying_ball(fps: f64, flash_delay_secs: f64) -> SequenceSpec {
    let motion = MotionSpec {
        velocity_mm_per_sec: [600.0, -200.0, -500.0],
        acceleration_mm_per_sec2: [0.0, 9810.0, 0.0],
        angular_velocity: [0.0, 4.0, 2.0],
        ..MotionSpec::default()
    };
    SequenceSpec {
        name: "ball".into(),
        fps,
        frames: 4,
        flash_delay_secs,
        pattern_interval_secs: 0.0,
        pattern_set: None,
        black: false,
        objects: vec![MovingObjectSpec { object: ball([-8.0, 0.0, MIDDLE_MM + 10.0]), motion }],
    }
}
