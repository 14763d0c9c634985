/*
 * Jobs on one engine: two at once give what one after the other gave, the number of threads
 * changes nothing, and a job that is asked to stop stops.
 *
 *     jobs HEAD.obj LANDMARKS.json VOICE.wav
 */
#include "check.h"
#include "text.h"

#include <math.h>
#include <pthread.h>

static AnyfaceError *error = NULL;

typedef struct {
    const AnyfaceEngine *engine;
    const AnyfaceFace *face;
    const AnyfaceAudio *audio;
    float happy;
    AnyfaceClip *clip;
    AnyfaceStatus status;
} Job;

static void *work(void *argument) {
    Job *job = argument;
    AnyfaceRequest *request = NULL;
    double strengths[ANYFACE_EMOTION_COUNT] = {0};
    strengths[1] = job->happy;
    CHECK(anyface_request_new(&request, NULL) == ANYFACE_STATUS_OK);
    CHECK(anyface_request_set_rows(request, "emotion", NULL, strengths, 1, ANYFACE_EMOTION_COUNT,
                                   NULL) == ANYFACE_STATUS_OK);
    CHECK(anyface_request_set_number(request, "steps", 2.0, NULL) == ANYFACE_STATUS_OK);
    job->status = anyface_engine_animate(job->engine, job->face, job->audio, request, NULL,
                                         &job->clip, NULL);
    anyface_request_free(request);
    return NULL;
}

static void check_same(const AnyfaceClip *a, const AnyfaceClip *b) {
    size_t frames = anyface_clip_frame_count(a), vertices = anyface_clip_vertex_count(a);
    CHECK(frames > 0 && vertices > 0);
    CHECK(frames == anyface_clip_frame_count(b) && vertices == anyface_clip_vertex_count(b));
    size_t bytes = frames * vertices * 3 * sizeof(float);
    CHECK(memcmp(anyface_clip_displacements(a), anyface_clip_displacements(b), bytes) == 0);
}

static void two_at_once(const AnyfaceEngine *engine, const AnyfaceFace *face,
                        const AnyfaceAudio *audio) {
    Job alone[2], together[2];
    pthread_t threads[2];
    for (int i = 0; i < 2; i++) {
        together[i] = alone[i] =
            (Job){.engine = engine, .face = face, .audio = audio, .happy = (float)i};
        work(&alone[i]);
        CHECK(alone[i].status == ANYFACE_STATUS_OK);
    }
    for (int round = 0; round < 2; round++) {
        for (int i = 0; i < 2; i++) {
            CHECK(pthread_create(&threads[i], NULL, work, &together[i]) == 0);
        }
        for (int i = 0; i < 2; i++) {
            CHECK(pthread_join(threads[i], NULL) == 0 && together[i].status == ANYFACE_STATUS_OK);
            check_same(alone[i].clip, together[i].clip);
            anyface_clip_free(together[i].clip);
        }
    }
    /* The two jobs are two performances, or the comparison above would say nothing. */
    size_t count = anyface_clip_frame_count(alone[0].clip) * ANYFACE_LANDMARK_COUNT * 3;
    float *moved = malloc(2 * count * sizeof *moved);
    CHECK(moved != NULL);
    for (int i = 0; i < 2; i++) {
        CHECK_OK(anyface_clip_copy_landmark_displacements(alone[i].clip, moved + i * count, count,
                                                          &error));
        anyface_clip_free(alone[i].clip);
    }
    CHECK(memcmp(moved, moved + count, count * sizeof *moved) != 0);
    free(moved);
}

static void any_number_of_threads(const AnyfaceMesh *mesh, AnyfaceRequest *request,
                                  const AnyfaceAudio *audio) {
    Job jobs[2];
    for (uint32_t i = 0; i < 2; i++) {
        CHECK_OK(anyface_request_set_text(request, "cache", "off", &error));
        CHECK_OK(anyface_request_set_number(request, "threads", 1 + 2 * i, &error));
        AnyfaceEngine *engine = NULL;
        AnyfaceFace *face = NULL;
        CHECK_OK(anyface_engine_new(request, &engine, &error));
        CHECK_OK(anyface_face_new(engine, mesh, request, NULL, &face, &error));
        jobs[i] = (Job){.engine = engine, .face = face, .audio = audio, .happy = 0.5f};
        work(&jobs[i]);
        CHECK(jobs[i].status == ANYFACE_STATUS_OK);
        anyface_face_free(face);
        anyface_engine_free(engine);
    }
    check_same(jobs[0].clip, jobs[1].clip);
    anyface_clip_free(jobs[0].clip);
    anyface_clip_free(jobs[1].clip);
}

static int stop_at_fifth_call(void *user, const char *stage, float fraction) {
    int *calls = user;
    CHECK(strlen(stage) > 0 && fraction >= 0.0f && fraction <= 1.0f);
    return ++*calls == 5;
}

static void cancelling(const AnyfaceEngine *engine, const AnyfaceFace *face,
                       const AnyfaceAudio *audio) {
    char mark;
    AnyfaceClip *clip = (AnyfaceClip *)(void *)&mark;
    AnyfaceClip *const before = clip;

    int calls = 0;
    AnyfaceProgress *progress = anyface_progress_new(stop_at_fifth_call, &calls);
    CHECK_FAILS(anyface_engine_animate(engine, face, audio, NULL, progress, &clip, &error),
                ANYFACE_STATUS_CANCELLED, "cancelled");
    CHECK(calls == 5 && clip == before);
    anyface_progress_free(progress);

    progress = anyface_progress_new(NULL, NULL);
    anyface_progress_cancel(progress);
    CHECK_FAILS(anyface_engine_animate(engine, face, audio, NULL, progress, &clip, &error),
                ANYFACE_STATUS_CANCELLED, "cancelled");
    CHECK(clip == before);
    anyface_progress_free(progress);

    progress = anyface_progress_new(NULL, NULL);
    const char *stage = NULL;
    float fraction = -1.0f;
    CHECK(anyface_progress_read(progress, &stage, &fraction) == ANYFACE_STATUS_OK);
    CHECK(strcmp(stage, "") == 0 && fraction == 0.0f);
    CHECK_OK(anyface_engine_animate(engine, face, audio, NULL, progress, &clip, &error));
    CHECK(anyface_progress_read(progress, &stage, &fraction) == ANYFACE_STATUS_OK);
    CHECK(strlen(stage) > 0 && fraction == 1.0f);
    anyface_progress_free(progress);
    anyface_clip_free(clip);
}

/* What a host does with frames as they are made. */
typedef struct {
    const AnyfaceClip *whole;
    size_t vertices, next, stop_at;
} Frames;

static int take_frames(void *user, size_t first, size_t count, const float *displacements) {
    Frames *frames = user;
    CHECK(first == frames->next && count >= 1 && count <= 2);
    frames->next += count;
    size_t floats = frames->vertices * 3;
    const float *same = anyface_clip_displacements(frames->whole) + first * floats;
    for (size_t i = 0; i < count * floats; i++) {
        /* Products of other sizes are rounded otherwise. */
        CHECK(fabsf(displacements[i] - same[i]) < 1e-6f);
    }
    return frames->next >= frames->stop_at;
}

static void block_by_block(const AnyfaceEngine *engine, const AnyfaceFace *face) {
    static float moved[5 * 3 * ANYFACE_LANDMARK_COUNT];
    for (int frame = 0; frame < 5; frame++) {
        moved[(frame * ANYFACE_LANDMARK_COUNT + 8) * 3 + 1] = -0.002f * (float)frame;
    }
    AnyfaceMotion *motion = NULL;
    AnyfaceClip *clip = NULL;
    CHECK_OK(anyface_motion_new_displacements(moved, 5, 24.0, &motion, &error));
    CHECK_OK(anyface_clip_new(engine, face, motion, NULL, &clip, &error));
    Frames frames = {clip, anyface_clip_vertex_count(clip), 0, 99};
    CHECK_OK(anyface_clip_stream(engine, face, motion, 2, take_frames, &frames, NULL, &error));
    CHECK(frames.next == 5);
    frames.next = 0;
    frames.stop_at = 3;
    CHECK_FAILS(anyface_clip_stream(engine, face, motion, 2, take_frames, &frames, NULL, &error),
                ANYFACE_STATUS_CANCELLED, "cancelled");
    CHECK(frames.next == 4);
    CHECK_FAILS(anyface_clip_stream(engine, face, motion, 0, take_frames, &frames, NULL, &error),
                ANYFACE_STATUS_INVALID_INPUT, "frames_at_once");
    CHECK_FAILS(anyface_clip_stream(engine, face, motion, 2, NULL, NULL, NULL, &error),
                ANYFACE_STATUS_NULL_POINTER, "take_frames");
    anyface_motion_free(motion);
    anyface_clip_free(clip);
}

/* The jaw's chin drops by a centimetre in the second frame; nothing else is given. */
static void motion_of_the_host(const AnyfaceEngine *engine, const AnyfaceFace *face) {
    static float moved[2 * 3 * ANYFACE_LANDMARK_COUNT];
    moved[3 * ANYFACE_LANDMARK_COUNT + 3 * 8 + 1] = -0.01f;
    AnyfaceMotion *motion = NULL;
    AnyfaceClip *clip = NULL;
    CHECK_OK(anyface_motion_new_displacements(moved, 2, 24.0, &motion, &error));
    CHECK_OK(anyface_clip_new(engine, face, motion, NULL, &clip, &error));
    anyface_motion_free(motion);
    size_t vertices = anyface_clip_vertex_count(clip);
    CHECK(anyface_clip_frame_count(clip) == 2 && anyface_clip_fps(clip) == 24.0);
    CHECK(vertices == anyface_face_vertex_count(face));
    CHECK(anyface_clip_largest_displacement(clip) > 0.005f);

    const float *all = anyface_clip_displacements(clip);
    for (size_t i = 0; i < vertices * 3; i++) {
        CHECK(all[i] == 0.0f);
    }
    anyface_clip_free(clip);
}

static void landmarks(const AnyfaceFace *face) {
    float positions[3 * ANYFACE_LANDMARK_COUNT], confidence[ANYFACE_LANDMARK_COUNT];
    uint32_t vertices[ANYFACE_LANDMARK_COUNT];
    CHECK_OK(anyface_face_copy_landmarks(face, positions, vertices, confidence, &error));
    CHECK(positions[3 * 8 + 1] < positions[3 * 27 + 1]); /* the chin is below the nose */
    float way[12], scale = 0.0f, tip = 0.0f;
    CHECK_OK(anyface_face_copy_to_canonical(face, way, 12, &error));
    for (int i = 0; i < 3; i++) {
        scale += way[4 + i] * way[4 + i];
        tip += way[8 + i] * positions[3 * 30 + i];
    }
    const double metres = anyface_face_metres_per_unit(face);
    CHECK(fabs(scale / (metres * metres) - 1.0) < 2e-5);
    CHECK(tip + way[11] > 0.05f); /* metres out of the face, from the jaw's hinges */
    CHECK_FAILS(anyface_face_copy_to_canonical(face, way, 9, &error), ANYFACE_STATUS_INVALID_INPUT,
                "12");
    for (int i = 0; i < ANYFACE_LANDMARK_COUNT; i++) {
        CHECK(vertices[i] < anyface_face_vertex_count(face) && confidence[i] == 1.0f);
    }
}

static void parts(const AnyfaceFace *face) {
    size_t count = anyface_face_part_count(face), vertices = anyface_face_vertex_count(face);
    int32_t roles[64];
    uint32_t *part_of_vertex = malloc(vertices * sizeof *part_of_vertex);
    CHECK(count > 0 && count <= 64 && part_of_vertex != NULL);
    CHECK_OK(anyface_face_copy_parts(face, roles, part_of_vertex, &error));
    CHECK(roles[part_of_vertex[0]] == ANYFACE_PART_ROLE_SKIN);
    CHECK_OK(anyface_face_copy_parts(face, NULL, NULL, &error));
    CHECK(anyface_face_part_count(NULL) == 0);
    free(part_of_vertex);
}

/* Finding alone, then with the chin held elsewhere: the chin is exact, its neighbours follow. */
static void found_alone(const AnyfaceEngine *engine, const AnyfaceMesh *mesh, const AnyfaceFace *face) {
    enum { CHIN = 8, NEIGHBOUR = 7 };
    float free_ones[3 * ANYFACE_LANDMARK_COUNT], held[3 * ANYFACE_LANDMARK_COUNT];
    float confidence[ANYFACE_LANDMARK_COUNT];
    AnyfaceFace *found = NULL;
    CHECK_OK(anyface_face_find(engine, mesh, NULL, NULL, &found, &error));
    CHECK_OK(anyface_face_copy_landmarks(found, free_ones, NULL, NULL, &error));
    CHECK(anyface_face_mouth(found) >= ANYFACE_MOUTH_OPEN);
    /* Its eyes are one with the skin about them. */
    CHECK(anyface_face_lids(face, 0) == ANYFACE_LIDS_JOINED && anyface_face_lids(NULL, 1) == -1);
    CHECK(anyface_face_part_count(found) == anyface_face_part_count(face));
    double metres = anyface_face_metres_per_unit(found), same = anyface_face_metres_per_unit(face);
    CHECK(metres > 0.0 && fabs(metres / same - 1.0) < 0.1);
    anyface_face_free(found);

    double places[3 * ANYFACE_LANDMARK_COUNT], chin[4] = {CHIN};
    for (int i = 0; i < 3 * ANYFACE_LANDMARK_COUNT; i++) {
        places[i] = (double)free_ones[i];
    }
    memcpy(chin + 1, places + 3 * CHIN, 3 * sizeof *chin);
    chin[1] += 0.1 * (places[3 * 45] - places[3 * 36]);
    AnyfaceRequest *request = NULL;
    CHECK_OK(anyface_request_new(&request, &error));
    CHECK_OK(anyface_request_set_rows(request, "landmarks", NULL, places, ANYFACE_LANDMARK_COUNT, 3,
                                      &error));
    CHECK_OK(anyface_request_set_rows(request, "fixed_landmarks", NULL, chin, 1, 4, &error));
    found = NULL;
    CHECK_OK(anyface_face_find(engine, mesh, request, NULL, &found, &error));
    CHECK_OK(anyface_face_copy_landmarks(found, held, NULL, confidence, &error));
    CHECK(held[3 * CHIN] > free_ones[3 * CHIN] && confidence[CHIN] == 1.0f);
    CHECK(held[3 * NEIGHBOUR] > free_ones[3 * NEIGHBOUR]);
    anyface_face_free(found);

    chin[0] = ANYFACE_LANDMARK_COUNT;
    CHECK_OK(anyface_request_set_rows(request, "fixed_landmarks", NULL, chin, 1, 4, &error));
    found = NULL;
    CHECK_FAILS(anyface_face_find(engine, mesh, request, NULL, &found, &error),
                ANYFACE_STATUS_INVALID_INPUT, "below 68");
    anyface_request_free(request);
    CHECK(found == NULL && anyface_face_mouth(NULL) == -1);
    CHECK(anyface_face_part_count(NULL) == 0);
    anyface_face_free(NULL);
}

/* The same speech with other controls, without sampling again: bit for bit a new run with them. */
static void performed_again(const AnyfaceEngine *engine, const AnyfaceAudio *audio) {
    const double times[2] = {0.2, 0.8}, values[2] = {0.5, 1.5};
    AnyfaceRequest *asked = NULL;
    CHECK_OK(anyface_request_new(&asked, &error));
    CHECK_OK(anyface_request_set_rows(asked, "articulation", times, values, 2, 1, &error));
    CHECK_OK(anyface_request_set_number(asked, "blinks_per_minute", 0.0, &error));
    AnyfaceMotion *first = NULL, *again = NULL, *anew = NULL;
    CHECK_OK(anyface_motion_new(engine, audio, NULL, NULL, &first, &error));
    CHECK_OK(anyface_motion_new(engine, audio, asked, NULL, &anew, &error));
    CHECK_OK(anyface_motion_new_again(engine, first, asked, &again, &error));
    anyface_request_free(asked);
    size_t count = anyface_motion_frame_count(first) * 3 * ANYFACE_LANDMARK_COUNT;
    float *moved = malloc(3 * count * sizeof *moved);
    CHECK(moved != NULL && anyface_motion_frame_count(again) == anyface_motion_frame_count(anew));
    CHECK_OK(anyface_motion_copy_displacements(first, moved, count, &error));
    CHECK_OK(anyface_motion_copy_displacements(again, moved + count, count, &error));
    CHECK_OK(anyface_motion_copy_displacements(anew, moved + 2 * count, count, &error));
    CHECK(memcmp(moved + count, moved + 2 * count, count * sizeof *moved) == 0);
    CHECK(memcmp(moved, moved + count, count * sizeof *moved) != 0);
    free(moved);
    anyface_motion_free(first);
    anyface_motion_free(again);
    anyface_motion_free(anew);
}

/* What is heard, given back, moves nothing; without a closure, and with one of the host's own, it does. A
   stretch of that in the first motion leaves the rest to the bit. */
static void mended(const AnyfaceEngine *engine, const AnyfaceAudio *audio) {
    AnyfaceSounds *heard = NULL;
    CHECK_OK(anyface_sounds_new(engine, audio, &heard, &error));
    size_t closures = anyface_sounds_interval_count(heard, ANYFACE_TIER_CLOSURES);
    double *times = malloc((2 * closures + 1) * sizeof *times);
    CHECK(times != NULL);
    CHECK_OK(anyface_sounds_copy_intervals(heard, ANYFACE_TIER_CLOSURES, times, 2 * closures,
                                           &error));
    const double own[2] = {0.15, 0.35};
    AnyfaceRequest *same = NULL, *other = NULL;
    CHECK_OK(anyface_request_new(&same, &error));
    CHECK_OK(anyface_request_new(&other, &error));
    CHECK_OK(anyface_request_set_rows(same, "closures", NULL, times, closures, 2, &error));
    CHECK_OK(anyface_request_set_rows(other, "closures", NULL, own, 1, 2, &error));
    AnyfaceMotion *motions[4] = {NULL, NULL, NULL, NULL};
    CHECK_OK(anyface_motion_new(engine, audio, NULL, NULL, &motions[0], &error));
    CHECK_OK(anyface_motion_new(engine, audio, same, NULL, &motions[1], &error));
    CHECK_OK(anyface_motion_new(engine, audio, other, NULL, &motions[2], &error));
    CHECK_OK(anyface_motion_new_redone(motions[0], motions[2], 0.1, 0.4, &motions[3], &error));
    size_t frame = 3 * ANYFACE_LANDMARK_COUNT, count = anyface_motion_frame_count(motions[0]) * frame;
    float *moved = malloc(4 * count * sizeof *moved);
    CHECK(moved != NULL && count > 13 * frame);
    for (int i = 0; i < 4; ++i)
        CHECK_OK(anyface_motion_copy_displacements(motions[i], moved + i * count, count, &error));
    CHECK(memcmp(moved, moved + count, count * sizeof *moved) == 0);
    const float *redone = moved + 3 * count;
    CHECK(memcmp(moved, redone, 4 * frame * sizeof *moved) == 0);
    CHECK(memcmp(moved + 4 * frame, redone + 4 * frame, 9 * frame * sizeof *moved) != 0);
    CHECK(memcmp(moved + 13 * frame, redone + 13 * frame, (count - 13 * frame) * sizeof *moved) == 0);
    AnyfaceMotion *none = NULL;
    CHECK_FAILS(anyface_motion_new_redone(motions[0], motions[2], 0.4, 0.1, &none, &error),
                ANYFACE_STATUS_INVALID_INPUT, "after the start");
    anyface_request_free(same);
    anyface_request_free(other);
    free(moved);
    free(times);
    for (int i = 0; i < 4; ++i)
        anyface_motion_free(motions[i]);
    anyface_sounds_free(heard);
}

/* Words of a text stand in their order. */
static void said(const AnyfaceEngine *engine, const AnyfaceAudio *audio) {
    AnyfaceSounds *plain = NULL, *heard = NULL;
    CHECK_OK(anyface_sounds_new(engine, audio, &plain, &error));
    CHECK(anyface_sounds_interval_count(plain, ANYFACE_TIER_WORDS) == 0);
    CHECK_OK(anyface_sounds_new_with_text(engine, audio, "Oh, a b!", &heard, &error));
    CHECK(anyface_sounds_interval_count(heard, ANYFACE_TIER_WORDS) == 3);
    CHECK(strcmp(anyface_sounds_label(heard, ANYFACE_TIER_WORDS, 2), "b") == 0);
    CHECK(anyface_sounds_label(heard, ANYFACE_TIER_WORDS, 3) == NULL);
    double times[6];
    CHECK_OK(anyface_sounds_copy_intervals(heard, ANYFACE_TIER_WORDS, times, 6, &error));
    for (int i = 0; i < 5; ++i)
        CHECK(times[i] <= times[i + 1]);
    CHECK_FAILS(anyface_sounds_copy_intervals(heard, 4, times, 6, &error), ANYFACE_STATUS_INVALID_INPUT,
                "tier");
    anyface_sounds_free(plain);
    anyface_sounds_free(heard);
    heard = NULL;
    CHECK_FAILS(anyface_sounds_new_with_text(engine, audio, "...", &heard, &error),
                ANYFACE_STATUS_INVALID_INPUT, "letter");
    CHECK_OK(anyface_sounds_new_with_text(engine, audio, NULL, &heard, &error));
    CHECK(anyface_sounds_interval_count(heard, ANYFACE_TIER_WORDS) == 0);
    anyface_sounds_free(heard);
}

/* Of a mask there is nothing in motion that was not spoken, or that another system spoke. */
static void masks(const AnyfaceEngine *engine, const AnyfaceFace *face, const AnyfaceAudio *audio) {
    AnyfaceRequest *request = NULL;
    AnyfaceEngine *emotion = NULL;
    CHECK_OK(anyface_request_new(&request, &error));
    CHECK_OK(anyface_request_set_text(request, "system", "emoface", &error));
    CHECK_OK(anyface_engine_new(request, &emotion, &error));
    anyface_request_free(request);
    size_t count = anyface_face_vertex_count(face);
    float *mask = malloc(count * sizeof *mask);
    CHECK(mask != NULL);
    AnyfaceMotion *motion = NULL;
    CHECK_OK(anyface_motion_new(engine, audio, NULL, NULL, &motion, &error));
    CHECK_FAILS(anyface_motion_copy_mask(motion, engine, face, 0, mask, count, &error),
                ANYFACE_STATUS_INVALID_INPUT, "got freetalk");
    CHECK_FAILS(anyface_motion_copy_mask(motion, emotion, face, 0, mask, count, &error),
                ANYFACE_STATUS_INVALID_INPUT, "another system");
    anyface_motion_free(motion);
    static float moved[3 * ANYFACE_LANDMARK_COUNT];
    CHECK_OK(anyface_motion_new_displacements(moved, 1, 24.0, &motion, &error));
    CHECK_FAILS(anyface_motion_copy_mask(motion, emotion, face, 0, mask, count, &error),
                ANYFACE_STATUS_INVALID_INPUT, "motion of a sound");
    anyface_motion_free(motion);
    // Silence is a sound like any other, of which the mask can be asked.
    static float nothing[16000];
    AnyfaceAudio *silence = NULL;
    CHECK_OK(anyface_audio_new(nothing, 16000, 1, 16000, &silence, &error));
    CHECK(anyface_audio_peak(silence) == 0.0f);
    CHECK_OK(anyface_motion_new(emotion, silence, NULL, NULL, &motion, &error));
    CHECK_OK(anyface_motion_copy_mask(motion, emotion, face, 0, mask, count, &error));
    CHECK_FAILS(anyface_motion_copy_mask(motion, engine, face, 0, mask, count, &error),
                ANYFACE_STATUS_INVALID_INPUT, "got freetalk");
    anyface_motion_free(motion);
    anyface_audio_free(silence);
    free(mask);
    anyface_engine_free(emotion);
}

int main(int argc, char **argv) {
    CHECK(argc == 4);
    AnyfaceEngine *engine = NULL;
    AnyfaceMesh *mesh = NULL;
    AnyfaceAudio *audio = NULL;
    AnyfaceFace *face = NULL;
    CHECK_OK(anyface_engine_new(NULL, &engine, &error));
    CHECK_OK(anyface_mesh_read(argv[1], &mesh, &error));
    CHECK_OK(anyface_audio_read(argv[3], &audio, &error));
    AnyfaceRequest *request = NULL;
    CHECK_OK(anyface_request_new(&request, &error));
    CHECK_OK(anyface_request_set_text(request, "landmarks", read_text(argv[2]), &error));
    CHECK_OK(anyface_face_new(engine, mesh, request, NULL, &face, &error));

    landmarks(face);
    parts(face);
    found_alone(engine, mesh, face);
    motion_of_the_host(engine, face);
    block_by_block(engine, face);
    performed_again(engine, audio);
    mended(engine, audio);
    said(engine, audio);
    masks(engine, face, audio);
    two_at_once(engine, face, audio);
    any_number_of_threads(mesh, request, audio);
    cancelling(engine, face, audio);

    anyface_request_free(request);
    anyface_face_free(face);
    anyface_audio_free(audio);
    anyface_mesh_free(mesh);
    anyface_engine_free(engine);
    puts("ok");
    return 0;
}
