//! The pixel's response to light beside its center: its own area and the lens's Gaussian blur, over subsamples.

/// A separable filter over lines of n subsamples per pixel.
#[derive(Clone, Debug)]
pub struct PixelFilter {
    n: usize,
    /// Subsamples it reaches beyond the pixel's own on either side.
    radius: usize,
    /// Weights of the subsamples from −radius to n + radius of the pixel's first; their sum is 1.
    taps: Vec<f32>,
}

impl PixelFilter {
    /// Returns the filter of `n` subsamples per pixel and a blur of standard deviation `sigma_px`.
    pub fn new(n: usize, sigma_px: f64) -> Self {
        let sigma = sigma_px * n as f64;
        let radius = (4.0 * sigma).ceil() as usize;
        let gauss: Vec<f64> = (0..=2 * radius)
            .map(|i| if radius == 0 { 1.0 } else { (-0.5 * ((i as f64 - radius as f64) / sigma).powi(2)).exp() })
            .collect();
        // The pixel's area is n equal taps; its convolution with the Gaussian:
        let mut taps = vec![0.0; n + 2 * radius];
        for (i, g) in gauss.iter().enumerate() {
            for tap in &mut taps[i..i + n] {
                *tap += g;
            }
        }
        let total: f64 = taps.iter().sum();
        Self { n, radius, taps: taps.iter().map(|t| (t / total) as f32).collect() }
    }

    /// Returns the number of subsamples it reaches beyond the pixel, on either side.
    pub fn radius(&self) -> usize {
        self.radius
    }

    /// Returns the number of pixels it reaches beyond the image.
    pub(crate) fn margin_px(&self) -> usize {
        self.radius.div_ceil(self.n)
    }

    /// Returns the weight of a subsample by its offset to the pixel's first; 0 beyond its reach. The weights' sum is 1.
    pub fn weight(&self, offset: i64) -> f32 {
        usize::try_from(offset + self.radius as i64).ok().and_then(|i| self.taps.get(i)).copied().unwrap_or(0.0)
    }

    /// Filters a line of subsamples (with `radius` more on either side) to a line of pixels, of `values` (1 or 3) each.
    pub(crate) fn reduce_line(&self, line: &[f32], values: usize, pixels: &mut [f32]) {
        match values {
            1 => self.reduce::<1>(line, pixels),
            3 => self.reduce::<3>(line, pixels),
            _ => panic!("images of {values} channels"),
        }
    }

    fn reduce<const N: usize>(&self, line: &[f32], pixels: &mut [f32]) {
        let (samples, pixels) = (line.as_chunks::<N>().0, pixels.as_chunks_mut::<N>().0);
        for (pixel, samples) in pixels.iter_mut().zip(samples.windows(self.taps.len()).step_by(self.n)) {
            let mut sum = [0.0; N];
            for (tap, sample) in self.taps.iter().zip(samples) {
                for (s, v) in sum.iter_mut().zip(sample) {
                    *s += tap * v;
                }
            }
            *pixel = sum;
        }
    }
}
