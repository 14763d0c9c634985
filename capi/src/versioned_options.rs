//! Options structs that may grow. The first field says how long the caller's struct is.
//!
//! A program built against an older header passes a shorter struct, and the missing fields take
//! their defaults. A program built against a newer header passes a longer struct. That works if the
//! fields that are unknown here are all zero. Otherwise it is an error; it is never ignored.

use crate::{error::Failure, pointer, status::AnyfaceStatus};

/// An options struct.
///
/// # Safety
/// The type is `repr(C)`, its first field is `struct_size: usize`, and every pattern of bytes is a
/// valid value of it (numbers and raw pointers only).
pub(crate) unsafe trait Versioned: Sized {
    /// The name in error messages.
    const NAME: &'static str;
    /// Length in bytes in the first published header.
    const FIRST_SIZE: usize;
    /// The defaults, with the `struct_size` of this library.
    fn defaults() -> Self;
    /// NULL and 0 in every field.
    fn zero() -> Self {
        // Every pattern of bytes is a valid value of the type.
        unsafe { std::mem::zeroed() }
    }
}

/// Copies the caller's options over the defaults. NULL gives the defaults.
///
/// # Safety
/// `options` is NULL or points to a struct whose first field states its size in bytes.
pub(crate) unsafe fn read<T: Versioned>(options: *const T) -> Result<T, Failure> {
    let mut known = T::defaults();
    if options.is_null() {
        return Ok(known);
    }
    pointer::check_out(T::NAME, options.cast_mut())?;
    let theirs = unsafe { options.cast::<usize>().read() };
    let ours = size_of::<T>();
    // The limit is far above any future struct: a larger number is a field that was never set.
    if theirs < T::FIRST_SIZE || theirs > ours + 4096 {
        return Err(Failure::invalid(format!(
            "{}.struct_size: expected {ours}, got {theirs}; initialise the struct with {}_init",
            T::NAME,
            T::NAME
        )));
    }
    let from = options.cast::<u8>();
    let to = (&raw mut known).cast::<u8>();
    unsafe { from.copy_to_nonoverlapping(to, theirs.min(ours)) };
    if theirs > ours {
        let unknown = unsafe { std::slice::from_raw_parts(from.add(ours), theirs - ours) };
        if unknown.iter().any(|byte| *byte != 0) {
            return Err(Failure::invalid(format!(
                "{}: an option is set that this version does not know; it knows {ours} bytes, got {theirs}",
                T::NAME
            )));
        }
    }
    Ok(known)
}

/// Writes the defaults into the caller's struct of `struct_size` bytes.
///
/// # Safety
/// `options` is NULL or valid for writes of `struct_size` bytes.
pub(crate) unsafe fn init<T: Versioned>(options: *mut T, struct_size: usize) -> AnyfaceStatus {
    let known = T::defaults();
    if options.is_null() {
        return AnyfaceStatus::NullPointer;
    }
    let ours = size_of::<T>();
    if struct_size < T::FIRST_SIZE || struct_size > ours + 4096 || !options.is_aligned() {
        return AnyfaceStatus::InvalidInput;
    }
    let to = options.cast::<u8>();
    unsafe {
        to.write_bytes(0, struct_size);
        to.copy_from_nonoverlapping((&raw const known).cast::<u8>(), struct_size.min(ours));
        options.cast::<usize>().write(struct_size);
    }
    AnyfaceStatus::Ok
}

#[cfg(test)]
mod tests {
    use super::*;

    #[repr(C)]
    #[derive(Debug, Clone, Copy, PartialEq)]
    struct First {
        struct_size: usize,
        fps: f64,
    }

    #[repr(C)]
    #[derive(Debug, Clone, Copy, PartialEq)]
    struct Second {
        first: First,
        seed: u64,
    }

    unsafe impl Versioned for First {
        const NAME: &'static str = "test_options";
        const FIRST_SIZE: usize = size_of::<First>();
        fn defaults() -> Self {
            First {
                struct_size: size_of::<Self>(),
                fps: 30.0,
            }
        }
    }

    unsafe impl Versioned for Second {
        const NAME: &'static str = "test_options";
        const FIRST_SIZE: usize = size_of::<First>();
        fn defaults() -> Self {
            Second {
                first: First {
                    struct_size: size_of::<Self>(),
                    fps: 30.0,
                },
                seed: 7,
            }
        }
    }

    #[test]
    fn an_older_program_gets_defaults_for_what_it_does_not_know() {
        let theirs = First {
            struct_size: size_of::<First>(),
            fps: 25.0,
        };
        let read = unsafe { read((&raw const theirs).cast::<Second>()) }.unwrap();
        assert_eq!((read.first.fps, read.seed), (25.0, 7));
    }

    #[test]
    fn a_newer_program_works_until_it_asks_for_something_new() {
        let first = First {
            struct_size: size_of::<Second>(),
            fps: 25.0,
        };
        let mut theirs = Second { first, seed: 0 };
        let known = unsafe { read((&raw const theirs).cast::<First>()) }.unwrap();
        assert_eq!(known.fps, 25.0);
        theirs.seed = 1;
        assert!(unsafe { read((&raw const theirs).cast::<First>()) }.is_err());
    }

    #[test]
    fn init_never_writes_past_the_callers_struct() {
        let first = First {
            struct_size: 0,
            fps: 0.0,
        };
        let mut theirs = Second { first, seed: 99 };
        let status = unsafe { init((&raw mut theirs).cast::<Second>(), size_of::<First>()) };
        assert_eq!(status, AnyfaceStatus::Ok);
        let expected = First {
            struct_size: size_of::<First>(),
            fps: 30.0,
        };
        assert_eq!((theirs.first, theirs.seed), (expected, 99));
    }

    #[test]
    fn init_zeroes_what_it_does_not_know() {
        let first = First {
            struct_size: 0,
            fps: 0.0,
        };
        let mut theirs = Second { first, seed: 99 };
        let status = unsafe { init((&raw mut theirs).cast::<First>(), size_of::<Second>()) };
        assert_eq!((status, theirs.seed), (AnyfaceStatus::Ok, 0));
    }

    #[test]
    fn a_size_that_was_never_set_is_refused() {
        for struct_size in [0, 3, usize::MAX] {
            let theirs = First {
                struct_size,
                fps: 25.0,
            };
            assert!(unsafe { read(&raw const theirs) }.is_err());
        }
        let mut theirs = First {
            struct_size: 0,
            fps: 0.0,
        };
        assert_eq!(
            unsafe { init(&raw mut theirs, 0) },
            AnyfaceStatus::InvalidInput
        );
        assert_eq!(theirs.struct_size, 0);
    }
}
