//! Zeros of polynomials on an interval, none missed: between two zeros of its derivative a polynomial has at most one.

use super::spline::cubic;

/// Returns the first s in `(0, to]` where the quartic `Σ c_k s^k` changes its sign.
pub fn first_root(c: &[f64; 5], to: f64) -> Option<f64> {
    let mut all = [0.0; 8];
    // From the linear third derivative up to the quartic itself.
    let mut marks = [0.0; 8];
    let mut n = 0;
    for order in (0..4).rev() {
        let mut derivative = [0.0; 5];
        for k in order..5 {
            derivative[k - order] = c[k] * (k + 1 - order..=k).map(|f| f as f64).product::<f64>();
        }
        let f = |s: f64| derivative.iter().rev().fold(0.0, |sum, c| sum * s + c);
        let mut found = 0;
        let mut from = 0.0;
        for i in 0..=n {
            let until = if i < n { marks[i] } else { to };
            if let Some(root) = crossing(f, from, until) {
                if order == 0 {
                    return Some(root);
                }
                all[found] = root;
                found += 1;
            }
            from = until;
        }
        (marks, n) = (all, found);
    }
    None
}

/// Returns the zero between two places where f has different signs, by false position that never leaves the interval
/// (Illinois) and halving where that is slow.
fn crossing(f: impl Fn(f64) -> f64, from: f64, to: f64) -> Option<f64> {
    let (mut a, mut b) = (from, to);
    let (mut fa, mut fb) = (f(a), f(b));
    if fa == 0.0 || (fa < 0.0) == (fb < 0.0) {
        // At its start the ray leaves a surface: that is no hit.
        return (fb == 0.0 && fa != 0.0).then_some(b);
    }
    let mut side = 0;
    for step in 0..200 {
        let mut s = if step % 8 == 7 { 0.5 * (a + b) } else { (a * fb - b * fa) / (fb - fa) };
        if !(s > a && s < b) {
            s = 0.5 * (a + b);
        }
        if s <= a || s >= b {
            break;
        }
        let fs = f(s);
        if fs == 0.0 {
            return Some(s);
        }
        if (fs < 0.0) == (fa < 0.0) {
            (a, fa) = (s, fs);
            if side == -1 {
                fb *= 0.5;
            }
            side = -1;
        } else {
            (b, fb) = (s, fs);
            if side == 1 {
                fa *= 0.5;
            }
            side = 1;
        }
        if b - a <= 1e-13 * (1.0 + b.abs()) {
            break;
        }
    }
    Some(0.5 * (a + b))
}

/// Returns the first s in `[from, to]` where the cubic goes from positive to not positive (or, from `inside`, from
/// negative to not negative). The cubic is cut at its extrema, so that every part has at most one crossing and none is
/// missed.
pub(super) fn first_crossing(poly: &[f64; 4], from: f64, to: f64, inside: bool) -> Option<f64> {
    let sign = if inside { -1.0 } else { 1.0 };
    let f = |s: f64| sign * cubic(poly, s);
    let mut cuts = [from, from, from, to];
    let (a, b, c) = (3.0 * poly[3], 2.0 * poly[2], poly[1]);
    let root = (b * b - 4.0 * a * c).max(0.0).sqrt();
    // Both roots of the derivative without cancellation; a vanishing divisor gives infinity or NaN, which is no cut.
    let q = -0.5 * (b + root.copysign(b));
    let mut extrema = [q / a, c / q];
    extrema.sort_by(f64::total_cmp);
    let mut n = 1;
    for e in extrema {
        if e > from && e < to {
            cuts[n] = e;
            n += 1;
        }
    }
    cuts[n] = to;
    for part in cuts[..=n].windows(2) {
        let (mut p, mut q) = (part[0], part[1]);
        if f(p) > 0.0 && f(q) <= 0.0 {
            // Bisection ends when no number lies between; 200 halvings are more than there are.
            for _ in 0..200 {
                let middle = 0.5 * (p + q);
                if middle <= p || middle >= q || q - p < 1e-12 {
                    break;
                }
                if f(middle) > 0.0 {
                    p = middle;
                } else {
                    q = middle;
                }
            }
            return Some(0.5 * (p + q));
        }
    }
    None
}
