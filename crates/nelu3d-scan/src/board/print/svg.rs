//! Scalable Vector Graphics: one file a sheet, whose unit is the millimeter.

use std::fmt::Write as _;

use super::sheet::Sheet;

impl Sheet {
    /// Returns the text of an SVG file of the sheet.
    pub fn to_svg(&self) -> String {
        let [w, h] = self.size_mm;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}mm\" height=\"{h}mm\" viewBox=\"0 0 {w} {h}\">\n\
             <rect width=\"{w}\" height=\"{h}\" fill=\"white\"/>\n"
        );
        for shape in &self.shapes {
            svg += "<path fill-rule=\"evenodd\" d=\"";
            for points in &shape.loops {
                for (i, [x, y]) in points.iter().enumerate() {
                    // A micrometer's tenth, far below what is printed.
                    let _ = write!(svg, "{}{x:.4} {y:.4}", if i == 0 { 'M' } else { 'L' });
                }
                svg.push('Z');
            }
            svg += "\"/>\n";
        }
        for label in &self.labels {
            let [x, y] = label.at_mm;
            let text = label.text.replace('&', "&amp;").replace('<', "&lt;");
            let _ = writeln!(
                svg,
                "<text x=\"{x:.3}\" y=\"{y:.3}\" font-family=\"Helvetica, Arial, sans-serif\" \
                 font-size=\"{}\">{text}</text>",
                label.size_mm
            );
        }
        svg + "</svg>\n"
    }
}
