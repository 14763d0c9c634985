//! Which devices there are, and the one that a name means.

use cpal::{
    Device, Host, HostId, SampleFormat, SupportedStreamConfig,
    traits::{DeviceTrait, HostTrait},
};

use crate::SAMPLE_RATE_HZ;

/// Why no sound comes.
#[derive(Debug, thiserror::Error)]
pub enum MicrophoneError {
    /// The system lists no device that records.
    #[error(
        "microphone: expected a device that records, and this system lists none; plug one in, and let programs use it in \
         the system's privacy settings"
    )]
    None,
    /// No device, or several, have this name.
    #[error("microphone: expected one of {}, got {name:?}", .names.join(", "))]
    Name {
        /// What was asked for.
        name: String,
        /// What there is.
        names: Vec<String>,
    },
    /// The device is there and cannot be used.
    #[error("microphone: {name} cannot be opened: {reason}")]
    Device {
        /// Name of the device.
        name: String,
        /// What the system says.
        reason: String,
    },
}

/// Names of the devices that record, the system's own choice first.
pub fn devices() -> Vec<String> {
    let host = usual_host();
    let mut names = names_of(&recorders(&host));
    if let Some(first) = host.default_input_device() {
        let first = name_of(&first);
        names.sort_by_key(|name| *name != first);
    }
    names
}

/// The sound system that serves this machine.
pub(crate) fn usual_host() -> Host {
    quieten();
    cpal::default_host()
}

/// Keeps ALSA's library from writing to standard error about devices that it tries, in this thread.
fn quieten() {
    #[cfg(target_os = "linux")]
    let _ = alsa::Output::local_error_handler();
}

fn recorders(host: &Host) -> Vec<Device> {
    let devices = host.input_devices();
    devices.map_or(Vec::new(), |all| all.filter(is_device).collect())
}

/// Whether a person would call it a device: ALSA also lists its plugins, such as one that discards all samples.
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

/// The device of that name, of which a part is enough where no other device has it; the system's choice for none. It is
/// looked for in the sound system `host`, or else in the usual one.
pub(crate) fn device_named(
    name: Option<&str>,
    host: Option<HostId>,
) -> Result<Device, MicrophoneError> {
    let host = match host {
        None => usual_host(),
        // One that stopped may be back later.
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

/// Which of `names` is meant by `name`: the same, or the only one that holds it.
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

/// How a device is asked to record: at our own rate and with one channel where it can, else as it likes best.
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
