"""Facts about synthetic speech with phone times; a stand-in for the model sounds a tone for each letter."""

import json

import numpy as np
import pytest

from training.corpus import kokoro
from training.corpus.aligned import kokoro_count, read_kokoro, read_timed, write
from training.corpus.kokoro import LAG_S, RATE_HZ, UNIT_S, Kokoro, phones
from training.corpus.phones import Phone
from training.packages import check_hash

VOICES = ["af_bella", "af_heart", "am_adam", "am_echo", "ff_siwis", "jf_alpha"]


def tones(inputs) -> tuple[np.ndarray, np.ndarray]:
    """Every token lasts five units at speed 1."""
    count = inputs["tokens"].shape[1]
    durations = np.full((1, count), round(5 / float(inputs["speed"][0])), np.float32)
    samples = int(durations.sum() * UNIT_S * RATE_HZ)
    return np.sin(np.arange(samples) * 0.3, dtype=np.float32), durations


def stand_in() -> Kokoro:
    signs = "bpmaksei nɐəɹIO" + kokoro.BEFORE + kokoro.AFTER + kokoro.NO_SOUND
    vocabulary = {sign: number for number, sign in enumerate(dict.fromkeys(signs), start=1)}
    styles = {voice: np.zeros((510, 1, kokoro.STYLE), np.float32) for voice in VOICES}
    return Kokoro(tones, vocabulary, styles)


class Spelling:
    """In place of espeak-ng: a word sounds as it is spelled."""

    def ipa(self, text: str, voice: str) -> str:
        return text


def speaker() -> kokoro.Speaker:
    words = {
        language: (["baba", "pa^ɪp", "sam"], np.full(3, 1 / 3)) for _, language in kokoro.LANGUAGES.values()
    }
    return kokoro.Speaker(stand_in(), Spelling(), words)


def test_phones_stand_where_they_sound():
    letters = ["ˈ", "b", "I", "ː", " ", "m", ",", " ", "a"]
    timed = phones(letters, np.array([10, 1, 2, 4, 1, 2, 3, 4, 5, 6, 4], float))
    assert [p.label for p in timed] == ["_", "b", "aɪː", "m", "_", "_", "a", "_"]
    first, b, vowel, m = timed[:4]
    assert first == Phone(0.0, 10 * UNIT_S - LAG_S, "_")
    assert b.start_s == pytest.approx(10 * UNIT_S - LAG_S) and b.duration_s == pytest.approx(3 * UNIT_S)
    assert vowel.duration_s == pytest.approx(7 * UNIT_S), (
        "it sounds through its length sign and a short space"
    )
    assert m.start_s == pytest.approx(vowel.end_s)
    assert timed[-1].end_s == pytest.approx(42 * UNIT_S - LAG_S)


def test_a_letter_before_a_pause_ends_with_its_sound():
    samples = np.zeros(16000, np.float32)
    samples[1600:8000] = np.sin(np.arange(6400) * 0.3)
    said = [Phone(0.0, 0.1, "_"), Phone(0.1, 0.2, "a"), Phone(0.3, 0.5, "n"), Phone(0.8, 0.1, "_"),
            Phone(0.9, 0.05, "_"), Phone(0.95, 0.05, "t")]  # fmt: skip
    shortened = kokoro.ended(said, samples)
    assert [p.label for p in shortened] == [p.label for p in said] and shortened[:2] == said[:2]
    assert shortened[2].end_s == pytest.approx(0.5) and shortened[3].start_s == pytest.approx(0.5)
    assert shortened[3].end_s == pytest.approx(0.9) and shortened[4:] == said[4:]
    silent = kokoro.ended(said, np.concatenate([samples[:4800], samples[8000:]]))
    assert silent[2].duration_s == pytest.approx(kokoro.LAST_S)


def test_ipa_is_spelled_in_letters_of_kokoro():
    assert kokoro.spelled("t^ʃˈe^ɪn d^ʒˈo^ʊ s-e^n") == "ʧˈAn ʤˈO sen"


def test_every_voice_of_a_language_takes_its_turn():
    circle = kokoro.voices_in_turn(VOICES)
    assert circle.count("ff_siwis") == kokoro.LEAST_TURNS and "jf_alpha" not in circle
    assert [circle.count(voice) for voice in VOICES[:4]] == [1, 1, 1, 1]


def test_speech_goes_on_where_it_was_interrupted(tmp_path):
    whole, parts, said = tmp_path / "whole/speech/kokoro", tmp_path / "parts/speech/kokoro", speaker()
    kokoro.write(whole, said.say, 60 / 3600)
    kokoro.write(parts, said.say, 20 / 3600)
    with open(parts / "phones.jsonl", "a") as file:
        file.write('{"id": "af_be')
    assert kokoro.write(parts, said.say, 60 / 3600) >= 60
    assert (parts / "phones.jsonl").read_text() == (whole / "phones.jsonl").read_text()
    records = [json.loads(line) for line in (whole / "phones.jsonl").read_text().splitlines()]
    assert kokoro_count(tmp_path / "whole") == [len(records)]
    assert {r["id"][:-6] for r in records} <= set(VOICES[:5]) and len({r["speed"] for r in records}) > 3


def test_lessons_read_the_folder(tmp_path):
    assert read_kokoro(tmp_path) == [] and kokoro_count(tmp_path) == []
    folder = tmp_path / "speech/kokoro"
    kokoro.write(folder, speaker().say, 60 / 3600)
    utterances = read_kokoro(tmp_path)
    lines = [json.loads(line) for line in (folder / "phones.jsonl").read_text().splitlines()]
    assert [u.name for u in utterances] == [line["id"] for line in lines], "no phone overruns its sound"
    assert {u.source for u in utterances} <= {"kokoro_en-us", "kokoro_fr"}
    assert all(u.held_out == u.name.startswith(("af_bella", "ff_siwis")) for u in utterances)
    assert len(utterances[0].samples) / 16000 == pytest.approx(lines[0]["seconds"], abs=0.01)
    assert read_timed(folder, 2)[1].phones == utterances[1].phones
    write(tmp_path / "copy", utterances)
    copied = read_timed(tmp_path / "copy")
    assert [(u.source, u.held_out, u.phones) for u in copied] == [
        (u.source, u.held_out, u.phones) for u in utterances
    ]


def test_a_package_with_other_contents_is_refused():
    with pytest.raises(ValueError, match="expected sha256 00, got"):
        check_hash(b"model", "00", "kokoro")
