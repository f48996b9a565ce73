//! Sums over slices, always added in the same order.

/// Elements one task handles.
const GRAIN: usize = 4096;

/// Calls `f(offset, part)` on disjoint parts of `out` in parallel and adds what it returns along a fixed binary tree.
pub(crate) fn fill_and_sum<T: Send>(out: &mut [T], f: &(impl Fn(usize, &mut [T]) -> f64 + Sync)) -> f64 {
    fn part<T: Send>(offset: usize, out: &mut [T], f: &(impl Fn(usize, &mut [T]) -> f64 + Sync)) -> f64 {
        if out.len() <= GRAIN {
            return f(offset, out);
        }
        let middle = out.len() / 2;
        let (left, right) = out.split_at_mut(middle);
        let (a, b) = rayon::join(|| part(offset, left, f), || part(offset + middle, right, f));
        a + b
    }
    part(0, out, f)
}

/// Returns the scalar product, in eight running sums.
#[inline(always)]
pub(crate) fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0f32; 8];
    let ((a, rest_a), (b, rest_b)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    for (a, b) in a.iter().zip(b) {
        for i in 0..8 {
            sums[i] += a[i] * b[i];
        }
    }
    sums.iter().sum::<f32>() + rest_a.iter().zip(rest_b).map(|(a, b)| a * b).sum::<f32>()
}
