mod tree;

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use nelu3d::Progress;
use nelu3d_evaluate::cad::{
    CadComparison, CadError, CadOptions, CadSurface, InitialPose, ScanMaps, compare_with_cad, pose_rows, read_pose,
};
use nelu3d_scan::{Camera, Mesh};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};

/// A closed blob without any symmetry, about 80 mm across, as a grid of longitudes and latitudes.
fn blob() -> Mesh {
    ball(|d| {
        let bump = |c: [f64; 3], width: f64, height: f64| {
            let c = Vector3::from(c).normalize();
            height * (-(1.0 - d.dot(&c)) / width).exp()
        };
        36.0 + bump([1.0, 0.3, 0.2], 0.12, 14.0)
            + bump([-0.4, 1.0, 0.3], 0.08, 9.0)
            + bump([-0.3, -0.5, 1.0], 0.2, 11.0)
            + bump([0.2, -1.0, -0.6], 0.06, 7.0)
            + bump([0.1, 0.5, -1.0], 0.1, -8.0)
            + bump([-1.0, -0.3, -0.4], 0.15, 10.0)
    })
}

/// A star-shaped closed mesh, radius by direction.
fn ball(radius: impl Fn(&Vector3<f64>) -> f64) -> Mesh {
    let (columns, rows) = (96u32, 48u32);
    let mut mesh = Mesh::default();
    let mut add = |theta: f64, phi: f64| {
        let d = Vector3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
        let p = d * radius(&d);
        mesh.vertices.push([p.x as f32, p.y as f32, p.z as f32]);
    };
    use std::f64::consts::{PI, TAU};
    add(0.0, 0.0);
    for r in 1..rows {
        for c in 0..columns {
            add(PI * f64::from(r) / f64::from(rows), TAU * f64::from(c) / f64::from(columns));
        }
    }
    add(PI, 0.0);
    let at = |r: u32, c: u32| 1 + (r - 1) * columns + c % columns;
    let last = mesh.vertices.len() as u32 - 1;
    for c in 0..columns {
        mesh.faces.push([0, at(1, c), at(1, c + 1)]);
        for r in 1..rows - 1 {
            mesh.faces.push([at(r, c), at(r + 1, c), at(r + 1, c + 1)]);
            mesh.faces.push([at(r, c), at(r + 1, c + 1), at(r, c + 1)]);
        }
        mesh.faces.push([last, at(rows - 1, c + 1), at(rows - 1, c)]);
    }
    mesh
}

/// A prism over a polygon in x and y (counter-clockwise, star-shaped from its first corner), from z = 0 to the height
/// of each corner: all faces are planes or nearly so, and no two sides are alike.
fn bracket() -> Mesh {
    let outline = [[0.0, 0.0], [70.0, 0.0], [70.0, 14.0], [18.0, 14.0], [12.0, 50.0], [0.0, 50.0]];
    let heights = [30.0, 18.0, 18.0, 30.0, 30.0, 30.0];
    let n = outline.len() as u32;
    let mut mesh = Mesh::default();
    for (low, _) in [(true, 0), (false, 1)] {
        for (p, h) in outline.iter().zip(heights) {
            mesh.vertices.push([p[0] as f32, p[1] as f32, if low { 0.0 } else { h as f32 }]);
        }
    }
    for i in 1..n - 1 {
        mesh.faces.push([0, i + 1, i]);
        mesh.faces.push([n, n + i, n + i + 1]);
    }
    for i in 0..n {
        let j = (i + 1) % n;
        mesh.faces.push([i, j, n + j]);
        mesh.faces.push([i, n + j, n + i]);
    }
    mesh
}

fn camera() -> Camera {
    Camera::pinhole(130, 104, 312.0, 312.0, 64.5, 51.5)
}

/// Depth of a mesh at a pose, by marching each ray to the surface; `noise` is the standard deviation along z, mm.
fn render(mesh: &Mesh, pose: &Isometry3<f64>, noise: f64, seed: u64) -> Vec<f32> {
    let (camera, surface) = (camera(), CadSurface::new(mesh, 1.0).unwrap());
    let mut rng = StdRng::seed_from_u64(seed);
    let center = pose * Point3::from((surface_center(mesh)).coords);
    (0..camera.n_pixels())
        .map(|i| {
            let ray = camera.ray([(i % camera.width) as f64, (i / camera.width) as f64]);
            // Sphere tracing: signed distances are what the surface is asked for.
            let mut t = center.coords.norm() - surface.diagonal();
            if center.coords.cross(&ray.dir).norm() > 0.6 * surface.diagonal() {
                return f32::NAN;
            }
            for _ in 0..400 {
                let distance = surface.signed_distance(pose, &ray.at(t));
                if distance < 1e-6 {
                    let noise: f64 = noise * Distribution::<f64>::sample(&StandardNormal, &mut rng);
                    return (ray.at(t).z + noise) as f32;
                }
                t += distance;
                if t > center.coords.norm() + surface.diagonal() {
                    break;
                }
            }
            f32::NAN
        })
        .collect()
}

fn surface_center(mesh: &Mesh) -> Point3<f64> {
    let sum = mesh.vertices.iter().fold(Vector3::zeros(), |s, v| s + Vector3::from(v.map(f64::from)));
    Point3::from(sum / mesh.vertices.len() as f64)
}

/// A random rotation about the middle of the mesh, half a meter before the camera.
fn random_pose(mesh: &Mesh, seed: u64) -> Isometry3<f64> {
    let mut rng = StdRng::seed_from_u64(1000 + seed);
    let mut random = || rng.random_range(-1.0..1.0);
    let axis = Vector3::new(random(), random(), random()) * 3.0;
    let shift = Vector3::new(15.0 * random(), 15.0 * random(), 480.0 + 40.0 * random());
    Isometry3::from_parts(Translation3::from(shift), UnitQuaternion::from_scaled_axis(axis))
        * Translation3::from(-surface_center(mesh).coords)
}

fn compare(depth: &[f32], mesh: &Mesh, options: &CadOptions) -> Result<CadComparison, CadError> {
    let camera = camera();
    compare_with_cad(&ScanMaps { camera: &camera, depth, normals: None }, mesh, options, &Progress::none())
}

/// How far two poses put the mesh apart, mm at its center and degrees.
fn apart(a: &Isometry3<f64>, b: &Isometry3<f64>, mesh: &Mesh) -> (f64, f64) {
    let center = surface_center(mesh);
    ((a * center - b * center).norm(), a.rotation.angle_to(&b.rotation).to_degrees())
}

#[test]
fn any_pose_of_a_part_is_found_from_one_view() {
    for (name, mesh) in [("blob", blob()), ("bracket", bracket())] {
        for seed in 0..3 {
            let truth = random_pose(&mesh, seed);
            let depth = render(&mesh, &truth, 0.05, seed);
            let found = compare(&depth, &mesh, &CadOptions { seed, ..CadOptions::default() }).unwrap();
            let (shift, turn) = apart(&found.pose, &truth, &mesh);
            let m = &found.metrics;
            println!("{name} {seed}: {shift:.4} mm, {turn:.4}°, {:?}", m.part.distance_mm);
            assert!(shift < 0.1 && turn < 0.1, "{name} {seed}: {shift} mm, {turn}°\n{m}");
            assert!(m.inliers > 0.99 && m.visible_found > 0.97 && m.in_front < 0.02, "{name} {seed}\n{m}");
            // Noise along z is shorter along the normal: at most what was added, and most of it where the view is
            // straight.
            assert!((0.02..0.051).contains(&m.body.distance_mm.rmse), "{name} {seed}\n{m}");
            assert!(m.body.distance_mm.bias.abs() < 0.005, "{name} {seed}\n{m}");
        }
    }
}

#[test]
fn what_stands_around_the_part_does_not_matter() {
    let mesh = bracket();
    let truth = random_pose(&mesh, 2);
    let mut depth = render(&mesh, &truth, 0.05, 2);
    let n_part = depth.iter().filter(|z| z.is_finite()).count();
    // A wall behind it, in all pixels that are left.
    for (i, z) in depth.iter_mut().enumerate() {
        if z.is_nan() {
            *z = 560.0 + 0.3 * (i % 130) as f32;
        }
    }
    assert!(n_part * 4 < depth.len());
    let found = compare(&depth, &mesh, &CadOptions::default()).unwrap();
    let (shift, turn) = apart(&found.pose, &truth, &mesh);
    assert!(shift < 0.1 && turn < 0.1, "{shift} mm, {turn}°\n{}", found.metrics);
    assert!(found.metrics.part.n.abs_diff(n_part) < n_part / 50, "{n_part}\n{}", found.metrics);
    assert!(found.metrics.all.distance_mm.median > 10.0);
}

#[test]
fn a_given_pose_keeps_the_bias_and_an_alignment_takes_it() {
    let mesh = blob();
    let truth = random_pose(&mesh, 7);
    let mut depth = render(&mesh, &truth, 0.03, 7);
    depth.iter_mut().for_each(|z| *z -= 0.4);
    let fixed =
        compare(&depth, &mesh, &CadOptions { start: InitialPose::Fixed(truth), ..CadOptions::default() }).unwrap();
    let body = &fixed.metrics.body.distance_mm;
    // Nearer than the surface is outside of it: by 0.4 mm times the cosine of the slant.
    assert!((0.25..0.4).contains(&body.bias) && !fixed.metrics.aligned, "{}", fixed.metrics);
    let straight = (0..depth.len()).filter(|&i| depth[i].is_finite()).min_by(|&a, &b| depth[a].total_cmp(&depth[b]));
    assert!((fixed.distances[straight.unwrap()] - 0.4).abs() < 0.12);
    assert_eq!(fixed.pose, truth);

    // A guess 3 mm and 3° away is enough to come back, and what a motion explains is gone.
    let nudge = Isometry3::new(Vector3::new(2.0, -1.0, 2.0), Vector3::new(0.02, 0.04, -0.02));
    let center = Translation3::from((truth * surface_center(&mesh)).coords);
    let guess = center * nudge * center.inverse() * truth;
    let near =
        compare(&depth, &mesh, &CadOptions { start: InitialPose::Near(guess), ..CadOptions::default() }).unwrap();
    assert!(near.metrics.body.distance_mm.bias.abs() < 0.005, "{}", near.metrics);
    let moved = near.pose.translation.vector - truth.translation.vector;
    let (_, turn) = apart(&near.pose, &truth, &mesh);
    assert!(
        turn < 0.1 && (near.pose * surface_center(&mesh) - truth * surface_center(&mesh)).z < -0.3,
        "{moved} {turn}"
    );
}

#[test]
fn a_sphere_has_distances_though_its_turn_is_anybodys() {
    let mesh = ball(|_| 40.0);
    let truth = random_pose(&mesh, 3);
    let depth = render(&mesh, &truth, 0.05, 3);
    let found = compare(&depth, &mesh, &CadOptions::default()).unwrap();
    let (shift, _) = apart(&found.pose, &truth, &mesh);
    assert!(shift < 0.1, "{shift} mm");
    assert!(found.metrics.body.distance_mm.rmse < 0.06, "{}", found.metrics);
}

#[test]
fn distances_are_signed_at_faces_edges_and_corners() {
    let mut cube = Mesh {
        vertices: (0..8).map(|i| [i & 1, i >> 1 & 1, i >> 2].map(|c| 10.0 * c as f32)).collect(),
        faces: vec![
            [0, 2, 1],
            [1, 2, 3],
            [4, 5, 6],
            [5, 7, 6],
            [0, 1, 4],
            [1, 5, 4],
            [2, 6, 3],
            [3, 6, 7],
            [0, 4, 2],
            [2, 4, 6],
            [1, 3, 5],
            [3, 7, 5],
        ],
        ..Mesh::default()
    };
    for _ in 0..2 {
        let surface = CadSurface::new(&cube, 2.0).unwrap();
        assert!(surface.closed());
        let signed = |p: [f64; 3]| surface.signed_distance(&Isometry3::identity(), &Point3::from(p));
        assert_eq!(signed([10.0, 10.0, 23.0]), 3.0);
        assert_eq!(signed([10.0, 10.0, 19.0]), -1.0);
        assert!((signed([24.0, 23.0, 10.0]) - 5.0).abs() < 1e-12);
        assert!((signed([-2.0, -1.0, -2.0]) - 3.0).abs() < 1e-12);
        assert!((signed([0.5, 1.0, 10.0]) + 0.5).abs() < 1e-12);
        // Inside out, it is turned.
        cube.faces.iter_mut().for_each(|f| f.swap(0, 1));
    }

    // Without its lid it has no inside: what faces the camera at the origin is the positive side, and what lies beyond
    // the border says nothing.
    cube.faces = vec![[4, 5, 6], [5, 7, 6]];
    let surface = CadSurface::new(&cube, 1.0).unwrap();
    assert!(!surface.closed());
    let signed = |p: [f64; 3]| surface.signed_distance(&Isometry3::identity(), &Point3::from(p));
    assert_eq!((signed([4.0, 4.0, 9.0]), signed([4.0, 4.0, 12.0])), (1.0, -2.0));
    assert!(signed([14.0, 4.0, 10.0]).is_nan());
}

/// Signs of distances against the winding number (solid angles by Van Oosterom and Strackee 1983).
#[test]
fn a_closed_mesh_has_an_inside() {
    let mesh = blob();
    let surface = CadSurface::new(&mesh, 1.0).unwrap();
    let corners: Vec<[Vector3<f64>; 3]> =
        mesh.faces.iter().map(|f| f.map(|i| Vector3::from(mesh.vertices[i as usize].map(f64::from)))).collect();
    let mut rng = StdRng::seed_from_u64(3);
    let (mut inside, mut outside) = (0, 0);
    for _ in 0..1000 {
        let p = Vector3::from([0; 3].map(|_| rng.random_range(-60.0..60.0)));
        let angle = |corners: &[Vector3<f64>; 3]| {
            let [a, b, c] = corners.map(|v| v - p);
            let [x, y, z] = [a.norm(), b.norm(), c.norm()];
            let cosine = x * y * z + a.dot(&b) * z + b.dot(&c) * x + c.dot(&a) * y;
            2.0 * a.dot(&b.cross(&c)).atan2(cosine)
        };
        let turns = corners.iter().map(angle).sum::<f64>() / (4.0 * std::f64::consts::PI);
        let distance = surface.closest(&Point3::from(p), f64::MAX).unwrap().distance;
        assert_eq!(turns.abs() > 0.5, distance < 0.0, "{p}: {turns} turns, {distance} mm");
        *(if distance < 0.0 { &mut inside } else { &mut outside }) += 1;
    }
    assert!(inside > 100 && outside > 100);
}

#[test]
fn an_open_mesh_is_aligned_too() {
    // What the camera sees of the blob, and a bit more: a scan of an earlier day.
    let mut mesh = blob();
    let truth = random_pose(&mesh, 5);
    let depth = render(&mesh, &truth, 0.02, 5);
    let view = truth.inverse_transform_vector(&Vector3::z());
    let center = surface_center(&mesh);
    let vertices = mesh.vertices.clone();
    mesh.faces
        .retain(|f| f.iter().all(|&i| (Point3::from(vertices[i as usize].map(f64::from)) - center).dot(&view) < 12.0));
    let found = compare(&depth, &mesh, &CadOptions::default()).unwrap();
    let (shift, turn) = apart(&found.pose, &truth, &mesh);
    assert!(shift < 0.1 && turn < 0.1, "{shift} mm, {turn}°\n{}", found.metrics);
    assert!(!found.metrics.closed);
}

#[test]
fn what_cannot_be_compared_is_refused_with_a_remedy() {
    let mesh = blob();
    let depth = render(&mesh, &random_pose(&mesh, 1), 0.02, 1);
    let complaint = |depth: &[f32], mesh: &Mesh| match compare(depth, mesh, &CadOptions::default()) {
        Ok(found) => panic!("{}", found.metrics),
        Err(e) => e.to_string(),
    };
    assert!(complaint(&depth, &Mesh::default()).contains("no triangles"));
    let points = Mesh { faces: vec![[0, 0, 1]], ..mesh.clone() };
    assert!(complaint(&depth, &points).contains("no triangles"));
    assert!(complaint(&vec![f32::NAN; depth.len()], &mesh).contains("0 points"));
    let sized =
        |scale: f32| Mesh { vertices: mesh.vertices.iter().map(|v| v.map(|c| scale * c)).collect(), ..mesh.clone() };
    for (scale, remedy) in [(0.001, "a scale of 1000"), (1000.0, "a scale of 0.001")] {
        let e = complaint(&depth, &sized(scale));
        assert!(e.contains("another unit") && e.contains(remedy), "{e}");
    }
    // With the remedy it works.
    let options = CadOptions { scale: 1000.0, ..CadOptions::default() };
    assert!(compare(&depth, &sized(0.001), &options).unwrap().metrics.inliers > 0.99);
    // A plate is not in a scan of a blob.
    let plate = Mesh {
        vertices: vec![[0.0; 3], [90.0, 0.0, 0.0], [90.0, 60.0, 0.0], [0.0, 60.0, 0.0]],
        faces: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    };
    let e = complaint(&depth, &plate);
    assert!(e.contains("does not fit") && e.contains("give its pose"), "{e}");
}

#[test]
fn the_same_seed_gives_the_same_pose() {
    let mesh = bracket();
    let depth = render(&mesh, &random_pose(&mesh, 9), 0.05, 9);
    let run = || compare(&depth, &mesh, &CadOptions::default()).unwrap();
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap().install(run);
    assert_eq!(one.pose, run().pose);
}

#[test]
fn poses_are_read_back_and_others_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("pose.txt");
    let pose = random_pose(&blob(), 4);
    let rows = pose_rows(&pose);
    let read = |text: &str| {
        std::fs::write(&path, text).unwrap();
        read_pose(&path)
    };
    let text = rows.map(|r| r.map(|v| v.to_string()).join(" ")).join("\n");
    for text in [text.clone(), format!("{{\"cam_from_cad\": {rows:?}, \"scale\": 1}}"), text.replace(' ', ", ")] {
        let (shift, turn) = apart(&read(&text).unwrap(), &pose, &blob());
        assert!(shift < 1e-9 && turn < 1e-6, "{shift} {turn}");
    }
    for (text, problem) in [
        ("1 2 3", "3 numbers"),
        ("a", "`a` is not a number"),
        ("{}", "cam_from_cad"),
        ("2 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1", "no rotation"),
        ("-1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1", "no rotation"),
        ("NaN 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1", "no rotation"),
        ("1 0 0 inf 0 1 0 0 0 0 1 0 0 0 0 1", "no rotation"),
    ] {
        let e = read(text).unwrap_err().to_string();
        assert!(e.contains(problem) && e.contains("pose.txt"), "{e}");
    }
    assert!(read_pose(&dir.path().join("none")).unwrap_err().to_string().contains("cannot be read"));
}
