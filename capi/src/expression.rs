//! What a text asks of a face.

use std::{
    ffi::{CString, c_char},
    path::PathBuf,
    ptr::null,
    sync::{Arc, Mutex, PoisonError},
};

use anyface::{
    conditions::{ACTION_UNITS, Side},
    text::{TextUnits, Understood},
};

use crate::{
    error::{AnyfaceError, Failure},
    guard, pointer,
    status::AnyfaceStatus,
};

/// The reader that was asked for last, and the folder of its models: one may hold half a gigabyte.
static LAST: Mutex<Option<(Option<PathBuf>, Arc<TextUnits>)>> = Mutex::new(None);

/// The reader of texts of a folder of models, or the built-in one.
///
/// # Safety
/// `weights_dir` is NULL or a text that ends in 0.
pub(crate) unsafe fn words(weights_dir: *const c_char) -> Result<Arc<TextUnits>, Failure> {
    let folder = unsafe { pointer::optional_text("weights_dir", weights_dir) }?.map(PathBuf::from);
    let mut last = LAST.lock().unwrap_or_else(PoisonError::into_inner);
    match &*last {
        Some((of, words)) if *of == folder => Ok(Arc::clone(words)),
        _ => {
            let words = Arc::new(TextUnits::open(folder.as_deref())?);
            *last = Some((folder, Arc::clone(&words)));
            Ok(words)
        }
    }
}

/// The action units of an expression in English words. Never changes after it was made: any number of threads
/// may read it at the same time.
pub struct AnyfaceExpression {
    units: Vec<CString>,
    strength: f32,
    hint: Option<CString>,
}

impl AnyfaceExpression {
    fn of(understood: &Understood) -> AnyfaceExpression {
        let text = |text: &str| CString::new(text).unwrap_or_default();
        let units = understood.units.iter().map(|(unit, side, ..)| {
            let side = match side {
                Side::Both => "",
                Side::Left => "L",
                Side::Right => "R",
            };
            text(&format!("{}{side}", ACTION_UNITS[*unit].name))
        });
        let strengths = understood.units.iter().map(|unit| unit.2);
        AnyfaceExpression {
            units: units.collect(),
            strength: strengths.fold(0.0, f32::max),
            hint: understood.hint.as_deref().map(text),
        }
    }
}

/// Reads what a text asks of a face, such as "a sarcastic laugh" or "winks with the right eye".
///
/// `weights_dir`: UTF-8, a folder of models that holds `text_units`, which may read by CLIP, or NULL for the built-in
/// reader; the last one is kept. `text`: UTF-8. A text that says nothing to a face has no units, and `anyface_expression_hint()` the nearest
/// that has some. Free with `anyface_expression_free()`. Fails with `ANYFACE_STATUS_INVALID_INPUT` for a text of more
/// than 1,000 letters, `ANYFACE_STATUS_WEIGHTS` or `ANYFACE_STATUS_IO` for a folder that cannot be used.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_expression_new(
    weights_dir: *const c_char,
    text: *const c_char,
    out: *mut *mut AnyfaceExpression,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        pointer::check_out("out", out)?;
        let text = unsafe { pointer::text("text", text) }?;
        let words = unsafe { words(weights_dir) }?;
        let expression = AnyfaceExpression::of(&words.understand(text)?);
        unsafe { pointer::give(out, expression) };
        Ok(())
    };
    unsafe { guard::guard(error, work) }
}

/// Number of units; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_expression_unit_count(
    expression: *const AnyfaceExpression,
) -> usize {
    unsafe { expression.as_ref() }.map_or(0, |expression| expression.units.len())
}

/// A unit as `AnyfaceEvent` takes it: "12", "45L". NULL from the count on, for NULL. Lives as long as the
/// expression.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_expression_unit(
    expression: *const AnyfaceExpression,
    index: usize,
) -> *const c_char {
    let unit = unsafe { expression.as_ref() }.and_then(|expression| expression.units.get(index));
    unit.map_or(null(), |unit| unit.as_ptr())
}

/// How strongly the text asks for it, 1 for a plain word; 0 without units, for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_expression_strength(expression: *const AnyfaceExpression) -> f32 {
    unsafe { expression.as_ref() }.map_or(0.0, |expression| expression.strength)
}

/// The nearest expression that would be understood, where there are no units and one is near; NULL otherwise, for
/// NULL. Lives as long as the expression.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_expression_hint(
    expression: *const AnyfaceExpression,
) -> *const c_char {
    let hint = unsafe { expression.as_ref() }.and_then(|expression| expression.hint.as_ref());
    hint.map_or(null(), |hint| hint.as_ptr())
}

/// Frees an expression that no running call uses; nothing happens for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_expression_free(expression: *mut AnyfaceExpression) {
    unsafe { guard::free(expression) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::{ffi::CStr, ptr::null_mut};

    fn read(text: &str) -> (Vec<String>, f32, Option<String>) {
        let text = CString::new(text).unwrap();
        let (mut made, mut error) = (null_mut(), null_mut());
        let said =
            |text: *const c_char| unsafe { CStr::from_ptr(text) }.to_str().unwrap().to_owned();
        unsafe {
            let status = anyface_expression_new(null(), text.as_ptr(), &mut made, &mut error);
            assert_eq!(status, AnyfaceStatus::Ok);
            let count = anyface_expression_unit_count(made);
            let units = (0..count).map(|at| said(anyface_expression_unit(made, at)));
            let units = units.collect();
            assert!(anyface_expression_unit(made, count).is_null());
            let hint = anyface_expression_hint(made);
            let hint = (!hint.is_null()).then(|| said(hint));
            let strength = anyface_expression_strength(made);
            anyface_expression_free(made);
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
    fn what_says_nothing_has_no_units() {
        assert_eq!(read("").0, Vec::<String>::new());
        let (units, strength, _) = read("12345");
        assert_eq!((units.len(), strength), (0, 0.0));
    }
}
