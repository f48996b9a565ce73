//! Board poses from corners: PnP with refinement, the trajectory of a sweep, and the bend of a board that is not flat.

mod bend;
mod error;
mod flatness;
mod homography;
mod pnp;
mod robust;
mod stage;
mod systematic;
mod trajectory;

pub use bend::{Bend, Flatness};
pub use error::PoseError;
pub use pnp::{PoseFit, solve_pnp};
pub use systematic::{Explanation, SharedCause, SharedMisfit, explain_misfit};
pub use trajectory::{Position, Rejected, Steps, Trajectory, TrajectoryModel};

pub use homography::Homography;
pub(crate) use homography::homography_4pt;
pub(crate) use robust::{huber, sigma_of_norms};
