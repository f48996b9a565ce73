//! Checking the table `[board]`.

use std::collections::HashSet;

use super::problems::Problems;
use super::schema::{BoardToml, bounding_box_mm};
use crate::board::{Artwork, Board, BoardError, BoardKind, Dictionary, Marker};

/// Returns the board, if its keys make one.
pub(super) fn board(b: BoardToml, problems: &mut Problems) -> Option<Board> {
    let before = problems.found.len();
    let allowed = allowed_keys(&b.kind, problems)?;
    check_keys(&b, allowed, problems);
    if problems.found.len() > before {
        return None;
    }
    let given_extent = b.extent_mm;
    let scale = b.scale.unwrap_or([1.0, 1.0]);
    let good = scale.iter().all(|s| (0.5..=2.0).contains(s));
    let remedy = "give what was measured along x and y over what it should have been, as [0.996, 0.998]";
    if !problems.expect(good, "board.scale", format!("is {scale:?}"), remedy) {
        return None;
    }
    let kind = board_kind(b, allowed, problems);
    if problems.found.len() > before {
        return None;
    }
    let extent_mm = given_extent.unwrap_or_else(|| bounding_box_mm(&kind, scale));
    let [x0, y0, x1, y1] = extent_mm;
    let good = extent_mm.iter().all(|v| v.is_finite()) && x0 < x1 && y0 < y1;
    let problem = format!("is {extent_mm:?}");
    if !problems.expect(good, "board.extent_mm", problem, "it must be [x_min, y_min, x_max, y_max]") {
        return None;
    }
    let print = bounding_box_mm(&kind, scale);
    let problem = format!("is {extent_mm:?}, far beside the print, which is within {print:?}");
    let remedy = "give the board's outline in its own frame, in millimeters, or leave the key out";
    if !problems.expect(is_near(extent_mm, print), "board.extent_mm", problem, remedy) {
        return None;
    }
    let board = Board { kind, extent_mm, scale };
    match Artwork::new(&board) {
        Ok(_) => Some(board),
        Err(e) => {
            let problem = match e {
                BoardError::Invalid { reason } => format!("cannot be printed as described: {reason}"),
                other => other.to_string(),
            };
            problems
                .expect(false, "board", problem, "measure the board again, and correct its numbers")
                .then_some(board)
        }
    }
}

/// Returns whether an outline is that of a board with this print: not further beside it than the print is large. A
/// plate may well have its markers along one edge.
fn is_near([x0, y0, x1, y1]: [f64; 4], print: [f64; 4]) -> bool {
    let (w, h) = (print[2] - print[0], print[3] - print[1]);
    x0 < print[2] + w && x1 > print[0] - w && y0 < print[3] + h && y1 > print[1] - h
}

/// Returns the keys that a kind of board has, beside `kind`, `scale` and `extent_mm`; `None` for an unknown kind.
fn allowed_keys(kind: &str, problems: &mut Problems) -> Option<&'static [&'static str]> {
    Some(match kind {
        "charuco" => &["columns", "rows", "square_mm", "marker_mm", "dictionary", "legacy"],
        "chessboard" => &["columns", "rows", "square_mm"],
        "markers" => &["dictionary", "markers"],
        other => {
            let problem = format!("is \"{other}\"");
            problems.expect(false, "board.kind", problem, "it must be one of: charuco, chessboard, markers");
            return None;
        }
    })
}

/// Checks that the keys of this kind are there, and none that belongs to another kind: that would be a mistake.
fn check_keys(b: &BoardToml, allowed: &[&str], problems: &mut Problems) {
    for (key, given) in [
        ("columns", b.columns.is_some()),
        ("rows", b.rows.is_some()),
        ("square_mm", b.square_mm.is_some()),
        ("marker_mm", b.marker_mm.is_some()),
        ("dictionary", b.dictionary.is_some()),
        ("legacy", b.legacy.is_some()),
        ("markers", b.markers.is_some()),
    ] {
        let key_path = format!("board.{key}");
        if allowed.contains(&key) {
            problems.expect(given || key == "legacy", &key_path, "is missing", &format!("a {} board needs it", b.kind));
        } else {
            problems.expect(!given, &key_path, "does not belong here", &format!("a {} board has no such key", b.kind));
        }
    }
}

/// Returns what is printed on the board, and checks its numbers.
fn board_kind(b: BoardToml, allowed: &[&str], problems: &mut Problems) -> BoardKind {
    let (columns, rows) = (b.columns.unwrap_or_default(), b.rows.unwrap_or_default());
    let (square_mm, marker_mm) = (b.square_mm.unwrap_or_default(), b.marker_mm.unwrap_or_default());
    let dictionary = b.dictionary.unwrap_or_default();
    if allowed.contains(&"dictionary") {
        let known = Dictionary::by_name(&dictionary).is_ok();
        let remedy = format!("it must be one of: {}", Dictionary::names().join(", "));
        problems.expect(known, "board.dictionary", format!("is \"{dictionary}\""), &remedy);
    }
    if allowed.contains(&"columns") {
        // A chessboard's corners lie between squares, and a plane needs more than one row of them.
        for (key, n) in [("board.columns", columns), ("board.rows", rows)] {
            problems.expect((3..=1000).contains(&n), key, format!("is {n}"), "count the squares: there are 3 or more");
        }
        let good = square_mm.is_finite() && square_mm > 0.0;
        problems.expect(
            good,
            "board.square_mm",
            format!("is {square_mm:?}"),
            "give the side of a square in millimeters",
        );
    }
    match b.kind.as_str() {
        "charuco" => {
            let good = marker_mm > 0.0 && marker_mm < square_mm;
            let problem = format!("is {marker_mm:?}, with board.square_mm = {square_mm:?}");
            let remedy = "a marker is smaller than its square and larger than nothing";
            problems.expect(good, "board.marker_mm", problem, remedy);
            let legacy = b.legacy.unwrap_or(false);
            BoardKind::Charuco { columns, rows, square_mm, marker_mm, dictionary, legacy }
        }
        "chessboard" => BoardKind::Chessboard { columns, rows, square_mm },
        _ => {
            let markers = b.markers.unwrap_or_default();
            check_markers(&markers, problems);
            BoardKind::Markers { dictionary, markers }
        }
    }
}

fn check_markers(markers: &[Marker], problems: &mut Problems) {
    problems.expect(!markers.is_empty(), "board.markers", "is empty", "list the markers of the board");
    let mut ids = HashSet::new();
    for m in markers {
        let key = format!("board.markers, id {}", m.id);
        problems.expect(ids.insert(m.id), &key, "is listed twice", "every marker of a board has its own id");
        let c = &m.corners_mm;
        // Twice the area, by the shoelace formula.
        let area: f64 = (0..4).map(|i| c[i][0] * c[(i + 1) % 4][1] - c[(i + 1) % 4][0] * c[i][1]).sum();
        // NaN fails this comparison too.
        let good = area.abs() > 1e-6;
        problems.expect(good, &key, "has corners_mm without an area", "give the corners in order, in millimeters");
    }
}
