/*
 * Animates a head with the system "toy", its chin dropping by 20 mm, and prints the largest displacement.
 *
 *     toy HEAD.obj LANDMARKS.json VOICE.wav
 */
#include "../c_host/check.h"
#include "../c_host/text.h"

int main(int argc, char **argv) {
    CHECK(argc == 4);
    AnyfaceError *error = NULL;
    AnyfaceRequest *request = NULL;
    CHECK_OK(anyface_request_new(&request, &error));
    CHECK_OK(anyface_request_set_text(request, "system", "toy", &error));
    CHECK_OK(anyface_request_set_text(request, "cache", "off", &error));
    AnyfaceEngine *engine = NULL;
    CHECK_OK(anyface_engine_new(request, &engine, &error));
    AnyfaceMesh *mesh = NULL;
    AnyfaceAudio *audio = NULL;
    CHECK_OK(anyface_mesh_read(argv[1], &mesh, &error));
    CHECK_OK(anyface_audio_read(argv[3], &audio, &error));
    AnyfaceFace *face = NULL;
    CHECK_OK(anyface_request_set_text(request, "landmarks", read_text(argv[2]), &error));
    CHECK_OK(anyface_face_new(engine, mesh, request, NULL, &face, &error));
    CHECK_OK(anyface_request_set_number(request, "drop_mm", 20.0, &error));
    AnyfaceClip *clip = NULL;
    CHECK_OK(anyface_engine_animate(engine, face, audio, request, NULL, &clip, &error));
    anyface_request_free(request);
    printf("%.6g\n", (double)anyface_clip_largest_displacement(clip));
    anyface_clip_free(clip);
    anyface_face_free(face);
    anyface_audio_free(audio);
    anyface_mesh_free(mesh);
    anyface_engine_free(engine);
    return 0;
}
