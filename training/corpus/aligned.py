"""Speech with phone times: recorded, aligned by pocketsphinx, or spoken by espeak-ng.

    python -m training.corpus.aligned --data ../shared/data --out runs/aligned

writes the held-out part of each source as a folder of sound and `phones.jsonl`, for
`cargo measure quality --aligned`. The corpora here train the ear (`training.speech.train_ear`) and drive the
co-articulation teacher.
"""

import csv
import json
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import soundfile

from training import DATA
from training.corpus.clip import read_sound
from training.corpus.espeak import Espeak
from training.corpus.phones import PAUSE, Phone
from training.corpus.split import grid_held_out
from training.flags import run_command

LAST_PHONE_S = 0.02
HELD_OUT_EVERY = 20
UNSEEN_LANGUAGES = ("fi", "hu", "el")
"""Languages that training never sees. They measure how well the encoder generalises."""

MEASURED_LANGUAGES = (*UNSEEN_LANGUAGES, "de", "es", "fr", "hi", "it", "pl", "cmn")
"""Languages in the report. Training speaks some of them too, but not the sentences of `MEASURED_SEED`."""

MEASURED_SEED = 1_000_003

ALPHABETS = {
    "en-us": ("b c d f g h j k l m n p r s t v w y z sh ch th", "a e i o u ea oo ai"),
    "en-gb-scotland": ("b c d f g h k l m n p r s t v w sh ch th", "a e i o u ou ee ow"),
    "de": ("b d f g h k l m n p r s t w z sch pf", "a e i o u ä ö ü ei au"),
    "nl": ("b d f g h k l m n p r s t v w z sch", "a e i o u aa oe ui ij eu"),
    "fr": ("b c d f g j l m n p r s t v ch", "a é i o u ou an on eu oi"),
    "es": ("b c d f g j l m n p r s t v ll ñ", "a e i o u ie ue"),
    "it": ("b c d f g l m n p r s t v gl gn z", "a e i o u ia uo"),
    "pt-br": ("b c d f g j l m n p r s t v lh nh", "a e i o u ão õe"),
    "pl": ("b c d f g k l ł m n p r s t w z sz cz", "a e i o u y ą ę ó"),
    "cs": ("b c č d f h k l m n p r ř s š t v z ž", "a e i o u y á í ů ou"),
    "ru": ("б в г д ж з к л м н п р с т ф х ч ш", "а е и о у ы ю я"),
    "sv": ("b d f g h k l m n p r s t v sj", "a e i o u y å ä ö"),
    "tr": ("b c ç d f g h k l m n p r s ş t v y z", "a e ı i o ö u ü"),
    "hi": ("ब भ च ड द फ ग ह ज क ल म न प र स त व य", "ा ि ी ु ू े ै ो ौ"),
    "cmn": ("妈 爸 不 波 破 摸 佛 发 得 特 呢 了", "我 是 一 五 鱼 好 歌 饿 爱 欧 安 恩"),
    "id": ("b c d f g h j k l m n p r s t w y", "a e i o u ai au"),
    "ro": ("b c d f g h j l m n p r s ș t ț v z", "a e i o u ă î"),
    "fi": ("h j k l m n p r s t v", "a e i o u y ä ö aa uo ie"),
    "hu": ("b c cs d f g gy h j k l m n p r s sz t v z", "a á e é i o ö ő u ü ű"),
    "el": ("β γ δ ζ θ κ λ μ ν ξ π ρ σ τ φ χ ψ μπ", "α ε η ι ο υ ω ου"),
}
"""For each language that espeak-ng speaks here, the spellings of consonants and of vowels."""

VARIANTS = ("", "+m1", "+m3", "+m5", "+m7", "+f1", "+f2", "+f3", "+f4")


@dataclass
class Utterance:
    """Speech, `samples` [S] at 16 kHz. `phones` is None if they are unknown; `words` have start and end in
    seconds and are empty if nobody timed them."""

    name: str
    source: str
    held_out: bool
    samples: np.ndarray
    phones: list[Phone] | None
    words: list[tuple[float, float, str]] = field(default_factory=list)


def read_nathalie(data: Path, limit: int | None = None) -> list[Utterance]:
    """Dutch with its own phone times."""
    return read_timed(data / "speech/nathalie_nl", limit)


def read_kokoro(data: Path) -> list[Utterance]:
    """Voices of `training.corpus.kokoro`; empty if it wrote nothing."""
    folder = data / "speech/kokoro"
    return read_timed(folder) if folder.exists() else []


def kokoro_count(data: Path) -> list[int]:
    """Number of Kokoro utterances as a list of one, for the names of caches; empty if there are none."""
    path = data / "speech/kokoro/phones.jsonl"
    return [path.read_text().count("\n")] if path.exists() else []


def read_timed(folder: Path, limit: int | None = None) -> list[Utterance]:
    """Sounds listed in `phones.jsonl`, one per line. Clips whose phones overrun the sound are dropped.

    A line may have `source` and `held_out`. Without them the folder is the source, and every twentieth clip
    is held out.
    """
    utterances = []
    for index, line in enumerate((folder / "phones.jsonl").read_text().splitlines()[:limit]):
        record = json.loads(line)
        phones = [Phone(p["start"], p["duration"], p["phone"]) for w in record["words"] for p in w["phones"]]
        sounds = (folder / f"{record['id']}{ending}" for ending in (".ogg", ".wav"))
        samples = read_sound(next(path for path in sounds if path.exists()))
        end_s = len(samples) / 16000
        if phones and phones[-1].end_s > end_s + LAST_PHONE_S:
            continue
        timed = [
            (word["phones"], word["word"]) for word in record["words"] if word["phones"] and word["word"]
        ]
        words = [(p[0]["start"], p[-1]["start"] + p[-1]["duration"], word) for p, word in timed]
        held_out = record.get("held_out", index % HELD_OUT_EVERY == 0)
        source = record.get("source", folder.name)
        utterances.append(Utterance(record["id"], source, held_out, samples, phones, words))
    return utterances


def read_librivox(data: Path) -> list[Utterance]:
    """Five English sentences with phone times; never trained on."""
    utterances = []
    for path in sorted((data / "clips/librivox").glob("*.phone.json")):
        rows = json.loads(path.read_text())["w"]
        phones = [Phone(p["b"], p["d"], p["t"]) for w in rows for p in w.get("w", [])]
        words = [(w["b"], w["b"] + w["d"], w["t"].split("(")[0]) for w in rows if not w["t"].startswith("<")]
        name = path.name.removesuffix(".phone.json")
        samples = read_sound(path.with_name(f"{name}.wav"))
        utterances.append(Utterance(name, "librivox_en", True, samples, phones, words))
    return utterances


def read_texts(folder: Path) -> dict[str, str]:
    """Sentences by clip name, from `transcripts.tsv`."""
    with open(folder / "transcripts.tsv", newline="") as file:
        rows = csv.reader(file, delimiter="\t", quoting=csv.QUOTE_NONE)
        return {row[0]: row[-1] for row in rows}


def read_kathleen(data: Path, limit: int | None = None, only_held_out: bool = False) -> list[Utterance]:
    """English of one woman, aligned."""
    folder, aligner, utterances = data / "speech/kathleen_en", Aligner(), []
    for index, (name, text) in enumerate(sorted(read_texts(folder).items())[:limit]):
        held_out = index % HELD_OUT_EVERY == 0
        if only_held_out and not held_out:
            continue
        samples = read_sound(folder / f"{name}.ogg")
        phones = aligner.align(samples, text)
        if phones:
            utterances.append(Utterance(name, "kathleen_en", held_out, samples, phones))
    return utterances


def read_grid_speech(data: Path, source: str = "grid_s1", chosen: set[str] | None = None) -> list[Utterance]:
    """The words of grid_s1 or grid_five, aligned."""
    folder, aligner, utterances = data / "motion" / source, Aligner(), []
    texts = grid_texts(data, source)
    held_out = grid_held_out(list(texts)) if source == "grid_s1" else set()
    for name in sorted(texts if chosen is None else chosen & set(texts)):
        samples = read_sound(folder / "audio" / f"{name}.ogg")
        phones = aligner.align(samples, texts[name])
        if phones:
            utterances.append(Utterance(name, source, name in held_out, samples, phones))
    return utterances


def grid_texts(data: Path, source: str) -> dict[str, str]:
    """Sentences of the clips of grid_s1 or grid_five by name."""
    if source == "grid_s1":
        return {name: " ".join(word for _, _, word in words) for name, words in grid_words(data).items()}
    with open(data / "motion" / source / "clips.tsv", newline="") as file:
        return {row["clip"]: row["text"] for row in csv.DictReader(file, delimiter="\t")}


def grid_words(data: Path) -> dict[str, list[tuple[float, float, str]]]:
    """Words of the clips of grid_s1, start and end in seconds."""
    words = {}
    for line in (data / "motion/grid_s1/words.tsv").read_text().splitlines():
        name, start, end, word = line.split("\t")
        rows = words.setdefault(name, [])
        if word not in ("sil", "sp"):
            rows.append((float(start), float(end), word))
    return words


def read_unlabelled(data: Path, source: str, limit: int | None = None) -> list[Utterance]:
    """Speech with unknown phones."""
    paths = sorted((data / "speech" / source).glob("*.ogg"))[:limit]
    return [Utterance(p.stem, source, False, read_sound(p), None) for p in paths]


class Aligner:
    """Aligns English text to sound with pocketsphinx (BSD): first words, then phones, in steps of 10 ms."""

    def __init__(self):
        from pocketsphinx import Decoder

        self.decoder = Decoder(samprate=16000, loglevel="FATAL", bestpath=False)

    def align(self, samples: np.ndarray, text: str) -> list[Phone]:
        """Phones of `text` in the sound; empty if the aligner fails or knows less than 80 % of the words."""
        known = [w for w in _words(text) if self.decoder.lookup_word(w)]
        sound = (np.clip(samples, -1, 1) * 32767).astype(np.int16).tobytes()
        if len(known) < 0.8 * len(_words(text)) or not known:
            return []
        try:
            self.decoder.set_align_text(" ".join(known))
            self._decode(sound)
            self.decoder.set_alignment()
            self._decode(sound)
            alignment = self.decoder.get_alignment()
        except RuntimeError:
            return []
        if alignment is None:
            return []
        return [Phone(p.start / 100, p.duration / 100, p.name) for w in alignment.words() for p in w]

    def _decode(self, sound: bytes) -> None:
        self.decoder.start_utt()
        self.decoder.process_raw(sound, full_utt=True)
        self.decoder.end_utt()


def _words(text: str) -> list[str]:
    letters = "".join(c if c.isalpha() or c == "'" else " " for c in text.lower())
    return letters.split()


def speak(espeak: Espeak, language: str, minutes: float, seed: int, texts=()) -> list[Utterance]:
    """Synthetic speech: numbers, invented words of the language, and `texts` if there are any.

    Voice, rate and pitch change with every sentence.
    """
    random = np.random.default_rng([seed, zlib.crc32(language.encode())])
    utterances, seconds = [], 0.0
    while seconds < 60.0 * minutes:
        phrase = texts[int(random.integers(len(texts)))] if len(texts) and random.random() < 0.5 else None
        text = phrase or _sentence(language, random)
        voice = language + str(random.choice(VARIANTS))
        rate, pitch, melody = (int(random.integers(*r)) for r in ((110, 230), (20, 85), (20, 80)))
        samples, phones = espeak.speak(text, voice, rate, pitch, melody)
        if len(samples) < 8000:
            continue
        samples = samples / max(np.abs(samples).max(), 1e-3) * 0.9
        held_out = language in UNSEEN_LANGUAGES or len(utterances) % HELD_OUT_EVERY == 0
        name = f"{language}_{len(utterances):04d}"
        utterances.append(Utterance(name, f"espeak_{language}", held_out, samples, phones))
        seconds += len(samples) / 16000
    return utterances


def _sentence(language: str, random: np.random.Generator) -> str:
    consonants, vowels = (spelling.split() for spelling in ALPHABETS[language])
    words = []
    for _ in range(int(random.integers(3, 9))):
        if random.random() < 0.3:
            words.append(str(int(10 ** random.uniform(0, 5))))
            continue
        count = int(random.integers(1, 4))
        syllable = [str(random.choice(consonants)) + str(random.choice(vowels)) for _ in range(count)]
        ending = str(random.choice(consonants)) if random.random() < 0.4 and language != "hi" else ""
        words.append("".join(syllable) + ending)
    return " ".join(words) + str(random.choice([".", "?", "!", ","]))


def write(folder: Path, utterances: list[Utterance]) -> None:
    """Writes one source as sound files and `phones.jsonl`."""
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / "phones.jsonl", "w") as file:
        for utterance in utterances:
            soundfile.write(folder / f"{utterance.name}.wav", utterance.samples, 16000, subtype="PCM_16")
            phones = [
                {"start": round(p.start_s, 3), "duration": round(p.duration_s, 3), "phone": p.label or PAUSE}
                for p in utterance.phones
            ]
            record = {"id": utterance.name, "source": utterance.source, "held_out": utterance.held_out}
            record["words"] = [{"word": "", "phones": phones}]
            file.write(json.dumps(record, ensure_ascii=False) + "\n")


def main(
    data: Path = DATA,
    out: Path = Path("runs/aligned"),
    minutes: Annotated[float, "minutes of each language that espeak-ng speaks"] = 1.5,
) -> None:
    """Command line."""
    espeak = Espeak()
    clips = (data / "motion/grid_s1/clips.tsv").read_text().splitlines()
    held_out = grid_held_out([line.split("\t")[0] for line in clips])
    recorded = [
        read_librivox(data),
        read_nathalie(data),
        read_kathleen(data, only_held_out=True),
        read_grid_speech(data, chosen=held_out),
    ]
    spoken = [speak(espeak, x, minutes, seed=MEASURED_SEED) for x in MEASURED_LANGUAGES]
    for part in [[u for u in utterances if u.held_out] for utterances in recorded] + spoken:
        write(out / part[0].source, part)
        print(out / part[0].source, len(part))


if __name__ == "__main__":
    run_command(main)
