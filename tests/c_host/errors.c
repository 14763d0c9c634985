/*
 * Wrong calls: each gives its status and a message, writes no result and never crashes.
 *
 *     errors FOLDER      FOLDER can be written to
 */
#include "check.h"

#include <math.h>
#include <stddef.h>

static AnyfaceError *error = NULL;
static char mark;

/* What an out-pointer holds before a call that fails, and must hold after it. */
#define MARK(type) ((type *)(void *)&mark)

static const float square[] = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0, 0, 0, 1, 1, 0, 1, 1, 1, 1, 0, 1, 1};
static const uint32_t triangles[] = {0, 1, 2, 0, 2, 3, 4, 6, 5, 4, 7, 6, 0, 4, 5, 0, 5, 1};

static void versions_and_names(void) {
    CHECK(anyface_abi_version() == ANYFACE_ABI_VERSION);
    CHECK(strchr(anyface_version(), '.') != NULL);
    CHECK(strcmp(anyface_status_name(ANYFACE_STATUS_FACE_NOT_FOUND), "face not found") == 0);
    CHECK(strcmp(anyface_status_name(12345), "unknown") == 0);
    CHECK(strstr(anyface_describe(), "\"neutral\",\"happy\"") != NULL);
    CHECK(strcmp(anyface_error_message(NULL), "") == 0);
    CHECK(anyface_error_status(NULL) == ANYFACE_STATUS_OK);
}

static void meshes(void) {
    AnyfaceMesh *mesh = MARK(AnyfaceMesh);
    CHECK_FAILS(anyface_mesh_new(NULL, 8, triangles, 6, &mesh, &error),
                ANYFACE_STATUS_NULL_POINTER, "positions");
    CHECK_FAILS(anyface_mesh_new(square, 8, NULL, 6, &mesh, &error), ANYFACE_STATUS_NULL_POINTER,
                "triangles");
    CHECK_FAILS(anyface_mesh_new(square, 8, triangles, 6, NULL, &error),
                ANYFACE_STATUS_NULL_POINTER, "out");
    CHECK_FAILS(anyface_mesh_new(square, SIZE_MAX / 2, triangles, 6, &mesh, &error),
                ANYFACE_STATUS_INVALID_INPUT, "positions");
    CHECK_FAILS(anyface_mesh_new(NULL, 0, NULL, 0, &mesh, &error), ANYFACE_STATUS_MESH, "vertices");
    CHECK_FAILS(anyface_mesh_new(square, 4, triangles, 6, &mesh, &error), ANYFACE_STATUS_MESH, "");
    float broken[24];
    memcpy(broken, square, sizeof broken);
    broken[7] = NAN;
    CHECK_FAILS(anyface_mesh_new(broken, 8, triangles, 6, &mesh, &error), ANYFACE_STATUS_MESH,
                "finite");
    CHECK(mesh == MARK(AnyfaceMesh));

    /* No place for the error: the status alone. */
    CHECK(anyface_mesh_new(NULL, 8, triangles, 6, &mesh, NULL) == ANYFACE_STATUS_NULL_POINTER);
    CHECK(mesh == MARK(AnyfaceMesh));
}

static void polygons(void) {
    const uint32_t corners[] = {0, 1, 2, 3, 4, 7, 6, 5, 0, 4, 5, 1, 1, 5, 6, 2};
    const uint32_t sizes[] = {4, 4, 4, 4};
    AnyfaceMesh *mesh = NULL;
    CHECK_OK(anyface_mesh_new_polygons(square, 8, sizes, 4, corners, 16, &mesh, &error));
    CHECK(anyface_mesh_vertex_count(mesh) == 8);
    CHECK(anyface_mesh_triangle_count(mesh) == 8);
    float positions[24];
    CHECK_OK(anyface_mesh_copy_positions(mesh, positions, 24, &error));
    CHECK(memcmp(positions, square, sizeof square) == 0);
    CHECK_FAILS(anyface_mesh_copy_positions(mesh, positions, 8, &error),
                ANYFACE_STATUS_INVALID_INPUT, "24");
    uint32_t cut[24];
    CHECK_OK(anyface_mesh_copy_triangles(mesh, cut, 24, &error));
    CHECK(cut[0] < 8 && cut[23] < 8);
    anyface_mesh_free(mesh);
    mesh = MARK(AnyfaceMesh);
    CHECK_FAILS(anyface_mesh_new_polygons(square, 8, sizes, 4, corners, 15, &mesh, &error),
                ANYFACE_STATUS_INVALID_INPUT, "16");
    CHECK(mesh == MARK(AnyfaceMesh));
    CHECK(anyface_mesh_vertex_count(NULL) == 0 && anyface_mesh_triangle_count(NULL) == 0);
}

static void weights(void) {
    const char *names[] = {"jawOpen", "tongueOut"};
    const float shapes[12] = {1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0};
    float motion[6] = {0.5f, 0, 0, 0, 0.25f, 0}, found[2] = {0, 0};
    AnyfaceWeights *solved = NULL;
    CHECK_OK(anyface_weights_new(names, shapes, 2, motion, 1, 2, NULL, 0, NULL, &solved, &error));
    CHECK_OK(anyface_weights_copy(solved, found, 2, &error));
    CHECK(fabsf(found[0] - 0.5f) < 3e-3f && fabsf(found[1] - 0.25f) < 3e-3f);
    CHECK(anyface_weights_left_out(solved) < 0.01f && anyface_weights_left_out(NULL) == 0.0f);
    CHECK_FAILS(anyface_weights_copy(solved, found, 3, &error), ANYFACE_STATUS_INVALID_INPUT, "2");
    CHECK_FAILS(anyface_weights_write(solved, "weights.txt", 25.0, &error),
                ANYFACE_STATUS_INVALID_INPUT, ".csv");
    anyface_weights_free(solved);
    anyface_weights_free(NULL);
    solved = MARK(AnyfaceWeights);
    CHECK_FAILS(anyface_weights_new(NULL, shapes, 2, motion, 1, 2, NULL, 0, NULL, &solved, &error),
                ANYFACE_STATUS_NULL_POINTER, "names");
    CHECK_FAILS(anyface_weights_new(names, shapes, 2, NULL, 1, 2, NULL, 0, NULL, &solved, &error),
                ANYFACE_STATUS_NULL_POINTER, "displacements");
    motion[0] = NAN;
    CHECK_FAILS(anyface_weights_new(names, shapes, 2, motion, 1, 2, NULL, 0, NULL, &solved, &error),
                ANYFACE_STATUS_INVALID_INPUT, "finite");
    CHECK(solved == MARK(AnyfaceWeights));
}

static void sounds(void) {
    static float samples[16000];
    AnyfaceAudio *audio = MARK(AnyfaceAudio);
    CHECK_FAILS(anyface_audio_new(samples, 0, 1, 16000, &audio, &error), ANYFACE_STATUS_AUDIO, "");
    CHECK_FAILS(anyface_audio_new(samples, 100, 0, 16000, &audio, &error), ANYFACE_STATUS_AUDIO,
                "channels");
    CHECK_FAILS(anyface_audio_new(samples, 100, 1, 7, &audio, &error), ANYFACE_STATUS_AUDIO, "7");
    CHECK_FAILS(anyface_audio_new(NULL, 100, 1, 16000, &audio, &error),
                ANYFACE_STATUS_NULL_POINTER, "samples");
    samples[99] = INFINITY;
    CHECK_FAILS(anyface_audio_new(samples, 100, 1, 16000, &audio, &error), ANYFACE_STATUS_AUDIO,
                "finite");
    samples[99] = 0.5f;
    CHECK(audio == MARK(AnyfaceAudio));

    CHECK_OK(anyface_audio_new(samples, 8000, 2, 16000, &audio, &error));
    CHECK(fabs(anyface_audio_duration_s(audio) - 0.5) < 1e-9);
    CHECK(anyface_audio_peak(audio) == 0.25f); /* the mean of two channels */
    AnyfaceAudio *part = MARK(AnyfaceAudio);
    CHECK_FAILS(anyface_audio_trim(audio, -1.0, 1.0, &part, &error), ANYFACE_STATUS_INVALID_INPUT,
                "start_s");
    CHECK_FAILS(anyface_audio_trim(audio, 0.5, 1.0, &part, &error), ANYFACE_STATUS_AUDIO, "");
    CHECK(part == MARK(AnyfaceAudio));
    CHECK_OK(anyface_audio_trim(audio, 0.1, 0.2, &part, &error));
    CHECK(fabs(anyface_audio_duration_s(part) - 0.2) < 1e-9);
    anyface_audio_free(part);
    anyface_audio_free(audio);
    CHECK(anyface_audio_duration_s(NULL) == 0.0 && anyface_audio_peak(NULL) == 0.0f);
}

static void files(const char *folder) {
    char path[4096];
    snprintf(path, sizeof path, "%s/nothing here", folder);
    AnyfaceMesh *mesh = MARK(AnyfaceMesh);
    AnyfaceAudio *audio = MARK(AnyfaceAudio);
    CHECK_FAILS(anyface_mesh_read(path, &mesh, &error), ANYFACE_STATUS_IO, "nothing here");
    CHECK_FAILS(anyface_audio_read(path, &audio, &error), ANYFACE_STATUS_IO, "nothing here");
    CHECK_FAILS(anyface_mesh_read(NULL, &mesh, &error), ANYFACE_STATUS_NULL_POINTER, "path");
    CHECK_FAILS(anyface_mesh_read("", &mesh, &error), ANYFACE_STATUS_INVALID_INPUT, "path");
    CHECK_FAILS(anyface_mesh_read("\xff\xfe", &mesh, &error), ANYFACE_STATUS_INVALID_INPUT, "UTF-8");

    snprintf(path, sizeof path, "%s/text.wav", folder);
    FILE *file = fopen(path, "wb");
    CHECK(file != NULL && fputs("this is no sound, and no mesh either", file) >= 0);
    fclose(file);
    CHECK_FAILS(anyface_audio_read(path, &audio, &error), ANYFACE_STATUS_AUDIO, "");
    CHECK_FAILS(anyface_mesh_read(path, &mesh, &error), ANYFACE_STATUS_MESH, "");
    CHECK(mesh == MARK(AnyfaceMesh) && audio == MARK(AnyfaceAudio));
}

static void options(const char *folder) {
    const AnyfaceStatus invalid = ANYFACE_STATUS_INVALID_INPUT;
    AnyfaceRequest *request = NULL;
    AnyfaceEngine *engine = MARK(AnyfaceEngine);
    CHECK_OK(anyface_request_new(&request, &error));
    CHECK_OK(anyface_request_set_text(request, "cache", "off", &error));
    CHECK_FAILS(anyface_request_set_number(request, "cache", 17.0, &error), invalid, "17");
    CHECK_FAILS(anyface_request_set_number(request, "threads", 1.5, &error), invalid, "1.5");
    CHECK_FAILS(anyface_request_set_number(request, "by_field", 2.0, &error), invalid, "0 or 1");
    CHECK_FAILS(anyface_request_set_text(request, "forward", "z", &error), invalid, "+z");
    const double rows[4] = {1.0, 7.0, -1.0, 0.5};
    CHECK_FAILS(anyface_request_set_rows(request, "part_roles", NULL, rows, 1, 2, &error), invalid,
                "got 7");
    CHECK_FAILS(anyface_request_set_rows(request, "object_of_vertex", NULL, rows, 4, 1, &error),
                invalid, "got 0.5");
    CHECK_FAILS(anyface_request_set_rows(request, "landmarks", NULL, rows, 2, 2, &error), invalid,
                "68 rows of 3");
    CHECK_FAILS(anyface_request_set_rows(request, "fixed_landmarks", rows, rows, 1, 4, &error),
                invalid, "with times");
    char path[4096];
    snprintf(path, sizeof path, "%s/no weights", folder);
    CHECK_OK(anyface_request_set_text(request, "weights_dir", path, &error));
    CHECK_FAILS(anyface_engine_new(request, &engine, &error), ANYFACE_STATUS_WEIGHTS, "no weights");
    CHECK_OK(anyface_request_set_text(request, "weights_dir", "", &error));
    CHECK_OK(anyface_request_set_text(request, "system", "shouting", &error));
    CHECK_FAILS(anyface_engine_new(request, &engine, &error), invalid, "shouting");
    CHECK(engine == MARK(AnyfaceEngine));
    anyface_request_free(request);
}

static void systems_are_described(void) {
    const char *const parts[] = {"\"cafe-talk\"", "\"controls\"", "\"articulation\"", "\"neutral_voice\"",
                                 "\"lip corner puller\"", "\"jaw drop\""};
    for (size_t i = 0; i < sizeof parts / sizeof *parts; i++) {
        CHECK(strstr(anyface_describe(), parts[i]) != NULL);
    }
}

/* What a request refuses leaves it as it was; what it takes needs no copy of the caller. */
static void requests(void) {
    const AnyfaceStatus invalid = ANYFACE_STATUS_INVALID_INPUT;
    AnyfaceRequest *request = NULL;
    CHECK_OK(anyface_request_new(&request, &error));
    CHECK_OK(anyface_request_set_text(request, "emotion", "auto", &error));
    CHECK_OK(anyface_request_set_text(request, "seed", "18446744073709551615", &error));
    CHECK_OK(anyface_request_set_text(request, "text", "", &error));
    CHECK_FAILS(anyface_request_set_text(request, "emotion", "joyful:1", &error), invalid, "joyful");
    CHECK_OK(anyface_request_set_text(request, "fps", "24", &error));
    CHECK_FAILS(anyface_request_set_text(request, "fps", "fast", &error), invalid, "a number");
    CHECK_FAILS(anyface_request_set_text(request, "nothing", "x", &error), invalid, "emotion_of");
    CHECK_FAILS(anyface_request_set_text(request, "nothing", "x", &error), invalid, "landmarks");
    CHECK_FAILS(anyface_request_set_number(request, "fps", NAN, &error), invalid, "1 to 240");
    CHECK_FAILS(anyface_request_set_number(NULL, "fps", 24.0, &error), ANYFACE_STATUS_NULL_POINTER,
                "request");
    const double rows[2] = {0.4, 0.2};
    CHECK_FAILS(anyface_request_set_rows(request, "closures", NULL, rows, 1, 2, &error), invalid,
                "closures");
    CHECK_FAILS(anyface_request_set_rows(request, "articulation", NULL, rows, 2, 1, &error), invalid,
                "with times");
    CHECK_FAILS(anyface_request_set_rows(request, "closures", NULL, rows, SIZE_MAX, 2, &error),
                invalid, "values");
    CHECK_FAILS(anyface_request_set_sound(request, "neutral_voice", NULL, &error),
                ANYFACE_STATUS_NULL_POINTER, "sound");
    CHECK_FAILS(anyface_request_set_motion(request, "starts_from", NULL, &error),
                ANYFACE_STATUS_NULL_POINTER, "motion");
    anyface_request_free(request);
    anyface_request_free(NULL);
}

static void motions(void) {
    static float moved[2 * 3 * ANYFACE_LANDMARK_COUNT], copy[2 * 3 * ANYFACE_LANDMARK_COUNT];
    const size_t count = sizeof moved / sizeof *moved;
    moved[200] = 0.01f;
    AnyfaceMotion *motion = MARK(AnyfaceMotion);
    CHECK_FAILS(anyface_motion_new_displacements(moved, 0, 25.0, &motion, &error),
                ANYFACE_STATUS_INVALID_INPUT, "frame");
    CHECK_FAILS(anyface_motion_new_displacements(moved, 2, 0.0, &motion, &error),
                ANYFACE_STATUS_INVALID_INPUT, "fps");
    moved[300] = NAN;
    CHECK_FAILS(anyface_motion_new_displacements(moved, 2, 25.0, &motion, &error),
                ANYFACE_STATUS_INVALID_INPUT, "frame 1, landmark 32");
    moved[300] = 2000.0f;
    CHECK_FAILS(anyface_motion_new_displacements(moved, 2, 25.0, &motion, &error),
                ANYFACE_STATUS_INVALID_INPUT, "at most 10 m");
    moved[300] = 0.0f;
    CHECK(motion == MARK(AnyfaceMotion));
    CHECK_OK(anyface_motion_new_displacements(moved, 2, 25.0, &motion, &error));
    CHECK(anyface_motion_frame_count(motion) == 2 && anyface_motion_fps(motion) == 25.0);
    CHECK_OK(anyface_motion_copy_displacements(motion, copy, count, &error));
    CHECK(memcmp(moved, copy, sizeof moved) == 0);
    CHECK_FAILS(anyface_motion_copy_displacements(motion, copy, 5, &error),
                ANYFACE_STATUS_INVALID_INPUT, "408");
    CHECK_FAILS(anyface_motion_copy_weights(motion, copy, count, &error),
                ANYFACE_STATUS_INVALID_INPUT, "got landmarks");
    CHECK_FAILS(anyface_motion_write(motion, "motion.txt", &error), ANYFACE_STATUS_INVALID_INPUT,
                ".npz");
    anyface_motion_free(motion);
}

static void missing_handles(void) {
    AnyfaceFace *face = MARK(AnyfaceFace);
    AnyfaceMotion *motion = MARK(AnyfaceMotion);
    AnyfaceClip *clip = MARK(AnyfaceClip);
    const AnyfaceStatus null_pointer = ANYFACE_STATUS_NULL_POINTER;
    float value;
    CHECK_FAILS(anyface_face_new(NULL, NULL, NULL, NULL, &face, &error), null_pointer, "engine");
    CHECK_FAILS(anyface_motion_new(NULL, NULL, NULL, NULL, &motion, &error), null_pointer, "engine");
    CHECK_FAILS(anyface_motion_new_again(NULL, NULL, NULL, &motion, &error), null_pointer, "engine");
    CHECK_FAILS(anyface_face_find(NULL, NULL, NULL, NULL, &face, &error), null_pointer, "engine");
    CHECK_FAILS(anyface_clip_new(NULL, NULL, NULL, NULL, &clip, &error), null_pointer, "engine");
    CHECK(anyface_clip_visibility(NULL) == -1 && anyface_face_metres_per_unit(NULL) == 0.0);
    CHECK_FAILS(anyface_engine_animate(NULL, NULL, NULL, NULL, NULL, &clip, &error), null_pointer,
                "engine");
    CHECK_FAILS(anyface_face_copy_landmarks(NULL, &value, NULL, NULL, &error), null_pointer, "face");
    CHECK_FAILS(anyface_face_copy_to_canonical(NULL, &value, 12, &error), null_pointer, "face");
    CHECK_FAILS(anyface_motion_copy_head(NULL, &value, 1, &error), null_pointer, "motion");
    CHECK_FAILS(anyface_motion_copy_gaze(NULL, &value, 1, &error), null_pointer, "motion");
    CHECK_FAILS(anyface_motion_copy_tongue(NULL, &value, 1, &error), null_pointer, "motion");
    CHECK_FAILS(anyface_face_write_landmarks(NULL, "x", &error), null_pointer, "face");
    CHECK_FAILS(anyface_clip_copy_landmarks_neutral(NULL, &value, 1, &error), null_pointer, "clip");
    CHECK_FAILS(anyface_clip_copy_landmark_displacements(NULL, &value, 1, &error), null_pointer,
                "clip");
    CHECK_FAILS(anyface_clip_write(NULL, NULL, "x.npz", &error), null_pointer, "clip");
    CHECK_FAILS(anyface_clip_write_shapes(NULL, NULL, "x.vrma", &error), null_pointer, "clip");
    CHECK_FAILS(anyface_rig_write(NULL, NULL, "x.vrm", &error), null_pointer, "rig");
    CHECK_FAILS(anyface_motion_copy_displacements(NULL, &value, 1, &error), null_pointer, "motion");
    CHECK(anyface_progress_read(NULL, NULL, NULL) == null_pointer);
    CHECK(face == MARK(AnyfaceFace) && motion == MARK(AnyfaceMotion) && clip == MARK(AnyfaceClip));
    CHECK(anyface_clip_frame_count(NULL) == 0 && anyface_clip_vertex_count(NULL) == 0);
    CHECK(anyface_clip_fps(NULL) == 0.0 && anyface_clip_displacements(NULL) == NULL);
    CHECK(anyface_clip_largest_displacement(NULL) == 0.0f && anyface_face_vertex_count(NULL) == 0);
    CHECK(anyface_motion_frame_count(NULL) == 0 && anyface_motion_fps(NULL) == 0.0);
    CHECK(anyface_motion_heard_emotion(NULL) == NULL);
}

static void spoken_sounds(void) {
    const AnyfaceStatus null_pointer = ANYFACE_STATUS_NULL_POINTER;
    AnyfaceSounds *heard = NULL;
    CHECK_FAILS(anyface_sounds_new(NULL, NULL, &heard, &error), null_pointer, "engine");
    CHECK_FAILS(anyface_sounds_read("x.TextGrid", 0.0, &heard, &error), ANYFACE_STATUS_INVALID_INPUT,
                "fps");
    CHECK_FAILS(anyface_sounds_read("x.abc", 24.0, &heard, &error), ANYFACE_STATUS_INVALID_INPUT,
                ".TextGrid");
    CHECK_FAILS(anyface_sounds_read("not-there.tsv", 24.0, &heard, &error), ANYFACE_STATUS_IO,
                "not-there.tsv");
    CHECK_FAILS(anyface_sounds_write(NULL, "x.tsv", 24.0, &error), null_pointer, "sounds");
    CHECK_FAILS(anyface_sounds_new_with_text(NULL, NULL, "a", &heard, &error), null_pointer, "engine");
    CHECK(heard == NULL);
    CHECK(anyface_sounds_interval_count(NULL, ANYFACE_TIER_WORDS) == 0);
    CHECK(anyface_sounds_label(NULL, ANYFACE_TIER_PHONES, 0) == NULL);
    CHECK(anyface_sounds_label_closes_lips("P") == 1 && anyface_sounds_label_closes_lips("f") == 0);
    CHECK(anyface_sounds_label_closes_lips(NULL) == 0);
    anyface_sounds_free(NULL);
}

static void events(void) {
    const AnyfaceStatus null_pointer = ANYFACE_STATUS_NULL_POINTER;
    const AnyfaceStatus invalid = ANYFACE_STATUS_INVALID_INPUT;
    char *json = &mark;
    CHECK_FAILS(anyface_events_read(NULL, NULL, &json, &error), null_pointer, "text");
    CHECK_FAILS(anyface_events_read(NULL, "0.5-1:12", NULL, &error), null_pointer, "json");
    CHECK_FAILS(anyface_events_read(NULL, "[1, 2", &json, &error), invalid, "expected a JSON list");
    CHECK_FAILS(anyface_events_read(NULL, "0-1:12\n0-1:99", &json, &error), invalid, "event 2");
    CHECK_FAILS(anyface_events_read(NULL, "0.5-0.5:12", &json, &error), invalid, "slot");
    CHECK_FAILS(anyface_events_read(NULL, "0.5-1:12:9", &json, &error), invalid, "strength");
    CHECK(json == &mark);
    CHECK_OK(anyface_events_read(NULL, "0.5-1:12,45L\n", &json, &error));
    CHECK(strstr(json, "[\"12\",\"45L\"]") != NULL);
    AnyfaceRequest *request = NULL;
    CHECK_OK(anyface_request_new(&request, &error));
    CHECK_OK(anyface_request_set_text(request, "events", json, &error));
    CHECK_OK(anyface_request_set_text(request, "events", "0.5-1:left wink:0.8", &error));
    CHECK_FAILS(anyface_request_set_text(request, "events", "1-0:smile", &error), invalid, "event 1");
    anyface_request_free(request);
    anyface_text_free(json);
    anyface_text_free(NULL);
    json = &mark;
    CHECK_FAILS(anyface_motion_notes(NULL, NULL, NULL, NULL, &json, &error), null_pointer, "engine");
    CHECK(json == &mark);

    float value = 7.0f;
    CHECK_FAILS(anyface_motion_copy_weights(NULL, &value, 1, &error), null_pointer, "motion");
    CHECK(anyface_motion_weight_count(NULL) == 0 && anyface_motion_weight_name(NULL, 0) == NULL);
    const char *names[] = {"jawOpen", "tongueOut"};
    AnyfaceWeights *weights = MARK(AnyfaceWeights);
    CHECK_FAILS(anyface_weights_new_from_array(names, NULL, 2, 1, &weights, &error), null_pointer,
                "weights");
    CHECK(value == 7.0f && weights == MARK(AnyfaceWeights));
}

/* A megabyte of one word. */
static void long_texts(void) {
    size_t length = (size_t)1 << 20;
    char *text = malloc(length + 1);
    CHECK(text != NULL);
    memset(text, 'a', length);
    memcpy(text, "0-1:", 4);
    text[length] = 0;
    char *json = &mark;
    CHECK_FAILS(anyface_events_read(NULL, text, &json, &error), ANYFACE_STATUS_INVALID_INPUT,
                "at most 1000 letters, got 1048576");
    CHECK_FAILS(anyface_expression_read(NULL, text, &json, &error), ANYFACE_STATUS_INVALID_INPUT,
                "at most 1000 letters, got 1048576");
    text[0] = '[';
    CHECK_FAILS(anyface_events_read(NULL, text, &json, &error), ANYFACE_STATUS_INVALID_INPUT,
                "expected a JSON list");
    CHECK(json == &mark);
    free(text);
}

static void freeing_null(void) {
    anyface_error_free(NULL);
    anyface_engine_free(NULL);
    anyface_mesh_free(NULL);
    anyface_audio_free(NULL);
    anyface_face_free(NULL);
    anyface_motion_free(NULL);
    anyface_clip_free(NULL);
    anyface_progress_free(NULL);
    anyface_progress_cancel(NULL);
}

int main(int argc, char **argv) {
    CHECK(argc == 2);
    versions_and_names();
    meshes();
    polygons();
    weights();
    sounds();
    files(argv[1]);
    options(argv[1]);
    systems_are_described();
    requests();
    motions();
    missing_handles();
    spoken_sounds();
    events();
    long_texts();
    freeing_null();
    puts("ok");
    return 0;
}
