//! Interreflection: light that reached a pixel from the rest of the scene, gathered from the surface as reconstructed
//! so far.
//!
//! A diffuse point x of albedo ρ that receives E c from the light source and I from the surface around it shows ρ/π (E
//! c + I). What arrives from a patch y is what y shows, and that is in the captures themselves, all bounces included:
//! under pattern j, I_j(x) = Σ_y L_j(y) A_y cos θ_x cos θ_y / r², and likewise for white (the rendering equation,
//! Kajiya 1986, with the captures in place of its recursion). With s = I_j / I_white, the codeword is c + b (s − c),
//! where b = ρ I_white / (π L_white(x)). So s and b/ρ follow from the surface and the captures; the albedo is all that
//! remains to be estimated. What the camera does not see throws light, too: that part is the unseen indirect light of
//! [`super::light_fractions`].
//!
//! Occlusion between x and y is neglected: testing it against the depth map changed no error by more than 1 % and cost
//! more than all the rest.

mod gather;
mod patches;
mod surface;
mod vector;

pub use gather::{Interreflection, gather};
pub use surface::GatherSurface;
