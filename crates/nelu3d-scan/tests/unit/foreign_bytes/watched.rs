//! Readers that are watched: how long they take, and how much memory they ask for at once.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::time::{Duration, Instant};

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

/// Returns what a reader answers, and the largest request for memory that it made, bytes.
pub(crate) fn measured<T>(read: impl FnOnce() -> T) -> (T, usize) {
    LARGEST.set(0);
    let result = read();
    (result, LARGEST.get())
}

/// Reads foreign bytes, and fails where that takes too long or too much memory at once.
pub(crate) fn watched<T>(read: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let (result, largest) = measured(read);
    let time = start.elapsed();
    assert!(largest <= MAX_ALLOCATION, "{largest} bytes were asked for at once");
    assert!(time <= MAX_TIME, "it took {time:?}");
    result
}
