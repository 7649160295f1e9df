//! Access to the client's memory: the only code that reads or writes through the client's pointers.

use std::ffi::{CStr, c_char};

/// Reads a text; `None` if the pointer is null or the bytes are not UTF-8.
pub fn read_text<'a>(text: *const c_char) -> Option<&'a str> {
    if text.is_null() {
        return None;
    }
    // SAFETY: the client guarantees a zero-terminated text that is valid during the call, as with
    // SteamVR.
    unsafe { CStr::from_ptr(text) }.to_str().ok()
}

/// Reads a value; `None` if the pointer is null.
pub fn read<T: Copy>(from: *const T) -> Option<T> {
    // SAFETY: not null, and the client guarantees a value of that type. It need not be aligned.
    (!from.is_null()).then(|| unsafe { from.read_unaligned() })
}

/// Writes a value, unless the pointer is null.
pub fn write<T>(to: *mut T, value: T) {
    if !to.is_null() {
        // SAFETY: not null, and the client guarantees room for a value of that type. It need not be
        // aligned.
        unsafe { to.write_unaligned(value) }
    }
}

/// Writes as many values as there is room for. Remaining room is filled with `rest`.
pub fn write_all<T: Copy>(to: *mut T, room: u32, values: &[T], rest: T) {
    if to.is_null() {
        return;
    }
    for index in 0..room as usize {
        let value = values.get(index).copied().unwrap_or(rest);
        // SAFETY: the client guarantees room for `room` values.
        unsafe { to.add(index).write_unaligned(value) }
    }
}

/// Writes the first bytes of a value, for clients with a shorter version of the type.
pub fn write_part<T>(to: *mut T, bytes: u32, value: &T) {
    if to.is_null() {
        return;
    }
    let bytes = (bytes as usize).min(size_of::<T>());
    // SAFETY: the client guarantees room for `bytes`, and no more than the size of the value is
    // copied.
    unsafe { std::ptr::from_ref(value).cast::<u8>().copy_to_nonoverlapping(to.cast::<u8>(), bytes) }
}

/// Writes a zero-terminated text if there is room. Returns the number of bytes that it needs.
pub fn write_text(to: *mut c_char, room: u32, text: &str) -> u32 {
    let needed = text.len() as u32 + 1;
    if !to.is_null() && room >= needed {
        // SAFETY: the client guarantees room for `room` bytes, which is enough for the text and its
        // terminator.
        unsafe {
            text.as_ptr().copy_to_nonoverlapping(to.cast::<u8>(), text.len());
            to.add(text.len()).write(0);
        }
    }
    needed
}
