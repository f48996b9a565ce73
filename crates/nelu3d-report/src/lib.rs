//! Pages that show results, readable offline, on a phone, by somebody without this program.
//!
//! [`html`], [`chart`] and [`number`] are the pieces; [`viewer`] is a surface that can be turned; [`page`] puts a title
//! above them and sets their style; each other module is one kind of page.

pub mod chart;
mod comparison;
pub mod html;
mod live;
mod mesh;
pub mod number;
pub mod page;
mod result;
mod surface;
pub mod viewer;

pub use comparison::{ComparisonReport, DIFFERENCE_COLORS, NamedTable};
pub use live::{LIVE_SCRIPTS, LIVE_STYLE, LiveSurface, live_page, live_surface};
pub use result::{Captures, ResultReport};
pub use surface::{surface_page, surface_picture};
