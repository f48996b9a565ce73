//! The Levenberg–Marquardt method (Levenberg 1944; Marquardt 1963): Gauss–Newton steps that are damped until they help.
//!
//! [`minimize`] is the loop alone. What is fitted, how its normal equations are built and solved, and when a fit has
//! converged is the business of a [`Problem`]; how damping follows success and failure is in [`LmSettings`].

/// A nonlinear least-squares problem, with the state that its evaluations share.
///
/// The loop calls [`cost`](Problem::cost) of the start; then, for each iteration, [`linearize`](Problem::linearize)
/// once and [`step`](Problem::step) and `cost` for each trial, and [`accept`](Problem::accept) as soon as a trial
/// succeeds. A problem may therefore keep what an evaluation computed for the call that follows.
pub trait Problem {
    /// What is searched for.
    type Parameters;

    /// Returns the cost of some parameters; infinite or NaN where they are impossible.
    fn cost(&mut self, parameters: &Self::Parameters) -> f64;

    /// Builds the normal equations at the current parameters, whose cost is given. Returns the cost that trials have to
    /// beat: the given one, unless weights are chosen anew here. `None` ends the search without a result.
    fn linearize(&mut self, parameters: &Self::Parameters, cost: f64) -> Option<f64>;

    /// Solves the normal equations with this damping and returns the parameters after the step; `None` where they are
    /// singular.
    fn step(&mut self, parameters: &Self::Parameters, damping: f64) -> Option<Self::Parameters>;

    /// Takes note that the last trial lowered the cost from `before` to `after`, and returns whether that was so little
    /// that the search has converged.
    fn accept(&mut self, before: f64, after: f64) -> bool;

    /// Returns whether to end the search after a trial that did not help. By default it goes on with more damping.
    fn gives_up(&self) -> bool {
        false
    }
}

/// What makes normal equations without a solution end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SingularSystem {
    /// The damping is raised, as after a trial that did not help.
    RaisesDamping,
    /// The search ends with the best parameters so far.
    Stops,
    /// The search ends without a result.
    Fails,
}

/// How damping follows success and failure, and how long to try.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LmSettings {
    /// Damping of the first trial, relative to the diagonal of the normal equations.
    pub damping: f64,
    /// Smallest damping.
    pub min_damping: f64,
    /// Trials are made only below this damping.
    pub max_damping: f64,
    /// Factor on the damping after a trial that helped.
    pub lower: f64,
    /// Factor on the damping after a trial that did not help.
    pub raise: f64,
    /// Most linearizations.
    pub max_iterations: usize,
    /// Most trials of one linearization.
    pub max_trials: usize,
    /// Most trials of all linearizations together.
    pub max_total_trials: usize,
    /// Whether a trial of equal cost counts as a success.
    pub accept_equal: bool,
    /// What happens where the normal equations have no solution.
    pub singular: SingularSystem,
}

impl Default for LmSettings {
    fn default() -> Self {
        Self {
            damping: 1e-4,
            min_damping: 1e-12,
            max_damping: 1e8,
            lower: 0.1,
            raise: 10.0,
            max_iterations: 50,
            max_trials: usize::MAX,
            max_total_trials: usize::MAX,
            accept_equal: false,
            singular: SingularSystem::RaisesDamping,
        }
    }
}

/// Lowers the cost of `start` until the problem says that it has converged, no damping helps, or the trials are used
/// up; returns the best parameters seen.
///
/// Returns `None` where the start has no finite cost, where the problem cannot be linearized, and where a singular
/// system is to end the search.
pub fn minimize<P: Problem>(problem: &mut P, start: P::Parameters, settings: &LmSettings) -> Option<P::Parameters> {
    let mut parameters = start;
    let mut cost = Some(problem.cost(&parameters)).filter(|c| c.is_finite())?;
    let mut damping = settings.damping;
    let mut trials_left = settings.max_total_trials;
    for _ in 0..settings.max_iterations {
        cost = problem.linearize(&parameters, cost)?;
        let mut improved = false;
        for _ in 0..settings.max_trials {
            // A NaN must not be tried for ever.
            if trials_left == 0 || damping.is_nan() || damping >= settings.max_damping {
                break;
            }
            trials_left -= 1;
            let Some(candidate) = problem.step(&parameters, damping) else {
                match settings.singular {
                    SingularSystem::RaisesDamping => damping *= settings.raise,
                    SingularSystem::Stops => return Some(parameters),
                    SingularSystem::Fails => return None,
                }
                continue;
            };
            let after = problem.cost(&candidate);
            if after < cost || (settings.accept_equal && after == cost) {
                let converged = problem.accept(cost, after);
                (parameters, cost) = (candidate, after);
                damping = (damping * settings.lower).max(settings.min_damping);
                improved = !converged;
                break;
            }
            if problem.gives_up() {
                return Some(parameters);
            }
            damping *= settings.raise;
        }
        if !improved {
            break;
        }
    }
    Some(parameters)
}
