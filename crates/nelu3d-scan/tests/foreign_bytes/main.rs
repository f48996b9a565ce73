//! Properties of everything that reads bytes of other programs: whatever they are, a reader answers soon, without a
//! panic and without asking for more memory than a file of that size can justify; and what is written is read back as
//! it was.

#[path = "../../src/import/tests/dng.rs"]
mod dng;
mod images;
mod meshes;
mod mutation;
mod numbers;
mod rigs;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::time::{Duration, Instant};

use proptest::test_runner::Config;

/// Largest single request for memory that a file of a few kilobytes may make, bytes: what the TIFF crate allows for a
/// tag.
const MAX_ALLOCATION: usize = 256 << 20;

/// Longest time that a reader may take for such a file.
const MAX_TIME: Duration = Duration::from_secs(5);

/// The system's allocator, which notes the largest request of each thread.
struct Watched;

thread_local! {
    static LARGEST: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: every call is passed on to the system's allocator as it is.
#[allow(unsafe_code, reason = "an allocator cannot be written without")]
unsafe impl GlobalAlloc for Watched {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        note(layout.size());
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        note(layout.size());
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, at: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        note(size);
        unsafe { System.realloc(at, layout, size) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Watched = Watched;

fn note(size: usize) {
    // A thread that ends has no such cell any more.
    let _ = LARGEST.try_with(|l| l.set(l.get().max(size)));
}

/// Reads foreign bytes, and fails where that takes too long or too much memory at once.
fn watched<T>(read: impl FnOnce() -> T) -> T {
    LARGEST.set(0);
    let start = Instant::now();
    let result = read();
    let (time, largest) = (start.elapsed(), LARGEST.get());
    assert!(largest <= MAX_ALLOCATION, "{largest} bytes were asked for at once");
    assert!(time <= MAX_TIME, "it took {time:?}");
    result
}

/// So many cases, times the number in `NELU3D_MORE_CASES` for a long search, and no file of failed ones: CI's checkout
/// is thrown away.
fn cases(n: u32) -> Config {
    let factor = std::env::var("NELU3D_MORE_CASES").ok().and_then(|f| f.parse().ok()).unwrap_or(1u32);
    Config { failure_persistence: None, ..Config::with_cases(n.saturating_mul(factor)) }
}
