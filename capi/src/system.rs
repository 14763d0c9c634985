//! The systems of this library and the controls that each of them understands.

use std::{ffi::CString, ptr::null, sync::LazyLock};

use anyface::{
    conditions::{Control, ControlStage, ControlValues},
    systems::{Ability, Registration, SYSTEMS},
};
use libc::c_char;

use crate::{
    guard, sliders,
    status::AnyfaceStatus,
    versioned_options::{self, Versioned},
};

/// The meaning of a control's numbers; for `AnyfaceControl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AnyfaceControlValues {
    /// Any number within the range.
    Real = 0,
    /// Whole numbers within the range.
    Whole = 1,
    /// The number of one of `choices`.
    Choice = 2,
}

/// The stage that a control changes; for `AnyfaceControl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AnyfaceControlStage {
    /// A face: set it in `AnyfaceFaceOptions`.
    Face = 0,
    /// A performance: set it in `AnyfaceMotionOptions`.
    Motion = 1,
}

/// A setting that a system lets its user change. All texts live as long as the library is loaded.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct AnyfaceControl {
    /// Size in bytes of this struct in the caller's header.
    pub struct_size: usize,
    /// The name by which it is set, such as "blinks_per_minute".
    pub name: *const c_char,
    /// The name to show to people.
    pub label: *const c_char,
    /// One or two sentences of help.
    pub help: *const c_char,
    /// The unit of its numbers: "s", "per_minute", or "".
    pub unit: *const c_char,
    /// `[choice_count]`: the names of the choices; NULL if `values` is not a choice.
    pub choices: *const *const c_char,
    /// Number of names in `choices`.
    pub choice_count: usize,
    /// An `AnyfaceControlValues`.
    pub values: i32,
    /// An `AnyfaceControlStage`.
    pub stage: i32,
    /// The least number.
    pub low: f32,
    /// The largest number.
    pub high: f32,
    /// The number that applies if a user sets none.
    pub default_value: f32,
    /// The number that leaves the motion as the system made it.
    pub neutral: f32,
    /// 1 if it may have keys over time, else 0.
    pub animatable: i32,
    /// Always 0.
    pub reserved: u32,
}

unsafe impl Versioned for AnyfaceControl {
    const NAME: &'static str = "anyface_control";
    const FIRST_SIZE: usize = size_of::<Self>();
    fn defaults() -> Self {
        AnyfaceControl {
            struct_size: size_of::<Self>(),
            stage: AnyfaceControlStage::Motion as i32,
            ..Self::zero()
        }
    }
}

/// A system as C reads it. Its texts are never freed: they live as long as the library is loaded.
struct Listed {
    name: *const c_char,
    label: *const c_char,
    help: *const c_char,
    controls: Vec<AnyfaceControl>,
}

// The pointers lead to texts and arrays that never change.
unsafe impl Send for Listed {}
unsafe impl Sync for Listed {}

static LIST: LazyLock<Vec<Listed>> = LazyLock::new(|| {
    let listed = SYSTEMS.iter().map(|system| Listed {
        name: lasting(system.name),
        label: lasting(system.label),
        help: lasting(system.help),
        controls: system.controls().map(AnyfaceControl::of).collect(),
    });
    listed.collect()
});

fn lasting(text: &str) -> *const c_char {
    CString::new(text).unwrap_or_default().into_raw()
}

impl AnyfaceControl {
    fn of(control: &Control) -> AnyfaceControl {
        let (values, names) = match control.values {
            ControlValues::Real => (AnyfaceControlValues::Real, &[][..]),
            ControlValues::Whole => (AnyfaceControlValues::Whole, &[][..]),
            ControlValues::Choice(names) => (AnyfaceControlValues::Choice, names),
        };
        let stage = match control.stage {
            ControlStage::Face => AnyfaceControlStage::Face,
            ControlStage::Motion => AnyfaceControlStage::Motion,
        };
        let choices: Vec<*const c_char> = names.iter().map(|name| lasting(name)).collect();
        AnyfaceControl {
            name: lasting(control.name),
            label: lasting(control.label),
            help: lasting(control.help),
            unit: lasting(control.unit),
            choice_count: choices.len(),
            choices: if choices.is_empty() {
                null()
            } else {
                choices.leak().as_ptr()
            },
            values: values as i32,
            stage: stage as i32,
            low: control.low,
            high: control.high,
            default_value: control.default,
            neutral: control.neutral,
            animatable: control.is_animatable.into(),
            ..Self::defaults()
        }
    }
}

fn of_system(system: usize, pick: fn(&Listed) -> *const c_char) -> *const c_char {
    guard::guard_or(null(), || LIST.get(system).map_or(null(), pick))
}

/// Number of systems that turn speech into motion. Number 0 is the default one.
#[unsafe(no_mangle)]
pub extern "C" fn anyface_system_count() -> usize {
    SYSTEMS.len()
}

/// The name by which `AnyfaceEngineOptions` selects a system. NULL for a number that is not below
/// the count. It lives as long as the library is loaded.
#[unsafe(no_mangle)]
pub extern "C" fn anyface_system_name(system: usize) -> *const c_char {
    of_system(system, |listed| listed.name)
}

/// The name of a system to show to people. NULL and lifetime are as for `anyface_system_name()`.
#[unsafe(no_mangle)]
pub extern "C" fn anyface_system_label(system: usize) -> *const c_char {
    of_system(system, |listed| listed.label)
}

/// A sentence of help for a system. NULL and lifetime are as for `anyface_system_name()`.
#[unsafe(no_mangle)]
pub extern "C" fn anyface_system_help(system: usize) -> *const c_char {
    of_system(system, |listed| listed.help)
}

/// Number of controls that a system understands. 0 for a number that is not below the count.
#[unsafe(no_mangle)]
pub extern "C" fn anyface_system_control_count(system: usize) -> usize {
    guard::guard_or(0, || {
        LIST.get(system).map_or(0, |listed| listed.controls.len())
    })
}

fn can(system: usize, ability: Ability) -> i32 {
    let system = SYSTEMS.get(system);
    system.is_some_and(|system| system.can(ability)).into()
}

/// 1 if a system shows the events of `AnyfaceMotionOptions`, else 0. 0 for a number that is not
/// below the count.
#[unsafe(no_mangle)]
pub extern "C" fn anyface_system_takes_events(system: usize) -> i32 {
    can(system, Ability::Events)
}

/// 1 if a system hears emotion in the voice or in `emotion_of` of `AnyfaceMotionOptions`, else 0. 0
/// for a number that is not below the count.
#[unsafe(no_mangle)]
pub extern "C" fn anyface_system_hears_emotion(system: usize) -> i32 {
    can(system, Ability::Emotion)
}

/// 1 if a system can start from the pose of `starts_from` of `AnyfaceMotionOptions`, else 0. 0 for
/// a number that is not below the count.
#[unsafe(no_mangle)]
pub extern "C" fn anyface_system_starts_from_pose(system: usize) -> i32 {
    can(system, Ability::FirstPose)
}

/// 1 if takes of a system have this `AnyfaceSlider`, else 0. 0 for an unknown system or slider.
#[unsafe(no_mangle)]
pub extern "C" fn anyface_system_has_slider(system: usize, slider: i32) -> i32 {
    let has = |system: &&Registration| {
        let known = sliders::known(slider);
        known.is_ok_and(|slider| system.sliders.contains(&slider))
    };
    SYSTEMS.get(system).is_some_and(has).into()
}

/// Describes a control of a system. Controls are numbered in the order in which a panel shows them.
/// `struct_size` is `sizeof *out`.
///
/// Fails with `ANYFACE_STATUS_NULL_POINTER` if `out` is NULL, or with
/// `ANYFACE_STATUS_INVALID_INPUT` for an unknown system or control, or for a size that no version
/// had.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_system_control(
    system: usize,
    control: usize,
    out: *mut AnyfaceControl,
    struct_size: usize,
) -> AnyfaceStatus {
    guard::guard_or(AnyfaceStatus::Panic, || {
        let listed = LIST
            .get(system)
            .and_then(|listed| listed.controls.get(control));
        match listed {
            Some(control) => unsafe { versioned_options::write(*control, out, struct_size) },
            None => AnyfaceStatus::InvalidInput,
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ffi::CStr;

    #[test]
    fn every_control_of_the_registry_is_described() {
        for (number, system) in SYSTEMS.iter().enumerate() {
            let name = unsafe { CStr::from_ptr(anyface_system_name(number)) };
            assert_eq!(name.to_str(), Ok(system.name));
            assert!(
                !anyface_system_label(number).is_null() && !anyface_system_help(number).is_null()
            );
            assert_eq!(
                anyface_system_takes_events(number) == 1,
                system.can(Ability::Events)
            );
            assert_eq!(
                anyface_system_hears_emotion(number) == 1,
                system.can(Ability::Emotion)
            );
            assert_eq!(
                anyface_system_starts_from_pose(number) == 1,
                system.can(Ability::FirstPose)
            );
            let sliders = (0..4).map(|slider| anyface_system_has_slider(number, slider));
            assert_eq!(sliders.sum::<i32>() as usize, system.sliders.len());
            assert_eq!(anyface_system_has_slider(number, 4), 0);
            assert_eq!(
                anyface_system_control_count(number),
                system.controls().count()
            );
            for (at, control) in system.controls().enumerate() {
                let mut out = AnyfaceControl::defaults();
                let size = size_of::<AnyfaceControl>();
                let status = unsafe { anyface_system_control(number, at, &mut out, size) };
                assert_eq!(status, AnyfaceStatus::Ok);
                let name = unsafe { CStr::from_ptr(out.name) };
                assert_eq!(name.to_str(), Ok(control.name));
                assert_eq!((out.low, out.high), (control.low, control.high));
                assert_eq!(out.choices.is_null(), out.choice_count == 0);
            }
        }
    }

    #[test]
    fn systems_and_controls_that_are_not_there_are_refused() {
        let mut out = AnyfaceControl::defaults();
        let size = size_of::<AnyfaceControl>();
        assert!(anyface_system_name(SYSTEMS.len()).is_null());
        assert_eq!(anyface_system_control_count(SYSTEMS.len()), 0);
        assert_eq!(anyface_system_takes_events(SYSTEMS.len()), 0);
        assert_eq!(anyface_system_hears_emotion(SYSTEMS.len()), 0);
        assert_eq!(anyface_system_has_slider(SYSTEMS.len(), 0), 0);
        for (system, control, size) in [(SYSTEMS.len(), 0, size), (0, usize::MAX, size), (0, 0, 3)]
        {
            let status = unsafe { anyface_system_control(system, control, &mut out, size) };
            assert_eq!(status, AnyfaceStatus::InvalidInput);
        }
        assert!(out.name.is_null());
    }
}
