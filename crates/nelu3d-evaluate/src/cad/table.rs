//! The numbers of a comparison as a table for people.

use std::fmt;

use super::{CadErrors, CadMetrics};
use crate::table::{aligned, number, percent, signed};

impl CadMetrics {
    /// Returns the groups of points with their names, in the order they are shown in.
    pub fn groups(&self) -> [(&'static str, &CadErrors); 3] {
        [("all points", &self.all), ("the part", &self.part), ("body", &self.body)]
    }

    /// Returns the column headings of [`Self::rows`].
    pub fn headings() -> [&'static str; 10] {
        ["points", "number", "mean mm", "median", "RMSE", "p95", "max", "bias", "<0.5 mm", "<1 mm"]
    }

    /// Returns one row of cells per group; a dash where no point gave a number.
    pub fn rows(&self) -> Vec<Vec<String>> {
        let row = |(name, e): (&str, &CadErrors)| {
            let d = &e.distance_mm;
            let mut cells = vec![name.to_owned(), e.n.to_string()];
            cells.extend([d.mae, d.median, d.rmse, d.p95, e.max_mm].map(|v| number(v, 3)));
            cells.push(signed(d.bias, 3));
            cells.extend([e.under_half_mm, e.under_1mm].map(percent));
            cells
        };
        self.groups().into_iter().map(row).collect()
    }
}

impl fmt::Display for CadMetrics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&aligned(&Self::headings(), &self.rows()))?;
        writeln!(
            f,
            "{} of {} points belong to the part (within {} mm of the mesh)",
            percent(self.inliers),
            self.n_points,
            number(self.within_mm, 2)
        )?;
        writeln!(f, "{} of the mesh that the camera should see was found", percent(self.visible_found))?;
        if self.in_front > 0.02 {
            writeln!(f, "{} of the mesh lies in front of what was measured", percent(self.in_front))?;
        }
        writeln!(f, "cam_from_cad ({})", if self.aligned { "aligned" } else { "as given" })?;
        for row in self.cam_from_cad {
            writeln!(f, "{}", row.map(|v| format!("{v:12.6}")).join(" "))?;
        }
        Ok(())
    }
}
