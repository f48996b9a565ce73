//! Zeros of polynomials on an interval, none missed: between two zeros of its derivative a polynomial has at most one.

/// The first s in `(0, to]` where the quartic `Σ c_k s^k` changes its sign.
pub(super) fn first_root(c: &[f64; 5], to: f64) -> Option<f64> {
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

/// The zero between two places where f has different signs, by false position that never leaves the interval (Illinois)
/// and halving where that is slow.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_of_known_zeros_is_found() {
        for zeros in [[1.0, 2.0, 3.0, 4.0], [0.5, 0.5001, 7.0, 9.0], [-3.0, -1.0, 2.5, 60.0], [1e-3, 5.0, 5.0, 80.0]] {
            let mut c = [1.0, 0.0, 0.0, 0.0, 0.0];
            for z in zeros {
                for k in (0..5).rev() {
                    c[k] = if k > 0 { c[k - 1] } else { 0.0 } - z * c[k];
                }
            }
            let first = zeros.into_iter().find(|z| *z > 0.0).unwrap();
            let got = first_root(&c, 100.0).unwrap();
            assert!((got - first).abs() < 1e-8, "{got}, not {first}");
            assert!(first_root(&c, first * 0.99).is_none());
        }
        assert!(first_root(&[1.0, 0.0, 1.0, 0.0, 1.0], 50.0).is_none());
    }
}
