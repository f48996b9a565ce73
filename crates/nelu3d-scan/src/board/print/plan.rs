//! How a board and what stands beside it are laid over sheets of paper.

use super::decoration::{Decoration, RULER_MM};
use super::paper::Paper;
use super::shapes::shapes;
use super::sheet::{Label, Shape, Sheet};
use crate::board::layout::Layout;
use crate::board::{Board, BoardError, BoardKind};

/// How a board is printed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrintOptions {
    /// The paper, in either direction: the one that takes fewer sheets.
    pub paper: Paper,
    /// What the printer leaves white along every edge of a sheet, mm; marks for joining stand in it.
    pub margin_mm: f64,
    /// Width of the strips that are printed on both of two neighboring sheets, mm.
    pub overlap_mm: f64,
}

impl Default for PrintOptions {
    fn default() -> Self {
        Self { paper: Paper::A4, margin_mm: 10.0, overlap_mm: 10.0 }
    }
}

/// A board on sheets of paper, at the size its description gives (what a printer made of it, `Board::scale`, is not
/// undone).
#[derive(Clone, Debug, PartialEq)]
pub struct BoardPrint {
    /// The sheets, row by row.
    pub sheets: Vec<Sheet>,
    /// Rows and columns of sheets.
    pub grid: [usize; 2],
}

/// Most sheets.
const MAX_SHEETS: usize = 400;
/// Room left of the board and above it, where rulers and text stand, and right of it and below, mm. The board's ground
/// must be white around it: a chessboard's corners are found by it.
const LEFT_MM: f64 = 13.0;
const ABOVE_MM: f64 = 26.0;
const REST_MM: f64 = 2.0;
/// Room for text and the ruler along x, mm.
const HEADER_MM: [f64; 2] = [124.0, ABOVE_MM];

impl BoardPrint {
    /// Lays a board out. Fails where it cannot be printed as described, or not on this paper.
    pub fn new(board: &Board, options: &PrintOptions) -> Result<Self, BoardError> {
        let layout = Layout::new(board)?;
        let [x0, y0, x1, y1] = board.kind.bounding_box_mm();
        let area = [
            (x1 - x0 + LEFT_MM + REST_MM).max(HEADER_MM[0]),
            (y1 - y0 + ABOVE_MM + REST_MM).max(RULER_MM + ABOVE_MM + REST_MM),
        ];
        let fits = |paper: &Paper| Tiling::new(*paper, area, options);
        let both = [options.paper, options.paper.turned()].map(|p| fits(&p));
        let best = both.into_iter().flatten().min_by(|a, b| a.count().cmp(&b.count()));
        let tiling = best.ok_or_else(|| {
            let [w, h] = options.paper.size_mm;
            BoardError::Paper {
                reason: format!(
                    "{:.0} x {:.0} mm with rulers do not go on up to {MAX_SHEETS} sheets of {w} x {h} mm with margins \
                     of {} mm, of which one has to hold the rulers ({:.0} x {:.0} mm)",
                    area[0],
                    area[1],
                    options.margin_mm,
                    HEADER_MM[0],
                    RULER_MM + ABOVE_MM,
                ),
            }
        })?;

        // Coordinates of the area: its origin is the top left corner of the first sheet's printed part.
        let origin = [LEFT_MM - x0, ABOVE_MM - y0];
        let mut beside = Decoration::default();
        beside.header([0.0, 0.0], &title(board));
        let board_corner = [LEFT_MM, ABOVE_MM];
        beside.ruler([board_corner[0], ABOVE_MM - 6.0], 0);
        beside.text([board_corner[0] + 0.8, ABOVE_MM - 10.5], "100 mm along x");
        beside.ruler([board_corner[0] - 6.0, board_corner[1]], 1);
        beside.text([0.0, board_corner[1] - 2.0], "100 mm");
        beside.text([0.0, board_corner[1] + 1.5], "y");
        let printed: Vec<Shape> = shapes(&layout)?.iter().map(|s| s.moved(origin)).chain(beside.shapes).collect();

        let mut sheets = Vec::with_capacity(tiling.count());
        for row in 0..tiling.grid[0] {
            for column in 0..tiling.grid[1] {
                sheets.push(tiling.sheet([row, column], &printed, &beside.labels, origin));
            }
        }
        Ok(Self { sheets, grid: tiling.grid })
    }
}

/// Says what a board is.
fn title(board: &Board) -> String {
    match &board.kind {
        BoardKind::Charuco { columns, rows, square_mm, marker_mm, dictionary, legacy } => format!(
            "nelu3d board: charuco {columns} x {rows}, squares {square_mm} mm, markers {marker_mm} mm, {dictionary}{}",
            if *legacy { ", legacy" } else { "" }
        ),
        BoardKind::Chessboard { columns, rows, square_mm } => {
            format!("nelu3d board: chessboard {columns} x {rows}, squares {square_mm} mm")
        }
        BoardKind::Markers { dictionary, markers } => {
            let ids = markers.iter().map(|m| m.id);
            let (first, last) = (ids.clone().min().unwrap_or(0), ids.max().unwrap_or(0));
            format!("nelu3d board: {} markers, {dictionary}, {first} to {last}", markers.len())
        }
    }
}

/// Sheets of one size over an area.
struct Tiling {
    paper: Paper,
    /// Rows and columns.
    grid: [usize; 2],
    margin_mm: f64,
    /// Width and height of what is printed on a sheet, mm.
    printed_mm: [f64; 2],
    /// From one sheet to the next along x and y, mm.
    step_mm: [f64; 2],
    /// Where the area begins on the first sheet: in the middle of a single one.
    inset_mm: [f64; 2],
}

impl Tiling {
    fn new(paper: Paper, area: [f64; 2], o: &PrintOptions) -> Option<Self> {
        let printed_mm = paper.size_mm.map(|s| s - 2.0 * o.margin_mm);
        let step_mm = printed_mm.map(|p| p - o.overlap_mm);
        let good = o.margin_mm >= 0.0 && o.overlap_mm >= 0.0 && printed_mm[0] >= HEADER_MM[0];
        if !(good && printed_mm[1] >= RULER_MM + ABOVE_MM && step_mm.iter().all(|s| *s >= 20.0)) {
            return None;
        }
        let n = |k: usize| {
            if area[k] <= printed_mm[k] { 1 } else { ((area[k] - o.overlap_mm) / step_mm[k]).ceil() as usize }
        };
        let (columns, rows) = (n(0), n(1));
        let inset = |k: usize| if area[k] <= printed_mm[k] { 0.5 * (printed_mm[k] - area[k]) } else { 0.0 };
        let inset_mm = [inset(0), inset(1)];
        let tiling = Self { paper, grid: [rows, columns], margin_mm: o.margin_mm, printed_mm, step_mm, inset_mm };
        (columns <= MAX_SHEETS && rows <= MAX_SHEETS && tiling.count() <= MAX_SHEETS).then_some(tiling)
    }

    fn count(&self) -> usize {
        self.grid[0] * self.grid[1]
    }

    /// Returns the sheet of this row and column; shapes and labels are in coordinates of the area, whose board begins at
    /// `origin` there.
    fn sheet(&self, place: [usize; 2], printed: &[Shape], labels: &[Label], origin: [f64; 2]) -> Sheet {
        let at = [place[1] as f64 * self.step_mm[0], place[0] as f64 * self.step_mm[1]];
        let by: [f64; 2] = std::array::from_fn(|k| self.margin_mm + self.inset_mm[k] - at[k]);
        let (min, max) = ([self.margin_mm; 2], self.printed_mm.map(|p| self.margin_mm + p));
        let shapes = printed.iter().filter_map(|s| s.moved(by).clipped(min, max));
        let mut own = Decoration { shapes: shapes.collect(), labels: Vec::new() };
        // All text stands on the first sheet.
        if place == [0, 0] {
            let moved = |l: &Label| Label { at_mm: [l.at_mm[0] + by[0], l.at_mm[1] + by[1]], ..l.clone() };
            own.labels.extend(labels.iter().map(moved));
        }
        if self.count() > 1 {
            self.add_marks(place, &mut own);
        }
        let board_from_sheet_mm = std::array::from_fn(|k| -by[k] - origin[k]);
        Sheet { size_mm: self.paper.size_mm, board_from_sheet_mm, place, shapes: own.shapes, labels: own.labels }
    }

    /// Adds marks in the margins where neighboring sheets meet: at the edge of this sheet's print toward the sheet
    /// before it, and where the next one's begins. When marks lie on marks, the print is joined.
    fn add_marks(&self, [row, column]: [usize; 2], sheet: &mut Decoration) {
        let (gap, length) = (0.15 * self.margin_mm, 0.55 * self.margin_mm);
        for (axis, i, n) in [(0, column, self.grid[1]), (1, row, self.grid[0])] {
            let seams = [(i > 0).then_some(0.0), (i + 1 < n).then_some(self.step_mm[axis])];
            for seam in seams.into_iter().flatten() {
                let across = 1 - axis;
                let end = self.margin_mm + self.printed_mm[across];
                for start in [self.margin_mm - gap - length, end + gap] {
                    let mut from = [0.0; 2];
                    from[axis] = self.margin_mm + seam;
                    from[across] = start;
                    sheet.line(from, across, length);
                }
            }
        }
        let text = format!(
            "sheet {} of {}, row {} column {}: join rows, then columns: trim left and top at the marks, lay marks on \
             marks",
            row * self.grid[1] + column + 1,
            self.count(),
            row + 1,
            column + 1
        );
        let baseline = self.margin_mm + self.printed_mm[1] + 0.45 * self.margin_mm;
        sheet.text([self.margin_mm + 2.0, baseline], text);
    }
}
