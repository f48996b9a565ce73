//! Simulated rigs, read back the way any rig is, against what is known in closed form.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Point3, Vector3};
use nelu3d_scan::board::Detector;
use nelu3d_scan::pattern::{Axis, Gray, Pattern, Ramp, Rgb, Sinusoid, decode_gray};
use nelu3d_scan::rig::{Need, Rig};
use nelu3d_scan::{Image, Mesh, Projector, npy};
use nelu3d_sim::spec::{AxisSpec, BlackImage, BoardBendSpec, LightSpec, PatternSetSpec, ShapeSpec, SweepSpec};
use nelu3d_sim::sweep::sweep_poses;
use nelu3d_sim::{GroundTruth, SimulationError, Spec, simulate, simulate_until};

/// The `shapes` preset at half the resolution and quick to render.
fn small() -> Spec {
    let mut spec = Spec::preset("shapes").unwrap();
    let c = &mut spec.camera;
    (c.width, c.height) = (160, 120);
    (c.fx, c.fy, c.cx, c.cy) = (450.0, 449.0, 80.3, 59.2);
    spec.supersampling = 2;
    positions(&mut spec, 3);
    spec
}

fn positions(spec: &mut Spec, n: usize) {
    let SweepSpec::Stage { positions, .. } = &mut spec.sweep else { panic!("a stage") };
    *positions = n;
}

/// As good as a camera without noise.
fn quiet(mut spec: Spec) -> Spec {
    spec.camera.bits = 16;
    spec.camera.full_well_electrons = 1e9;
    spec.camera.electrons_per_sec = (0.8 * 1e9 / spec.camera.exposure_secs).into();
    spec.camera.read_noise_electrons = 0.0;
    spec
}

fn projector_of(spec: &mut Spec) -> &mut nelu3d_sim::spec::ProjectorSpec {
    let LightSpec::Projector(p) = &mut spec.light else { panic!("a projector") };
    p
}

/// Simulates into a temporary folder, which lives as long as the first of the pair.
fn rig(spec: &Spec) -> (tempfile::TempDir, Rig) {
    let dir = tempfile::tempdir().unwrap();
    simulate(spec, &dir.path().join("rig"), &|_, _, _| ()).unwrap();
    let rig = Rig::open(&dir.path().join("rig")).unwrap();
    (dir, rig)
}

/// Every file of a folder with its content.
fn files(root: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = BTreeMap::new();
    let mut open = vec![root.to_path_buf()];
    while let Some(dir) = open.pop() {
        for entry in std::fs::read_dir(dir).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else {
                all.insert(path.strip_prefix(root).unwrap().to_path_buf(), std::fs::read(&path).unwrap());
            }
        }
    }
    all
}

/// (pattern − black) / (white − black).
fn normalized(pattern: &Image, white: &Image, black: &Image) -> Image {
    let value = |i: usize| (pattern.data[i] - black.data[i]) / (white.data[i] - black.data[i]);
    Image { data: (0..white.data.len()).map(value).collect(), ..white.clone() }
}

/// Pixels whose 7 × 7 neighbors are all in the mask.
fn interior(mask: &[bool], width: usize) -> Vec<usize> {
    let height = mask.len() / width;
    (0..mask.len())
        .filter(|i| {
            let (x, y) = (i % width, i / width);
            (3..width - 3).contains(&x)
                && (3..height - 3).contains(&y)
                && (y - 3..=y + 3).all(|y| (x - 3..=x + 3).all(|x| mask[y * width + x]))
        })
        .collect()
}

#[test]
fn a_simulation_is_an_ordinary_rig() {
    let spec = small();
    let (_dir, rig) = rig(&spec);
    assert_eq!(rig.name, "shapes");
    assert_eq!(rig.board.as_ref(), Some(&spec.board.board()));
    let names: Vec<_> = rig.scenes().unwrap().into_iter().map(|s| s.name).collect();
    assert_eq!(names, ["occlusion", "plane", "sphere", "step"]);
    let set = &rig.pattern_sets[0];
    assert_eq!(set.images, ["sine_00.png", "triangle_00.png", "random_00.png"]);
    let shots = rig.positions().unwrap();
    assert_eq!(shots.len(), 3);
    for shot in &shots {
        rig.read_shot(shot, set, Need::Calibration).unwrap();
    }
    let (w, h) = (rig.camera.width, rig.camera.height);
    for (i, scene) in spec.scenes.iter().enumerate() {
        let shot = rig.scene(&scene.name).unwrap();
        assert!(rig.read_shot(&shot, set, Need::Scene).unwrap().black.is_some());
        let truth = GroundTruth::of_scene(&spec, i);
        let depth = npy::read(&shot.dir.join("truth/depth.npy")).unwrap();
        assert_eq!(depth.shape, [h, w]);
        assert!(depth.data.iter().zip(&truth.depth).all(|(a, b)| a.to_bits() == b.to_bits()));
        let mask = nelu3d_scan::image::decode(&shot.dir.join("truth/mask.png"), Some((w, h))).unwrap();
        let nelu3d_scan::image::RawData::U8(mask) = mask.data else { panic!("8 bits") };
        assert!(mask.iter().zip(&truth.mask).all(|(a, b)| (*a == 255) == *b && (*a == 0) != *b));
        assert_eq!(Mesh::read(&shot.dir.join("truth/mesh.ply")).unwrap().faces, truth.mesh.faces);
    }
    // The spec goes with it, and makes it again.
    assert_eq!(Spec::read(&rig.root.join("simulation.toml")).unwrap(), spec);
}

#[test]
fn the_same_seed_gives_the_same_bytes_with_any_number_of_threads() {
    let mut spec = small();
    spec.scenes.truncate(1);
    let bytes = |spec: &Spec, threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let (_dir, rig) = pool.install(|| rig(spec));
        files(&rig.root)
    };
    let one = bytes(&spec, 1);
    assert!(one == bytes(&spec, 3), "one thread and three differ");
    let other = bytes(&Spec { seed: 77, ..spec }, 2);
    let name = Path::new("scenes/plane/white.png");
    assert!(one[name] != other[name]);
    let truth = Path::new("scenes/plane/truth/depth.npy");
    assert!(one[truth] == other[truth]);
}

#[test]
fn truth_is_the_closed_form() {
    let spec = small();
    let camera = rig(&spec).1.camera;
    let light = Point3::from(projector_of(&mut spec.clone()).position_mm);
    for (i, scene) in spec.scenes.iter().enumerate() {
        let truth = GroundTruth::of_scene(&spec, i);
        let mut compared = 0;
        for (p, depth) in truth.depth.iter().enumerate() {
            let ray = camera.ray([(p % camera.width) as f64, (p / camera.width) as f64]);
            // Depth of the nearest object along the ray, from textbook formulas.
            let nearest = scene.objects.iter().filter_map(|o| {
                let pose = Isometry3::new(Vector3::from(o.position_mm), Vector3::from(o.rotation));
                let center = Point3::from(o.position_mm);
                match o.shape {
                    ShapeSpec::Plane { width_mm, height_mm } => {
                        let n = pose * Vector3::z();
                        let x = ray.at(n.dot(&center.coords) / n.dot(&ray.dir));
                        let local = pose.inverse() * x;
                        (local.x.abs() <= width_mm / 2.0 && local.y.abs() <= height_mm / 2.0).then_some(x.z)
                    }
                    ShapeSpec::Sphere { radius_mm } => {
                        let b = center.coords.dot(&ray.dir);
                        let d = b * b - center.coords.norm_squared() + radius_mm * radius_mm;
                        (d >= 0.0).then(|| ray.at(b - d.sqrt()).z)
                    }
                    ShapeSpec::Step { width_mm, height_mm, jump_mm } => {
                        let half = |near: bool, z: f64| {
                            let n = pose * Vector3::z();
                            let on = pose * Point3::new(0.0, 0.0, z);
                            let x = ray.at(n.dot(&on.coords) / n.dot(&ray.dir));
                            let local = pose.inverse() * x;
                            let side = if near { local.x <= 0.0 } else { local.x >= 0.0 };
                            (side && local.x.abs() <= width_mm / 2.0 && local.y.abs() <= height_mm / 2.0).then_some(x.z)
                        };
                        half(true, 0.0).or(half(false, jump_mm))
                    }
                    _ => panic!("checked where it is defined"),
                }
            });
            let expected = nearest.fold(f64::INFINITY, f64::min);
            if expected.is_finite() {
                assert!((f64::from(*depth) - expected).abs() < 1e-4, "{}: {depth}, not {expected}", scene.name);
                compared += 1;
            } else if scene.name != "step" {
                assert!(depth.is_nan(), "{}: {depth} from nothing", scene.name);
            }
        }
        assert!(compared > 1000, "{}: {compared}", scene.name);
        if scene.name == "occlusion" {
            // A point of the plane is in shadow where its way to the light meets the ball.
            let ball = Point3::from(scene.objects[0].position_mm);
            let mut shadowed = 0;
            for (p, depth) in truth.depth.iter().enumerate() {
                let ray = camera.ray([(p % camera.width) as f64, (p / camera.width) as f64]);
                let x = ray.at(f64::from(*depth) / ray.dir.z);
                if depth.is_nan() || (x - ball).norm() < 30.5 {
                    continue;
                }
                let way = (light - x).normalize();
                let miss = (ball - x).cross(&way).norm();
                if (miss - 30.0).abs() > 0.01 {
                    assert_eq!(truth.mask[p], miss > 30.0, "{x}");
                    shadowed += usize::from(miss < 30.0);
                }
            }
            assert!(shadowed > 100, "{shadowed}");
        }
    }
}

#[test]
fn normalized_intensity_is_the_pattern_at_the_projector_pixel() {
    let mut spec = quiet(small());
    spec.scenes.truncate(2);
    // Ambient light, leak and fall-off all cancel; blur does not, but the ramp does not mind it.
    projector_of(&mut spec).black = BlackImage::Darkest;
    projector_of(&mut spec).black_leak = 0.02;
    spec.ambient = 0.05;
    let wave = Sinusoid { axis: Axis::Y, period_px: 160.0, steps: 1 };
    let patterns = vec![Pattern::Ramp(Ramp { axis: Axis::X }), Pattern::Sinusoid(wave)];
    spec.pattern_sets = vec![PatternSetSpec { name: "two".into(), patterns }];
    let (_dir, rig) = rig(&spec);
    let projector: &Projector = rig.projector.as_ref().unwrap();
    for (i, scene) in spec.scenes.iter().enumerate() {
        let shot = rig.read_shot(&rig.scene(&scene.name).unwrap(), &rig.pattern_sets[0], Need::Scene).unwrap();
        let truth = GroundTruth::of_scene(&spec, i);
        let black = shot.black.as_ref().unwrap();
        let inside = interior(&truth.mask, rig.camera.width);
        assert!(inside.len() > 800, "{}", inside.len());
        for p in inside {
            let ray = rig.camera.ray([(p % rig.camera.width) as f64, (p / rig.camera.width) as f64]);
            let [u, v] = projector.project(&ray.at(f64::from(truth.depth[p]) / ray.dir.z)).unwrap();
            let expected = [u / 639.0, 0.5 + 0.5 * (std::f64::consts::TAU * v / 160.0).cos()];
            for (pattern, expected) in shot.patterns.iter().zip(expected) {
                let got = f64::from(normalized(pattern, &shot.white, black).data[p]);
                // A code of the 8-bit projector, and the curvature of ball and wave over a pixel.
                assert!((got - expected).abs() < 0.006, "{}: {got}, not {expected}", scene.name);
            }
        }
    }
}

#[test]
fn gray_code_decodes_to_the_projector_column() {
    let mut spec = small();
    spec.scenes.truncate(2);
    let patterns = vec![Pattern::Gray(Gray { axis: Axis::X, inverse: true })];
    spec.pattern_sets = vec![PatternSetSpec { name: "gray".into(), patterns }];
    let (_dir, rig) = rig(&spec);
    let set = &rig.pattern_sets[0];
    assert_eq!((set.images.len(), set.inverse.len()), (10, 10));
    for (i, scene) in spec.scenes.iter().enumerate() {
        let shot = rig.scene(&scene.name).unwrap();
        let capture = rig.read_shot(&shot, set, Need::Scene).unwrap();
        let black = capture.black.as_ref().unwrap();
        let normal =
            |images: &[Image]| -> Vec<Image> { images.iter().map(|p| normalized(p, &capture.white, black)).collect() };
        let inverse = rig.read_inverse(&shot, set).unwrap();
        // The finest stripes are narrower than a camera pixel: decode what the camera resolves.
        let bits = 7;
        let codes = decode_gray(&normal(&capture.patterns)[..bits], &normal(&inverse)[..bits], 0.3);
        let truth = GroundTruth::of_scene(&spec, i);
        let inside = interior(&truth.mask, rig.camera.width);
        let mut right = 0;
        for p in &inside {
            let ray = rig.camera.ray([(p % rig.camera.width) as f64, (p / rig.camera.width) as f64]);
            let x = ray.at(f64::from(truth.depth[*p]) / ray.dir.z);
            let [u, _] = rig.projector.as_ref().unwrap().project(&x).unwrap();
            let stripe = f64::from(1u32 << (10 - bits));
            if let Some(code) = codes[*p] {
                let error = u + 0.5 - (f64::from(code) + 0.5) * stripe;
                assert!(error.abs() < 0.5 * stripe + 1.5, "{}: code {code} at column {u}", scene.name);
                right += 1;
            }
        }
        assert!(right * 10 > inside.len() * 8, "{}: {right} of {}", scene.name, inside.len());
    }
}

#[test]
fn noise_in_the_images_follows_the_declared_sensor() {
    let mut spec = small();
    spec.scenes.truncate(1);
    let capture = |seed: u64| {
        let (_dir, rig) = rig(&Spec { seed, ..spec.clone() });
        rig.read_shot(&rig.scene("plane").unwrap(), &rig.pattern_sets[0], Need::Scene).unwrap()
    };
    let (a, b) = (capture(1), capture(2));
    let inside = interior(&GroundTruth::of_scene(&spec, 0).mask, 160);
    let camera = &spec.camera;
    let range = camera.saturation() - camera.black_level;
    let images = [(&a.white, &b.white), (a.black.as_ref().unwrap(), b.black.as_ref().unwrap())];
    for (a, b) in images {
        let n = inside.len() as f64;
        let (mut mean, mut variance) = (0.0, 0.0);
        for &p in &inside {
            let [a, b] = [a.data[p], b.data[p]].map(f64::from);
            mean += 0.5 * (a + b) / n;
            variance += 0.5 * (a - b) * (a - b) / n;
        }
        // In electrons: shot noise, read noise, quantization.
        let electrons = mean * camera.full_well_electrons;
        let got = variance * camera.full_well_electrons.powi(2);
        let step = camera.full_well_electrons / range;
        let expected = electrons + camera.read_noise_electrons.powi(2) + step * step / 12.0;
        // Five standard errors of a variance from n differences.
        assert!((got / expected - 1.0).abs() < 5.0 * (2.0 / n).sqrt(), "{got} electrons², not {expected}");
    }
}

/// Where the detector finds the corners of boards, against where projection puts them.
#[test]
fn boards_are_where_their_poses_say() {
    for (preset, corners, limit_px) in [("demo", 40, 0.05), ("color", 48, 0.03)] {
        let mut spec = Spec::preset(preset).unwrap();
        positions(&mut spec, 3);
        spec.scenes.clear();
        let (_dir, rig) = rig(&spec);
        let detector = Detector::new(rig.board.as_ref().unwrap()).unwrap().with_camera(&rig.camera);
        for (shot, pose) in rig.positions().unwrap().iter().zip(sweep_poses(&spec)) {
            assert_eq!(shot.name, pose.position);
            let white = rig.read_image(&shot.dir.join(&rig.white)).unwrap();
            let found = detector.detect(&white.to_gray(), white.width, white.height).unwrap();
            let (mut bias, mut square) = ([0.0; 2], 0.0);
            for c in &found {
                let x = pose.cam_from_board * Point3::new(c.board_mm[0], c.board_mm[1], 0.0);
                let expected = rig.camera.project(&x).unwrap();
                for k in 0..2 {
                    bias[k] += (c.px[k] - expected[k]) / found.len() as f64;
                    square += (c.px[k] - expected[k]).powi(2) / found.len() as f64;
                }
            }
            eprintln!("{preset} {}: {} corners, RMS {:.3} px, bias {bias:.3?}", shot.name, found.len(), square.sqrt());
            assert!(found.len() * 10 >= corners * 9, "{preset}: {} corners", found.len());
            assert!(square.sqrt() < limit_px, "{preset}: RMS {} px", square.sqrt());
            assert!(bias[0].hypot(bias[1]) < 0.01, "{preset}: bias {bias:?} px");
        }
    }
}

#[test]
fn color_cameras_see_each_band_in_its_channel() {
    let mut spec = quiet(small());
    spec.scenes.truncate(1);
    let ramp = |axis| Box::new(Pattern::Ramp(Ramp { axis }));
    let wave = Box::new(Pattern::Sinusoid(Sinusoid { axis: Axis::X, period_px: 200.0, steps: 1 }));
    let rgb = Pattern::Rgb(Rgb { parts: [ramp(Axis::X), ramp(Axis::Y), wave] });
    spec.pattern_sets = vec![PatternSetSpec { name: "rgb".into(), patterns: vec![rgb] }];
    let inside = interior(&GroundTruth::of_scene(&spec, 0).mask, 160);
    for channels in ["rgb", "bayer-rggb", "bayer-gbrg"] {
        spec.camera.channels = channels.into();
        let (_dir, rig) = rig(&spec);
        let shot = rig.read_shot(&rig.scene("plane").unwrap(), &rig.pattern_sets[0], Need::Scene).unwrap();
        assert_eq!(shot.white.channels, 3);
        let got = normalized(&shot.patterns[0], &shot.white, shot.black.as_ref().unwrap());
        let truth = GroundTruth::of_scene(&spec, 0);
        for &p in &inside {
            let (x, y) = (p % 160, p / 160);
            let ray = rig.camera.ray([x as f64, y as f64]);
            let point = ray.at(f64::from(truth.depth[p]) / ray.dir.z);
            let [u, v] = rig.projector.as_ref().unwrap().project(&point).unwrap();
            let expected = [u / 639.0, v / 399.0, 0.5 + 0.5 * (std::f64::consts::TAU * u / 200.0).cos()];
            for (got, expected) in got.pixel(x, y).iter().zip(expected) {
                // A mosaic is interpolated between pixels.
                assert!((f64::from(*got) - expected).abs() < 0.012, "{channels} ({x}, {y}): {got}, not {expected}");
            }
        }
    }
}

#[test]
fn film_throws_a_color_pattern_that_white_normalizes() {
    let mut spec = quiet(Spec::preset("color").unwrap());
    positions(&mut spec, 3);
    spec.supersampling = 2;
    // One lamp for both: then the ratio is the film's transmission, whatever the surface's color.
    let LightSpec::Film(film) = &mut spec.light else { panic!("film") };
    film.flash_offset_mm = [0.0; 3];
    spec.camera.color_mixing = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let (_dir, rig) = rig(&spec);
    assert!(rig.projector.is_none() && !rig.root.join("patterns").exists());
    assert_eq!(rig.pattern_sets[0].images, ["pattern.png"]);
    for (i, scene) in spec.scenes.iter().enumerate() {
        let shot = rig.read_shot(&rig.scene(&scene.name).unwrap(), &rig.pattern_sets[0], Need::Scene).unwrap();
        assert!(shot.black.is_none(), "the preset's scenes have no black image");
        let mask = GroundTruth::of_scene(&spec, i).mask;
        let none = Image::new(shot.white.width, shot.white.height, 3);
        let ratio = normalized(&shot.patterns[0], &shot.white, &none);
        let mut sums = [[0.0; 2]; 3];
        let inside = interior(&mask, ratio.width);
        for &p in &inside {
            for (c, sum) in sums.iter_mut().enumerate() {
                let v = f64::from(ratio.data[3 * p + c]);
                assert!((-1e-3..=1.001).contains(&v), "{v}");
                sum[0] += v / inside.len() as f64;
                sum[1] += v * v / inside.len() as f64;
            }
        }
        for [mean, square] in sums {
            let contrast = (square - mean * mean).sqrt();
            assert!((mean - 0.5).abs() < 0.1 && contrast > 0.1, "mean {mean}, contrast {contrast}");
        }
    }
}

#[test]
fn sets_share_equal_images_and_no_others() {
    let mut spec = small();
    spec.scenes.clear();
    let sine = |period_px| Pattern::Sinusoid(Sinusoid { axis: Axis::X, period_px, steps: 1 });
    let set = |name: &str, patterns| PatternSetSpec { name: name.into(), patterns };
    spec.pattern_sets = vec![set("a", vec![sine(16.0), sine(32.0)]), set("b", vec![sine(24.0), sine(32.0)])];
    let (_dir, rig) = rig(&spec);
    assert_eq!(rig.pattern_sets[0].images, ["sine_00.png", "sine_01.png"]);
    assert_eq!(rig.pattern_sets[1].images, ["sine_02.png", "sine_01.png"]);
}

#[test]
fn nothing_is_left_of_a_simulation_that_fails() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("rig");
    let run = |spec: &Spec| simulate(spec, &out, &|_, _, _| ()).unwrap_err();
    let mut spec = small();
    spec.camera.full_well_electrons = f64::NAN;
    let message = run(&spec).to_string();
    assert!(message.contains("camera.full_well_electrons"), "{message}");

    let mut spec = small();
    let nelu3d_sim::spec::BoardSpec::Markers { dictionary, .. } = &mut spec.board else { panic!("markers") };
    *dictionary = "DICT_NONE".into();
    assert!(matches!(run(&spec), SimulationError::Board(_)));
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);

    // Somebody's own folder is not replaced; an earlier simulation is.
    std::fs::create_dir(&out).unwrap();
    std::fs::write(out.join("thesis.tex"), "").unwrap();
    assert!(matches!(run(&small()), SimulationError::Io(_)));
    assert!(out.join("thesis.tex").exists());
}

/// A sweep by hand with everything that makes it hard.
fn by_hand(seed: u64) -> Spec {
    let text = r#"
        kind = "handheld"
        positions = 4
        first_mm = 600.0
        last_mm = 800.0
        position_sigma_mm = 12.0
        tilt_sigma = 0.3
        depths = "scattered"
        max_tilt = 0.7
        min_in_view = 0.7
        hands = { number = 2 }
    "#;
    Spec { seed, sweep: toml::from_str(text).unwrap(), scenes: Vec::new(), ..Spec::preset("color").unwrap() }
}

/// Returns the corners that are found at every position, with where the flat board's would be, px, and their places on
/// the board, mm.
fn found_corners(spec: &Spec) -> Vec<Vec<([f64; 2], [f64; 2])>> {
    let (_dir, rig) = rig(spec);
    let detector = Detector::new(rig.board.as_ref().unwrap()).unwrap().with_camera(&rig.camera);
    let found = rig.positions().unwrap().into_iter().map(|shot| {
        let white = rig.read_image(&shot.dir.join(&rig.white)).unwrap();
        let corners = detector.detect(&white.to_gray(), white.width, white.height).unwrap();
        corners.iter().map(|c| (c.px, [c.board_mm[0], c.board_mm[1]])).collect()
    });
    found.collect()
}

#[test]
fn hands_hide_corners_and_leave_the_others_where_they_are() {
    let held = by_hand(1);
    let mut free = held.clone();
    let SweepSpec::Handheld { hands, .. } = &mut free.sweep else { panic!("by hand") };
    *hands = None;
    let [a, b] = [&held, &free].map(found_corners);
    let count = |all: &[Vec<_>]| all.iter().map(Vec::len).sum::<usize>();
    eprintln!("{} corners behind hands, {} without", count(&a), count(&b));
    assert!(count(&a) < count(&b) && count(&a) * 2 > count(&b), "{} of {}", count(&a), count(&b));
    let mut compared = 0;
    for (a, b) in a.iter().zip(&b) {
        for (px, board) in a {
            let Some((other, _)) = b.iter().find(|c| c.1 == *board) else { continue };
            let off = (px[0] - other[0]).hypot(px[1] - other[1]);
            assert!(off < 0.5, "{board:?}: {off} px");
            compared += 1;
        }
    }
    assert!(compared * 10 > 9 * count(&a), "{compared}");
}

#[test]
fn corners_of_a_bent_board_lie_on_its_arc() {
    let mut spec = by_hand(2);
    let SweepSpec::Handheld { hands, .. } = &mut spec.sweep else { panic!("by hand") };
    *hands = None;
    let sagitta = 2.0;
    spec.board_bend = Some(BoardBendSpec { sagitta_mm: sagitta, axis: AxisSpec::Y });
    let [x0, _, x1, _] = spec.board.extent_mm();
    let (middle, length) = (0.5 * (x0 + x1), x1 - x0);
    // A shallow arc: sagitta = L² / 8R to a part in a million.
    let radius = length * length / (8.0 * sagitta);
    let camera = rig(&spec).1.camera;
    let [mut bent, mut flat, mut n] = [0.0; 3];
    for (found, pose) in found_corners(&spec).iter().zip(sweep_poses(&spec)) {
        for (px, [x, y]) in found {
            let angle = (x - middle) / radius;
            let on_arc = Point3::new(middle + radius * angle.sin(), *y, radius * (1.0 - angle.cos()));
            let off = |p: Point3<f64>| {
                let expected = camera.project(&(pose.cam_from_board * p)).unwrap();
                (px[0] - expected[0]).powi(2) + (px[1] - expected[1]).powi(2)
            };
            bent += off(on_arc);
            flat += off(Point3::new(*x, *y, 0.0));
            n += 1.0;
        }
    }
    let [bent, flat] = [bent, flat].map(|s: f64| (s / n).sqrt());
    eprintln!("{n} corners, RMS {bent:.3} px from the arc, {flat:.3} px from the plane");
    assert!(bent < 0.08 && flat > 4.0 * bent, "{bent} {flat}");
}

#[test]
fn a_sweep_by_hand_is_the_same_for_the_same_seed_only() {
    let bytes = |seed| {
        let mut spec = by_hand(seed);
        spec.supersampling = 1;
        files(&rig(&spec).1.root)
    };
    let (a, b) = (bytes(3), bytes(3));
    assert!(a == b, "the same seed differs");
    let name = Path::new("calibration/001/white.png");
    assert!(a[name] != bytes(4)[name]);
    // Keys that are not given are not written: rigs made before these keys existed keep their bytes.
    let text = Spec::preset("demo").unwrap().to_toml();
    assert!(!text.contains("bend") && !text.contains("hands"), "{text}");
}

/// What is stopped in the middle of the sweep leaves neither a rig nor a part of one.
#[test]
fn a_stopped_simulation_leaves_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let asked = std::sync::atomic::AtomicUsize::new(0);
    let stop = || asked.fetch_add(1, std::sync::atomic::Ordering::Relaxed) >= 2;
    let stopped = simulate_until(&small(), &dir.path().join("rig"), &|_, _, _| (), &stop);
    assert!(matches!(stopped, Err(SimulationError::Stopped)), "{stopped:?}");
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
}
