//! The values that a caller gives to the controls of a system.

use anyface::conditions::{ControlCurve, Controls};
use libc::c_char;

use crate::{error::Failure, pointer};

/// The value of one control; `anyface_system_control()` lists the controls.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct AnyfaceControlSetting {
    /// Its name, such as "articulation", UTF-8.
    pub name: *const c_char,
    /// Its value, within the control's range. For a choice, the number of the chosen name.
    pub value: f32,
    /// Must be 0.
    pub reserved: u32,
    /// `[key_count]`: times in seconds, rising, at which the control has the values of
    /// `key_values`. It changes linearly between keys and keeps the first or last value outside
    /// them. NULL if it does not change over time.
    pub key_times_s: *const f64,
    /// `[key_count]`, within the control's range; NULL if it does not change over time.
    pub key_values: *const f64,
    /// Number of keys; 0 if the control does not change over time.
    pub key_count: usize,
}

/// Reads controls by name. Their ranges are checked later, when they are used.
///
/// # Safety
/// `settings` is NULL or valid for reads of `count` settings. Their pointers are NULL or meet the
/// documentation of their fields.
pub(crate) unsafe fn read(
    settings: *const AnyfaceControlSetting,
    count: usize,
) -> Result<Controls, Failure> {
    let mut controls = Controls::default();
    for setting in unsafe { pointer::slice("controls", settings, count, 1) }? {
        if setting.reserved != 0 {
            let got = setting.reserved;
            return Err(Failure::invalid(format!(
                "controls.reserved: expected 0, got {got}"
            )));
        }
        let name = unsafe { pointer::text("controls.name", setting.name) }?;
        let (times, values) = (setting.key_times_s, setting.key_values);
        let times = unsafe { pointer::slice("key_times_s", times, setting.key_count, 1) }?;
        let values = unsafe { pointer::slice("key_values", values, setting.key_count, 1) }?;
        let keys = times.iter().copied().zip(values.iter().copied());
        let curve = ControlCurve {
            value: setting.value,
            keys: keys.collect(),
        };
        controls.set_curve(name, curve);
    }
    Ok(controls)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use std::{ffi::CStr, ptr::null};

    pub(crate) fn setting(name: &'static CStr, value: f32) -> AnyfaceControlSetting {
        AnyfaceControlSetting {
            name: name.as_ptr(),
            value,
            reserved: 0,
            key_times_s: null(),
            key_values: null(),
            key_count: 0,
        }
    }

    #[test]
    fn values_and_keys_reach_the_library() {
        let (times, values) = ([0.0, 2.0], [0.5, 1.5]);
        let settings = [
            setting(c"jaw", 0.5),
            AnyfaceControlSetting {
                key_times_s: times.as_ptr(),
                key_values: values.as_ptr(),
                key_count: 2,
                ..setting(c"articulation", 1.0)
            },
        ];
        let controls = unsafe { read(settings.as_ptr(), 2) }.unwrap();
        assert_eq!(controls.get("jaw"), Some(0.5));
        let curve = controls.animated("articulation").unwrap();
        assert_eq!((curve.value, curve.at(1.0)), (1.0, 1.0));
    }

    #[test]
    fn settings_without_a_name_or_with_half_a_curve_are_refused() {
        let nameless = AnyfaceControlSetting {
            name: null(),
            ..setting(c"x", 0.0)
        };
        let half = AnyfaceControlSetting {
            key_count: 1,
            ..setting(c"articulation", 1.0)
        };
        let odd = AnyfaceControlSetting {
            reserved: 1,
            ..setting(c"articulation", 1.0)
        };
        for wrong in [nameless, half, odd] {
            assert!(unsafe { read(&raw const wrong, 1) }.is_err());
        }
        assert_eq!(unsafe { read(null(), 0) }.unwrap(), Controls::default());
    }
}
