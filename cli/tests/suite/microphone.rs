//! `anyface live` on a microphone. The tests run a sound system whose device records what is played on it, and a
//! command that is installed with the microphone's library beside it.

use std::{
    fs,
    io::{BufRead, BufReader, Read},
    path::{Path, PathBuf},
    process::{Child, ChildStdout, Command, Stdio},
    sync::{
        LazyLock,
        mpsc::{Receiver, channel},
    },
    thread,
    time::{Duration, Instant},
};

use serde_json::Value;

use crate::{folder_with_sound, voice};

/// How long anything may take on a busy machine.
const PATIENCE: Duration = Duration::from_secs(60);
/// At rest, the weight of `jawOpen` stays below this.
const REST: f64 = 0.05;

const LIBRARY: &str = "libanyface_microphone.so";

/// Folder of a command with the library, as packages have it: in `bin` and `lib`.
static PACKAGE: LazyLock<tempfile::TempDir> = LazyLock::new(|| {
    let package = installed("bin");
    fs::create_dir(package.path().join("lib")).unwrap();
    fs::hard_link(built_library(), package.path().join("lib").join(LIBRARY)).unwrap();
    package
});

/// A new folder on the disk of the builds, with a link to the command in its folder `name`.
fn installed(name: &str) -> tempfile::TempDir {
    let command = Path::new(env!("CARGO_BIN_EXE_anyface"));
    let folder = tempfile::tempdir_in(command.parent().unwrap()).unwrap();
    fs::create_dir(folder.path().join(name)).unwrap();
    fs::hard_link(command, folder.path().join(name).join("anyface")).unwrap();
    folder
}

/// The library of the crate `anyface-microphone`, which cargo has built beside the tests.
fn built_library() -> PathBuf {
    std::env::current_exe().unwrap().with_file_name(LIBRARY)
}

/// A PulseAudio whose one device has no hardware; it records what is played on it.
struct SoundSystem {
    folder: tempfile::TempDir,
    server: Child,
}

impl SoundSystem {
    fn start() -> SoundSystem {
        let folder = tempfile::tempdir().unwrap();
        let server = serve(folder.path());
        let system = SoundSystem { folder, server };
        system.wait();
        system
    }

    fn wait(&self) {
        let end = Instant::now() + PATIENCE;
        while Instant::now() < end {
            let info = self.command("pactl").arg("info").output().unwrap();
            if info.status.success() {
                return;
            }
            thread::sleep(Duration::from_millis(50));
        }
        panic!("PulseAudio does not start");
    }

    /// A program that uses this sound system.
    fn command(&self, program: &str) -> Command {
        let mut command = Command::new(program);
        in_sound_folder(&mut command, self.folder.path());
        command
    }

    fn live(&self, arguments: &[&str]) -> Command {
        let installed = PACKAGE.path().join("bin/anyface");
        let mut command = self.command(installed.to_str().unwrap());
        command.arg("live").args(arguments);
        command
    }

    fn play(&self, wav: &Path) {
        let mut player = self.command("paplay");
        assert!(player.arg(wav).status().unwrap().success());
    }

    fn stop(&mut self) {
        self.server.kill().unwrap();
        self.server.wait().unwrap();
    }

    fn start_again(&mut self) {
        self.server = serve(self.folder.path());
        self.wait();
    }
}

impl Drop for SoundSystem {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

fn in_sound_folder(command: &mut Command, folder: &Path) {
    command.env("XDG_RUNTIME_DIR", folder).env("HOME", folder);
    for name in [
        "PULSE_SERVER",
        "PULSE_RUNTIME_PATH",
        "DISPLAY",
        "DBUS_SESSION_BUS_ADDRESS",
    ] {
        command.env_remove(name);
    }
}

fn serve(folder: &Path) -> Child {
    let mut command = Command::new("pulseaudio");
    in_sound_folder(&mut command, folder);
    command
        .args([
            "-n",
            "--daemonize=no",
            "--exit-idle-time=-1",
            "--disable-shm",
            "--use-pid-file=no",
        ])
        .args(["-L", "module-native-protocol-unix"])
        .args([
            "-L",
            "module-null-sink rate=48000 sink_properties=device.description=Desk",
        ])
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}

/// A running `anyface live`, with its frames and notes as they arrive.
struct Face {
    child: Child,
    frames: Receiver<Value>,
    notes: Receiver<String>,
}

impl Face {
    fn start(mut command: Command) -> Face {
        let pipes = command.stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = pipes.spawn().unwrap();
        let frames = lines(child.stdout.take().unwrap(), |line| {
            serde_json::from_str(&line).unwrap()
        });
        let notes = lines(child.stderr.take().unwrap(), |line| line);
        Face {
            child,
            frames,
            notes,
        }
    }

    /// Waits for a note that holds `text`.
    fn notes(&self, text: &str) {
        let end = Instant::now() + PATIENCE;
        while let Ok(note) = self
            .notes
            .recv_timeout(end.saturating_duration_since(Instant::now()))
        {
            if note.contains(text) {
                return;
            }
        }
        panic!("no note {text:?}");
    }

    /// The widest mouth opening in the frames that have arrived or arrive within `time`.
    fn opening(&self, time: Duration) -> f64 {
        let (end, mut widest, mut count) = (Instant::now() + time, 0.0f64, 0);
        while let Ok(frame) = self
            .frames
            .recv_timeout(end.saturating_duration_since(Instant::now()))
        {
            widest = widest.max(frame["shapes"]["jawOpen"].as_f64().unwrap());
            count += 1;
        }
        assert!(count > 10, "{count} frames");
        widest
    }
}

impl Drop for Face {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn lines<T: Send + 'static>(
    from: impl Read + Send + 'static,
    read: impl Fn(String) -> T + Send + 'static,
) -> Receiver<T> {
    let (sender, receiver) = channel();
    thread::spawn(move || {
        for line in BufReader::new(from).lines().map_while(Result::ok) {
            if sender.send(read(line)).is_err() {
                return;
            }
        }
    });
    receiver
}

/// A voice of two seconds at the sample rate of usual sound cards, loud enough to be heard.
fn spoken() -> (tempfile::TempDir, PathBuf) {
    let folder = folder_with_sound(&voice::intoned(2.0, 48_000), 48_000);
    let wav = folder.path().join("a.wav");
    (folder, wav)
}

#[test]
#[cfg_attr(not(has_pulseaudio), ignore = "needs pulseaudio")]
fn a_face_follows_a_microphone_that_goes_and_comes_back() {
    let mut system = SoundSystem::start();
    let (_folder, wav) = spoken();
    let face = Face::start(system.live(&["--microphone", "desk", "--json"]));
    face.notes("listening to Monitor of Desk");
    assert!(face.opening(Duration::from_secs(2)) < REST);
    system.play(&wav);
    assert!(face.opening(Duration::from_secs(1)) > 2.0 * REST);
    system.stop();
    face.notes("Monitor of Desk is gone");
    // The mouth shuts after the last words, and frames keep arriving.
    face.opening(Duration::from_secs(1));
    assert!(face.opening(Duration::from_secs(1)) < REST);
    system.start_again();
    face.notes("Monitor of Desk is back");
    system.play(&wav);
    assert!(face.opening(Duration::from_secs(1)) > 2.0 * REST);
}

#[test]
#[cfg_attr(not(has_pulseaudio), ignore = "needs pulseaudio")]
fn devices_are_listed_and_what_is_none_is_refused() {
    let system = SoundSystem::start();
    let listed = system.live(&["--devices"]).output().unwrap();
    assert_eq!(String::from_utf8_lossy(&listed.stdout), "Monitor of Desk\n");
    let refused = system
        .live(&["--microphone", "kitchen", "--json"])
        .output()
        .unwrap();
    assert_eq!(refused.status.code(), Some(4));
    let message = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(
        message.contains("expected one of Monitor of Desk, got"),
        "{message}"
    );
}

#[test]
#[cfg_attr(not(has_pulseaudio), ignore = "needs pulseaudio")]
fn what_the_face_follows_is_played_later() {
    let system = SoundSystem::start();
    let (folder, _) = spoken();
    // Record raw samples of the sound that is played.
    let mut recorder = system.command("parec");
    recorder.args([
        "--format=s16le",
        "--rate=16000",
        "--channels=1",
        "--latency-msec=20",
    ]);
    let mut recorder = recorder.stdout(Stdio::piped()).spawn().unwrap();
    let heard = loudest(recorder.stdout.take().unwrap());
    let mut live = system.live(&["--input", "a.wav", "--monitor", "--json"]);
    let played = live.current_dir(folder.path()).output().unwrap();
    let notes = String::from_utf8_lossy(&played.stderr).into_owned();
    assert!(played.status.success(), "{notes}");
    assert!(notes.contains("playing on Desk, 192 ms later"), "{notes}");
    thread::sleep(Duration::from_millis(500));
    recorder.kill().unwrap();
    recorder.wait().unwrap();
    assert!(heard.join().unwrap() > 1_000);
}

/// Reads 16-bit samples to the end and returns the loudest.
fn loudest(mut from: ChildStdout) -> thread::JoinHandle<u16> {
    thread::spawn(move || {
        let mut bytes = Vec::new();
        from.read_to_end(&mut bytes).unwrap();
        let samples = bytes
            .chunks_exact(2)
            .map(|b| i16::from_le_bytes([b[0], b[1]]));
        samples.map(i16::unsigned_abs).max().unwrap_or(0)
    })
}

#[test]
fn a_machine_without_sound_says_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = Command::new(PACKAGE.path().join("bin/anyface"));
    in_sound_folder(&mut command, folder.path());
    // ALSA then knows no device either.
    fs::write(folder.path().join("asound.conf"), "").unwrap();
    command.env("ALSA_CONFIG_PATH", folder.path().join("asound.conf"));
    let message = refusal(command.args(["live", "--devices"]));
    assert!(
        message.contains("this system lists none; plug one in"),
        "{message}"
    );
    assert!(!message.contains("ALSA lib"), "{message}");
}

#[test]
fn without_the_library_it_says_where_it_looked_and_how_to_build_it() {
    let folder = installed("bin");
    let command = folder.path().join("bin/anyface");
    for arguments in [&["live", "--devices"][..], &["live", "--json"]] {
        let message = refusal(Command::new(&command).args(arguments));
        for part in [
            format!(
                "expected {LIBRARY} in {}",
                command.parent().unwrap().display()
            ),
            "cargo build --release -p anyface-microphone".to_owned(),
            "name a sound with --input".to_owned(),
        ] {
            assert!(message.contains(&part), "{part}: {message}");
        }
    }
}

#[test]
fn a_library_that_is_none_is_refused_by_name() {
    let folder = installed("bin");
    let library = folder.path().join("bin").join(LIBRARY);
    fs::write(&library, "no library").unwrap();
    let message =
        refusal(Command::new(folder.path().join("bin/anyface")).args(["live", "--devices"]));
    let expected = format!("{} cannot be loaded", library.display());
    assert!(message.contains(&expected), "{message}");
}

/// Standard error of a command that ends because of its sound.
fn refusal(command: &mut Command) -> String {
    let output = command.output().unwrap();
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(4), "{message}");
    message
}
