//! Calibrated uncertainty of each depth: one standard deviation, from what the method knows without a ground truth.
//!
//! Three parts, added as variances:
//!
//! 1. the sensor's noise, as large as the residuals show it, carried through the last linear system;
//! 2. what the thin-plate prior smooths away, scaled by how rough the found surface really is: the prior allows every
//!    surface a minimum roughness, and many are smoother;
//! 3. what is systematic: light that no part of the model explains (crosstalk, errors of the color field,
//!    interreflection). It differs from noise in that neighbors share it, so averaging over the prior does not remove
//!    it: the mean over squares as large as the prior averages over. It shows in the directions of code space that
//!    depth cannot explain. An offset and a gain of a pixel's channels change depth by what of them lies along its
//!    direction; what else there is, channel by channel, is taken to be as large along that direction as across.
//!
//! The first two are diagonals of matrices of the size of the image. A pixel's are taken from a uniform plate of
//! infinite extent with the pixel's own weight and information, for which they are integrals over spatial frequencies;
//! free edges make them larger.

mod information;
mod masked_mean;
mod posterior;
mod sigma;
mod systematic;
mod uniform_plate;
mod zones;

pub use information::Information;
pub(super) use masked_mean::masked_mean;
pub use posterior::Posterior;
pub use sigma::{noise_ratio, sigma};
pub use systematic::{Nuisances, Systematic, systematic};
