"""Reading strips and files: trim, place, packing, retiming, errors."""

import bpy
import numpy as np
import pytest

from figures import Stage, grid, strip, tone, write_wav

RATE = 16000


def ramp(path, seconds=4.0):
    """A sound whose samples tell their time: `value = time / 10`."""
    write_wav(path, np.arange(int(seconds * RATE)) / RATE / 10.0, RATE)
    return str(path)


def with_length(path, frame=11):
    """Adds a strip. Skips the test without sound, as in Blender 4.2 as a Python module."""
    try:
        return strip(path, frame=frame)
    except RuntimeError as error:
        pytest.skip(str(error).strip())


def read(addon, name="Voice"):
    """The frame at which a strip begins, and its sound."""
    stage = Stage(addon("core.take"))
    source = addon("scene.sound.sound_source").from_strip(bpy.context.scene, name, stage.decode)
    return source.start_frame, source.load(stage.decode)


def test_a_whole_strip(addon, tmp_path):
    with_length(ramp(tmp_path / "a.wav"))
    start, sound = read(addon)
    assert start == 11
    assert sound.rate_hz == RATE and len(sound.samples) == 4 * RATE


def test_trim_moves_start_and_content_together(addon, tmp_path):
    voice = with_length(ramp(tmp_path / "a.wav"))
    voice.frame_offset_start, voice.frame_offset_end = 24, 12
    start, sound = read(addon)
    assert start == 35
    assert sound.samples[0] == pytest.approx(0.1, abs=1e-3)
    assert sound.duration_s == pytest.approx(2.5, abs=1e-3)


def test_a_strip_made_longer_than_its_sound_begins_with_silence(addon, tmp_path):
    voice = with_length(ramp(tmp_path / "a.wav"))
    voice.frame_offset_start = -24
    start, sound = read(addon)
    assert start == -13
    assert np.abs(sound.samples[: RATE - 2]).max() == 0.0
    assert sound.samples[2 * RATE] == pytest.approx(0.1, abs=1e-3)


def test_muted_and_packed_strips_are_read(addon, tmp_path):
    path = tmp_path / "a.wav"
    voice = with_length(ramp(path))
    voice.mute = True
    voice.sound.pack()
    path.unlink()
    assert len(read(addon)[1].samples) == 4 * RATE


def test_a_retimed_strip_plays_as_blender_plays_it(addon, tmp_path):
    voice = with_length(tone(tmp_path / "a.wav", seconds=4.0, silent_until=2.0))
    other = strip(tone(tmp_path / "b.wav", seconds=4.0), name="Noise", channel=2)
    scene = bpy.context.scene
    scene.sequence_editor.active_strip = voice
    voice.select, other.select = True, False
    with bpy.context.temp_override(**addon("scene.sound.sequencer").override(scene)):
        set_speed = bpy.ops.sequencer.retiming_segment_speed_set
        # Blender 5.2 no longer has this option and always behaves as if it were false.
        known = "keep_retiming" in set_speed.get_rna_type().properties
        set_speed(speed=200, **({"keep_retiming": False} if known else {}))
    assert voice.frame_final_duration == pytest.approx(48, abs=1)
    before = (other.mute, scene.frame_start, scene.frame_end)
    _, sound = read(addon)
    assert sound.duration_s == pytest.approx(2.0, abs=0.1)
    loud = np.abs(sound.samples) > 0.05
    assert np.flatnonzero(loud)[0] / sound.rate_hz == pytest.approx(1.0, abs=0.1)
    assert (other.mute, scene.frame_start, scene.frame_end) == before


def test_a_missing_strip_names_those_that_are_there(addon, tmp_path):
    with_length(ramp(tmp_path / "a.wav"))
    with pytest.raises(addon("core.errors").AnyfaceError, match=r"\(Voice\), got 'Vioce'"):
        read(addon, "Vioce")


def test_a_missing_file_is_named(addon, tmp_path):
    path = tmp_path / "a.wav"
    with_length(ramp(path))
    path.unlink()
    with pytest.raises(addon("core.errors").AnyfaceError, match=r"no sound file at .*a\.wav"):
        read(addon)
    with pytest.raises(addon("core.errors").AnyfaceError, match="empty path"):
        addon("scene.sound.sound_source").from_file("", 1)


def test_aud_averages_channels(addon, tmp_path):
    pytest.importorskip("aud")
    import wave

    path = str(tmp_path / "stereo.wav")
    left = np.full(RATE, 0.8)
    with wave.open(path, "wb") as file:
        file.setnchannels(2)
        file.setsampwidth(2)
        file.setframerate(RATE)
        pairs = np.column_stack([left, left * 0.5])
        file.writeframes((pairs * 32767).astype("<i2").tobytes())
    samples, rate = addon("scene.sound.decode").decode_with_aud(path)
    assert rate == RATE and samples.shape == (RATE,)
    assert samples.mean() == pytest.approx(0.6, abs=1e-3)


@pytest.mark.parametrize(
    "raised", [ValueError("cannot reshape"), SystemError("no data"), OSError()]
)
def test_an_empty_sound_is_told_in_the_words_of_the_library(addon, monkeypatch, tmp_path, raised):
    module, errors = addon("scene.sound.decode"), addon("core.errors")
    path = tmp_path / "empty.wav"
    write_wav(path, np.zeros(0), 16000)

    class Library:
        def decode(self, _path):
            raise errors.AnyfaceError("audio", f"{path.name}: expected sound, got no samples")

        def is_damaged(self, _path):
            return False

    def breaks(_path):
        raise raised

    monkeypatch.setattr(module, "decode_with_aud", breaks)
    with pytest.raises(errors.AnyfaceError, match="expected sound, got no samples"):
        module.decoder(Library())(str(path))


def test_an_empty_sound_is_told_by_the_real_library(addon, tmp_path):
    ob = grid()
    path = tmp_path / "empty.wav"
    write_wav(path, np.zeros(0), 16000)
    ob.anyface.source, ob.anyface.sound_file = "FILE", str(path)
    engine, errors = addon("ui.running").engine(""), addon("core.errors")
    decode = addon("scene.sound.decode").decoder(engine)
    with pytest.raises(errors.AnyfaceError, match="no samples") as caught:
        addon("scene.sound.sound_source").from_file(str(path), 1).load(decode)
    assert caught.value.kind == "audio"
    path.write_bytes(b"")
    with pytest.raises(RuntimeError, match=r"empty\.wav is empty"):
        bpy.ops.anyface.choose_sound(filepath=str(path))
