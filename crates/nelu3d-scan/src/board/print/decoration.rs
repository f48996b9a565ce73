//! What stands beside a board: rulers, a field for what they measured, and marks to join sheets by.

use super::sheet::{Label, Shape};

/// Length of the rulers, mm.
pub(super) const RULER_MM: f64 = 100.0;
/// Width of lines, mm.
const LINE_MM: f64 = 0.15;
/// Size of the text, mm.
const TEXT_MM: f64 = 2.8;

/// Shapes and text, in any coordinates.
#[derive(Default)]
pub(super) struct Decoration {
    pub(super) shapes: Vec<Shape>,
    pub(super) labels: Vec<Label>,
}

impl Decoration {
    /// Adds a line of text.
    pub(super) fn text(&mut self, at_mm: [f64; 2], text: impl Into<String>) {
        self.labels.push(Label { at_mm, size_mm: TEXT_MM, text: text.into() });
    }

    /// Adds a straight line along x (0) or y (1), whose middle runs through `from`.
    pub(super) fn line(&mut self, from: [f64; 2], axis: usize, length_mm: f64) {
        let (mut min, mut max) = (from, from);
        max[axis] += length_mm;
        for k in 0..2 {
            min[k] -= 0.5 * LINE_MM;
            max[k] += 0.5 * LINE_MM;
        }
        self.shapes.push(Shape::rectangle(min, max));
    }

    /// Adds a ruler of [`RULER_MM`] along x (0) or y (1): ticks of millimeters beside a line that starts at `from`. The
    /// length holds between the middles of its first and last tick.
    pub(super) fn ruler(&mut self, from: [f64; 2], axis: usize) {
        self.line(from, axis, RULER_MM);
        let across = 1 - axis;
        for mm in 0..=RULER_MM as usize {
            let length = if mm % 10 == 0 {
                3.5
            } else if mm % 5 == 0 {
                2.5
            } else {
                1.5
            };
            let mut at = from;
            at[axis] += mm as f64;
            at[across] -= length;
            self.line(at, across, length);
        }
    }

    /// Adds two lines of text at the top, under which everything else begins, with blanks to fill in by hand.
    pub(super) fn header(&mut self, at: [f64; 2], title: &str) {
        self.text([at[0], at[1] + 3.0], title);
        let y = at[1] + 9.0;
        let hint = "print at 100 % (actual size), then measure both rulers:";
        self.text([at[0], y], hint);
        for (k, axis) in ["x", "y"].into_iter().enumerate() {
            let x = at[0] + 72.0 + 25.0 * k as f64;
            self.text([x, y], axis);
            self.line([x + 3.0, y + 0.5], 0, 14.0);
            self.text([x + 18.0, y], "mm");
        }
    }
}
