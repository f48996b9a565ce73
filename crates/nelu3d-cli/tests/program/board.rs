//! `nelu3d board`: what is printed is found, at its size, and what is described is read back.

use std::path::Path;
use std::process::Command;

use super::common::{nelu3d, stderr};
use nelu3d_scan::board::{BoardKind, Detector};
use nelu3d_scan::image::{Channels, decode};
use nelu3d_scan::rig::read_board;

const BOARDS: [(&str, usize); 4] = [
    ("charuco --squares 6x7 --square 25", 30),
    ("charuco --squares 6x8 --square 22 --legacy --paper letter", 35),
    ("chessboard --squares 7x6 --square 24 --paper 220x200", 30),
    ("markers --size 160x120 --marker 25 --dictionary DICT_5X5_100", 56),
];

/// Runs `nelu3d board` with an output; returns the described board.
fn print(arguments: &str, output: &Path) -> nelu3d_scan::board::Board {
    let mut all = vec!["board"];
    all.extend(arguments.split(' '));
    all.extend(["-o", output.to_str().unwrap()]);
    let out = nelu3d(&all);
    assert!(out.status.success(), "{}", stderr(&out));
    let lines = output.with_extension("toml");
    std::fs::write(&lines, out.stdout).unwrap();
    read_board(&lines).unwrap()
}

/// The pages as `pdftoppm -r 600` renders them: every side to 0.05 mm, every corner found by our detector.
#[test]
fn rendered_pages_are_true_to_scale_and_found() {
    if Command::new("pdftoppm").arg("-v").output().is_err() {
        eprintln!("SKIPPED: pdftoppm is not installed (apt-get install poppler-utils): PDF pages are not rendered");
        return;
    }
    let dir = tempfile::tempdir().unwrap();
    for (i, (arguments, expected)) in BOARDS.iter().enumerate() {
        let pdf = dir.path().join(format!("{i}.pdf"));
        let board = print(arguments, &pdf);
        let page = dir.path().join(format!("{i}"));
        let mut render = Command::new("pdftoppm");
        let status = render.args(["-r", "600", "-gray", "-png", "-singlefile"]).arg(&pdf).arg(&page).status();
        let status = status.unwrap();
        assert!(status.success());
        let png = page.with_extension("png");
        let raw = decode(&png, None).unwrap();
        // Some versions write gray pages with three channels.
        let channels = if raw.channels == 1 { Channels::Mono } else { Channels::Rgb };
        let image = raw.linearize(&png, channels, 0.0, 255.0).unwrap();
        // Short of full scale, at which the detector takes it for clipped.
        let gray: Vec<f32> = image.to_gray().iter().map(|v| 0.98 * v).collect();
        let corners = Detector::new(&board).unwrap().detect(&gray, image.width, image.height).unwrap();
        assert_eq!(corners.len(), *expected, "{arguments}");
        let mm = 25.4 / 600.0;
        let first = &corners[0];
        let mut worst: f64 = 0.0;
        for a in &corners {
            // Places to one corner, and sides: the nearest corners of each.
            let near =
                corners.iter().filter(|b| (b.board_mm[0] - a.board_mm[0]).hypot(b.board_mm[1] - a.board_mm[1]) < 30.0);
            for b in near.chain([first]) {
                let seen = [0, 1].map(|k| mm * (a.px[k] - b.px[k]));
                for k in 0..2 {
                    worst = worst.max((seen[k] - (a.board_mm[k] - b.board_mm[k])).abs());
                }
            }
        }
        eprintln!("{arguments}: {} corners, worst {worst:.4} mm", corners.len());
        assert!(worst < 0.05, "{arguments}: {worst} mm");
    }
}

#[test]
fn what_was_measured_goes_into_the_lines() {
    let dir = tempfile::tempdir().unwrap();
    let out = nelu3d(&["board", "chessboard", "--measured", "99.6x100.4"]);
    assert!(out.status.success(), "{}", stderr(&out));
    let lines = dir.path().join("board.toml");
    std::fs::write(&lines, &out.stdout).unwrap();
    let board = read_board(&lines).unwrap();
    assert_eq!(board.scale, [0.996, 1.004]);
    assert!((board.extent_mm[2] - 8.0 * 20.0 * 0.996).abs() < 1e-9, "{:?}", board.extent_mm);
    assert!(matches!(board.kind, BoardKind::Chessboard { square_mm: 20.0, .. }));
    // Nothing was printed: who measures has printed.
    assert!(!Path::new("board.pdf").exists());
}

#[test]
fn what_cannot_be_printed_is_said_in_one_sentence() {
    let dir = tempfile::tempdir().unwrap();
    let file = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    std::fs::write(file("there.pdf"), "mine").unwrap();
    for (arguments, output, complaint) in [
        ("charuco", "there.pdf", "give --force to replace it"),
        ("charuco", "a.doc", "name it .pdf, .svg or .png"),
        ("charuco --paper 90x90", "a.pdf", "take larger paper"),
        ("charuco --squares 30x30 --dictionary DICT_4X4_50", "a.pdf", "has only 50 markers"),
        ("charuco --marker 21", "a.pdf", "do not fit its squares"),
        ("charuco --dictionary DICT_9X9", "a.pdf", "there is no ArUco dictionary"),
        ("chessboard --measured 50x100", "a.pdf", "give what each ruler measures"),
        ("markers --size 30x30 --marker 20", "a.pdf", "holds no two markers"),
        ("rig /nowhere", "a.pdf", "/nowhere: cannot be read"),
    ] {
        let output = file(output);
        let mut all = vec!["board"];
        all.extend(arguments.split(' '));
        all.extend(["-o", &output]);
        let out = nelu3d(&all);
        let said = stderr(&out);
        assert_eq!(out.status.code(), Some(1), "{arguments}: {said}");
        assert!(said.contains(complaint) && said.trim_end().lines().count() == 1, "{arguments}: {said}");
    }
    assert_eq!(std::fs::read_to_string(file("there.pdf")).unwrap(), "mine");
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
}
