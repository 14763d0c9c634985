/*
 * Sliders of a finished take: what they say of themselves, and what they refuse.
 *
 *     sliders HEAD.obj LANDMARKS.json VOICE.wav
 */
#include "check.h"
#include "text.h"

static AnyfaceError *error = NULL;

typedef struct {
    AnyfaceMotion *motion;
    AnyfaceClip *clip;
    AnyfaceBasis *basis;
} Take;

static Take take_of(const AnyfaceEngine *engine, const AnyfaceFace *face, AnyfaceMotion *motion) {
    Take take = {.motion = motion};
    CHECK_OK(anyface_clip_new(engine, face, motion, NULL, &take.clip, &error));
    float limit = 0.01f * anyface_clip_largest_displacement(take.clip);
    CHECK_OK(anyface_basis_new(engine, take.clip, limit, 256, NULL, &take.basis, &error));
    return take;
}

static void free_take(Take take) {
    anyface_motion_free(take.motion);
    anyface_clip_free(take.clip);
    anyface_basis_free(take.basis);
}

static Take happy(const AnyfaceEngine *engine, const AnyfaceFace *face,
                  const AnyfaceAudio *audio) {
    AnyfaceRequest *request = NULL;
    CHECK_OK(anyface_request_new(&request, &error));
    CHECK_OK(anyface_request_set_text(request, "emotion", "happy:0.8", &error));
    CHECK_OK(anyface_request_set_number(request, "blinks_per_minute", 0.0, &error));
    AnyfaceMotion *motion = NULL;
    CHECK_OK(anyface_motion_new(engine, audio, request, NULL, &motion, &error));
    anyface_request_free(request);
    return take_of(engine, face, motion);
}

/* Knots rise around 1, and away from it something changes. */
static void articulation_and_emotion_act(const AnyfaceSliders *sliders, size_t count) {
    for (int32_t slider = ANYFACE_SLIDER_ARTICULATION; slider <= ANYFACE_SLIDER_EMOTION; slider++) {
        float knots[3];
        size_t knot_count = anyface_sliders_knot_count(sliders, slider);
        CHECK(knot_count == (slider == ANYFACE_SLIDER_EMOTION ? 3 : 2));
        CHECK_OK(anyface_sliders_copy_knots(sliders, slider, knots, knot_count, &error));
        CHECK(knots[0] == 0.0f && knots[knot_count - 1] > 1.0f);
        float *changes = malloc(knot_count * count * sizeof *changes);
        float largest = 0.0f;
        CHECK(changes != NULL);
        CHECK_OK(anyface_sliders_copy_changes(sliders, slider, changes, knot_count * count, &error));
        for (size_t i = 0; i < knot_count * count; i++) {
            largest = changes[i] > largest ? changes[i] : largest;
        }
        CHECK(largest > 0.05f && largest < 100.0f);
        CHECK_FAILS(anyface_sliders_copy_changes(sliders, slider, changes, count, &error),
                    ANYFACE_STATUS_INVALID_INPUT, "expected room for");
        free(changes);
    }
    CHECK(anyface_sliders_knot_count(sliders, ANYFACE_SLIDER_BLINKS) == 0);
    CHECK(anyface_sliders_knot_count(NULL, ANYFACE_SLIDER_EMOTION) == 0);
    CHECK_FAILS(anyface_sliders_copy_knots(sliders, 99, NULL, 0, &error),
                ANYFACE_STATUS_INVALID_INPUT, "got 99");
}

static void wrong_calls(const AnyfaceEngine *engine, const AnyfaceFace *face, Take take) {
    static float moved[2 * 3 * ANYFACE_LANDMARK_COUNT];
    moved[3 * ANYFACE_LANDMARK_COUNT + 3 * 8 + 1] = -0.01f;
    AnyfaceMotion *given = NULL;
    AnyfaceSliders *sliders = NULL;
    CHECK_OK(anyface_motion_new_displacements(moved, 2, 24.0, &given, &error));
    Take own = take_of(engine, face, given);
    CHECK_FAILS(anyface_sliders_new(engine, face, take.motion, own.clip, take.basis, NULL, &sliders,
                                    &error),
                ANYFACE_STATUS_INVALID_INPUT, "sliders: expected");
    CHECK_FAILS(anyface_sliders_new(engine, face, NULL, take.clip, take.basis, NULL, &sliders,
                                    &error),
                ANYFACE_STATUS_NULL_POINTER, "motion");
    AnyfaceProgress *progress = anyface_progress_new(NULL, NULL);
    anyface_progress_cancel(progress);
    CHECK_FAILS(anyface_sliders_new(engine, face, take.motion, take.clip, take.basis, progress,
                                    &sliders, &error),
                ANYFACE_STATUS_CANCELLED, "cancelled");
    anyface_progress_free(progress);
    CHECK(sliders == NULL);
    CHECK_OK(anyface_sliders_new(engine, face, given, own.clip, own.basis, NULL, &sliders, &error));
    CHECK(anyface_sliders_knot_count(sliders, ANYFACE_SLIDER_ARTICULATION) == 0);
    anyface_sliders_free(sliders);
    free_take(own);
}

int main(int argc, char **argv) {
    CHECK(argc == 4);
    AnyfaceEngine *engine = NULL;
    AnyfaceMesh *mesh = NULL;
    AnyfaceAudio *audio = NULL;
    AnyfaceFace *face = NULL;
    AnyfaceSliders *sliders = NULL;
    AnyfaceRequest *request = NULL;
    CHECK_OK(anyface_request_new(&request, &error));
    CHECK_OK(anyface_request_set_text(request, "landmarks", read_text(argv[2]), &error));
    CHECK_OK(anyface_engine_new(NULL, &engine, &error));
    CHECK_OK(anyface_mesh_read(argv[1], &mesh, &error));
    CHECK_OK(anyface_audio_read(argv[3], &audio, &error));
    CHECK_OK(anyface_face_new(engine, mesh, request, NULL, &face, &error));
    anyface_request_free(request);

    Take take = happy(engine, face, audio);
    size_t count = anyface_clip_frame_count(take.clip) * anyface_basis_shape_count(take.basis);
    CHECK_OK(anyface_sliders_new(engine, face, take.motion, take.clip, take.basis, NULL, &sliders,
                                 &error));
    wrong_calls(engine, face, take);
    free_take(take);
    articulation_and_emotion_act(sliders, count);

    anyface_sliders_free(sliders);
    anyface_sliders_free(NULL);
    anyface_face_free(face);
    anyface_audio_free(audio);
    anyface_mesh_free(mesh);
    anyface_engine_free(engine);
    puts("ok");
    return 0;
}
