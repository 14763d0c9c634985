"""The C interface of the native library: its structs, a table of its functions, how to load it.

The table follows `include/anyface.h`; a test compares the two. ctypes releases Python's lock
during a call, so Blender's interface keeps running while a thread waits here.
"""

import ctypes
import os
import sys
from collections.abc import Callable
from ctypes import (
    POINTER,
    Structure,
    c_char_p,
    c_double,
    c_float,
    c_int32,
    c_size_t,
    c_uint32,
    c_uint64,
    c_void_p,
)
from itertools import count, takewhile
from pathlib import Path

from .errors import AnyfaceError

ABI_VERSION = 1


class EngineOptions(Structure):
    """`AnyfaceEngineOptions`."""

    _fields_ = [
        ("struct_size", c_size_t),
        ("weights_dir", c_char_p),
        ("speech_dir", c_char_p),
        ("cache_dir", c_char_p),
        ("cache", c_int32),
        ("threads", c_uint32),
        ("system", c_char_p),
        ("emotion_model_dir", c_char_p),
    ]


class FaceOptions(Structure):
    """`AnyfaceFaceOptions`."""

    _fields_ = [
        ("struct_size", c_size_t),
        ("landmark_positions", POINTER(c_float)),
        ("landmark_vertices", POINTER(c_uint32)),
        ("landmark_json", c_char_p),
        ("forward", c_int32),
        ("up", c_int32),
        ("request", c_void_p),
        ("part_numbers", POINTER(c_uint32)),
        ("part_roles", POINTER(c_int32)),
        ("part_count", c_size_t),
        ("fixed_numbers", POINTER(c_uint32)),
        ("fixed_positions", POINTER(c_float)),
        ("fixed_count", c_size_t),
        ("object_of_vertex", POINTER(c_uint32)),
        ("object_vertex_count", c_size_t),
        ("object_roles", POINTER(c_int32)),
        ("object_count", c_size_t),
    ]


class Event(Structure):
    """`AnyfaceEvent`."""

    _fields_ = [
        ("start_s", c_double),
        ("end_s", c_double),
        ("units", POINTER(c_char_p)),
        ("unit_count", c_size_t),
        ("strength", c_float),
        ("over_speech", c_int32),
    ]


_FLOATS, _INDICES = POINTER(c_float), POINTER(c_uint32)
_HANDLE, _OUT = c_void_p, POINTER(c_void_p)
# _OF_MESH is for functions that make something of a mesh: engine, mesh, options, progress, out,
# error.
_LIPS, _OUTS = (_INDICES, c_size_t), (_HANDLE, _OUT, _OUT)
_OF_MESH = [_HANDLE, _HANDLE, POINTER(FaceOptions), _HANDLE, _OUT, _OUT]

# Name: return type and argument types. Handles are untyped pointers.
SIGNATURES = {
    "anyface_abi_version": (c_uint32, []),
    "anyface_error_message": (c_char_p, [_HANDLE]),
    "anyface_system_name": (c_char_p, [c_size_t]),
    "anyface_describe": (c_char_p, [c_char_p]),
    "anyface_request_new": (c_int32, [_OUT, _OUT]),
    "anyface_request_set_text": (c_int32, [_HANDLE, c_char_p, c_char_p, _OUT]),
    "anyface_request_set_number": (c_int32, [_HANDLE, c_char_p, c_double, _OUT]),
    "anyface_request_set_rows": (
        c_int32,
        [_HANDLE, c_char_p, POINTER(c_double), POINTER(c_double), c_size_t, c_size_t, _OUT],
    ),
    "anyface_request_set_sound": (c_int32, [_HANDLE, c_char_p, _HANDLE, _OUT]),
    "anyface_request_set_motion": (c_int32, [_HANDLE, c_char_p, _HANDLE, _OUT]),
    "anyface_engine_options_init": (c_int32, [POINTER(EngineOptions), c_size_t]),
    "anyface_engine_new": (c_int32, [POINTER(EngineOptions), _OUT, _OUT]),
    "anyface_engine_memory_needed": (
        c_uint64,
        [_HANDLE, c_size_t, c_size_t, c_double],
    ),
    "anyface_memory_left": (c_uint64, []),
    "anyface_audio_new": (c_int32, [_FLOATS, c_size_t, c_uint32, c_uint32, _OUT, _OUT]),
    "anyface_audio_read": (c_int32, [c_char_p, _OUT, _OUT]),
    "anyface_audio_read_damaged": (c_int32, [c_char_p, _OUT, _OUT]),
    "anyface_audio_warning": (c_char_p, [_HANDLE]),
    "anyface_audio_sample_count": (c_size_t, [_HANDLE]),
    "anyface_audio_copy_samples": (c_int32, [_HANDLE, _FLOATS, c_size_t, _OUT]),
    "anyface_mesh_new": (c_int32, [_FLOATS, c_size_t, _INDICES, c_size_t, _OUT, _OUT]),
    "anyface_mesh_new_polygons": (
        c_int32,
        [_FLOATS, c_size_t, _INDICES, c_size_t, _INDICES, c_size_t, _OUT, _OUT],
    ),
    "anyface_mesh_read": (c_int32, [c_char_p, _OUT, _OUT]),
    "anyface_mesh_vertex_count": (c_size_t, [_HANDLE]),
    "anyface_mesh_triangle_count": (c_size_t, [_HANDLE]),
    "anyface_mesh_copy_positions": (c_int32, [_HANDLE, _FLOATS, c_size_t, _OUT]),
    "anyface_mesh_copy_triangles": (c_int32, [_HANDLE, _INDICES, c_size_t, _OUT]),
    "anyface_face_options_init": (c_int32, [POINTER(FaceOptions), c_size_t]),
    "anyface_face_new": (c_int32, _OF_MESH),
    "anyface_face_find": (c_int32, _OF_MESH),
    "anyface_face_mouth": (c_int32, [_HANDLE]),
    "anyface_face_lids": (c_int32, [_HANDLE, c_int32]),
    "anyface_face_metres_per_unit": (c_double, [_HANDLE]),
    "anyface_face_copy_landmarks": (c_int32, [_HANDLE, _FLOATS, _INDICES, _FLOATS, _OUT]),
    "anyface_face_copy_to_canonical": (c_int32, [_HANDLE, _FLOATS, c_size_t, _OUT]),
    "anyface_face_part_count": (c_size_t, [_HANDLE]),
    "anyface_face_copy_parts": (c_int32, [_HANDLE, POINTER(c_int32), _INDICES, _OUT]),
    "anyface_open_mouth": (c_int32, [_HANDLE, _HANDLE, _HANDLE, _OUT, _OUT]),
    "anyface_open_eyes": (c_int32, [_HANDLE, _HANDLE, _HANDLE, _OUT, _OUT]),
    "anyface_opened_face_mesh": (c_int32, [_HANDLE, _OUT, _OUT]),
    "anyface_opened_face_first_lining_triangle": (c_size_t, [_HANDLE]),
    "anyface_opened_face_first_inside_triangle": (c_size_t, [_HANDLE]),
    "anyface_opened_face_copy_landmarks": (c_int32, [_HANDLE, _FLOATS, _INDICES, _OUT]),
    "anyface_opened_face_copy_vertex_sources": (
        c_int32,
        [_HANDLE, _INDICES, _FLOATS, c_size_t, _OUT],
    ),
    "anyface_opened_face_copy_triangle_sources": (
        c_int32,
        [_HANDLE, _INDICES, c_size_t, _FLOATS, c_size_t, _OUT],
    ),
    "anyface_expression_new": (c_int32, [c_char_p, c_char_p, _OUT, _OUT]),
    "anyface_expression_unit_count": (c_size_t, [_HANDLE]),
    "anyface_expression_unit": (c_char_p, [_HANDLE, c_size_t]),
    "anyface_expression_strength": (c_float, [_HANDLE]),
    "anyface_expression_over_speech": (c_int32, [_HANDLE]),
    "anyface_expression_said": (c_char_p, [_HANDLE]),
    "anyface_expression_hint": (c_char_p, [_HANDLE]),
    "anyface_events_new": (c_int32, [POINTER(Event), c_size_t, _OUT, _OUT]),
    "anyface_events_parse": (c_int32, [c_char_p, c_char_p, _OUT, _OUT]),
    "anyface_events_from_text": (c_int32, [c_char_p, c_char_p, _OUT, _OUT]),
    "anyface_events_json": (c_char_p, [_HANDLE]),
    "anyface_event_notes_new": (c_int32, [_HANDLE, _HANDLE, _HANDLE, _HANDLE, _OUT, _OUT]),
    "anyface_event_notes_count": (c_size_t, [_HANDLE]),
    "anyface_event_notes_text": (c_char_p, [_HANDLE, c_size_t]),
    "anyface_motion_new": (
        c_int32,
        [_HANDLE, _HANDLE, _HANDLE, _HANDLE, _OUT, _OUT],
    ),
    "anyface_motion_new_content": (c_int32, [_HANDLE, _HANDLE, _HANDLE, _OUT, _OUT]),
    "anyface_motion_new_displacements": (c_int32, [_FLOATS, c_size_t, c_double, _OUT, _OUT]),
    "anyface_motion_new_frames": (c_int32, [_HANDLE, c_size_t, c_size_t, _OUT, _OUT]),
    "anyface_motion_new_pose": (c_int32, [_HANDLE, _FLOATS, c_size_t, _OUT, _OUT]),
    "anyface_motion_frame_count": (c_size_t, [_HANDLE]),
    "anyface_motion_weight_count": (c_size_t, [_HANDLE]),
    "anyface_motion_weight_name": (c_char_p, [_HANDLE, c_size_t]),
    "anyface_motion_copy_weights": (c_int32, [_HANDLE, _FLOATS, c_size_t, _OUT]),
    "anyface_motion_copy_mask": (
        c_int32,
        [_HANDLE, _HANDLE, _HANDLE, c_size_t, _FLOATS, c_size_t, _OUT],
    ),
    "anyface_motion_heard_emotion": (c_char_p, [_HANDLE]),
    "anyface_motion_copy_head": (c_int32, [_HANDLE, _FLOATS, c_size_t, _OUT]),
    "anyface_motion_copy_gaze": (c_int32, [_HANDLE, _FLOATS, c_size_t, _OUT]),
    "anyface_motion_copy_tongue": (c_int32, [_HANDLE, _FLOATS, c_size_t, _OUT]),
    "anyface_clip_new": (c_int32, [_HANDLE, _HANDLE, _HANDLE, _HANDLE, _OUT, _OUT]),
    "anyface_clip_frame_count": (c_size_t, [_HANDLE]),
    "anyface_clip_copy_frame": (c_int32, [_HANDLE, c_size_t, _FLOATS, c_size_t, _OUT]),
    "anyface_clip_copy_displacements": (c_int32, [_HANDLE, _FLOATS, c_size_t, _OUT]),
    "anyface_clip_copy_landmarks_neutral": (c_int32, [_HANDLE, _FLOATS, c_size_t, _OUT]),
    "anyface_clip_copy_landmark_displacements": (c_int32, [_HANDLE, _FLOATS, c_size_t, _OUT]),
    "anyface_clip_largest_displacement": (c_float, [_HANDLE]),
    "anyface_clip_visibility": (c_int32, [_HANDLE]),
    "anyface_clip_new_difference": (c_int32, [_HANDLE, _HANDLE, _OUT, _OUT]),
    "anyface_basis_new": (
        c_int32,
        [_HANDLE, _HANDLE, c_float, c_size_t, _HANDLE, _OUT, _OUT],
    ),
    "anyface_basis_shape_count": (c_size_t, [_HANDLE]),
    "anyface_basis_max_error": (c_float, [_HANDLE]),
    "anyface_basis_copy_shapes": (c_int32, [_HANDLE, _FLOATS, c_size_t, _OUT]),
    "anyface_basis_copy_weights": (c_int32, [_HANDLE, _FLOATS, c_size_t, _OUT]),
    "anyface_curves_new": (
        c_int32,
        [
            _FLOATS,
            c_size_t,
            c_size_t,
            _FLOATS,
            c_size_t,
            c_float,
            c_void_p,
            _HANDLE,
            _OUT,
            _OUT,
        ],
    ),
    "anyface_curves_new_each": (
        c_int32,
        [_FLOATS, c_size_t, c_size_t, _FLOATS, c_void_p, _OUT, _OUT],
    ),
    "anyface_curves_key_count": (c_size_t, [_HANDLE, c_size_t]),
    "anyface_curves_copy_keys": (
        c_int32,
        [_HANDLE, c_size_t, POINTER(c_uint32), _FLOATS, c_size_t, _OUT],
    ),
    "anyface_progress_new": (_HANDLE, [c_void_p, c_void_p]),
    "anyface_progress_read": (c_int32, [_HANDLE, POINTER(c_char_p), _FLOATS]),
    "anyface_progress_cancel": (None, [_HANDLE]),
    "anyface_rig_new": (c_int32, _OF_MESH),
    "anyface_rig_new_by_field": (c_int32, [*_OF_MESH[:3], c_int32, *_OF_MESH[3:]]),
    "anyface_clip_write_shapes": (c_int32, [_HANDLE, _HANDLE, c_char_p, _OUT]),
    "anyface_rig_write": (c_int32, [_HANDLE, c_char_p, c_char_p, _OUT]),
    "anyface_rig_shape_count": (c_size_t, [_HANDLE]),
    "anyface_rig_shape_name": (c_char_p, [_HANDLE, c_size_t]),
    "anyface_rig_shape_note": (c_char_p, [_HANDLE, c_size_t]),
    "anyface_rig_copy_shape": (c_int32, [_HANDLE, c_size_t, _FLOATS, c_size_t, _OUT]),
    "anyface_weights_new": (
        c_int32,
        [POINTER(c_char_p), _FLOATS, c_size_t, _FLOATS, c_size_t, c_size_t, *_LIPS, *_OUTS],
    ),
    "anyface_weights_new_of_clip": (
        c_int32,
        [_HANDLE, POINTER(c_char_p), _FLOATS, c_size_t, c_size_t, _FLOATS, *_LIPS, *_OUTS],
    ),
    "anyface_weights_new_from_array": (
        c_int32,
        [POINTER(c_char_p), _FLOATS, c_size_t, c_size_t, _OUT, _OUT],
    ),
    "anyface_weights_copy": (c_int32, [_HANDLE, _FLOATS, c_size_t, _OUT]),
    "anyface_weights_left_out": (c_float, [_HANDLE]),
    "anyface_weights_write": (c_int32, [_HANDLE, c_char_p, c_double, _OUT]),
    "anyface_sounds_new": (c_int32, [_HANDLE, _HANDLE, _OUT, _OUT]),
    "anyface_sounds_new_with_text": (c_int32, [_HANDLE, _HANDLE, c_char_p, _OUT, _OUT]),
    "anyface_sounds_new_chart": (
        c_int32,
        [_HANDLE, _HANDLE, c_int32, c_size_t, c_size_t, c_size_t, c_size_t, _OUT, _OUT],
    ),
    "anyface_sounds_interval_count": (c_size_t, [_HANDLE, c_int32]),
    "anyface_sounds_label": (c_char_p, [_HANDLE, c_int32, c_size_t]),
    "anyface_sounds_copy_intervals": (
        c_int32,
        [_HANDLE, c_int32, POINTER(c_double), c_size_t, _OUT],
    ),
    "anyface_sounds_read": (c_int32, [c_char_p, c_double, _OUT, _OUT]),
    "anyface_sounds_write": (c_int32, [_HANDLE, c_char_p, c_double, _OUT]),
    "anyface_sounds_closure_count": (c_size_t, [_HANDLE]),
    "anyface_sounds_copy_closures": (c_int32, [_HANDLE, POINTER(c_double), c_size_t, _OUT]),
    "anyface_sounds_label_closes_lips": (c_int32, [c_char_p]),
    "anyface_sliders_new": (
        c_int32,
        [_HANDLE, _HANDLE, _HANDLE, _HANDLE, _HANDLE, _HANDLE, _OUT, _OUT],
    ),
    "anyface_sliders_knot_count": (c_size_t, [_HANDLE, c_int32]),
    "anyface_sliders_copy_knots": (c_int32, [_HANDLE, c_int32, _FLOATS, c_size_t, _OUT]),
    "anyface_sliders_copy_changes": (c_int32, [_HANDLE, c_int32, _FLOATS, c_size_t, _OUT]),
    "anyface_head_new": (c_int32, [c_char_p, _FLOATS, c_size_t, c_uint64, _OUT, _OUT]),
    "anyface_head_new_mixed": (c_int32, [_HANDLE, _HANDLE, c_float, _OUT, _OUT]),
    "anyface_head_new_along": (c_int32, [_HANDLE, c_size_t, c_float, _OUT, _OUT]),
    "anyface_head_face_count": (c_size_t, [_HANDLE]),
    "anyface_head_skin_face_count": (c_size_t, [_HANDLE]),
    "anyface_head_copy_faces": (c_int32, [_HANDLE, _INDICES, c_size_t, _OUT]),
    "anyface_head_copy_uv": (c_int32, [_HANDLE, _FLOATS, c_size_t, _OUT]),
    "anyface_head_copy_face_materials": (c_int32, [_HANDLE, _INDICES, c_size_t, _OUT]),
    "anyface_head_material_count": (c_size_t, [_HANDLE]),
    "anyface_head_material_name": (c_char_p, [_HANDLE, c_size_t]),
    "anyface_head_direction_count": (c_size_t, [_HANDLE]),
    "anyface_head_direction_name": (c_char_p, [_HANDLE, c_size_t]),
    "anyface_head_copy_directions": (c_int32, [_HANDLE, _FLOATS, c_size_t, _OUT]),
    "anyface_head_mesh": (
        c_int32,
        [_HANDLE, c_size_t, c_int32, _HANDLE, _OUT, POINTER(c_size_t), _INDICES, _OUT],
    ),
    "anyface_head_fit": (c_int32, [c_char_p, _HANDLE, _HANDLE, _OUT, _OUT]),
    "anyface_head_fit_mm": (c_float, [_HANDLE]),
    "anyface_stream_new": (c_int32, [_HANDLE, _OUT, _OUT]),
    "anyface_stream_push": (c_int32, [_HANDLE, _FLOATS, c_size_t, _OUT]),
    "anyface_stream_pull": (c_int32, [_HANDLE, _FLOATS, c_size_t, POINTER(c_size_t), _OUT]),
    "anyface_stream_finish": (c_int32, [_HANDLE, _OUT]),
    "anyface_stream_look_ahead": (c_int32, [_HANDLE, c_double, _OUT]),
    "anyface_stream_hear_all": (c_int32, [_HANDLE, _OUT]),
    "anyface_stream_set_emotion": (c_int32, [_HANDLE, _FLOATS, _OUT]),
    "anyface_stream_latency_s": (c_double, [_HANDLE]),
    "anyface_weight_stream_new": (c_int32, [_HANDLE, _OUT, _OUT]),
    "anyface_weight_stream_name": (c_char_p, [c_size_t]),
    "anyface_weight_stream_push": (c_int32, [_HANDLE, _FLOATS, c_size_t, _OUT]),
    "anyface_weight_stream_pull": (
        c_int32,
        [_HANDLE, _FLOATS, _FLOATS, _FLOATS, POINTER(c_int32), _OUT],
    ),
    "anyface_weight_stream_finish": (c_int32, [_HANDLE, _OUT]),
    "anyface_weight_stream_set_emotion": (c_int32, [_HANDLE, _FLOATS, _OUT]),
    "anyface_weight_stream_hear_emotion": (c_int32, [_HANDLE, _OUT]),
    "anyface_weight_stream_hear_all": (c_int32, [_HANDLE, _OUT]),
    "anyface_weight_stream_look_ahead": (c_int32, [_HANDLE, c_double, _OUT]),
    "anyface_weight_stream_latency_s": (c_double, [_HANDLE]),
}

_FREED = (
    "audio", "basis", "clip", "curves", "engine", "error", "event_notes", "events", "expression",
    "face", "head", "mesh", "motion", "opened_face", "progress", "request", "rig", "sliders",
    "sounds", "stream", "weight_stream", "weights",
)  # fmt: skip
SIGNATURES |= {f"anyface_{noun}_free": (None, [_HANDLE]) for noun in _FREED}


def library_path() -> Path:
    """The library in `lib` beside this folder; `ANYFACE_LIBRARY` names another one."""
    variable = os.environ.get("ANYFACE_LIBRARY")
    names = {"win32": "anyface.dll", "darwin": "libanyface.dylib"}
    name = names.get(sys.platform, "libanyface.so")
    return Path(variable) if variable else Path(__file__).resolve().parents[1] / "lib" / name


def load(path: Path) -> ctypes.CDLL:
    """Loads the library and declares its functions; raises `AnyfaceError("weights")`."""
    try:
        library = ctypes.CDLL(str(path))
        for name, (result, arguments) in SIGNATURES.items():
            function = getattr(library, name)
            function.restype, function.argtypes = result, arguments
    except (OSError, AttributeError) as error:
        raise AnyfaceError("weights", f"the native library cannot be used: {error}") from error
    version = library.anyface_abi_version()
    if version != ABI_VERSION:
        raise AnyfaceError(
            "weights", f"{path}: expected interface {ABI_VERSION}, got {version}: install it again"
        )
    return library


def texts(function: Callable[[int], bytes | None]) -> list[str]:
    """The texts that a function of the library returns for 0, 1, 2, …, until it returns none."""
    entries = takewhile(lambda text: text is not None, map(function, count()))
    return [text.decode() for text in entries]
