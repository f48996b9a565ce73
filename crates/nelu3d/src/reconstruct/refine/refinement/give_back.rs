//! What the prior took from the surface, and the uncertainty of what is left.

use rayon::prelude::*;

use super::Refinement;
use super::strip::Strip;
use crate::reconstruct::refine::smoothed_away::smoothed_away;
use crate::reconstruct::refine::uncertainty::{self, Nuisances, systematic};

impl Refinement<'_> {
    /// Gives back what the prior took from the surface, and returns one standard deviation of the unknown per pixel of
    /// the window.
    pub(super) fn give_back(&mut self) -> Vec<f32> {
        let mut sigma = Vec::with_capacity(self.x.len());
        let mut change = Vec::with_capacity(self.x.len());
        for strip in self.strips() {
            let of_strip = self.give_back_to_strip(&strip);
            for (all, some) in [&mut sigma, &mut change].into_iter().zip(&of_strip) {
                all.extend_from_slice(strip.own(some));
            }
        }
        self.x.iter_mut().zip(change).for_each(|(x, change)| *x += change);
        sigma
    }

    /// Returns one standard deviation of the unknown per pixel of a strip, and by how much it changes where what the
    /// prior took is given back.
    fn give_back_to_strip(&self, strip: &Strip) -> [Vec<f32>; 2] {
        let (m, k, w) = (&self.scene.measurements, self.scene.measurements.k, self.window.w);
        let Strip { rows, start, prior, information, posterior, .. } = strip;
        let (start, n) = (*start, prior.active.len());
        let (mut whitened, mut slopes) = (vec![0.0f32; n * k], vec![0.0f32; n * k]);
        let (mut offset, mut gain) = (vec![0.0f32; n * k], vec![0.0f32; n * k]);
        whitened
            .par_chunks_exact_mut(k)
            .zip(slopes.par_chunks_exact_mut(k))
            .zip(offset.par_chunks_exact_mut(k).zip(gain.par_chunks_exact_mut(k)))
            .enumerate()
            .filter(|(at, _)| prior.active[*at])
            .for_each(|(at, ((whitened, slopes), (offset, gain)))| {
                let i = start + at;
                let px = self.window.at(i);
                for j in 0..k {
                    let weight = m.inv_var[px * k + j].sqrt();
                    whitened[j] = weight * self.residual(i, px, j);
                    slopes[j] = weight * self.rendered[i * 2 * k + k + j];
                    offset[j] = weight;
                    gain[j] = weight * self.rendered[i * 2 * k + j];
                }
            });
        let nuisances = Nuisances { offset: &offset, gain: &gain, patterns: k / self.channels };
        let systematic =
            systematic(&whitened, &slopes, &nuisances, k, &prior.active, [w, rows.len()], &posterior.pixels);
        let factor = |at: usize, pixels: f32| self.depth_noise_factor(start + at, pixels);
        let x = &self.x[start..start + n];
        let mut sigma = uncertainty::sigma(prior, posterior, x, information, &systematic, factor);
        // What neighbors share of errors is no shape either, and as much of it is smoothed away as of noise.
        let ratio = uncertainty::noise_ratio(prior, information);
        let error = |i: usize| {
            let noise = ratio[i] * factor(i, posterior.pixels[i]) * posterior.noise[i];
            posterior.smoothed_away[i] * (noise + systematic.variance[i]) / posterior.noise[i]
        };
        let noise: Vec<f32> = (0..n).into_par_iter().map(|i| if prior.active[i] { error(i) } else { 0.0 }).collect();
        // By the information that the last step was solved with: that of the robust loss may be negative.
        let h: Vec<f32> = (0..n).map(|at| if prior.active[at] { self.data.h[start + at] } else { 0.0 }).collect();
        let away = smoothed_away(prior, &h, x, &noise);
        sigma.iter_mut().zip(&away.variance).for_each(|(s, variance)| *s = (*s * *s + variance).sqrt());
        [sigma, away.change]
    }
}
