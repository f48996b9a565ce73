//! Asking for memory ahead of its use. Tables are far larger than the second-level cache and are read at random:
//! without this, a training step mostly waits.

/// Brings the cache line of `slice[index]` closer, on machines where the compiler offers that; never faults, whatever
/// the index.
#[inline(always)]
pub fn prefetch<T>(slice: &[T], index: usize) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let address = slice.as_ptr().wrapping_add(index).cast();
        // SAFETY: a prefetch is a hint: it reads nothing the program can see and any address is allowed. SSE is part of
        // every x86-64.
        #[allow(unsafe_code)]
        unsafe {
            _mm_prefetch::<_MM_HINT_T0>(address);
        }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (slice, index);
}
