//! Counts the allocations of the code under test, so that a target can check their limit.
//!
//! libFuzzer's own limits need a sanitizer's hooks. libFuzzer's memory is C++ and is not counted
//! here.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

/// A larger single request aborts the run at once, with the culprit on the stack, bytes. Choice.
const ABORT_BYTES: usize = 1 << 30;

static LIVE: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);
static LARGEST: AtomicUsize = AtomicUsize::new(0);

struct Counting;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn count_allocation(bytes: usize) {
    if bytes > ABORT_BYTES {
        std::process::abort();
    }
    LARGEST.fetch_max(bytes, Relaxed);
    PEAK.fetch_max(LIVE.fetch_add(bytes, Relaxed) + bytes, Relaxed);
}

// SAFETY: every call is forwarded to the system allocator with the same arguments.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count_allocation(layout.size());
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count_allocation(layout.size());
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        LIVE.fetch_sub(layout.size(), Relaxed);
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, bytes: usize) -> *mut u8 {
        count_allocation(bytes);
        LIVE.fetch_sub(layout.size(), Relaxed);
        unsafe { System.realloc(pointer, layout, bytes) }
    }
}

/// Runs code under test. Panics if it held more than `peak_bytes` at once, or requested more than
/// `largest_bytes` at once.
pub fn bounded<T>(peak_bytes: usize, largest_bytes: usize, run: impl FnOnce() -> T) -> T {
    let before = LIVE.load(Relaxed);
    PEAK.store(before, Relaxed);
    LARGEST.store(0, Relaxed);
    let result = run();
    let (peak, largest) = (PEAK.load(Relaxed).saturating_sub(before), LARGEST.load(Relaxed));
    assert!(peak <= peak_bytes, "{peak} bytes held at once, {peak_bytes} allowed");
    assert!(largest <= largest_bytes, "{largest} bytes asked for in one go, {largest_bytes} allowed");
    result
}
