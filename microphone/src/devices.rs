//! Lists the recording devices and finds the one that a name means.

use cpal::{
    Device, Host, HostId, SampleFormat, SupportedStreamConfig,
    traits::{DeviceTrait, HostTrait},
};

use crate::SAMPLE_RATE_HZ;

/// Why a sound device cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum MicrophoneError {
    /// The system lists no device that records.
    #[error(
        "microphone: expected a device that records, and this system lists none; plug one in, and let programs use it in \
         the system's privacy settings"
    )]
    None,
    /// No device matches this name, or several do.
    #[error("microphone: expected one of {}, got {name:?}", .names.join(", "))]
    Name {
        /// The requested name.
        name: String,
        /// The names of all recording devices.
        names: Vec<String>,
    },
    /// The device exists but cannot be used.
    #[error("microphone: {name} cannot be opened: {reason}")]
    Device {
        /// Name of the device.
        name: String,
        /// The system's reason.
        reason: String,
    },
}

/// The names of the recording devices, the system's default device first.
pub fn devices() -> Vec<String> {
    let host = usual_host();
    let mut names = names_of(&recorders(&host));
    if let Some(first) = host.default_input_device() {
        let first = name_of(&first);
        names.sort_by_key(|name| *name != first);
    }
    names
}

/// The default sound system of this machine.
pub(crate) fn usual_host() -> Host {
    quieten();
    cpal::default_host()
}

/// Keeps ALSA, in this thread, from writing to standard error about the devices that it tries.
fn quieten() {
    #[cfg(target_os = "linux")]
    let _ = alsa::Output::local_error_handler();
}

fn recorders(host: &Host) -> Vec<Device> {
    let devices = host.input_devices();
    devices.map_or(Vec::new(), |all| all.filter(is_device).collect())
}

/// Whether a person would call this a device. ALSA also lists its plugins, such as one that
/// discards all samples.
fn is_device(device: &Device) -> bool {
    let Ok(id) = device.id() else {
        return true;
    };
    let cards = ["hw:", "plughw:", "sysdefault:"];
    id.host().name() != "ALSA"
        || ["default", "pipewire", "pulse"].contains(&id.id())
        || cards.iter().any(|card| id.id().starts_with(card))
}

fn names_of(devices: &[Device]) -> Vec<String> {
    let mut names: Vec<String> = devices.iter().map(name_of).collect();
    names.sort();
    names.dedup();
    names
}

pub(crate) fn name_of(device: &Device) -> String {
    let description = device.description();
    description.map_or_else(|_| device.to_string(), |d| d.name().to_owned())
}

/// The device called `name`, or the system's default device if there is no name. Part of a name is
/// enough if no other device has it. Looks in the sound system `host`, or in the usual one if
/// `None`.
pub(crate) fn device_named(
    name: Option<&str>,
    host: Option<HostId>,
) -> Result<Device, MicrophoneError> {
    let host = match host {
        None => usual_host(),
        // A sound system that has stopped may be back later.
        Some(id) => {
            quieten();
            cpal::host_from_id(id).map_err(|_| MicrophoneError::None)?
        }
    };
    let Some(name) = name else {
        return host.default_input_device().ok_or(MicrophoneError::None);
    };
    let mut devices = recorders(&host);
    if devices.is_empty() {
        return Err(MicrophoneError::None);
    }
    let names: Vec<String> = devices.iter().map(name_of).collect();
    match place_of(name, &names) {
        Some(place) => Ok(devices.swap_remove(place)),
        None => Err(MicrophoneError::Name {
            name: name.to_owned(),
            names: names_of(&devices),
        }),
    }
}

/// The index of the entry that `name` means: the equal one, or else the only name that contains it,
/// ignoring case.
fn place_of(name: &str, names: &[String]) -> Option<usize> {
    if let Some(place) = names.iter().position(|known| known == name) {
        return Some(place);
    }
    let name = name.to_lowercase();
    let holds = |known: &String| known.to_lowercase().contains(&name);
    let mut places = names.iter().enumerate().filter(|(_, known)| holds(known));
    let (place, first) = places.next()?;
    places.all(|(_, other)| other == first).then_some(place)
}

/// The settings to record a device with: our own rate and as few channels as possible, or the
/// device's default settings if it does not support our rate.
pub(crate) fn recording_of(device: &Device) -> Result<SupportedStreamConfig, cpal::Error> {
    let ranges = device
        .supported_input_configs()
        .map_or(Vec::new(), Iterator::collect);
    let ours = ranges
        .into_iter()
        .filter(|range| is_known(range.sample_format()))
        .filter_map(|range| range.try_with_sample_rate(SAMPLE_RATE_HZ))
        .min_by_key(|config| (config.channels(), rank(config.sample_format())));
    match ours {
        Some(config) => Ok(config),
        None => device.default_input_config(),
    }
}

fn is_known(format: SampleFormat) -> bool {
    rank(format) < 3
}

fn rank(format: SampleFormat) -> usize {
    match format {
        SampleFormat::F32 => 0,
        SampleFormat::I16 => 1,
        SampleFormat::I32 => 2,
        _ => 3,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_of_a_name_is_enough_where_no_other_device_has_it() {
        let names = ["USB Mic", "USB Camera", "Built-in"].map(str::to_owned);
        assert_eq!(place_of("built", &names), Some(2));
        assert_eq!(place_of("USB Mic", &names), Some(0));
        assert_eq!(place_of("usb", &names), None, "two devices");
        assert_eq!(place_of("line", &names), None);
        let twins = ["Mic", "Mic"].map(str::to_owned);
        assert_eq!(place_of("mic", &twins), Some(0), "both are as good");
    }

    #[test]
    fn an_error_names_what_there_is() {
        let error = MicrophoneError::Name {
            name: "x".into(),
            names: vec!["a".into(), "b".into()],
        };
        assert_eq!(
            error.to_string(),
            "microphone: expected one of a, b, got \"x\""
        );
    }
}
