//! The virtual scanner: captures of a declared camera, light source, board and scenes, written as an ordinary rig folder,
//! with the truth beside them.
//!
//! ```text
//! Spec ─► sweep poses ─► Scene (board or objects, at their moment) ─► render (Light × rays) ─► sensor noise ─► rig folder
//!                                     └► Truth: depth, mask, mesh
//! ```
//!
//! The physics, each in one place: [`spec`] declares all quantities with their units; `scene` has surfaces and materials,
//! `light` what falls on them, `render` what a pixel collects, also by way of other surfaces, `sensor` what it makes of it. The same spec (with its seed) gives the same bytes, whatever the number of threads.
//!
//! Nothing that reconstructs may depend on this crate: it knows the truth.

mod capture;
mod light;
mod random;
mod render;
mod scene;
mod sensor;
mod sequence;
mod shown;
mod simulate;
pub mod spec;
mod sweep;
mod truth;

pub use sequence::object_at;
pub use simulate::{SimError, simulate};
pub use spec::Spec;
pub use sweep::sweep_poses;
pub use truth::Truth;
