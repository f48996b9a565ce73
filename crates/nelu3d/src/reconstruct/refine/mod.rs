//! Refinement by narrow-band volume rendering, to the accuracy that the noise allows.
//!
//! The signed distance field of the `fast` recipe lives on the camera's own lattice: along the ray of pixel i, f(t) =
//! cos θ_i (t_i − t), so that |∇f| = 1 where the surface is smooth (the eikonal condition holds by construction and
//! needs no loss), every ray crosses its own zero level set exactly once (no sheets behind the object), and neighbors
//! are coupled only by a discontinuity-preserving thin-plate prior (no bridges across depth jumps). Rendering it with
//! NeuS weights is a quadrature of c across the surface with a logistic of width 1/inv_s; inv_s grows as the fit
//! converges. Of the paper's losses there remain the image loss, weighed by the noise of every measurement instead of a
//! fixed blend, the ambient term and the mask. It is minimized by Gauss-Newton, each step one sparse linear system.

#[doc(hidden)]
pub mod band;
#[doc(hidden)]
pub mod bands;
#[doc(hidden)]
pub mod blocks;
#[doc(hidden)]
pub mod coarse;
mod demand;
#[doc(hidden)]
pub mod interreflection;
#[doc(hidden)]
pub mod light_fractions;
mod refined;
mod refinement;
mod scene_light;
#[doc(hidden)]
pub mod seen;
mod settings;
mod slopes;
#[doc(hidden)]
pub mod smoothed_away;
#[doc(hidden)]
pub mod thin_plate;
#[doc(hidden)]
pub mod uncertainty;
#[doc(hidden)]
pub mod window;

use super::context::Context;
use super::error::Failure;
use super::initialize::InitialDepth;
use super::light_fractions::LightFractionPrior;
use super::observer::Stage;
use super::scene::Scene;
use coarse::Reduced;
use demand::WindowDemand;
pub use refined::Refined;
use refinement::Refinement;
pub use settings::RefineSettings;
use window::Window;

/// Refines the initial surface of a scene: in a reduced image first, if it has a million pixels. `fractions` is the prior
/// of light fractions, `board` the board's white − black per channel, where crosstalk may be looked for.
pub(crate) fn refine(
    scene: &Scene<'_>,
    initial: &InitialDepth,
    settings: &RefineSettings,
    (fractions, board): (&LightFractionPrior, Option<[f32; 3]>),
    cx: &mut Context<'_>,
) -> Result<Refined, Failure> {
    cx.clock.begin("refine the surface");
    let mut steps = Steps { losses: Vec::new(), all: settings.steps, prior: fractions, board, cx };
    let Some(factor) = coarse::factor(initial, settings) else {
        let refined = steps.take(scene, initial, settings, |depth| depth, |r, losses| r.finish(losses));
        cx.stop_if_cancelled()?;
        return Ok(refined);
    };
    steps.all += settings.fine_steps;
    let width = scene.camera.width;
    let reduced = Reduced::new(scene, initial, factor);
    let start = {
        let (coarse, coarse_initial) = reduced.scene(scene);
        let shown = |depth: Vec<f32>| reduced.expanded(&depth, initial, width, f32::INFINITY);
        let found = steps.take(&coarse, coarse_initial, settings, shown, |r, _| r.inverse_depth());
        reduced.start(&found, initial, width)
    };
    drop(reduced);
    let settings = RefineSettings {
        steps: settings.fine_steps,
        fine_steps: 0,
        first_width_mm: settings.last_width_mm,
        loosened: 1.0,
        roughness_measurements: settings.roughness_measurements.min(FINE_MEASUREMENTS),
        gathers: settings.gathers.min(FINE_GATHERS),
        first_gather: 0,
        ..*settings
    };
    let refined = steps.take(scene, &start, &settings, |depth| depth, |r, losses| r.finish(losses));
    cx.stop_if_cancelled()?;
    Ok(refined)
}

/// Number of times that interreflection is gathered after the refinement of a reduced image.
const FINE_GATHERS: usize = 2;
/// Number of times that the surface's roughness is measured after it.
const FINE_MEASUREMENTS: usize = 2;

/// The steps of a refinement, in one image or two.
struct Steps<'a, 'b> {
    /// The loss after every step.
    losses: Vec<f32>,
    /// Number of steps that there may be.
    all: usize,
    prior: &'a LightFractionPrior,
    board: Option<[f32; 3]>,
    cx: &'a mut Context<'b>,
}

impl Steps<'_, '_> {
    /// Takes the steps of one image, and ends with `end`, which is given the losses of all steps so far. `shown` makes
    /// a map of camera z that an observer may see.
    fn take<T>(
        &mut self,
        scene: &Scene<'_>,
        initial: &InitialDepth,
        settings: &RefineSettings,
        shown: impl Fn(Vec<f32>) -> Vec<f32>,
        end: impl FnOnce(Refinement<'_>, Vec<f32>) -> T,
    ) -> T {
        let cx = &mut *self.cx;
        let window = Window::around(&initial.inv_z, scene.camera.width).expect("the initial surface has a pixel");
        let active: Vec<bool> =
            (0..window.n()).map(|i| !window.in_ring(i) && initial.inv_z[window.at(i)].is_finite()).collect();
        let mut r = Refinement::new(scene, initial, settings, (self.prior, self.board), &window, &active);
        let m = &scene.measurements;
        let demand = WindowDemand { n: window.n(), k: m.k, channels: scene.white.channels };
        for step in 0..settings.steps {
            if cx.progress.cancelled() {
                break;
            }
            cx.progress.tick(self.losses.len(), self.all);
            let progress = cx.progress;
            let slopes = r.slopes();
            if settings.patches > 0 && settings.gathers_at(step) {
                progress.measure("gathering", || ((), r.gather_interreflection(&slopes)));
            }
            progress.measure("bands", || ((), r.render(&slopes, settings.width_mm(step))));
            progress.measure("light fractions", || (r.update_fractions(&slopes, step), demand.fractions()));
            self.losses.push(progress.measure("data term", || (r.linearize(), demand.data_term())));
            if settings.measures_roughness_at(step) {
                progress.measure("roughness", || (r.measure_roughness(), demand.roughness()));
            }
            progress.measure("prior", || (r.reweight(step), demand.prior()));
            let change = progress.measure("solver", || {
                let swept = r.gauss_newton_step(step);
                (swept.change, swept.demand())
            });
            cx.observe(Stage::Refine, self.losses.len(), || shown(r.depth()));
            if settings.is_final(step) && change < f64::from(settings.settled) * r.n_active as f64 {
                break;
            }
        }
        let losses = self.losses.clone();
        cx.progress.measure("sigma", || (end(r, losses), demand.sigma()))
    }
}
