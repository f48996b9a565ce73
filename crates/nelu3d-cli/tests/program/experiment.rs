//! `nelu3d experiment` from a file to tables, pictures and a page, and that nothing is computed twice.

use std::path::Path;
use std::process::{Command, Output};

fn nelu3d(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_nelu3d")).args(args).output().expect("the program runs")
}

fn code(output: &Output) -> i32 {
    output.status.code().expect("it was not killed")
}

fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Two methods on two scenes of a small virtual rig, with two lengths of the sweep.
const EXPERIMENT: &str = r#"
title = "A small experiment"
source = "Nowhere, Table 0"
note = "First paragraph."
seeds = [3]
against = "LookUp3D"

[rigs.small]
preset = "demo"

[rigs.small.set]
supersampling = 2
scenes = [{ name = "ball", objects = [{ position_mm = [0.0, 0.0, 700.0], shape = { kind = "sphere", radius_mm = 50.0 } }] }]

# Fewer pixels than the preset has.
[rigs.small.set.camera]
width = 240
height = 180
fx = 675.0
fy = 674.3
cx = 120.8
cy = 89.1

[rigs.small.set.sweep]
positions = "{n}"

[[cases]]
label = "ball"
rig = "small"
scene = "ball"

[vary]
name = "n"
label = "board positions"
values = [8, 16]

[[methods]]
label = "fast"
run = "reconstruct --seed {seed} --effort quick"

[[methods]]
label = "LookUp3D"
run = "decode --method lookup3d"

[[methods]]
label = "Gray"
run = "decode --method gray"

[[columns]]
label = "MAE, mm"
value = "result.metrics.whole.depth_mm.mae"
main = true

[[claims]]
column = "MAE, mm"
method = "fast"
at_most = "LookUp3D"

[[columns]]
label = "to LookUp3D, mm"
value = "against.depth_mm.mae"

[[columns]]
label = "to the model, mm"
value = "cad.metrics.all.distance_mm.mae"
"#;

fn run(dir: &Path, more: &[&str]) -> serde_json::Value {
    let (file, out) = (dir.join("small.toml"), dir.join("out"));
    let mut arguments = vec!["experiment", file.to_str().unwrap(), "-o", out.to_str().unwrap(), "--json", "--quiet"];
    arguments.extend(more);
    let output = nelu3d(&arguments);
    assert_eq!(code(&output), 0, "{}", stderr(&output));
    serde_json::from_str(&stdout(&output)).unwrap()
}

#[test]
fn a_file_becomes_tables_and_a_page_and_nothing_is_computed_twice() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("small.toml"), EXPERIMENT).unwrap();
    let answer = run(dir.path(), &[]);
    // Two rigs, two fields, six results of which two fail, four comparisons with the model.
    assert_eq!((answer["ran"].as_u64(), answer["experiment"].as_str()), (Some(14), Some("small")));
    let entries = answer["numbers"]["entries"].as_array().unwrap();
    assert_eq!(entries.len(), 6);
    let number = |entry: usize, column: usize| entries[entry]["numbers"][column]["mean"].as_f64();
    for entry in [0, 1, 3, 4] {
        let (mae, cad) = (number(entry, 0).unwrap(), number(entry, 2).unwrap());
        // Distances to a surface are no longer than errors along a ray to it, but for the few pixels beside it.
        // LookUp3D rejects no pixel by default, so that a few percent are far off.
        assert!(mae > 0.0 && mae < 12.0 && cad > 0.0 && cad < mae + 0.5, "{entry}: {mae} {cad}");
    }
    assert!(number(0, 0) < number(1, 0), "fast is better than LookUp3D");
    assert_eq!(number(1, 1), Some(0.0));
    assert!(entries[2]["problem"].as_str().unwrap().contains("cannot be decoded with --method gray"));

    let folder = dir.path().join("out/small");
    let read = |name: &str| std::fs::read_to_string(folder.join(name)).unwrap();
    let table = read("table.md");
    assert!(table.contains("## A small experiment") && table.contains("| ball, 16 | **"), "{table}");
    assert!(table.contains("Without a result"), "{table}");
    assert!(table.contains("- holds: MAE, mm: fast has at most that of LookUp3D"), "{table}");
    assert_eq!(read("table.csv").lines().count(), 7);
    assert!(read("plot-1.svg").starts_with("<svg"));
    let page = read("index.html");
    assert!(
        page.contains("data:image/png;base64,") && page.contains("nelu3d reconstruct ") && !page.contains("src=\"http")
    );

    // Only what failed is tried again.
    let again = run(dir.path(), &[]);
    assert_eq!((again["ran"].as_u64(), &again["numbers"]), (Some(2), &answer["numbers"]));
    // A result that was lost is made again, and nothing else.
    std::fs::remove_dir_all(folder.join("results/ball-8-fast-3")).unwrap();
    assert_eq!(run(dir.path(), &[])["ran"].as_u64(), Some(3));

    // What is claimed wrongly is an error, and the tables are there.
    let file = dir.path().join("small.toml");
    std::fs::write(&file, EXPERIMENT.replace("at_most", "at_least")).unwrap();
    let out = dir.path().join("out");
    let wrong = nelu3d(&["experiment", file.to_str().unwrap(), "-o", out.to_str().unwrap(), "--quiet"]);
    assert_eq!(code(&wrong), 1);
    assert!(stderr(&wrong).contains("small: 1 of 1 claims do not hold"), "{}", stderr(&wrong));
    assert!(read("table.md").contains("- DOES NOT HOLD: MAE, mm: fast has at least that of LookUp3D (ball, 8: "));
}

/// Gray code on boards placed by hand, decoded with the projector that the boards calibrate.
const BY_HAND: &str = r#"
title = "Boards by hand"

[rigs.hand]
preset = "demo"

[rigs.hand.set]
supersampling = 2
scenes = [{ name = "ball", objects = [{ position_mm = [0.0, 0.0, 700.0], shape = { kind = "sphere", radius_mm = 50.0 } }] }]
pattern_sets = [{ name = "gray", patterns = [{ family = "gray", axis = "x" }, { family = "gray", axis = "y" }] }]

[rigs.hand.set.sweep]
kind = "handheld"
positions = 5
first_mm = 620.0
last_mm = 780.0
position_sigma_mm = 8.0
tilt_sigma = 0.2
depths = "scattered"

[[cases]]
label = "ball"
rig = "hand"
scene = "ball"

[[methods]]
label = "triangulated"
run = "decode --method gray"
projector = "--set gray"

[[columns]]
label = "MAE, mm"
value = "result.metrics.body.depth_mm.mae"
"#;

#[test]
fn a_decoder_can_have_the_projector_that_the_sweep_calibrates() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("small.toml"), BY_HAND).unwrap();
    let answer = run(dir.path(), &[]);
    // A rig, its projector, a result.
    assert_eq!(answer["ran"].as_u64(), Some(3));
    let mae = answer["numbers"]["entries"][0]["numbers"][0]["mean"].as_f64().unwrap();
    assert!(mae > 0.0 && mae < 1.0, "{mae}");
}

#[test]
fn what_is_wrong_with_an_experiment_is_said() {
    let unknown = nelu3d(&["experiment", "table99"]);
    assert_eq!(code(&unknown), 1);
    assert!(stderr(&unknown).contains("neither an experiment (table1, "), "{}", stderr(&unknown));
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("bad.toml");
    std::fs::write(&file, EXPERIMENT.replace("--effort quick", "--effort hasty")).unwrap();
    let out = dir.path().join("out");
    let wrong = nelu3d(&["experiment", file.to_str().unwrap(), "-o", out.to_str().unwrap(), "--quiet"]);
    assert_eq!(code(&wrong), 1);
    let said = stderr(&wrong);
    assert!(said.contains("hasty") && said.contains("method `fast`") && said.contains("correct its `run`"), "{said}");
    assert!(!out.exists(), "it is said before anything is made");
    let list = nelu3d(&["experiment"]);
    assert!(stdout(&list).contains("table1") && stdout(&list).contains("limits"), "{}", stdout(&list));
}
