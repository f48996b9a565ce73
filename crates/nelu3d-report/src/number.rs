//! Numbers for people.

/// Formats a number in few characters.
pub fn short(v: f64) -> String {
    match v.abs() {
        a if !v.is_finite() => format!("{a}"),
        0.0 => "0".to_owned(),
        100.0.. => format!("{v:.0}"),
        10.0.. => format!("{v:.1}"),
        0.1.. => format!("{v:.2}"),
        0.01.. => format!("{v:.3}"),
        0.001.. => format!("{v:.4}"),
        _ => format!("{v:.1e}"),
    }
}

/// Formats a number with its unit; a dash where there is none.
pub fn with_unit(v: f64, digits: usize, unit: &str) -> String {
    if v.is_finite() { format!("{v:.digits$} {unit}") } else { "–".to_owned() }
}

/// Formats a fraction in [0, 1] as a percentage.
pub fn percent(v: f64) -> String {
    with_unit(100.0 * v, 1, "%")
}

/// Formats a count in groups of three digits.
pub fn grouped(n: usize) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push('\u{202f}');
        }
        out.push(c);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short() {
        assert_eq!(grouped(1_234_567), "1\u{202f}234\u{202f}567");
        assert_eq!([short(0.0), short(523.4), short(-0.5), short(2e-5)], ["0", "523", "-0.50", "2.0e-5"]);
    }
}
