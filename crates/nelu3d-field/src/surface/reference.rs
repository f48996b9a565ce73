//! The plain form of a step's loss and gradients.

use super::batch::{SurfaceBatch, eikonal_samples};
use super::config::SurfaceConfig;
use super::losses::SurfaceLosses;
use crate::Real;
use crate::encoding::hash_grid::{HashGrid, reference as hash_grid};
use crate::mlp::{MlpConfig, reference as mlp};
use crate::volrend::midpoint::MidpointRay;
use crate::{loss, volrend};

/// Gradients of one step.
#[derive(Clone, Debug)]
pub struct SurfaceGradient<T> {
    /// By the parameters: the table, then the network.
    pub params: Vec<T>,
    /// By v.
    pub sharpness: T,
    /// By the ambient fractions, `[ray][k]`.
    pub ambient: Vec<T>,
}

/// Returns values in another precision; `n` times `default` if there are none.
fn widen<T: Real>(values: &[f32], n: usize, default: f64) -> Vec<T> {
    if values.is_empty() {
        return vec![T::of(default); n];
    }
    values.iter().map(|&x| T::of(x as f64)).collect()
}

/// Returns the loss of a batch and its gradients, for parameters `params` (table, then network) and `sharpness` (v).
pub fn loss_and_gradient<T: Real>(
    config: &SurfaceConfig,
    grid: &HashGrid<3>,
    network: &MlpConfig,
    params: &[T],
    sharpness: T,
    ambient: &[T],
    batch: &SurfaceBatch,
) -> (SurfaceLosses, SurfaceGradient<T>) {
    let (table, weights) = params.split_at(grid.n_params());
    let settings = &config.loss;
    let zero = T::of(0.0);
    let step = ReferenceStep { config, grid, network, table, weights, inv_s: (T::of(10.0) * sharpness).exp(), batch };
    let samples = step.samples();
    let slopes = step.eikonal_slopes(&samples);
    let rays = step.composite(&samples.sdf, &slopes.gradients, ambient);

    // Losses and their own gradients.
    let image_loss = step.image_loss(&rays);
    let mask_loss = step.mask_loss(&rays);
    let mut d_sparsity = vec![zero; samples.sdf.len()];
    let sparsity = loss::reference::sparsity(&samples.sdf, &mut d_sparsity);
    let mut d_gradients = vec![[zero; 3]; slopes.gradients.len()];
    let eikonal = loss::reference::eikonal(&slopes.gradients, &mut d_gradients);

    // Backward: first what volume rendering sends to the distances, then both roads through the field.
    let ambient = vec![zero; rays.residual.len()];
    let mut out = SurfaceGradient { params: vec![zero; params.len()], sharpness: zero, ambient };
    let mut d_sdf: Vec<T> = d_sparsity.iter().map(|&d| T::of(settings.sparsity_weight) * d).collect();
    d_gradients.iter_mut().flatten().for_each(|d| *d *= T::of(settings.eikonal_weight));
    let losses = (&image_loss, &mask_loss);
    step.render_backward(&samples.sdf, &slopes.gradients, &rays, losses, &mut d_sdf, &mut d_gradients, &mut out);
    step.field_backward(&samples, &d_sdf, &slopes, &d_gradients, &mut out.params);

    let (image, mask) = (image_loss.value.to_f64(), mask_loss.value.to_f64());
    let mut losses =
        SurfaceLosses { image, mask, eikonal: eikonal.to_f64(), sparsity: sparsity.to_f64(), ..Default::default() };
    losses.sum(settings);
    (losses, out)
}

/// What the parts of a step read.
struct ReferenceStep<'a, T> {
    config: &'a SurfaceConfig,
    grid: &'a HashGrid<3>,
    network: &'a MlpConfig,
    table: &'a [T],
    /// Parameters of the network.
    weights: &'a [T],
    inv_s: T,
    batch: &'a SurfaceBatch<'a>,
}

/// The signed distance at the samples.
struct Samples<T> {
    points: Vec<[T; 3]>,
    /// Network inputs of every sample.
    inputs: Vec<Vec<T>>,
    sdf: Vec<T>,
    /// Gradients of the distance by the network's inputs.
    d_inputs: Vec<Vec<T>>,
}

/// Composited rays.
struct Composited<T> {
    /// Codewords of the samples, `[sample][k]`.
    colors: Vec<T>,
    /// I_white, `[ray][k]`.
    white: Vec<T>,
    /// The mask of every ray.
    mask: Vec<T>,
    /// Ambient fractions, `[ray][k]`.
    ambient: Vec<T>,
    /// Compositing weights of the samples.
    weights: Vec<T>,
    /// Composited codewords, `[ray][k]`.
    image: Vec<T>,
    /// Opacity of every ray.
    opacity: Vec<T>,
    /// Logarithm of the transmittance behind every ray's last sample.
    log_transmittance: Vec<T>,
    /// Residuals of Eq. 1, `[ray][k]`.
    residual: Vec<T>,
}

/// The image loss, and its gradients by the residuals.
struct ImageLoss<T> {
    value: T,
    d_residual: Vec<T>,
}

/// The mask loss, and its gradients by opacity and log transmittance.
struct MaskLoss<T> {
    value: T,
    d_opacity: Vec<T>,
    d_log_transmittance: Vec<T>,
}

/// The distance's gradients at the samples of the eikonal loss.
struct EikonalSlopes<T> {
    samples: Vec<usize>,
    /// Jacobians of the network's inputs by the point.
    jacobians: Vec<Vec<[T; 3]>>,
    /// Gradients in space.
    gradients: Vec<[T; 3]>,
}

impl<T: Real> ReferenceStep<'_, T> {
    fn extent(&self) -> [T; 3] {
        self.config.extent.map(|x| T::of(x as f64))
    }

    /// Computes the signed distance and its gradient by the network's inputs, at all samples.
    fn samples(&self) -> Samples<T> {
        let zero = T::of(0.0);
        let points: Vec<[T; 3]> = self.batch.points.iter().map(|x| x.map(|x| T::of(x as f64))).collect();
        let input = |&x: &[T; 3]| {
            let mut input = vec![zero; self.grid.n_features()];
            hash_grid::forward(self.grid, self.table, x, &mut input);
            if self.config.field.append_position {
                input.extend(x.map(|x| T::of(2.0) * x - T::of(1.0)));
            }
            input
        };
        let inputs: Vec<Vec<T>> = points.iter().map(input).collect();
        let mut unused = vec![zero; self.weights.len()];
        let (mut sdf, mut d_inputs) = (vec![zero; points.len()], vec![vec![zero; self.network.n_inputs]; points.len()]);
        let one = [T::of(1.0)];
        for (i, input) in inputs.iter().enumerate() {
            mlp::forward(self.network, self.weights, input, &mut sdf[i..=i]);
            mlp::backward(self.network, self.weights, input, &one, &mut unused, &mut d_inputs[i]);
        }
        Samples { points, inputs, sdf, d_inputs }
    }

    /// Composites the rays, Eq. 1.
    fn composite(&self, sdf: &[T], gradients: &[[T; 3]], ambient: &[T]) -> Composited<T> {
        let (batch, zero, one) = (self.batch, T::of(0.0), T::of(1.0));
        let (n_rays, k) = (batch.n_rays(), batch.k());
        let colors: Vec<T> = widen(batch.colors, sdf.len() * k, 0.0);
        let measured: Vec<T> = widen(batch.measured, n_rays * k, 0.0);
        let mask: Vec<T> = widen(batch.mask, n_rays, 0.0);
        let ambient = if ambient.is_empty() { vec![zero; n_rays * k] } else { ambient.to_vec() };
        let mut weights = vec![zero; sdf.len()];
        let (mut image, mut opacity) = (vec![zero; n_rays * k], vec![zero; n_rays]);
        let mut log_transmittance = Vec::with_capacity(n_rays);
        for r in 0..n_rays {
            let samples = batch.offsets[r]..batch.offsets[r + 1];
            log_transmittance.push(self.composite_ray(r, sdf, gradients, &mut weights[samples.clone()]));
            let ray = &weights[samples.clone()];
            volrend::reference::accumulate(ray, &colors[samples.start * k..samples.end * k], &mut image[r * k..][..k]);
            opacity[r] = ray.iter().copied().sum();
        }
        let residual = (0..n_rays * k).map(|i| image[i] * (one - ambient[i]) + ambient[i] - measured[i]).collect();
        let white = widen(batch.white, n_rays * k, 1.0);
        Composited { colors, white, mask, ambient, weights, image, opacity, log_transmittance, residual }
    }

    /// Writes the weights of a ray's samples; returns the logarithm of the transmittance behind the last.
    fn composite_ray(&self, r: usize, sdf: &[T], gradients: &[[T; 3]], weights: &mut [T]) -> T {
        let samples = self.batch.offsets[r]..self.batch.offsets[r + 1];
        let Some(lengths) = self.lengths(r) else {
            volrend::reference::render_weights(&sdf[samples.clone()], self.inv_s, weights);
            return volrend::reference::log_transmittance(&sdf[samples], self.inv_s);
        };
        let ray = self.midpoints(r, &sdf[samples.clone()], &gradients[samples], &lengths);
        let mut out = Vec::new();
        let left = volrend::midpoint::composite(&ray, &mut out);
        weights.iter_mut().zip(out).for_each(|(w, m)| *w = m.weight);
        left.ln()
    }

    /// Returns the lengths of a ray's intervals, if its samples are midpoints.
    fn lengths(&self, r: usize) -> Option<Vec<T>> {
        let batch = self.batch;
        batch.intervals.map(|i| widen(&i.lengths[batch.offsets[r]..batch.offsets[r + 1]], 0, 0.0))
    }

    /// Returns a ray as its midpoints.
    fn midpoints<'a>(&self, r: usize, sdf: &'a [T], gradients: &'a [[T; 3]], lengths: &'a [T]) -> MidpointRay<'a, T> {
        let intervals = self.batch.intervals.expect("a ray of midpoints");
        let dir = intervals.dirs[r].map(|x| T::of(x as f64));
        MidpointRay { sdf, gradients, lengths, dir, anneal: T::of(intervals.anneal as f64), inv_s: self.inv_s }
    }

    /// Computes the image loss, Eq. 4.
    fn image_loss(&self, rays: &Composited<T>) -> ImageLoss<T> {
        let settings = &self.config.loss;
        let (alpha, one, n) = (T::of(settings.lookup_loss_weight), T::of(1.0), rays.residual.len());
        let (mut d_lookup, mut d_pattern) = (vec![T::of(0.0); n], vec![T::of(0.0); n]);
        let lookup = loss::reference::lookup(settings.norms, &rays.residual, &mut d_lookup);
        let pattern = loss::reference::pattern(settings.norms, &rays.residual, &rays.white, &mut d_pattern);
        let d = |(p, l): (&T, &T)| (one - alpha) * *p + alpha * *l;
        let d_residual = d_pattern.iter().zip(&d_lookup).map(d).collect();
        ImageLoss { value: (one - alpha) * pattern + alpha * lookup, d_residual }
    }

    /// Computes the mask loss, Eq. 5.
    fn mask_loss(&self, rays: &Composited<T>) -> MaskLoss<T> {
        let n_rays = self.batch.n_rays();
        let (mut d_opacity, mut d_log_transmittance) = (vec![T::of(0.0); n_rays], vec![T::of(0.0); n_rays]);
        let value = if self.config.loss.clamped_mask {
            loss::reference::mask(&rays.opacity, &rays.mask, &mut d_opacity)
        } else {
            loss::reference::mask_log(&rays.log_transmittance, &rays.mask, &mut d_log_transmittance)
        };
        MaskLoss { value, d_opacity, d_log_transmittance }
    }

    /// Computes the distance's gradients in space, at the samples of the eikonal loss.
    fn eikonal_slopes(&self, all: &Samples<T>) -> EikonalSlopes<T> {
        let (zero, extent) = (T::of(0.0), self.extent());
        let samples: Vec<usize> = eikonal_samples(self.batch.offsets, self.config.loss.eikonal_every).collect();
        let jacobian = |&i: &usize| {
            let mut rows = vec![[zero; 3]; self.grid.n_features()];
            hash_grid::jacobian(self.grid, self.table, all.points[i], &mut rows);
            if self.config.field.append_position {
                // 2x − 1
                let two = T::of(2.0);
                rows.extend((0..3).map(|a| std::array::from_fn(|b| if a == b { two } else { zero })));
            }
            rows
        };
        let jacobians: Vec<Vec<[T; 3]>> = samples.iter().map(jacobian).collect();
        let gradient = |(&i, rows): (&usize, &Vec<[T; 3]>)| {
            let along = |a: usize| rows.iter().zip(&all.d_inputs[i]).map(|(row, &d)| row[a] * d).sum::<T>();
            std::array::from_fn(|a| along(a) / extent[a])
        };
        let gradients = samples.iter().zip(&jacobians).map(gradient).collect();
        EikonalSlopes { samples, jacobians, gradients }
    }

    /// Adds what the image and mask losses send through compositing to the distances, the sharpness and the ambient
    /// fractions; where samples are midpoints, to the distances' gradients too.
    fn render_backward(
        &self,
        sdf: &[T],
        gradients: &[[T; 3]],
        rays: &Composited<T>,
        (image_loss, mask_loss): (&ImageLoss<T>, &MaskLoss<T>),
        d_sdf: &mut [T],
        d_gradients: &mut [[T; 3]],
        out: &mut SurfaceGradient<T>,
    ) {
        let (k, zero, one) = (self.batch.k(), T::of(0.0), T::of(1.0));
        let mask_weight = T::of(self.config.loss.mask_weight);
        for r in 0..self.batch.n_rays() {
            let samples = self.batch.offsets[r]..self.batch.offsets[r + 1];
            let mut d_image = vec![zero; k];
            for (c, d_image) in d_image.iter_mut().enumerate() {
                let i = r * k + c;
                let d_residual = image_loss.d_residual[i];
                *d_image = d_residual * (one - rays.ambient[i]);
                out.ambient[i] = d_residual * (one - rays.image[i]);
            }
            let mut d_weights = vec![mask_weight * mask_loss.d_opacity[r]; samples.len()];
            let mut frozen = vec![zero; samples.len() * k];
            let colors = &rays.colors[samples.start * k..samples.end * k];
            let weights = &rays.weights[samples.clone()];
            volrend::reference::accumulate_backward(weights, colors, &d_image, &mut d_weights, &mut frozen);
            let mut d_ray = vec![zero; samples.len()];
            let d_log = mask_weight * mask_loss.d_log_transmittance[r];
            let sdf = &sdf[samples.clone()];
            let d_inv_s = if let Some(lengths) = self.lengths(r) {
                let along = self.midpoints(r, sdf, &gradients[samples.clone()], &lengths);
                let (mut out, mut d_g) = (Vec::new(), vec![[zero; 3]; samples.len()]);
                volrend::midpoint::composite(&along, &mut out);
                let d_inv_s =
                    volrend::midpoint::composite_backward(&along, &out, &d_weights, d_log, &[], &mut d_ray, &mut d_g);
                let more = d_g.as_flattened();
                d_gradients[samples.clone()].as_flattened_mut().iter_mut().zip(more).for_each(|(d, more)| *d += *more);
                d_inv_s
            } else {
                volrend::reference::render_weights_backward(sdf, self.inv_s, &d_weights, d_log, &mut d_ray)
            };
            out.sharpness += T::of(10.0) * self.inv_s * d_inv_s;
            d_sdf[samples].iter_mut().zip(d_ray).for_each(|(d, more)| *d += more);
        }
    }

    /// Adds what the distances and their gradients send to the parameters.
    fn field_backward(
        &self,
        samples: &Samples<T>,
        d_sdf: &[T],
        slopes: &EikonalSlopes<T>,
        d_gradients: &[[T; 3]],
        d_params: &mut [T],
    ) {
        let (grid, network, weights) = (self.grid, self.network, self.weights);
        let (extent, n_features) = (self.extent(), grid.n_features());
        let (d_table, d_network) = d_params.split_at_mut(self.table.len());
        let mut d_input = vec![T::of(0.0); network.n_inputs];
        for (i, input) in samples.inputs.iter().enumerate() {
            mlp::backward(network, weights, input, &[d_sdf[i]], d_network, &mut d_input);
            hash_grid::backward(grid, samples.points[i], &d_input[..n_features], d_table);
        }
        for ((&i, rows), d) in slopes.samples.iter().zip(&slopes.jacobians).zip(d_gradients) {
            let u: [T; 3] = std::array::from_fn(|a| d[a] / extent[a]);
            let v: Vec<T> = rows.iter().map(|row| row.iter().zip(u).map(|(&j, u)| j * u).sum()).collect();
            mlp::backward_gradient(network, weights, &samples.inputs[i], &[T::of(1.0)], &v, d_network);
            hash_grid::backward_jacobian(grid, samples.points[i], &samples.d_inputs[i][..n_features], u, d_table);
        }
    }
}
