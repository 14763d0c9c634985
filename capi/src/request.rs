//! Requests: how an engine, a face and a performance shall be, by name.

use std::{
    ffi::CString,
    ptr::null,
    sync::{Arc, LazyLock},
};

use anyface::{
    EngineOptions, Error, MotionRequest,
    conditions::{ControlStage, Controls, Emotion, EmotionCurve},
    face::FaceOptions,
    motion::Performer,
    rig::ShapeSource,
    systems::{FIELDS, FieldValue, NamedValue, SYSTEMS, describe, set_field},
};
use libc::c_char;
use ndarray::ArrayView2;

use crate::{
    audio::AnyfaceAudio,
    error::{AnyfaceError, Failure},
    guard,
    options::{self, OPTIONS, Options},
    pointer,
    status::AnyfaceStatus,
};

/// How an engine, a face and a performance shall be. `anyface_describe()` lists the names of fields
/// and controls that a system obeys; `anyface_engine_new()`, `anyface_face_new()`,
/// `anyface_rig_new()` and `anyface_stream_obey()` say what else they read. Whatever is not set has
/// its default. One request may serve any number of engines, faces, performances and streams: each
/// reads only what concerns it. No other call may use it while it is changed.
#[derive(Default)]
pub struct AnyfaceRequest {
    performance: MotionRequest,
    pub(crate) options: Options,
}

impl AnyfaceRequest {
    /// The performer, and how strongly it is shown.
    pub(crate) fn performer(&self) -> (Option<Arc<Performer>>, f32) {
        let MotionRequest {
            performer,
            performer_strength,
            ..
        } = &self.performance;
        (performer.clone(), *performer_strength)
    }

    /// The request of a performance. NULL asks for nothing.
    ///
    /// # Safety
    /// `request` is NULL or a request that is neither freed nor changed during the call.
    pub(crate) unsafe fn motion(request: *const AnyfaceRequest) -> MotionRequest {
        let Some(AnyfaceRequest { performance, .. }) = (unsafe { request.as_ref() }) else {
            return MotionRequest::default();
        };
        MotionRequest {
            controls: of_stage(&performance.controls, ControlStage::Motion),
            ..performance.clone()
        }
    }

    /// The options of an engine. NULL asks for nothing.
    ///
    /// # Safety
    /// As [`AnyfaceRequest::motion`].
    pub(crate) unsafe fn engine(request: *const AnyfaceRequest) -> EngineOptions {
        let request = unsafe { request.as_ref() };
        request.map_or_else(EngineOptions::default, |request| {
            request.options.engine.clone()
        })
    }

    /// What is known about a face. NULL asks for nothing.
    ///
    /// # Safety
    /// As [`AnyfaceRequest::motion`].
    pub(crate) unsafe fn face(request: *const AnyfaceRequest) -> Result<FaceOptions, Failure> {
        let Some(request) = (unsafe { request.as_ref() }) else {
            return Ok(FaceOptions::default());
        };
        let controls = of_stage(&request.performance.controls, ControlStage::Face);
        request.options.face.to_library(controls)
    }

    /// What makes the shapes of a rig. NULL asks for nothing.
    ///
    /// # Safety
    /// As [`AnyfaceRequest::motion`].
    pub(crate) unsafe fn shape_source(request: *const AnyfaceRequest) -> ShapeSource {
        let request = unsafe { request.as_ref() };
        request.map_or(ShapeSource::Network, |request| {
            request.options.shape_source()
        })
    }

    /// The emotion that a stream shows.
    pub(crate) fn emotion(&self) -> &EmotionCurve {
        &self.performance.emotion
    }

    /// The emotion, if it is a named one that does not change over time.
    pub(crate) fn named_emotion(&self) -> Result<Emotion, Failure> {
        let got = match self.emotion() {
            EmotionCurve::Constant(emotion) => return Ok(*emotion),
            EmotionCurve::Keys(_) => "one that changes over time",
            EmotionCurve::Auto => "auto",
            EmotionCurve::Arousal => "auto-arousal",
            EmotionCurve::Off => "off",
        };
        let message = format!("emotion: expected a name and a strength for a stream, got {got}");
        Err(Failure::invalid(message))
    }

    /// # Safety
    /// As for the functions below.
    pub(crate) unsafe fn set(
        request: *mut AnyfaceRequest,
        name: *const c_char,
        error: *mut *mut AnyfaceError,
        value: impl FnOnce() -> Result<FieldValue<'static>, Failure>,
    ) -> AnyfaceStatus {
        let work = || {
            let request = unsafe { pointer::handle_mut("request", request) }?;
            let name = unsafe { pointer::text("name", name) }?;
            Ok(request.set_value(NamedValue {
                name,
                value: value()?,
            })?)
        };
        unsafe { guard::guard(error, work) }
    }

    fn set_value(&mut self, named: NamedValue<'_>) -> anyface::Result<()> {
        check_name(named.name)?;
        match options::find(named.name) {
            Some(option) => (option.set)(&mut self.options, &named),
            None => set_field(&mut self.performance, named.name, named.value),
        }
    }
}

fn check_name(name: &str) -> anyface::Result<()> {
    let fields = FIELDS.iter().map(|field| field.name);
    let known: Vec<&str> = fields
        .chain(OPTIONS.iter().map(|option| option.name))
        .collect();
    let mut controls = SYSTEMS.iter().flat_map(|system| system.controls());
    if known.contains(&name) || controls.any(|control| control.name == name) {
        return Ok(());
    }
    Err(Error::InvalidInput(format!(
        "request: expected one of {} or a control of a system, got {name:?}",
        known.join(", ")
    )))
}

fn of_stage(controls: &Controls, stage: ControlStage) -> Controls {
    let known = SYSTEMS.iter().flat_map(|system| system.controls());
    controls.among(known.filter(|control| control.stage == stage))
}

static DESCRIPTIONS: LazyLock<CString> = LazyLock::new(|| {
    let systems: Vec<String> = SYSTEMS.iter().map(|system| describe(system)).collect();
    pointer::c_text(&format!("[{}]", systems.join(",")))
});

/// Describes the systems and what each of them obeys as a JSON list, the default system first. Each
/// is an object: `name`, by which "system" of a request selects it, `label` and `help`;
/// `abilities` ("events", "words", "emotion", "first_pose", "head"); `sliders`; `fields`, each with
/// `name`, `label`, `help` and `kind` ("number", "text", "emotion", "intervals", "events", "sound",
/// "pose"), numbers also with `low`, `high`, `default` and `is_whole`; `controls`, each with `name`, `label`, `help`, `unit`, `values` ("real", "whole",
/// "choice"), `choices`, `stage` ("face", "motion"), `low`, `high`, `default`, `neutral` and
/// `animatable`; `emotions` in the order of their strengths; `units` with `name` and `label`, and
/// `words`, both for events.
///
/// Lives as long as the library is loaded.
#[unsafe(no_mangle)]
pub extern "C" fn anyface_describe() -> *const c_char {
    guard::guard_or(null(), || pointer::lend(Some(&DESCRIPTIONS)))
}

/// Makes a request that asks for nothing. Free with `anyface_request_free()`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_request_new(
    out: *mut *mut AnyfaceRequest,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    unsafe { guard::give(out, error, || Ok(AnyfaceRequest::default())) }
}

/// Asks for a text: fields of the kinds "text", "emotion" ("happy:0.7", "auto", "auto-arousal",
/// "off") and "events" (`anyface_events_read()`), the seed, controls that are a choice, and what else
/// is said to be a text, such as "system" of `anyface_engine_new()`. An empty text asks for nothing.
///
/// `name` and `text`: UTF-8. Fails with `ANYFACE_STATUS_INVALID_INPUT` for an unknown name, for a
/// field that takes something else, or for a text that it cannot read. The request is then as it was.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_request_set_text(
    request: *mut AnyfaceRequest,
    name: *const c_char,
    text: *const c_char,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    unsafe {
        AnyfaceRequest::set(request, name, error, || {
            Ok(FieldValue::Text(pointer::text("text", text)?))
        })
    }
}

/// Asks for a number: fields of the kind "number", controls, and what else is said to be a number,
/// such as "threads" of `anyface_engine_new()`. For a control that is a choice, the number of the
/// chosen name.
///
/// Fails like `anyface_request_set_text()`. The range of a control is checked when it is used.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_request_set_number(
    request: *mut AnyfaceRequest,
    name: *const c_char,
    number: f64,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    unsafe { AnyfaceRequest::set(request, name, error, || Ok(FieldValue::Number(number))) }
}

/// Asks for rows of numbers: fields of the kinds "emotion" (`column_count` is
/// `ANYFACE_EMOTION_COUNT`, strengths of 0 or more, each row with a sum of at most 1.5) and
/// "intervals" (2 columns: start and end, seconds, no times), controls that change over time (1
/// column), and what else is said to be rows (no times), such as "landmarks" of `anyface_face_new()`.
///
/// `times_s`: `[row_count]`, seconds, rising: values are linear between the rows, and constant before
/// the first and after the last. NULL for rows without times and for a single row of an emotion.
/// `values`: `[row_count, column_count]`. Both are copied.
/// Fails like `anyface_request_set_text()`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_request_set_rows(
    request: *mut AnyfaceRequest,
    name: *const c_char,
    times_s: *const f64,
    values: *const f64,
    row_count: usize,
    column_count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let rows = || {
        let values = unsafe { pointer::slice("values", values, row_count, column_count) }?;
        let rows = ArrayView2::from_shape((row_count, column_count), values).map_err(|_| {
            Failure::invalid("values: expected row_count times column_count numbers")
        })?;
        let times_s = if times_s.is_null() {
            None
        } else {
            Some(unsafe { pointer::slice("times_s", times_s, row_count, 1) }?)
        };
        Ok(FieldValue::Rows(times_s, rows))
    };
    unsafe { AnyfaceRequest::set(request, name, error, rows) }
}

/// Asks for a field of the kind "sound". The sound is copied.
///
/// Fails like `anyface_request_set_text()`, and with `ANYFACE_STATUS_AUDIO` for a sound that is silent
/// or too short.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_request_set_sound(
    request: *mut AnyfaceRequest,
    name: *const c_char,
    sound: *const AnyfaceAudio,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    unsafe {
        AnyfaceRequest::set(request, name, error, || {
            Ok(FieldValue::Sound(&pointer::handle("sound", sound)?.0))
        })
    }
}

/// Frees a request that no running call uses; nothing happens for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_request_free(request: *mut AnyfaceRequest) {
    unsafe { guard::free(request) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::{
        ffi::CStr,
        ptr::{null, null_mut},
    };

    const OK: AnyfaceStatus = AnyfaceStatus::Ok;

    /// A request with one number.
    fn with_number(name: &CStr, number: f64) -> AnyfaceRequest {
        let mut request = AnyfaceRequest::default();
        let status =
            unsafe { anyface_request_set_number(&mut request, name.as_ptr(), number, null_mut()) };
        assert_eq!(status, OK);
        request
    }

    #[test]
    fn texts_numbers_and_rows_reach_the_library() {
        let mut request = with_number(c"fps", 24.0);
        let (times, values) = ([0.0, 2.0], [0.5, 1.5]);
        let closures = [0.1, 0.2, 0.3, 0.4];
        unsafe {
            let own: *mut AnyfaceRequest = &mut request;
            let text = anyface_request_set_text;
            assert_eq!(
                text(own, c"emotion".as_ptr(), c"happy:0.5".as_ptr(), null_mut()),
                OK
            );
            assert_eq!(text(own, c"text".as_ptr(), c"a b".as_ptr(), null_mut()), OK);
            let name = c"articulation".as_ptr();
            let (at, of) = (times.as_ptr(), values.as_ptr());
            assert_eq!(
                anyface_request_set_rows(own, name, at, of, 2, 1, null_mut()),
                OK
            );
            let (name, of) = (c"closures".as_ptr(), closures.as_ptr());
            assert_eq!(
                anyface_request_set_rows(own, name, null(), of, 2, 2, null_mut()),
                OK
            );
        }
        let whole = unsafe { AnyfaceRequest::motion(&request) };
        assert_eq!(
            (whole.fps, whole.closures),
            (24.0, Some(vec![[0.1, 0.2], [0.3, 0.4]]))
        );
        assert!((whole.emotion.strongest() - 0.5).abs() < 1e-6 && whole.script.is_some());
        assert_eq!(
            whole.controls.animated("articulation").unwrap().at(1.0),
            1.0
        );
    }

    #[test]
    fn a_face_and_a_performance_read_their_own_controls() {
        let mut request = with_number(c"learned", 0.5);
        let name = c"articulation".as_ptr();
        unsafe { anyface_request_set_number(&mut request, name, 1.3, null_mut()) };
        let face = unsafe { AnyfaceRequest::face(&request) }.unwrap().controls;
        let motion = unsafe { AnyfaceRequest::motion(&request) }.controls;
        assert_eq!(
            (face.get("learned"), face.get("articulation")),
            (Some(0.5), None)
        );
        assert_eq!(
            (motion.get("learned"), motion.get("articulation")),
            (None, Some(1.3))
        );
        let nothing = unsafe { AnyfaceRequest::face(null()) };
        assert_eq!(nothing.unwrap(), FaceOptions::default());
    }

    #[test]
    fn a_refusal_leaves_the_request_as_it_was() {
        let mut request = with_number(c"fps", 24.0);
        let own: *mut AnyfaceRequest = &mut request;
        unsafe {
            for (name, number) in [
                (c"fps", 0.0),
                (c"fps", f64::NAN),
                (c"winks", 1.0),
                (c"text", 1.0),
            ] {
                let status = anyface_request_set_number(own, name.as_ptr(), number, null_mut());
                assert_eq!(status, AnyfaceStatus::InvalidInput);
            }
            let status = anyface_request_set_number(own, null(), 1.0, null_mut());
            assert_eq!(status, AnyfaceStatus::NullPointer);
            let status =
                anyface_request_set_text(null_mut(), c"text".as_ptr(), c"a".as_ptr(), null_mut());
            assert_eq!(status, AnyfaceStatus::NullPointer);
            let name = c"articulation".as_ptr();
            let status = anyface_request_set_rows(own, name, null(), null(), 2, 1, null_mut());
            assert_eq!(status, AnyfaceStatus::NullPointer);
        }
        assert_eq!(unsafe { AnyfaceRequest::motion(own) }.fps, 24.0);
    }

    #[test]
    fn every_system_is_described_and_the_default_one_first() {
        let text = unsafe { CStr::from_ptr(anyface_describe()) };
        let list: Vec<serde_json::Value> = serde_json::from_str(text.to_str().unwrap()).unwrap();
        let described: Vec<_> = list
            .iter()
            .map(|system| system["name"].as_str().unwrap())
            .collect();
        let names: Vec<_> = SYSTEMS.iter().map(|system| system.name).collect();
        assert_eq!(described, names);
    }
}
