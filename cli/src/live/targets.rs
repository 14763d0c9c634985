//! The targets that frames are sent to.

use anyface::{
    Error, Result,
    job::{InputKind, read_file},
    output::TargetNames,
    rig::{ARKIT, VISEMES},
};
use clap::Args;
use serde_json::{Map, Value, json};

use super::{
    address::Address,
    frame::{Frame, Shown},
    live_link,
    osc::{self, AddressPattern, VmcNames},
    output::Output,
    udp::Datagrams,
    websocket::Broadcast,
};
use crate::{console::Console, paths::InputPath};

/// Where frames are sent.
#[derive(Args)]
pub struct TargetArgs {
    /// Send to avatars by the VMC protocol, as in VSeeFace, Warudo, VMC or VNyan [default: 127.0.0.1:39539]
    #[arg(long, value_name = "HOST:PORT", num_args = 0..=1, default_missing_value = "127.0.0.1:39539")]
    vmc: Option<Address>,
    /// Which expressions avatars get: those of Perfect Sync (ARKit's), those of VRM, or all
    #[arg(
        long,
        value_name = "NAMES",
        value_enum,
        default_value = "all",
        requires = "vmc"
    )]
    vmc_names: VmcNames,
    /// Send to Unreal Engine and others, in the format of the app Live Link Face [default: 127.0.0.1:11111]
    #[arg(long, value_name = "HOST:PORT", num_args = 0..=1, default_missing_value = "127.0.0.1:11111")]
    live_link: Option<Address>,
    /// Name of the face in Live Link
    #[arg(
        long,
        value_name = "NAME",
        default_value = "anyface",
        requires = "live_link"
    )]
    subject: String,
    /// Send plain OSC: /anyface/jawOpen and so on, /anyface/viseme_aa and so on, /anyface/head
    #[arg(long, value_name = "HOST:PORT")]
    osc: Option<Address>,
    /// Addresses of the weights in plain OSC, with {jawOpen}, {JawOpen} or VRCFaceTracking's {Unified} in place of the
    /// name, as in /avatar/parameters/v2/{Unified}
    #[arg(
        long,
        value_name = "PATTERN",
        default_value = "/anyface/{jawOpen}",
        requires = "osc"
    )]
    osc_address: AddressPattern,
    /// Send lines of JSON to clients that connect by WebSocket, such as a web page [default: 127.0.0.1:8765]
    #[arg(long, value_name = "HOST:PORT", num_args = 0..=1, default_missing_value = "127.0.0.1:8765")]
    websocket: Option<Address>,
    /// GLB or VRM whose own morph targets or expressions lines of JSON also name, under "targets": ARKit, Oculus, VRM,
    /// MMD, Character Creator, Daz or Ready Player Me
    #[arg(long, value_name = "FILE")]
    targets_of: Option<InputPath>,
    /// What is sent. A Live Link packet always holds the whole face
    #[arg(
        long,
        value_name = "PART",
        value_enum,
        default_value = "all",
        conflicts_with = "live_link"
    )]
    only: Shown,
}

impl TargetArgs {
    /// Checks that frames have a target. If `is_json`, they go to standard output.
    ///
    /// # Errors
    /// `InvalidInput` if there is no target, or none that can have the targets of a file.
    pub fn check(&self, is_json: bool) -> Result<()> {
        let all = [&self.vmc, &self.live_link, &self.osc, &self.websocket];
        if !is_json && all.iter().all(|address| address.is_none()) {
            return Err(Error::InvalidInput(
                "live: expected a target, got none; name one or more of --vmc, --live-link, --osc, --websocket and --json"
                    .into(),
            ));
        }
        if self.targets_of.is_some() && self.websocket.is_none() && !is_json {
            return Err(Error::InvalidInput(
                "--targets-of: expected --websocket or --json, whose lines name the targets, got neither; add one"
                    .into(),
            ));
        }
        Ok(())
    }

    /// Opens all targets for frames at `fps` per second.
    ///
    /// # Errors
    /// `InvalidInput` for an address that cannot be used, those of [`TargetNames::read`].
    pub fn open(&self, fps: f64, is_json: bool) -> Result<Targets> {
        let mut datagrams = Vec::new();
        let shown = self.only;
        if let Some(address) = &self.vmc {
            let names = self.vmc_names;
            let packet = Box::new(move |frame: &Frame| osc::vmc(frame, names, shown));
            datagrams.push(Datagrams::new("--vmc", "VMC", address, packet)?);
        }
        if let Some(address) = &self.live_link {
            let subject = self.subject.clone();
            let packet = Box::new(move |frame: &Frame| live_link::packet(frame, &subject, fps));
            datagrams.push(Datagrams::new("--live-link", "Live Link", address, packet)?);
        }
        if let Some(address) = &self.osc {
            let pattern = self.osc_address.clone();
            let packet = Box::new(move |frame: &Frame| osc::plain(frame, &pattern, shown));
            datagrams.push(Datagrams::new("--osc", "OSC", address, packet)?);
        }
        let broadcast = self.websocket.as_ref();
        let broadcast = broadcast.map(|address| Broadcast::new("--websocket", address));
        let own = self.targets_of.as_ref();
        let own = own.map(|path| TargetNames::read(&read_file(path, InputKind::Mesh)?));
        let is_alone = datagrams.is_empty() && broadcast.is_none();
        Ok(Targets {
            datagrams,
            broadcast: broadcast.transpose()?,
            own: own.transpose()?,
            shown,
            output: is_json.then(|| Output::new(is_alone)),
        })
    }
}

/// The open targets.
pub struct Targets {
    datagrams: Vec<Datagrams>,
    broadcast: Option<Broadcast>,
    /// Morph targets that lines of JSON name.
    own: Option<TargetNames>,
    shown: Shown,
    /// Lines of JSON on standard output.
    output: Option<Output>,
}

impl Targets {
    /// Tells the user which format goes to which address.
    pub fn introduce(&self, console: &Console) {
        let broadcast = self.broadcast.iter().map(Broadcast::name);
        for name in self.datagrams.iter().map(Datagrams::name).chain(broadcast) {
            console.note(&format!("sending {name}"));
        }
        if let Some(own) = &self.own {
            let values = own.values(|_| 0.0, |name| counts(name, self.shown));
            let count = values.len();
            console.note(&format!(
                "driving {count} targets, named as by {}",
                own.tool()
            ));
        }
    }

    /// Sends a frame to all targets. None of them waits for another.
    ///
    /// # Errors
    /// Those of [`Output::send`].
    pub fn send(&mut self, frame: &Frame, console: &Console) -> Result<()> {
        for target in &mut self.datagrams {
            if let Some(problem) = target.send(frame) {
                console.note(&problem);
            }
        }
        if self.broadcast.is_some() || self.output.is_some() {
            let line = line(frame, self.own.as_ref(), self.shown);
            if let Some(broadcast) = &mut self.broadcast {
                broadcast.send(&line);
            }
            if let Some(output) = &mut self.output {
                output.send(&line, console)?;
            }
        }
        Ok(())
    }

    /// Waits until the reader of standard output has all lines.
    ///
    /// # Errors
    /// Those of [`Output::finish`].
    pub fn finish(&mut self) -> Result<()> {
        self.output.as_mut().map_or(Ok(()), Output::finish)
    }

    /// Whether no target is left.
    pub fn are_gone(&self) -> bool {
        let is_output_gone = self.output.as_ref().is_none_or(Output::is_gone);
        self.datagrams.is_empty() && self.broadcast.is_none() && is_output_gone
    }
}

/// A frame as JSON on one line, with the values of a file's `own` targets.
fn line(frame: &Frame, own: Option<&TargetNames>, shown: Shown) -> String {
    let shapes = ARKIT.iter().zip(frame.shapes);
    let shapes = shapes.filter(|(name, _)| shown.has(name));
    let shapes: Map<String, Value> = shapes.map(entry).collect();
    let visemes = VISEMES.iter().zip(frame.visemes);
    let visemes: Map<String, Value> = visemes.map(entry).collect();
    let mut value = json!({
        "frame": frame.number,
        "time_s": frame.time_s,
        "shapes": shapes,
        "visemes": visemes,
    });
    if shown == Shown::All {
        value["head"] = json!(frame.head);
    }
    if let Some(own) = own {
        let weight = |name: &str| {
            if VISEMES.contains(&name) {
                frame.viseme(name)
            } else {
                frame.shape(name)
            }
        };
        let values = own.values(weight, |name| counts(name, shown));
        value["targets"] = values
            .iter()
            .map(|(name, value)| entry((name, *value)))
            .collect();
    }
    value.to_string()
}

/// Whether a shape or viseme moves the targets of a file.
fn counts(name: &str, shown: Shown) -> bool {
    shown.has(name) || VISEMES.contains(&name)
}

fn entry((name, weight): (&&str, f32)) -> (String, Value) {
    ((*name).to_owned(), json!(weight))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_has_every_weight_by_name() {
        let frame = Frame {
            head: [0.5, 0.0, -0.25],
            ..Frame::at_rest().with(&[("jawOpen", 0.5), ("viseme_aa", 0.75)])
        };
        let line = line(&frame, None, Shown::All);
        assert!(!line.contains('\n'));
        let value: Value = serde_json::from_str(&line).unwrap();
        assert_eq!(value["frame"], 3);
        assert_eq!(value["time_s"], 0.12);
        assert_eq!(value["shapes"]["jawOpen"], 0.5);
        assert_eq!(value["visemes"]["viseme_aa"], 0.75);
        assert_eq!(value["head"], json!([0.5, 0.0, -0.25]));
        assert_eq!(value["shapes"].as_object().unwrap().len(), 52);
        assert_eq!(value["visemes"].as_object().unwrap().len(), 15);
        assert!(value.get("targets").is_none());
    }
}
