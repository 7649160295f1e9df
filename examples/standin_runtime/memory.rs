//! The client's memory: the only places where pointers that it gave are read or written.

use std::ffi::{CStr, c_char};

/// Reads a text; `None` where the pointer is null or the bytes are no UTF-8.
pub fn read_text<'a>(text: *const c_char) -> Option<&'a str> {
    if text.is_null() {
        return None;
    }
    // SAFETY: the client promises a text that ends with zero and stays for the call, as with SteamVR.
    unsafe { CStr::from_ptr(text) }.to_str().ok()
}

/// Reads a value; `None` where the pointer is null.
pub fn read<T: Copy>(from: *const T) -> Option<T> {
    // SAFETY: not null, and the client promises that a value of that type is there. It need not be aligned.
    (!from.is_null()).then(|| unsafe { from.read_unaligned() })
}

/// Writes a value, unless the pointer is null.
pub fn write<T>(to: *mut T, value: T) {
    if !to.is_null() {
        // SAFETY: not null, and the client promises room for a value of that type. It need not be aligned.
        unsafe { to.write_unaligned(value) }
    }
}

/// Writes as many values as there is room for; the rest of the room is filled with the last argument.
pub fn write_all<T: Copy>(to: *mut T, room: u32, values: &[T], rest: T) {
    if to.is_null() {
        return;
    }
    for index in 0..room as usize {
        let value = values.get(index).copied().unwrap_or(rest);
        // SAFETY: the client promises room for `room` values.
        unsafe { to.add(index).write_unaligned(value) }
    }
}

/// Writes the first bytes of a value, for clients that know a shorter one.
pub fn write_part<T>(to: *mut T, bytes: u32, value: &T) {
    if to.is_null() {
        return;
    }
    let bytes = (bytes as usize).min(size_of::<T>());
    // SAFETY: the client promises room for `bytes`, and no more than the value has is copied.
    unsafe { std::ptr::from_ref(value).cast::<u8>().copy_to_nonoverlapping(to.cast::<u8>(), bytes) }
}

/// Writes a text with its zero where there is room, and returns the bytes that it takes.
pub fn write_text(to: *mut c_char, room: u32, text: &str) -> u32 {
    let needed = text.len() as u32 + 1;
    if !to.is_null() && room >= needed {
        // SAFETY: the client promises room for `room` bytes, which is enough for the text and its zero.
        unsafe {
            text.as_ptr().copy_to_nonoverlapping(to.cast::<u8>(), text.len());
            to.add(text.len()).write(0);
        }
    }
    needed
}
