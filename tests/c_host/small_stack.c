/*
 * The whole way on threads of a host that have little stack: 256 KB, as some audio threads and fibers have.
 *
 *     small_stack HEAD.obj VOICE.wav
 */
#include "check.h"

#include <pthread.h>

enum { STACK_BYTES = 256 << 10 };

typedef struct {
    const char *system, *mesh, *voice;
} Files;

static void *talk(void *argument) {
    const Files *files = argument;
    AnyfaceError *error = NULL;
    AnyfaceRequest *request = NULL;
    CHECK_OK(anyface_request_new(&request, &error));
    CHECK_OK(anyface_request_set_text(request, "system", files->system, &error));
    AnyfaceEngine *engine = NULL;
    AnyfaceMesh *mesh = NULL;
    AnyfaceAudio *audio = NULL;
    AnyfaceFace *face = NULL;
    AnyfaceClip *clip = NULL;
    AnyfaceSounds *sounds = NULL;
    CHECK_OK(anyface_engine_new(request, &engine, &error));
    anyface_request_free(request);
    CHECK_OK(anyface_mesh_read(files->mesh, &mesh, &error));
    CHECK_OK(anyface_audio_read(files->voice, &audio, &error));
    CHECK_OK(anyface_face_new(engine, mesh, NULL, NULL, &face, &error));
    CHECK_OK(anyface_engine_animate(engine, face, audio, NULL, NULL, &clip, &error));
    CHECK(anyface_clip_largest_displacement(clip) > 0.0f);
    CHECK_OK(anyface_sounds_new_with_text(engine, audio, "Oh, a b!", &sounds, &error));
    anyface_sounds_free(sounds);
    anyface_clip_free(clip);
    anyface_face_free(face);
    anyface_audio_free(audio);
    anyface_mesh_free(mesh);
    anyface_engine_free(engine);
    return NULL;
}

int main(int argc, char **argv) {
    CHECK(argc == 3);
    pthread_attr_t little;
    CHECK(pthread_attr_init(&little) == 0);
    CHECK(pthread_attr_setstacksize(&little, STACK_BYTES) == 0);
    static const char *const systems[] = {"freetalk", "cafe-talk", "emoface", "facetalk"};
    for (size_t i = 0; i < sizeof systems / sizeof *systems; i++) {
        Files files = {systems[i], argv[1], argv[2]};
        pthread_t thread;
        CHECK(pthread_create(&thread, &little, talk, &files) == 0);
        CHECK(pthread_join(thread, NULL) == 0);
    }
    pthread_attr_destroy(&little);
    puts("ok");
    return 0;
}
