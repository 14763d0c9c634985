"""Events in a real window: strips above the voice, a marker, and how the panel understands them.

The pictures go to the folder `ANYFACE_PHOTOGRAPHS`.
"""

from screen import WITHOUT_PROPERTIES
from test_heads import voice  # noqa: F401 - a fixture
from test_window import MORE, REDRAW, TAB, photographs, screen  # noqa: F401 - fixtures
from test_window_page import OPEN, SEQUENCER, VIEW_ALL

HEAD = "bpy.data.objects['Head']"
LENGTH = 16
# Frame and expression of each event.
WANTED = ((14, "smile"), (36, "wink"), (57, "sarcastic laugh"))
ADD = """
bpy.context.scene.frame_set({frame})
window, area, region, _ = area_of('VIEW_3D')
with bpy.context.temp_override(window=window, area=area, region=region):
    bpy.ops.anyface.event_add(expression={expression!r})
answer = {head}.anyface_audio.event_channel
"""
MARKER = f"""
bpy.context.scene.timeline_markers.new('brow raise:0.5', frame=4)
{HEAD}.anyface_audio.event_markers = True
"""
TEXTS = "[s for s in bpy.context.scene.sequence_editor.sequences_all if s.type == 'TEXT']"
PLACES = f"answer = [(s.text, s.frame_final_start, s.frame_final_end) for s in {TEXTS}]"


def test_events_stand_above_the_voice_and_esc_leaves_them(screen, photographs):  # noqa: F811
    screen.ask(f"{HEAD}.anyface.system = 'cafe-talk'\n{MORE.format(True)}\n{REDRAW}")
    # The names of markers cover the lowest channel, so the voice moves up.
    screen.ask("bpy.context.scene.sequence_editor.sequences_all[0].channel = 2")
    channels = {
        screen.ask(ADD.format(frame=frame, expression=expression, head=HEAD))
        for frame, expression in WANTED
    }
    assert len(channels) == 1
    (channel,) = channels
    wrong = "the blue car"
    screen.ask(
        f"for strip in {TEXTS}:\n"
        f"    strip.frame_final_end = strip.frame_final_start + {LENGTH}\n"
        "strips = bpy.context.scene.sequence_editor.sequences\n"
        f"made = strips.new_effect(name='Car', type='TEXT', channel={channel}, frame_start=77, "
        f"frame_end=86)\nmade.text, made.mute = {wrong!r}, True\n"
    )
    screen.ask(MARKER)
    screen.ask(OPEN.format(labels=("Events",), suffix="_e") + REDRAW)
    screen.hand("sleep", "0.7")
    screen.ask(SEQUENCER)
    screen.hand("sleep", "0.5")
    screen.ask(VIEW_ALL)
    screen.ask(TAB + "\n" + REDRAW)
    screen.hand("sleep", "0.5")
    # Esc during the run leaves strips and keys as they were.
    before = screen.ask(PLACES)
    screen.press("anyface.generate")
    screen.hand("mousemove", "400", "300", "key", "Escape")
    screen.wait("not running()")
    assert not screen.ask("answer = keys()")
    now = screen.ask(PLACES)
    assert now == before
    screen.press("anyface.generate")
    screen.wait("keys() and not running()")
    report = screen.ask(f"answer = {HEAD}.anyface.report")
    assert "the event Car was left out" in report and wrong in report
    assert "brow raise" not in report
    screen.ask("bpy.context.scene.frame_set(46)")
    screen.scroll(5)
    screen.hand("sleep", "1.5")
    screen.photograph(photographs / "pages/events.png", WITHOUT_PROPERTIES)
