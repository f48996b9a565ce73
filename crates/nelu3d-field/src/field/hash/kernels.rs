//! What a field computes, in the dimensions that fields have: compiled here, once. Methods that are generic over the
//! dimension would be compiled again, with all their kernels, in every crate that calls them, and in its tests.

use super::field::HashField;

macro_rules! in_dimensions {
    ($($D:literal),*) => {$(
        impl HashField<$D> {
            /// Writes the outputs of many points, in parallel: `out[point][output]`. Points outside [0, 1]^D are
            /// clamped to it.
            ///
            /// # Panics
            /// If `out` does not hold `n_outputs` values per point.
            #[inline(never)]
            pub fn query(&self, points: &[[f32; $D]], out: &mut [f32]) {
                self.query_points(points, out);
            }

            /// Writes the outputs and their derivatives by the point, in parallel: `out[point][output]`,
            /// `jacobian[point][output][axis]` per unit of [0, 1]. Along an axis where a point is clamped the
            /// derivative is 0.
            ///
            /// # Panics
            /// If `out` or `jacobian` do not hold `n_outputs` values per point.
            #[inline(never)]
            pub fn query_with_jacobian(&self, points: &[[f32; $D]], out: &mut [f32], jacobian: &mut [[f32; $D]]) {
                self.query_points_with_jacobian(points, out, jacobian);
            }

            /// Takes one step of weighted regression; returns the loss before it,
            /// (1 / n k) Σ_i w_i Σ_o ρ(out_io − target_io), with ρ of
            /// [`TrainConfig::loss`](crate::field::TrainConfig::loss).
            ///
            /// `targets[point][output]`, `weights[point]` (empty: all 1). The schedule counts the calls. A loss that is
            /// not finite means a target or weight is not, and the field is lost. No points: nothing happens, loss 0.
            ///
            /// # Panics
            /// If a length does not fit.
            #[inline(never)]
            pub fn train_step(&mut self, points: &[[f32; $D]], targets: &[f32], weights: &[f32]) -> f64 {
                self.regress(points, targets, weights)
            }

            /// Takes one step of the optimizer for a loss that is the caller's, given its gradient by the outputs,
            /// `[point][output]`. No points: nothing happens.
            ///
            /// # Panics
            /// If a length does not fit.
            #[inline(never)]
            pub fn descend(&mut self, points: &[[f32; $D]], d_outputs: &[f32]) {
                self.descend_along(points, d_outputs);
            }
        }
    )*};
}

in_dimensions!(2, 3);
