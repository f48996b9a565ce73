//! What a step of the refinement asks of the machine besides its kernels, for `nelu3d bench`: counted by hand from the
//! code, the maps of a window that are read and written, and the operations on them.

use nelu3d_field::bench::Demand;

/// Sizes of a window.
#[derive(Clone, Copy)]
pub(super) struct WindowDemand {
    /// Pixels.
    pub(super) n: usize,
    /// Pattern channels.
    pub(super) k: usize,
    /// Color channels.
    pub(super) channels: usize,
}

/// Operations, and values read and written, of a mean over squares, per pixel: sums along rows and columns.
const BOX_MEAN: [f64; 2] = [6.0, 4.0];

impl WindowDemand {
    fn of(&self, flops: f64, values: f64) -> Demand {
        let n = self.n as f64;
        Demand { flops: n * flops, bytes: n * 4.0 * values, ..Demand::default() }
    }

    /// Light fractions: the albedo, the equations, which are averaged twice, and their solution.
    pub(super) fn fractions(&self) -> Demand {
        let (k, c) = (self.k as f64, self.channels as f64);
        let flops = 2.0 * 16.0 * k + c * (5.0 * 2.0 * BOX_MEAN[0] + 50.0);
        let values = 2.0 * 5.0 * k + c * (5.0 * (3.0 + 2.0 * BOX_MEAN[1]) + 12.0);
        self.of(flops, values)
    }

    /// The normal equation of every pixel.
    pub(super) fn data_term(&self) -> Demand {
        let (k, c) = (self.k as f64, self.channels as f64);
        self.of(20.0 * k + 10.0, 6.0 * k + 3.0 * c + 4.0)
    }

    /// The weights of the prior: three differences, the means of two maps for each.
    pub(super) fn prior(&self) -> Demand {
        self.of(3.0 * (2.0 * BOX_MEAN[0] + 20.0), 3.0 * (2.0 * BOX_MEAN[1] + 6.0))
    }

    /// The surface's roughness: means over squares of 40 maps, and of two for each of three differences and three squares.
    pub(super) fn roughness(&self) -> Demand {
        self.of(58.0 * BOX_MEAN[0] + 100.0, 58.0 * BOX_MEAN[1] + 120.0)
    }

    /// The uncertainty: means over squares of the maps of every channel, and of eight others.
    pub(super) fn sigma(&self) -> Demand {
        let k = self.k as f64;
        self.of(k * (3.0 * BOX_MEAN[0] + 30.0) + 16.0 * BOX_MEAN[0] + 60.0, k * (3.0 * BOX_MEAN[1] + 14.0) + 64.0)
    }
}
