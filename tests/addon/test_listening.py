"""*Live Microphone*: the face speaks along with the artist, and recordings become takes."""

import wave
from pathlib import Path

import bpy
import numpy as np
import pytest

from test_live import now, shape

RATE_HZ = 16000
KEY = "Anyface Live"


class Room:
    """The sound that microphones hear, in place of the library's microphones."""

    def __init__(self):
        self.sound, self.open, self.is_lost, self.error = np.zeros(0, np.float32), 0, False, None
        self.spoken = 0

    def speak(self, seconds):
        """Plays the next seconds of a voice at once: syllables whose pitch glides."""
        first, self.spoken = self.spoken, self.spoken + int(seconds * RATE_HZ)
        at = np.arange(self.spoken) / RATE_HZ
        pitch = 120 * (1 + 0.3 * (np.sin(5.6 * at) + 0.5 * np.sin(18.8 * at)))
        phase = 2 * np.pi * np.cumsum(pitch) / RATE_HZ
        buzz = sum(formants(k * pitch) * np.sin(k * phase) for k in range(1, 30))
        voice = 0.06 * buzz * (0.5 - 0.5 * np.cos(6 * np.pi * at)) ** 2
        self.sound = np.concatenate([self.sound, voice[first:].astype(np.float32)])


def formants(hz):
    """The gain at frequencies `hz` in a mouth that says "a"."""
    peaks = ((1.0, 700, 300), (0.5, 1200, 300), (0.15, 2500, 400))
    return sum(gain * np.exp(-(((hz - place) / width) ** 2)) for gain, place, width in peaks)


@pytest.fixture
def room(addon, monkeypatch):
    """A room that the microphones of the add-on hear."""
    room = Room()

    class Microphone:
        name = "Desk"

        def __init__(self, name=""):
            if room.error:
                raise addon("core.errors").AnyfaceError("audio", room.error)

        def __enter__(self):
            room.open += 1
            return self

        def __exit__(self, *_):
            room.open -= 1

        @property
        def is_lost(self):
            return room.is_lost

        def read(self):
            heard, room.sound = room.sound, np.zeros(0, np.float32)
            return heard

    monkeypatch.setattr(addon("core.native_live"), "Microphone", Microphone)
    return room


@pytest.fixture
def listener(room):
    """The sample head, listening to the microphone."""
    bpy.ops.anyface.add_sample_head()
    ob = bpy.context.object
    bpy.context.scene.render.fps = 24
    assert bpy.ops.anyface.listen() == {"FINISHED"}
    return ob


def heard(addon, ob):
    """Runs Blender's timer once and returns the face."""
    addon("scene.live").listen()
    return now(ob)


def test_the_face_speaks_with_the_artist_and_nothing_stays(addon, room, listener):
    rest = now(listener)
    shapes = []
    for _ in range(8):
        room.speak(0.1)
        shapes.append(heard(addon, listener))
    assert max(np.abs(points - rest).max() for points in shapes) > 0.002
    assert np.array_equal(heard(addon, listener), shapes[-1]), "nothing more was heard"
    listener.anyface.emotion, listener.anyface.intensity = "happy", 1.0
    room.speak(1.0)
    assert np.abs(heard(addon, listener) - shapes[-1]).max() > 0.003
    assert room.open == 1
    assert bpy.ops.anyface.listen() == {"FINISHED"}
    assert room.open == 0 and listener.data.shape_keys is None
    assert addon("scene.live").listen() is None, "the timer ends"


def test_a_face_without_delay_shows_what_the_room_has_just_heard(addon, room, monkeypatch):
    preferences = addon("ui.preferences")
    bpy.ops.anyface.add_sample_head()
    ob = bpy.context.object
    opened_s = {}
    for setting in ("0.19", "0"):
        monkeypatch.setattr(preferences, "look_ahead", lambda setting=setting: float(setting))
        room.sound, room.spoken = np.zeros(0, np.float32), 0
        assert bpy.ops.anyface.listen() == {"FINISHED"}
        face = addon("scene.live").listener(ob)
        assert face.delay_s == pytest.approx(float(setting), abs=0.005)
        rest, seconds = now(ob), 0.0
        while seconds < 2.0 and np.abs(heard(addon, ob) - rest).max() < 0.002:
            room.speak(0.02)
            seconds += 0.02
        opened_s[setting] = seconds
        bpy.ops.anyface.listen()
    assert opened_s["0"] < opened_s["0.19"] < 2.0


def test_a_system_that_needs_more_sound_takes_it(addon, room, monkeypatch):
    monkeypatch.setattr(addon("ui.preferences"), "look_ahead", lambda: 0.0)
    bpy.ops.anyface.add_sample_head()
    ob = bpy.context.object
    ob.anyface.system = "emoface"
    assert bpy.ops.anyface.listen() == {"FINISHED"}
    assert addon("scene.live").listener(ob).delay_s > 0.1


def test_a_recording_is_a_strip_and_a_take(addon, room, listener, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    assert room.open == 0, "saving ends it"
    bpy.context.scene.frame_set(11)
    bpy.ops.anyface.listen()
    room.speak(1.0)
    heard(addon, listener)
    assert bpy.ops.anyface.record() == {"FINISHED"}
    bpy.context.scene.frame_set(20)
    for _ in range(5):
        room.speak(0.3)
        heard(addon, listener)
    assert bpy.ops.anyface.record() == {"FINISHED"}
    path = tmp_path / "sounds" / "recording_001.wav"
    with wave.open(str(path)) as file:
        assert (file.getnchannels(), file.getframerate()) == (1, RATE_HZ)
        assert file.getnframes() == 24000
        samples = np.frombuffer(file.readframes(24000), "<i2")
    assert 3000 < np.abs(samples).max() < 20000
    strips = addon("scene.sound.sequencer").sound_strips(bpy.context.scene)
    assert [strip.name for strip in strips] == [listener.anyface.strip]
    assert addon("scene.sound.sequencer").ends(strips[0])[0] == 11
    # The take is there, and the microphone is closed.
    assert room.open == 0
    assert KEY not in listener.data.shape_keys.key_blocks
    assert np.abs(shape(listener, 24) - shape(listener, 200)).max() > 0.002
    assert not bpy.ops.anyface.listen.poll() and not bpy.ops.anyface.record.poll()
    bpy.ops.anyface.remove()
    bpy.ops.anyface.listen()
    bpy.ops.anyface.record()
    room.speak(0.5)
    heard(addon, listener)
    bpy.ops.anyface.record()
    assert (tmp_path / "sounds" / "recording_002.wav").is_file()


def test_a_recording_in_a_file_without_a_name_is_kept_in_it(addon, room, listener):
    bpy.ops.anyface.record()
    room.speak(0.5)
    heard(addon, listener)
    bpy.ops.anyface.record()
    (strip,) = addon("scene.sound.sequencer").sound_strips(bpy.context.scene)
    assert strip.sound.packed_file is not None
    assert Path(strip.sound.filepath).name == "recording_001.wav"


def test_a_recording_that_cannot_be_written_is_not_lost(addon, room, listener, monkeypatch):
    module = addon("scene.sound.recording")
    bpy.ops.anyface.record()
    room.speak(0.5)
    heard(addon, listener)

    def full(_sound):
        raise OSError("No space left on device")

    with monkeypatch.context() as disk:
        disk.setattr(module, "write", full)
        with pytest.raises(RuntimeError, match="cannot be written: No space left"):
            bpy.ops.anyface.record()
    assert addon("scene.live").listener(listener).is_recording
    room.speak(0.5)
    heard(addon, listener)
    assert bpy.ops.anyface.record() == {"FINISHED"}
    (strip,) = addon("scene.sound.sequencer").sound_strips(bpy.context.scene)
    ends = addon("scene.sound.sequencer").ends(strip)
    assert ends[1] - ends[0] == pytest.approx(24, abs=1)


def test_a_slip_of_the_button_changes_nothing(addon, room, listener):
    bpy.ops.anyface.record()
    with pytest.raises(RuntimeError, match=r"0\.2 s or more"):
        bpy.ops.anyface.record()
    assert not addon("scene.sound.sequencer").sound_strips(bpy.context.scene)
    assert addon("scene.live").listens(listener), "it goes on"


def test_a_microphone_that_cannot_be_opened_is_told(room):
    bpy.ops.anyface.add_sample_head()
    ob = bpy.context.object
    room.error = "microphone: expected a device that records, and this system lists none"
    with pytest.raises(RuntimeError, match="expected a device that records"):
        bpy.ops.anyface.listen()
    assert ob.data.shape_keys is None and room.open == 0
    room.error = None
    assert bpy.ops.anyface.listen() == {"FINISHED"}


def test_a_face_that_cannot_be_keyed_closes_the_microphone(addon, room):
    bpy.ops.anyface.add_sample_head()
    ob = bpy.context.object
    ob.anyface.system = "cafe-talk"
    with pytest.raises(RuntimeError, match="needs the whole sound"):
        bpy.ops.anyface.listen()
    assert room.open == 0 and ob.data.shape_keys is None


def test_a_face_that_cannot_begin_closes_the_microphone(addon, room, monkeypatch):
    bpy.ops.anyface.add_sample_head()

    def refuse(*_):
        raise addon("core.errors").AnyfaceError("mesh", "no key today")

    monkeypatch.setattr(addon("scene.live"), "begin", refuse)
    with pytest.raises(RuntimeError, match="no key today"):
        bpy.ops.anyface.listen()
    assert room.open == 0


def test_a_voice_of_a_file_takes_over(addon, room, listener, tmp_path):
    room.speak(1.0)
    with wave.open(str(tmp_path / "voice.wav"), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(RATE_HZ)
        file.writeframes((room.sound * 32767).astype("<i2").tobytes())
    listener.anyface.source = "FILE"
    listener.anyface.sound_file = str(tmp_path / "voice.wav")
    assert bpy.ops.anyface.live() == {"FINISHED"}
    live = addon("scene.live")
    assert live.is_on(listener) and not live.listens(listener) and room.open == 0
    assert bpy.ops.anyface.listen() == {"FINISHED"}
    assert live.listens(listener) and room.open == 1


def test_a_face_that_is_deleted_closes_the_microphone(addon, room, listener):
    bpy.data.objects.remove(listener)
    addon("scene.live").listen()
    assert room.open == 0


def test_the_library_of_the_microphone_is_there_and_refuses_what_is_none(addon):
    microphone = addon("core.microphone")
    assert microphone.path().is_file()
    assert all(isinstance(name, str) for name in microphone.devices())
    with pytest.raises(addon("core.errors").AnyfaceError, match="microphone: expected"):
        microphone.Microphone("a device that nobody has")


def test_without_the_library_the_button_is_grey_and_says_what_is_missing(addon, room, monkeypatch):
    microphone = addon("core.microphone")
    bpy.ops.anyface.add_sample_head()
    listen = addon("ui.listening").ANYFACE_OT_listen
    assert listen.poll(bpy.context)
    place = Path("/nowhere/libanyface_microphone.so")
    monkeypatch.setattr(microphone, "path", lambda: place)
    assert not listen.poll(bpy.context)
    assert f"expected {place.name} in {place.parent}" in listen.why_not(bpy.context)
