/*
 * Calls in an order that a number draws, with right and wrong arguments: whatever comes, a call succeeds and
 * gives its result, or fails with a message and gives none, and memory does not grow.
 *
 *     soak HEAD.obj LANDMARKS.json VOICE.wav ROUNDS SEED
 */
#define _POSIX_C_SOURCE 200809L /* setenv() */

#include "check.h"
#include "text.h"

#include <inttypes.h>
#include <malloc.h>
#include <math.h>
#include <threads.h>
#include <time.h>
#include <unistd.h>

#define SLOTS 3
/* Rounds after which all is freed. */
#define LIFETIME 300
/* Memory in use that may be added after the first third. What the process keeps beside it is the allocator's. */
#define GROWTH_MB 0.4
/* The product of matrices keeps a block of so many bytes for each thread that multiplies, as long as it lives. */
#define SCRATCH ((size_t)64 << 20)

static AnyfaceError *error = NULL;
static uint64_t state;
static unsigned long counts[14];

static AnyfaceEngine *engines[SLOTS];
static AnyfaceMesh *meshes[SLOTS];
static AnyfaceAudio *sounds[SLOTS];
static AnyfaceFace *faces[SLOTS];
static AnyfaceMotion *motions[SLOTS];
static AnyfaceClip *clips[SLOTS];
static AnyfaceStream *streams[SLOTS];
static AnyfaceRequest *requests[SLOTS];

static const char *head, *voice;
static const char *landmarks;

/* SplitMix64. */
static uint64_t draw(uint64_t below) {
    uint64_t z = (state += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return (z ^ (z >> 31)) % below;
}

static int one_in(uint64_t n) { return draw(n) == 0; }

/* A number that may be no number, far too large, or usual. */
static float number(void) {
    static const float odd[] = {NAN, INFINITY, -INFINITY, 3e38f, -1.0f, 1e-40f, 0.0f};
    return one_in(12) ? odd[draw(7)] : (float)draw(2001) / 1000.0f;
}

/* The result is there exactly where the call succeeded, and a failure says why. */
static void outcome(AnyfaceStatus status, int is_there) {
    CHECK(status >= 0 && status < 14 && status != ANYFACE_STATUS_PANIC &&
          status != ANYFACE_STATUS_INTERNAL);
    counts[status]++;
    CHECK((status == ANYFACE_STATUS_OK) == is_there);
    CHECK((status == ANYFACE_STATUS_OK) == (error == NULL));
    if (error != NULL) {
        CHECK(anyface_error_status(error) == status && strlen(anyface_error_message(error)) > 0);
        anyface_error_free(error);
        error = NULL;
    }
}

/* Makes `slot` anew: the function that frees it, and the call that fills it. */
#define REMAKE(slot, release, call)                                                                \
    do {                                                                                           \
        release(slot);                                                                             \
        slot = NULL;                                                                               \
        AnyfaceStatus status = (call);                                                             \
        outcome(status, slot != NULL);                                                             \
    } while (0)

/* One of a kind; seldom nothing, and where there is none yet. */
#define ANY(pool) pool[some((const void *const *)(pool))]

static size_t some(const void *const *pool) {
    size_t at = draw(SLOTS);
    for (int tries = 0; pool[at] == NULL && tries < 5; tries++) {
        at = draw(SLOTS);
    }
    return at;
}

static void remake_engine(void) {
    AnyfaceRequest *request = NULL;
    static const char *const systems[] = {"freetalk", "cafe-talk", "emoface", "facetalk", "nobody"};
    CHECK_OK(anyface_request_new(&request, &error));
    CHECK_OK(anyface_request_set_text(request, "system", systems[draw(5)], &error));
    CHECK_OK(anyface_request_set_number(request, "threads", (double)draw(4), &error));
    CHECK_OK(anyface_request_set_text(request, "cache", "off", &error));
    size_t at = draw(SLOTS);
    REMAKE(engines[at], anyface_engine_free, anyface_engine_new(request, &engines[at], &error));
    anyface_request_free(request);
}

static void remake_mesh(void) {
    size_t at = draw(SLOTS);
    if (!one_in(3)) {
        REMAKE(meshes[at], anyface_mesh_free, anyface_mesh_read(head, &meshes[at], &error));
        return;
    }
    float positions[30];
    uint32_t triangles[24];
    for (int i = 0; i < 30; i++) {
        positions[i] = number();
    }
    for (int i = 0; i < 24; i++) {
        triangles[i] = (uint32_t)draw(one_in(20) ? 1000 : 10);
    }
    const float *given = one_in(10) ? NULL : positions;
    REMAKE(meshes[at], anyface_mesh_free,
           anyface_mesh_new(given, draw(11), triangles, draw(9), &meshes[at], &error));
}

static void remake_sound(void) {
    size_t at = draw(SLOTS);
    if (!one_in(3)) {
        REMAKE(sounds[at], anyface_audio_free, anyface_audio_read(voice, &sounds[at], &error));
        return;
    }
    static float samples[8000];
    size_t count = draw(8001);
    for (size_t i = 0; i < count; i++) {
        samples[i] = (float)draw(2001) / 1000.0f - 1.0f;
    }
    if (count > 0 && one_in(4)) {
        samples[draw(count)] = number();
    }
    uint32_t rate = one_in(6) ? (uint32_t)draw(1000000) : 16000;
    REMAKE(sounds[at], anyface_audio_free,
           anyface_audio_new(samples, count, (uint32_t)draw(3), rate, &sounds[at], &error));
}

/* A progress that may stop the job at some call. */
static int stop_at(void *user, const char *stage, float fraction) {
    int *left = user;
    CHECK(strlen(stage) > 0 && fraction >= 0.0f && fraction <= 1.0f);
    return --*left == 0;
}

static void read_events(void) {
    static const char *const texts[] = {"0.1-0.4:smile:0.8", "0.2-0.3:12,6L", "nan-1:smile", "", "x",
                                        "0.1-0.2:blink:9"};
    char *json = NULL;
    AnyfaceStatus status = anyface_events_read(NULL, texts[draw(6)], &json, &error);
    outcome(status, json != NULL);
    anyface_text_free(json);
}

/* Asks for one thing more, of which much is refused. */
static void ask(AnyfaceRequest *request) {
    static const char *const names[] = {"articulation", "head_motion", "learned", "none", "steps",
                                        "up", "landmarks", "fixed_landmarks", "object_roles",
                                        "fps", "seed", "emotion", "emotion_of", "neutral_voice",
                                        "closures", "events", "starts_from", "style", "text"};
    static const char *const texts[] = {"happy:0.7", "auto", "off", "", "a b c", "paper", "7",
                                        "0.1-0.4:smile:0.8"};
    const char *name = names[draw(sizeof names / sizeof *names)];
    double rows[2 * ANYFACE_EMOTION_COUNT] = {0}, times[2] = {0.0, one_in(6) ? NAN : 0.2};
    rows[draw(2 * ANYFACE_EMOTION_COUNT)] = (double)number();
    static const size_t columns[] = {1, 2, ANYFACE_EMOTION_COUNT};
    AnyfaceStatus status = ANYFACE_STATUS_OK;
    switch (draw(5)) {
    case 0:
        status = anyface_request_set_number(request, name, (double)number(), &error);
        break;
    case 1:
        status = anyface_request_set_rows(request, name, one_in(2) ? times : NULL, rows, draw(3),
                                          columns[draw(3)], &error);
        break;
    case 2:
        status = anyface_request_set_sound(request, name, ANY(sounds), &error);
        break;
    case 3:
        status = anyface_request_set_motion(request, name, ANY(motions), &error);
        break;
    default:
        status = anyface_request_set_text(request, name, texts[draw(sizeof texts / sizeof *texts)],
                                          &error);
    }
    outcome(status, status == ANYFACE_STATUS_OK);
}

static void remake_face(void) {
    AnyfaceRequest *request = NULL;
    CHECK_OK(anyface_request_new(&request, &error));
    if (one_in(2)) {
        ask(request);
    }
    CHECK_OK(anyface_request_set_text(request, "landmarks", landmarks, &error));
    int left = (int)draw(12);
    AnyfaceProgress *progress = one_in(3) ? anyface_progress_new(stop_at, &left) : NULL;
    size_t at = draw(SLOTS);
    REMAKE(faces[at], anyface_face_free,
           anyface_face_new(ANY(engines), ANY(meshes), request, progress, &faces[at], &error));
    anyface_progress_free(progress);
    anyface_request_free(request);
}

static void remake_request(void) {
    size_t at = draw(SLOTS);
    REMAKE(requests[at], anyface_request_free, anyface_request_new(&requests[at], &error));
    for (size_t count = draw(4); count > 0; count--) {
        ask(requests[at]);
    }
}

static void remake_motion(void) {
    const AnyfaceRequest *request = one_in(3) ? NULL : ANY(requests);
    int left = (int)draw(20);
    AnyfaceProgress *progress = one_in(3) ? anyface_progress_new(stop_at, &left) : NULL;
    size_t at = draw(SLOTS);
    REMAKE(motions[at], anyface_motion_free,
           anyface_motion_new(ANY(engines), ANY(sounds), request, progress, &motions[at], &error));
    anyface_progress_free(progress);
}

static void remake_clip(void) {
    size_t at = draw(SLOTS);
    REMAKE(clips[at], anyface_clip_free,
           anyface_clip_new(ANY(engines), ANY(faces), ANY(motions), NULL, &clips[at], &error));
    const AnyfaceClip *clip = ANY(clips);
    size_t count = 3 * anyface_clip_vertex_count(clip) * anyface_clip_frame_count(clip);
    const float *moved = anyface_clip_displacements(clip);
    for (size_t i = 0; i < count; i++) {
        CHECK(isfinite(moved[i]));
    }
    float landmarks_at_rest[3 * ANYFACE_LANDMARK_COUNT];
    size_t room = one_in(4) ? 7 : 3 * ANYFACE_LANDMARK_COUNT;
    AnyfaceStatus status = anyface_clip_copy_landmarks_neutral(clip, landmarks_at_rest, room, &error);
    outcome(status, status == ANYFACE_STATUS_OK);
}

static int take_frames(void *user, size_t first, size_t count, const float *displacements) {
    int *left = user;
    (void)first;
    CHECK(count > 0 && isfinite(displacements[0]));
    return --*left == 0;
}

static void stream_clip(void) {
    int left = (int)draw(6);
    AnyfaceStatus status = anyface_clip_stream(ANY(engines), ANY(faces), ANY(motions), draw(5),
                                               one_in(9) ? NULL : take_frames, &left, NULL, &error);
    outcome(status, status == ANYFACE_STATUS_OK);
}

static void use_stream(void) {
    size_t at = draw(SLOTS);
    if (one_in(4)) {
        REMAKE(streams[at], anyface_stream_free,
               anyface_stream_new(ANY(engines), &streams[at], &error));
    }
    static float moved[40 * 3 * ANYFACE_LANDMARK_COUNT], samples[1600];
    size_t written = 0;
    for (int i = 0; i < 1600; i++) {
        samples[i] = (float)(i % 100) / 100.0f - 0.5f;
    }
    if (one_in(10)) {
        samples[draw(1600)] = number();
    }
    AnyfaceStatus status = anyface_stream_push(streams[at], samples, draw(1601), &error);
    outcome(status, status == ANYFACE_STATUS_OK);
    status = anyface_stream_pull(streams[at], moved, draw(41), &written, &error);
    outcome(status, status == ANYFACE_STATUS_OK);
    CHECK(written <= 40);
    if (one_in(5)) {
        status = anyface_stream_finish(streams[at], &error);
        outcome(status, status == ANYFACE_STATUS_OK);
    }
}

static size_t thread_count(void) {
    FILE *file = fopen("/proc/self/status", "r");
    char line[256];
    size_t threads = 0;
    CHECK(file != NULL);
    while (threads == 0 && fgets(line, sizeof line, file) != NULL) {
        (void)sscanf(line, "Threads: %zu", &threads);
    }
    fclose(file);
    CHECK(threads > 0);
    return threads;
}

/* What is in use once the threads of freed engines have ended, which they do by themselves: all but one scratch for
 * each thread that is left. */
static double in_use_mb(void) {
    double least = INFINITY;
    for (int i = 0; i < 50; i++) {
        thrd_sleep(&(struct timespec){.tv_nsec = 10000000}, NULL);
        size_t threads = thread_count();
        struct mallinfo2 of = mallinfo2();
        size_t scratches = of.hblkhd / SCRATCH;
        size_t theirs = scratches < threads ? scratches : threads;
        double now = (double)(of.uordblks + of.hblkhd - theirs * SCRATCH) / 1e6;
        least = now < least ? now : least;
    }
    return least;
}

static double resident_mb(void) {
    FILE *file = fopen("/proc/self/statm", "r");
    unsigned long pages = 0, resident = 0;
    CHECK(file != NULL && fscanf(file, "%lu %lu", &pages, &resident) == 2);
    fclose(file);
    return (double)resident * (double)sysconf(_SC_PAGESIZE) / 1e6;
}

static void free_all(void) {
    for (int i = 0; i < SLOTS; i++) {
        anyface_stream_free(streams[i]);
        anyface_clip_free(clips[i]);
        anyface_motion_free(motions[i]);
        anyface_request_free(requests[i]);
        anyface_face_free(faces[i]);
        anyface_audio_free(sounds[i]);
        anyface_mesh_free(meshes[i]);
        anyface_engine_free(engines[i]);
        streams[i] = NULL, clips[i] = NULL, motions[i] = NULL, requests[i] = NULL;
        faces[i] = NULL, sounds[i] = NULL, meshes[i] = NULL, engines[i] = NULL;
    }
}

int main(int argc, char **argv) {
    /* What threads keep of freed memory for their next calls counts as in use, so that none may be kept. */
    if (getenv("GLIBC_TUNABLES") == NULL) {
        setenv("GLIBC_TUNABLES", "glibc.malloc.tcache_count=0:glibc.malloc.mxfast=0", 1);
        execv("/proc/self/exe", argv);
    }
    static void (*const calls[])(void) = {
        remake_mesh,   remake_sound, remake_sound, remake_face, remake_face,
        read_events,   remake_request, remake_request, remake_motion, remake_motion,
        remake_motion, remake_clip,    remake_clip,    stream_clip,   use_stream,
        use_stream,
    };
    CHECK(argc == 6);
    head = argv[1];
    landmarks = read_text(argv[2]);
    voice = argv[3];
    unsigned long rounds = strtoul(argv[4], NULL, 10);
    state = strtoull(argv[5], NULL, 10);
    double first_mb = 0.0;
    for (unsigned long round = 0; round < rounds; round++) {
        if (round % LIFETIME == 0) {
            free_all();
            if (first_mb == 0.0 && round > rounds / 3) {
                first_mb = in_use_mb();
            }
        }
        /* Engines are dear. */
        if (round % LIFETIME < SLOTS || one_in(100)) {
            remake_engine();
        } else {
            calls[draw(sizeof calls / sizeof *calls)]();
        }
    }
    free_all();
    double last_mb = in_use_mb();
    if (getenv("ANYFACE_SOAK") != NULL) {
        for (int status = 0; status < 14; status++) {
            printf("%s %lu\n", anyface_status_name(status), counts[status]);
        }
        printf("%.3f MB in use after a third, %.3f MB at the end; resident %.0f MB\n", first_mb,
               last_mb, resident_mb());
    }
    CHECK(counts[ANYFACE_STATUS_OK] > rounds / 4);
    CHECK(first_mb == 0.0 || last_mb < first_mb + GROWTH_MB);
    puts("ok");
    return 0;
}
