/*
 * Head, eyes and tongue beside a performance: what they say, how strengths reach them, and what is refused.
 *
 *     life VOICE.wav MOTION.npz
 */
#include "check.h"

static AnyfaceError *error = NULL;

static AnyfaceMotion *spoken(const AnyfaceEngine *engine, const AnyfaceAudio *audio, float head,
                             float gaze) {
    AnyfaceRequest *request = NULL;
    CHECK_OK(anyface_request_new(&request, &error));
    CHECK_OK(anyface_request_set_number(request, "head_motion", (double)head, &error));
    CHECK_OK(anyface_request_set_number(request, "gaze", (double)gaze, &error));
    AnyfaceMotion *motion = NULL;
    CHECK_OK(anyface_motion_new(engine, audio, request, NULL, &motion, &error));
    anyface_request_free(request);
    return motion;
}

static float largest(const float *values, size_t count) {
    float most = 0.0f;
    for (size_t i = 0; i < count; i++) {
        float size = values[i] < 0.0f ? -values[i] : values[i];
        most = size > most ? size : most;
    }
    return most;
}

/* The largest angle of the head and of the eyes, radians. */
static void angles(const AnyfaceMotion *motion, float *head, float *gaze) {
    size_t frames = anyface_motion_frame_count(motion);
    float *turns = malloc(7 * frames * sizeof *turns);
    CHECK(turns != NULL && frames > 0);
    CHECK_OK(anyface_motion_copy_head(motion, turns, 3 * frames, &error));
    CHECK_OK(anyface_motion_copy_gaze(motion, turns + 3 * frames, 4 * frames, &error));
    *head = largest(turns, 3 * frames);
    *gaze = largest(turns + 3 * frames, 4 * frames);
    free(turns);
}

/* The largest share of the tongue, whose shares all are within 0 and 1. */
static float tongue(const AnyfaceMotion *motion) {
    size_t count = 4 * anyface_motion_frame_count(motion);
    float *shares = malloc(count * sizeof *shares);
    CHECK(shares != NULL);
    CHECK_OK(anyface_motion_copy_tongue(motion, shares, count, &error));
    for (size_t i = 0; i < count; i++) CHECK(shares[i] >= 0.0f && shares[i] <= 1.0f);
    float most = largest(shares, count);
    free(shares);
    return most;
}

static void wrong_calls(const AnyfaceMotion *motion) {
    float *none = NULL;
    float few[3] = {7.0f, 7.0f, 7.0f};
    CHECK_FAILS(anyface_motion_copy_head(motion, none, 3, &error), ANYFACE_STATUS_INVALID_INPUT,
                "expected");
    CHECK_FAILS(anyface_motion_copy_gaze(motion, few, 3, &error), ANYFACE_STATUS_INVALID_INPUT,
                "expected");
    CHECK_FAILS(anyface_motion_copy_tongue(motion, few, 3, &error), ANYFACE_STATUS_INVALID_INPUT,
                "expected");
    CHECK(few[0] == 7.0f);
}

int main(int argc, char **argv) {
    CHECK(argc == 3);
    AnyfaceEngine *engine = NULL;
    AnyfaceAudio *audio = NULL;
    CHECK_OK(anyface_engine_new(NULL, &engine, &error));
    CHECK_OK(anyface_audio_read(argv[1], &audio, &error));

    AnyfaceMotion *motion = spoken(engine, audio, 1.0f, 1.0f);
    float head = 0.0f, gaze = 0.0f;
    angles(motion, &head, &gaze);
    CHECK(head > 0.001f && head < 0.09f);
    CHECK(gaze > 0.01f && gaze < 0.4f);
    CHECK(tongue(motion) > 0.0f);
    wrong_calls(motion);
    CHECK_OK(anyface_motion_write(motion, argv[2], &error));

    AnyfaceRequest *still = NULL;
    CHECK_OK(anyface_request_new(&still, &error));
    CHECK_OK(anyface_request_set_number(still, "head_motion", 0.0, &error));
    CHECK_OK(anyface_request_set_number(still, "gaze", 0.0, &error));
    CHECK_OK(anyface_request_set_number(still, "articulation", 0.0, &error));
    AnyfaceMotion *again = NULL;
    CHECK_OK(anyface_motion_new_again(engine, motion, still, &again, &error));
    anyface_request_free(still);
    angles(again, &head, &gaze);
    CHECK(head == 0.0f && gaze == 0.0f && tongue(again) == 0.0f);
    anyface_motion_free(again);
    // FreeTalk does not tell what is said from what is felt.
    CHECK(anyface_motion_new_content(engine, motion, NULL, &again, NULL) ==
          ANYFACE_STATUS_INVALID_INPUT);
    anyface_motion_free(motion);

    static float moved[2 * 3 * ANYFACE_LANDMARK_COUNT];
    AnyfaceMotion *given = NULL;
    CHECK_OK(anyface_motion_new_displacements(moved, 2, 24.0, &given, &error));
    angles(given, &head, &gaze);
    CHECK(head == 0.0f && gaze == 0.0f && tongue(given) == 0.0f);
    anyface_motion_free(given);

    anyface_audio_free(audio);
    anyface_engine_free(engine);
    puts("ok");
    return 0;
}
