//! The rectangle of an image that holds a surface.

/// A rectangle of pixels with a free ring around it, which may lie outside the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    x0: isize,
    y0: isize,
    image_width: usize,
    /// Width with the ring.
    pub w: usize,
    /// Height with the ring.
    pub h: usize,
}

impl Window {
    /// Returns the smallest window around the finite values of a map of width `width`, plus the ring; `None` when there
    /// are none.
    pub fn around(map: &[f32], width: usize) -> Option<Self> {
        let (mut x0, mut y0, mut x1, mut y1) = (usize::MAX, usize::MAX, 0, 0);
        for (i, _) in map.iter().enumerate().filter(|(_, v)| v.is_finite()) {
            let (x, y) = (i % width, i / width);
            (x0, x1) = (x0.min(x), x1.max(x));
            (y0, y1) = (y0.min(y), y1.max(y));
        }
        (x0 <= x1).then(|| Self {
            x0: x0 as isize - 1,
            y0: y0 as isize - 1,
            image_width: width,
            w: x1 - x0 + 3,
            h: y1 - y0 + 3,
        })
    }

    /// Returns the number of pixels, with the ring.
    pub(super) fn n(&self) -> usize {
        self.w * self.h
    }

    /// Returns whether pixel `i` of the window belongs to the ring.
    pub fn in_ring(&self, i: usize) -> bool {
        let (x, y) = (i % self.w, i / self.w);
        x == 0 || y == 0 || x + 1 == self.w || y + 1 == self.h
    }

    /// Returns the image's pixel of pixel `i` of the window, which is not in its ring.
    #[inline]
    pub fn at(&self, i: usize) -> usize {
        let (x, y) = (self.x0 + (i % self.w) as isize, self.y0 + (i / self.w) as isize);
        y as usize * self.image_width + x as usize
    }
}
