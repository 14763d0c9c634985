/*
 * Makes a head talk and writes the result for numpy (.npz) or as a point cache (.pc2, .mdd).
 *
 *     talk HEAD.obj VOICE.wav OUT.pc2 [EMOTION] [LANDMARKS.json]
 *     talk head.obj voice.wav out.pc2 happy:0.7
 *
 * Build: cc -std=c11 talk.c $(pkg-config --cflags --libs anyface) -o talk
 */
#include <anyface.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Every object of one run, so that one place frees them all: freeing NULL does nothing. */
typedef struct {
    AnyfaceEngine *engine;
    AnyfaceMesh *mesh;
    AnyfaceAudio *audio;
    AnyfaceFace *face;
    AnyfaceClip *clip;
    AnyfaceProgress *progress;
    char *landmark_json;
} Run;

static void run_free(Run *run) {
    anyface_clip_free(run->clip);
    anyface_face_free(run->face);
    anyface_audio_free(run->audio);
    anyface_mesh_free(run->mesh);
    anyface_engine_free(run->engine);
    anyface_progress_free(run->progress);
    free(run->landmark_json);
}

/* Called by the library while it works; any result but 0 would stop the job. */
static int show_progress(void *user, const char *stage, float fraction) {
    fprintf((FILE *)user, "\r%-10s %3.0f %%", stage, 100.0 * (double)fraction);
    return 0;
}

/* Prints what went wrong, frees it and returns its status; NULL is no error. */
static AnyfaceStatus report(AnyfaceError *error) {
    AnyfaceStatus status = anyface_error_status(error);
    if (status != ANYFACE_STATUS_OK) {
        fprintf(stderr, "\n%s: %s\n", anyface_status_name(status), anyface_error_message(error));
    }
    anyface_error_free(error);
    return status;
}

static char *read_text(const char *path) {
    FILE *file = fopen(path, "rb");
    if (file == NULL) {
        return NULL;
    }
    size_t length = 0, room = 4096, got;
    char *text = malloc(room + 1);
    while (text != NULL && (got = fread(text + length, 1, room - length, file)) > 0) {
        length += got;
        if (length == room) {
            room *= 2;
            char *larger = realloc(text, room + 1);
            if (larger == NULL) {
                free(text);
            }
            text = larger;
        }
    }
    fclose(file);
    if (text != NULL) {
        text[length] = '\0';
    }
    return text;
}

static AnyfaceStatus load(Run *run, const char *mesh, const char *audio) {
    AnyfaceError *error = NULL;
    AnyfaceStatus status = anyface_engine_new(NULL, &run->engine, &error);
    if (status == ANYFACE_STATUS_OK) {
        status = anyface_mesh_read(mesh, &run->mesh, &error);
    }
    if (status == ANYFACE_STATUS_OK) {
        anyface_audio_read(audio, &run->audio, &error);
    }
    return report(error);
}

static AnyfaceStatus animate(Run *run, const char *emotion) {
    AnyfaceError *error = NULL;

    AnyfaceRequest *request = NULL;
    AnyfaceStatus status = anyface_request_new(&request, &error);
    if (status == ANYFACE_STATUS_OK && emotion != NULL) {
        status = anyface_request_set_text(request, "emotion", emotion, &error);
    }
    if (status == ANYFACE_STATUS_OK && run->landmark_json != NULL) { /* else the library finds them */
        status = anyface_request_set_text(request, "landmarks", run->landmark_json, &error);
    }
    if (status == ANYFACE_STATUS_OK) {
        status = anyface_face_new(run->engine, run->mesh, request, run->progress, &run->face, &error);
    }
    if (status == ANYFACE_STATUS_OK) {
        anyface_engine_animate(run->engine, run->face, run->audio, request, run->progress, &run->clip,
                               &error);
    }
    anyface_request_free(request);
    return report(error);
}

static AnyfaceStatus save(const Run *run, const char *out) {
    AnyfaceError *error = NULL;
    anyface_clip_write(run->clip, run->mesh, out, &error);
    AnyfaceStatus status = report(error);
    if (status == ANYFACE_STATUS_OK) {
        printf("frames %zu vertices %zu fps %g largest %g\n", anyface_clip_frame_count(run->clip),
               anyface_clip_vertex_count(run->clip), anyface_clip_fps(run->clip),
               (double)anyface_clip_largest_displacement(run->clip));
    }
    return status;
}

int main(int argc, char **argv) {
    if (argc < 4 || argc > 6) {
        fprintf(stderr, "usage: %s HEAD.obj VOICE.wav OUT.pc2 [EMOTION] [LANDMARKS.json]\n",
                argv[0]);
        return 2;
    }
    if (anyface_abi_version() != ANYFACE_ABI_VERSION) {
        fprintf(stderr, "built for interface %d, the library has %u (version %s)\n",
                ANYFACE_ABI_VERSION, (unsigned)anyface_abi_version(), anyface_version());
        return 2;
    }
    Run run = {0};
    run.progress = anyface_progress_new(show_progress, stderr);
    if (argc == 6 && (run.landmark_json = read_text(argv[5])) == NULL) {
        perror(argv[5]);
        run_free(&run);
        return ANYFACE_STATUS_IO;
    }
    const char *emotion = argc > 4 && strlen(argv[4]) > 0 ? argv[4] : NULL;
    AnyfaceStatus status = load(&run, argv[1], argv[2]);
    if (status == ANYFACE_STATUS_OK) {
        status = animate(&run, emotion);
    }
    if (status == ANYFACE_STATUS_OK) {
        status = save(&run, argv[3]);
    }
    run_free(&run);
    return (int)status;
}
