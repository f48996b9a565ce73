//! The mistakes that people make with a scanner, one at a time on a small virtual rig: each has to be seen, or be known
//! to be out of reach; and rigs without a mistake have to be called good.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use nelu3d_scan::image::write_png16;
use nelu3d_scan::{Image, Rig};
use nelu3d_sim::Spec;
use serde_json::Value;

use super::common::{copy, nelu3d, stderr};

const BLACK_LEVEL: f64 = 64.0;
const SATURATION: f64 = 4095.0;
const PATTERNS: [&str; 3] = ["sine_00.png", "triangle_00.png", "random_00.png"];

/// The scanner that they are made with.
const SPEC: &str = include_str!("mistakes/rig.toml");

/// A mistake.
struct Mistake {
    name: &'static str,
    /// Makes it in a rig folder.
    make: fn(&Path),
    /// What has to be said.
    told: Told,
}

/// Which command has to notice a mistake, and by which codes.
enum Told {
    /// `calibrate` has one of these codes.
    Calibrate(&'static [&'static str]),
    /// `calibrate` has one of these codes, by corners and white images alone: wherever the light is, which takes most of
    /// the time to find.
    Boards(&'static [&'static str]),
    /// `calibrate` has this code where the stage's step is stated.
    Step(&'static str),
    /// Nothing in the sweep tells; `calibrate` says that it was not checked, by this note.
    Noted(&'static str),
    /// `calibrate` refuses, and writes nothing, with this code first.
    Refused(&'static str),
    /// `reconstruct`, with the field of the rig without mistake, has one of these codes or finds no surface at all.
    Reconstruct(&'static [&'static str]),
    /// Nothing in the captures tells; the report says that it was not checked, by this note.
    NotChecked(&'static str),
}

const MISTAKES: &[Mistake] = &[
    Mistake {
        name: "camera.json of another resolution",
        make: |rig| camera(rig, |k| k.iter_mut().flatten().for_each(|v| *v *= 2.0)),
        told: Told::Boards(&["camera-intrinsics"]),
    },
    Mistake {
        name: "distortion missing",
        make: |rig| edit_json(rig, |json| json["dist_coeffs"] = serde_json::json!([0.0, 0.0, 0.0, 0.0, 0.0])),
        told: Told::Boards(&["camera-distortion"]),
    },
    Mistake {
        name: "print stretched by 2 %",
        make: |rig| board(rig, |x, y| [1.02 * x, y]),
        told: Told::Boards(&["print-stretched"]),
    },
    Mistake {
        name: "focal length 2 % too long",
        make: |rig| camera(rig, |k| (0..2).for_each(|i| k[i][i] *= 1.02)),
        told: Told::Noted("scale-not-checked"),
    },
    Mistake {
        name: "markers entered 10 % too large",
        make: |rig| board(rig, |x, y| [1.1 * x, 1.1 * y]),
        told: Told::Noted("scale-not-checked"),
    },
    Mistake {
        name: "markers entered 2 % too large, the board on a stage of known step",
        make: |rig| board(rig, |x, y| [1.02 * x, 1.02 * y]),
        told: Told::Step("scale-contradicted"),
    },
    Mistake {
        name: "a code that repeats along the ray",
        make: |rig| {
            let file = rig.join("rig.toml");
            let mut toml: toml::Table = std::fs::read_to_string(&file).unwrap().parse().unwrap();
            toml["pattern_sets"][0]["images"] = toml::Value::from(vec![PATTERNS[0]]);
            std::fs::write(&file, toml.to_string()).unwrap();
        },
        told: Told::Calibrate(&["code-repeats"]),
    },
    Mistake {
        name: "patterns lag one position",
        make: |rig| {
            for image in PATTERNS {
                let files: Vec<PathBuf> = positions(rig).iter().map(|p| p.join(image)).collect();
                let bytes: Vec<Vec<u8>> = files.iter().map(|f| std::fs::read(f).unwrap()).collect();
                files[1..].iter().zip(&bytes).for_each(|(f, b)| std::fs::write(f, b).unwrap());
            }
        },
        told: Told::Calibrate(&["field-below-noise"]),
    },
    Mistake {
        name: "12 times the same position",
        make: |rig| {
            let all = positions(rig);
            for to in &all[1..] {
                for image in ["white.png", "black.png"].into_iter().chain(PATTERNS) {
                    std::fs::copy(all[0].join(image), to.join(image)).unwrap();
                }
            }
        },
        told: Told::Refused("depth-range"),
    },
    Mistake {
        name: "two patterns swapped at one position",
        make: |rig| swap(&positions(rig)[5]),
        told: Told::Calibrate(&["patterns-swapped"]),
    },
    Mistake {
        name: "white × 1.2 at one position",
        make: |rig| image(&positions(rig)[5], "white.png", |v| v.iter_mut().for_each(|v| *v *= 1.2)),
        told: Told::Calibrate(&["exposure-jump"]),
    },
    Mistake {
        name: "camera moved between white and patterns at one position",
        make: |rig| PATTERNS.iter().for_each(|name| shift(&positions(rig)[5], name, 2)),
        told: Told::Calibrate(&["position-moved", "position-disagrees"]),
    },
    Mistake {
        name: "automatic exposure of the patterns",
        make: |rig| {
            for (i, position) in positions(rig).iter().enumerate() {
                for (j, name) in PATTERNS.iter().enumerate() {
                    let factor = [0.85, 1.0, 1.12, 0.93][(i + j) % 4];
                    image(position, name, |v| v.iter_mut().for_each(|v| *v *= factor));
                }
            }
        },
        told: Told::Calibrate(&["exposure-jump"]),
    },
    Mistake {
        name: "sweep: JPEG",
        make: |rig| {
            for position in positions(rig) {
                ["white.png"].iter().chain(&PATTERNS).for_each(|name| compress(&position, name));
            }
        },
        told: Told::Boards(&["lossy-compression"]),
    },
    Mistake {
        name: "sweep and scene: sRGB",
        make: |rig| {
            for dir in positions(rig) {
                ["white.png", "black.png"].iter().chain(&PATTERNS).for_each(|name| {
                    image(&dir, name, |v| v.iter_mut().for_each(|v| *v = srgb(*v)));
                });
            }
        },
        told: Told::Calibrate(&["nonlinear-response"]),
    },
    Mistake {
        name: "scene: sRGB",
        make: |rig| scene_images(rig, |v| v.iter_mut().for_each(|v| *v = srgb(*v))),
        told: Told::Reconstruct(&["nonlinear-response", "residual-above-noise", "little-explained"]),
    },
    Mistake {
        name: "scene: mirrored",
        make: |rig| scene_images(rig, |v| v.chunks_exact_mut(WIDTH).for_each(<[f32]>::reverse)),
        told: Told::Reconstruct(&["little-explained", "residual-above-noise"]),
    },
    Mistake {
        name: "scene: patterns swapped",
        make: |rig| swap(&scene(rig)),
        told: Told::Reconstruct(&["residual-above-noise", "little-explained"]),
    },
    Mistake {
        name: "scene: a pattern without light",
        make: |rig| {
            std::fs::copy(scene(rig).join("black.png"), scene(rig).join(PATTERNS[1])).unwrap();
        },
        told: Told::Reconstruct(&["pattern-without-light"]),
    },
    Mistake {
        name: "scene: a pattern again in the place of the next",
        make: |rig| {
            std::fs::copy(scene(rig).join(PATTERNS[0]), scene(rig).join(PATTERNS[1])).unwrap();
        },
        told: Told::Reconstruct(&["pattern-disagrees"]),
    },
    Mistake {
        name: "scene: white × 1.2",
        make: |rig| image(&scene(rig), "white.png", |v| v.iter_mut().for_each(|v| *v *= 1.2)),
        told: Told::Reconstruct(&["exposure-jump", "residual-above-noise", "little-explained"]),
    },
    Mistake {
        name: "scene: ambient light that is not in black",
        make: |rig| {
            ["white.png"].iter().chain(&PATTERNS).for_each(|name| {
                image(&scene(rig), name, |v| v.iter_mut().for_each(|v| *v += 0.03));
            })
        },
        told: Told::Reconstruct(&["ambient-not-in-black"]),
    },
    Mistake {
        name: "scene: exposure × 3",
        make: |rig| scene_images(rig, |v| v.iter_mut().for_each(|v| *v *= 3.0)),
        told: Told::Reconstruct(&["clipped"]),
    },
    Mistake {
        name: "camera bumped by 1 px after the sweep",
        make: |rig| {
            ["white.png", "black.png"].iter().chain(&PATTERNS).for_each(|name| shift(&scene(rig), name, 1));
        },
        told: Told::NotChecked("drift-not-checked"),
    },
];

const WIDTH: usize = 160;

#[test]
fn every_mistake_is_seen() {
    let good = good_rig();
    let (next, failures) = (AtomicUsize::new(0), std::sync::Mutex::new(Vec::new()));
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                while let Some(mistake) = MISTAKES.get(next.fetch_add(1, Ordering::Relaxed)) {
                    if let Err(why) = mistake.check(good) {
                        failures.lock().unwrap().push(format!("{}: {why}", mistake.name));
                    }
                }
            });
        }
    });
    let failures = failures.into_inner().unwrap();
    assert!(failures.is_empty(), "{} of {} went wrong:\n{}", failures.len(), MISTAKES.len(), failures.join("\n"));
}

/// Nobody listens to who cries wolf.
#[test]
fn good_rigs_have_no_warnings() {
    let good = |seed: u64, args: &[&str]| {
        let (answer, said) = run(args, &[]).unwrap();
        assert_eq!(answer["verdict"], "good", "seed {seed}: {said}");
        assert_eq!(answer["warnings"], serde_json::json!([]));
    };
    // Not into the rig, which other tests copy.
    let result = tempfile::tempdir().unwrap();
    good(1, &["reconstruct", path(good_rig()), "vase", "-o", path(&result.path().join("vase"))]);
    for seed in [2, 3] {
        let dir = tempfile::tempdir().unwrap();
        let rig = rig(&dir.path().join("rig"), |spec| spec.seed = seed);
        good(seed, &["calibrate", path(&rig)]);
        good(seed, &["reconstruct", path(&rig), "vase"]);
    }
}

/// Where an object lies within one stripe of a coarse code, that image shows it all lit or all dark, as it should; and
/// of its mirror image, which has no depth, that is not the only reason that is given.
#[test]
fn an_object_within_a_stripe_is_no_mistake() {
    let dir = tempfile::tempdir().unwrap();
    let rig = gray_rig(dir.path(), "position_mm = [-38.0, 0.0, 700.0]", 14.0);
    run(&["calibrate", path(&rig)], &[]).unwrap();
    let (answer, said) = run(&["reconstruct", path(&rig), "vase"], &[]).unwrap();
    assert_eq!(answer["verdict"], "good", "{said}");
    for entry in std::fs::read_dir(scene(&rig)).unwrap().map(|e| e.unwrap().path()).filter(|p| p.is_file()) {
        let name = entry.file_name().unwrap().to_str().unwrap();
        image(&scene(&rig), name, |v| v.chunks_exact_mut(WIDTH).for_each(<[f32]>::reverse));
    }
    let refused = run(&["reconstruct", path(&rig), "vase"], &[]).unwrap_err();
    assert!(refused.contains("no pixel can be reconstructed") && refused.contains("mirrored"), "{refused}");
}

/// A trigger that was missed: white, or the pattern before it, in the place of one of a code's. With stripes along one
/// axis alone nothing else tells: the surface is folded where the others fit a second place.
#[test]
fn one_pattern_that_was_missed_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let good = gray_rig(dir.path(), "position_mm = [0.0, 0.0, 700.0]", 40.0);
    run(&["calibrate", path(&good)], &[]).unwrap();
    let scan = |rig: &Path| run(&["reconstruct", path(rig), "vase"], &["--accept"]);
    assert_eq!(scan(&good).unwrap().0["verdict"], "good");
    let missed = [
        ("white.png", "gray_x_05.png", "is bright wherever something is lit"),
        ("white.png", "gray_x_07.png", "is bright wherever something is lit"),
        ("gray_x_04.png", "gray_x_05.png", "shows what gray_x_04.png shows"),
        ("gray_x_06.png", "gray_x_07.png", "shows what gray_x_06.png shows"),
        ("white.png", "gray_x_08.png", "disagrees with the other patterns"),
    ];
    for (shown, pattern, what) in missed {
        let rig = dir.path().join(format!("{shown}-{pattern}"));
        copy(&good, &rig);
        std::fs::copy(scene(&rig).join(shown), scene(&rig).join(pattern)).unwrap();
        let said = scan(&rig).map_or_else(|said| said, |(answer, _)| answer["warnings"].to_string());
        assert!(said.contains(&format!("{pattern} {what}")), "{shown} as {pattern}: {said}");
    }
}

/// What the numbers mean is printed.
#[test]
fn a_wrong_scale_meets_the_eye() {
    let (_, text) = calibrated_good_rig();
    assert!(text.starts_with("verdict   good\n") && text.contains("corners fit to 0.0"), "{text}");
    assert!(text.contains("boards    from 62") && text.contains("mm to the right"), "{text}");
}

impl Mistake {
    /// Makes the mistake in a copy of the good rig, and returns what is wrong with what is said about it.
    fn check(&self, good: &Path) -> Result<(), String> {
        let dir = tempfile::tempdir().unwrap();
        let rig = dir.path().join("rig");
        copy(good, &rig);
        (self.make)(&rig);
        let codes = |answer: &Value, of: &str| -> Vec<String> {
            let all = answer[of].as_array().cloned().unwrap_or_default();
            all.iter().filter_map(|w| w["code"].as_str().map(str::to_owned)).collect()
        };
        let has = |answer: &Value, wanted: &[&str]| {
            let found = codes(answer, "warnings");
            let told = answer["verdict"] != "good" && found.iter().any(|f| wanted.contains(&f.as_str()));
            if told { Ok(()) } else { Err(format!("{} with {found:?} instead of {wanted:?}", answer["verdict"])) }
        };
        match self.told {
            Told::Calibrate(wanted) => has(&run(&["calibrate", path(&rig)], &["--accept"])?.0, wanted),
            Told::Boards(wanted) => {
                has(&run(&["calibrate", path(&rig), "--frame", "camera"], &["--accept"])?.0, wanted)
            }
            Told::Step(code) => {
                let with = |step: &str| run(&["calibrate", path(&rig), "--frame", "camera", "--step", step], &[]);
                has(&with("12.545")?.0, &[code])?;
                // 2 % longer steps agree with the print as it was entered.
                let (agreeing, _) = with("12.796")?;
                let said = [codes(&agreeing, "warnings"), codes(&agreeing, "notes")].concat();
                if said.iter().any(|c| c.starts_with("scale")) { Err(format!("{said:?}")) } else { Ok(()) }
            }
            Told::Noted(note) => {
                let (answer, _) = run(&["calibrate", path(&rig), "--frame", "camera"], &[])?;
                let noted = codes(&answer, "notes").iter().any(|n| n == note);
                if noted { Ok(()) } else { Err(format!("{} without the note {note}", answer["verdict"])) }
            }
            Told::Refused(code) => {
                let field = rig.join("fields/mixed3.safetensors");
                std::fs::remove_file(&field).unwrap();
                let out = nelu3d(&["calibrate", path(&rig), "--quiet"]);
                if out.status.code() != Some(1) || field.exists() || !stderr(&out).contains(&format!("[{code}]")) {
                    return Err(format!("it is not refused: {}", stderr(&out)));
                }
                let (answer, _) = run(&["calibrate", path(&rig)], &["--accept"])?;
                let bad = answer["verdict"] == "bad" && codes(&answer, "warnings").first().is_some_and(|c| c == code);
                if bad && field.exists() { Ok(()) } else { Err(format!("it is not accepted: {answer}")) }
            }
            Told::Reconstruct(wanted) => match run(&["reconstruct", path(&rig), "vase"], &["--accept"]) {
                Err(said) if said.contains("no pixel can be reconstructed") => Ok(()),
                answer => has(&answer?.0, wanted),
            },
            Told::NotChecked(note) => {
                let (answer, _) = run(&["reconstruct", path(&rig), "vase"], &[])?;
                let noted = answer["verdict"] == "good" && codes(&answer, "notes").iter().any(|n| n == note);
                if noted { Ok(()) } else { Err(format!("{} without the note {note}", answer["verdict"])) }
            }
        }
    }
}

/// Runs the program; returns its answer and what it said, or only that if it failed.
fn run(args: &[&str], more: &[&str]) -> Result<(Value, String), String> {
    let out = nelu3d(&[args, more, &["--json", "--quiet"]].concat());
    if !out.status.success() {
        return Err(stderr(&out));
    }
    Ok((serde_json::from_slice(&out.stdout).expect("one JSON value"), stderr(&out)))
}

// ---- Rigs, and what is done to them ----

/// A rig without mistakes, with its field.
fn good_rig() -> &'static Path {
    calibrated_good_rig().0
}

/// The rig without mistakes, and what its calibration reported; made once.
fn calibrated_good_rig() -> (&'static Path, &'static str) {
    static RIG: OnceLock<(tempfile::TempDir, PathBuf, String)> = OnceLock::new();
    let make = || {
        let dir = tempfile::tempdir().unwrap();
        let rig = rig(&dir.path().join("rig"), |_| {});
        let out = nelu3d(&["calibrate", path(&rig), "--quiet"]);
        assert!(out.status.success(), "{}", stderr(&out));
        (dir, rig, String::from_utf8(out.stdout).unwrap())
    };
    let (_, rig, text) = RIG.get_or_init(make);
    (rig, text)
}

fn rig(to: &Path, edit: impl Fn(&mut Spec)) -> PathBuf {
    let mut spec =
        Spec::read(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/program/mistakes/rig.toml"))).unwrap();
    edit(&mut spec);
    nelu3d_sim::simulate(&spec, to, &|_, _, _| {}).unwrap();
    to.to_path_buf()
}

/// A rig with Gray code along x and its inverse, and a sphere at `position` (a line of its scene) as the only object.
fn gray_rig(dir: &Path, position: &str, radius_mm: f64) -> PathBuf {
    let mut spec: toml::Table = SPEC.parse().unwrap();
    let gray = r#"name = "gray"
patterns = [{ family = "gray", axis = "x", inverse = true }]"#;
    spec["pattern_sets"] = toml::Value::Array(vec![gray.parse::<toml::Table>().unwrap().into()]);
    let object = format!(
        r#"{position}
shape = {{ kind = "sphere", radius_mm = {radius_mm} }}
albedo = {{ kind = "constant", rgb = [0.75, 0.75, 0.75] }}"#
    );
    spec["scenes"][0]["objects"] = toml::Value::Array(vec![object.parse::<toml::Table>().unwrap().into()]);
    let file = dir.join("spec.toml");
    std::fs::write(&file, spec.to_string()).unwrap();
    let rig = dir.join("rig");
    nelu3d_sim::simulate(&Spec::read(&file).unwrap(), &rig, &|_, _, _| {}).unwrap();
    rig
}

fn path(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn positions(rig: &Path) -> Vec<PathBuf> {
    Rig::open(rig).unwrap().positions().unwrap().into_iter().map(|p| p.dir).collect()
}

fn scene(rig: &Path) -> PathBuf {
    rig.join("scenes/vase")
}

/// Changes the linear values of an image.
fn image(dir: &Path, name: &str, edit: impl Fn(&mut Vec<f32>)) {
    let file = dir.join(name);
    let raw = nelu3d_scan::image::decode(&file, None).unwrap();
    let mut image = Image::new(raw.width, raw.height, 1);
    let nelu3d_scan::image::RawData::U16(codes) = raw.data else { panic!("{} has 16 bits", file.display()) };
    let linear = |code: &u16| ((f64::from(*code) - BLACK_LEVEL) / (SATURATION - BLACK_LEVEL)) as f32;
    image.data = codes.iter().map(linear).collect();
    edit(&mut image.data);
    image.data.iter_mut().for_each(|v| *v = v.min(1.0));
    write_png16(&file, &image, BLACK_LEVEL, SATURATION).unwrap();
}

fn scene_images(rig: &Path, edit: impl Fn(&mut Vec<f32>)) {
    ["white.png", "black.png"].iter().chain(&PATTERNS).for_each(|name| image(&scene(rig), name, &edit));
}

fn swap(dir: &Path) {
    let files = [dir.join(PATTERNS[0]), dir.join(PATTERNS[1])];
    let bytes = files.clone().map(|f| std::fs::read(f).unwrap());
    std::fs::write(&files[0], &bytes[1]).unwrap();
    std::fs::write(&files[1], &bytes[0]).unwrap();
}

/// Moves an image to the right.
fn shift(dir: &Path, name: &str, px: usize) {
    image(dir, name, |v| v.chunks_exact_mut(WIDTH).for_each(|row| row.copy_within(..WIDTH - px, px)));
}

/// The encoding of sRGB (IEC 61966-2-1).
fn srgb(v: f32) -> f32 {
    if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 }
}

/// What is left of 8 × 8 blocks when most of what varies within them is dropped.
fn compress(dir: &Path, name: &str) {
    image(dir, name, |v| {
        for block in 0..WIDTH / 8 * (v.len() / WIDTH / 8) {
            let (x0, y0) = (block % (WIDTH / 8) * 8, block / (WIDTH / 8) * 8);
            let at = |i: usize| (y0 + i / 8) * WIDTH + x0 + i % 8;
            let mean = (0..64).map(|i| v[at(i)]).sum::<f32>() / 64.0;
            (0..64).for_each(|i| v[at(i)] = mean + 0.5 * (v[at(i)] - mean));
        }
    });
}

fn edit_json(rig: &Path, edit: impl Fn(&mut Value)) {
    let file = rig.join("camera.json");
    let mut json: Value = serde_json::from_slice(&std::fs::read(&file).unwrap()).unwrap();
    edit(&mut json);
    std::fs::write(&file, json.to_string()).unwrap();
}

/// Changes the upper two rows of the camera's matrix.
fn camera(rig: &Path, edit: impl Fn(&mut [[f64; 3]])) {
    edit_json(rig, |json| {
        let mut k: [[f64; 3]; 3] = serde_json::from_value(json["K"].clone()).unwrap();
        edit(&mut k[..2]);
        json["K"] = serde_json::json!(k);
    });
}

/// Changes the corners of the board's markers.
fn board(rig: &Path, edit: impl Fn(f64, f64) -> [f64; 2]) {
    let file = rig.join("rig.toml");
    let mut toml: toml::Table = std::fs::read_to_string(&file).unwrap().parse().unwrap();
    let markers = toml["board"]["markers"].as_array_mut().unwrap();
    for corner in markers.iter_mut().flat_map(|m| m["corners_mm"].as_array_mut().unwrap()) {
        let [x, y] = [0, 1].map(|i| corner[i].as_float().unwrap());
        *corner = toml::Value::from(edit(x, y).map(toml::Value::from).to_vec());
    }
    std::fs::write(&file, toml.to_string()).unwrap();
}
