"""The settings of a character, stored on its object and animatable where that makes sense."""

import bpy
from bpy.props import (
    BoolProperty,
    CollectionProperty,
    EnumProperty,
    FloatProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)
from bpy.types import PropertyGroup

from ..core import systems
from ..core.emotion import MAX_INTENSITY
from ..scene import identity, live, outputs
from . import (
    audio,
    character,
    controls,
    life,
    mixture,
    mouth_chart,
    output_properties,
    overridable,
    pictures,
    texts,
    words,
)

_SOURCES = [
    ("STRIP", "Strip", "A sound strip of the video sequencer, with its trim and place", 0),
    ("FILE", "File", "A sound file that the sequencer does not play", 1),
    ("CHANNEL", "Channel", "All sound strips of a channel of the sequencer, as one take", 2),
    ("CHOSEN", "Several", "The strips that you chose, as one take", 3),
]
_EMOTION_SOURCES = [
    ("GIVEN", "As Chosen", "The emotion and intensity of the panel", 0),
    (
        "VOICE",
        "From the Voice",
        "The emotion in the voice: anger, joy, fear, sadness, disgust, calm; none if uncertain",
        1,
    ),
    (
        "AROUSAL",
        "Excitement of the Voice",
        "How excited the voice sounds, not which emotion it has: glad and angry voices look alike",
        3,
    ),
    ("OFF", "None", "Speech alone: no emotion, no blinks, no motion of brows and lids", 2),
]
_AXES = [
    (
        "AUTO",
        "Automatic",
        "Any direction; the others decide where several places look like faces",
        0,
    ),
    ("WORLD", "World", "The head faces -Y in the world", 1),
    ("LOCAL", "Local", "The head faces -Y in its own space", 2),
    ("LOCAL_Y_UP", "Local, Y Up", "The head faces +Z with +Y up in its own space", 3),
]


def _frames(name: str, description: str, least: int):
    """A property for how many frames a pose is held."""
    more = "" if least else "; 0 for one pose"
    return IntProperty(
        name=name,
        description=description + more,
        default=2,
        min=least,
        soft_max=8,
        max=48,
        options=set(),
    )


class AnyfaceCharacter(PropertyGroup):
    """Settings of one character; `Object.anyface`.

    When the extension registers, it adds a property for each of the library's controls and for
    each of its plain fields.
    """

    source: EnumProperty(name="Sound", items=_SOURCES, default="STRIP", options=set())
    strip: StringProperty(
        name="Strip", description="Sound strip of the video sequencer", options=set()
    )
    sound_file: StringProperty(
        name="File", description="WAV, MP3, FLAC, OGG, M4A …", subtype="FILE_PATH", options=set()
    )
    start_frame: IntProperty(
        name="Start Frame",
        description="Frame at which the sound file begins",
        default=1,
        options=set(),
    )
    emotion_source: EnumProperty(
        name="Emotion",
        items=_EMOTION_SOURCES,
        default="GIVEN",
        options=set(),
        update=live.feel,
    )
    emotion: EnumProperty(
        name="Emotion",
        description="Can be animated",
        items=mixture.ITEMS,
        default="neutral",
        update=live.feel,
    )
    emotion_face: EnumProperty(
        name="Emotion",
        description="The emotion, as Draw Emotions has drawn it on this face",
        items=pictures.items,
        get=pictures.chosen,
        set=pictures.choose,
        options={"HIDDEN", "SKIP_SAVE"},
        # Without this the artist could not choose a picture on an override.
        override={"LIBRARY_OVERRIDABLE"},
    )
    intensity: FloatProperty(
        name="Intensity",
        description="How strongly the emotion shows; 1 is a full expression. Can be animated",
        default=1.0,
        min=0.0,
        max=MAX_INTENSITY,
        subtype="FACTOR",
        update=live.feel,
    )
    # The emotions after the first one, and the same as text for presets and takes.
    mixture: CollectionProperty(type=mixture.AnyfaceEmotion, options=set())
    mixed: StringProperty(get=mixture.text, set=mixture.fill, options={"HIDDEN", "SKIP_SAVE"})
    fps: FloatProperty(
        name="Frame Rate",
        description="Frames per second of the keys; 0 uses the scene's frame rate",
        default=0.0,
        min=0.0,
        max=240.0,
        options=set(),
    )
    mode: EnumProperty(name="Output", items=outputs.ITEMS, default=outputs.MODES[0], options=set())
    layered: BoolProperty(
        name="Emotion as a Layer",
        description="Put emotion and speech on separate keys. The keys of emotion act where the "
        "vertex group Emotion Mask is painted, and follow the slider of the emotion",
        default=True,
        options=set(),
    )
    starts_from_pose: BoolProperty(
        name="Start from Current Pose",
        description="The take begins with the pose of the shape keys in the current frame, such "
        "as the end of the shot before, and blends into its own motion within 0.4 s",
        default=False,
        options=set(),
    )
    error_mm: FloatProperty(
        name="Precision",
        description="How far any point may be from the full performance, in mm on a head of "
        "human size; finer takes more keys",
        default=0.1,
        min=0.005,
        max=5.0,
        precision=3,
        options=set(),
    )
    named_keys: BoolProperty(
        name="Named Keys",
        description="New keys follow jaw, lips, brows and lids and are named after them; off makes "
        "numbered keys, of which about half as many move in a frame, for long takes on heavy "
        "meshes",
        default=True,
        options=set(),
    )
    curves: EnumProperty(
        name="Curves",
        description="How many keyframes the curves of a take have",
        items=(
            ("SPARSE", "Sparse", "Few keyframes with handles, at extremes and where lips touch"),
            ("EVERY", "Every Frame", "A keyframe in every frame, linear in between"),
            ("HELD", "Held Poses", "Poses on twos, threes or fours, each held until the next"),
        ),
        default="SPARSE",
        options=set(),
    )
    curves_mm: FloatProperty(
        name="Tolerance",
        description="How far fewer keyframes may move any point, in mm on a head of human size; "
        "where lips touch a tenth of it",
        default=0.2,
        min=0.01,
        max=5.0,
        precision=2,
        options=set(),
    )
    pose_on: _frames("Change Every", "Poses change only on every Nth frame", 1)
    pose_closures: _frames("Closed Lips", "The fewest frames for which lips stay closed", 0)
    pose_vowels: _frames("Vowels", "The fewest frames for which a wide-open mouth stands", 0)
    axes: EnumProperty(
        name="Face Direction",
        description="Direction in which the head faces, for finding the face",
        items=_AXES,
        default="AUTO",
        options=set(),
    )
    landmark_file: StringProperty(
        name="Face Points",
        description="JSON file with 68 points of the face (iBUG order), as `anyface landmarks` "
        "writes it; empty finds them",
        subtype="FILE_PATH",
        options=set(),
    )
    report: StringProperty(name="Last Take", options={"HIDDEN"})
    report_is_error: BoolProperty(options={"HIDDEN"})
    # The last scene frame of the take as it was generated, 0 without a take.
    last_frame: IntProperty(options={"HIDDEN"})
    # Details of the report, which the panel shows only on request.
    report_details: StringProperty(options={"HIDDEN"})
    # How the lips meet in the last take, one of `core.take.MOUTHS`.
    mouth: StringProperty(options={"HIDDEN"})
    # What the lids of both eyes do in the last take, names of `core.take.LIDS`.
    lids: StringProperty(options={"HIDDEN"})
    # Names of the mends that the report offers, see `ui.mending`.
    report_mends: StringProperty(options={"HIDDEN"})


_OWN = dict(AnyfaceCharacter.__annotations__)
_OWN_OF_AUDIO = dict(audio.AnyfaceAudio.__annotations__)


class AnyfaceScene(PropertyGroup):
    """`Scene.anyface`: which character the panel shows, and which models are used."""

    # True once playback was set to follow the sound. From then on it is the artist's choice.
    synced: BoolProperty(options={"HIDDEN"})

    character: PointerProperty(
        name="Face",
        description="The face mesh; empty uses the active object",
        type=bpy.types.Object,
        poll=lambda _self, ob: ob.type == "MESH",
    )
    model_folder: StringProperty(
        name="Model Folder",
        description="Folder of your own models for this scene; empty uses the folder in the "
        "preferences, or the built-in models",
        subtype="DIR_PATH",
        options=set(),
    )
    # The text of each sound.
    texts: CollectionProperty(type=texts.AnyfaceText, options={"HIDDEN"})
    text: StringProperty(
        name="Text",
        description="The words that are spoken in the character's sound. The mouth then shows "
        "their sounds; empty shows what is heard",
        get=texts.get,
        set=texts.put,
        options=set(),
    )


def _of_library() -> dict:
    """The property that chooses the system, and one for each control and each word or number."""
    items = [
        (system.name, system.label, system.help.rstrip("."), number)
        for number, system in enumerate(systems.known())
    ]
    system_choice = (
        {"system": EnumProperty(name="System", items=items, options=set())} if items else {}
    )
    controls = {control.name: _of_control(control) for control in systems.controls()}
    plain = systems.plain_fields(systems.NUMBER, systems.TEXT, systems.FILE)
    return system_choice | controls | {field.name: _of_field(field) for field in plain}


def _recordings() -> dict:
    """A property for each recording that a system can use beside the speech."""
    return {field.name: _of_field(field) for field in systems.plain_fields(systems.SOUND)}


def _of_field(field: systems.Field):
    shared = {"name": field.label, "description": field.help.rstrip("."), "options": set()}
    if field.kind == systems.NUMBER:
        numbers = {"default": field.default, "min": field.low, "max": field.high}
        if not field.is_whole:
            return FloatProperty(**shared | numbers)
        # Blender's whole numbers have 32 bits.
        whole = {name: int(min(number, 2**31 - 1)) for name, number in numbers.items()}
        return IntProperty(**shared | whole)
    subtype = "FILE_PATH" if field.kind in systems.PATHS else "NONE"
    return StringProperty(subtype=subtype, **shared)


def _of_control(control: systems.Control):
    name, text = words.of_control(control)
    shared = {"name": name, "description": text}
    if not control.is_animatable:
        shared["options"] = set()
    if control.values == systems.CHOICE:
        items = [(name, name.capitalize(), "", at) for at, name in enumerate(control.choices)]
        return EnumProperty(items=items, default=control.choices[int(control.default)], **shared)
    shared |= {"default": control.default, "min": control.low, "max": control.high}
    if control.values == systems.WHOLE:
        whole = {name: int(shared[name]) for name in ("default", "min", "max")}
        return IntProperty(**shared | whole)
    if control.name.endswith("_s"):
        shared["unit"] = "TIME_ABSOLUTE"
    # A wide range shows no decimals, a narrow one up to three.
    span = control.high - control.low
    return FloatProperty(precision=0 if span > 10.0 else 2 if span > 0.5 else 3, **shared)


# The property groups of a character, by their names on objects.
_GROUPS = {
    "anyface_output": output_properties.GROUPS,
    "anyface": (mixture.AnyfaceEmotion, AnyfaceCharacter),
    "anyface_audio": audio.GROUPS,
    "anyface_controls": controls.GROUPS,
    "anyface_face": character.GROUPS,
    "anyface_life_settings": life.GROUPS,
    "anyface_mouth_chart": mouth_chart.GROUPS,
}


def register() -> None:
    """Adds the settings to objects and scenes."""
    identity.register()
    AnyfaceCharacter.__annotations__ = _OWN | _of_library()
    audio.AnyfaceAudio.__annotations__ = _OWN_OF_AUDIO | _recordings()
    for name, groups in _GROUPS.items():
        overridable.add(name, *groups)
    bpy.utils.register_class(texts.AnyfaceText)
    bpy.utils.register_class(AnyfaceScene)
    bpy.types.Scene.anyface = PointerProperty(type=AnyfaceScene)


def unregister() -> None:
    """Removes them; values stay in the file."""
    del bpy.types.Scene.anyface
    bpy.utils.unregister_class(AnyfaceScene)
    bpy.utils.unregister_class(texts.AnyfaceText)
    for name, groups in reversed(_GROUPS.items()):
        overridable.remove(name, *groups)
    identity.unregister()
