// A host with its own arrays and its own threads: hands over positions and triangles, runs the job
// on a worker thread, shows progress from the main thread, prints how far the lips open.
//
//     talk_cpp HEAD.obj VOICE.wav LANDMARKS.json|- [SECONDS]
//
// With SECONDS the job is cancelled after that time, as a user's Escape would.
// Build: c++ -std=c++17 talk.cpp $(pkg-config --cflags --libs anyface) -pthread -o talk_cpp
#include "anyface.hpp"

#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <future>
#include <iterator>
#include <string>
#include <thread>
#include <vector>

namespace {

using Clock = std::chrono::steady_clock;

/// What a host holds of a mesh.
struct Arrays {
    std::vector<float> positions;
    std::vector<std::uint32_t> triangles;
};

/// The library's reader stands in for the host's own scene.
Arrays read_scene(const char *path) {
    const auto mesh = anyface::make<anyface::Mesh>(anyface_mesh_read, path);
    Arrays arrays;
    arrays.positions.resize(3 * anyface_mesh_vertex_count(mesh.get()));
    arrays.triangles.resize(3 * anyface_mesh_triangle_count(mesh.get()));
    anyface::call(anyface_mesh_copy_positions, mesh.get(), arrays.positions.data(),
                  arrays.positions.size());
    anyface::call(anyface_mesh_copy_triangles, mesh.get(), arrays.triangles.data(),
                  arrays.triangles.size());
    return arrays;
}

std::string read_text(const std::string &path) {
    std::ifstream file(path, std::ios::binary);
    if (!file) {
        throw std::runtime_error(path + ": cannot be read");
    }
    return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

/// Everything that a worker thread does; the objects free themselves, also after an exception.
anyface::Clip perform(const AnyfaceEngine *engine, const Arrays &arrays, const char *voice,
                      const std::string &landmarks, const AnyfaceProgress *progress) {
    const auto mesh = anyface::make<anyface::Mesh>(
        anyface_mesh_new, arrays.positions.data(), arrays.positions.size() / 3,
        arrays.triangles.data(), arrays.triangles.size() / 3);
    const auto audio = anyface::make<anyface::Audio>(anyface_audio_read, voice);

    const auto request = anyface::make<anyface::Request>(anyface_request_new);
    anyface::call(anyface_request_set_text, request.get(), "landmarks", landmarks.c_str());
    const auto face = anyface::make<anyface::Face>(anyface_face_new, engine, mesh.get(),
                                                   request.get(), progress);

    // Emotion over time, in the order of the emotions of anyface_describe(): calm at first, surprised
    // after half a second.
    std::vector<double> rows(2 * ANYFACE_EMOTION_COUNT);
    rows[3] = 0.3;
    rows[ANYFACE_EMOTION_COUNT + 4] = 0.8;
    const double times_s[] = {0.0, 0.5};
    anyface::call(anyface_request_set_rows, request.get(), "emotion", times_s, rows.data(),
                  std::size_t{2}, ANYFACE_EMOTION_COUNT);
    anyface::call(anyface_request_set_number, request.get(), "fps", 25.0);
    return anyface::make<anyface::Clip>(anyface_engine_animate, engine, face.get(), audio.get(),
                                        request.get(), progress);
}

/// Between landmarks 62 and 66, the inner lips; mesh units.
std::vector<float> lip_gaps(const AnyfaceClip *clip) {
    constexpr std::size_t row = 3 * ANYFACE_LANDMARK_COUNT;
    std::vector<float> neutral(row);
    std::vector<float> moved(row * anyface_clip_frame_count(clip));
    anyface::call(anyface_clip_copy_landmarks_neutral, clip, neutral.data(), neutral.size());
    anyface::call(anyface_clip_copy_landmark_displacements, clip, moved.data(), moved.size());
    std::vector<float> gaps;
    for (std::size_t frame = 0; frame < moved.size(); frame += row) {
        float squared = 0.0F;
        for (std::size_t axis = 0; axis < 3; ++axis) {
            const std::size_t upper = 3 * 62 + axis;
            const std::size_t lower = 3 * 66 + axis;
            const float gap = neutral[upper] + moved[frame + upper] - neutral[lower] -
                              moved[frame + lower];
            squared += gap * gap;
        }
        gaps.push_back(std::sqrt(squared));
    }
    return gaps;
}

void report(const AnyfaceClip *clip) {
    // Lent: valid as long as the clip.
    const float *displacements = anyface_clip_displacements(clip);
    std::printf("frames %zu vertices %zu fps %g first %g\n", anyface_clip_frame_count(clip),
                anyface_clip_vertex_count(clip), anyface_clip_fps(clip),
                static_cast<double>(displacements[0]));
    for (const float gap : lip_gaps(clip)) {
        std::printf("%.6f\n", static_cast<double>(gap));
    }
}

int run(int argc, char **argv) {
    const auto engine = anyface::make<anyface::Engine>(
        anyface_engine_new, static_cast<const AnyfaceRequest *>(nullptr));
    const Arrays arrays = read_scene(argv[1]);
    const std::string landmarks = std::string(argv[3]) == "-" ? "" : read_text(argv[3]);
    const double limit_s = argc > 4 ? std::atof(argv[4]) : 1e9;

    const anyface::Progress progress(anyface_progress_new(nullptr, nullptr));
    auto job = std::async(std::launch::async, perform, engine.get(), std::cref(arrays), argv[2],
                          std::cref(landmarks), progress.get());
    const auto begun = Clock::now();
    while (job.wait_for(std::chrono::milliseconds(20)) != std::future_status::ready) {
        const char *stage = "";
        float fraction = 0.0F;
        anyface_progress_read(progress.get(), &stage, &fraction);
        std::fprintf(stderr, "\r%-10s %3.0f %%", stage, 100.0 * static_cast<double>(fraction));
        if (std::chrono::duration<double>(Clock::now() - begun).count() > limit_s) {
            anyface_progress_cancel(progress.get());
        }
    }
    report(job.get().get());
    return 0;
}

} // namespace

int main(int argc, char **argv) {
    if (argc < 4 || argc > 5) {
        std::fprintf(stderr, "usage: %s HEAD.obj VOICE.wav LANDMARKS.json|- [SECONDS]\n", argv[0]);
        return 2;
    }
    try {
        return run(argc, argv);
    } catch (const anyface::Error &error) {
        std::fprintf(stderr, "\n%s: %s\n", anyface_status_name(error.status), error.what());
        return static_cast<int>(error.status);
    } catch (const std::exception &error) {
        std::fprintf(stderr, "\n%s\n", error.what());
        return 1;
    }
}
