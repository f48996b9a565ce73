use nalgebra::{Matrix2, Vector2};
use nelu3d_scan::least_squares::{LmSettings, Problem, minimize};

/// The Rosenbrock function as a sum of two squares: (10 (y − x²), 1 − x).
struct Rosenbrock {
    normal: Matrix2<f64>,
    rhs: Vector2<f64>,
    costs: Vec<f64>,
}

impl Problem for Rosenbrock {
    type Parameters = Vector2<f64>;

    fn cost(&mut self, p: &Vector2<f64>) -> f64 {
        (10.0 * (p.y - p.x * p.x)).powi(2) + (1.0 - p.x).powi(2)
    }

    fn linearize(&mut self, p: &Vector2<f64>, cost: f64) -> Option<f64> {
        let j = Matrix2::new(-20.0 * p.x, 10.0, -1.0, 0.0);
        let r = Vector2::new(10.0 * (p.y - p.x * p.x), 1.0 - p.x);
        (self.normal, self.rhs) = (j.transpose() * j, -j.transpose() * r);
        self.costs.push(cost);
        Some(cost)
    }

    fn step(&mut self, p: &Vector2<f64>, damping: f64) -> Option<Vector2<f64>> {
        let mut m = self.normal;
        (0..2).for_each(|i| m[(i, i)] *= 1.0 + damping);
        Some(p + m.cholesky()?.solve(&self.rhs))
    }

    fn accept(&mut self, before: f64, after: f64) -> bool {
        before - after <= 1e-14 * before
    }
}

fn rosenbrock() -> Rosenbrock {
    Rosenbrock { normal: Matrix2::zeros(), rhs: Vector2::zeros(), costs: Vec::new() }
}

#[test]
fn the_valley_is_followed_to_its_end() {
    let mut problem = rosenbrock();
    let settings = LmSettings { max_iterations: 200, ..LmSettings::default() };
    let found = minimize(&mut problem, Vector2::new(-1.2, 1.0), &settings).unwrap();
    assert!((found - Vector2::new(1.0, 1.0)).norm() < 1e-9, "{found}");
    assert!(problem.costs.windows(2).all(|c| c[1] < c[0]), "{:?}", problem.costs);
}

#[test]
fn limits_end_the_search_with_the_best_so_far() {
    let start = Vector2::new(-1.2, 1.0);
    let begin = rosenbrock().cost(&start);
    for (max_total_trials, max_iterations) in [(3, 100), (100, 2)] {
        let settings = LmSettings { max_total_trials, max_iterations, ..LmSettings::default() };
        let found = minimize(&mut rosenbrock(), start, &settings).unwrap();
        assert!(rosenbrock().cost(&found) <= begin);
    }
    let none = LmSettings { max_total_trials: 0, ..LmSettings::default() };
    assert_eq!(minimize(&mut rosenbrock(), start, &none), Some(start));
}

#[test]
fn a_start_without_a_cost_has_no_result() {
    assert_eq!(minimize(&mut rosenbrock(), Vector2::new(f64::NAN, 0.0), &LmSettings::default()), None);
}
