use std::fs;

use nelu3d_scan::output::{OutputDir, remove_abandoned};

use crate::output::names;

#[test]
fn folders_of_killed_runs_go_and_those_at_work_stay() {
    let dir = tempfile::tempdir().unwrap();
    for left in [".005.partial-1", ".b.c.partial-77-2", ".hidden", ".partial-3", "mine"] {
        fs::create_dir(dir.path().join(left)).unwrap();
    }
    let at_work = OutputDir::create(&dir.path().join("006"), "white.png").unwrap();
    let building = at_work.path().file_name().unwrap().to_string_lossy().into_owned();
    remove_abandoned(dir.path());
    assert_eq!(names(dir.path()), [building.as_str(), ".hidden", ".partial-3", "mine"]);
    remove_abandoned(&dir.path().join("missing"));
}

#[test]
fn a_folder_appears_whole_or_not_at_all() {
    let dir = tempfile::tempdir().unwrap();
    let target = dir.path().join("results/pawn");
    let out = OutputDir::create(&target, "result.json").unwrap();
    fs::write(out.path().join("result.json"), "1").unwrap();
    assert!(!target.exists());
    drop(out);
    assert!(names(dir.path()).is_empty());

    for content in ["2", "3"] {
        let out = OutputDir::create(&target, "result.json").unwrap();
        fs::write(out.path().join("result.json"), content).unwrap();
        fs::write(out.path().join(content), "").unwrap();
        out.commit().unwrap();
        assert_eq!(fs::read_to_string(target.join("result.json")).unwrap(), content);
        assert_eq!(names(&target), [content, "result.json"]);
        assert_eq!(names(&dir.path().join("results")), ["pawn"]);
    }
}

#[test]
fn somebody_elses_folder_is_not_replaced() {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("thesis.tex"), "years").unwrap();
    let e = OutputDir::create(dir.path(), "result.json").unwrap_err();
    assert!(e.to_string().contains("choose another folder"), "{e}");
    let e = OutputDir::create(&dir.path().join("thesis.tex"), "result.json").unwrap_err();
    assert!(e.to_string().contains("a file of this name exists"), "{e}");
    assert_eq!(names(dir.path()), ["thesis.tex"]);
}

/// What killed runs left of this folder goes; what a run has in hand stays, and so does what belongs to others.
#[cfg(unix)]
#[test]
fn what_killed_runs_left_is_removed() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let live = OutputDir::create(&at("pawn"), "result.json").unwrap();
    let others = [".pawn.partial-x", ".pawn.partial-1-2-3", ".pawn.b.partial-7", ".queen.partial-7", "pawn.partial-7"];
    for name in [".pawn.partial-7", ".pawn.partial-7-1", ".pawn.old-8"].iter().chain(&others) {
        fs::create_dir(at(name)).unwrap();
        fs::write(at(name).join("depth.npy"), "half").unwrap();
    }
    fs::write(at(".pawn.partial-9"), "a file").unwrap();
    drop(OutputDir::create(&at("pawn"), "result.json").unwrap());
    let mut expected: Vec<String> = others.map(String::from).into();
    expected.push(".pawn.partial-9".into());
    expected.push(live.path().file_name().unwrap().to_string_lossy().into_owned());
    expected.sort();
    assert_eq!(names(dir.path()), expected);
    fs::write(live.path().join("result.json"), "1").unwrap();
    live.commit().unwrap();
    assert_eq!(names(&at("pawn")), ["result.json"]);
}

/// A run that was killed between two renames left the earlier result aside: it comes back.
#[cfg(unix)]
#[test]
fn an_earlier_result_that_was_moved_aside_comes_back() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    fs::create_dir_all(at(".pawn.old-7/previous")).unwrap();
    fs::write(at(".pawn.old-7/previous/result.json"), "1").unwrap();
    fs::create_dir(at(".pawn.partial-7")).unwrap();
    drop(OutputDir::create(&at("pawn"), "result.json").unwrap());
    assert_eq!(names(dir.path()), ["pawn"]);
    assert_eq!(fs::read_to_string(at("pawn/result.json")).unwrap(), "1");
}

/// Both ways of replacing an earlier result leave the new one and nothing else.
#[test]
fn an_earlier_result_is_replaced_either_way() {
    let dir = tempfile::tempdir().unwrap();
    let target = dir.path().join("pawn");
    for content in ["1", "2", "3"] {
        let mut out = OutputDir::create(&target, "result.json").unwrap();
        fs::write(out.path().join("result.json"), content).unwrap();
        match content {
            "3" => {
                out.replace_in_two_steps().unwrap();
                drop(out);
            }
            _ => out.commit().unwrap(),
        }
        assert_eq!(fs::read_to_string(target.join("result.json")).unwrap(), content);
        assert_eq!(names(dir.path()), ["pawn"]);
    }
}

/// The disk of tests can exchange folders: a run that is killed at any moment leaves a result.
#[cfg(target_os = "linux")]
#[test]
fn folders_are_exchanged_in_one_step() {
    let dir = tempfile::tempdir().unwrap();
    let (a, b) = (dir.path().join("a"), dir.path().join("b"));
    for path in [&a, &b] {
        fs::create_dir(path).unwrap();
        fs::write(path.join(path.file_name().unwrap()), "").unwrap();
    }
    if nelu3d_scan::output::exchange_folders(&a, &b).unwrap() {
        assert_eq!((names(&a), names(&b)), (vec!["b".to_owned()], vec!["a".to_owned()]));
    } else {
        eprintln!("SKIPPED: folders_are_exchanged_in_one_step: this disk cannot");
    }
}

/// What somebody put there while the result was computed is not replaced.
#[test]
fn what_appears_meanwhile_is_not_replaced() {
    let dir = tempfile::tempdir().unwrap();
    let target = dir.path().join("pawn");
    let out = OutputDir::create(&target, "result.json").unwrap();
    fs::create_dir(&target).unwrap();
    fs::write(target.join("thesis.tex"), "years").unwrap();
    let e = out.commit().unwrap_err().to_string();
    assert!(e.contains("pawn: cannot be written") && e.contains("not an earlier result"), "{e}");
    assert_eq!(names(dir.path()), ["pawn"]);
    assert_eq!(names(&target), ["thesis.tex"]);
}
