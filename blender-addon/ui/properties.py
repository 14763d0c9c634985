"""The settings of a character, stored on its object and animatable where that makes sense."""

import bpy
from bpy.props import (
    BoolProperty,
    EnumProperty,
    FloatProperty,
    IntProperty,
    PointerProperty,
    StringProperty,
)
from bpy.types import PropertyGroup

from ..core.emotion import EMOTIONS, MAX_INTENSITY
from ..core.take import Controls
from ..scene import outputs
from . import audio, character, output_properties

_EMOTION_ITEMS = [(name, name.capitalize(), "", number) for number, name in enumerate(EMOTIONS)]
_SOURCES = [
    ("STRIP", "Strip", "A sound strip of the video sequencer, with its trim and place", 0),
    ("FILE", "File", "A sound file", 1),
    ("CHANNEL", "Channel", "All sound strips of a channel of the sequencer, as one take", 2),
    ("CHOSEN", "Several", "The strips that you chose, as one take", 3),
]
_EMOTION_SOURCES = [
    ("GIVEN", "Panel", "The emotion and intensity below", 0),
    ("VOICE", "Voice", "How aroused the voice sounds; not whether it is glad or angry", 1),
    ("OFF", "Off", "Speech alone: no emotion, no blinks, no motion of brows and lids", 2),
]
_DEFAULTS = Controls()
_AXES = [
    (
        "AUTO",
        "Automatic",
        "Wherever it looks; the others decide where several places look like faces",
        0,
    ),
    ("WORLD", "World", "The head faces -Y in the world", 1),
    ("LOCAL", "Local", "The head faces -Y in its own space", 2),
    ("LOCAL_Y_UP", "Local, Y Up", "The head faces +Z with +Y up in its own space", 3),
]


class AnyfaceCharacter(PropertyGroup):
    """Settings of one character; `Object.anyface`."""

    source: EnumProperty(name="Sound", items=_SOURCES, default="STRIP", options=set())
    strip: StringProperty(
        name="Strip", description="Sound strip of the video sequencer", options=set()
    )
    sound_file: StringProperty(
        name="File", description="WAV, MP3, FLAC, OGG, M4A …", subtype="FILE_PATH", options=set()
    )
    start_frame: IntProperty(
        name="Start", description="Frame at which the sound file begins", default=1, options=set()
    )
    emotion_source: EnumProperty(
        name="Emotion from", items=_EMOTION_SOURCES, default="GIVEN", options=set()
    )
    emotion: EnumProperty(
        name="Emotion", description="Can be animated", items=_EMOTION_ITEMS, default="neutral"
    )
    intensity: FloatProperty(
        name="Intensity",
        description="How strongly the emotion shows; 1 is a full expression. Can be animated",
        default=1.0,
        min=0.0,
        max=MAX_INTENSITY,
        subtype="FACTOR",
    )
    articulation: FloatProperty(
        name="Articulation",
        description="Strength of what speech does to mouth and jaw; closed lips stay closed. "
        "Can be animated",
        default=_DEFAULTS.articulation,
        min=0.0,
        max=2.0,
    )
    jaw_lips: FloatProperty(
        name="Lips to Jaw",
        description="-1 moves motion from the jaw to the lips, 1 from the lips to the jaw",
        default=_DEFAULTS.jaw_lips,
        min=-1.0,
        max=1.0,
    )
    smoothing_s: FloatProperty(
        name="Smoothing",
        description="In seconds; closed lips stay closed",
        default=_DEFAULTS.smoothing_s,
        min=0.0,
        max=0.1,
        precision=3,
        options=set(),
    )
    upper_face: FloatProperty(
        name="Upper Face",
        description="Strength of brows, lids and the bridge of the nose; blinks stay",
        default=_DEFAULTS.upper_face,
        min=0.0,
        max=2.0,
    )
    blinks_per_minute: FloatProperty(
        name="Blinks per Minute",
        default=_DEFAULTS.blinks_per_minute,
        min=0.0,
        max=60.0,
        precision=0,
        options=set(),
    )
    brow_accents: FloatProperty(
        name="Brow Accents",
        description="Strength of the raises of the brows on stressed syllables",
        default=_DEFAULTS.brow_accents,
        min=0.0,
        max=2.0,
    )
    asymmetry: FloatProperty(
        name="Asymmetry",
        description="More motion of brows and mouth corners on the right (-1) or left (1) side",
        default=_DEFAULTS.asymmetry,
        min=-1.0,
        max=1.0,
    )
    style: StringProperty(
        name="Style", description="Speaking style by name; empty takes the default", options=set()
    )
    seed: IntProperty(
        name="Seed", description="Another seed, another take", default=0, min=0, options=set()
    )
    fps: FloatProperty(
        name="Frame Rate",
        description="Frames per second of the keys; 0 takes that of the scene",
        default=0.0,
        min=0.0,
        max=240.0,
        options=set(),
    )
    steps: IntProperty(
        name="Steps",
        description="Denoising steps; 0 takes the model's default",
        default=0,
        min=0,
        max=1000,
        options=set(),
    )
    learned: FloatProperty(
        name="Learned Detail",
        description="Strength of the learned correction; 0 spreads motion by geometry alone",
        default=1.0,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        options=set(),
    )
    mode: EnumProperty(name="Output", items=outputs.ITEMS, default=outputs.MODES[0], options=set())
    error_mm: FloatProperty(
        name="Largest Error",
        description="Basis keys: largest error of any vertex in any frame, in mm on a head of "
        "human size; the number of keys follows from it",
        default=0.1,
        min=0.005,
        max=5.0,
        precision=3,
        options=set(),
    )
    axes: EnumProperty(
        name="Face Direction",
        description="How the head looks when the face is searched",
        items=_AXES,
        default="AUTO",
        options=set(),
    )
    landmark_file: StringProperty(
        name="Landmarks",
        description="JSON file with the 68 landmarks, as `anyface landmarks` writes it; empty "
        "finds them",
        subtype="FILE_PATH",
        options=set(),
    )
    report: StringProperty(name="Last Take", options={"HIDDEN"})
    report_is_error: BoolProperty(options={"HIDDEN"})


class AnyfaceScene(PropertyGroup):
    """`Scene.anyface`: which character the panel shows."""

    character: PointerProperty(
        name="Face",
        description="The face mesh; empty takes the active object",
        type=bpy.types.Object,
        poll=lambda _self, ob: ob.type == "MESH",
    )


def register_character() -> None:
    """Adds the settings of a character to objects."""
    output_properties.register()
    bpy.utils.register_class(AnyfaceCharacter)
    bpy.types.Object.anyface = PointerProperty(type=AnyfaceCharacter)
    audio.register()
    character.register()


def register() -> None:
    """Adds the settings to objects and scenes."""
    register_character()
    bpy.utils.register_class(AnyfaceScene)
    bpy.types.Scene.anyface = PointerProperty(type=AnyfaceScene)


def unregister() -> None:
    """Takes them away; values stay in the file."""
    character.unregister()
    audio.unregister()
    del bpy.types.Scene.anyface
    del bpy.types.Object.anyface
    bpy.utils.unregister_class(AnyfaceScene)
    bpy.utils.unregister_class(AnyfaceCharacter)
    output_properties.unregister()
