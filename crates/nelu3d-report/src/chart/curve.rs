//! Small curves without axes.

use std::fmt::Write;

use crate::number::short;

/// Draws a small curve of a list of numbers, without axes.
pub fn curve(values: &[f64]) -> String {
    let (low, high) = values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &v| (a.min(v), b.max(v)));
    let span = if high > low { high - low } else { 1.0 };
    let points = values.iter().enumerate().fold(String::new(), |mut s, (i, v)| {
        let x = 240.0 * i as f64 / (values.len() - 1) as f64;
        let _ = write!(s, "{x:.1},{:.1} ", 38.0 - 36.0 * (v - low) / span);
        s
    });
    format!(
        "<svg viewBox='0 0 240 40' class=curve><polyline points='{points}'/></svg> <span class=note>{} values, {} … \
         {}</span>",
        values.len(),
        short(low),
        short(high)
    )
}
