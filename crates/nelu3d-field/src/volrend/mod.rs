//! Volume rendering of signed distances (Wang et al. 2021, *NeuS*, Eq. 13).
//!
//! Rays are packed: ray r owns the samples `offsets[r]..offsets[r + 1]`, any number of them. With Φ(f) = sigmoid(inv_s
//! f)
//!
//! ```text
//! alpha_j = clamp((Φ(f_j) − Φ(f_{j+1})) / Φ(f_j), 0, 1),   T_j = Π_{l<j} (1 − alpha_l),   w_j = T_j alpha_j
//! ```
//!
//! The last sample of a ray only closes the last interval: its weight is 0, as is that of a ray's only sample.
//!
//! 1 − alpha_j = exp(Δ_j) with Δ_j = min(0, log Φ(f_{j+1}) − log Φ(f_j)), so everything is computed from log-sigmoids
//! and stays finite for inv_s f = ±1e4. Written for Δ, the backward pass needs no division by 1 − alpha:
//!
//! ```text
//! ∂L/∂Δ_j = Σ_{l>j} w_l g_l − T_{j+1} g_j,   g = ∂L/∂w,   ∂ log Φ(f)/∂f = inv_s (1 − Φ(f))
//! ```
//!
//! which is −(1 − alpha_j) times the usual ∂L/∂alpha_j = T_j g_j − (Σ_{l>j} w_l g_l) / (1 − alpha_j).
//!
//! [`midpoint`] has the alphas of the public code of NeuS and TurboSL instead, which see a sample's own gradient.

pub mod cpu;
pub mod midpoint;
pub mod reference;
