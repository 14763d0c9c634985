//! Events and expressions as text, and texts that the caller owns.

use std::{
    ffi::CString,
    path::Path,
    sync::{Arc, Mutex, PoisonError},
};

use anyface::text::{Reader, events_to_json};
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
unsafe fn reader(weights_dir: *const c_char) -> Result<Arc<Reader>, Failure> {
    let folder = unsafe { pointer::optional_text("weights_dir", weights_dir) }?.map(Path::new);
    let mut last = LAST.lock().unwrap_or_else(PoisonError::into_inner);
    match &*last {
        Some(reader) if reader.models() == folder => Ok(Arc::clone(reader)),
        _ => Ok(Arc::clone(last.insert(Arc::new(Reader::new(folder))))),
    }
}

/// Frees a text that a function wrote to a `char **`; nothing happens for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_text_free(text: *mut c_char) {
    if !text.is_null() {
        guard::guard_or((), || drop(unsafe { CString::from_raw(text) }));
    }
}

/// Reads an expression: units such as "12,6L", one of the `words` of `anyface_describe()` with a side
/// anywhere in it, such as "left wink", or English words, such as "winks with the right eye". It
/// may end in a strength, ":0.5". A "!" lets it override the speech.
///
/// `weights_dir`: UTF-8, a folder of models that holds `text_units`, which may use CLIP, or NULL
/// for the built-in reader. The library keeps the reader of the last call. It loads the model at
/// the first text that is neither a unit nor a word of the list.
/// `text`: UTF-8. `json` receives an object: `said`, the text without strength and "!"; `units`, such
/// as "45L"; `strength`, 0 to 2, 1 for a plain word; `over_speech`; and `hint`, "" or, if the text
/// describes no expression and there are no units, a sentence that says why and suggests the nearest
/// one. Free it with `anyface_text_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for a text of more than 1,000 letters, and with
/// `ANYFACE_STATUS_WEIGHTS` or `ANYFACE_STATUS_IO` for a folder that cannot be used.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_expression_read(
    weights_dir: *const c_char,
    text: *const c_char,
    json: *mut *mut c_char,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let text = unsafe { pointer::text("text", text) }?;
        Ok(unsafe { reader(weights_dir) }?.expression_to_json(text)?)
    };
    unsafe { guard::give_text(json, error, make) }
}

/// Reads events, what a face does for a while, and writes them with all fields. The field "events"
/// of a request takes the same texts; it reads words with the built-in reader.
///
/// `text`: UTF-8, lines or JSON. A line holds seconds, an expression as `anyface_expression_read()`
/// takes it, and a strength: "1.2-2.0:smile:0.8" or "2.4-2.8:45L". JSON is a list, or an object with a
/// list `events`, of `{"start_s": 1.2, "end_s": 2.0, "units": ["12", "45L"], "strength": 0.8,
/// "over_speech": false}`. The last two may be left out. `units` may also be one expression, such
/// as "left wink". A final L or R restricts a unit to the subject's left or right side; a strength is
/// 0 to 2, 1 as strong as the model itself; events may overlap.
/// `weights_dir`: as in `anyface_expression_read()`. `json` receives a list with the units as lists;
/// free it with `anyface_text_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for times that do not rise, an unknown unit, a strength
/// out of range, and words that describe no expression; the message names the event, counted from 1.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_events_read(
    weights_dir: *const c_char,
    text: *const c_char,
    json: *mut *mut c_char,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let text = unsafe { pointer::text("text", text) }?;
        let events = unsafe { reader(weights_dir) }?.events(text)?;
        Ok(events_to_json(&events))
    };
    unsafe { guard::give_text(json, error, make) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyface::conditions::MENU;
    use std::{
        ffi::CStr,
        ptr::{null, null_mut},
    };

    type Read = unsafe extern "C" fn(
        *const c_char,
        *const c_char,
        *mut *mut c_char,
        *mut *mut AnyfaceError,
    ) -> AnyfaceStatus;

    fn read(function: Read, text: &str) -> String {
        let (text, mut json) = (CString::new(text).unwrap(), null_mut());
        unsafe {
            let status = function(null(), text.as_ptr(), &mut json, null_mut());
            assert_eq!(status, AnyfaceStatus::Ok);
            let copy = CStr::from_ptr(json).to_str().unwrap().to_owned();
            anyface_text_free(json);
            copy
        }
    }

    #[test]
    fn words_become_units_with_sides() {
        let json = read(anyface_expression_read, "winks with the right eye");
        assert!(
            json.contains(r#""45R""#) && json.contains(r#""hint":"""#),
            "{json}"
        );
        let json = read(anyface_expression_read, "");
        assert!(
            json.contains(r#""units":[]"#) && json.contains("says nothing"),
            "{json}"
        );
    }

    #[test]
    fn every_word_of_the_menu_has_units() {
        for (word, _) in MENU {
            let json = read(anyface_expression_read, word);
            let start = format!(r#"{{"said":"{word}","units":[""#);
            assert!(json.starts_with(&start), "{json}");
        }
    }

    #[test]
    fn lines_and_json_give_the_same_events() {
        let row = r#"[{"start_s":1.2,"end_s":2.0,"units":["12","6L"],"strength":0.8,"over_speech":false}]"#;
        assert_eq!(read(anyface_events_read, "1.2-2.0:12,6L:0.8"), row);
        assert_eq!(read(anyface_events_read, row), row);
    }

    #[test]
    fn a_failure_writes_no_text() {
        let mut json = null_mut();
        unsafe {
            let status = anyface_events_read(null(), c"x".as_ptr(), &mut json, null_mut());
            assert_eq!(status, AnyfaceStatus::InvalidInput);
            let status = anyface_events_read(null(), null(), &mut json, null_mut());
            assert_eq!(status, AnyfaceStatus::NullPointer);
            let status = anyface_events_read(null(), c"".as_ptr(), null_mut(), null_mut());
            assert_eq!(status, AnyfaceStatus::NullPointer);
            anyface_text_free(json);
        }
        assert!(json.is_null());
    }
}
