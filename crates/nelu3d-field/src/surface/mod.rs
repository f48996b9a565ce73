//! A neural signed distance field, trained by volume rendering against measured codewords (NeLU3D, Eq. 1 to 6).
//!
//! A ray's codeword is Ĩ = Σ_j w_j c(x_j) with the weights of [`crate::volrend`], of sections or of midpoints; with
//! ambient fraction A the residual is r = Ĩ (1 − A) + A − P (Eq. 1 divided by I_white). The loss of a step is
//!
//! ```text
//! (1 − α) L_pattern + α L_lookup + mask_weight L_mask + eikonal_weight L_eik + sparsity_weight L_sp
//! ```
//!
//! each as in [`crate::loss`]: image losses a mean over rays and channels (the codeword of a background ray is the
//! caller's: black, as published), L_mask over rays, L_sp over samples, and L_eik over [`eikonal_samples`]. The color
//! field c is frozen, so the samples' codewords come with the batch, and so does the ambient light, whose gradient goes
//! back to the caller.
//!
//! [`mod@reference`] is the plain form; [`NeuralSurface::train_step`] the fast one. A method with another image
//! formation brings its own [`RayLoss`] to [`NeuralSurface::step`]; L_eik and L_sp, the field and the optimizer stay
//! the same.

mod batch;
mod block;
mod chunk;
mod codeword;
mod config;
mod cpu;
mod losses;
mod neural;
mod ray_loss;
pub mod reference;
mod state;

pub use batch::{Intervals, SurfaceBatch, blocks, eikonal_samples};
pub use config::{SurfaceConfig, SurfaceError, SurfaceLoss};
pub use losses::SurfaceLosses;
pub use neural::NeuralSurface;
pub use ray_loss::{RayGradient, RayLoss, RayScratch};
