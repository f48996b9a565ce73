//! The linear system of the surface: data terms on the diagonal, and a discontinuity-preserving thin-plate prior that
//! can break between pixels.
//!
//! Minimizes Σ_i h_i (x_i − y_i)² + Σ w_d (D x)_d² over the second differences D along x, along y and mixed. The
//! unknown is inverse depth, in which planes are linear over the image: planes cost nothing, however slanted. The
//! system is solved by [`nelu3d_field::plate`].

mod prior;

pub use prior::ThinPlatePrior;
