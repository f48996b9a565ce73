//! The specs that come with the program.

mod films;
mod projectors;

use nelu3d_scan::board::Marker;
use nelu3d_scan::pattern::{Axis, Pattern, Random, Sinusoid, Triangle};

use super::{
    AlbedoSpec, BlackImage, BoardSpec, CameraSpec, FilmSpec, InterreflectionSpec, LightSpec, MaterialSpec, ObjectSpec,
    PatternSetSpec, ProjectorSpec, SceneSpec, ShapeSpec, Spec, SweepSpec,
};

/// Names of the presets, and what each is.
pub const PRESETS: [(&str, &str); 7] = [
    ("demo", "a mono camera and a projector, three patterns, a board with markers, a vase"),
    ("shapes", "the scanner of `demo` with a plane, a ball, a step and a ball before a plane"),
    ("color", "a color camera and film: one color pattern and a flash, a charuco board, no black images of scenes"),
    (
        "dlp",
        "a machine-vision camera of 640 × 480 and a good DLP projector, three patterns, a sphere, a vase, two objects",
    ),
    ("lcd", "the same before a 50-dollar LCD projector: gaps, gamma, distortion, vignetting, no one plane of focus"),
    ("film-triton", "a LUCID Triton color camera and an RGB film projector, with a sequence of a flying ball"),
    (
        "film-chronos",
        "a Kron Chronos high-speed color camera, short of light, and the same film, with the same sequence",
    ),
];

pub(super) fn preset(name: &str) -> Option<Spec> {
    match name {
        "demo" => Some(demo()),
        "shapes" => Some(Spec { name: "shapes".into(), scenes: shapes(), ..demo() }),
        "color" => Some(color()),
        "dlp" => Some(projectors::dlp()),
        "lcd" => Some(projectors::lcd()),
        "film-triton" => Some(films::triton()),
        "film-chronos" => Some(films::chronos()),
        _ => None,
    }
}

/// Depth of the middle of every preset's volume, mm.
const MIDDLE_MM: f64 = 700.0;

const IDENTITY: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

fn demo() -> Spec {
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
        pattern_sets: vec![PatternSetSpec {
            name: "mixed3".into(),
            patterns: vec![
                Pattern::Sinusoid(Sinusoid { axis: Axis::X, period_px: 20.0, steps: 1 }),
                Pattern::Triangle(Triangle { axis: Axis::X, period_px: 640.0 / 3.0 }),
                Pattern::Random(Random { axis: Axis::X, min_period_px: 40.0, max_period_px: 320.0, seed: 7 }),
            ],
        }],
        board: marker_board(),
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
        scenes: vec![SceneSpec { name: "vase".into(), black: true, objects: vec![vase(AlbedoSpec::default())] }],
        print_dpi: None,
        sequences: Vec::new(),
    }
}

/// A white board with a column of markers at its left and right edge.
fn marker_board() -> BoardSpec {
    let (side, pitch) = (22.0, 31.0);
    let mut markers = Vec::new();
    for x in [-95.0, 95.0 - side] {
        for row in 0..5 {
            let y = (f64::from(row) - 2.0) * pitch - side / 2.0;
            let corners_mm = [[x, y], [x + side, y], [x + side, y + side], [x, y + side]];
            markers.push(Marker { id: markers.len() as u32, corners_mm });
        }
    }
    BoardSpec::Markers { dictionary: "DICT_4X4_50".into(), markers, extent_mm: [-100.0, -80.0, 100.0, 80.0] }
}

/// A vase with a foot, a belly, a neck and a lip, 128 mm high, its top leaning a little toward the camera.
fn vase(albedo: AlbedoSpec) -> ObjectSpec {
    ObjectSpec {
        position_mm: [0.0, 64.0, MIDDLE_MM + 5.0],
        rotation: [0.12, 0.0, 0.0],
        shape: ShapeSpec::Vase {
            profile_mm: vec![
                [0.0, 25.0],
                [5.0, 24.0],
                [14.0, 20.5],
                [32.0, 33.0],
                [54.0, 41.0],
                [76.0, 32.0],
                [94.0, 18.5],
                [106.0, 16.0],
                [118.0, 20.0],
                [126.0, 26.0],
                [128.0, 27.0],
            ],
        },
        deformation: None,
        albedo,
        material: MaterialSpec::Lambert,
    }
}

fn object(position_mm: [f64; 3], rotation: [f64; 3], shape: ShapeSpec) -> ObjectSpec {
    let (albedo, material) = (AlbedoSpec::default(), MaterialSpec::Lambert);
    ObjectSpec { position_mm, rotation, shape, deformation: None, albedo, material }
}

fn shapes() -> Vec<SceneSpec> {
    let scene = |name: &str, objects| SceneSpec { name: name.into(), black: true, objects };
    let plane = |z, rotation| object([0.0, 0.0, z], rotation, ShapeSpec::Plane { width_mm: 150.0, height_mm: 130.0 });
    let ball = |z, radius_mm| object([0.0, 0.0, z], [0.0; 3], ShapeSpec::Sphere { radius_mm });
    let jump = ShapeSpec::Step { width_mm: 150.0, height_mm: 130.0, jump_mm: 40.0 };
    vec![
        scene("plane", vec![plane(MIDDLE_MM, [0.2, -0.35, 0.0])]),
        scene("sphere", vec![ball(MIDDLE_MM, 50.0)]),
        scene("step", vec![object([5.0, 0.0, MIDDLE_MM - 20.0], [0.05, 0.1, 0.0], jump)]),
        scene("occlusion", vec![ball(MIDDLE_MM - 20.0, 30.0), plane(MIDDLE_MM + 40.0, [0.0, 0.1, 0.0])]),
    ]
}

fn color() -> Spec {
    let waves = AlbedoSpec::Waves { from: [0.85, 0.62, 0.40], to: [0.45, 0.70, 0.80], period_mm: 45.0 };
    let ball = ObjectSpec {
        albedo: waves.clone(),
        ..object([0.0, 0.0, MIDDLE_MM], [0.3, 0.2, 0.1], ShapeSpec::Sphere { radius_mm: 48.0 })
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
        board: BoardSpec::Charuco {
            columns: 9,
            rows: 7,
            square_mm: 24.0,
            marker_mm: 18.0,
            dictionary: "DICT_4X4_50".into(),
            legacy: false,
            extent_mm: [0.0, 0.0, 216.0, 168.0],
        },
        board_albedo: [0.3, 0.85],
        scenes: vec![
            SceneSpec { name: "vase".into(), black: false, objects: vec![vase(waves)] },
            SceneSpec { name: "ball".into(), black: false, objects: vec![ball] },
        ],
        ..demo()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_are_sound_and_survive_a_file() {
        for (name, _) in PRESETS {
            let spec = Spec::preset(name).unwrap();
            spec.check().unwrap();
            assert_eq!(toml::from_str::<Spec>(&spec.to_toml()).unwrap(), spec);
        }
        assert!(Spec::preset("none").is_none());
    }
}
