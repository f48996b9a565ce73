//! What is on one sheet of paper.

/// A black shape: closed loops of points (mm); a point is black that lies inside of an odd number of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// The loops, [x, y] in mm.
    pub loops: Vec<Vec<[f64; 2]>>,
}

/// A line of text.
#[derive(Clone, Debug, PartialEq)]
pub struct Label {
    /// Left end of its base line, mm.
    pub at_mm: [f64; 2],
    /// Size of the font, mm.
    pub size_mm: f64,
    /// What it says, in ASCII.
    pub text: String,
}

/// One side of one sheet of paper: coordinates in mm from its top left corner, x to the right, y down.
#[derive(Clone, Debug, PartialEq)]
pub struct Sheet {
    /// Width and height of the paper, mm.
    pub size_mm: [f64; 2],
    /// Where the sheet's origin lies on the board as described, mm: board = sheet + this.
    pub board_from_sheet_mm: [f64; 2],
    /// Row and column among the sheets that are joined, from 0.
    pub place: [usize; 2],
    /// What is black.
    pub shapes: Vec<Shape>,
    /// What is written.
    pub labels: Vec<Label>,
}

impl Shape {
    /// Returns a rectangle.
    pub(super) fn rectangle([x0, y0]: [f64; 2], [x1, y1]: [f64; 2]) -> Self {
        Self { loops: vec![vec![[x0, y0], [x1, y0], [x1, y1], [x0, y1]]] }
    }

    /// Returns the shape moved by `by` (mm).
    #[must_use]
    pub(super) fn moved(&self, by: [f64; 2]) -> Self {
        let loops = self.loops.iter().map(|l| l.iter().map(|p| [p[0] + by[0], p[1] + by[1]]).collect()).collect();
        Self { loops }
    }

    /// Returns what of the shape lies inside of a rectangle; `None` where nothing does.
    ///
    /// Half plane by half plane (Sutherland & Hodgman 1974). Loops that are not convex get edges along the rectangle's
    /// sides that cover each other: they enclose nothing, and count twice in even and odd.
    pub(super) fn clipped(&self, min: [f64; 2], max: [f64; 2]) -> Option<Self> {
        let clip = |loop_: &Vec<[f64; 2]>| {
            let mut points = loop_.clone();
            for axis in 0..2 {
                points = half(&points, axis, min[axis], 1.0);
                points = half(&points, axis, max[axis], -1.0);
            }
            points
        };
        let loops: Vec<_> = self.loops.iter().map(clip).filter(|l| l.len() > 2).collect();
        (!loops.is_empty()).then_some(Self { loops })
    }
}

/// Returns the part of a closed loop where `sign · (p[axis] − limit)` is not negative.
fn half(points: &[[f64; 2]], axis: usize, limit: f64, sign: f64) -> Vec<[f64; 2]> {
    let side = |p: &[f64; 2]| sign * (p[axis] - limit);
    let mut out = Vec::with_capacity(points.len() + 4);
    for i in 0..points.len() {
        let (a, b) = (points[i], points[(i + 1) % points.len()]);
        let (da, db) = (side(&a), side(&b));
        if da >= 0.0 {
            out.push(a);
        }
        if (da > 0.0 && db < 0.0) || (da < 0.0 && db > 0.0) {
            let t = da / (da - db);
            let mut p = [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])];
            p[axis] = limit;
            out.push(p);
        }
    }
    out
}
