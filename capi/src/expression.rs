//! Turns an expression in words into action units of a face.

use std::{
    ffi::CString,
    path::Path,
    sync::{Arc, Mutex, PoisonError},
};

use anyface::{
    Error,
    conditions::{ACTION_UNITS, Expression},
    text::{Reader, check_length},
};
use libc::c_char;

use crate::{
    error::{AnyfaceError, Failure},
    guard, pointer,
    status::AnyfaceStatus,
};

/// The reader that was used last. Only one is kept, because it may take half a gigabyte.
static LAST: Mutex<Option<Arc<Reader>>> = Mutex::new(None);

/// The reader of expressions that uses the models of a folder, or the built-in one.
///
/// # Safety
/// `weights_dir` is NULL or a NUL-terminated text.
pub(crate) unsafe fn reader(weights_dir: *const c_char) -> Result<Arc<Reader>, Failure> {
    let folder = unsafe { pointer::optional_text("weights_dir", weights_dir) }?.map(Path::new);
    let mut last = LAST.lock().unwrap_or_else(PoisonError::into_inner);
    match &*last {
        Some(reader) if reader.models() == folder => Ok(Arc::clone(reader)),
        _ => Ok(Arc::clone(last.insert(Arc::new(Reader::new(folder))))),
    }
}

/// The action units of an expression. It never changes once it is made: any number of threads may
/// read it at the same time.
pub struct AnyfaceExpression {
    said: CString,
    units: Vec<CString>,
    strength: f32,
    over_speech: bool,
    hint: Option<CString>,
}

impl AnyfaceExpression {
    fn of(expression: &Expression) -> AnyfaceExpression {
        let units = expression.units.iter();
        let units =
            units.map(|(unit, side)| pointer::c_text(&side.written(ACTION_UNITS[*unit].name)));
        AnyfaceExpression {
            said: pointer::c_text(&expression.said),
            units: units.collect(),
            strength: expression.strength,
            over_speech: expression.over_speech,
            hint: None,
        }
    }

    /// An expression without units, with the reason why it has none.
    fn none(said: &str, why: String) -> AnyfaceExpression {
        AnyfaceExpression {
            said: pointer::c_text(said.trim()),
            units: Vec::new(),
            strength: 0.0,
            over_speech: false,
            hint: Some(pointer::c_text(&why)),
        }
    }
}

/// Reads an expression: units such as "12,6L", one of the `words` of `anyface_describe()` with a side
/// anywhere in it, such as "left wink", or English words, such as "winks with the right eye". It
/// may end in a strength, ":0.5". A "!" lets it override the speech.
///
/// `weights_dir`: UTF-8, a folder of models that holds `text_units`, which may use CLIP, or NULL
/// for the built-in reader. The library keeps the reader of the last call. It loads the model at
/// the first text that is neither a unit nor a word of the list.
/// `text`: UTF-8. A text that describes no expression gives no units, and
/// `anyface_expression_hint()` says why. Free with `anyface_expression_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for a text of more than 1,000 letters, and with
/// `ANYFACE_STATUS_WEIGHTS` or `ANYFACE_STATUS_IO` for a folder that cannot be used.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_expression_new(
    weights_dir: *const c_char,
    text: *const c_char,
    out: *mut *mut AnyfaceExpression,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let text = unsafe { pointer::text("text", text) }?;
        check_length(text)?;
        let expression = match unsafe { reader(weights_dir) }?.expression(text) {
            Ok(expression) => AnyfaceExpression::of(&expression),
            Err(Error::InvalidInput(why)) => AnyfaceExpression::none(text, why),
            Err(error) => return Err(error.into()),
        };
        Ok(expression)
    };
    unsafe { guard::give(out, error, make) }
}

/// Number of units; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_expression_unit_count(
    expression: *const AnyfaceExpression,
) -> usize {
    unsafe { expression.as_ref() }.map_or(0, |expression| expression.units.len())
}

/// A unit in the form that `AnyfaceEvent` takes: "12", "45L". NULL if `index` is not below the
/// count, and for NULL. Lives as long as the expression.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_expression_unit(
    expression: *const AnyfaceExpression,
    index: usize,
) -> *const c_char {
    pointer::lend(unsafe { expression.as_ref() }.and_then(|expression| expression.units.get(index)))
}

/// How strong the expression is according to the text, 0 to 2; 1 for a plain word. 0 if there are
/// no units, and for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_expression_strength(expression: *const AnyfaceExpression) -> f32 {
    unsafe { expression.as_ref() }.map_or(0.0, |expression| expression.strength)
}

/// 1 if a "!" lets the expression override the speech, otherwise 0.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_expression_over_speech(
    expression: *const AnyfaceExpression,
) -> i32 {
    unsafe { expression.as_ref() }.map_or(0, |expression| i32::from(expression.over_speech))
}

/// The text without strength and "!". NULL for NULL. Lives as long as the expression.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_expression_said(
    expression: *const AnyfaceExpression,
) -> *const c_char {
    pointer::lend(unsafe { expression.as_ref() }.map(|expression| &expression.said))
}

/// A sentence in English that says why there are no units. It suggests the nearest expression that
/// would be understood, if one is near. NULL if there are units, and for NULL. Lives as long as the
/// expression.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_expression_hint(
    expression: *const AnyfaceExpression,
) -> *const c_char {
    pointer::lend(unsafe { expression.as_ref() }.and_then(|expression| expression.hint.as_ref()))
}

/// Frees an expression that no running call uses; nothing happens for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_expression_free(expression: *mut AnyfaceExpression) {
    unsafe { guard::free(expression) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyface::conditions::MENU;
    use std::{
        ffi::CStr,
        ptr::{null, null_mut},
    };

    fn read(text: &str) -> (Vec<String>, f32, Option<String>) {
        let text = CString::new(text).unwrap();
        let (mut expression, mut error) = (null_mut(), null_mut());
        let said =
            |text: *const c_char| unsafe { CStr::from_ptr(text) }.to_str().unwrap().to_owned();
        unsafe {
            let status = anyface_expression_new(null(), text.as_ptr(), &mut expression, &mut error);
            assert_eq!(status, AnyfaceStatus::Ok);
            let count = anyface_expression_unit_count(expression);
            let units = (0..count).map(|at| said(anyface_expression_unit(expression, at)));
            let units = units.collect();
            assert!(anyface_expression_unit(expression, count).is_null());
            let hint = anyface_expression_hint(expression);
            let hint = (!hint.is_null()).then(|| said(hint));
            let strength = anyface_expression_strength(expression);
            anyface_expression_free(expression);
            (units, strength, hint)
        }
    }

    #[test]
    fn words_become_units_with_sides() {
        let (units, strength, hint) = read("winks with the right eye");
        assert!(units.contains(&"45R".to_owned()), "{units:?}");
        assert!(strength > 0.0 && hint.is_none());
    }

    #[test]
    fn words_of_the_menu_have_their_units_side_strength_and_sign() {
        let (units, strength, hint) = read("right wink!:0.5");
        assert_eq!(
            (units, strength, hint),
            (vec!["6R".into(), "45R".into()], 0.5, None)
        );
        let mut expression = null_mut();
        for (word, _) in MENU {
            let word = pointer::c_text(word);
            unsafe {
                let status =
                    anyface_expression_new(null(), word.as_ptr(), &mut expression, null_mut());
                assert_eq!(status, AnyfaceStatus::Ok);
                assert!(anyface_expression_unit_count(expression) > 0);
                assert_eq!(CStr::from_ptr(anyface_expression_said(expression)), &*word);
                assert_eq!(anyface_expression_over_speech(expression), 0);
                anyface_expression_free(expression);
            }
        }
    }

    #[test]
    fn what_says_nothing_has_no_units_and_says_why() {
        let (units, _, hint) = read("");
        assert!(units.is_empty() && hint.unwrap().contains("says nothing"));
        let (units, strength, hint) = read("12345");
        assert_eq!((units.len(), strength), (0, 0.0));
        assert!(hint.unwrap().contains("got 12345"));
    }
}
