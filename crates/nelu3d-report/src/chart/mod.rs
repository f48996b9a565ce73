//! Charts as SVG, in the colors of the page: lines, dots or bars over two axes with labels.
//!
//! The only place where charts are drawn: reports, evaluations and experiments describe theirs as a [`Chart`].

mod axis;
mod curve;
mod drawing;
mod series;

pub use axis::{AxisScale, ChartAxis};
pub use curve::curve;
pub use drawing::Chart;
pub use series::{ChartMark, ChartSeries};
