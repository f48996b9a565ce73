use nelu3d::reconstruct::refine::light_fractions::solve;
use nelu3d_field::cost_volume::LightFractionEquations;

/// Returns the equations of a pixel with ambient and unseen light of the given fractions under a code of 8 patterns
/// measured to 0.001.
fn equations(fractions: [f32; 2]) -> [f32; 5] {
    let mut e = LightFractionEquations::default();
    for j in 0..8 {
        let c = j as f32 / 8.0;
        let [ambient, unseen] = [1.0 - c, 0.4 - c];
        e.add(fractions[0] * ambient + fractions[1] * unseen, ambient, unseen, 1e6);
    }
    e.sums
}

#[test]
fn light_that_is_everywhere_is_found() {
    let [a, b] = solve(equations([0.04, 0.1]), equations([0.04, 0.1]), [400.0, 25.0]);
    assert!((a - 0.04).abs() < 1e-3 && (b - 0.1).abs() < 1e-3, "{a} {b}");
}

#[test]
fn what_differs_from_place_to_place_has_to_show_clearly() {
    // A small square that tells all agrees with itself; one that tells nothing with what is around.
    let [a, b] = solve(equations([0.06, 0.05]), equations([0.04, 0.1]), [400.0, 25.0]);
    assert!((a - 0.06).abs() < 2e-3 && (b - 0.05).abs() < 2e-3, "{a} {b}");
    let weak = equations([0.3, 0.0]).map(|e| 1e-6 * e);
    let [a, b] = solve(weak, equations([0.04, 0.1]), [400.0, 25.0]);
    assert!((a - 0.04).abs() < 1e-3 && (b - 0.1).abs() < 2e-3, "{a} {b}");
    // No light is taken away.
    let [a, b] = solve(equations([-0.1, -0.1]), equations([0.0, 0.0]), [400.0, 25.0]);
    assert_eq!([a, b], [0.0, 0.0]);
}
