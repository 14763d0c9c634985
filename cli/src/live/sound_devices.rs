//! The sound devices of this machine: microphones, and loudspeakers that play the sound the face follows.

use anyface::{Error, Result};
use clap::Args;

use super::sound_library::{Microphone, Monitor, devices};
use crate::console::Console;

/// The longest delay of the played sound, in seconds.
const LONGEST_DELAY_S: f64 = 5.0;

/// Which sound devices are used.
#[derive(Args)]
pub struct DeviceArgs {
    /// The microphone, or a part of its name; see --devices [default: the system's choice]
    #[arg(long, value_name = "NAME", conflicts_with = "input")]
    microphone: Option<String>,
    /// List the microphones, the system's choice first, and end
    #[arg(long)]
    devices: bool,
    /// Play the sound on the system's loudspeakers, as late as the face, so that lips and voice fit
    #[arg(long, conflicts_with = "fast")]
    monitor: bool,
    /// Play the sound this many seconds late instead
    #[arg(long, value_name = "SECONDS", requires = "monitor")]
    delay: Option<f64>,
}

impl DeviceArgs {
    /// Whether the user only wants a list of the microphones.
    pub fn are_to_be_listed(&self) -> bool {
        self.devices
    }

    /// Opens the microphone and tells the user its name.
    ///
    /// # Errors
    /// `Audio` if it cannot be opened for recording.
    pub fn open(&self, console: &Console) -> Result<Microphone> {
        let microphone = Microphone::open(self.microphone.as_deref())?;
        console.note(&format!("listening to {}", microphone.name()));
        Ok(microphone)
    }

    /// Opens the loudspeakers if `--monitor` asks for them. The face is `lag_s` seconds late.
    ///
    /// # Errors
    /// `InvalidInput` for a delay out of range, `Audio` if nothing can be played.
    pub fn monitor(&self, lag_s: f64, console: &Console) -> Result<Option<Monitor>> {
        if !self.monitor {
            return Ok(None);
        }
        let delay_s = self.delay.unwrap_or(lag_s);
        if !(0.0..=LONGEST_DELAY_S).contains(&delay_s) {
            return Err(Error::InvalidInput(format!(
                "--delay: expected 0 to {LONGEST_DELAY_S} seconds, got {delay_s}"
            )));
        }
        let monitor = Monitor::open(delay_s)?;
        console.note(&format!(
            "playing on {}, {:.0} ms later",
            monitor.name(),
            1e3 * delay_s
        ));
        Ok(Some(monitor))
    }
}

/// Prints the names of the microphones.
///
/// # Errors
/// `Audio` if there is none or no library for them, `Io` if standard output cannot be written to.
pub fn print_devices(console: &Console) -> Result<()> {
    let names = devices()?;
    if names.is_empty() {
        return Err(Error::Audio(
            "microphone: expected a device that records, and this system lists none; plug one in, and let programs \
             use it in the system's privacy settings"
                .into(),
        ));
    }
    console.value(&names, &names.join("\n"))
}
