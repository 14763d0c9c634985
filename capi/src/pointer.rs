//! Turns raw pointers into checked borrows, and writes results through checked pointers.

use std::{
    ffi::{CStr, CString},
    path::Path,
    ptr::null,
};

use libc::c_char;

use crate::error::Failure;

/// Borrows a handle that must not be NULL.
///
/// # Safety
/// `handle` is NULL or valid for reads for the lifetime that the caller uses.
pub(crate) unsafe fn handle<'a, T>(name: &'static str, handle: *const T) -> Result<&'a T, Failure> {
    unsafe { handle.as_ref() }.ok_or(Failure::Null(name))
}

/// Borrows several handles that must not be NULL. The error for a NULL one names its variable.
macro_rules! handles {
    ($($name:ident),+) => {
        ($(unsafe { $crate::pointer::handle(stringify!($name), $name) }?),+)
    };
}
pub(crate) use handles;

/// Borrows a handle that must not be NULL and that the call changes.
///
/// # Safety
/// `handle` is NULL or valid for reads and writes for the lifetime that the caller uses, and no
/// other reference to it is in use.
pub(crate) unsafe fn handle_mut<'a, T>(
    name: &'static str,
    handle: *mut T,
) -> Result<&'a mut T, Failure> {
    unsafe { handle.as_mut() }.ok_or(Failure::Null(name))
}

/// Borrows `rows` × `columns` values. NULL is allowed if that is 0.
///
/// # Safety
/// `values` is NULL or valid for reads of `rows * columns` values.
pub(crate) unsafe fn slice<'a, T>(
    name: &'static str,
    values: *const T,
    rows: usize,
    columns: usize,
) -> Result<&'a [T], Failure> {
    let length = checked_length::<T>(name, rows, columns)?;
    if length == 0 {
        return Ok(&[]);
    }
    check_pointer(name, values)?;
    Ok(unsafe { std::slice::from_raw_parts(values, length) })
}

/// Checks a buffer for `rows` × `columns` results. NULL is allowed if that is 0.
pub(crate) fn check_room<T>(
    name: &'static str,
    buffer: *mut T,
    rows: usize,
    columns: usize,
) -> Result<(), Failure> {
    match checked_length::<T>(name, rows, columns)? {
        0 => Ok(()),
        _ => check_pointer(name, buffer.cast_const()),
    }
}

/// Copies `values` into the caller's buffer. `capacity` must be exactly their number.
///
/// # Safety
/// `buffer` is NULL or valid for writes of `capacity` values.
pub(crate) unsafe fn copy_out<T: Copy>(
    name: &'static str,
    values: &[T],
    buffer: *mut T,
    capacity: usize,
) -> Result<(), Failure> {
    if capacity != values.len() {
        return Err(Failure::invalid(format!(
            "{name}: expected room for {} values, got {capacity}",
            values.len()
        )));
    }
    if values.is_empty() {
        return Ok(());
    }
    check_pointer(name, buffer)?;
    unsafe { buffer.copy_from_nonoverlapping(values.as_ptr(), values.len()) };
    Ok(())
}

/// Copies `values` into a buffer of the caller that has room for them. Does nothing for NULL.
///
/// # Safety
/// `buffer` is NULL or valid for writes of `values.len()` values.
pub(crate) unsafe fn copy_where_asked<T: Copy>(
    name: &'static str,
    values: &[T],
    buffer: *mut T,
) -> Result<(), Failure> {
    if buffer.is_null() {
        Ok(())
    } else {
        unsafe { copy_out(name, values, buffer, values.len()) }
    }
}

/// Looks up the meaning of the caller's number in `known`, whose numbers count up from 0.
pub(crate) fn one_of<T, const N: usize>(
    name: &'static str,
    code: i32,
    known: [(i32, T); N],
) -> Result<T, Failure> {
    let entry = known.into_iter().find(|(number, _)| *number == code);
    entry.map(|(_, meaning)| meaning).ok_or_else(|| {
        let last = N - 1;
        Failure::invalid(format!("{name}: expected 0 to {last}, got {code}"))
    })
}

/// Reads a string that must not be NULL.
///
/// # Safety
/// `text` is NULL or a NUL-terminated string.
pub(crate) unsafe fn text<'a>(name: &'static str, text: *const c_char) -> Result<&'a str, Failure> {
    if text.is_null() {
        return Err(Failure::Null(name));
    }
    let bytes = unsafe { CStr::from_ptr(text) };
    bytes.to_str().map_err(|error| {
        let place = error.valid_up_to();
        Failure::invalid(format!(
            "{name}: expected UTF-8, got other bytes at {place}"
        ))
    })
}

/// Reads a string that may be NULL.
///
/// # Safety
/// As [`text`].
pub(crate) unsafe fn optional_text<'a>(
    name: &'static str,
    value: *const c_char,
) -> Result<Option<&'a str>, Failure> {
    if value.is_null() {
        Ok(None)
    } else {
        unsafe { text(name, value) }.map(Some)
    }
}

/// Reads a file name, which must not be empty.
///
/// # Safety
/// As [`text`].
pub(crate) unsafe fn path<'a>(
    name: &'static str,
    value: *const c_char,
) -> Result<&'a Path, Failure> {
    match unsafe { text(name, value) }? {
        "" => Err(Failure::invalid(format!(
            "{name}: expected a file name, got an empty string"
        ))),
        path => Ok(Path::new(path)),
    }
}

/// Checks the pointer that a result will be written to, before the work is done.
pub(crate) fn check_out<T>(name: &'static str, out: *mut T) -> Result<(), Failure> {
    check_pointer(name, out.cast_const())
}

/// Turns a text of the library into a C string. A NUL in it becomes a space.
pub(crate) fn c_text(text: &str) -> CString {
    CString::new(text.replace('\0', " ")).unwrap_or_default()
}

/// Lends a text that lives as long as its owner. NULL if there is no text.
pub(crate) fn lend(text: Option<&CString>) -> *const c_char {
    text.map_or(null(), |text| text.as_ptr())
}

fn check_pointer<T>(name: &'static str, pointer: *const T) -> Result<(), Failure> {
    if pointer.is_null() {
        return Err(Failure::Null(name));
    }
    if pointer.is_aligned() {
        Ok(())
    } else {
        Err(Failure::invalid(format!(
            "{name}: expected an address that is a multiple of {}, got {pointer:p}",
            align_of::<T>()
        )))
    }
}

fn checked_length<T>(name: &'static str, rows: usize, columns: usize) -> Result<usize, Failure> {
    rows.checked_mul(columns)
        .filter(|length| {
            let bytes = length.checked_mul(size_of::<T>());
            bytes.is_some_and(|bytes| isize::try_from(bytes).is_ok())
        })
        .ok_or_else(|| {
            let message = format!("{name}: [{rows}, {columns}] is larger than memory can be");
            Failure::invalid(message)
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::status::AnyfaceStatus;
    use std::ptr::{null, null_mut};

    #[test]
    fn nothing_may_be_null_but_something_may_not() {
        assert!(
            unsafe { slice::<f32>("x", null(), 0, 3) }
                .unwrap()
                .is_empty()
        );
        let failure = unsafe { slice::<f32>("x", null(), 1, 3) }.unwrap_err();
        assert_eq!(failure.status(), AnyfaceStatus::NullPointer);
    }

    #[test]
    fn impossible_sizes_are_refused_before_reading() {
        let one = [0.0f32];
        for (rows, columns) in [(usize::MAX, 3), (usize::MAX / 4, 1)] {
            let failure = unsafe { slice("x", one.as_ptr(), rows, columns) }.unwrap_err();
            assert_eq!(failure.status(), AnyfaceStatus::InvalidInput);
        }
    }

    #[test]
    fn a_crooked_address_is_refused() {
        let bytes = [0u32; 2];
        let crooked = unsafe { bytes.as_ptr().cast::<u8>().add(1) }.cast::<f32>();
        let failure = unsafe { slice("x", crooked, 1, 1) }.unwrap_err();
        assert_eq!(failure.status(), AnyfaceStatus::InvalidInput);
    }

    #[test]
    fn buffers_of_another_size_stay_untouched() {
        let mut buffer = [9.0f32; 2];
        let pointer = buffer.as_mut_ptr();
        assert!(unsafe { copy_out("x", &[1.0], pointer, 2) }.is_err());
        assert!(unsafe { copy_out("x", &[1.0, 2.0], null_mut(), 2) }.is_err());
        assert_eq!(buffer, [9.0; 2]);
        unsafe { copy_out("x", &[1.0, 2.0], pointer, 2) }.unwrap();
        assert_eq!(buffer, [1.0, 2.0]);
    }

    #[test]
    fn text_must_be_utf8() {
        assert_eq!(unsafe { text("x", c"gr\u{fc}n".as_ptr()) }.unwrap(), "grün");
        let latin1 = c"gr\xfcn";
        let failure = unsafe { text("x", latin1.as_ptr()) }.unwrap_err();
        assert_eq!(failure.status(), AnyfaceStatus::InvalidInput);
        assert!(unsafe { path("x", c"".as_ptr()) }.is_err());
        assert!(unsafe { optional_text("x", null()) }.unwrap().is_none());
    }
}
