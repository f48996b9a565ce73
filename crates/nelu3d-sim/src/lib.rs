//! The virtual scanner: captures of a declared camera, light source, board and scenes, written as an ordinary rig
//! folder, with the ground truth beside them.
//!
//! ```text
//! Spec ─► sweep poses ─► VirtualScene (board, or objects at their moment) ─► render (LightSource × rays) ─► Sensor
//!                             └► GroundTruth: depth, mask, mesh                                             └► rig folder
//! ```
//!
//! The physics, each in one place: [`spec`] declares all quantities with their units; [`scene`] has surfaces and
//! materials, [`light`] what falls on them, [`render`] what a pixel collects, with interreflection, and [`sensor`] what
//! it makes of it. The same spec (with its seed) gives the same bytes, whatever the number of threads.
//!
//! A file imports only from above it here: `spec`; `random` and `geometry`; `scene` and `light`; `sweep`; `check`;
//! `render`, `sensor` and `ground_truth`; `displayed`, `capture` and `sequence`; `simulate`.
//!
//! A preset's scanner before a sphere, as a rig folder:
//!
//! ```no_run
//! use nelu3d_sim::spec::{ObjectSpec, SceneSpec, ShapeSpec};
//! use nelu3d_sim::{Spec, simulate};
//!
//! let sphere = ObjectSpec::new(ShapeSpec::Sphere { radius_mm: 50.0 }, [0.0, 0.0, 700.0]);
//! let demo = Spec::preset("demo").expect("a preset");
//! let spec = Spec { scenes: vec![SceneSpec::new("sphere", vec![sphere])], ..demo };
//! simulate(&spec, "rig".as_ref(), &|_, _, _| ())?;
//! # Ok::<(), nelu3d_sim::SimulationError>(())
//! ```
//!
//! Nothing that reconstructs may depend on this crate: it knows the ground truth.

mod capture;
mod check;
mod displayed;
mod error;
pub mod geometry;
mod ground_truth;
pub mod light;
pub mod random;
pub mod render;
pub mod scene;
pub mod sensor;
mod sequence;
mod simulate;
pub mod spec;
pub mod staging;
pub mod sweep;

pub use error::SimulationError;
pub use ground_truth::GroundTruth;
pub use sequence::object_at;
pub use simulate::{simulate, simulate_until};
pub use spec::Spec;
