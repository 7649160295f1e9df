//! Function tables without null pointers: the implemented functions, and for all others a function
//! of the right type that records a violation and returns an error.

use std::ffi::c_char;

use crate::{sys, world};

/// A function's name, as a type.
pub trait Named {
    /// Names of the interface and the function.
    const NAME: &'static str;
}

/// Return value of a function that fails.
pub trait Failure {
    /// The value; `code` if the type is an error number.
    fn failure(code: u32) -> Self;
}

impl Failure for () {
    fn failure(_: u32) {}
}

impl Failure for u32 {
    fn failure(code: u32) -> u32 {
        code
    }
}

impl<T> Failure for *mut T {
    fn failure(_: u32) -> Self {
        std::ptr::null_mut()
    }
}

macro_rules! failures {
    ($($type:ty => $value:expr),* $(,)?) => {
        $(impl Failure for $type {
            fn failure(_: u32) -> Self {
                $value
            }
        })*
    };
}

failures! {
    bool => false,
    i32 => 0,
    u64 => 0,
    f32 => 0.0,
    sys::HmdMatrix34_t => sys::HmdMatrix34_t { m: [[0.0; 4]; 3] },
    sys::HmdMatrix44_t => sys::HmdMatrix44_t { m: [[0.0; 4]; 4] },
    sys::HmdColor_t => sys::HmdColor_t { r: 0.0, g: 0.0, b: 0.0, a: 0.0 },
    sys::HiddenAreaMesh_t => sys::HiddenAreaMesh_t { pVertexData: std::ptr::null_mut(), unTriangleCount: 0 },
}

/// Function pointer types for which a rejecting function exists.
pub trait UnsupportedFn {
    /// A function that records a violation and returns the failure `CODE`.
    fn unsupported<N: Named, const CODE: u32>() -> Self;
}

macro_rules! unsupported_fn {
    ($($argument:ident)*) => {
        impl<R: Failure, $($argument),*> UnsupportedFn for unsafe extern "C" fn($($argument),*) -> R {
            fn unsupported<N: Named, const CODE: u32>() -> Self {
                unsafe extern "C" fn refuse<N: Named, const CODE: u32, R: Failure, $($argument),*>(
                    $(_: $argument),*
                ) -> R {
                    world::unsupported(N::NAME);
                    R::failure(CODE)
                }
                refuse::<N, CODE, R, $($argument),*>
            }
        }
    };
}

unsupported_fn!();
unsupported_fn!(A);
unsupported_fn!(A B);
unsupported_fn!(A B C);
unsupported_fn!(A B C D);
unsupported_fn!(A B C D E);
unsupported_fn!(A B C D E F);
unsupported_fn!(A B C D E F G);
unsupported_fn!(A B C D E F G H);
unsupported_fn!(A B C D E F G H I);

/// A table: `field: function` for implemented functions, then lists of fields that fail with a
/// code.
macro_rules! table {
    ($table:ident, $interface:literal; given { $($given:ident: $function:path),* $(,)? }
     $(fails($code:expr) { $($unsupported:ident),* $(,)? })*) => {
        $crate::sys::$table {
            $($given: Some($function),)*
            $($($unsupported: Some({
                struct Name;
                impl $crate::table::Named for Name {
                    const NAME: &'static str = concat!($interface, "::", stringify!($unsupported));
                }
                $crate::table::UnsupportedFn::unsupported::<Name, { $code }>()
            }),)*)*
        }
    };
}
pub(crate) use table;

/// Leaks a table, because clients keep the pointer.
pub fn leaked<T>(table: T) -> usize {
    std::ptr::from_mut(Box::leak(Box::new(table))) as usize
}

/// A constant text as a C pointer.
pub fn text(text: &'static std::ffi::CStr) -> *mut c_char {
    text.as_ptr().cast_mut()
}
