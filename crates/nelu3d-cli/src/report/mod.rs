//! Pages that show results, readable offline, on a phone, by somebody without this program.
//!
//! [`html`], [`chart`] and [`number`] are the pieces; [`viewer`] is a surface that can be turned; [`page`] puts a title
//! above them and sets their style; each other module is one kind of page.

pub(crate) mod chart;
mod comparison;
pub(crate) mod html;
mod mesh;
pub(crate) mod number;
pub(crate) mod page;
mod result;
pub(crate) mod viewer;

pub(crate) use comparison::{ComparisonReport, DIFFERENCE_COLORS};
pub(crate) use result::ResultReport;
