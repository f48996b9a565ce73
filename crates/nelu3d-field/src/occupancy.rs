//! Occupancy grid: which cells of the unit cube volume rendering need not look into (Müller et al. 2022, Sec. 5.1; Li
//! et al. 2023, *NerfAcc*, Sec. 4.1).
//!
//! A cell holds a decaying maximum of the alphas seen at random points in it, and is occupied where that exceeds a
//! threshold. Which cells exist at all is the caller's: those that no ray can reach are never looked at.

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};
use std::io::{self, Read, Write};

use crate::state::{TrainingState, other_configuration, read_floats, read_u64, write_floats, write_u64};

/// Settings of an [`OccupancyGrid`]; the defaults are those of NerfAcc 0.3, with the threshold of TurboSL.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OccupancyConfig {
    /// Cells per axis.
    pub resolution: usize,
    /// Alpha above which a cell is occupied (or the mean over all cells, if that is less).
    pub threshold: f32,
    /// Factor on a cell's value whenever it is looked at again.
    pub decay: f32,
    /// Steps between two updates.
    pub every: u64,
    /// Steps until which every cell is looked at; later a quarter of them, and as many of the occupied ones.
    pub n_warmup_steps: u64,
}

impl Default for OccupancyConfig {
    fn default() -> Self {
        Self { resolution: 128, threshold: 1e-3, decay: 0.95, every: 16, n_warmup_steps: 256 }
    }
}

/// The cells of the unit cube in which volume rendering looks for a surface.
#[derive(Clone, Debug)]
pub struct OccupancyGrid {
    pub(crate) config: OccupancyConfig,
    /// Cells that exist, ascending.
    pub(crate) cells: Vec<u32>,
    /// Value of every cell of the cube, x fastest.
    pub(crate) values: Vec<f32>,
    pub(crate) occupied: Vec<u64>,
}

impl OccupancyGrid {
    /// Makes a grid all of whose cells for which `exists` (given the center) are occupied.
    pub fn new(config: OccupancyConfig, exists: impl Fn([f32; 3]) -> bool) -> Self {
        let n = config.resolution;
        assert!((1..=1024).contains(&n), "an occupancy grid has 1 to 1024 cells per axis, not {n}");
        let mut grid = Self {
            config,
            cells: Vec::new(),
            values: vec![0.0; n * n * n],
            occupied: vec![0; (n * n * n).div_ceil(64)],
        };
        grid.cells = (0..(n * n * n) as u32).filter(|&c| exists(grid.point(c, [0.5; 3]))).collect();
        for &c in &grid.cells {
            grid.occupied[c as usize / 64] |= 1 << (c % 64);
        }
        grid
    }

    /// Returns the point of a cell at a position within it.
    fn point(&self, cell: u32, within: [f32; 3]) -> [f32; 3] {
        let n = self.config.resolution as u32;
        let corner = [cell % n, cell / n % n, cell / n / n];
        std::array::from_fn(|a| (corner[a] as f32 + within[a]) / n as f32)
    }

    /// Returns whether a point of the unit cube lies in an occupied cell.
    #[inline]
    pub fn is_occupied(&self, point: [f32; 3]) -> bool {
        let n = self.config.resolution;
        let mut cell = 0;
        for a in (0..3).rev() {
            let along = point[a] * n as f32;
            if !(along >= 0.0 && along < n as f32) {
                return false;
            }
            cell = cell * n + along as usize;
        }
        self.occupied[cell / 64] >> (cell % 64) & 1 == 1
    }

    /// Returns the fraction of the existing cells that are occupied.
    pub fn occupied_fraction(&self) -> f64 {
        let occupied: u32 = self.occupied.iter().map(|bits| bits.count_ones()).sum();
        occupied as f64 / self.cells.len().max(1) as f64
    }

    /// Looks at cells again if it is time: `alpha` is given random points in them and writes what is seen there.
    pub fn update(&mut self, step: u64, seed: u64, alpha: impl FnOnce(&[[f32; 3]], &mut [f32])) {
        let OccupancyConfig { threshold, decay, every, n_warmup_steps, .. } = self.config;
        if !step.is_multiple_of(every) || self.cells.is_empty() {
            return;
        }
        let mut rng = StdRng::seed_from_u64(seed ^ step.wrapping_mul(0x9E37_79B9_7F4A_7C15));
        let cells = if step < n_warmup_steps {
            self.cells.clone()
        } else {
            let n = self.cells.len().div_ceil(4);
            let mut some: Vec<u32> = (0..n).map(|_| self.cells[rng.random_range(0..self.cells.len())]).collect();
            let occupied: Vec<u32> =
                self.cells.iter().copied().filter(|&c| self.occupied[c as usize / 64] >> (c % 64) & 1 == 1).collect();
            if occupied.len() <= n {
                some.extend(occupied);
            } else {
                some.extend((0..n).map(|_| occupied[rng.random_range(0..occupied.len())]));
            }
            // In order: neighbors share what they read.
            some.sort_unstable();
            some.dedup();
            some
        };
        let points: Vec<[f32; 3]> =
            cells.iter().map(|&c| self.point(c, std::array::from_fn(|_| rng.random()))).collect();
        let mut alphas = vec![0.0; points.len()];
        alpha(&points, &mut alphas);
        for (&c, a) in cells.iter().zip(alphas) {
            let value = &mut self.values[c as usize];
            *value = (*value * decay).max(a);
        }
        let sum: f64 = self.cells.iter().map(|&c| self.values[c as usize] as f64).sum();
        let threshold = threshold.min((sum / self.cells.len() as f64) as f32);
        self.occupied.fill(0);
        for &c in &self.cells {
            if self.values[c as usize] > threshold {
                self.occupied[c as usize / 64] |= 1 << (c % 64);
            }
        }
    }
}

impl TrainingState for OccupancyGrid {
    fn save(&self, out: &mut dyn Write) -> io::Result<()> {
        write_u64(out, self.cells.len() as u64)?;
        write_floats(out, &self.values)?;
        self.occupied.iter().try_for_each(|bits| write_u64(out, *bits))
    }

    fn load(&mut self, from: &mut dyn Read) -> io::Result<()> {
        if read_u64(from)? != self.cells.len() as u64 {
            return Err(other_configuration());
        }
        read_floats(from, &mut self.values)?;
        for bits in &mut self.occupied {
            *bits = read_u64(from)?;
        }
        Ok(())
    }
}
