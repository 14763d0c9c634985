/*
 * Says what a face does beside its speech, and writes the weights of ARKit's shapes as a table.
 *
 *     events VOICE.wav OUT.csv [EVENTS]
 *     events voice.wav out.csv
 *     events voice.wav out.csv '0.2-0.5:left wink:0.8'
 *     events voice.wav out.csv '[{"start_s": 0.2, "end_s": 0.5, "units": ["45L"]}]'
 *
 * Without events of your own it smiles with half its strength from 0.1 to 0.5 s and winks with the left eye
 * from 0.2 s. Build: cc -std=c11 events.c $(pkg-config --cflags --libs anyface) -o events
 */
#include <anyface.h>

#include <stdio.h>

/* Every object of one run, so that one place frees them all: freeing NULL does nothing. */
typedef struct {
    AnyfaceEngine *engine;
    AnyfaceAudio *audio;
    char *events;
    AnyfaceMotion *motion;
} Run;

static void run_free(Run *run) {
    anyface_motion_free(run->motion);
    anyface_text_free(run->events);
    anyface_audio_free(run->audio);
    anyface_engine_free(run->engine);
}

static AnyfaceStatus perform(Run *run, const char *voice, AnyfaceError **error) {
    AnyfaceRequest *request = NULL;
    AnyfaceStatus status = anyface_request_new(&request, error);
    if (status == ANYFACE_STATUS_OK) {
        status = anyface_request_set_text(request, "events", run->events, error);
    }
    if (status == ANYFACE_STATUS_OK) { /* the one that shows events */
        status = anyface_request_set_text(request, "system", "cafe-talk", error);
    }
    if (status == ANYFACE_STATUS_OK) {
        status = anyface_engine_new(request, &run->engine, error);
    }
    if (status == ANYFACE_STATUS_OK) {
        status = anyface_audio_read(voice, &run->audio, error);
    }
    if (status == ANYFACE_STATUS_OK) {
        status = anyface_motion_new(run->engine, run->audio, request, NULL, &run->motion, error);
    }
    anyface_request_free(request);
    return status;
}

/* The weights as the system made them: nothing is solved on a mesh. */
static AnyfaceStatus save(const Run *run, const char *out, AnyfaceError **error) {
    printf("frames %zu fps %g shapes %zu events %s\n", anyface_motion_frame_count(run->motion),
           anyface_motion_fps(run->motion), anyface_motion_weight_count(run->motion), run->events);
    return anyface_motion_write(run->motion, out, error);
}

int main(int argc, char **argv) {
    if (argc < 3 || argc > 4) {
        fprintf(stderr, "usage: %s VOICE.wav OUT.csv [EVENTS]\n", argv[0]);
        return 2;
    }
    Run run = {0};
    AnyfaceError *error = NULL;
    /* Lines or JSON; here read once alone, to show what the words mean. */
    const char *events = argc > 3 ? argv[3] : "0.1-0.5:6,12:0.5\n0.2-0.4:45L";
    AnyfaceStatus status = anyface_events_read(NULL, events, &run.events, &error);
    if (status == ANYFACE_STATUS_OK) {
        status = perform(&run, argv[1], &error);
    }
    if (status == ANYFACE_STATUS_OK) {
        status = save(&run, argv[2], &error);
    }
    if (error != NULL) {
        fprintf(stderr, "%s: %s\n", anyface_status_name(status), anyface_error_message(error));
        anyface_error_free(error);
    }
    run_free(&run);
    return (int)status;
}
