//! Plain form of a step's loss and gradients.

use super::{SurfaceBatch, SurfaceConfig, SurfaceLosses, eikonal_samples};
use crate::Real;
use crate::encoding::hash_grid::{HashGrid, reference as hash_grid};
use crate::mlp::{MlpConfig, reference as mlp};
use crate::{loss, volrend};

/// Gradients of one step.
#[derive(Clone, Debug)]
pub struct SurfaceGradient<T> {
    /// Of the table, then the network.
    pub params: Vec<T>,
    /// Of v.
    pub sharpness: T,
    /// Of the ambient shares, `[ray][k]`.
    pub ambient: Vec<T>,
}

fn widen<T: Real>(values: &[f32], n: usize, default: f64) -> Vec<T> {
    if values.is_empty() {
        return vec![T::of(default); n];
    }
    values.iter().map(|&x| T::of(x as f64)).collect()
}

/// Loss of a batch and its gradients, for parameters `params` (table, then network) and `sharpness` (v).
pub fn loss_and_gradient<T: Real>(
    config: &SurfaceConfig,
    grid: &HashGrid<3>,
    network: &MlpConfig,
    params: &[T],
    sharpness: T,
    ambient: &[T],
    batch: &SurfaceBatch,
) -> (SurfaceLosses, SurfaceGradient<T>) {
    let (n_rays, n, k) = (batch.n_rays(), batch.points.len(), batch.k());
    let (table, weights_of_network) = params.split_at(grid.n_params());
    let settings = &config.loss;
    let zero = T::of(0.0);
    let extent = config.extent.map(|x| T::of(x as f64));
    let points: Vec<[T; 3]> = batch.points.iter().map(|x| x.map(|x| T::of(x as f64))).collect();

    // The signed distance and its gradient by the network's inputs, everywhere.
    let inputs: Vec<Vec<T>> = points
        .iter()
        .map(|&x| {
            let mut input = vec![zero; grid.n_features()];
            hash_grid::forward(grid, table, x, &mut input);
            if config.field.append_position {
                input.extend(x);
            }
            input
        })
        .collect();
    let mut unused = vec![zero; weights_of_network.len()];
    let (mut sdf, mut d_inputs) = (vec![zero; n], vec![vec![zero; network.n_inputs]; n]);
    for i in 0..n {
        mlp::forward(network, weights_of_network, &inputs[i], &mut sdf[i..=i]);
        mlp::backward(network, weights_of_network, &inputs[i], &[T::of(1.0)], &mut unused, &mut d_inputs[i]);
    }

    // Compositing.
    let inv_s = (T::of(10.0) * sharpness).exp();
    let colors: Vec<T> = widen(batch.colors, n * k, 0.0);
    let (measured, white): (Vec<T>, Vec<T>) =
        (widen(batch.measured, n_rays * k, 0.0), widen(batch.white, n_rays * k, 1.0));
    let mask: Vec<T> = widen(batch.mask, n_rays, 0.0);
    let ambient = if ambient.is_empty() { vec![zero; n_rays * k] } else { ambient.to_vec() };
    let mut weights = vec![zero; n];
    let (mut image, mut opacity) = (vec![zero; n_rays * k], vec![zero; n_rays]);
    for r in 0..n_rays {
        let samples = batch.offsets[r]..batch.offsets[r + 1];
        volrend::reference::render_weights(&sdf[samples.clone()], inv_s, &mut weights[samples.clone()]);
        let ray = &weights[samples.clone()];
        volrend::reference::accumulate(ray, &colors[samples.start * k..samples.end * k], &mut image[r * k..][..k]);
        opacity[r] = ray.iter().copied().sum();
    }
    let one = T::of(1.0);
    // A background ray has no codeword.
    let lit = mask.clone();
    let residual: Vec<T> =
        (0..n_rays * k).map(|i| lit[i / k] * (image[i] * (one - ambient[i]) + ambient[i] - measured[i])).collect();

    // Losses.
    let alpha = T::of(settings.lookup_loss_weight);
    let (mut d_lookup, mut d_pattern) = (vec![zero; n_rays * k], vec![zero; n_rays * k]);
    let lookup = loss::reference::lookup(settings.norms, &residual, &mut d_lookup);
    let pattern = loss::reference::pattern(settings.norms, &residual, &white, &mut d_pattern);
    let (mut d_opacity, mut d_log_transmittance) = (vec![zero; n_rays], vec![zero; n_rays]);
    let mask = if settings.clamped_mask {
        loss::reference::mask(&opacity, &mask, &mut d_opacity)
    } else {
        let rays = batch.offsets.windows(2);
        let log_transmittance: Vec<T> =
            rays.map(|r| volrend::reference::log_transmittance(&sdf[r[0]..r[1]], inv_s)).collect();
        loss::reference::mask_log(&log_transmittance, &mask, &mut d_log_transmittance)
    };
    let mut d_sparsity = vec![zero; n];
    let sparsity = loss::reference::sparsity(&sdf, &mut d_sparsity);
    let eikonal_samples: Vec<usize> = eikonal_samples(batch.offsets, settings.eikonal_every).collect();
    let jacobians: Vec<Vec<[T; 3]>> = eikonal_samples
        .iter()
        .map(|&i| {
            let mut rows = vec![[zero; 3]; grid.n_features()];
            hash_grid::jacobian(grid, table, points[i], &mut rows);
            if config.field.append_position {
                rows.extend((0..3).map(|a| std::array::from_fn(|b| if a == b { one } else { zero })));
            }
            rows
        })
        .collect();
    let gradients: Vec<[T; 3]> = eikonal_samples
        .iter()
        .zip(&jacobians)
        .map(|(&i, rows)| {
            std::array::from_fn(|a| rows.iter().zip(&d_inputs[i]).map(|(row, &d)| row[a] * d).sum::<T>() / extent[a])
        })
        .collect();
    let mut d_gradients = vec![[zero; 3]; gradients.len()];
    let eikonal = loss::reference::eikonal(&gradients, &mut d_gradients);

    // Backward: first what volume rendering sends to the distances, then both roads through the field.
    let mut out =
        SurfaceGradient { params: vec![zero; params.len()], sharpness: zero, ambient: vec![zero; n_rays * k] };
    let mut d_sdf: Vec<T> = d_sparsity.iter().map(|&d| T::of(settings.sparsity_weight) * d).collect();
    for r in 0..n_rays {
        let samples = batch.offsets[r]..batch.offsets[r + 1];
        let mut d_image = vec![zero; k];
        for (c, d_image) in d_image.iter_mut().enumerate() {
            let i = r * k + c;
            let d_residual = lit[r] * ((one - alpha) * d_pattern[i] + alpha * d_lookup[i]);
            *d_image = d_residual * (one - ambient[i]);
            out.ambient[i] = d_residual * (one - image[i]);
        }
        let mut d_weights = vec![T::of(settings.mask_weight) * d_opacity[r]; samples.len()];
        let mut frozen = vec![zero; samples.len() * k];
        let colors = &colors[samples.start * k..samples.end * k];
        volrend::reference::accumulate_backward(
            &weights[samples.clone()],
            colors,
            &d_image,
            &mut d_weights,
            &mut frozen,
        );
        let mut d_ray = vec![zero; samples.len()];
        let d_log = T::of(settings.mask_weight) * d_log_transmittance[r];
        let sdf = &sdf[samples.clone()];
        let d_inv_s = volrend::reference::render_weights_backward(sdf, inv_s, &d_weights, d_log, &mut d_ray);
        out.sharpness += T::of(10.0) * inv_s * d_inv_s;
        d_sdf[samples].iter_mut().zip(d_ray).for_each(|(d, more)| *d += more);
    }
    let (d_table, d_network) = out.params.split_at_mut(table.len());
    let mut d_input = vec![zero; network.n_inputs];
    for i in 0..n {
        mlp::backward(network, weights_of_network, &inputs[i], &[d_sdf[i]], d_network, &mut d_input);
        hash_grid::backward(grid, points[i], &d_input[..grid.n_features()], d_table);
    }
    for ((&i, rows), d) in eikonal_samples.iter().zip(&jacobians).zip(&d_gradients) {
        let u: [T; 3] = std::array::from_fn(|a| T::of(settings.eikonal_weight) * d[a] / extent[a]);
        let v: Vec<T> = rows.iter().map(|row| row.iter().zip(u).map(|(&j, u)| j * u).sum()).collect();
        mlp::backward_gradient(network, weights_of_network, &inputs[i], &[one], &v, d_network);
        hash_grid::backward_jacobian(grid, points[i], &d_inputs[i][..grid.n_features()], u, d_table);
    }

    let image = ((one - alpha) * pattern + alpha * lookup).to_f64();
    let (mask, eikonal, sparsity) = (mask.to_f64(), eikonal.to_f64(), sparsity.to_f64());
    let total =
        image + settings.mask_weight * mask + settings.eikonal_weight * eikonal + settings.sparsity_weight * sparsity;
    (SurfaceLosses { total, image, mask, eikonal, sparsity }, out)
}
