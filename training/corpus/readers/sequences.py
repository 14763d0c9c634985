"""Corpora of vertex sequences: VOCASET, BIWI, Multiface."""

import re
from pathlib import Path

import numpy as np

from training.corpus.checked import CorpusError
from training.corpus.readers.tables import (
    found_files,
    need_table,
    numbers,
    pairs_of,
    rate_of,
    read_mesh,
    read_pickle,
    read_sequence,
    sound_of,
)
from training.corpus.writer import CorpusWriter

VOCASET_SPLITS = {
    "val": ("FaceTalk_170811_03275_TA", "FaceTalk_170908_03277_TA"),
    "test": ("FaceTalk_170809_00138_TA", "FaceTalk_170731_00024_TA"),
}
"""Speakers that VOCA (Cudeiro et al. 2019) holds out. The other eight are for training."""
BIWI_FIRST_VAL, BIWI_FIRST_TEST = 33, 37
"""First validation and first test sentence of BIWI in the split of FaceFormer (Fan et al. 2022)."""
BIWI_TRAINING = ("F2", "F3", "F4", "M3", "M4", "M5")
"""Speakers with whom FaceFormer trains. The other eight are for testing."""
SCANTALK_SPLITS = {
    "val": ("F7", "M5", "20190828", "20190521"),
    "test": ("F8", "M6", "20181017", "20180105"),
}
"""Speakers of BIWI and Multiface that ScanTalk (Nocentini et al. 2024) holds out."""
MULTIFACE_TEST_EVERY = 10
VOCASET_FPS, BIWI_FPS, MULTIFACE_FPS = 60.0, 25.0, 30.0
HALVED = 2
"""Public loaders take every second frame of VOCASET. Some copies hold no others."""


def vocaset_split(speaker: str) -> str:
    """The split of a speaker: train, val or test."""
    return next((split for split, names in VOCASET_SPLITS.items() if speaker in names), "train")


def vocaset(source: Path, folder: Path, landmarks: Path | None) -> Path:
    """Reads VOCASET (metres, head still, 60 fps) in one of three layouts, each with FLAME_sample.ply.

    As published: `unposedcleaneddata/SPEAKER/sentenceNN/*.ply` and `audio/SPEAKER/sentenceNN.wav`. For
    training: data_verts.npy, subj_seq_to_idx.pkl, raw_audio_fixed.pkl, templates.pkl. Or as FaceFormer,
    CodeTalker, SelfTalk and ScanTalk need it: vertices_npy/SPEAKER_sentenceNN.npy, wav/, templates.pkl. In
    that layout the frames per second of sound tell whether every frame is there or every second one.
    """
    if (source / "vertices_npy").is_dir():
        rates = (VOCASET_FPS, VOCASET_FPS / HALVED)
        return _flat(source, folder, landmarks, ("vocaset", "flame"), rates, "m", _vocaset_name)
    table = need_table(landmarks, "flame")
    writer = CorpusWriter(folder, "vocaset", "m", topology="flame", fps={"vertices": VOCASET_FPS})
    neutral, triangles = read_mesh(found_files(source, "FLAME_sample.ply")[0])
    writer.mesh("neutral", neutral, triangles)
    writer.landmark_table(table)
    if (source / "data_verts.npy").exists():
        _vocaset_arrays(source, writer, triangles)
    else:
        _vocaset_meshes(source, writer, len(neutral))
    return writer.close()


def _vocaset_arrays(source: Path, writer: CorpusWriter, triangles: np.ndarray) -> None:
    vertices = np.load(source / "data_verts.npy", mmap_mode="r")
    sounds, index = (read_pickle(source / f"{n}.pkl") for n in ("raw_audio_fixed", "subj_seq_to_idx"))
    for speaker, mesh in read_pickle(source / "templates.pkl").items():
        writer.mesh(speaker, numbers(mesh), triangles)
    for speaker, sentences in index.items():
        spoken = sounds.get(speaker, {})
        for sentence, frames in ((name, of) for name, of in sentences.items() if name in spoken):
            clip, sound = f"{speaker}_{sentence}", spoken[sentence]
            writer.clip(clip, speaker, vocaset_split(speaker))
            writer.sound(clip, np.asarray(sound["audio"]), int(sound["sample_rate"]))
            writer.vertices(clip, vertices[[frames[i] for i in sorted(frames)]])


def _vocaset_meshes(source: Path, writer: CorpusWriter, count: int) -> None:
    sentences = found_files(source / "unposedcleaneddata", "sentence*")
    for sentence in [path for path in sentences if path.is_dir()]:
        speaker, clip = sentence.parent.name, f"{sentence.parent.name}_{sentence.name}"
        writer.clip(clip, speaker, vocaset_split(speaker))
        writer.sound_file(clip, sound_of(source / "audio" / speaker, sentence.name))
        writer.vertices(clip, read_sequence(sentence, count))


def _vocaset_name(stem: str) -> tuple[str, str]:
    speaker, _, sentence = stem.rpartition("_")
    return speaker, vocaset_split(speaker) if sentence else "train"


def biwi(source: Path, folder: Path, landmarks: Path | None) -> Path:
    """Reads BIWI at 25 fps as FaceFormer, CodeTalker and SelfTalk need it, or as ScanTalk does.

    FaceFormer: vertices_npy/F2_e01.npy, wav/, templates.pkl, BIWI.ply. ScanTalk (BIWI6): vertices/F2_01.npy,
    wav/, templates/F2.obj. BIWI states no unit and its faces are about one unit wide, so they are scaled to
    about human size. Emotional takes (`e`) have no label, so their emotion is unknown.
    """
    if _has_templates_by_speaker(source):
        return _flat(source, folder, landmarks, ("biwi", "biwi6"), (BIWI_FPS,), None, _scantalk_name)
    return _flat(source, folder, landmarks, ("biwi", "biwi"), (BIWI_FPS,), None, _biwi_name)


def _biwi_name(stem: str) -> tuple[str, str]:
    parts = re.fullmatch(r"([FM]\d+)_(e?)(\d+)", stem)
    if parts is None:
        raise CorpusError(Path(stem), None, "a name like F2_e01 or M3_12", stem)
    sentence = int(parts[3])
    split = "train" if sentence < BIWI_FIRST_VAL else "val" if sentence < BIWI_FIRST_TEST else "test"
    return parts[1], split if parts[1] in BIWI_TRAINING else "test"


def _scantalk_name(stem: str) -> tuple[str, str]:
    speaker = stem.split("_")[0]
    held_out = (split for split, names in SCANTALK_SPLITS.items() if speaker in names)
    return speaker, next(held_out, "train")


def _flat(source: Path, folder: Path, landmarks: Path | None, names: tuple[str, str],
          rates: tuple[float, ...], unit: str | None, of_name) -> Path:  # fmt: skip
    """Reads vertices_npy/*.npy (or vertices/), wav/*.wav, and templates.

    Templates are templates.pkl with a .ply or .obj that has the triangles, or a mesh templates/SPEAKER for
    each speaker. `names`: of the corpus and of its topology. `rates`: the rates that the files may have.
    """
    table = need_table(landmarks, names[1])
    templates, neutral, triangles = _templates(source, names[1])
    scale = 1.0 if unit else metres_of(np.stack(list(templates.values())))
    place = source / "vertices_npy"
    pairs = pairs_of(place if place.is_dir() else source / "vertices", source / "wav")
    fps = {"vertices": rate_of(pairs, rates)}
    writer = CorpusWriter(folder, names[0], unit or "m", topology=names[1], fps=fps)
    writer.mesh("neutral", scale * next(iter(templates.values()), neutral), triangles)
    writer.landmark_table(table)
    for speaker, vertices in templates.items():
        writer.mesh(speaker, scale * vertices, triangles)
    for path, sound in pairs:
        speaker, split = of_name(path.stem)
        emotion = "unknown" if re.search(r"_e\d+$", path.stem) else "neutral"
        writer.clip(path.stem, speaker, split, emotion)
        writer.sound_file(path.stem, sound)
        writer.vertices(path.stem, scale * read_sequence(path, len(neutral)))
    return writer.close()


def _has_templates_by_speaker(source: Path) -> bool:
    """Whether it is ScanTalk's layout. FaceFormer's may have a folder of that name beside templates.pkl."""
    return (source / "templates").is_dir() and not (source / "templates.pkl").exists()


def _templates(source: Path, topology: str) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray]:
    """The speakers' neutral faces [V, 3], and the vertices and triangles of the topology."""
    folder = source / "templates"
    if _has_templates_by_speaker(source):
        files = sorted([*folder.glob("*.ply"), *folder.glob("*.obj")])
        if not files:
            raise CorpusError(folder, None, "a .ply or .obj for each speaker", "none")
        templates = {path.stem: read_mesh(path)[0] for path in files}
        return templates, *read_mesh(files[0])
    meshes = [*sorted(source.glob("*.ply")), *sorted(source.glob("*.obj"))]
    meshes = meshes or [*sorted(source.rglob("*.ply")), *sorted(source.rglob("*.obj"))]
    templates = {k: numbers(v).reshape(-1, 3) for k, v in read_pickle(source / "templates.pkl").items()}
    if not meshes:
        raise CorpusError(source, None, f"a .ply or .obj of {topology} with triangles", "none")
    return templates, *read_mesh(meshes[0])


def metres_of(templates: np.ndarray, width_m: float = 0.15) -> float:
    """Factor that brings faces [S, V, 3] of unknown unit to about human width (ear to ear, along x)."""
    width = float(np.median(np.ptp(templates[..., 0], axis=1)))
    return width_m / width


def multiface(source: Path, folder: Path, landmarks: Path | None) -> Path:
    """Reads Multiface (Wuu et al. 2022), in millimetres, head still, 30 fps.

    Its files are PERSON/tracked_mesh/SENTENCE/*.obj (or .bin beside one .obj) and PERSON/audio/SENTENCE.wav.
    Every tenth sentence of a person is for testing. A person's neutral face is the first frame of a take with
    `neutral` in its name if there is one, else of the first sentence. ScanTalk's copies have another layout:
    vertices/20180227_SENTENCE.npy, wav/, templates/20180227.ply, in a unit that they do not state.
    """
    if _has_templates_by_speaker(source):
        fps = (MULTIFACE_FPS,)
        return _flat(source, folder, landmarks, ("multiface", "multiface"), fps, None, _scantalk_name)
    table = need_table(landmarks, "multiface")
    writer = CorpusWriter(folder, "multiface", "mm", topology="multiface", fps={"vertices": MULTIFACE_FPS})
    writer.landmark_table(table)
    for tracked in found_files(source, "tracked_mesh"):
        person = tracked.parent.name
        takes = sorted(path for path in tracked.iterdir() if path.is_dir())
        rest = [take for take in takes if "neutral" in take.name.lower()] or takes
        neutral, triangles = read_obj_of(rest[0])
        writer.mesh(person, neutral, triangles)
        if not (folder / "topologies/multiface/neutral.obj").exists():
            writer.mesh("neutral", neutral, triangles)
        said = [take for take in takes if (tracked.parent / f"audio/{take.name}.wav").exists()]
        for number, take in enumerate(said):
            clip = f"{person}_{take.name}"
            writer.clip(clip, person, "test" if number % MULTIFACE_TEST_EVERY == 9 else "train")
            writer.sound_file(clip, tracked.parent / f"audio/{take.name}.wav")
            writer.vertices(clip, multiface_frames(take, len(neutral)))
    return writer.close()


def read_obj_of(take: Path) -> tuple[np.ndarray, np.ndarray]:
    """Reads the first .obj of a take."""
    return read_mesh(found_files(take, "*.obj")[0])


def multiface_frames(take: Path, vertices: int) -> np.ndarray:
    """Vertices [T, V, 3] of a take, from its .bin files (f32) if it has any."""
    binary = sorted(take.glob("*.bin"))
    if not binary:
        return read_sequence(take, vertices)
    frames = [np.fromfile(path, np.float32) for path in binary]
    for path, frame in zip(binary, frames, strict=True):
        if frame.size != 3 * vertices:
            raise CorpusError(path, None, f"{3 * vertices} numbers", frame.size)
    return np.stack(frames).reshape(len(frames), vertices, 3)
