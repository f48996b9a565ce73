use nalgebra::{Matrix3, Vector3};

use super::layout::{Layout, Squares};
use super::{Board, BoardError, Dictionary};
use crate::pose::homography_4pt;

/// What is printed on a board, at any point of its plane.
#[derive(Clone, Debug)]
pub struct Artwork {
    squares: Option<Squares>,
    dictionary: Option<Dictionary>,
    markers: Vec<Print>,
    /// Real lengths along x and y over those of the description.
    scale: [f64; 2],
    /// Which markers may cover a cell of a coarse grid over them.
    index: Index,
}

/// A marker and the map from the board to its unit square.
#[derive(Clone, Debug)]
struct Print {
    id: u32,
    unit_from_board: Matrix3<f64>,
}

#[derive(Clone, Debug, Default)]
struct Index {
    min: [f64; 2],
    cell: [f64; 2],
    size: [usize; 2],
    cells: Vec<Vec<u32>>,
}

impl Artwork {
    /// Returns the print of a board. Fails when the board cannot be printed as described.
    pub fn new(board: &Board) -> Result<Self, BoardError> {
        let layout = Layout::new(board)?;
        let unit = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let mut markers = Vec::with_capacity(layout.markers.len());
        for m in &layout.markers {
            let unit_from_board = homography_4pt(&m.corners_mm, &unit)
                .ok_or_else(|| BoardError::invalid(format!("the corners of marker {} lie on a line", m.id)))?;
            markers.push(Print { id: m.id, unit_from_board });
        }
        let index = Index::new(&layout);
        Ok(Self { squares: layout.squares, dictionary: layout.dictionary, markers, scale: layout.scale, index })
    }

    /// Returns 0 where black ink is printed and 1 on bare paper, for a point of the board's plane (mm); all paper
    /// outside the print.
    pub fn albedo(&self, x_mm: f64, y_mm: f64) -> f32 {
        let (x_mm, y_mm) = (x_mm / self.scale[0], y_mm / self.scale[1]);
        if let Some(s) = &self.squares {
            let (c, r) = ((x_mm / s.side_mm).floor(), (y_mm / s.side_mm).floor());
            let outside = !(c >= 0.0 && r >= 0.0 && c < s.columns as f64 && r < s.rows as f64);
            if outside {
                return 1.0;
            }
            if s.is_black(c as usize, r as usize) {
                return 0.0;
            }
        }
        let Some(dictionary) = &self.dictionary else { return 1.0 };
        for &i in self.index.at(x_mm, y_mm) {
            let m = &self.markers[i as usize];
            let p = m.unit_from_board * Vector3::new(x_mm, y_mm, 1.0);
            let (u, v) = (p.x / p.z, p.y / p.z);
            if !(p.z > 0.0 && (0.0..1.0).contains(&u) && (0.0..1.0).contains(&v)) {
                continue;
            }
            let n = dictionary.bits();
            let (column, row) = ((u * (n + 2) as f64) as usize, (v * (n + 2) as f64) as usize);
            let border = column == 0 || row == 0 || column > n || row > n;
            return if border || dictionary.is_black(m.id, row - 1, column - 1) { 0.0 } else { 1.0 };
        }
        1.0
    }
}

impl Index {
    fn new(layout: &Layout) -> Self {
        if layout.markers.is_empty() {
            return Self::default();
        }
        let bounds = |corners: &mut dyn Iterator<Item = [f64; 2]>| {
            corners.fold(([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]), |(lo, hi), c| {
                ([lo[0].min(c[0]), lo[1].min(c[1])], [hi[0].max(c[0]), hi[1].max(c[1])])
            })
        };
        let (min, max) = bounds(&mut layout.markers.iter().flat_map(|m| m.corners_mm));
        // About four cells a marker keeps the lists at one or two entries for any sensible layout.
        let n = ((4 * layout.markers.len()) as f64).sqrt().ceil() as usize;
        let cell = [(max[0] - min[0]) / n as f64, (max[1] - min[1]) / n as f64];
        let mut index = Self { min, cell, size: [n, n], cells: vec![Vec::new(); n * n] };
        for (i, m) in layout.markers.iter().enumerate() {
            let (lo, hi) = bounds(&mut m.corners_mm.iter().copied());
            let (a, b) = (index.clamped(lo), index.clamped(hi));
            for y in a[1]..=b[1] {
                for x in a[0]..=b[0] {
                    index.cells[y * n + x].push(i as u32);
                }
            }
        }
        index
    }

    fn clamped(&self, p: [f64; 2]) -> [usize; 2] {
        std::array::from_fn(|k| (((p[k] - self.min[k]) / self.cell[k]) as usize).min(self.size[k] - 1))
    }

    fn at(&self, x: f64, y: f64) -> &[u32] {
        if self.cells.is_empty() {
            return &[];
        }
        let (u, v) = ((x - self.min[0]) / self.cell[0], (y - self.min[1]) / self.cell[1]);
        if !(u >= 0.0 && v >= 0.0 && u < self.size[0] as f64 && v < self.size[1] as f64) {
            return &[];
        }
        &self.cells[v as usize * self.size[0] + u as usize]
    }
}
