// The C interface as C++17 objects: owned handles and exceptions, in one header without a library
// of its own. Copy it into a program and change it as you like.
#pragma once

#include <anyface.h>

#include <cstddef>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace anyface {

/// A failed call: the message, and the status in `status`.
struct Error : std::runtime_error {
    AnyfaceStatus status;
    Error(AnyfaceStatus status, const char *message) : std::runtime_error(message), status(status) {}
};

/// A handle that frees itself.
template <typename T, void (*free_handle)(T *)> struct Free {
    void operator()(T *handle) const noexcept { free_handle(handle); }
};
using Engine = std::unique_ptr<AnyfaceEngine, Free<AnyfaceEngine, anyface_engine_free>>;
using Mesh = std::unique_ptr<AnyfaceMesh, Free<AnyfaceMesh, anyface_mesh_free>>;
using Audio = std::unique_ptr<AnyfaceAudio, Free<AnyfaceAudio, anyface_audio_free>>;
using Face = std::unique_ptr<AnyfaceFace, Free<AnyfaceFace, anyface_face_free>>;
using Motion = std::unique_ptr<AnyfaceMotion, Free<AnyfaceMotion, anyface_motion_free>>;
using Clip = std::unique_ptr<AnyfaceClip, Free<AnyfaceClip, anyface_clip_free>>;
using Request = std::unique_ptr<AnyfaceRequest, Free<AnyfaceRequest, anyface_request_free>>;
using Progress = std::unique_ptr<AnyfaceProgress, Free<AnyfaceProgress, anyface_progress_free>>;

/// Calls a function whose last parameter is the error; throws `Error` if it fails.
template <typename Function, typename... Arguments>
void call(Function function, Arguments... arguments) {
    AnyfaceError *error = nullptr;
    const AnyfaceStatus status = function(arguments..., &error);
    if (status == ANYFACE_STATUS_OK) {
        return;
    }
    const std::unique_ptr<AnyfaceError, Free<AnyfaceError, anyface_error_free>> owned(error);
    throw Error(status, anyface_error_message(owned.get()));
}

/// Calls a function that makes an object: its last parameters are `out` and the error.
template <typename Owner, typename Function, typename... Arguments>
Owner make(Function function, Arguments... arguments) {
    typename Owner::pointer out = nullptr;
    call(function, arguments..., &out);
    return Owner(out);
}

} // namespace anyface
