//! A frozen function on the unit cube: a uniform tricubic B-spline over a projective frame.
//!
//! | file | content |
//! |---|---|
//! | `spline.rs` | the weights of four neighboring nodes and their derivatives |
//! | `view.rs` | [`Lattice`], the nodes, and their plain evaluation for any number of channels |
//! | `evaluator.rs` | [`LatticeEvaluator`], the fast evaluation at one point |
//! | `jet.rs` | values, slopes and bends along curves, for many points; `lanes.rs` is what its loops are made of, `many.rs` for more than six channels |
//! | `frame.rs` | [`ProjectiveFrame`], the map from space to the unit cube |

mod evaluator;
mod frame;
mod jet;
pub(crate) mod lanes;
pub(crate) mod many;
mod spline;
mod view;

pub use evaluator::LatticeEvaluator;
pub use frame::ProjectiveFrame;
pub use jet::{CurvePoint, ProjectiveLine};
pub use spline::{slopes, weights, weights_by_product, weights_times_six};
pub use view::{Lattice, locate};
