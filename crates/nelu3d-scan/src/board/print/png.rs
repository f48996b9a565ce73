//! Portable Network Graphics: gray pixels of a stated size, one file a sheet.

use std::io;

use font8x8::UnicodeFonts as _;
use png::{BitDepth, ColorType, Compression, Encoder, PixelDimensions, Unit};

use super::outline::outlines;
use super::sheet::{Label, Shape, Sheet};

/// Lines along which a pixel's black share is summed.
const SCANS: usize = 8;
/// Most pixels of a picture.
const MAX_PIXELS: f64 = 5e8;

impl Sheet {
    /// Returns the bytes of a PNG file of the sheet, of so many pixels an inch, which the file says. A pixel's value is
    /// the share of it that is white, to 1/255 along x and 1/8 along y.
    ///
    /// # Errors
    ///
    /// A picture of more than 5 × 10⁸ pixels.
    pub fn to_png(&self, dots_per_inch: f64) -> io::Result<Vec<u8>> {
        let per_mm = dots_per_inch / 25.4;
        let size = self.size_mm.map(|s| (s * per_mm).round().max(1.0));
        if size[0] * size[1] > MAX_PIXELS {
            let [w, h] = self.size_mm;
            return Err(io::Error::other(format!("{w} x {h} mm at {dots_per_inch} dots an inch are too many pixels")));
        }
        let [width, height] = size.map(|s| s as usize);
        let mut pixels = vec![255u8; width * height];
        for shape in self.shapes.iter().cloned().chain(self.labels.iter().flat_map(glyphs)) {
            fill(&shape, per_mm, &mut pixels, width);
        }
        let mut bytes = Vec::new();
        let mut encoder = Encoder::new(&mut bytes, width as u32, height as u32);
        encoder.set_color(ColorType::Grayscale);
        encoder.set_depth(BitDepth::Eight);
        encoder.set_compression(Compression::Balanced);
        let per_meter = (1000.0 * per_mm).round() as u32;
        encoder.set_pixel_dims(Some(PixelDimensions { xppu: per_meter, yppu: per_meter, unit: Unit::Meter }));
        let written = encoder.write_header().and_then(|mut w| w.write_image_data(&pixels));
        written.map_err(io::Error::other)?;
        Ok(bytes)
    }
}

/// Darkens pixels by a shape's share of them.
fn fill(shape: &Shape, per_mm: f64, pixels: &mut [u8], width: usize) {
    let height = pixels.len() / width;
    let points = || shape.loops.iter().flatten().map(|p| p[1] * per_mm);
    let (top, bottom) = points().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), y| (a.min(y), b.max(y)));
    let edges: Vec<[[f64; 2]; 2]> = shape
        .loops
        .iter()
        .flat_map(|l| (0..l.len()).map(move |i| [l[i], l[(i + 1) % l.len()]]))
        .map(|e| e.map(|p| [p[0] * per_mm, p[1] * per_mm]))
        .collect();
    let mut share = vec![0.0f64; width];
    let mut crossings = Vec::new();
    for row in top.floor().max(0.0) as usize..(bottom.ceil().max(0.0) as usize).min(height) {
        share.fill(0.0);
        for scan in 0..SCANS {
            let y = row as f64 + (scan as f64 + 0.5) / SCANS as f64;
            crossings.clear();
            // Half open: a line through a corner crosses one of its two edges.
            let crossed = edges.iter().filter(|[a, b]| (a[1] <= y) != (b[1] <= y));
            crossings.extend(crossed.map(|[a, b]| a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0])));
            crossings.sort_by(f64::total_cmp);
            for span in crossings.chunks_exact(2) {
                let (from, to) = (span[0].clamp(0.0, width as f64), span[1].clamp(0.0, width as f64));
                for x in from as usize..(to.ceil() as usize).min(width) {
                    share[x] += (to.min(x as f64 + 1.0) - from.max(x as f64)) / SCANS as f64;
                }
            }
        }
        for (pixel, share) in pixels[row * width..][..width].iter_mut().zip(&share) {
            *pixel = pixel.saturating_sub((255.0 * share).round() as u8);
        }
    }
}

/// Returns the letters of a text as shapes: those of a font of 8 × 8 cells.
fn glyphs(label: &Label) -> Vec<Shape> {
    // Capitals are seven cells high, and those of other fonts 0.72 of the size.
    let cell = 0.72 * label.size_mm / 7.0;
    // Narrower than high, so that lines are about as long as in a font of proportional width.
    let pitch = 0.8 * cell;
    let letter = |(i, c): (usize, char)| {
        let bits = font8x8::BASIC_FONTS.get(c)?;
        let loops = outlines(8, 8, |column, row| bits[row] >> column & 1 == 1);
        let left = label.at_mm[0] + 8.0 * pitch * i as f64;
        let mm = |p: [usize; 2]| [left + pitch * p[0] as f64, label.at_mm[1] + cell * (p[1] as f64 - 7.0)];
        let loops: Vec<Vec<[f64; 2]>> = loops.into_iter().map(|l| l.into_iter().map(mm).collect()).collect();
        (!loops.is_empty()).then_some(Shape { loops })
    };
    label.text.chars().enumerate().filter_map(letter).collect()
}
