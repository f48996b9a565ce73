//! Evaluates a result against ground truth, a CAD model or another result, region by region: the mean over a whole
//! scene is ruled by a few percent of its pixels.
//!
//! The [regions](Regions) are everything that can be recovered (`whole`), what lies away from silhouettes and depth
//! jumps (`body`), and what is seen at more than 70° (`grazing`). In each of them [`evaluate`] measures depth errors in
//! mm, errors in projector columns where a projector is known, angles between normals, and whether the 1σ that came
//! with the depth is calibrated. [`compare`] takes two results of one camera, [`cad`] a mesh of the part, and [`Trace`]
//! follows the error of a reconstruction while it runs.
//!
//! No reconstruction may depend on this crate: it reads what a reconstruction must not see.

pub mod cad;
mod comparison;
mod evaluation;
mod ground_truth;
mod jumps;
mod metrics;
mod regions;
mod stats;
mod table;
mod trace;

pub use comparison::{Comparison, compare};
pub use evaluation::{EvaluatedMaps, angle_deg, evaluate};
pub use ground_truth::{GroundTruth, GroundTruthError};
pub use jumps::depth_jumps;
pub use metrics::{Metrics, RegionMetrics, UncertaintyCalibration};
pub use regions::{BODY_MARGIN_PX, GRAZING_DEG, Regions, normals_from_depth};
pub use stats::ErrorStatistics;
pub use trace::{Trace, TracePoint};
