//! Large tables on large pages. They are read at random, and with pages of 4 KiB a table of a few dozen megabytes has
//! more of them than the processor remembers the places of: each access then looks its page up first.

/// Bytes of a large page; tables smaller than a few of them gain nothing.
const LARGE_PAGE: usize = 1 << 21;

/// Returns `n` zeros, on large pages where the system has them to give.
pub(crate) fn zeros(n: usize) -> Vec<f32> {
    // Fresh memory that nothing has touched yet: only then does the advice decide how it is laid out.
    let values = vec![0.0; n];
    advise(&values);
    values
}

#[cfg(target_os = "linux")]
fn advise(values: &[f32]) {
    let start = values.as_ptr().addr().next_multiple_of(LARGE_PAGE);
    let end = values.as_ptr_range().end.addr() / LARGE_PAGE * LARGE_PAGE;
    if end <= start {
        return;
    }
    let address = values.as_ptr().with_addr(start).cast_mut().cast();
    // SAFETY: the range lies within the vector's memory, and the advice changes no value in it, only the size of the
    // pages behind it. A system that does not know the advice refuses it, and nothing is lost.
    #[allow(unsafe_code)]
    unsafe {
        libc::madvise(address, end - start, libc::MADV_HUGEPAGE);
    }
}

#[cfg(not(target_os = "linux"))]
fn advise(_: &[f32]) {
    let _ = LARGE_PAGE;
}
