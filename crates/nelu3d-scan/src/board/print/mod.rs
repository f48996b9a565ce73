//! Boards on paper: pages with the print of a board, rulers to measure it by, and marks to join sheets by.
//!
//! [`BoardPrint`] lays a board out from the same layout that the detector reads. It is a list of [`Sheet`]s, of black
//! polygons and lines of text in millimeters, which [`BoardPrint::to_pdf`], [`Sheet::to_svg`], and [`Sheet::to_png`]
//! write: one file per format, each of which has to keep every length to 0.05 mm. A new format is a new such file.

mod decoration;
mod outline;
mod paper;
mod pdf;
mod plan;
mod png;
mod shapes;
mod sheet;
mod svg;
pub use outline::outlines;
pub use paper::Paper;
pub use plan::{BoardPrint, PrintOptions};
pub use sheet::{Label, Shape, Sheet};
