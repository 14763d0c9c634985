//! `AnyfaceSpeaker`, a node for Godot 4 that moves the blend shapes of a mesh to a sound that is played.
//! `anyface live --websocket` and docs/examples/anyface.gd follow a microphone.

// The macro of exported properties writes accessors without comments.
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

/// Speaks with the sound of its player.
///
/// Where `player` plays, the blend shapes of `mesh` follow: ARKit's (`jawOpen`, …), or Oculus' visemes (`viseme_aa`, …)
/// where it has no `jawOpen`. `anyface rig --out head.glb` gives a mesh that has none its shapes.
#[derive(GodotClass)]
#[class(base = Node, init)]
pub struct AnyfaceSpeaker {
    /// An AudioStreamPlayer, AudioStreamPlayer2D or AudioStreamPlayer3D.
    #[export]
    player: Option<Gd<Node>>,
    /// What has the blend shapes.
    #[export]
    mesh: Option<Gd<MeshInstance3D>>,
    /// What has the bone of the head; none leaves the head still.
    #[export]
    skeleton: Option<Gd<Skeleton3D>>,
    /// Name of the bone of the head.
    #[export]
    #[init(val = "Head".into())]
    head_bone: GString,
    /// What the face feels: `neutral`, `happy:0.5`, `sad:0.4,calm:0.3`, or `auto` for what is heard in the voice. A change
    /// shows in the next frame; `auto` and a name change into one another when the sound begins anew.
    #[export]
    #[init(val = "neutral".into())]
    emotion: GString,
    /// Whether every sound moves the face, singing, music and noise too; otherwise speech alone does.
    #[export]
    any_sound: bool,
    voice: Option<Voice>,
    /// The sound of `voice`, or one that cannot be heard.
    sound: Option<Gd<AudioStream>>,
    character: Character,
    /// What went wrong last, so that it is said once.
    complaint: String,
    base: Base<Node>,
}

#[godot_api]
impl INode for AnyfaceSpeaker {
    fn process(&mut self, _delta: f64) {
        // A tool script may draw it in the editor, where nothing plays.
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
    /// The face cannot speak, and why.
    #[signal]
    fn failed(reason: GString);

    /// Decodes a sound before it is played: otherwise that is done when it begins. Returns whether it could be done.
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

    /// Weights of all shapes and visemes by name at an instant of the sound, in seconds, for characters that have other
    /// shapes; empty before a sound is there.
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
    /// Shows the face at the instant that is heard.
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
        // As Godot's manual has it: the position is that of the last mixed block, and is heard later.
        let seconds = at.try_to::<f64>().unwrap_or(0.0) + server.get_time_since_last_mix()
            - server.get_output_latency();
        let (voice, emotion) = (self.voice.as_mut(), self.emotion.to_string());
        let frame = voice.expect("just heard").at(seconds, &emotion);
        self.show(&frame.map_err(|e| e.to_string())?)
    }

    /// Decodes a sound and begins to listen to it.
    fn hear(&mut self, sound: &Gd<AudioStream>) -> Result<(), String> {
        // Kept where it fails too: the next frame would fail alike.
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

    /// Says once what is wrong, as an error and a signal.
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

/// Any sound that Godot plays, mono at 16 kHz.
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
    let mut playback = playback.ok_or("sound: expected one that can be played, got none")?;
    playback.start();
    let count = (length_s * f64::from(rate_hz)).ceil() as i32;
    let stereo = playback.mix_audio(1.0, count);
    let interleaved: Vec<f32> = stereo.as_slice().iter().flat_map(|s| [s.x, s.y]).collect();
    Waveform::from_interleaved(&interleaved, 2, rate_hz as u32).map_err(|error| error.to_string())
}
