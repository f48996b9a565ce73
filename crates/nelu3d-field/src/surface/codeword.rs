//! The image formation of NeLU3D: codewords of a frozen color field, and an ambient share.

use super::batch::SurfaceBatch;
use super::config::SurfaceLoss;
use super::ray_loss::{RayGradient, RayLoss, RayScratch};
use crate::loss::cpu as loss;
use crate::volrend::cpu as volrend;
use crate::volrend::midpoint::{self, MidpointRay};

/// The codewords of a batch. Sends the gradient of the ambient fractions back.
pub(super) struct Codewords<'a> {
    pub(super) batch: &'a SurfaceBatch<'a>,
    pub(super) settings: &'a SurfaceLoss,
}

impl RayLoss for Codewords<'_> {
    #[inline(always)]
    fn needs_gradients(&self) -> bool {
        self.batch.intervals.is_some()
    }

    #[inline(always)]
    fn n_ray_outputs(&self) -> usize {
        self.batch.k()
    }

    #[inline(always)]
    fn n_sample_outputs(&self) -> usize {
        0
    }

    #[inline(always)]
    fn ray(
        &self,
        r: usize,
        sdf: &[f32],
        gradients: &[[f32; 3]],
        inv_s: f64,
        scratch: &mut RayScratch,
        out: RayGradient<'_>,
    ) {
        let Self { batch, settings } = self;
        let RayScratch { buffers: [weights, d_weights, image, _], steps, midpoints } = scratch;
        let k = batch.k();
        let n_rays = batch.n_rays();
        let image_scale = 1.0 / (n_rays * k).max(1) as f64;
        let alpha = settings.lookup_loss_weight as f32;
        let mask_scale = 1.0 / n_rays as f64;
        let d_mask = (settings.mask_weight * mask_scale) as f32;
        weights.resize(sdf.len(), 0.0);
        d_weights.resize(sdf.len(), 0.0);
        image.resize(k, 0.0);
        let along = batch.intervals.map(|intervals| MidpointRay {
            sdf,
            gradients,
            lengths: &intervals.lengths[batch.offsets[r]..batch.offsets[r + 1]],
            dir: intervals.dirs[r],
            anneal: intervals.anneal,
            inv_s: inv_s as f32,
        });
        let log_transmittance = match &along {
            Some(along) => {
                let left = midpoint::composite(along, midpoints);
                weights.iter_mut().zip(&*midpoints).for_each(|(w, m)| *w = m.weight);
                (left as f64).max(f64::MIN_POSITIVE).ln()
            }
            None => {
                volrend::forward_ray(sdf, inv_s, weights, steps);
                volrend::log_transmittance(steps)
            }
        };
        let colors = &batch.colors[batch.offsets[r] * k..batch.offsets[r + 1] * k];
        image.fill(0.0);
        let mut opacity = 0.0f64;
        for (&w, colors) in weights.iter().zip(colors.chunks_exact(k.max(1))) {
            opacity += w as f64;
            image.iter_mut().zip(colors).for_each(|(sum, c)| *sum += w * c);
        }
        let mut image_loss = 0.0;
        for (c, image) in image.iter_mut().enumerate() {
            let i = r * k + c;
            let a = batch.ambient.get(i).copied().unwrap_or(0.0);
            let white = batch.white.get(i).copied().unwrap_or(1.0);
            let residual = *image * (1.0 - a) + a - batch.measured[i];
            let (lookup, d_lookup) = loss::robust_at(settings.norms, residual);
            let (pattern, d_pattern) = loss::robust_at(settings.norms, white * residual);
            image_loss += ((1.0 - alpha) * pattern + alpha * lookup) as f64;
            let d = ((1.0 - alpha) * white * d_pattern + alpha * d_lookup) * image_scale as f32;
            out.ray[c] = d * (1.0 - *image);
            // From here on its gradient.
            *image = d * (1.0 - a);
        }
        let (mask_loss, slope, d_log_transmittance) = if settings.clamped_mask {
            let (value, slope) = loss::mask_at(opacity as f32, batch.mask[r]);
            (value as f64, slope, 0.0)
        } else {
            let (value, slope) = loss::mask_log_at(log_transmittance, batch.mask[r] as f64);
            (value, 0.0, d_mask as f64 * slope)
        };
        for (d, colors) in d_weights.iter_mut().zip(colors.chunks_exact(k.max(1))) {
            *d = d_mask * slope + image.iter().zip(colors).map(|(d, c)| d * c).sum::<f32>();
        }
        *out.d_inv_s += match &along {
            Some(along) => {
                let d_log = d_log_transmittance as f32;
                let (d_sdf, d_gradients) = (out.d_sdf, out.d_gradients);
                midpoint::composite_backward(along, midpoints, d_weights, d_log, &[], d_sdf, d_gradients) as f64
            }
            None => volrend::backward_ray(sdf, inv_s, weights, steps, d_weights, d_log_transmittance, out.d_sdf),
        };
        out.losses.image += image_loss * image_scale;
        out.losses.mask += mask_loss * mask_scale;
    }
}
