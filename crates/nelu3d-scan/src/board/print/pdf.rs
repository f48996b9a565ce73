//! Portable Document Format: vectors, one page a sheet.

use pdf_writer::{Content, Name, Pdf, Rect, Ref, Str};

use super::plan::BoardPrint;
use super::sheet::Sheet;

/// Points of 1/72 inch in a millimeter.
const POINTS: f64 = 72.0 / 25.4;
const FONT: Name<'static> = Name(b"F");

impl BoardPrint {
    /// Returns the bytes of a PDF file whose pages are the sheets. It asks viewers not to fit pages to the paper, which
    /// most do by default (ISO 32000-1, 12.2, PrintScaling).
    pub fn to_pdf(&self) -> Vec<u8> {
        let [catalog, tree, font] = [1, 2, 3].map(Ref::new);
        let id = |i: usize, k: i32| Ref::new(4 + 2 * i as i32 + k);
        let mut pdf = Pdf::new();
        let mut root = pdf.catalog(catalog);
        root.pages(tree);
        root.viewer_preferences().pair(Name(b"PrintScaling"), Name(b"None"));
        drop(root);
        pdf.pages(tree).kids((0..self.sheets.len()).map(|i| id(i, 0))).count(self.sheets.len() as i32);
        // One of the fonts that every viewer has (ISO 32000-1, 9.6.2.2).
        pdf.type1_font(font).base_font(Name(b"Helvetica"));
        for (i, sheet) in self.sheets.iter().enumerate() {
            let [w, h] = sheet.size_mm.map(|s| (s * POINTS) as f32);
            let mut page = pdf.page(id(i, 0));
            page.media_box(Rect::new(0.0, 0.0, w, h)).parent(tree).contents(id(i, 1));
            page.resources().fonts().pair(FONT, font);
            drop(page);
            pdf.stream(id(i, 1), &content(sheet));
        }
        pdf.finish()
    }
}

fn content(sheet: &Sheet) -> Vec<u8> {
    let point = |p: [f64; 2]| [(p[0] * POINTS) as f32, ((sheet.size_mm[1] - p[1]) * POINTS) as f32];
    let mut content = Content::new();
    content.set_fill_gray(0.0);
    for shape in &sheet.shapes {
        for points in &shape.loops {
            for (i, p) in points.iter().enumerate() {
                let [x, y] = point(*p);
                if i == 0 {
                    content.move_to(x, y)
                } else {
                    content.line_to(x, y)
                };
            }
            content.close_path();
        }
        content.fill_even_odd();
    }
    for label in &sheet.labels {
        let [x, y] = point(label.at_mm);
        content.begin_text().set_font(FONT, (label.size_mm * POINTS) as f32).next_line(x, y);
        content.show(Str(label.text.as_bytes())).end_text();
    }
    content.finish().into_vec()
}
