//! `AnyfaceSpeaker`, a node for Godot 4 that moves the blend shapes of a mesh while a sound plays.
//! To follow a microphone instead, use `anyface live --websocket` with docs/examples/anyface.gd.

// The macro for exported properties generates accessors without comments.
#![allow(missing_docs)]

mod character;
mod voice;

use std::sync::OnceLock;

use anyface::{Engine, EngineOptions, audio::Waveform, motion::WeightFrame};
use godot::{
    classes::{AudioServer, AudioStream, Engine as Godot, MeshInstance3D, Skeleton3D},
    prelude::*,
};

use character::Character;
use voice::Voice;

struct Extension;

#[gdextension]
unsafe impl ExtensionLibrary for Extension {}

/// Makes a face speak in time with the sound of a player.
///
/// While `player` plays, the blend shapes of `mesh` follow: ARKit's (`jawOpen`, …), or Oculus'
/// visemes (`viseme_aa`, …) if the mesh has no `jawOpen`. If a mesh has no blend shapes,
/// `anyface rig --out head.glb` adds them.
#[derive(GodotClass)]
#[class(base = Node, init)]
pub struct AnyfaceSpeaker {
    /// An AudioStreamPlayer, AudioStreamPlayer2D or AudioStreamPlayer3D.
    #[export]
    player: Option<Gd<Node>>,
    /// The mesh with the blend shapes.
    #[export]
    mesh: Option<Gd<MeshInstance3D>>,
    /// The skeleton with the bone of the head. Without one, the head stays still.
    #[export]
    skeleton: Option<Gd<Skeleton3D>>,
    /// Name of the bone of the head.
    #[export]
    #[init(val = "Head".into())]
    head_bone: GString,
    /// The emotion of the face: `neutral`, `happy:0.5`, `sad:0.4,calm:0.3`, or `auto` to hear it in
    /// the voice. A change shows from the next new frame on; frames already computed for this sound
    /// keep their emotion. After a change to `auto` the first second is neutral.
    #[export]
    #[init(val = "neutral".into())]
    emotion: GString,
    /// Whether every sound moves the face, including singing, music and noise. Otherwise only
    /// speech does.
    #[export]
    any_sound: bool,
    voice: Option<Voice>,
    /// The sound of `voice`, or the last sound if it could not be decoded.
    sound: Option<Gd<AudioStream>>,
    character: Character,
    /// The last problem, so that it is reported only once.
    complaint: String,
    base: Base<Node>,
}

#[godot_api]
impl INode for AnyfaceSpeaker {
    fn process(&mut self, _delta: f64) {
        // A tool script may run this node in the editor, where nothing plays.
        if Godot::singleton().is_editor_hint() {
            return;
        }
        if let Err(reason) = self.follow_player() {
            self.complain(reason);
        }
    }
}

#[godot_api]
impl AnyfaceSpeaker {
    /// The face cannot speak, for this reason.
    #[signal]
    fn failed(reason: GString);

    /// Decodes a sound ahead of time. Without this, it is decoded when it starts to play. Returns
    /// whether decoding succeeded.
    #[func]
    fn prepare(&mut self, sound: Gd<AudioStream>) -> bool {
        match self.hear(&sound) {
            Ok(()) => true,
            Err(reason) => {
                self.complain(reason);
                false
            }
        }
    }

    /// The weights of all shapes and visemes by name, at a time of the sound in seconds. For
    /// characters that have other shapes. Empty if there is no sound yet.
    #[func]
    fn weights_at(&mut self, seconds: f64) -> VarDictionary {
        let emotion = self.emotion.to_string();
        let frame = self.voice.as_mut().map(|v| v.at(seconds, &emotion));
        match frame {
            Some(Ok(frame)) => character::by_name(&frame),
            Some(Err(reason)) => {
                self.complain(reason.to_string());
                VarDictionary::new()
            }
            None => VarDictionary::new(),
        }
    }
}

impl AnyfaceSpeaker {
    /// Shows the face at the moment of the sound that is being heard.
    fn follow_player(&mut self) -> Result<(), String> {
        let Some(mut player) = self.player.clone() else {
            return Ok(());
        };
        if !player.call("is_playing", &[]).try_to().unwrap_or(false) {
            return Ok(());
        }
        let sound = player.call("get_stream", &[]).try_to::<Gd<AudioStream>>();
        let sound = sound.map_err(|_| {
            format!(
                "player: expected a node that plays a sound, got {}",
                player.get_class()
            )
        })?;
        if self.sound.as_ref() != Some(&sound) {
            self.hear(&sound)?;
        }
        let at = player.call("get_playback_position", &[]);
        let server = AudioServer::singleton();
        // From Godot's manual: the position is that of the last mixed block, which is heard later.
        let seconds = at.try_to::<f64>().unwrap_or(0.0) + server.get_time_since_last_mix()
            - server.get_output_latency();
        let emotion = self.emotion.to_string();
        // Without a voice the sound could not be decoded, which an earlier frame has reported.
        let Some(voice) = self.voice.as_mut() else {
            return Ok(());
        };
        let frame = voice.at(seconds, &emotion);
        self.show(&frame.map_err(|e| e.to_string())?)
    }

    /// Decodes a sound and opens a `Voice` for it.
    fn hear(&mut self, sound: &Gd<AudioStream>) -> Result<(), String> {
        // Remember the sound even if decoding fails: it would fail again in the next frame.
        (self.sound, self.voice) = (Some(sound.clone()), None);
        let waveform = decoded(sound)?;
        let voice = Voice::new(engine()?, waveform.samples, self.any_sound);
        self.voice = Some(voice.map_err(|e| e.to_string())?);
        Ok(())
    }

    fn show(&mut self, frame: &WeightFrame) -> Result<(), String> {
        let (mesh, skeleton) = (self.mesh.as_mut(), self.skeleton.as_mut());
        self.character
            .show(frame, mesh, skeleton, &self.head_bone)?;
        self.complaint.clear();
        Ok(())
    }

    /// Reports a problem once, as an error and as a signal.
    fn complain(&mut self, reason: String) {
        if reason != self.complaint {
            godot_error!("Anyface: {reason}");
            self.signals().failed().emit(&GString::from(&reason));
            self.complaint = reason;
        }
    }
}

/// The models, loaded once for all nodes.
fn engine() -> Result<&'static Engine, String> {
    static ENGINE: OnceLock<Result<Engine, String>> = OnceLock::new();
    let engine = ENGINE
        .get_or_init(|| Engine::new(EngineOptions::default()).map_err(|error| error.to_string()));
    engine.as_ref().map_err(Clone::clone)
}

/// Decodes any sound that Godot can play, to mono at 16 kHz.
fn decoded(sound: &Gd<AudioStream>) -> Result<Waveform, String> {
    let rate_hz = AudioServer::singleton().get_mix_rate();
    let length_s = sound.get_length();
    // A generator or a microphone has no end.
    if !(length_s > 0.0 && length_s < 36_000.0) {
        return Err(format!(
            "sound: expected one with a length of up to ten hours, got {length_s} s"
        ));
    }
    let playback = sound.clone().instantiate_playback();
    let mut playback = playback.ok_or("sound: expected one that Godot can play, got another")?;
    playback.start();
    let count = (length_s * f64::from(rate_hz)).ceil() as i32;
    let stereo = playback.mix_audio(1.0, count);
    let interleaved: Vec<f32> = stereo.as_slice().iter().flat_map(|s| [s.x, s.y]).collect();
    Waveform::from_interleaved(&interleaved, 2, rate_hz as u32).map_err(|error| error.to_string())
}
