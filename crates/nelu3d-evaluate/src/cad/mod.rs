//! A scan against a mesh of what was scanned: where the mesh lies in the camera's frame, and how far the scan is from
//! it.
//!
//! The scan is one view of the part, with gaps, and maybe with other things around it. The pose is searched for by
//! voting with point pair features, from principal axes, and from rotations all over; every candidate is refined by
//! robust iterated closest points, and scored by what lies on the mesh and by what the camera would have seen through.
//! [`InitialPose`] says where to begin instead.
//!
//! An alignment takes with it every error that a rigid motion of the part explains: a scan that is 1 mm too far away
//! has no bias after it. To see such errors too, give the pose ([`InitialPose::Fixed`]).

mod comparison;
mod error;
mod features;
mod icp;
mod metrics;
mod options;
mod pose;
mod sample;
mod scan;
mod score;
mod search;
mod starts;
mod surface;
mod table;
#[doc(hidden)]
pub mod tree;

pub use comparison::{CadComparison, compare_with_cad};
pub use error::CadError;
pub use metrics::{CadErrors, CadMetrics};
pub use options::{CadOptions, InitialPose};
pub use pose::{pose_rows, read_pose};
pub use scan::ScanMaps;
pub use surface::{CadSurface, ClosestPoint};
