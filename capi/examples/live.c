/*
 * Follows a voice while it is spoken: raw sound on standard input, weights of ARKit's shapes and visemes on standard output.
 *
 *     parec --rate=16000 --channels=1 --format=s16le | live [happy | auto] [any] [soon]
 *
 * With "any" every sound moves the face, music and noise too; else speech does. With "soon" frames come sooner, and are less sure.
 * Each line is a frame: its number, the shapes and visemes above 0.1 with their weights, and how the head is turned. A frame
 * comes as soon as the sound that it waits for is there.
 * Build: cc -std=c11 live.c $(pkg-config --cflags --libs anyface) -o live
 */
#include <anyface.h>

#include <stdint.h>
#include <stdio.h>
#include <string.h>

enum { BLOCK = 160, NAMES = ANYFACE_LIVE_SHAPE_COUNT + ANYFACE_LIVE_VISEME_COUNT };

typedef struct {
    AnyfaceEngine *engine;
    AnyfaceWeightStream *stream;
    int frame;
} Live;

/* Writes the frames that are ready. */
static AnyfaceStatus show(Live *live, AnyfaceError **error) {
    float weights[NAMES], head[3];
    for (;;) {
        int32_t is_ready = 0;
        AnyfaceStatus status = anyface_weight_stream_pull(
            live->stream, weights, weights + ANYFACE_LIVE_SHAPE_COUNT, head, &is_ready, error);
        if (status != ANYFACE_STATUS_OK || !is_ready) {
            return status;
        }
        printf("%d", live->frame++);
        for (size_t i = 0; i < NAMES; i++) {
            if (weights[i] > 0.1f) {
                printf(" %s=%.2f", anyface_weight_stream_name(i), weights[i]);
            }
        }
        printf(" head %.3f %.3f %.3f\n", head[0], head[1], head[2]);
        fflush(stdout);
    }
}

/* Asks for what one word of the command line says: "auto" is an emotion too. */
static AnyfaceStatus ask(AnyfaceRequest *request, const char *word, AnyfaceError **error) {
    if (strcmp(word, "any") == 0) {
        return anyface_request_set_number(request, "hear_all", 1.0, error);
    }
    if (strcmp(word, "soon") == 0) {
        return anyface_request_set_number(request, "look_ahead_s", 0.07, error);
    }
    return anyface_request_set_text(request, "emotion", word, error);
}

static AnyfaceStatus begin(Live *live, char **words, AnyfaceError **error) {
    AnyfaceRequest *request = NULL;
    AnyfaceStatus status = anyface_request_new(&request, error);
    while (status == ANYFACE_STATUS_OK && *words != NULL) {
        status = ask(request, *words++, error);
    }
    if (status == ANYFACE_STATUS_OK) {
        status = anyface_engine_new(NULL, &live->engine, error);
    }
    if (status == ANYFACE_STATUS_OK) {
        status = anyface_weight_stream_new(live->engine, &live->stream, error);
    }
    if (status == ANYFACE_STATUS_OK) { /* at any time again, with another emotion */
        status = anyface_weight_stream_obey(live->stream, request, error);
    }
    anyface_request_free(request);
    return status;
}

static AnyfaceStatus follow(Live *live, char **words, AnyfaceError **error) {
    AnyfaceStatus status = begin(live, words, error);
    if (status == ANYFACE_STATUS_OK) {
        double latency_s = anyface_weight_stream_latency_s(live->stream);
        fprintf(stderr, "frames come %.0f ms late\n", 1000.0 * latency_s);
    }
    int16_t block[BLOCK];
    size_t count = 0;
    while (status == ANYFACE_STATUS_OK && (count = fread(block, sizeof *block, BLOCK, stdin)) > 0) {
        float samples[BLOCK];
        for (size_t i = 0; i < count; i++) {
            samples[i] = (float)block[i] / 32768.0f;
        }
        status = anyface_weight_stream_push(live->stream, samples, count, error);
        if (status == ANYFACE_STATUS_OK) {
            status = show(live, error);
        }
    }
    if (status == ANYFACE_STATUS_OK) {
        status = anyface_weight_stream_finish(live->stream, error);
    }
    return status == ANYFACE_STATUS_OK ? show(live, error) : status;
}

int main(int argc, char **argv) {
    Live live = {0};
    AnyfaceError *error = NULL;
    AnyfaceStatus status = follow(&live, argc > 0 ? argv + 1 : argv, &error);
    if (status != ANYFACE_STATUS_OK) {
        fprintf(stderr, "live: %s\n", anyface_error_message(error));
    }
    anyface_error_free(error);
    anyface_weight_stream_free(live.stream);
    anyface_engine_free(live.engine);
    return (int)status;
}
