//! What a board's description means, checked once: where its squares and markers are.

use super::{Board, BoardError, BoardKind, Dictionary, Marker};

/// The squares of a chessboard or charuco board; the outer corner of the top-left one is the origin.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Squares {
    pub(crate) columns: usize,
    pub(crate) rows: usize,
    pub(crate) side_mm: f64,
    /// Whether the top-left square is black.
    pub(crate) black_first: bool,
}

impl Squares {
    pub(crate) fn is_black(&self, column: usize, row: usize) -> bool {
        (column + row).is_multiple_of(2) == self.black_first
    }
}

/// Squares, markers, or both.
#[derive(Clone, Debug)]
pub(crate) struct Layout {
    pub(crate) squares: Option<Squares>,
    pub(crate) markers: Vec<Marker>,
    /// Present when there are markers.
    pub(crate) dictionary: Option<Dictionary>,
    /// Real lengths along x and y over those above, which are as described.
    pub(crate) scale: [f64; 2],
}

/// Most squares along a side, and most markers: far beyond any print, small enough to be laid out at once.
const MAX_COUNT: usize = 1000;

/// Smallest size of a print over the one described: printers are off by percents, a page fitted to paper by tenths.
const MIN_SCALE: f64 = 0.5;

impl Layout {
    pub(crate) fn new(board: &Board) -> Result<Self, BoardError> {
        let scale = board.scale;
        if scale.iter().any(|s| !(MIN_SCALE..=1.0 / MIN_SCALE).contains(s)) {
            return Err(BoardError::invalid(format!(
                "its print is {} by {} times as large as described ({MIN_SCALE} to {} is possible)",
                scale[0],
                scale[1],
                1.0 / MIN_SCALE
            )));
        }
        match &board.kind {
            BoardKind::Charuco { columns, rows, square_mm, marker_mm, dictionary, legacy } => {
                // OpenCV's `CharucoBoard`: since 4.6 the top-left square is always black. Before, an even number of
                // rows made it white (`setLegacyPattern`); with an odd number both are the same print.
                let black_first = !(*legacy && rows.is_multiple_of(2));
                let squares = squares(*columns, *rows, *square_mm, black_first)?;
                if !(*marker_mm > 0.0 && marker_mm <= square_mm) {
                    return Err(BoardError::invalid(format!(
                        "its markers of {marker_mm} mm do not fit its squares of {square_mm} mm"
                    )));
                }
                let dictionary = Dictionary::by_name(dictionary)?;
                let markers = charuco_markers(&squares, *marker_mm);
                if markers.len() > dictionary.len() {
                    return Err(BoardError::invalid(format!(
                        "it has {} white squares, but {} has only {} markers",
                        markers.len(),
                        dictionary.name(),
                        dictionary.len()
                    )));
                }
                Ok(Self { squares: Some(squares), markers, dictionary: Some(dictionary), scale })
            }
            BoardKind::Chessboard { columns, rows, square_mm } => {
                let squares = squares(*columns, *rows, *square_mm, true)?;
                if *columns < 3 || *rows < 3 {
                    return Err(BoardError::invalid("a chessboard needs at least 3 x 3 squares"));
                }
                Ok(Self { squares: Some(squares), markers: Vec::new(), dictionary: None, scale })
            }
            BoardKind::Markers { dictionary, markers } => {
                let dictionary = Dictionary::by_name(dictionary)?;
                check_markers(markers, &dictionary)?;
                Ok(Self { squares: None, markers: markers.clone(), dictionary: Some(dictionary), scale })
            }
        }
    }
}

fn squares(columns: usize, rows: usize, side_mm: f64, black_first: bool) -> Result<Squares, BoardError> {
    if !(2..=MAX_COUNT).contains(&columns) || !(2..=MAX_COUNT).contains(&rows) {
        return Err(BoardError::invalid(format!("{columns} x {rows} squares (2 to {MAX_COUNT} a side are possible)")));
    }
    if !(side_mm > 0.0 && side_mm.is_finite()) {
        return Err(BoardError::invalid(format!("squares of {side_mm} mm")));
    }
    Ok(Squares { columns, rows, side_mm, black_first })
}

/// Returns a marker in the middle of each white square, numbered row by row.
fn charuco_markers(squares: &Squares, marker_mm: f64) -> Vec<Marker> {
    let margin = 0.5 * (squares.side_mm - marker_mm);
    let mut markers = Vec::new();
    for row in 0..squares.rows {
        for column in 0..squares.columns {
            if squares.is_black(column, row) {
                continue;
            }
            let (x, y) = (column as f64 * squares.side_mm + margin, row as f64 * squares.side_mm + margin);
            let corners_mm = [[x, y], [x + marker_mm, y], [x + marker_mm, y + marker_mm], [x, y + marker_mm]];
            markers.push(Marker { id: markers.len() as u32, corners_mm });
        }
    }
    markers
}

fn check_markers(markers: &[Marker], dictionary: &Dictionary) -> Result<(), BoardError> {
    if markers.is_empty() || markers.len() > MAX_COUNT {
        return Err(BoardError::invalid(format!("it has {} markers (1 to {MAX_COUNT} are possible)", markers.len())));
    }
    let mut seen = std::collections::BTreeSet::new();
    for m in markers {
        if m.id as usize >= dictionary.len() {
            return Err(BoardError::invalid(format!(
                "marker {} is not in {}, which ends at {}",
                m.id,
                dictionary.name(),
                dictionary.len() - 1
            )));
        }
        if !seen.insert(m.id) {
            return Err(BoardError::invalid(format!("marker {} is there twice", m.id)));
        }
        let c = &m.corners_mm;
        let convex = (0..4).all(|i| {
            let (a, b, d) = (c[i], c[(i + 1) % 4], c[(i + 2) % 4]);
            (b[0] - a[0]) * (d[1] - b[1]) - (b[1] - a[1]) * (d[0] - b[0]) > 1e-9
        });
        if !convex || c.iter().flatten().any(|v| !v.is_finite()) {
            return Err(BoardError::invalid(format!(
                "the corners of marker {} are not a convex quadrilateral, clockwise as one looks at the print (x to \
                 the right, y down)",
                m.id
            )));
        }
    }
    Ok(())
}
