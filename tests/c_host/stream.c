/*
 * Motion while somebody is speaking: the same bits however the sound is cut, also by streams of one
 * engine in several threads, and clear refusals.
 *
 *     stream VOICE.wav
 */
#include "check.h"

#include <math.h>
#include <pthread.h>

#define FLOATS (3 * ANYFACE_LANDMARK_COUNT)

static _Thread_local AnyfaceError *error = NULL;

/* Pushes the sound in pieces, pulls after each, and returns all frames; the caller frees them. */
static float *perform(const AnyfaceEngine *engine, const float *samples, size_t count, size_t piece,
                      const char *emotion, size_t *frames) {
    AnyfaceStream *stream = NULL;
    AnyfaceRequest *request = NULL;
    size_t room = count / 640 + 1, written = 0;
    float *moved = malloc(room * FLOATS * sizeof *moved);
    CHECK(moved != NULL);
    *frames = 0;
    CHECK_OK(anyface_stream_new(engine, &stream, &error));
    CHECK_OK(anyface_request_new(&request, &error));
    CHECK_OK(anyface_request_set_number(request, "hear_all", 1.0, &error));
    CHECK_OK(anyface_request_set_text(request, "emotion", emotion, &error));
    CHECK_OK(anyface_stream_obey(stream, request, &error));
    anyface_request_free(request);
    CHECK(anyface_stream_latency_s(stream) > 0.0 && anyface_stream_latency_s(stream) <= 0.2);
    for (size_t from = 0; from < count; from += piece) {
        size_t now = piece < count - from ? piece : count - from;
        CHECK_OK(anyface_stream_push(stream, samples + from, now, &error));
        CHECK_OK(anyface_stream_pull(stream, moved + *frames * FLOATS, room - *frames, &written,
                                     &error));
        *frames += written;
    }
    CHECK_OK(anyface_stream_finish(stream, &error));
    CHECK_OK(anyface_stream_pull(stream, moved + *frames * FLOATS, room - *frames, &written, &error));
    *frames += written;
    anyface_stream_free(stream);
    return moved;
}

/* A stream that waits for no sound gives the frame of the first 40 ms as soon as they are there. */
static void sooner(const AnyfaceEngine *engine, const float *samples) {
    AnyfaceStream *stream = NULL;
    float frame[FLOATS];
    size_t written = 0;
    CHECK_OK(anyface_stream_new(engine, &stream, &error));
    AnyfaceRequest *request = NULL;
    CHECK_OK(anyface_request_new(&request, &error));
    CHECK_OK(anyface_request_set_number(request, "look_ahead_s", -1.0, &error));
    CHECK_FAILS(anyface_stream_obey(stream, request, &error), ANYFACE_STATUS_INVALID_INPUT,
                "look-ahead");
    CHECK_OK(anyface_request_set_number(request, "look_ahead_s", 0.0, &error));
    CHECK_OK(anyface_stream_obey(stream, request, &error));
    CHECK(anyface_stream_latency_s(stream) == 0.0);
    CHECK_OK(anyface_stream_push(stream, samples, 640, &error));
    CHECK_OK(anyface_stream_pull(stream, frame, 1, &written, &error));
    CHECK(written == 1);
    /* The same look-ahead, with another emotion, may be asked for at any time. */
    CHECK_OK(anyface_request_set_text(request, "emotion", "sad", &error));
    CHECK_OK(anyface_stream_obey(stream, request, &error));
    CHECK_OK(anyface_request_set_number(request, "look_ahead_s", 0.07, &error));
    CHECK_FAILS(anyface_stream_obey(stream, request, &error), ANYFACE_STATUS_INVALID_INPUT, "");
    anyface_request_free(request);
    anyface_stream_free(stream);
}

/* A stream of one thread: the sound, how it is cut, and the motion. */
typedef struct {
    const AnyfaceEngine *engine;
    const float *samples;
    size_t count, piece, frames;
    float *moved;
} Cut;

static void *perform_cut(void *argument) {
    Cut *cut = argument;
    cut->moved = perform(cut->engine, cut->samples, cut->count, cut->piece, "", &cut->frames);
    return NULL;
}

static void any_cut(const AnyfaceEngine *engine, const float *samples, size_t count) {
    size_t pieces[] = {count, 1600, 160, 37}, frames[4];
    float *moved[4];
    Cut cuts[4];
    pthread_t threads[4];
    for (int i = 0; i < 4; i++) {
        cuts[i] = (Cut){engine, samples, count, pieces[i], 0, NULL};
        CHECK(pthread_create(&threads[i], NULL, perform_cut, &cuts[i]) == 0);
    }
    for (int i = 0; i < 4; i++) {
        CHECK(pthread_join(threads[i], NULL) == 0);
        moved[i] = cuts[i].moved;
        frames[i] = cuts[i].frames;
    }
    for (int i = 0; i < 4; i++) {
        CHECK(frames[i] == (count + 639) / 640 && frames[i] == frames[0]);
        CHECK(memcmp(moved[i], moved[0], frames[0] * FLOATS * sizeof(float)) == 0);
    }
    size_t happy_frames;
    float *smile = perform(engine, samples, count, count, "happy:1", &happy_frames);
    CHECK(memcmp(smile, moved[0], frames[0] * FLOATS * sizeof(float)) != 0);
    free(smile);
    for (int i = 0; i < 4; i++) {
        free(moved[i]);
    }
}

static void refusals(const AnyfaceEngine *engine) {
    AnyfaceStream *stream = NULL;
    AnyfaceRequest *request = NULL;
    float broken[] = {0.0f, NAN}, frame[FLOATS];
    size_t written = 99;
    CHECK_FAILS(anyface_stream_new(NULL, &stream, &error), ANYFACE_STATUS_NULL_POINTER, "engine");
    CHECK_OK(anyface_stream_new(engine, &stream, &error));
    CHECK_FAILS(anyface_stream_push(stream, broken, 2, &error), ANYFACE_STATUS_AUDIO, "first at 1");
    CHECK_FAILS(anyface_stream_push(stream, NULL, 2, &error), ANYFACE_STATUS_NULL_POINTER,
                "samples");
    CHECK_OK(anyface_stream_push(stream, NULL, 0, &error));
    CHECK_OK(anyface_request_new(&request, &error));
    CHECK_OK(anyface_request_set_text(request, "emotion", "auto", &error));
    CHECK_FAILS(anyface_stream_obey(stream, request, &error), ANYFACE_STATUS_INVALID_INPUT, "auto");
    CHECK_FAILS(anyface_stream_obey(stream, NULL, &error), ANYFACE_STATUS_NULL_POINTER, "request");
    anyface_request_free(request);
    CHECK_FAILS(anyface_stream_pull(stream, NULL, 1, &written, &error), ANYFACE_STATUS_NULL_POINTER,
                "buffer");
    CHECK(written == 99);
    CHECK_OK(anyface_stream_pull(stream, frame, 1, &written, &error));
    CHECK(written == 0);
    CHECK_OK(anyface_stream_finish(stream, &error));
    CHECK_FAILS(anyface_stream_finish(stream, &error), ANYFACE_STATUS_INVALID_INPUT, "finish");
    CHECK_FAILS(anyface_stream_push(stream, frame, 0, &error), ANYFACE_STATUS_INVALID_INPUT, "push");
    anyface_stream_free(stream);
    anyface_stream_free(NULL);
    CHECK(anyface_stream_latency_s(NULL) == 0.0);
}

int main(int argc, char **argv) {
    CHECK(argc == 2);
    AnyfaceEngine *engine = NULL;
    AnyfaceAudio *audio = NULL;
    CHECK_OK(anyface_engine_new(NULL, &engine, &error));
    CHECK_OK(anyface_audio_read(argv[1], &audio, &error));
    size_t count = anyface_audio_sample_count(audio);
    float *samples = malloc(count * sizeof *samples);
    CHECK(samples != NULL && count > 0);
    CHECK_OK(anyface_audio_copy_samples(audio, samples, count, &error));
    any_cut(engine, samples, count);
    sooner(engine, samples);
    refusals(engine);
    free(samples);
    anyface_audio_free(audio);
    anyface_engine_free(engine);
    puts("ok");
    return 0;
}
