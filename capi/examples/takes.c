/*
 * Cuts a line out of a recording and takes it three times, as a director would: as it is said, with wider lips and
 * other blinks, and the first with the middle of the second. The sound is heard once.
 *
 *     takes HEAD.obj RECORDING.wav START_S SECONDS
 *     takes head.obj session.wav 12.5 4
 *
 * Writes first.npz, again.npz and mixed.npz for numpy; the frames of the last as mixed.raw, floats [T, V, 3], block by
 * block, so that a film of any length fits into memory; and found.json, which talk.c reads.
 * Build: cc -std=c11 takes.c $(pkg-config --cflags --libs anyface) -o takes
 */
#include <anyface.h>

#include <stdio.h>
#include <stdlib.h>

/* Every object of one run, so that one place frees them all: freeing NULL does nothing. */
typedef struct {
    AnyfaceEngine *engine;
    AnyfaceAudio *recording, *line;
    AnyfaceMotion *first, *again, *mixed;
    AnyfaceMesh *mesh;
    AnyfaceFace *face;
} Run;

static void run_free(Run *run) {
    anyface_face_free(run->face);
    anyface_mesh_free(run->mesh);
    anyface_motion_free(run->mixed);
    anyface_motion_free(run->again);
    anyface_motion_free(run->first);
    anyface_audio_free(run->line);
    anyface_audio_free(run->recording);
    anyface_engine_free(run->engine);
}

static AnyfaceStatus cut(Run *run, const char *path, double start_s, double seconds, AnyfaceError **error) {
    AnyfaceStatus status = anyface_audio_read(path, &run->recording, error);
    if (status == ANYFACE_STATUS_OK) {
        status = anyface_audio_trim(run->recording, start_s, seconds, &run->line, error);
    }
    if (status == ANYFACE_STATUS_OK && anyface_audio_peak(run->line) < 0.001f) {
        fprintf(stderr, "nothing is heard from %g s for %g s: the face will rest\n", start_s, seconds);
    }
    return status;
}

static AnyfaceStatus speak(Run *run, AnyfaceError **error) {
    AnyfaceRequest *wider = NULL;
    AnyfaceStatus status = anyface_request_new(&wider, error);
    if (status == ANYFACE_STATUS_OK) {
        status = anyface_request_set_number(wider, "articulation", 1.3, error);
    }
    if (status == ANYFACE_STATUS_OK) { /* other blinks, brows and looks */
        status = anyface_request_set_number(wider, "seed", 1.0, error);
    }
    if (status == ANYFACE_STATUS_OK) {
        status = anyface_engine_new(NULL, &run->engine, error);
    }
    if (status == ANYFACE_STATUS_OK) {
        status = anyface_motion_new(run->engine, run->line, NULL, NULL, &run->first, error);
    }
    if (status == ANYFACE_STATUS_OK) {
        status = anyface_motion_new_again(run->engine, run->first, wider, &run->again, error);
    }
    anyface_request_free(wider);
    if (status == ANYFACE_STATUS_OK) {
        double third_s = anyface_audio_duration_s(run->line) / 3.0;
        status = anyface_motion_new_redone(run->first, run->again, third_s, 2.0 * third_s, &run->mixed, error);
    }
    return status;
}

/* Writes a take, and prints how far the lower lip goes down: landmark 66, the middle of its inner rim. */
static AnyfaceStatus save(const AnyfaceMotion *take, const char *path, AnyfaceError **error) {
    size_t row = 3 * ANYFACE_LANDMARK_COUNT, count = row * anyface_motion_frame_count(take);
    float *moved = malloc(count * sizeof *moved), lowest = 0.0f;
    if (moved == NULL) {
        return ANYFACE_STATUS_OUT_OF_MEMORY;
    }
    AnyfaceStatus status = anyface_motion_copy_displacements(take, moved, count, error);
    for (size_t at = 3 * 66 + 1; status == ANYFACE_STATUS_OK && at < count; at += row) {
        lowest = moved[at] < lowest ? moved[at] : lowest;
    }
    free(moved);
    if (status == ANYFACE_STATUS_OK) {
        printf("%s: the lower lip goes down by %.1f mm\n", path, -1000.0 * (double)lowest);
        status = anyface_motion_write(take, path, error);
    }
    return status;
}

typedef struct {
    FILE *file;
    size_t vertices;
} Film;

/* The library calls this with each block of frames; any result but 0 ends the job. */
static int append(void *user, size_t first_frame, size_t frame_count, const float *displacements) {
    (void)first_frame;
    Film *film = user;
    size_t floats = 3 * film->vertices * frame_count;
    return fwrite(displacements, sizeof *displacements, floats, film->file) != floats;
}

static AnyfaceStatus film(Run *run, const char *head, AnyfaceError **error) {
    AnyfaceStatus status = anyface_mesh_read(head, &run->mesh, error);
    if (status == ANYFACE_STATUS_OK) {
        status = anyface_face_new(run->engine, run->mesh, NULL, NULL, &run->face, error);
    }
    if (status == ANYFACE_STATUS_OK) {
        status = anyface_face_write_landmarks(run->face, "found.json", error);
    }
    Film out = {NULL, anyface_face_vertex_count(run->face)};
    if (status == ANYFACE_STATUS_OK && (out.file = fopen("mixed.raw", "wb")) == NULL) {
        perror("mixed.raw");
        return ANYFACE_STATUS_IO;
    }
    if (status == ANYFACE_STATUS_OK) {
        status = anyface_clip_stream(run->engine, run->face, run->mixed, 16, append, &out, NULL, error);
        printf("mixed.raw: frames %zu vertices %zu\n", anyface_motion_frame_count(run->mixed), out.vertices);
    }
    if (out.file != NULL && fclose(out.file) != 0) {
        status = ANYFACE_STATUS_IO;
    }
    return status;
}

int main(int argc, char **argv) {
    if (argc != 5) {
        fprintf(stderr, "usage: %s HEAD.obj RECORDING.wav START_S SECONDS\n", argv[0]);
        return 2;
    }
    Run run = {0};
    AnyfaceError *error = NULL;
    AnyfaceStatus status = cut(&run, argv[2], atof(argv[3]), atof(argv[4]), &error);
    if (status == ANYFACE_STATUS_OK) {
        status = speak(&run, &error);
    }
    const AnyfaceMotion *takes[] = {run.first, run.again, run.mixed};
    const char *const paths[] = {"first.npz", "again.npz", "mixed.npz"};
    for (int i = 0; i < 3 && status == ANYFACE_STATUS_OK; i++) {
        status = save(takes[i], paths[i], &error);
    }
    if (status == ANYFACE_STATUS_OK) {
        status = film(&run, argv[1], &error);
    }
    if (status != ANYFACE_STATUS_OK) {
        fprintf(stderr, "%s: %s\n", anyface_status_name(status), anyface_error_message(error));
    }
    anyface_error_free(error);
    run_free(&run);
    return (int)status;
}
