//! Metrics as a table for people.

use std::fmt;

use crate::{Comparison, Metrics, RegionMetrics};

impl Metrics {
    /// Returns the regions with their names, in the order they are shown in.
    pub fn regions(&self) -> [(&'static str, &RegionMetrics); 3] {
        [("whole", &self.whole), ("body", &self.body), ("grazing", &self.grazing)]
    }

    /// Returns the column headings of [`Self::rows`].
    pub fn headings(&self) -> Vec<&'static str> {
        let mut headings =
            vec!["region", "pixels", "coverage", "MAE mm", "median", "RMSE", "p95", "bias", "<0.5 mm", "<1 mm"];
        if self.whole.disparity_px.is_some() {
            headings.push("MAE px");
            headings.push("median px");
        }
        if self.whole.normal_deg.is_some() {
            headings.push("normal °");
        }
        if self.whole.sigma.is_some() {
            headings.push("≤1σ");
            headings.push("≤2σ");
        }
        headings
    }

    /// Returns one row of cells per region; a dash where no pixel gave a number.
    pub fn rows(&self) -> Vec<Vec<String>> {
        self.regions().into_iter().map(|(name, r)| row(name, r)).collect()
    }
}

fn row(name: &str, r: &RegionMetrics) -> Vec<String> {
    let d = &r.depth_mm;
    let mut cells = vec![name.to_owned(), r.n_region.to_string(), percent(r.coverage)];
    cells.extend([d.mae, d.median, d.rmse, d.p95].map(|v| number(v, 3)));
    cells.push(signed(d.bias, 3));
    cells.extend([r.under_half_mm, r.under_1mm].map(percent));
    if let Some(e) = &r.disparity_px {
        cells.extend([e.mae, e.median].map(|v| number(v, 3)));
    }
    if let Some(e) = &r.normal_deg {
        cells.push(number(e.mae, 1));
    }
    if let Some(s) = &r.sigma {
        cells.extend([s.within_1, s.within_2].map(percent));
    }
    cells
}

/// Returns the lines of a table whose columns are aligned: the first to the left, the others to the right.
pub(crate) fn aligned(headings: &[&str], rows: &[Vec<String>]) -> String {
    let mut lines = vec![headings.iter().map(|&h| h.to_owned()).collect::<Vec<_>>()];
    lines.extend_from_slice(rows);
    let width = |c: usize| lines.iter().map(|l| l[c].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..lines[0].len()).map(width).collect();
    lines.iter().fold(String::new(), |text, line| {
        let cell = |(c, s): (usize, &String)| {
            if c == 0 { format!("{s:<0$}", widths[c]) } else { format!("{s:>0$}", widths[c]) }
        };
        text + line.iter().enumerate().map(cell).collect::<Vec<_>>().join("  ").trim_end() + "\n"
    })
}

pub(crate) fn signed(v: f64, digits: usize) -> String {
    if v.is_finite() { format!("{v:+.digits$}") } else { "–".to_owned() }
}

pub(crate) fn number(v: f64, digits: usize) -> String {
    if v.is_finite() { format!("{v:.digits$}") } else { "–".to_owned() }
}

pub(crate) fn percent(v: f64) -> String {
    if v.is_finite() { format!("{:.1} %", 100.0 * v) } else { "–".to_owned() }
}

impl fmt::Display for Metrics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&aligned(&self.headings(), &self.rows()))?;
        if self.n_outside_mask > 0 {
            writeln!(
                f,
                "{} pixels have a depth where the ground truth has none, or where the light cannot reach",
                self.n_outside_mask
            )?;
        }
        Ok(())
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let d = &self.depth_mm;
        writeln!(f, "valid in both       {}", self.n)?;
        writeln!(f, "only in the first   {}", self.n_only_first)?;
        writeln!(f, "only in the second  {}", self.n_only_second)?;
        writeln!(f, "mean |difference|   {} mm", number(d.mae, 3))?;
        writeln!(f, "median              {} mm", number(d.median, 3))?;
        writeln!(f, "RMS                 {} mm", number(d.rmse, 3))?;
        writeln!(f, "95th percentile     {} mm", number(d.p95, 3))?;
        writeln!(f, "first − second      {} mm", number(d.bias, 3))
    }
}
