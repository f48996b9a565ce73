//! Vectors that change slowly over an image, kept at a reduced size.

/// A map of vectors of `N` values over an image, at `size` points of it.
#[derive(Clone, Debug, PartialEq)]
pub struct VectorMap<const N: usize> {
    /// Number of points across and down.
    pub size: [usize; 2],
    /// Pixels of the image from one point to the next, along x and y.
    pub spacing: [f32; 2],
    /// The vector at each point, row by row.
    pub values: Vec<[f32; N]>,
}

impl<const N: usize> VectorMap<N> {
    /// Returns the vector at a place of the image, px, interpolated bilinearly; outside of the image that at its
    /// border.
    #[inline]
    pub fn at(&self, place: [f32; 2]) -> [f32; N] {
        let [w, h] = self.size;
        // The center of the first point's pixels.
        let index = |v: f32, spacing: f32, n: usize| ((v + 0.5) / spacing - 0.5).clamp(0.0, n as f32 - 1.0);
        let (x, y) = (index(place[0], self.spacing[0], w), index(place[1], self.spacing[1], h));
        let (x0, y0) = ((x as usize).min(w.saturating_sub(2)), (y as usize).min(h.saturating_sub(2)));
        let (x1, y1) = ((x0 + 1).min(w - 1), (y0 + 1).min(h - 1));
        let (fx, fy) = (x - x0 as f32, y - y0 as f32);
        let [a, b, c, d] = [(x0, y0), (x1, y0), (x0, y1), (x1, y1)].map(|(x, y)| &self.values[y * w + x]);
        std::array::from_fn(|i| {
            let (top, bottom) = (a[i] + fx * (b[i] - a[i]), c[i] + fx * (d[i] - c[i]));
            top + fy * (bottom - top)
        })
    }

    /// Returns the place in the image of point `i`, px.
    pub fn place(&self, i: usize) -> [f32; 2] {
        let [x, y] = [i % self.size[0], i / self.size[0]];
        [(x as f32 + 0.5) * self.spacing[0] - 0.5, (y as f32 + 0.5) * self.spacing[1] - 0.5]
    }
}
