//! Charuco boards, with `calib-targets-charuco`.

use std::collections::BTreeMap;
use std::sync::Mutex;

use calib_targets_aruco::Dictionary as Codes;
use calib_targets_charuco::{CharucoBoardSpec, CharucoDetector, CharucoParams};

use super::gray::Decimated;
use super::pair::Pair;
use crate::board::layout::{Layout, Squares};
use crate::board::{BoardError, Dictionary};

/// A charuco detector that also reads OpenCV's legacy layout.
///
/// The library knows only boards whose top-left square is black. A legacy board with an even number of rows starts with
/// a white one: it is such a board without its first row. So the library is given one more row on top, and as many more
/// codes at the front of the dictionary as that row has markers; what it finds is moved up by that row.
pub(super) struct Finder {
    detector: CharucoDetector,
    squares: Squares,
    /// Rows the library was given on top of the board's: 0 or 1.
    extra_rows: usize,
}

impl Finder {
    pub(super) fn new(layout: &Layout) -> Result<Self, BoardError> {
        let squares = layout.squares.expect("a charuco board has squares");
        let dictionary = layout.dictionary.expect("a charuco board has a dictionary");
        let extra_rows = usize::from(!squares.black_first);
        let codes = if extra_rows == 0 {
            dictionary.codes()
        } else {
            with_front(&dictionary, squares.columns / 2, layout.markers.len())
        };
        let [a, b, ..] = layout.markers[0].corners_mm;
        let marker_mm = b[0] - a[0];
        let spec = CharucoBoardSpec::new(
            (squares.rows + extra_rows) as u32,
            squares.columns as u32,
            squares.side_mm as f32,
            (marker_mm / squares.side_mm) as f32,
            codes,
        );
        let params = CharucoParams::for_board(spec);
        let detector = CharucoDetector::new(params).map_err(|e| BoardError::invalid(e.to_string()))?;
        Ok(Self { detector, squares, extra_rows })
    }

    pub(super) fn find(&self, image: &Decimated) -> Result<Vec<Pair>, BoardError> {
        let found = self.detector.detect(&image.view()).map_err(|e| BoardError::not_found(e.to_string()))?;
        let side = self.squares.side_mm;
        let mut pairs = Vec::with_capacity(found.corners.len());
        for c in &found.corners {
            // Numbers run row by row over the inner corners. (Its `grid` counts from the first square, not from there.)
            let columns = self.squares.columns as u32 - 1;
            let (column, row) =
                (f64::from(c.id % columns) + 1.0, f64::from(c.id / columns) + 1.0 - self.extra_rows as f64);
            // The corners between the extra row and the board's first are the board's outline.
            if row >= 1.0 {
                let px = [f64::from(c.position.x), f64::from(c.position.y)];
                pairs.push(([column * side, row * side], image.full(px)));
            }
        }
        if pairs.len() < 4 {
            return Err(BoardError::not_found(format!("only {} of its corners were seen", pairs.len())));
        }
        Ok(pairs)
    }
}

/// Returns a dictionary with `n` more codes at the front, of which none is on the board (its first `used` are).
fn with_front(dictionary: &Dictionary, n: usize, used: usize) -> Codes {
    // The library wants codes that live forever: made once for each dictionary and count, so nothing piles up.
    static MADE: Mutex<BTreeMap<(&str, usize, usize), Codes>> = Mutex::new(BTreeMap::new());
    let mut made = MADE.lock().unwrap_or_else(|e| e.into_inner());
    let make = || {
        let codes = dictionary.codes().codes();
        let mask = u64::MAX >> (64 - dictionary.bits() * dictionary.bits());
        // Codes the board does not use, from the end; negatives of used ones where the dictionary is used up.
        let spare = codes[used..].iter().rev().copied().chain(codes.iter().map(|c| !c & mask));
        let all: Vec<u64> = spare.take(n).chain(codes.iter().copied()).collect();
        let correctable = dictionary.codes().max_correction_bits();
        Codes::from_static_codes(dictionary.name(), dictionary.bits(), correctable, all.leak())
            .expect("codes of a dictionary are valid")
    };
    *made.entry((dictionary.name(), n, used)).or_insert_with(make)
}
