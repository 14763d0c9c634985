//! Events: what a face does and when, for systems that support them.

use std::ffi::CString;

use anyface::{
    conditions::{Event, read_unit},
    text::events_to_json,
};
use libc::c_char;

use crate::{
    error::{AnyfaceError, Failure},
    expression::reader,
    guard, pointer,
    status::AnyfaceStatus,
};

/// What a face does for a while; for `anyface_events_new()`.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct AnyfaceEvent {
    /// First second, 0 or more.
    pub start_s: f64,
    /// Last second, above the first.
    pub end_s: f64,
    /// `[unit_count]`, UTF-8: action units such as "12" or "AU1". A final L or R restricts a unit
    /// to the subject's left or right side: "45L".
    pub units: *const *const c_char,
    /// Number of units, 1 or more.
    pub unit_count: usize,
    /// 0 to 2; 1 is the strength that the model itself gives. It has no default, so set it.
    pub strength: f32,
    /// 1 if the event overrides the speech, so that lips may stay apart that the speech would
    /// close; otherwise 0.
    pub over_speech: i32,
}

/// Events of a performance. They never change once they are made: any number of threads may use
/// them at the same time.
pub struct AnyfaceEvents {
    pub(crate) rows: Vec<Event>,
    json: CString,
}

/// Makes events from arrays, which are copied; `anyface_events_json()` puts them into a request.
///
/// `events`: `[event_count]`, in any order; they may overlap. Free with `anyface_events_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for times that do not rise, an unknown unit or a
/// strength out of range; the message names the event, counted from 1.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_events_new(
    events: *const AnyfaceEvent,
    event_count: usize,
    out: *mut *mut AnyfaceEvents,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let rows = unsafe { pointer::slice("events", events, event_count, 1) }?;
        let read = |(row, event): (usize, &AnyfaceEvent)| {
            unsafe { event.to_library() }.map_err(|failure| named(row, failure))
        };
        let events = rows
            .iter()
            .enumerate()
            .map(read)
            .collect::<Result<_, _>>()?;
        Ok(AnyfaceEvents::new(events))
    };
    unsafe { guard::give(out, error, make) }
}

/// Reads events from JSON: a list, or an object with a list `events`, of `{"start_s": 1.2, "end_s":
/// 2.0, "units": ["12", "45L"], "strength": 0.8, "over_speech": false}`. The last two may be left
/// out. `units` may also be one expression, such as "left wink".
///
/// `weights_dir`: as in `anyface_expression_new()`. `json`: UTF-8. Free with
/// `anyface_events_free()`. Fails like `anyface_events_from_text()`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_events_parse(
    weights_dir: *const c_char,
    json: *const c_char,
    out: *mut *mut AnyfaceEvents,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let json = unsafe { pointer::text("json", json) }?;
        let events = unsafe { reader(weights_dir) }?.events_of_json(json)?;
        Ok(AnyfaceEvents::new(events))
    };
    unsafe { guard::give(out, error, make) }
}

/// Reads events from lines of text, as the command-line program does. A line holds seconds, units
/// or words, and a strength: "1.2-2.0:smile:0.8" or "2.4-2.8:45L". The text after the seconds is
/// read like that of `anyface_expression_new()`. Empty lines are skipped.
///
/// `weights_dir`: as in `anyface_expression_new()`. `text`: UTF-8. Free with
/// `anyface_events_free()`. Fails like `anyface_events_new()`, and for words that describe no
/// expression; the message then suggests the nearest one that does.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_events_from_text(
    weights_dir: *const c_char,
    text: *const c_char,
    out: *mut *mut AnyfaceEvents,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let text = unsafe { pointer::text("text", text) }?;
        let reader = unsafe { reader(weights_dir) }?;
        let lines = text.lines().filter(|line| !line.trim().is_empty());
        let read = |(row, line): (usize, &str)| {
            reader.event(line).map_err(|error| named(row, error.into()))
        };
        let events = lines.enumerate().map(read).collect::<Result<_, _>>()?;
        Ok(AnyfaceEvents::new(events))
    };
    unsafe { guard::give(out, error, make) }
}

/// The events as JSON that `anyface_events_parse()` can read: a list of rows, each with all fields
/// and its units as a list. NULL for NULL. Lives as long as the events.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_events_json(events: *const AnyfaceEvents) -> *const c_char {
    pointer::lend(unsafe { events.as_ref() }.map(|events| &events.json))
}

/// Number of events; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_events_count(events: *const AnyfaceEvents) -> usize {
    unsafe { events.as_ref() }.map_or(0, |events| events.rows.len())
}

/// Frees events that no running call uses; nothing happens for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_events_free(events: *mut AnyfaceEvents) {
    unsafe { guard::free(events) }
}

impl AnyfaceEvents {
    pub(crate) fn new(rows: Vec<Event>) -> AnyfaceEvents {
        let json = pointer::c_text(&events_to_json(&rows));
        AnyfaceEvents { rows, json }
    }
}

impl AnyfaceEvent {
    /// # Safety
    /// `units` meets the documentation of its field.
    unsafe fn to_library(self) -> Result<Event, Failure> {
        let over_speech = match self.over_speech {
            0 => false,
            1 => true,
            other => {
                let message = format!("over_speech: expected 0 or 1, got {other}");
                return Err(Failure::invalid(message));
            }
        };
        let texts = unsafe { pointer::slice("units", self.units, self.unit_count, 1) }?;
        let mut units = Vec::with_capacity(texts.len());
        for text in texts {
            let text = unsafe { pointer::text("units", *text) }?;
            units.push(read_unit(text)?);
        }
        let event = Event {
            slot_s: [self.start_s, self.end_s],
            units,
            strength: self.strength,
            over_speech,
        };
        event.check()?;
        Ok(event)
    }
}

/// Adds the number of the event to a failure, if it is about an invalid value.
fn named(row: usize, failure: Failure) -> Failure {
    match failure {
        Failure::Library(anyface::Error::InvalidInput(why)) => {
            Failure::invalid(format!("event {}: {why}", row + 1))
        }
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::{anyface_error_free, anyface_error_message};
    use anyface::conditions::ACTION_UNITS;
    use std::{
        ffi::CStr,
        ptr::{null, null_mut},
    };

    unsafe fn make_events(events: &[AnyfaceEvent]) -> Result<*mut AnyfaceEvents, String> {
        let (mut out, mut error) = (null_mut(), null_mut());
        let status =
            unsafe { anyface_events_new(events.as_ptr(), events.len(), &mut out, &mut error) };
        if status == AnyfaceStatus::Ok {
            return Ok(out);
        }
        let message = unsafe { CStr::from_ptr(anyface_error_message(error)) };
        let message = message.to_str().unwrap().to_owned();
        unsafe { anyface_error_free(error) };
        Err(message)
    }

    fn event(units: &[*const c_char]) -> AnyfaceEvent {
        AnyfaceEvent {
            start_s: 1.2,
            end_s: 2.0,
            units: units.as_ptr(),
            unit_count: units.len(),
            strength: 0.8,
            over_speech: 0,
        }
    }

    #[test]
    fn arrays_and_json_give_the_librarys_events() {
        let units = [c"12".as_ptr(), c"AU6L".as_ptr()];
        let json = cr#"[{"start_s": 1.2, "end_s": 2, "units": ["12", "6L"], "strength": 0.8}]"#;
        unsafe {
            let (from_arrays, mut from_json) = (make_events(&[event(&units)]).unwrap(), null_mut());
            let status = anyface_events_parse(null(), json.as_ptr(), &mut from_json, null_mut());
            assert_eq!(status, AnyfaceStatus::Ok);
            let expected = [Event::parse("1.2-2:12,6L:0.8").unwrap()];
            assert_eq!((*from_arrays).rows, expected);
            assert_eq!((*from_json).rows, expected);
            let written = CStr::from_ptr(anyface_events_json(from_json))
                .to_str()
                .unwrap();
            let row = r#"[{"start_s":1.2,"end_s":2.0,"units":["12","6L"],"strength":0.8,"over_speech":false}]"#;
            assert_eq!(written, row);
            assert_eq!(anyface_events_count(from_json), 1);
            anyface_events_free(from_arrays);
            anyface_events_free(from_json);
        }
        assert_eq!(unsafe { anyface_events_count(null()) }, 0);
    }

    #[test]
    fn lines_of_words_and_units_are_events() {
        let mut handle = null_mut();
        let text = c"1.2-2.0:smile:0.8\n\n2.4-2.8:45L\n";
        let status =
            unsafe { anyface_events_from_text(null(), text.as_ptr(), &mut handle, null_mut()) };
        assert_eq!(status, AnyfaceStatus::Ok);
        let events = unsafe { &(*handle).rows };
        assert_eq!(events.len(), 2);
        assert_eq!(events[1], Event::parse("2.4-2.8:45L").unwrap());
        assert!(
            events[0]
                .units
                .iter()
                .any(|(unit, _)| ACTION_UNITS[*unit].name == "12")
        );
        unsafe { anyface_events_free(handle) };
    }

    #[test]
    fn what_is_wrong_is_named_with_its_event() {
        let (good, bad) = ([c"12".as_ptr()], [c"99".as_ptr()]);
        let of = |change: fn(&mut AnyfaceEvent)| {
            let mut changed = event(&good);
            change(&mut changed);
            changed
        };
        for (wrong, reason) in [
            (event(&bad), "99"),
            (event(&[]), "units"),
            (of(|event| event.end_s = 1.0), "slot"),
            (of(|event| event.start_s = f64::NAN), "slot"),
            (of(|event| event.strength = f32::NAN), "strength"),
            (of(|event| event.over_speech = 2), "over_speech"),
        ] {
            let message = unsafe { make_events(&[event(&good), wrong]) }.unwrap_err();
            assert!(
                message.contains("event 2") && message.contains(reason),
                "{message}"
            );
        }
        let missing = of(|event| event.units = null());
        assert!(unsafe { make_events(&[missing]) }.is_err());
    }
}
