"""FLAME corpora whose clip names give the emotion: MEAD-3D, RAVDESS (parameters) and EmoVOCA (vertices)."""

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from training.corpus.checked import CorpusError, read_npz
from training.corpus.kalman import filter_track
from training.corpus.readers.sequences import HALVED, vocaset_split
from training.corpus.readers.tables import (
    found_files,
    need_table,
    numbers,
    rate_of,
    read_mesh,
    read_pickle,
    read_sequence,
    sound_of,
)
from training.corpus.writer import CorpusWriter

EMOTIONS = {
    "angry": "angry", "anger": "angry", "contempt": "contempt", "disgusted": "disgusted",
    "disgust": "disgusted", "fear": "afraid", "afraid": "afraid", "happy": "happy",
    "happiness": "happy", "neutral": "neutral", "sad": "sad", "sadness": "sad",
    "surprised": "surprised", "surprise": "surprised", "moderate": "neutral", "pleased": "pleased",
    "upset": "upset", "ill": "ill", "drunk": "drunk", "suspicious": "suspicious", "irritated": "angry",
    "smile": "happy", "moody": "upset", "ashamed": "ashamed",
}  # fmt: skip
BESIDE_SEQUENCES = {"label", "intensity", "landmarks_sequences"}
"""Folders of EmoVOCA whose files have the names of sequences."""
LEVELS = 3
"""MEAD records every emotion at three levels. The strongest counts as intensity 1."""
MEAD_FPS, EMOVOCA_FPS, RAVDESS_FPS = 25.0, 60.0, 30.0
RAVDESS_EMOTIONS = ("neutral", "calm", "happy", "sad", "angry", "afraid", "disgusted", "surprised")
RAVDESS_STATEMENTS = ("Kids are talking by the door", "Dogs are sitting by the door")
RAVDESS_INTENSITIES = (0.5, 1.0)
EXPRESSION = 300
"""Index of the first direction in FLAME's shape directions that belongs to the expression."""
JAW = 2


def label_of(name: str) -> tuple[str, float]:
    """Emotion and intensity from the words in a name: `M003_happy_level_2_001`, `…_sentence01_Sad1_3`."""
    words = [re.sub(r"(?<=[a-z])\d+$", "", word) for word in re.split(r"[\W_]+", name.lower())]
    label = next((word for word in words if word in EMOTIONS), None)
    if label is None:
        return "unknown", 0.0
    emotion = EMOTIONS[label]
    after = words[words.index(label) + 1 :]
    if after[:1] == ["level"]:
        after = after[1:]
    level = int(after[0]) if after and after[0].isdigit() and 1 <= int(after[0]) <= LEVELS else LEVELS
    return (emotion, 0.0) if emotion == "neutral" else (emotion, round(level / LEVELS, 3))


def emovoca(source: Path, folder: Path, landmarks: Path | None) -> Path:
    """Reads EmoVOCA (Nocentini et al. 2024).

    Its files are SPEAKER_sentenceNN_EMOTION_LEVEL.npy [T, 5023, 3], in `sequences` or anywhere but in
    `label`, `intensity` and `landmarks_sequences`, with VOCASET's templates.pkl and FLAME_sample.ply. Each
    sequence has a sound in `wav` or `audio`, of the same stem or of the stem SPEAKER_sentenceNN. The rate is
    60 fps as in VOCASET, or 30 if there are only half as many frames for a second of sound.
    """
    table = need_table(landmarks, "flame")
    neutral, triangles = read_mesh(found_files(source, "FLAME_sample.ply")[0])
    pairs = []
    for path in found_files(source, "*sentence*.npy"):
        if BESIDE_SEQUENCES & set(path.relative_to(source).parts[:-1]):
            continue
        spoken = re.match(r"(.+)_(sentence\d+)", path.stem)
        if spoken is None:
            raise CorpusError(path, None, "a name like SPEAKER_sentence01_Sad1_2", path.stem)
        sounds = source / "wav" if (source / "wav").is_dir() else source / "audio"
        has_sound = any(sounds.glob(f"{path.stem}.*"))
        pairs.append((path, sound_of(sounds, path.stem if has_sound else spoken[0])))
    if not pairs:
        raise CorpusError(source, None, "sequences/SPEAKER_sentence01_Sad1_2.npy", "none")
    fps = {"vertices": rate_of(pairs, (EMOVOCA_FPS, EMOVOCA_FPS / HALVED))}
    writer = CorpusWriter(folder, "emovoca", "m", topology="flame", fps=fps)
    writer.mesh("neutral", neutral, triangles)
    writer.landmark_table(table)
    for speaker, mesh in read_pickle(found_files(source, "templates.pkl")[0]).items():
        writer.mesh(speaker, numbers(mesh).reshape(-1, 3), triangles)
    for path, sound in pairs:
        speaker, said = re.match(r"(.+?)_sentence\d+(.*)", path.stem).groups()
        writer.clip(path.stem, speaker, vocaset_split(speaker), *label_of(said))
        writer.sound_file(path.stem, sound)
        writer.vertices(path.stem, read_sequence(path, len(neutral)))
    return writer.close()


def mead(source: Path, folder: Path, landmarks: Path | None) -> Path:
    """Reads MEAD-3D, a corpus of FLAME parameters.

    Each NAME.npz has `exp` [T, E], `jaw` [T, 3] (or `pose` [T, 6], jaw last) and `shape`, with a sound NAME
    beside it. The user adds the licensed model, flame.pkl or generic_model.pkl. The head stays still. The
    first word of a name is the speaker (M003). Every tenth speaker is for testing.
    """
    speakers: list[str] = []

    def about(name: str) -> Clip:
        speaker = re.split(r"[\W_]", name)[0]
        if speaker not in speakers:
            speakers.append(speaker)
        split = "test" if speakers.index(speaker) % 10 == 9 else "train"
        return Clip(speaker, split, *label_of(name))

    return _of_parameters(source, folder, landmarks, "mead", MEAD_FPS, about)


def ravdess(source: Path, folder: Path, landmarks: Path | None) -> Path:
    """Reads RAVDESS (Livingstone & Russo 2018) as FLAME parameters that EMOCA tracked at 30 fps.

    The files are those of MEAD-3D but with RAVDESS's own names, 03-01-06-01-02-01-12.npz. Actors 1 to 20 are
    for training, 21 and 22 for validation, 23 and 24 for testing, as in EmoFace (§4.1). As there, a Kalman
    filter smooths the parameters of expression and jaw. The paper also fixes "the last three of the pose
    parameters". In EMOCA's order these turn the jaw, and the mouth would stay shut; here the head stays
    still, as the paper's front view asks for, and the jaw moves. The two statements are the text, so that one
    actor's emotions can be crossed.
    """

    def about(name: str) -> Clip:
        fields = re.search(r"(?:\d\d-){6}\d\d$", name)
        if fields is None:
            raise CorpusError(source, None, "names such as 03-01-06-01-02-01-12", name)
        _, _, emotion, intensity, statement, _, actor = map(int, fields[0].split("-"))
        lists = (RAVDESS_EMOTIONS, RAVDESS_INTENSITIES, RAVDESS_STATEMENTS)
        numbers_ = (emotion, intensity, statement)
        if not all(1 <= n <= len(known) for n, known in zip(numbers_, lists, strict=True)):
            raise CorpusError(source, None, "emotion 01 to 08, intensity and statement 01 or 02", name)
        label, strength, text = (known[n - 1] for n, known in zip(numbers_, lists, strict=True))
        split = "train" if actor <= 20 else "val" if actor <= 22 else "test"
        return Clip(f"actor{actor:02d}", split, label, 0.0 if label == "neutral" else strength, text)

    return _of_parameters(source, folder, landmarks, "ravdess", RAVDESS_FPS, about, filter_track)


@dataclass
class Clip:
    """Facts about a clip that its name gives."""

    speaker: str
    split: str
    emotion: str
    intensity: float
    text: str = ""


def _of_parameters(
    source: Path, folder: Path, landmarks: Path | None, style: str, fps: float, about: Callable[[str], Clip],
    smooth: Callable[[np.ndarray], np.ndarray] = lambda track: track,
) -> Path:  # fmt: skip
    """Reads a folder of FLAME parameters, the sound beside each, and FLAME's own pickle.

    `smooth` gets the expression [T, E] and the jaw [T, 3] of each clip and returns the same, smoother.
    """
    table = need_table(landmarks, "flame")
    models = [*source.glob("flame.pkl"), *source.glob("generic_model.pkl")]
    if not models:
        raise CorpusError(source, None, "flame.pkl or generic_model.pkl, the FLAME model", "none")
    model = read_flame(models[0])
    writer = CorpusWriter(folder, style, "m", topology="flame", fps={"vertices": fps})
    writer.mesh("neutral", model.neutral, model.triangles)
    writer.landmark_table(table)
    speakers: set[str] = set()
    for path in found_files(source, "*.npz"):
        name = "_".join(path.relative_to(source).with_suffix("").parts)
        clip = about(name)
        shape, *tracks = _parameters(path, read_npz(path))
        expression, jaw = map(smooth, tracks)
        if clip.speaker not in speakers:
            speakers.add(clip.speaker)
            rest = model.vertices(shape, 0.0 * expression[:1], 0.0 * jaw[:1])[0]
            writer.mesh(clip.speaker, rest, model.triangles)
        writer.clip(name, clip.speaker, clip.split, clip.emotion, clip.intensity, clip.text)
        writer.sound_file(name, sound_of(path.parent, path.stem))
        writer.vertices(name, model.vertices(shape, expression, jaw))
    return writer.close()


def _parameters(path: Path, arrays: dict[str, np.ndarray]):
    """Shape [S] of the clip's speaker, expression [T, E], jaw [T, 3]."""
    if "exp" not in arrays or not {"jaw", "pose"} & set(arrays):
        raise CorpusError(path, None, "arrays exp, jaw or pose, shape", sorted(arrays))
    expression = arrays["exp"].reshape(len(arrays["exp"]), -1)
    jaw = arrays["jaw"] if "jaw" in arrays else arrays["pose"][..., 3:6]
    if len(jaw) != len(expression):
        raise CorpusError(path, None, f"{len(expression)} frames of the jaw", len(jaw))
    shape = np.atleast_2d(arrays.get("shape", np.zeros((1, 1))))
    return shape.reshape(-1, shape.shape[-1]).mean(axis=0), expression, jaw.reshape(len(jaw), 3)


@dataclass
class Flame:
    """FLAME (Li et al. 2017), in which only jaw and expression move.

    neutral: [V, 3] m. directions: [V, 3, 400], shape then expression. pose: [V, 3, 36], correctives for the
    rotations of four joints. regressor: [5, V]. skinning: [V, 5].
    """

    neutral: np.ndarray
    triangles: np.ndarray
    directions: np.ndarray
    pose: np.ndarray
    regressor: np.ndarray
    skinning: np.ndarray

    def vertices(self, shape: np.ndarray, expression: np.ndarray, jaw: np.ndarray) -> np.ndarray:
        """shape [S], expression [T, E], jaw [T, 3] rotation vectors → [T, V, 3] m."""
        identity = self.neutral + self.directions[..., : len(shape)] @ shape
        last = EXPRESSION + expression.shape[1]
        rest = identity + np.einsum("vxe,te->tvx", self.directions[..., EXPRESSION:last], expression)
        turn = Rotation.from_rotvec(jaw).as_matrix()
        first = 9 * (JAW - 1)
        bent = (turn - np.eye(3)).reshape(len(turn), 9)
        rest = rest + np.einsum("vxk,tk->tvx", self.pose[..., first : first + 9], bent)
        joint = self.regressor[JAW] @ identity
        turned = np.einsum("tij,tvj->tvi", turn, rest - joint) + joint
        share = self.skinning[:, JAW][:, None]
        return (1.0 - share) * rest + share * turned


def read_flame(path: Path) -> Flame:
    """Reads FLAME's own pickle."""
    model = read_pickle(path)
    names = ("v_template", "f", "shapedirs", "posedirs", "J_regressor", "weights")
    missing = [name for name in names if name not in model]
    if missing:
        raise CorpusError(path, None, f"FLAME with {', '.join(names)}", f"no {', '.join(missing)}")
    regressor = model["J_regressor"]
    dense = regressor.toarray() if hasattr(regressor, "toarray") else numbers(regressor)
    template, triangles, shape, pose = (numbers(model[name]) for name in names[:4])
    return Flame(template.astype(float), triangles.astype(int), shape, pose, dense, numbers(model["weights"]))
