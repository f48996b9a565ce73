//! Camera, projector, film and board against closed forms, measured in rendered images.

use super::common::{BASELINE_MM, edge_moments, image, middle_row, plane, projector, rig, scene, spec};
use nelu3d_scan::Image;
use nelu3d_scan::board::Artwork;
use nelu3d_scan::image::write_png8;
use nelu3d_scan::pattern::{Axis, Gray, Pattern, Ramp};
use nelu3d_sim::spec::{BoardSpec, FilmSpec, LightSpec, PerColor, SweepSpec};
use nelu3d_sim::sweep::sweep_poses;
use nelu3d_sim::{Spec, simulate};

/// Column of the projector that lights the middle row's pixel x of a facing plane.
fn column(x: f64, z_mm: f64) -> f64 {
    300.0 * ((x - 119.5) / 700.0 * z_mm - BASELINE_MM) / z_mm + 79.5
}

fn ramp() -> Vec<Pattern> {
    vec![Pattern::Ramp(Ramp { axis: Axis::X })]
}

#[test]
fn defocus_is_a_thin_lens_along_a_tilted_plane() {
    let mut spec = spec(vec![Pattern::Gray(Gray { axis: Axis::X, inverse: false })]);
    let (aperture, focus, tilt) = (110.0, 700.0, 0.75);
    let p = projector(&mut spec);
    (p.sharp_sigma_px, p.aperture_mm, p.focus_mm, p.focus_tilt) = (0.8, aperture, focus, [tilt, 0.0]);
    let depths = [560.0, 700.0, 860.0];
    spec.scenes = depths.map(|z| scene(&format!("z{z}"), vec![plane(z)])).to_vec();
    let (_dir, rig) = rig(&spec);
    let mut sigmas = Vec::new();
    for z in depths {
        let shot = rig.scene(&format!("z{z}")).unwrap();
        // The second bit changes at column 64 − ½, once: its inverse edge is out of the camera's sight.
        let bits = &rig.pattern_sets[0].images;
        let [white, black] = ["white.png", "black.png"].map(|f| middle_row(&image(&rig, &shot, f), 0));
        for (bit, edges) in [(0, vec![127.5]), (1, vec![63.5]), (2, vec![31.5, 95.5])] {
            let values = middle_row(&image(&rig, &shot, &bits[bit]), 0);
            let l: Vec<f64> = (0..values.len()).map(|i| (values[i] - black[i]) / (white[i] - black[i])).collect();
            let at: Vec<f64> = (0..l.len()).map(|x| column(x as f64, z)).collect();
            for edge in edges {
                let (from, to) = (edge - 15.0, edge + 15.0);
                if at[0] > from || at[at.len() - 1] < to {
                    continue;
                }
                let (mean, variance) = edge_moments(&at, &l, from, to);
                // Where the edge's ray meets the plane z = focus + x tan(tilt), and the circle of confusion at z.
                let slope = (edge - 79.5) / 300.0;
                let in_focus = focus / (1.0 - slope * f64::tan(tilt));
                let circle_mm = aperture * (z - in_focus).abs() / in_focus;
                let sigma = 0.25 * circle_mm * 300.0 / z;
                // With the lens's own blur, the projector's and the camera's pixels.
                let pixel = 300.0 / 700.0;
                let expected = sigma * sigma + 0.64 + 1.0 / 12.0 + pixel * pixel / 12.0;
                eprintln!(
                    "z {z}, edge {edge}: {mean:.3}, sigma {:.3}, expected {:.3}",
                    variance.sqrt(),
                    expected.sqrt()
                );
                assert!((mean - edge).abs() < 0.15, "z {z}: the edge of {edge} is at {mean}");
                // The blur grows across the edge itself, and 15 px hold nearly all of it.
                assert!((variance / expected - 1.0).abs() < 0.08, "z {z}, {edge}: {variance}, not {expected}");
                sigmas.push(expected.sqrt());
            }
        }
    }
    assert!(sigmas.len() >= 5, "{sigmas:?}");
    let (low, high) = sigmas.iter().fold((f64::MAX, 0.0f64), |(l, h), &s| (l.min(s), h.max(s)));
    assert!(high > 2.0 * low, "too much alike to tell anything: {sigmas:?}");
}

#[test]
fn gaps_cost_their_area_and_show_where_the_projector_is_sharp() {
    let mut spec = spec(ramp());
    spec.scenes = vec![scene("plane", vec![plane(700.0)])];
    let mut white = |fill: f64, sigma: f64| {
        let p = projector(&mut spec);
        (p.fill_factor, p.sharp_sigma_px) = (fill, sigma);
        let (_dir, rig) = rig(&spec);
        middle_row(&image(&rig, &rig.scene("plane").unwrap(), "white.png"), 0)
    };
    let inside = 60..180;
    let full = white(1.0, 0.3);
    for sigma in [0.3, 1.5] {
        let row = white(0.7, sigma);
        // The middle row lies on the projector's row 29.5: between two rows of squares, a minimum across.
        let series = |k: f64, f: f64, s: f64| {
            2.0 * (std::f64::consts::PI * k * f).sin() / (std::f64::consts::PI * k)
                * (-2.0 * (std::f64::consts::PI * k * s).powi(2)).exp()
        };
        // A camera pixel is a box of 3/7 px on the projector.
        let box_ = |k: f64| {
            let x = std::f64::consts::PI * k * 3.0 / 7.0;
            x.sin() / x
        };
        let v = 300.0 / 700.0 * (30.0 - 29.5) + 29.5;
        let at = |w: f64| {
            let term = |k: i32| {
                let k = f64::from(k);
                series(k, 0.7, sigma) * box_(k) * (std::f64::consts::TAU * k * w).cos()
            };
            0.7 + (1..12).map(term).sum::<f64>()
        };
        for x in inside.clone() {
            let expected = at(column(x as f64, 700.0)) * at(v);
            let got = row[x] / full[x];
            assert!((got - expected).abs() < 0.02, "sigma {sigma}, pixel {x}: {got}, not {expected}");
        }
        let (low, high) =
            inside.clone().map(|x| row[x] / full[x]).fold((9.0f64, 0.0f64), |(l, h), v| (l.min(v), h.max(v)));
        if sigma > 1.0 {
            assert!(high - low < 1e-3, "a grid of {low} to {high} in a blurred image");
        } else {
            assert!(high - low > 0.07, "no grid: {low} to {high}");
        }
    }
}

#[test]
fn each_channel_has_its_response_and_its_primary() {
    let mut spec = spec(ramp());
    spec.camera.channels = "rgb".into();
    spec.scenes = vec![scene("plane", vec![plane(700.0)])];
    let gamma = [1.0, 2.2, 3.0];
    let primaries = [[0.9, 0.2, 0.0], [0.1, 0.7, 0.1], [0.0, 0.1, 0.8]];
    let p = projector(&mut spec);
    (p.gamma, p.black_leak) = (PerColor::Each(gamma), 0.01);
    let shots = |spec: &Spec| {
        let (_dir, rig) = rig(spec);
        let shot = rig.scene("plane").unwrap();
        ["white.png", "ramp_00.png"].map(|f| [0, 1, 2].map(|c| middle_row(&image(&rig, &shot, f), c)))
    };
    let [white, pattern] = shots(&spec);
    projector(&mut spec).primaries = primaries;
    let [mixed_white, mixed_pattern] = shots(&spec);
    for x in (40..200).step_by(7) {
        let code = column(x as f64, 700.0) / 159.0;
        let light = [0, 1, 2].map(|c| 0.01 + 0.99 * code.powf(gamma[c]));
        for c in 0..3 {
            let got = pattern[c][x] / white[c][x];
            assert!((got - light[c]).abs() < 0.004, "channel {c}, code {code}: {got}, not {}", light[c]);
            // In the camera's band c: every channel's part.
            let sum: f64 = (0..3).map(|p| primaries[p][c]).sum();
            assert!((mixed_white[c][x] / white[c][x] - sum).abs() < 1e-3, "the flash in band {c}");
            let expected: f64 = (0..3).map(|p| primaries[p][c] * light[p]).sum::<f64>() / sum;
            let got = mixed_pattern[c][x] / mixed_white[c][x];
            assert!((got - expected).abs() < 0.004, "band {c}, code {code}: {got}, not {expected}");
        }
    }
}

#[test]
fn light_grows_with_time_and_gain_and_falls_off_the_axis() {
    let mut spec = spec(ramp());
    spec.scenes = vec![scene("plane", vec![plane(700.0)])];
    let white = |spec: &Spec| {
        let (_dir, rig) = rig(spec);
        middle_row(&image(&rig, &rig.scene("plane").unwrap(), "white.png"), 0)
    };
    let plain = white(&spec);
    // 0.4 of the well, times the inverse square and the cosine at the light's foot (119.5 + 60 px).
    assert!((plain[179] - 0.4).abs() < 0.001, "{}", plain[179]);
    spec.camera.exposure_secs *= 0.5;
    spec.camera.gain = 3.0;
    spec.camera.dark_electrons_per_sec = 1e9;
    spec.camera.vignetting = 4.0;
    let other = white(&spec);
    for (x, (a, b)) in plain.iter().zip(&other).enumerate() {
        let cosine = 1.0 / (1.0 + ((x as f64 - 119.5).powi(2) + 0.25) / 490_000.0).sqrt();
        let expected = 1.5 * a * cosine.powi(4) + 3.0 * 1e9 * 0.005 / 1e9;
        assert!((b - expected).abs() < 5e-4, "{x}: {b}, not {expected}");
    }
}

#[test]
fn a_printed_board_is_made_of_dots() {
    let mut spec = spec(ramp());
    let camera = &mut spec.camera;
    (camera.height, camera.cy) = (160, 79.5);
    let p = projector(&mut spec);
    (p.height, p.cy, p.fx, p.fy) = (160, 79.5, 200.0, 200.0);
    // Dots of 5.08 mm, a third of a square and more.
    spec.print_dpi = Some(5.0);
    spec.board =
        BoardSpec::Chessboard { columns: 10, rows: 7, square_mm: 12.0, extent_mm: Some([-20.0, -20.0, 140.0, 104.0]) };
    let SweepSpec::Stage { first_mm, last_mm, step_error_mm, .. } = &mut spec.sweep else { panic!("a stage") };
    (*first_mm, *last_mm, *step_error_mm) = (600.0, 620.0, 0.0);
    let (_dir, rig) = rig(&spec);
    let artwork = Artwork::new(&spec.board.board()).unwrap();
    let dot = 25.4 / 5.0;
    let (mut compared, mut changed) = (0, 0);
    for (shot, pose) in rig.positions().unwrap().iter().zip(sweep_poses(&spec)) {
        let white = image(&rig, shot, "white.png");
        let board_from_cam = pose.cam_from_board.inverse();
        for i in 0..white.data.len() {
            let ray = rig.camera.ray([(i % 240) as f64, (i / 240) as f64]);
            let (o, d) = (board_from_cam * ray.origin, board_from_cam * ray.dir);
            let p = o - d * (o.z / d.z);
            let inside = |v: f64, n: f64| v > 0.0 && v < n;
            let part = [p.x / dot, p.y / dot].map(|v| v - v.floor());
            // A pixel is 0.9 mm: keep to the inside of dots.
            if !inside(p.x, 120.0) || !inside(p.y, 84.0) || part.iter().any(|v| !(0.2..0.8).contains(v)) {
                continue;
            }
            let center = [p.x, p.y].map(|v| ((v / dot).floor() + 0.5) * dot);
            let expected = artwork.albedo(center[0], center[1]);
            let brightness = white.data[i];
            assert_eq!(brightness > 0.15, expected > 0.5, "({:.2}, {:.2}) mm: {brightness}", p.x, p.y);
            compared += 1;
            changed += usize::from(artwork.albedo(p.x, p.y) != expected);
        }
    }
    assert!(compared > 5000 && changed > 300, "{compared} compared, {changed} of them changed by the printer");
}

#[test]
fn a_picture_of_film_is_thrown_with_the_color_of_its_led() {
    let mut spec = Spec { pattern_sets: Vec::new(), ..spec(ramp()) };
    spec.camera.channels = "rgb".into();
    spec.scenes = vec![scene("plane", vec![plane(700.0)])];
    let dir = tempfile::tempdir().unwrap();
    let (w, h) = (300, 200);
    let value = |c: usize, u: f64| 0.5 + 0.4 * (std::f64::consts::TAU * (u / 6.0 + c as f64 / 3.0)).cos();
    let half = [9.0, 6.0];
    let data =
        (0..w * h * 3).map(|i| value(i % 3, ((i / 3 % w) as f64 + 0.5) / w as f64 * 18.0 - 9.0) as f32).collect();
    write_png8(&dir.path().join("strip.png"), &Image { width: w, height: h, channels: 3, data }, 0.0, 255.0).unwrap();
    let light = "kind = \"film\"\nposition_mm = [60.0, 0.0, 0.0]\ntarget_mm = [60.0, 0.0, 700.0]\nreference_mm = 700.0\n\
                 film_mm = 30.0\nlamp_sigma_mm = 0.5\nfilm_half_size_mm = [9.0, 6.0]\nimage = \"strip.png\"\n\
                 film_led = [1.0, 0.8, 0.6]\nflash_led = [0.9, 1.0, 0.7]\n";
    spec.light = toml::from_str(light).unwrap();
    let file = dir.path().join("spec.toml");
    std::fs::write(&file, spec.to_toml()).unwrap();
    // A path in a file starts from the file.
    let spec = Spec::read(&file).unwrap();
    let LightSpec::Film(FilmSpec { film_led, flash_led, .. }) = &spec.light else { panic!("film") };
    let (_dir, rig) = rig(&spec);
    let shot = rig.scene("plane").unwrap();
    let [white, pattern] = ["white.png", "pattern.png"].map(|f| image(&rig, &shot, f));
    // The lamp's disc, seen through the film from 700 mm, damps the wave.
    let sigma = 0.5 * (1.0 - 30.0 / 700.0);
    let damping = (-0.5 * (std::f64::consts::TAU * sigma / 6.0f64).powi(2)).exp();
    for c in 0..3 {
        let (white, pattern) = (middle_row(&white, c), middle_row(&pattern, c));
        for x in (60..230).step_by(5) {
            let u = 30.0 * ((x as f64 - 119.5) - BASELINE_MM) / 700.0;
            assert!(u.abs() < half[0]);
            let expected = (0.5 + (value(c, u) - 0.5) * damping) * film_led[c] / flash_led[c];
            let got = pattern[x] / white[x];
            assert!((got - expected).abs() < 0.01, "color {c} at {u} mm: {got}, not {expected}");
        }
    }
    // The rig holds its picture, and can be made again from itself.
    let again = dir.path().join("again");
    simulate(&Spec::read(&rig.root.join("simulation.toml")).unwrap(), &again, &|_, _, _| ()).unwrap();
    let file = "scenes/plane/pattern.png";
    assert!(std::fs::read(rig.root.join(file)).unwrap() == std::fs::read(again.join(file)).unwrap());

    // A picture of another shape than the film's, and none at all.
    for (path, size, part) in [("strip.png", [9.0, 9.0], "do not fill"), ("none.png", half, "none.png")] {
        let mut wrong = spec.clone();
        let LightSpec::Film(film) = &mut wrong.light else { panic!("film") };
        film.image = Some(dir.path().join(path));
        film.film_half_size_mm = size;
        let message = simulate(&wrong, &dir.path().join("wrong"), &|_, _, _| ()).unwrap_err().to_string();
        assert!(message.contains(part), "{message}");
    }
}

#[test]
fn what_makes_no_sense_is_refused_by_name() {
    let good = spec(ramp());
    good.check().unwrap();
    type Change = fn(&mut Spec);
    let changes: [(&str, Change); 17] = [
        ("camera.gain", |s| s.camera.gain = 0.5),
        ("camera.electrons_per_sec", |s| s.camera.electrons_per_sec = 0.0.into()),
        ("camera.electrons_per_sec", |s| s.camera.electrons_per_sec = PerColor::Each([1.0, 2.0, 3.0])),
        ("camera.exposure_secs", |s| s.camera.exposure_secs = f64::NAN),
        ("camera.dark_electrons_per_sec", |s| s.camera.dark_electrons_per_sec = -1.0),
        ("camera.shutter_samples", |s| s.camera.shutter_samples = 0),
        ("camera.vignetting", |s| s.camera.vignetting = -1.0),
        ("light.fill_factor", |s| projector(s).fill_factor = 0.0),
        ("light.fill_factor", |s| projector(s).fill_factor = 1.1),
        ("light.focus_tilt", |s| projector(s).focus_tilt = [0.0, 1.6]),
        ("light.gamma", |s| projector(s).gamma = PerColor::Each([1.0, 0.0, 1.0])),
        ("light.primaries", |s| projector(s).primaries[1][2] = -0.1),
        ("print_dpi", |s| s.print_dpi = Some(0.0)),
        ("sweep.tilt_jitter", |s| {
            let SweepSpec::Stage { tilt_jitter, .. } = &mut s.sweep else { panic!("a stage") };
            *tilt_jitter = -0.1;
        }),
        ("fps", |s| sequence(s, "fps = 0.0\nframes = 3\nobjects = []")),
        ("frames", |s| sequence(s, "fps = 1.0\nframes = 0\nobjects = []")),
        ("pattern_set", |s| sequence(s, "fps = 1.0\nframes = 1\nobjects = []\npattern_set = \"none\"")),
    ];
    for (key, change) in changes {
        let mut spec = good.clone();
        change(&mut spec);
        let message = spec.check().unwrap_err().to_string();
        assert!(message.contains(key), "{key}: {message}");
    }
}

#[test]
fn a_rolled_projector_turns_its_rows() {
    let mut spec = spec(ramp());
    projector(&mut spec).roll = 0.1;
    let (_dir, rig) = rig(&spec);
    let p = rig.projector.unwrap();
    // Beside the axis along the projector's own x, which points down by the roll in the camera's frame (y is down).
    let x = nalgebra::Point3::new(BASELINE_MM + 100.0 * 0.1f64.cos(), 100.0 * 0.1f64.sin(), 700.0);
    let [u, v] = p.project(&x).unwrap();
    assert!((u - 79.5 - 300.0 / 7.0).abs() < 1e-9 && (v - 29.5).abs() < 1e-9, "{u}, {v}");
}

fn sequence(spec: &mut Spec, text: &str) {
    spec.sequences.push(toml::from_str(&format!("name = \"s\"\n{text}")).unwrap());
}
