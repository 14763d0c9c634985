"""Operators that work in a thread, under a stand-in for Blender's window."""

import time
from types import SimpleNamespace

import bpy
import pytest

import figures

TIMER = SimpleNamespace(type="TIMER", value="NOTHING")
ESCAPE = SimpleNamespace(type="ESC", value="PRESS")


class Work:
    """The work of the thread: it waits until `let_go` is true."""

    let_go = False

    def work(self, progress):
        """Waits, then returns 7."""
        while not self.let_go:
            progress.check("motion", 0.5)
            time.sleep(0.001)
        return 7


@pytest.fixture
def operator(addon, monkeypatch):
    """An operator that records what it writes and reports."""
    operators = addon("ui.operators")
    window = SimpleNamespace(app=SimpleNamespace(background=False), data=bpy.data)
    monkeypatch.setattr(operators, "bpy", window)

    class Operator(operators.InThread):
        bl_label = "Test"

        def __init__(self):
            self.messages, self.wrote, self.works = [], [], Work()

        def report(self, kind, text):
            self.messages.append((*kind, text))

        def read(self, context, ob):
            return self.works

        def finish(self, ob, read, worked):
            self.wrote.append((ob.name, worked))

    return Operator()


@pytest.fixture
def context():
    """A window manager that counts its timers."""
    return figures.window()


def test_the_result_is_written_once_the_thread_has_ended(addon, operator, context):
    assert operator.invoke(context, TIMER) == {"RUNNING_MODAL"}
    assert operator.modal(context, TIMER) == {"PASS_THROUGH"} and context.window_manager.timers == 1
    assert addon("ui.running").current_name == "Head" and not operator.wrote
    operator.works.let_go = True
    operator._job.result()
    assert operator.modal(context, TIMER) == {"FINISHED"} and operator.wrote == [("Head", 7)]
    assert context.window_manager.timers == 0 and not addon("ui.running").is_running()


def test_esc_ends_the_work_and_nothing_is_written(addon, operator, context):
    operator.invoke(context, TIMER)
    assert operator.modal(context, ESCAPE) == {"CANCELLED"} and not operator.wrote
    assert (
        operator.messages == [("INFO", "Anyface: cancelled")] and context.window_manager.timers == 0
    )
    assert not addon("ui.running").is_running()


def test_a_face_that_is_gone_meanwhile_is_named(operator, context):
    operator.invoke(context, TIMER)
    bpy.data.objects.remove(context.object)
    operator.works.let_go = True
    operator._job.result()
    assert operator.modal(context, TIMER) == {"CANCELLED"} and not operator.wrote
    assert operator.messages == [("ERROR", "Anyface: Head is gone")]


def test_a_face_that_is_renamed_while_the_thread_works_is_found(addon, operator, context):
    operator.invoke(context, TIMER)
    context.object.name = "Kopf"
    operator.works.let_go = True
    operator._job.result()
    assert operator.modal(context, TIMER) == {"FINISHED"} and operator.wrote == [("Kopf", 7)]


def test_an_undo_meanwhile_cancels_with_a_word(addon, operator, context):
    operator.invoke(context, TIMER)
    bpy.ops.ed.undo_push(message="before")
    context.object.location.x = 1.0
    bpy.ops.ed.undo_push(message="moved")
    bpy.ops.ed.undo()
    assert operator.modal(context, TIMER) == {"CANCELLED"} and not operator.wrote
    assert operator.messages == [("INFO", "Anyface: cancelled: something was undone meanwhile")]
