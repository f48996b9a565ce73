//! Pages that show results, readable offline, on a phone, by somebody without this program.
//!
//! [`html`], [`chart`] and [`number`] are the pieces; [`viewer`] is a surface that can be turned; [`page`] puts a title
//! above and the look around them; each other module is one kind of page.

pub(crate) mod chart;
mod differences;
pub(crate) mod html;
mod mesh;
pub(crate) mod number;
pub(crate) mod page;
pub(crate) mod result;
pub(crate) mod viewer;

pub(crate) use differences::{DIFFERENCE_COLORS, Differences};
pub(crate) use result::Page;

/// Pictures of maps are at most this wide, so that a page stays small.
const MAP_WIDTH: usize = 640;
