//! Options that several subcommands share.

use std::{
    fmt::{Display, Formatter},
    path::Path,
    str::FromStr,
    sync::Arc,
};

use anyface::{
    CachePolicy, Engine, EngineOptions, Error, MotionRequest, Result,
    annotation::Annotation,
    audio::SoundFile,
    conditions::Event,
    face::{DEFAULT_PROXY, FaceOptions, check_landmarks},
    job::{InputKind, ProgressFn, Receipts, read_text},
    mesh::{
        Axis, FIVE_POINTS, FixedLandmark, LandmarkPlace, LandmarkSource, Mesh, NamedMesh,
        PartChoices, PartRole, PartSelector,
    },
    speech::Script,
    systems::{Ability, Registration},
    text::Reader,
};
use clap::Args;

use crate::controls::{EmotionArgs, FaceControls, MotionControls};
use crate::fields::FieldFlags;
use crate::paths::{CachePath, InputPath, landmarks_beside};

/// The fewest vertices of a proxy. A coarser skin has no usable lips.
const LEAST_PROXY: usize = 500;

/// Options of every subcommand.
#[derive(Args)]
pub struct SharedArgs {
    /// The system that turns speech into motion [default: the first that `anyface info` lists]
    #[arg(long, global = true, value_name = "NAME")]
    system: Option<String>,
    /// Folder of models (folders such as ats_paper, stm_paper, hubert) that replace the built-in ones
    #[arg(long, global = true, value_name = "DIR")]
    weights: Option<InputPath>,
    /// Folder of a HuBERT or wav2vec2 speech encoder (config.json, and model.safetensors or pytorch_model.bin) that
    /// replaces the built-in one
    #[arg(long, global = true, value_name = "DIR")]
    speech: Option<InputPath>,
    /// Folder that stores the work for each mesh between runs [default: the user's cache folder]
    #[arg(long, global = true, value_name = "DIR", conflicts_with = "no_cache")]
    cache: Option<CachePath>,
    /// Store no work between runs
    #[arg(long, global = true)]
    no_cache: bool,
    /// Worker threads [default: one per core]
    #[arg(long, global = true, value_name = "N")]
    threads: Option<usize>,
    /// Print results and errors as JSON
    #[arg(long, global = true)]
    pub json: bool,
}

impl SharedArgs {
    pub fn engine(&self) -> Result<Engine> {
        Engine::new(self.options())
    }

    /// The name given by --system.
    pub fn system(&self) -> Option<&str> {
        self.system.as_deref()
    }

    /// The number given by --threads.
    pub fn threads(&self) -> Option<usize> {
        self.threads
    }

    /// A text that is equal for options that make the same engine.
    pub fn key(&self) -> String {
        format!("{:?}", self.options())
    }

    /// The folder given by --weights.
    pub fn weights(&self) -> Option<&Path> {
        self.weights.as_deref()
    }

    /// The receipts of results whose names nobody typed.
    pub fn receipts(&self) -> Receipts {
        self.options().cache.receipts()
    }

    /// Checks the options before any work starts.
    pub fn check(&self) -> Result<()> {
        self.options().check()
    }

    fn options(&self) -> EngineOptions {
        EngineOptions {
            system: self.system.clone(),
            models: self.weights.as_deref().map(Path::to_path_buf),
            cache: match (&self.cache, self.no_cache) {
                (Some(folder), _) => CachePolicy::Folder(folder.to_path_buf()),
                (None, true) => CachePolicy::Off,
                (None, false) => CachePolicy::UserFolder,
            },
            threads: self.threads,
            speech: self.speech.as_deref().map(Path::to_path_buf),
        }
    }
}

/// Options for reading a sound.
#[derive(Args)]
pub struct SoundArgs {
    /// Use a damaged sound file even if more than a fifth of it is missing
    #[arg(long)]
    any_damage: bool,
    /// Number of the audio track, from 1, of a video or sound file that has several [default: the one that the file
    /// names]
    #[arg(long, value_name = "N")]
    track: Option<usize>,
}

impl SoundArgs {
    pub fn read(&self, path: &Path, progress: ProgressFn<'_>) -> Result<SoundFile> {
        let read = SoundFile::read_track(path, self.track, self.any_damage, progress);
        read.map_err(|error| match error {
            Error::DamagedSound(message) => {
                Error::DamagedSound(format!("{message}; --any-damage uses the rest"))
            }
            other => other,
        })
    }

    /// Says which audio track of a file was taken, if the user chose none of several.
    pub fn track_note(&self, file: &SoundFile) -> Option<String> {
        let sentence = file.track.sentence().filter(|_| self.track.is_none());
        sentence.map(|sentence| format!("{sentence}; --track N takes another"))
    }
}

/// Options for finding and moving the face.
#[derive(Args)]
pub struct FaceArgs {
    /// Landmarks as JSON: 68 positions or 68 vertex numbers [default: M.landmarks.json beside the mesh M.obj; if there
    /// is none, they are detected]
    #[arg(long, value_name = "L.json")]
    landmarks: Option<InputPath>,
    /// The object with the face, where a file has several heads. Its landmarks are searched for on this object alone
    #[arg(long, value_name = "NAME", conflicts_with = "landmarks")]
    head: Option<String>,
    /// Fixed landmarks as JSON. They stay where they are, and the detected ones are fitted to them
    #[arg(long, value_name = "F.json")]
    fix: Option<InputPath>,
    /// Five points that say where the face is, each as x,y,z in units of the mesh, with spaces between them: outer corner
    /// of the right eye, outer corner of the left eye, tip of the nose, right corner and left corner of the mouth. Right is
    /// the right side of the person, which a viewer sees on the left
    #[arg(long, value_name = "POINTS", allow_hyphen_values = true)]
    points: Option<FivePoints>,
    /// Axis that points out of the face: x, -x, y, -y, z or -z. It decides when several places look
    /// like a face
    #[arg(long, default_value = "z", value_parser = axis, allow_hyphen_values = true)]
    forward: Axis,
    /// Axis that points to the top of the head
    #[arg(long, default_value = "y", value_parser = axis, allow_hyphen_values = true)]
    up: Axis,
    #[command(flatten)]
    controls: FaceControls,
    /// Role of a part of the mesh: skin, jaw, skull, mouth, nearest, gaze or still. The part is a number or the name of its
    /// object (see `anyface parts`). May be repeated
    #[arg(long = "part", value_name = "PART=ROLE", value_parser = part)]
    parts: Vec<(PartSelector, PartRole)>,
    /// A skin of more than N vertices follows a coarser copy of N vertices. "off" works on every vertex
    #[arg(long, value_name = "N", default_value_t = ProxySize(Some(DEFAULT_PROXY)))]
    proxy: ProxySize,
}

/// Places of [`FIVE_POINTS`], mesh units.
#[derive(Debug, Clone, Copy, PartialEq)]
struct FivePoints([[f32; 3]; 5]);

impl FromStr for FivePoints {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let place = |word: &str| -> std::result::Result<[f32; 3], String> {
            let numbers: Vec<f32> = word.split(',').map_while(|x| x.parse().ok()).collect();
            let place = <[f32; 3]>::try_from(numbers);
            let place = place.ok().filter(|p| p.iter().all(|x| x.is_finite()));
            let is_whole = word.split(',').count() == 3;
            place
                .filter(|_| is_whole)
                .ok_or_else(|| format!("expected x,y,z, got {word:?}"))
        };
        let places = text.split_whitespace().map(place);
        let places: Vec<[f32; 3]> = places.collect::<std::result::Result<_, _>>()?;
        <[[f32; 3]; 5]>::try_from(places)
            .map(FivePoints)
            .map_err(|places| {
                format!(
                    "expected five points: outer corner of the right and of the left eye, tip of the nose, right and left \
                     corner of the mouth; got {}",
                    places.len()
                )
            })
    }
}

/// `off` or a number of vertices.
#[derive(Debug, Clone, Copy, PartialEq)]
struct ProxySize(Option<usize>);

impl FromStr for ProxySize {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        match (text, text.parse()) {
            ("off", _) => Ok(ProxySize(None)),
            (_, Ok(vertices @ LEAST_PROXY..)) => Ok(ProxySize(Some(vertices))),
            _ => Err(format!(
                "expected off or at least {LEAST_PROXY}, got {text:?}"
            )),
        }
    }
}

impl Display for ProxySize {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        match self.0 {
            Some(vertices) => vertices.fmt(f),
            None => f.write_str("off"),
        }
    }
}

impl FaceArgs {
    /// `mesh`: read from `file`. `known`: landmarks that the caller has from elsewhere, used
    /// unless --landmarks gives others. A landmarks file beside the mesh that does not fit it is
    /// passed over, and a warning says so.
    pub fn options(
        &self,
        (file, mesh): (&Path, &NamedMesh),
        known: Option<LandmarkSource>,
        warnings: &mut Vec<String>,
    ) -> Result<FaceOptions> {
        let landmarks = match &self.landmarks {
            Some(path) => Some(LandmarkSource::read(path)?),
            None if self.head.is_some() => None,
            None if known.is_none() => fitting_landmarks_beside(file, &mesh.mesh, warnings),
            None => known,
        };
        let mut fixed = match &self.fix {
            Some(path) => FixedLandmark::read(path)?,
            None => Vec::new(),
        };
        if let Some(FivePoints(places)) = self.points {
            let points = FIVE_POINTS.into_iter().zip(places);
            fixed.extend(points.map(|(index, place)| FixedLandmark {
                index,
                place: LandmarkPlace::Position(place),
            }));
        }
        Ok(FaceOptions {
            landmarks,
            head: self.head.clone(),
            fixed,
            forward: self.forward,
            up: self.up,
            controls: self.controls.controls()?,
            parts: PartChoices {
                names: mesh.names.clone(),
                roles: self.parts.clone(),
            },
            proxy: self.proxy.0,
        })
    }
}

/// The landmarks file beside a mesh, such as `open-mouth` and `head` write. It may belong to another mesh of the
/// same name: H.landmarks.json of H.obj lies beside H.vrm, too. It says so if Anyface wrote it; any other one must fit.
fn fitting_landmarks_beside(
    file: &Path,
    mesh: &Mesh,
    warnings: &mut Vec<String>,
) -> Option<LandmarkSource> {
    let beside = landmarks_beside(file);
    if !beside.is_file() {
        return None;
    }
    let landmarks = LandmarkSource::read_beside(&beside, mesh).and_then(|landmarks| {
        check_landmarks(mesh, &landmarks)?;
        Ok(landmarks)
    });
    match landmarks {
        Ok(landmarks) => Some(landmarks),
        Err(error) => {
            warnings.push(format!(
                "{} does not fit this mesh and was passed over ({error}); the face was searched for, and --landmarks names a \
                 file of landmarks",
                beside.display()
            ));
            None
        }
    }
}

/// Reads `3=jaw` and `teeth_low=jaw`.
fn part(text: &str) -> std::result::Result<(PartSelector, PartRole), String> {
    let wrong = || format!("expected PART=ROLE, as in 3=jaw, got {text:?}");
    let (part, role) = text.rsplit_once('=').ok_or_else(wrong)?;
    let selector = match part.parse() {
        Ok(number) => PartSelector::Number(number),
        Err(_) => PartSelector::Name(part.to_owned()),
    };
    let role = role.parse().map_err(|error: Error| error.to_string())?;
    Ok((selector, role))
}

/// Options of the performance.
#[derive(Args)]
pub struct MotionArgs {
    #[command(flatten)]
    emotion: EmotionArgs,
    #[command(flatten)]
    controls: MotionControls,
    #[command(flatten)]
    fields: FieldFlags,
    /// File that says what is spoken and when, which is otherwise heard in the speech: phones, words or
    /// mouth shapes of a .TextGrid, .tsv, .json (also of text-to-speech: ElevenLabs, Azure, Polly), .srt,
    /// .vtt, .pgo, .dat (which counts frames of --fps) or .txt. Phones and shapes also say when the lips
    /// close. `anyface sounds` writes such files
    #[arg(long, value_name = "S")]
    sounds: Option<InputPath>,
    /// Read the spoken words from this UTF-8 file instead
    #[arg(long, value_name = "F", conflicts_with = "text")]
    text_file: Option<InputPath>,
    /// What the face does and when (cafe-talk), as in 1.2-2.0:12,6:0.8 or 2.4-2.8:left wink: seconds, then action units
    /// (with L or R for one side) or words, then the strength. A ! at the end puts it over the speech. May be repeated.
    /// `anyface units` lists the words with fixed units
    #[arg(long = "event", value_name = "E")]
    event: Vec<String>,
    /// JSON file of such events: a list of {"start_s", "end_s", "units": ["12", "45L"] or "left wink", "strength",
    /// "over_speech"}
    #[arg(long, value_name = "E.json")]
    events: Option<InputPath>,
}

impl MotionArgs {
    fn events(&self, models: Option<&Path>) -> Result<Vec<Event>> {
        let reader = Reader::new(models);
        let file = self
            .events
            .as_deref()
            .map(|path| reader.events_of_file(path));
        let mut events = file.transpose()?.unwrap_or_default();
        for text in &self.event {
            events.push(reader.event(text)?);
        }
        Ok(events)
    }

    /// Reads the file of --sounds; `fps` is the frame rate that the request has.
    pub fn read_sounds(&self, fps: f64) -> Result<Option<Annotation>> {
        let read = |path: &InputPath| Annotation::read(path, fps);
        self.sounds.as_ref().map(read).transpose()
    }

    pub fn request(&self, shared: &SharedArgs) -> Result<MotionRequest> {
        let mut request = self.fields.request()?;
        if let Some(text) = read_words(self.text_file.as_ref())? {
            request.script = Some(Arc::new(Script::Text(text)));
        }
        if let Some(sounds) = self.read_sounds(request.fps)? {
            // Words alone do not say when lips close: their phones are found in the sound.
            if sounds.shows_mouths() {
                request.closures = Some(sounds.closures()?);
            }
            let of_sounds = || Script::of_annotation(&sounds).map(Arc::new);
            request.script = request.script.or_else(of_sounds);
        }
        let takes_words = Registration::find(shared.system.as_deref())?.can(Ability::Words);
        request.emotion = self.emotion.curve(takes_words, shared.weights())?;
        request.controls = self.controls.controls()?;
        request.events = self.events(shared.weights())?;
        Ok(request)
    }
}

/// The words of the file of `--text-file`.
pub fn read_words(file: Option<&InputPath>) -> Result<Option<String>> {
    let read = |path: &InputPath| read_text(path, InputKind::Text);
    let text = file.map(read).transpose()?;
    Ok(text.map(|text| text.trim_start_matches('\u{FEFF}').to_owned()))
}

/// Reads `x`, `+x` or `-x`, and the same for the other axes.
fn axis(text: &str) -> std::result::Result<Axis, String> {
    match text.trim_start_matches('+').to_ascii_lowercase().as_str() {
        "x" => Ok(Axis::PosX),
        "-x" => Ok(Axis::NegX),
        "y" => Ok(Axis::PosY),
        "-y" => Ok(Axis::NegY),
        "z" => Ok(Axis::PosZ),
        "-z" => Ok(Axis::NegZ),
        _ => Err(format!("expected x, -x, y, -y, z or -z, got {text:?}")),
    }
}

/// A path as text for reports.
pub fn shown(path: &Path) -> String {
    path.display().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn five_points_are_read_and_four_are_not() {
        let five = "-3,1.5,0 3,1.5,0 0,0,2e0 -1,-2,1 1,-2,1";
        let places = [
            [-3.0, 1.5, 0.0],
            [3.0, 1.5, 0.0],
            [0.0, 0.0, 2.0],
            [-1.0, -2.0, 1.0],
            [1.0, -2.0, 1.0],
        ];
        assert_eq!(five.parse(), Ok(FivePoints(places)));
        for (text, words) in [
            ("-3,1.5,0 3,1.5,0 0,0,2 -1,-2,1", "got 4"),
            ("", "got 0"),
            ("1,2 3,4,5", "expected x,y,z, got \"1,2\""),
            ("1,2,3,4", "expected x,y,z"),
            ("1,nan,3", "expected x,y,z"),
            ("1,2,x", "expected x,y,z"),
        ] {
            let error = text.parse::<FivePoints>().unwrap_err();
            assert!(error.contains(words), "{text}: {error}");
        }
    }
}
