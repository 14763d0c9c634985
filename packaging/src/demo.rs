//! `cargo xtask demo`: turns speech into talking heads in a .blend, a picture and a film.

use std::{
    path::{Path, PathBuf},
    process::Command,
};

use anyhow::{Context, Result, ensure};
use clap::Args;

use crate::{apt, extension, machine, python::Venv, steps::Steps};

const SENTENCE: &str = "I am Anyface. I make any mesh talk.";
const FPS: u32 = 25;
const BLEND: &str = "talking_heads.blend";
const STILL: &str = "talking_heads.png";
const FILM: &str = "talking_heads.mp4";
/// An animated picture for pages, which play no sound.
const MOVING: &str = "talking_heads.webp";
/// Skips the link-time optimisation of `release`. The library computes the same results.
const PROFILE: &str = "demo";

/// Animates three heads and Suzanne with a sentence. On two idle cores the first run takes about 7
/// minutes: it builds the library while it installs Blender's Python module, and the heads speak in
/// the .blend after 5. Later runs take 2 minutes, which they spend on rendering.
#[derive(Args)]
pub struct Demo {
    /// The sentence to speak, by flite or espeak-ng.
    #[arg(long, default_value = SENTENCE, conflicts_with = "audio")]
    say: String,
    /// A recording to use instead; any common format.
    #[arg(long)]
    audio: Option<PathBuf>,
    /// Emotion and intensity of the whole sentence, such as `happy:0.7` [default: several in turn].
    #[arg(long)]
    emotion: Option<String>,
    /// Render at most this many frames (0: all).
    #[arg(long, default_value_t = 0)]
    frames: u32,
    /// Folder for the results.
    #[arg(long, default_value = "demo-output")]
    out: PathBuf,
}

impl Demo {
    /// Installs what is missing, builds, animates, renders.
    pub fn run(&self) -> Result<()> {
        let mut steps = Steps::new("demo")?;
        let build = steps.start(extension::BUILD, &mut extension::library_build(PROFILE))?;
        apt::ensure(&mut steps, &["ffmpeg", "flite", "espeak-ng"])?;
        apt::ensure(&mut steps, apt::BLENDER_LIBRARIES)?;
        apt::ensure(&mut steps, apt::SOUND)?;
        let python = Venv::Blender.ensure(&mut steps)?;
        std::fs::create_dir_all(&self.out)?;
        let out = self.out.canonicalize()?;
        let audio = self.voice(&mut steps, &out)?;
        steps.join(build)?;
        let mut build = extension::microphone_build(PROFILE);
        steps.run("build the microphone library", &mut build)?;
        let zip = extension::default_zip();
        extension::build_zip(&mut steps, &extension::library_of(PROFILE)?, &zip)?;
        let blend = out.join(BLEND);
        self.animate(&mut steps, &python, &zip, &audio, &blend)?;
        let (blend, after) = (blend.display(), steps.elapsed());
        println!("speaks   {blend}, {after} after the start; what follows makes a film of it");
        render(&mut steps, &python, &out)?;
        film(&mut steps, &audio, &out)?;
        for name in [BLEND, STILL, FILM, MOVING] {
            println!("{}", out.join(name).display());
        }
        steps.finish()
    }

    fn voice(&self, steps: &mut Steps, out: &Path) -> Result<PathBuf> {
        if let Some(path) = &self.audio {
            return path
                .canonicalize()
                .with_context(|| format!("no sound at {}", path.display()));
        }
        let path = out.join("voice.wav");
        let mut command = if machine::has("flite") {
            let mut command = Command::new("flite");
            command
                .args(["-voice", "slt", "-t", &self.say, "-o"])
                .arg(&path);
            command
        } else {
            let mut command = Command::new("espeak-ng");
            command.arg("-w").arg(&path).arg(&self.say);
            command
        };
        steps.run("speak the sentence", &mut command)?;
        ensure!(path.is_file(), "the voice wrote no {}", path.display());
        Ok(path)
    }

    fn animate(
        &self,
        steps: &mut Steps,
        python: &Path,
        zip: &Path,
        audio: &Path,
        blend: &Path,
    ) -> Result<()> {
        let mut command = Command::new(python);
        command
            .arg(machine::root().join("packaging/demo/make_demo.py"))
            .arg("--extension")
            .arg(zip)
            .arg("--audio")
            .arg(audio)
            .arg("--suzanne-landmarks")
            .arg(machine::root().join("packaging/demo/suzanne_landmarks.json"))
            .args([
                "--fps",
                &FPS.to_string(),
                "--frames",
                &self.frames.to_string(),
            ])
            .arg("--out")
            .arg(blend);
        if let Some(emotion) = &self.emotion {
            let (emotion, intensity) = emotion.split_once(':').unwrap_or((emotion, "1"));
            command.args(["--emotion", emotion, "--intensity", intensity]);
        }
        let output = steps.run("animate in Blender", &mut command)?;
        for line in output.lines().filter(|line| line.starts_with("demo: ")) {
            println!("         {}", &line[6..]);
        }
        Ok(())
    }
}

/// Renders every frame of the scene as a picture, and a still.
fn render(steps: &mut Steps, python: &Path, out: &Path) -> Result<()> {
    let mut command = Command::new(python);
    command.arg(machine::root().join("packaging/demo/render.py"));
    command.arg(out.join(BLEND)).arg(out.join("frames"));
    command.arg(out.join(STILL));
    steps.run("render", &mut command)?;
    Ok(())
}

/// Makes a film with sound and an animated picture without from the frames.
fn film(steps: &mut Steps, audio: &Path, out: &Path) -> Result<()> {
    let frames = out.join("frames/%04d.png");
    let rate = FPS.to_string();
    steps.run(
        "film",
        Command::new("ffmpeg")
            .args(["-y", "-loglevel", "error", "-framerate", &rate, "-i"])
            .arg(&frames)
            .arg("-i")
            .arg(audio)
            .args(["-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", "20"])
            .args(["-c:a", "aac", "-shortest"])
            .arg(out.join(FILM)),
    )?;
    steps.run(
        "moving picture",
        Command::new("ffmpeg")
            .args(["-y", "-loglevel", "error", "-framerate", &rate, "-i"])
            .arg(&frames)
            .args(["-vf", "fps=12.5,scale=560:-1"])
            .args(["-loop", "0", "-quality", "60"])
            .arg(out.join(MOVING)),
    )?;
    Ok(())
}
