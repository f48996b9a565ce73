//! The light in simulated images against closed forms and quadrature that share no code with the renderer.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};
use std::path::Path;

use nalgebra::{Isometry3, Point3, Vector3};
use nelu3d_scan::pattern::{Axis, Gray, Pattern};
use nelu3d_scan::rig::{Need, Rig};
use nelu3d_scan::{Camera, Image, Mesh, Projector};
use nelu3d_sim::spec::{
    AlbedoSpec, AxisSpec, DeformationSpec, InterreflectionSpec, LightSpec, MaterialSpec, ObjectSpec, PatternSetSpec,
    ProjectorSpec, SceneSpec, ShapeSpec, SweepSpec,
};
use nelu3d_sim::{GroundTruth, Spec, simulate};

/// Depth of the scenes, mm.
const MIDDLE: f64 = 700.0;

/// A small mono camera without blur and (nearly) without noise, a projector without fall-off, one scene.
fn spec(objects: Vec<ObjectSpec>) -> Spec {
    let mut spec = Spec::preset("demo").unwrap();
    let c = &mut spec.camera;
    (c.width, c.height) = (64, 48);
    (c.fx, c.fy, c.cx, c.cy) = (400.0, 400.0, 31.3, 23.8);
    c.psf_sigma_px = 0.0;
    c.bits = 16;
    c.full_well_electrons = 1e9;
    c.electrons_per_sec = (0.8 * c.full_well_electrons / c.exposure_secs).into();
    c.read_noise_electrons = 0.0;
    spec.ambient = 0.0;
    spec.supersampling = 4;
    let p = projector(&mut spec);
    (p.width, p.height, p.cx, p.cy) = (512, 480, 255.8, 240.2);
    (p.vignetting, p.black_leak) = (0.0, 0.0);
    let SweepSpec::Stage { positions, .. } = &mut spec.sweep else { panic!("a stage") };
    *positions = 3;
    let gray = Pattern::Gray(Gray { axis: Axis::X, inverse: false });
    spec.pattern_sets = vec![PatternSetSpec { name: "gray".into(), patterns: vec![gray] }];
    spec.scenes = vec![SceneSpec::new("one", objects)];
    spec.check().unwrap();
    spec
}

fn projector(spec: &mut Spec) -> &mut ProjectorSpec {
    let LightSpec::Projector(p) = &mut spec.light else { panic!("a projector") };
    p
}

/// What a pixel of value 1 collects, in the unit of the simulator: albedo 1 under the flash at its reference distance.
fn unit(spec: &Spec) -> f64 {
    let c = &spec.camera;
    c.full_well_electrons / (c.electrons_per_sec.rgb()[0] * c.exposure_secs)
}

fn object(shape: ShapeSpec, position_mm: [f64; 3], rotation: [f64; 3], albedo: f64) -> ObjectSpec {
    let albedo = AlbedoSpec::Constant { rgb: [albedo; 3] };
    ObjectSpec { position_mm, rotation, shape, deformation: None, albedo, material: MaterialSpec::Lambert {} }
}

/// White, black and pattern images of the scene, as light.
struct Seen {
    camera: Camera,
    projector: Projector,
    white: Vec<f64>,
    black: Vec<f64>,
    patterns: Vec<Vec<f64>>,
}

impl Seen {
    fn new(spec: &Spec) -> Self {
        let dir = tempfile::tempdir().unwrap();
        simulate(spec, &dir.path().join("rig"), &|_, _, _| ()).unwrap();
        let rig = Rig::open(&dir.path().join("rig")).unwrap();
        let shot = rig.read_shot(&rig.scene("one").unwrap(), &rig.pattern_sets[0], Need::Scene).unwrap();
        let light = |image: &Image| image.data.iter().map(|v| f64::from(*v) * unit(spec)).collect();
        Self {
            white: light(&shot.white),
            black: light(shot.black.as_ref().unwrap()),
            patterns: shot.patterns.iter().map(light).collect(),
            projector: rig.projector.clone().unwrap(),
            camera: rig.camera,
        }
    }

    fn pixel(&self, i: usize) -> [usize; 2] {
        [i % self.camera.width, i / self.camera.width]
    }

    /// The points that pixels' centers see, where the scene is at least `margin` pixels on all sides.
    fn points(&self, truth: &GroundTruth, margin: usize) -> Vec<(usize, Point3<f64>)> {
        let (w, h) = (self.camera.width, self.camera.height);
        let inside = |i: &usize| {
            let [x, y] = self.pixel(*i);
            (margin..w - margin).contains(&x)
                && (margin..h - margin).contains(&y)
                && (y - margin..=y + margin).all(|y| (x - margin..=x + margin).all(|x| truth.mask[y * w + x]))
        };
        let point = |i: usize| {
            let [x, y] = self.pixel(i);
            let ray = self.camera.ray([x as f64, y as f64]);
            (i, ray.at(f64::from(truth.depth[i]) / ray.dir.z))
        };
        (0..w * h).filter(inside).map(point).collect()
    }
}

/// Inverse square and cosine.
fn irradiance(light: &ProjectorSpec, p: &Point3<f64>, normal: &Vector3<f64>) -> f64 {
    let way = Point3::from(light.position_mm) - p;
    (light.reference_mm / way.norm()).powi(2) * normal.dot(&way.normalize()).max(0.0)
}

#[test]
fn a_plane_and_a_ball_obey_lamberts_law_and_the_inverse_square() {
    let ball = ([-20.0, 5.0, MIDDLE], 60.0);
    let rotation = [0.3, 0.5, 0.0];
    let plane = ShapeSpec::Plane { width_mm: 300.0, height_mm: 300.0 };
    let scenes = [
        object(plane, [0.0, 0.0, MIDDLE], rotation, 0.6),
        object(ShapeSpec::Sphere { radius_mm: ball.1 }, ball.0, [0.0; 3], 0.6),
    ];
    for (k, scene) in scenes.into_iter().enumerate() {
        let mut spec = Spec { ambient: 0.05, ..spec(vec![scene]) };
        let (seen, truth) = (Seen::new(&spec), GroundTruth::of_scene(&spec, 0));
        let points = seen.points(&truth, 2);
        assert!(points.len() > 500, "{}", points.len());
        for (i, p) in points {
            let normal = if k == 0 {
                Isometry3::new(Vector3::zeros(), Vector3::from(rotation)) * -Vector3::z()
            } else {
                (p - Point3::from(ball.0)) / ball.1
            };
            let expected = 0.6 * (irradiance(projector(&mut spec), &p, &normal) + 0.05);
            // Over a pixel of the ball the cosine is no straight line.
            let tolerance = if k == 0 { 5e-4 } else { 4e-3 };
            assert!((seen.white[i] - expected).abs() < tolerance, "{i}: {}, not {expected}", seen.white[i]);
            assert!((seen.black[i] - 0.6 * 0.05).abs() < 1e-4);
        }
    }
}

#[test]
fn a_mesh_of_a_ball_is_seen_as_the_ball() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("ball.glb");
    let (radius, n) = (60.0, 192u32);
    let mut mesh = Mesh::default();
    for i in 0..=n {
        for j in 0..2 * n {
            let (s, c) = (PI * f64::from(i) / f64::from(n)).sin_cos();
            let (sp, cp) = (PI * f64::from(j) / f64::from(n)).sin_cos();
            let normal = [s * cp, c, s * sp].map(|v| v as f32);
            mesh.vertices.push(normal.map(|v| v * radius as f32 / 2.0));
            mesh.normals.push(normal);
            let at = |i: u32, j: u32| i * 2 * n + j % (2 * n);
            if i < n {
                mesh.faces.push([at(i, j), at(i, j + 1), at(i + 1, j)]);
                mesh.faces.push([at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)]);
            }
        }
    }
    mesh.write(&path).unwrap();
    let position = [-20.0, 5.0, MIDDLE];
    // Half as large in its file.
    let of_mesh = spec(vec![object(ShapeSpec::Mesh { file: path, scale: 2.0 }, position, [0.1, 0.2, 0.3], 0.7)]);
    let of_ball = spec(vec![object(ShapeSpec::Sphere { radius_mm: radius }, position, [0.0; 3], 0.7)]);
    let truths = [&of_mesh, &of_ball].map(|s| GroundTruth::of_scene(s, 0));
    let seen = [&of_mesh, &of_ball].map(Seen::new);
    // A chord's height over an arc of a 192th of a half turn.
    let sag = radius * (1.0 - (0.5 * PI / f64::from(n)).cos());
    let points = seen[1].points(&truths[1], 2);
    assert!(points.len() > 500, "{}", points.len());
    for (i, p) in points {
        let normal = (p - Point3::from(position)) / radius;
        let slant = normal.dot(&-p.coords.normalize());
        let off = f64::from(truths[0].depth[i] - truths[1].depth[i]);
        assert!(off > -1e-3 && off < 3.0 * sag / slant + 1e-3, "{i}: {off}");
        assert!((seen[0].white[i] - seen[1].white[i]).abs() < 3e-3, "{i}: {} {}", seen[0].white[i], seen[1].white[i]);
    }
}

/// Even light in a closed box: every bounce adds its power of the albedo, exactly.
#[test]
fn a_furnace_is_as_bright_as_its_series() {
    let size_mm = [2000.0, 2000.0, 3000.0];
    let furnace = |bounces: usize, albedo: f64, material: MaterialSpec| {
        let walls = ObjectSpec { material, ..object(ShapeSpec::Box { size_mm }, [0.0; 3], [0.0; 3], albedo) };
        let interreflection = InterreflectionSpec { bounces, paths_per_pixel: 16 };
        Seen::new(&Spec { ambient: 0.2, interreflection, ..spec(vec![walls]) }).black
    };
    for bounces in [0, 1, 3] {
        let a: f64 = 0.5;
        let expected = 0.2 * (1..=bounces as i32 + 1).map(|k| a.powi(k)).sum::<f64>();
        let translucent = MaterialSpec::Translucent { mean_free_path_mm: 5.0, share: 0.6 };
        for material in [MaterialSpec::Lambert {}, translucent] {
            let seen = furnace(bounces, a, material);
            assert!(seen.iter().all(|v| (v - expected).abs() < 2e-4), "{bounces} {material:?}: not {expected}");
        }
    }
    // Whatever lacquer over white reflects, it is all of the light: four times as much after three bounces.
    let glossy = MaterialSpec::Glossy { roughness: 0.4, reflectance: 0.3 };
    let seen = furnace(3, 1.0, glossy);
    let mean = seen.iter().sum::<f64>() / seen.len() as f64;
    assert!((mean / 0.8 - 1.0).abs() < 0.01, "{mean}");
}

/// Two squares at a right angle, open to the camera, against the rendering equation integrated on a grid.
#[test]
fn a_corner_is_lit_by_itself_as_quadrature_says() {
    let (side, a) = (80.0, 0.8);
    let edge = Vector3::new(0.0, 0.0, 730.0);
    let along = [1.0, -1.0].map(|s| Vector3::new(s * FRAC_PI_4.cos(), 0.0, -FRAC_PI_4.sin()));
    let normals = [along[1], along[0]];
    let wall = |k: usize| {
        let center = edge + along[k] * (side / 2.0);
        let turn = [FRAC_PI_4, -FRAC_PI_4][k];
        object(ShapeSpec::Plane { width_mm: side, height_mm: side }, center.into(), [0.0, turn, 0.0], a)
    };
    let mut spec = spec(vec![wall(0), wall(1)]);
    spec.interreflection = InterreflectionSpec { bounces: 2, paths_per_pixel: 256 };
    let (seen, truth) = (Seen::new(&spec), GroundTruth::of_scene(&spec, 0));
    let light = projector(&mut spec).clone();

    let n = 48;
    let cell = side / f64::from(n);
    let grid: Vec<Vec<Point3<f64>>> = (0..2)
        .map(|k| {
            let at = |i: i32| (f64::from(i % n) + 0.5, f64::from(i / n) + 0.5);
            let point = |(s, t)| Point3::from(edge + along[k] * (s * cell) + Vector3::y() * (t * cell - side / 2.0));
            (0..n * n).map(|i| point(at(i))).collect()
        })
        .collect();
    // What a point of wall k receives of a radiosity on the other.
    let gather = |p: &Point3<f64>, k: usize, radiosity: &[f64]| -> f64 {
        let other = grid[1 - k].iter().zip(radiosity);
        let parts = other.map(|(q, b)| {
            let way = q - p;
            let d2 = way.norm_squared();
            b * way.dot(&normals[k]) * -way.dot(&normals[1 - k]) / (PI * d2 * d2) * cell * cell
        });
        parts.sum()
    };
    let direct =
        [0, 1].map(|k| -> Vec<f64> { grid[k].iter().map(|p| a * irradiance(&light, p, &normals[k])).collect() });
    let once = [0, 1].map(|k| -> Vec<f64> {
        grid[k].iter().zip(&direct[k]).map(|(p, b)| b + a * gather(p, k, &direct[1 - k])).collect()
    });
    // Blocks of 3 × 3 pixels: the noise of random paths is smaller there.
    let mut sums = std::collections::BTreeMap::new();
    for (i, p) in seen.points(&truth, 1) {
        let k = usize::from(p.x < 0.0);
        // Close to the edge the grid is too coarse.
        if p.x.abs() < 6.0 {
            continue;
        }
        let first = a * irradiance(&light, &p, &normals[k]);
        let expected = first + a * gather(&p, k, &once[1 - k]);
        let [x, y] = seen.pixel(i);
        let sum = sums.entry([x / 3, y / 3]).or_insert([0.0; 4]);
        *sum = [sum[0] + seen.white[i], sum[1] + expected, sum[2] + first, sum[3] + 1.0];
    }
    let whole: Vec<_> = sums.values().filter(|s| s[3] == 9.0).collect();
    assert!(whole.len() > 60, "{}", whole.len());
    let (mut worst, mut share, mut bias) = (0f64, 0f64, 0f64);
    for [got, expected, first, n] in &whole {
        worst = worst.max((got - expected).abs() / n);
        share = share.max((expected - first) / expected);
        bias += (got / expected - 1.0) / whole.len() as f64;
    }
    assert!(share > 0.2, "the corner hardly matters: {share}");
    assert!(worst < 0.012 && bias.abs() < 1.5e-3, "worst {worst}, mean {bias}");
}

#[test]
fn wax_blurs_an_edge_of_light_as_declared() {
    let plane = object(ShapeSpec::Plane { width_mm: 400.0, height_mm: 400.0 }, [0.0, 0.0, MIDDLE], [0.0; 3], 0.8);
    let mean = 4.0;
    let wax = MaterialSpec::Translucent { mean_free_path_mm: mean, share: 0.7 };
    let mut of_wax = spec(vec![ObjectSpec { material: wax, ..plane.clone() }]);
    projector(&mut of_wax).sharp_sigma_px = 0.05;
    projector(&mut of_wax).aperture_mm = 0.0;
    projector(&mut of_wax).focus_mm = MIDDLE;
    let seen = Seen::new(&of_wax);
    let truth = GroundTruth::of_scene(&of_wax, 0);
    // White keeps its light: the lamp is so far that it is even over some millimeters.
    let lambert = Seen::new(&spec(vec![plane]));
    for (i, _) in seen.points(&truth, 2) {
        assert!((seen.white[i] / lambert.white[i] - 1.0).abs() < 0.01);
    }
    // The first Gray image is dark on one half and bright on the other. Light enters beyond distance d to one side with
    // probability 1/π ∫ exp(−d / (mean cos φ)) dφ over a quarter turn.
    let beyond = |d: f64| {
        let n = 2000;
        let at = |i: i32| (f64::from(i) + 0.5) / f64::from(n) * FRAC_PI_2;
        (0..n).map(|i| (-d / (mean * at(i).cos())).exp()).sum::<f64>() * FRAC_PI_2 / f64::from(n) / PI
    };
    let pattern = &seen.patterns[0];
    let right = seen.points(&truth, 2);
    let (_, last) = right.last().unwrap();
    let bright_right = {
        let far = right.iter().max_by(|a, b| a.1.x.total_cmp(&b.1.x)).unwrap();
        pattern[far.0] > 0.5 * seen.white[far.0]
    };
    assert!(last.z > 0.0);
    let mut bins = std::collections::BTreeMap::new();
    for (i, p) in right {
        let u = |x: f64| seen.projector.project(&Point3::new(x, p.y, p.z)).unwrap()[0];
        // The edge lies between the projector's columns 255 and 256.
        let edge = p.x + (255.5 - u(p.x)) / (u(p.x + 0.5) - u(p.x - 0.5));
        let edge = edge + (255.5 - u(edge)) / (u(edge + 0.5) - u(edge - 0.5));
        let d = if bright_right { p.x - edge } else { edge - p.x };
        let tail = 0.7 * beyond(d.abs());
        let expected = if d > 0.0 { 1.0 - tail } else { tail };
        // Within a pixel of the edge it is not sharp.
        if d.abs() > 1.8 && d.abs() < 25.0 {
            let bin = bins.entry((d / 1.5).round() as i64).or_insert([0.0; 3]);
            *bin = [bin[0] + pattern[i] / seen.white[i], bin[1] + expected, bin[2] + 1.0];
        }
    }
    assert!(bins.len() > 20, "{}", bins.len());
    for (d, [got, expected, n]) in bins {
        assert!((got - expected).abs() / n < 0.015, "{d}: {}, not {}", got / n, expected / n);
    }
}

#[test]
fn lacquer_shines_where_the_mirror_is() {
    let plane = |material| ObjectSpec {
        material,
        ..object(ShapeSpec::Plane { width_mm: 400.0, height_mm: 400.0 }, [0.0, 0.0, MIDDLE], [0.0, -0.13, 0.0], 0.3)
    };
    let glossy = MaterialSpec::Glossy { roughness: 0.3, reflectance: 0.04 };
    let mut shiny = spec(vec![plane(glossy)]);
    // Brighter than the sensor can read otherwise.
    projector(&mut shiny).reference_mm = 250.0;
    let seen = Seen::new(&shiny);
    let truth = GroundTruth::of_scene(&shiny, 0);
    let light = Point3::from(projector(&mut shiny).position_mm);
    let normal = Isometry3::new(Vector3::zeros(), Vector3::new(0.0, -0.13, 0.0)) * -Vector3::z();
    let points = seen.points(&truth, 2);
    let brightest = points.iter().max_by(|a, b| seen.white[a.0].total_cmp(&seen.white[b.0])).unwrap();
    // The brightest point's half vector is the normal.
    let half = ((light - brightest.1).normalize() - brightest.1.coords.normalize()).normalize();
    assert!(half.angle(&normal) < 0.02, "{}", half.angle(&normal));
    let [low, high] = [f64::min, f64::max].map(|f| points.iter().map(|p| seen.white[p.0]).reduce(f).unwrap());
    assert!(high > 2.0 * low, "{low} {high}");
}

#[test]
fn a_bent_sheet_is_a_cylinder_in_truth_and_image() {
    let k = 0.012;
    let sheet = ObjectSpec {
        deformation: Some(DeformationSpec::Bend { curvature_per_mm: k, axis: AxisSpec::Y }),
        ..object(ShapeSpec::Plane { width_mm: 200.0, height_mm: 200.0 }, [0.0, 0.0, MIDDLE], [0.0; 3], 0.7)
    };
    let mut spec = spec(vec![sheet]);
    let (seen, truth) = (Seen::new(&spec), GroundTruth::of_scene(&spec, 0));
    let center = MIDDLE + 1.0 / k;
    let points = seen.points(&truth, 2);
    assert!(points.len() > 800);
    for (i, p) in points {
        let outward = Vector3::new(p.x, 0.0, p.z - center);
        // Chords of a 256th of the sheet.
        assert!((outward.norm() - 1.0 / k).abs() < 2e-3, "{p}");
        let expected = 0.7 * irradiance(projector(&mut spec), &p, &outward.normalize());
        assert!((seen.white[i] - expected).abs() < 4e-3, "{}, not {expected}", seen.white[i]);
    }
}

#[test]
fn files_are_found_beside_the_spec_and_named_when_they_are_not() {
    let dir = tempfile::tempdir().unwrap();
    let mesh = Mesh {
        vertices: vec![[0.0; 3], [0.0, 60.0, 0.0], [60.0, 0.0, 0.0]],
        faces: vec![[0, 1, 2]],
        colors: vec![[255, 0, 0], [0, 255, 0], [0, 0, 255]],
        ..Mesh::default()
    };
    mesh.write(&dir.path().join("a.ply")).unwrap();
    let mut spec = spec(vec![object(ShapeSpec::Sphere { radius_mm: 20.0 }, [0.0, 0.0, MIDDLE], [0.0; 3], 0.5)]);
    let shape = ShapeSpec::Mesh { file: "a.ply".into(), scale: 1.0 };
    let albedo = AlbedoSpec::VertexColors { srgb: true };
    spec.scenes[0].objects = vec![ObjectSpec { albedo, ..object(shape, [0.0, 0.0, MIDDLE], [0.0; 3], 0.0) }];
    let file = dir.path().join("spec.toml");
    std::fs::write(&file, spec.to_toml()).unwrap();
    let read = Spec::read(&file).unwrap();
    let ShapeSpec::Mesh { file: found, .. } = &read.scenes[0].objects[0].shape else { panic!("a mesh") };
    assert_eq!(found, &std::path::absolute(dir.path().join("a.ply")).unwrap());
    let seen = Seen::new(&read);
    // A mono camera sees a third of every pure color.
    let truth = GroundTruth::of_scene(&read, 0);
    for (i, p) in seen.points(&truth, 1) {
        let expected = irradiance(projector(&mut spec), &p, &-Vector3::z()) / 3.0;
        assert!((seen.white[i] - expected).abs() < 2e-3, "{}, not {expected}", seen.white[i]);
    }
    let complaint = |change: &dyn Fn(&mut ObjectSpec), words: [&str; 2]| {
        let mut bad = read.clone();
        change(&mut bad.scenes[0].objects[0]);
        let message = bad.check().unwrap_err().to_string();
        assert!(words.iter().all(|w| message.contains(w)), "{message}");
    };
    let other = |name: &str| ShapeSpec::Mesh { file: Path::new(name).into(), scale: 1.0 };
    complaint(&|o| o.shape = other("none.stl"), ["none.stl", "shape.file"]);
    Mesh { colors: vec![], ..mesh }.write(&dir.path().join("gray.ply")).unwrap();
    complaint(&|o| o.shape = other(dir.path().join("gray.ply").to_str().unwrap()), ["gray.ply", "no vertex colors"]);
    let picture =
        |name: &str| AlbedoSpec::Image { file: name.into(), size_mm: [9.0; 2], axis: AxisSpec::Z, srgb: true };
    complaint(&|o| o.albedo = picture("none.png"), ["none.png", "albedo.file"]);
    complaint(
        &|o| o.material = MaterialSpec::Glossy { roughness: 0.0, reflectance: 0.04 },
        ["material.roughness", "0.05"],
    );
    let bend = DeformationSpec::Bend { curvature_per_mm: 0.01, axis: AxisSpec::Z };
    complaint(&|o| o.deformation = Some(bend), ["deformation.axis", "give one of them"]);
}
