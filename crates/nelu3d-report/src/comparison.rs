//! The page of a comparison: signed differences as a map, on the surface, as a histogram and as numbers.

use colorous::Gradient;
use nelu3d::result::picture::Picture;
use nelu3d_scan::Mesh;

use super::chart::Chart;
use super::html::{MAX_MAP_WIDTH, color_bar, figure, img, table, tiles};
use super::page;
use super::viewer::{Coloring, viewer};

/// Colors of signed differences: red below zero, blue above, white at zero.
pub const DIFFERENCE_COLORS: Gradient = colorous::RED_BLUE;

/// The page of a comparison.
pub struct ComparisonReport<'a> {
    /// Title of the page.
    pub title: String,
    /// What is compared how.
    pub subtitle: String,
    /// The numbers one looks for first, with their names.
    pub tiles: Vec<(String, String)>,
    /// Name of the values: `Distance`.
    pub quantity: &'static str,
    /// Values by pixel, mm; NaN where there is none.
    pub map: &'a [f32],
    /// Width and height of the map.
    pub size: [usize; 2],
    /// Values of the first and the last color, mm.
    pub range: [f64; 2],
    /// The values whose histogram is shown, mm.
    pub histogram_of: &'a [f64],
    /// The surface in these colors.
    pub mesh: Mesh,
    /// Tables of numbers.
    pub tables: Vec<NamedTable>,
}

/// A table of a page: its name, headings and rows.
pub type NamedTable = (&'static str, Vec<&'static str>, Vec<Vec<String>>);

impl ComparisonReport<'_> {
    /// Returns the histogram of the values.
    pub fn histogram(&self) -> Chart {
        // Somewhat beyond the colors, so that it can be seen what they do not show.
        let range = self.range.map(|v| 1.6 * v);
        Chart::histogram(&format!("{}, mm", self.quantity.to_lowercase()), self.histogram_of, range, 64)
    }

    /// Returns the page.
    pub fn html(&self) -> String {
        let picture = Picture::of_map(self.map, self.size[0], self.size[1], self.range, DIFFERENCE_COLORS);
        let bar = color_bar(DIFFERENCE_COLORS, self.range, "mm");
        let pictures = figure(self.quantity, "by pixel", &(img(&picture.at_most(MAX_MAP_WIDTH), self.quantity) + &bar))
            + &figure("Histogram", "number of points", &self.histogram().svg());
        let tables = self.tables.iter().map(|(name, headings, rows)| page::section(name, &table(headings, rows)));
        let body = [
            tiles(&self.tiles),
            viewer(&self.mesh, &[Coloring::Colored(self.quantity), Coloring::Clay, Coloring::Normals]),
            bar,
            page::section("Where", &format!("<div class=grid>{pictures}</div>")),
            tables.collect(),
        ];
        page::page(&self.title, &self.subtitle, &body.concat())
    }
}
