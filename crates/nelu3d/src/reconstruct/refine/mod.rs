//! Refinement by narrow-band volume rendering, to the accuracy that the noise allows.
//!
//! The signed distance field of the `fast` recipe lives on the camera's own lattice: along the ray of pixel i, f(t) =
//! cos θ_i (t_i − t), so that |∇f| = 1 where the surface is smooth (the eikonal condition holds by construction and
//! needs no loss), every ray crosses its own zero level set exactly once (no sheets behind the object), and neighbors
//! are coupled only by a discontinuity-preserving thin-plate prior (no bridges across depth jumps). Rendering it with
//! NeuS weights is a quadrature of c across the surface with a logistic of width 1/inv_s; inv_s grows as the fit
//! converges. Of the paper's losses there remain the image loss, weighed by the noise of every measurement instead of a
//! fixed blend, the ambient term and the mask. It is minimized by Gauss-Newton, each step one sparse linear system.

mod band;
mod bands;
mod blocks;
mod demand;
mod interreflection;
mod light_fractions;
mod refined;
mod refinement;
mod settings;
mod slopes;
mod thin_plate;
mod uncertainty;
mod window;

use super::context::Context;
use super::error::Failure;
use super::initialize::InitialDepth;
use super::light_fractions::LightFractionPrior;
use super::observer::Stage;
use super::scene::Scene;
use demand::WindowDemand;
pub(crate) use refined::Refined;
use refinement::Refinement;
pub use settings::RefineSettings;
use window::Window;

/// Refines the initial surface of a scene.
pub(crate) fn refine(
    scene: &Scene<'_>,
    initial: &InitialDepth,
    settings: &RefineSettings,
    fractions: &LightFractionPrior,
    cx: &mut Context<'_>,
) -> Result<Refined, Failure> {
    cx.clock.begin("refine the surface");
    let window = Window::around(&initial.inv_z, scene.camera.width).expect("the initial surface has a pixel");
    let active: Vec<bool> =
        (0..window.n()).map(|i| !window.in_ring(i) && initial.inv_z[window.at(i)].is_finite()).collect();
    let mut r = Refinement::new(scene, initial, settings, fractions, &window, &active);
    let m = &scene.measurements;
    let demand = WindowDemand { n: window.n(), k: m.k, channels: scene.white.channels };
    let mut losses = Vec::new();
    for step in 0..settings.steps {
        if cx.progress.cancelled() {
            break;
        }
        cx.progress.tick(step, settings.steps);
        let progress = cx.progress;
        let slopes = r.slopes();
        if settings.patches > 0 && settings.gathers_at(step) {
            progress.measure("gathering", || ((), r.gather_interreflection(&slopes)));
        }
        progress.measure("bands", || ((), r.render(&slopes, settings.width_mm(step))));
        progress.measure("light fractions", || (r.update_fractions(), demand.fractions()));
        losses.push(progress.measure("data term", || (r.linearize(), demand.data_term())));
        progress.measure("prior", || (r.reweight(step), demand.prior()));
        let change = progress.measure("solver", || {
            let swept = r.gauss_newton_step(step);
            (swept.change, swept.demand())
        });
        cx.observe(Stage::Refine, step + 1, || r.depth());
        if settings.is_final(step) && change < f64::from(settings.settled) * r.n_active as f64 {
            break;
        }
    }
    let refined = cx.progress.measure("sigma", || (r.finish(losses), demand.sigma()));
    cx.stop_if_cancelled()?;
    Ok(refined)
}
