//! Counts what is allocated, and refuses what no limit of the fuzzer allows.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Most memory of the whole process (bytes). Beyond it the process ends, and the file that did it is kept.
const MOST: usize = 2 << 30;

static LIVE: AtomicUsize = AtomicUsize::new(0);

thread_local! {
    /// Memory that this thread allocated and has not freed (bytes): less than 0 if it frees that of others.
    static OWN: Cell<isize> = const { Cell::new(0) };
    /// The most of it so far.
    static PEAK: Cell<isize> = const { Cell::new(0) };
}

/// The system's allocator, counted.
pub struct Counting;

impl Counting {
    /// Whether `size` more bytes are allowed; if so, they count.
    fn add(size: usize) -> bool {
        let live = LIVE.fetch_add(size, Ordering::Relaxed).saturating_add(size);
        if live > MOST {
            LIVE.fetch_sub(size, Ordering::Relaxed);
            return false;
        }
        let own = OWN.get() + size as isize;
        OWN.set(own);
        PEAK.set(PEAK.get().max(own));
        true
    }

    fn remove(size: usize) {
        LIVE.fetch_sub(size, Ordering::Relaxed);
        OWN.set(OWN.get() - size as isize);
    }
}

// SAFETY: every call goes to the system's allocator unchanged, or returns null, which `GlobalAlloc` allows.
#[allow(unsafe_code)]
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        if !Self::add(layout.size()) {
            return std::ptr::null_mut();
        }
        // SAFETY: as the caller promises.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        if !Self::add(layout.size()) {
            return std::ptr::null_mut();
        }
        // SAFETY: as the caller promises.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        Self::remove(layout.size());
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(pointer, layout) }
    }
}

/// Runs `work`; returns its result and the most memory that this thread allocated meanwhile, on top of what it had
/// before (bytes).
pub fn measured<T>(work: impl FnOnce() -> T) -> (T, usize) {
    let before = OWN.get();
    PEAK.set(before);
    let result = work();
    (result, (PEAK.get() - before).max(0) as usize)
}
