/*
 * Anyface makes any face mesh talk: speech in, facial animation with emotion out, on a plain CPU.
 *
 * Generated from capi/src by `cargo xtask header`; change it there.
 *
 * The way through
 * ---------------
 *
 *     AnyfaceEngine *engine = NULL;    loaded weights and settings; make one, keep it
 *     AnyfaceMesh *mesh = NULL;        triangles or polygons from memory or a file
 *     AnyfaceAudio *audio = NULL;      samples from memory or a file
 *     AnyfaceFace *face = NULL;        the mesh made ready: landmarks found, weights computed
 *     AnyfaceClip *clip = NULL;        displacements of every vertex in every frame
 *     AnyfaceError *error = NULL;
 *
 *     if (anyface_engine_new(NULL, &engine, &error) != ANYFACE_STATUS_OK ||
 *         anyface_mesh_read("head.obj", &mesh, &error) != ANYFACE_STATUS_OK ||
 *         anyface_audio_read("voice.wav", &audio, &error) != ANYFACE_STATUS_OK ||
 *         anyface_face_new(engine, mesh, NULL, NULL, &face, &error) != ANYFACE_STATUS_OK ||
 *         anyface_engine_animate(engine, face, audio, NULL, NULL, &clip, &error)
 *             != ANYFACE_STATUS_OK) {
 *         fprintf(stderr, "%s\n", anyface_error_message(error));
 *         anyface_error_free(error);
 *     }
 *
 * Whole programs: capi/examples/talk.c and talk.cpp; docs/c-host.md explains them.
 *
 * Shapes and units
 * ----------------
 *
 * T frames, V vertices, F triangles; 68 landmarks in the order of iBUG 300-W, counted from 0.
 * Arrays are dense and row by row: [T, V, 3] holds frame 0 first, in it vertex 0 as x, y, z.
 * Displacements are in the mesh's own units, axes and vertex order, added to its own positions.
 * Motion alone (AnyfaceMotion) is in the canonical frame: metres, +x to the subject's left, +y up,
 * +z out of the face. Text is UTF-8 and NUL-terminated.
 *
 * Errors
 * ------
 *
 * A function that can fail returns AnyfaceStatus. Results go through out-pointers, which are
 * written only on success: `*out` keeps its old value on failure. The last parameter, `error`, may
 * be NULL; otherwise `*error` is written only on failure and receives an AnyfaceError that the
 * caller frees with anyface_error_free(). Set it to NULL first and free it before using it again.
 * A NULL where something is needed gives ANYFACE_STATUS_NULL_POINTER, never a crash. A defect
 * inside the library gives ANYFACE_STATUS_PANIC. The library prints nothing.
 *
 * Ownership
 * ---------
 *
 * Every object from a function with `out` belongs to the caller, who frees it with the function
 * of its type (anyface_mesh_free() and so on), in any order: no object keeps a pointer to another.
 * What the library receives is copied: the caller's arrays and texts may go right after the call.
 * What it lends says how long it lives. Never free() anything that came from here.
 *
 * Options
 * -------
 *
 * Options are plain structs that may grow in later versions. Prepare them with their function,
 * then set what you need:
 *
 *     AnyfaceMotionOptions options;
 *     anyface_motion_options_init(&options, sizeof options);
 *     options.fps = 25.0;
 *
 * Threads
 * -------
 *
 * Engines, meshes, audio, faces, motions, clips, bases and sliders never change after they were
 * made: any number of threads may use the same object at the same time, for example two jobs on one
 * engine. Threads do not live on in a process after fork(): an engine works only in the process that
 * made it, and fails with ANYFACE_STATUS_INVALID_INPUT in another.
 * The result does not depend on what else runs, nor on the number of threads. An AnyfaceProgress
 * may be read and cancelled from any thread while one job uses it. Only freeing needs care: an
 * object must not be freed while another thread uses it. An AnyfaceError and an AnyfaceStream belong
 * to one thread at a time.
 */


#ifndef ANYFACE_H
#define ANYFACE_H

#include <stddef.h>
#include <stdint.h>

/// Version of this interface, for comparison with `anyface_abi_version()`.
#define ANYFACE_ABI_VERSION 1

/// Number `N` of face landmarks, in the order of iBUG 300-W.
#define ANYFACE_LANDMARK_COUNT 68

/// Number of emotion categories; `anyface_emotion_name()` gives their names.
#define ANYFACE_EMOTION_COUNT 15

/// Number of ARKit's shapes and of Oculus' visemes in a frame of `anyface_weight_stream_pull()`.
#define ANYFACE_LIVE_SHAPE_COUNT 52

#define ANYFACE_LIVE_VISEME_COUNT 15

/// How a call ended. Those from 3 on are also the exit codes of the `anyface` command.
typedef enum {
    /// It did what was asked.
    ANYFACE_STATUS_OK = 0,
    /// A pointer that must not be NULL was NULL.
    ANYFACE_STATUS_NULL_POINTER = 1,
    /// A defect in the library, caught; the handles of the call stay valid and can be freed.
    ANYFACE_STATUS_PANIC = 2,
    /// A value outside its stated range, NaN, an unknown name, text that is not UTF-8, or an array
    /// of the wrong length.
    ANYFACE_STATUS_INVALID_INPUT = 3,
    /// A sound that cannot be decoded or used.
    ANYFACE_STATUS_AUDIO = 4,
    /// A mesh that cannot be read or used.
    ANYFACE_STATUS_MESH = 5,
    /// No face was found on the mesh; the message says why and what would help.
    ANYFACE_STATUS_FACE_NOT_FOUND = 6,
    /// Weights that are missing, truncated or do not fit their config.
    ANYFACE_STATUS_WEIGHTS = 7,
    /// A file that could not be read or written.
    ANYFACE_STATUS_IO = 8,
    /// The caller asked to stop.
    ANYFACE_STATUS_CANCELLED = 9,
    /// A numerical method that did not converge, or a defect in the library.
    ANYFACE_STATUS_INTERNAL = 10,
    /// A result that does not fit into memory: take it block by block, as `anyface_clip_stream()` gives it.
    ANYFACE_STATUS_OUT_OF_MEMORY = 13,
} AnyfaceStatus;

/// Where work that depends only on the mesh is kept between runs; for `AnyfaceEngineOptions`.
typedef enum {
    /// In the user's cache folder, bounded in size. The default.
    ANYFACE_CACHE_USER = 0,
    /// Nothing is read or written.
    ANYFACE_CACHE_OFF = 1,
    /// In the folder `cache_dir`.
    ANYFACE_CACHE_FOLDER = 2,
} AnyfaceCache;

/// An axis of the mesh's own frame; for `AnyfaceFaceOptions`.
typedef enum {
    /// +x
    ANYFACE_AXIS_POS_X = 0,
    /// -x
    ANYFACE_AXIS_NEG_X = 1,
    /// +y
    ANYFACE_AXIS_POS_Y = 2,
    /// -y
    ANYFACE_AXIS_NEG_Y = 3,
    /// +z
    ANYFACE_AXIS_POS_Z = 4,
    /// -z
    ANYFACE_AXIS_NEG_Z = 5,
} AnyfaceAxis;

/// What a connected part of the mesh is and follows; for `AnyfaceFaceOptions` and
/// `anyface_face_copy_parts()`.
typedef enum {
    /// The face itself.
    ANYFACE_PART_ROLE_SKIN = 0,
    /// Follows the lower jaw as a rigid body: lower teeth, lower gums, tongue.
    ANYFACE_PART_ROLE_JAW = 1,
    /// Follows the skull: upper teeth, upper gums, glasses, hair.
    ANYFACE_PART_ROLE_SKULL = 2,
    /// Holds both jaws: gums with a tongue, the mouth's lining.
    ANYFACE_PART_ROLE_MOUTH = 3,
    /// Follows the skin nearest to its roots: lashes, brows, beards.
    ANYFACE_PART_ROLE_NEAREST = 4,
    /// An eyeball; rests and never deforms.
    ANYFACE_PART_ROLE_GAZE = 5,
    /// Nothing of the face; rests.
    ANYFACE_PART_ROLE_STILL = 6,
} AnyfacePartRole;

/// How the lips of a mesh meet.
typedef enum {
    /// Apart, with nothing or the mouth's inside between them.
    ANYFACE_MOUTH_OPEN = 0,
    /// Closed, but not joined: they part.
    ANYFACE_MOUTH_SLIT = 1,
    /// One surface that cannot part.
    ANYFACE_MOUTH_WELDED = 2,
} AnyfaceMouth;

/// What the lids of an eye can do.
typedef enum {
    /// They close.
    ANYFACE_LIDS_CLOSE = 0,
    /// They are sculpted shut and rest.
    ANYFACE_LIDS_SHUT = 1,
    /// They are one surface with the eye, without a slit between, and rest.
    ANYFACE_LIDS_JOINED = 2,
} AnyfaceLids;

/// Where the emotion of a performance comes from; for `AnyfaceMotionOptions`.
typedef enum {
    /// `emotion_strengths`; the default.
    ANYFACE_EMOTION_SOURCE_GIVEN = 0,
    /// The emotion that is heard in the voice: anger, joy, fear, sadness, disgust, calm, or nothing where that
    /// is not certain.
    ANYFACE_EMOTION_SOURCE_VOICE = 1,
    /// No emotion and nothing else that speech did not cause: no blinks, no motion of brows and lids.
    ANYFACE_EMOTION_SOURCE_OFF = 2,
    /// Arousal: how excited the voice sounds, not which emotion it has; glad, afraid and angry voices
    /// all widen the eyes and raise the brows.
    ANYFACE_EMOTION_SOURCE_AROUSAL = 3,
} AnyfaceEmotionSource;

/// Something of a take that can be scaled; 1 is the take as it was made.
typedef enum {
    /// What speech does to mouth and jaw: 0 to 2.
    ANYFACE_SLIDER_ARTICULATION = 0,
    /// How strongly the emotion shows: 0 to 1.5. Blinks stay where they are.
    ANYFACE_SLIDER_EMOTION = 1,
    /// How far the eyes close: 0 to 1.
    ANYFACE_SLIDER_BLINKS = 2,
    /// What emotion and blinks change together beyond what each does alone. Not for a user: with
    /// emotion at e and blinks at b it stands at 1 - (1 - e) * (1 - b).
    ANYFACE_SLIDER_EMOTION_AND_BLINKS = 3,
} AnyfaceSlider;

/// What the numbers of a control mean; for `AnyfaceControl`.
typedef enum {
    /// Any number of the range.
    ANYFACE_CONTROL_VALUES_REAL = 0,
    /// Whole numbers of the range.
    ANYFACE_CONTROL_VALUES_WHOLE = 1,
    /// The number of one of `choices`.
    ANYFACE_CONTROL_VALUES_CHOICE = 2,
} AnyfaceControlValues;

/// What a control acts on; for `AnyfaceControl`.
typedef enum {
    /// A face: set it in `AnyfaceFaceOptions`.
    ANYFACE_CONTROL_STAGE_FACE = 0,
    /// A performance: set it in `AnyfaceMotionOptions`.
    ANYFACE_CONTROL_STAGE_MOTION = 1,
} AnyfaceControlStage;

/// What a viewer sees of a clip.
typedef enum {
    /// The mouth speaks, or was asked to rest.
    ANYFACE_VISIBILITY_SPEAKS = 0,
    /// Lids and brows move, the lips do not: there is likely no speech in the sound.
    ANYFACE_VISIBILITY_LIPS_REST = 1,
    /// Nothing moves.
    ANYFACE_VISIBILITY_NOTHING = 2,
} AnyfaceVisibility;

/// What is said beside the closures.
typedef enum {
    /// Phones.
    ANYFACE_TIER_PHONES = 0,
    /// Words.
    ANYFACE_TIER_WORDS = 1,
    /// Mouths of a chart.
    ANYFACE_TIER_MOUTHS = 2,
} AnyfaceTier;

/// The mouths that a chart is drawn with.
typedef enum {
    /// Rhubarb's nine, A to H and X.
    ANYFACE_MOUTHS_RHUBARB = 0,
    /// Preston Blair's ten, as Papagayo names them: AI, E, O, U, L, WQ, MBP, FV, etc, rest.
    ANYFACE_MOUTHS_PRESTON_BLAIR = 1,
} AnyfaceMouths;

/// A sound, kept as mono at 16 kHz. Never changes after it was made: any number of threads may
/// use it at the same time.
typedef struct AnyfaceAudio AnyfaceAudio;

/// `K` shapes and their weights in every frame: `displacement[t] = sum over k of weight[t][k] *
/// shape[k]`. Weights lie within -1 and 1. Never changes after it was made: any number of threads
/// may use it at the same time.
typedef struct AnyfaceBasis AnyfaceBasis;

/// Displacements of every vertex over time, in the mesh's own units, axes and vertex order. Never
/// changes after it was made: any number of threads may read it at the same time.
typedef struct AnyfaceClip AnyfaceClip;

/// `K` curves with few keys each. Never changes after it was made: any number of threads may use it
/// at the same time.
///
/// A curve passes through the values at its keys. Between keys `n` frames apart it is a Bézier
/// segment whose handles lie `0.39 * n` frames beside them, along the slope of the key.
typedef struct AnyfaceCurves AnyfaceCurves;

/// Loaded weights and settings. Any number of threads may use one engine at the same time.
typedef struct AnyfaceEngine AnyfaceEngine;

/// Why a call failed: a status and a message in English. Owned by the caller.
typedef struct AnyfaceError AnyfaceError;

/// Sentences about a motion and its events on a face, in English. Never changes after it was made: any number of
/// threads may read it at the same time.
typedef struct AnyfaceEventNotes AnyfaceEventNotes;

/// Events of a performance. Never changes after it was made: any number of threads may use it at the same
/// time.
typedef struct AnyfaceEvents AnyfaceEvents;

/// The action units of an expression. Never changes after it was made: any number of threads may read it at the same
/// time.
typedef struct AnyfaceExpression AnyfaceExpression;

/// Everything known of one mesh: its landmarks, how its lips meet, what its parts are, and what moving it
/// needs. Never changes after it was made: any number of threads may use it at the same time.
typedef struct AnyfaceFace AnyfaceFace;

/// One head of FaceTalk's parametric model. Never changes after it was made: any number of threads may use
/// it at the same time.
///
/// It is `N` numbers: 100 coefficients, each from a normal distribution, then how far each of its traits goes (age, sex,
/// weight …), -4 to 4; all 0 is the mean head. Its frame is metres, +x to the subject's left, +y up, +z out of the face.
typedef struct AnyfaceHead AnyfaceHead;

/// A triangle mesh in the caller's own units, axes and vertex order. Never changes after it was
/// made: any number of threads may use it at the same time.
typedef struct AnyfaceMesh AnyfaceMesh;

/// Motion before any mesh is known, of landmarks or of what else the system moves. Fits every face; never
/// changes after it was made.
typedef struct AnyfaceMotion AnyfaceMotion;

/// A mesh whose lips or lids were one surface and can part now, and what each of its pieces was before. Never
/// changes after it was made: any number of threads may use it at the same time.
///
/// Old vertices come first, with their numbers and where they were. Old triangles stand in their order,
/// those that were cut in pieces; then what was sewn behind the cut.
typedef struct AnyfaceOpenedFace AnyfaceOpenedFace;

/// Watches and stops jobs.
///
/// Handed to a long call, it can be read and cancelled from any other thread while the call runs.
/// It may accompany several calls one after the other; one that was cancelled stays so.
typedef struct AnyfaceProgress AnyfaceProgress;

/// The 52 ARKit shapes and the 15 Oculus visemes of one mesh. Never changes after it was made: any
/// number of threads may use it at the same time.
typedef struct AnyfaceRig AnyfaceRig;

/// What each slider adds to the weights of a basis: `weight[t][k] + change[t][k]`.
///
/// A slider has `N` knots, rising and none of them 1, where nothing is added. Between them and 1 the
/// change is linear, beyond the last one it stays. Changes of several sliders add up. Never changes
/// after it was made: any number of threads may read it at the same time.
typedef struct AnyfaceSliders AnyfaceSliders;

/// Sounds of speech and their times: heard in a sound, or read from a file. Never changes after it was made.
typedef struct AnyfaceSounds AnyfaceSounds;

/// A performance in progress: push sound, pull frames of the 68 landmarks in the canonical frame.
///
/// The frames are the same bit for bit however the sound is cut into pushes. A stream belongs to
/// one thread at a time.
typedef struct AnyfaceStream AnyfaceStream;

/// A performance in progress for characters with shapes of their own: push sound, pull weights of ARKit's shapes and of
/// visemes, with blinks, eyes that move and a head that drifts.
///
/// The frames are the same bit for bit however the sound is cut into pushes. A stream belongs to
/// one thread at a time.
typedef struct AnyfaceWeightStream AnyfaceWeightStream;

/// Weights of `S` shapes in `T` frames, 0 to 1. Never changes after it was made: any number of
/// threads may use it at the same time.
typedef struct AnyfaceWeights AnyfaceWeights;

/// Receives progress; any result but 0 asks the job to stop.
///
/// `stage`: "speech", "motion", "landmarks", "operators", "weights", "deform", "compress" or another;
/// lives as long as the progress handle. `fraction`: share of that stage that is done, 0 to 1.
/// Called from a thread of the library, which may differ from the one that started the job and
/// from call to call; never twice at the same time for one handle. It must not throw or longjmp,
/// and must not start a job with the same handle.
typedef int (*AnyfaceProgressFn)(void *user, const char *stage, float fraction);

/// How an engine is set up; prepare it with `anyface_engine_options_init()`.
typedef struct {
    /// Bytes of this struct in the caller's header; set by `anyface_engine_options_init()`.
    size_t struct_size;
    /// Folder of model files that replace the built-in ones, UTF-8; NULL for the built-in ones.
    const char *weights_dir;
    /// Folder of a HuBERT or wav2vec2 model (`config.json` and `model.safetensors`) that replaces
    /// the built-in speech encoder, UTF-8; `weights_dir` must then hold weights trained with it.
    /// NULL, the default, for the built-in one.
    const char *speech_dir;
    /// Folder for `ANYFACE_CACHE_FOLDER`, UTF-8; otherwise NULL.
    const char *cache_dir;
    /// One of `AnyfaceCache`; default `ANYFACE_CACHE_USER`.
    int32_t cache;
    /// Worker threads; 0, the default, takes one for each core. The result does not depend on it.
    uint32_t threads;
    /// What turns speech into motion: a name of `anyface_system_name()`, UTF-8; NULL, the default, for
    /// the first.
    const char *system;
    /// Folder of Whisper base (`openai/whisper-base`), or of a classifier of emotions on HuBERT or wav2vec2
    /// (`config.json` with labels, weights), that hears emotions instead of the built-in ear where the emotion is that of
    /// the voice, UTF-8; NULL, the default, for the built-in one.
    const char *emotion_model_dir;
} AnyfaceEngineOptions;

/// Something that a system lets its user change. All texts live as long as the library is loaded.
typedef struct {
    /// Bytes of this struct in the caller's header.
    size_t struct_size;
    /// By which it is set, such as "blinks_per_minute".
    const char *name;
    /// Its name for people.
    const char *label;
    /// A sentence or two of help.
    const char *help;
    /// The unit of its numbers: "s", "per_minute", or "".
    const char *unit;
    /// `[choice_count]` names of a choice; NULL otherwise.
    const char *const *choices;
    /// Number of names of a choice.
    size_t choice_count;
    /// An `AnyfaceControlValues`.
    int32_t values;
    /// An `AnyfaceControlStage`.
    int32_t stage;
    /// The least number.
    float low;
    /// The largest number.
    float high;
    /// The number where nothing is set.
    float default_value;
    /// The number that leaves the motion as the system made it.
    float neutral;
    /// 1 if it may have keys over time, else 0.
    int32_t animatable;
    /// 0.
    uint32_t reserved;
} AnyfaceControl;

/// What one control is set to; `anyface_system_control()` lists the controls.
typedef struct {
    /// Its name, such as "articulation", UTF-8.
    const char *name;
    /// Its value, within the control's range; of a choice the number of the name.
    float value;
    /// Must be 0.
    uint32_t reserved;
    /// `[key_count]` seconds, rising, at which the control has the values of `key_values`: linear in
    /// between, held outside. NULL where it does not change over time.
    const double *key_times_s;
    /// `[key_count]`, within the control's range; NULL where it does not change over time.
    const double *key_values;
    /// Number of keys; 0 where the control does not change over time.
    size_t key_count;
} AnyfaceControlSetting;

/// What is known of a face; prepare it with `anyface_face_options_init()`.
///
/// Landmarks may come in one of three ways, or not at all: then the library finds them.
typedef struct {
    /// Bytes of this struct in the caller's header; set by `anyface_face_options_init()`.
    size_t struct_size;
    /// `[68, 3]`, mesh units and axes, in the order of iBUG 300-W; each is put on the nearest
    /// fitting place of the surface, unless its vertex is given as well. NULL otherwise.
    const float *landmark_positions;
    /// `[68]` vertex numbers, NULL otherwise. With positions: a point at the very place of its vertex stays
    /// on that vertex, as those of `anyface_opened_face_copy_landmarks()` on rims that touch.
    const uint32_t *landmark_vertices;
    /// The text of a landmark file as `anyface_face_write_landmarks()` writes it, UTF-8. NULL
    /// otherwise.
    const char *landmark_json;
    /// The axis out of the face, one of `AnyfaceAxis`; default +z, as in OBJ and glTF. Blender
    /// faces -y.
    int32_t forward;
    /// The axis to the top of the head, one of `AnyfaceAxis`; default +y. Blender has +z.
    int32_t up;
    /// `[control_count]`: controls of the system that act on a face, such as "learned"; the others
    /// stand at their defaults. They take no keys. NULL otherwise.
    const AnyfaceControlSetting *controls;
    /// Number of controls that are set.
    size_t control_count;
    /// `[part_count]` numbers of parts whose role the caller knows, as `anyface_face_copy_parts()`
    /// counts them; NULL otherwise. All other parts are told by shape and place.
    const uint32_t *part_numbers;
    /// `[part_count]` their roles, each one of `AnyfacePartRole`; NULL otherwise.
    const int32_t *part_roles;
    /// Number of parts whose role the caller knows.
    size_t part_count;
    /// `[fixed_count]` numbers, 0 to 67, of landmarks that stay where the caller puts them while the
    /// others follow; NULL otherwise.
    const uint32_t *fixed_numbers;
    /// `[fixed_count, 3]` their places, mesh units and axes; each is put on the surface. NULL
    /// otherwise.
    const float *fixed_positions;
    /// Number of landmarks that stay.
    size_t fixed_count;
    /// `[object_vertex_count]`: which object each vertex belongs to, for a mesh that was put together
    /// from several (a face, its teeth, its lashes); `UINT32_MAX` for none. NULL otherwise.
    const uint32_t *object_of_vertex;
    /// Number of vertices of the mesh where `object_of_vertex` is given, otherwise 0.
    size_t object_vertex_count;
    /// `[object_count]`: the role of every part of an object, one of `AnyfacePartRole`, or -1 for
    /// parts that are told by shape and place. `part_numbers` count before these. NULL otherwise.
    const int32_t *object_roles;
    /// Number of objects.
    size_t object_count;
} AnyfaceFaceOptions;

/// What a face does for a while; for `anyface_events_new()`.
typedef struct {
    /// First second, 0 or more.
    double start_s;
    /// Last second, above the first.
    double end_s;
    /// `[unit_count]`, UTF-8: action units such as "12" or "AU1", with L or R behind for the subject's left or
    /// right alone: "45L".
    const char *const *units;
    /// Number of units, 1 or more.
    size_t unit_count;
    /// 0 to 2; 1 is the model's own. Not 0 by itself: set it.
    float strength;
    /// 1 where lips that the speech brings together may stay apart under it, else 0.
    int32_t over_speech;
} AnyfaceEvent;

/// What a performance is asked to be; prepare it with `anyface_motion_options_init()`.
typedef struct {
    /// Bytes of this struct in the caller's header; set by `anyface_motion_options_init()`.
    size_t struct_size;
    /// `[emotion_count, ANYFACE_EMOTION_COUNT]`: strength of each emotion, 0 or more, at most 1.5
    /// in sum for each row. NULL with a count of 0, the default, is neutral throughout.
    const float *emotion_strengths;
    /// `[emotion_count]`: seconds at which the rows hold, rising; linear in between, held outside.
    /// NULL where there is one row, which then holds throughout.
    const double *emotion_times_s;
    /// Number of rows.
    size_t emotion_count;
    /// Frames per second of the result, 1 to 240; default 30.
    double fps;
    /// The same seed gives the same motion; default 0. Draws blinks, brow accents, head, gaze and
    /// variety, and the noise of models that sample with noise, which the built-in one does not.
    uint64_t seed;
    /// Speaking style by name, UTF-8; NULL, the default, takes the model's own.
    const char *style;
    /// An `AnyfaceEmotionSource`; default `ANYFACE_EMOTION_SOURCE_GIVEN`. With another one
    /// `emotion_count` must be 0.
    int32_t emotion_source;
    /// Must be 0.
    uint32_t reserved;
    /// `[control_count]`: controls of the system that act on a performance, such as "articulation"; the
    /// others stand at their defaults. NULL otherwise.
    const AnyfaceControlSetting *controls;
    /// Number of controls that are set.
    size_t control_count;
    /// `[closure_count, 2]`: start and end in seconds of the intervals in which the lips are together, in rising
    /// order, where `has_closures` is 1; see `anyface_sounds_copy_closures()`.
    const double *closures_s;
    /// Number of intervals; 0 with `has_closures` closes the lips nowhere.
    size_t closure_count;
    /// 1 closes the lips in these intervals, 0, the default, where that is heard.
    int32_t has_closures;
    /// Must be 0.
    uint32_t reserved_2;
    /// What the face is to do and when; only until the call returns. NULL, the default, is nothing. A system that
    /// cannot show them refuses: see `anyface_system_takes_events()`.
    const AnyfaceEvents *events;
    /// Another recording whose emotion the face shows; only until the call returns. NULL, the default, is the
    /// voice itself. A system that does not hear emotion refuses: see `anyface_system_hears_emotion()`.
    const AnyfaceAudio *emotion_of;
    /// A motion of landmarks in whose last frame the face begins, its tongue too; only until the call returns. NULL, the
    /// default, is rest. Systems that do not go on from a pose refuse: see `anyface_system_starts_from_pose()`.
    const AnyfaceMotion *starts_from;
    /// A recording in which the same person speaks neutrally, ten seconds or more; only until the call returns. The emotion
    /// of the voice is heard as what differs from it. NULL, the default, compares the voice with readers.
    const AnyfaceAudio *neutral_voice;
} AnyfaceMotionOptions;

/// Takes frames in order; any result but 0 ends the call with `ANYFACE_STATUS_CANCELLED`.
///
/// `first_frame`: number of the first of them. `displacements`: `[frame_count, V, 3]`, mesh units, added to
/// the neutral positions; valid during this call alone.
/// Called from a thread of the library, which may differ from the one that started the job and from
/// call to call; never twice at the same time. It must not throw or longjmp.
typedef int (*AnyfaceFramesFn)(void *user,
                               size_t first_frame,
                               size_t frame_count,
                               const float *displacements);

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/// Version of the interface that the loaded library has.
///
/// It is raised when something that existed changes its meaning or goes away. A program that
/// loads the library at run time stops where this differs from its own `ANYFACE_ABI_VERSION`.
/// New functions, and new fields at the end of an options struct, do not raise it. It counts from the first release on:
/// until 0.1.0 is out it is 1 whatever changes, and a program is built anew with each library.
uint32_t anyface_abi_version(void);

/// Version of the library, such as "0.1.0"; lives as long as the library is loaded.
const char *anyface_version(void);

/// A short name of a status, such as "face not found"; "unknown" for a number that is none.
///
/// The text lives as long as the library is loaded.
const char *anyface_status_name(int32_t status);

/// The message, UTF-8; lives until the error is freed. "" for NULL.
const char *anyface_error_message(const AnyfaceError *error);

/// The status that the failed call returned; `ANYFACE_STATUS_OK` for NULL.
AnyfaceStatus anyface_error_status(const AnyfaceError *error);

/// Frees an error; nothing happens for NULL.
void anyface_error_free(AnyfaceError *error);

/// A handle that watches and stops jobs; never NULL.
///
/// `callback` may be NULL for a program that reads with `anyface_progress_read()` instead. `user`
/// is passed to the callback as it is.
AnyfaceProgress *anyface_progress_new(AnyfaceProgressFn callback, void *user);

/// Reads how far the job is; from any thread, at any time.
///
/// `stage` receives the name of the stage ("" before the first), which lives until the handle is
/// freed; `fraction` the share of it that is done, 0 to 1. Either may be NULL.
/// Fails with `ANYFACE_STATUS_NULL_POINTER` if `progress` is NULL.
AnyfaceStatus anyface_progress_read(const AnyfaceProgress *progress,
                                    const char **stage,
                                    float *fraction);

/// Asks the job to stop, from any thread; the running call returns `ANYFACE_STATUS_CANCELLED` as
/// soon as it can. Nothing happens for NULL.
void anyface_progress_cancel(const AnyfaceProgress *progress);

/// Frees a progress handle that no running call uses; nothing happens for NULL.
void anyface_progress_free(AnyfaceProgress *progress);

/// Sets every option to its default. `struct_size` is `sizeof *options`.
///
/// Fails with `ANYFACE_STATUS_NULL_POINTER`, or `ANYFACE_STATUS_INVALID_INPUT` for a size that no
/// version had.
AnyfaceStatus anyface_engine_options_init(AnyfaceEngineOptions *options, size_t struct_size);

/// Loads the weights; takes some tenths of a second, so keep the engine.
///
/// `options` may be NULL for the defaults. Free with `anyface_engine_free()`.
/// Fails with `ANYFACE_STATUS_WEIGHTS` if a model file is missing, truncated or does not fit its
/// config, `ANYFACE_STATUS_INVALID_INPUT` for an unknown system or an option out of range.
AnyfaceStatus anyface_engine_new(const AnyfaceEngineOptions *options,
                                 AnyfaceEngine **out,
                                 AnyfaceError **error);

/// Most memory that motion on a mesh takes at a time, bytes, as far as that is known before the work starts: within 40 %
/// of what was measured.
///
/// `frames_at_once`: frames that are kept, all for `anyface_clip_new()`, two blocks for `anyface_clip_stream()`.
/// `sound_s`: seconds of the sound that `anyface_motion_new()` gets. 0 for NULL.
/// `anyface_face_new()` and `anyface_clip_new()` fail with `ANYFACE_STATUS_OUT_OF_MEMORY` where it surely does not fit.
uint64_t anyface_engine_memory_needed(const AnyfaceEngine *engine,
                                      size_t vertex_count,
                                      size_t frames_at_once,
                                      double sound_s);

/// Memory that this process may still take, bytes; `UINT64_MAX` where the system does not say.
uint64_t anyface_memory_left(void);

/// Frees an engine that no running call uses; nothing happens for NULL.
///
/// Faces, motions and clips that were made with it stay valid.
void anyface_engine_free(AnyfaceEngine *engine);

/// A mesh from triangles; the arrays are copied.
///
/// `positions`: `[vertex_count, 3]`, any units. `triangles`: `[triangle_count, 3]`, vertex
/// numbers. Loose vertices, several parts, holes, duplicate and flat triangles are allowed. Free
/// with `anyface_mesh_free()`.
/// Fails with `ANYFACE_STATUS_MESH` for too few triangles, positions that are not finite or vertex
/// numbers out of range.
AnyfaceStatus anyface_mesh_new(const float *positions,
                               size_t vertex_count,
                               const uint32_t *triangles,
                               size_t triangle_count,
                               AnyfaceMesh **out,
                               AnyfaceError **error);

/// A mesh from polygons, which are cut into triangles; the arrays are copied.
///
/// `positions`: `[vertex_count, 3]`, any units. `polygon_sizes`: `[polygon_count]`, corners of
/// each. `corners`: `[corner_count]`, the vertex numbers of all polygons in a row. Free with
/// `anyface_mesh_free()`.
/// Fails as `anyface_mesh_new()`, and with `ANYFACE_STATUS_INVALID_INPUT` if the sizes do not add
/// up to `corner_count`.
AnyfaceStatus anyface_mesh_new_polygons(const float *positions,
                                        size_t vertex_count,
                                        const uint32_t *polygon_sizes,
                                        size_t polygon_count,
                                        const uint32_t *corners,
                                        size_t corner_count,
                                        AnyfaceMesh **out,
                                        AnyfaceError **error);

/// A mesh from an OBJ, PLY or GLB file; the vertex order is the file's.
///
/// `path`: UTF-8. Free with `anyface_mesh_free()`.
/// Fails with `ANYFACE_STATUS_IO` if the file cannot be read, `ANYFACE_STATUS_MESH` if it is
/// neither format or the mesh cannot be used.
AnyfaceStatus anyface_mesh_read(const char *path, AnyfaceMesh **out, AnyfaceError **error);

/// Number `V` of vertices; 0 for NULL.
size_t anyface_mesh_vertex_count(const AnyfaceMesh *mesh);

/// Number `F` of triangles; 0 for NULL.
size_t anyface_mesh_triangle_count(const AnyfaceMesh *mesh);

/// Copies the positions into the caller's buffer.
///
/// `buffer`: `[V, 3]`, mesh units; `float_count` must be `V * 3`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`.
AnyfaceStatus anyface_mesh_copy_positions(const AnyfaceMesh *mesh,
                                          float *buffer,
                                          size_t float_count,
                                          AnyfaceError **error);

/// Copies the triangles into the caller's buffer.
///
/// `buffer`: `[F, 3]`, vertex numbers; `index_count` must be `F * 3`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `index_count`.
AnyfaceStatus anyface_mesh_copy_triangles(const AnyfaceMesh *mesh,
                                          uint32_t *buffer,
                                          size_t index_count,
                                          AnyfaceError **error);

/// Frees a mesh that no running call uses; nothing happens for NULL.
void anyface_mesh_free(AnyfaceMesh *mesh);

/// A sound from samples in memory, which are copied.
///
/// `samples`: `[frame_count, channels]`, interleaved, nominally -1 to 1; channels are averaged.
/// `sample_rate_hz`: 4000 to 384000. Free with `anyface_audio_free()`.
/// Fails with `ANYFACE_STATUS_AUDIO` for no samples, samples that are not finite, no channels or a
/// rate out of range.
AnyfaceStatus anyface_audio_new(const float *samples,
                                size_t frame_count,
                                uint32_t channels,
                                uint32_t sample_rate_hz,
                                AnyfaceAudio **out,
                                AnyfaceError **error);

/// A sound from a file: WAV, MP3, FLAC, Ogg, WebM, M4A, AAC, CAF or AIFF.
///
/// `path`: UTF-8. Free with `anyface_audio_free()`. Ask `anyface_audio_warning()` whether something of
/// the sound is missing because the file is damaged.
/// Fails with `ANYFACE_STATUS_IO` if the file cannot be read, `ANYFACE_STATUS_AUDIO` if it cannot
/// be decoded, holds no sound, or is damaged so that more than a fifth of it is missing;
/// `anyface_audio_read_damaged()` takes what is left.
AnyfaceStatus anyface_audio_read(const char *path,
                                 AnyfaceAudio **out,
                                 AnyfaceError **error);

/// As `anyface_audio_read()`, however much is missing.
AnyfaceStatus anyface_audio_read_damaged(const char *path,
                                         AnyfaceAudio **out,
                                         AnyfaceError **error);

/// What is missing of a sound because its file is damaged, as a sentence in English; NULL where nothing
/// is, and for NULL.
///
/// The text lives as long as the sound; a part of a sound has none.
const char *anyface_audio_warning(const AnyfaceAudio *audio);

/// A part of a sound, copied.
///
/// `start_s`, `duration_s`: seconds, not negative; what lies past the end is left out.
/// Free with `anyface_audio_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for times that are negative or not finite,
/// `ANYFACE_STATUS_AUDIO` if nothing is left.
AnyfaceStatus anyface_audio_trim(const AnyfaceAudio *audio,
                                 double start_s,
                                 double duration_s,
                                 AnyfaceAudio **out,
                                 AnyfaceError **error);

/// Number of samples, at 16 kHz; 0 for NULL.
size_t anyface_audio_sample_count(const AnyfaceAudio *audio);

/// Copies the samples, mono at 16 kHz, into the caller's buffer.
///
/// `buffer`: `[S]`, nominally -1 to 1; `float_count` must be `anyface_audio_sample_count()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`.
AnyfaceStatus anyface_audio_copy_samples(const AnyfaceAudio *audio,
                                         float *buffer,
                                         size_t float_count,
                                         AnyfaceError **error);

/// Length in seconds; 0 for NULL.
double anyface_audio_duration_s(const AnyfaceAudio *audio);

/// Largest magnitude of any sample; 0 for silence and for NULL. Below 0.001 counts as silence.
float anyface_audio_peak(const AnyfaceAudio *audio);

/// Frees a sound that no running call uses; nothing happens for NULL.
void anyface_audio_free(AnyfaceAudio *audio);

/// Draws a mouth chart: which of a few drawn mouths stands in each frame of a clip, by how far the lips are apart, how wide
/// the mouth is, and what is said.
///
/// `said`: from `anyface_sounds_new_with_text()` or a file, when lips close and which phones are said; may be NULL.
/// `mouths`: an `AnyfaceMouths`. `on`: mouths change at every so many frames, 1 to 240. `hold`: the fewest frames for
/// which a mouth stands, 1 to 240; `closure_hold` and `vowel_hold`: the same of lips that close for p, b and m, and of the
/// mouths of vowels, 0 for `hold`. The chart is the tier `ANYFACE_TIER_MOUTHS`; `anyface_sounds_write()` writes it. Free
/// with `anyface_sounds_free()`. Fails with `ANYFACE_STATUS_INVALID_INPUT` for numbers out of range.
AnyfaceStatus anyface_sounds_new_chart(const AnyfaceClip *clip,
                                       const AnyfaceSounds *said,
                                       int32_t mouths,
                                       size_t on,
                                       size_t hold,
                                       size_t closure_hold,
                                       size_t vowel_hold,
                                       AnyfaceSounds **out,
                                       AnyfaceError **error);

/// Listens to a sound: where the lips are heard to be together for p, b, m and their kin.
///
/// Free with `anyface_sounds_free()`. Fails with `ANYFACE_STATUS_AUDIO` for a sound too short to use.
AnyfaceStatus anyface_sounds_new(const AnyfaceEngine *engine,
                                 const AnyfaceAudio *audio,
                                 AnyfaceSounds **out,
                                 AnyfaceError **error);

/// Listens to a sound for its phones and, where `text` says them, its words, beside the closures of
/// `anyface_sounds_new()`, which stay the same and alone close lips.
///
/// `text`: UTF-8, the words that are said in the sound; NULL where nobody knows them. Free with
/// `anyface_sounds_free()`. Fails with `ANYFACE_STATUS_AUDIO` for a sound too short to use,
/// `ANYFACE_STATUS_INVALID_INPUT` for a text without a letter or too long for the sound,
/// `ANYFACE_STATUS_WEIGHTS` for an engine with a speech encoder of the user's own.
AnyfaceStatus anyface_sounds_new_with_text(const AnyfaceEngine *engine,
                                           const AnyfaceAudio *audio,
                                           const char *text,
                                           AnyfaceSounds **out,
                                           AnyfaceError **error);

/// Sounds from a file that another tool or an artist has made: .TextGrid (Praat), .tsv or .json (Rhubarb), .pgo
/// (Papagayo), .dat (Moho), .txt (lines of start, end and label).
///
/// `path`: UTF-8. `fps`: frames per second that .dat counts, 1 to 240. Free with `anyface_sounds_free()`.
/// Fails with `ANYFACE_STATUS_IO` if the file cannot be read, `ANYFACE_STATUS_INVALID_INPUT` for another
/// ending, a line that cannot be read, or words alone.
AnyfaceStatus anyface_sounds_read(const char *path,
                                  double fps,
                                  AnyfaceSounds **out,
                                  AnyfaceError **error);

/// Writes sounds as a file of the kind that its ending names, as `anyface_sounds_read()` lists them.
///
/// `path`: UTF-8. `fps`: frames per second that .pgo and .dat count, 1 to 240.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another ending, `ANYFACE_STATUS_IO` if the file cannot be
/// written; then nothing is left of it.
AnyfaceStatus anyface_sounds_write(const AnyfaceSounds *sounds,
                                   const char *path,
                                   double fps,
                                   AnyfaceError **error);

/// Number `n` of intervals in which the lips are together; 0 for NULL.
size_t anyface_sounds_closure_count(const AnyfaceSounds *sounds);

/// Copies the intervals in which the lips are together into the caller's buffer, as
/// `AnyfaceMotionOptions` takes them.
///
/// `buffer`: `[n, 2]`, start and end in seconds, in rising order; `double_count` must be `n * 2`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `double_count`.
AnyfaceStatus anyface_sounds_copy_closures(const AnyfaceSounds *sounds,
                                           double *buffer,
                                           size_t double_count,
                                           AnyfaceError **error);

/// Number `n` of intervals of an `AnyfaceTier`; 0 where nothing is known of it, for another number, for
/// NULL.
size_t anyface_sounds_interval_count(const AnyfaceSounds *sounds,
                                     int32_t tier);

/// Label of an interval of an `AnyfaceTier`: a phone (IPA) or a word; lives until the sounds are freed.
/// NULL for NULL or a number that is not below the count.
const char *anyface_sounds_label(const AnyfaceSounds *sounds,
                                 int32_t tier,
                                 size_t interval);

/// Copies the times of the intervals of an `AnyfaceTier` into the caller's buffer.
///
/// `buffer`: `[n, 2]`, start and end in seconds, in rising order; `double_count` must be `n * 2`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `double_count` or tier.
AnyfaceStatus anyface_sounds_copy_intervals(const AnyfaceSounds *sounds,
                                            int32_t tier,
                                            double *buffer,
                                            size_t double_count,
                                            AnyfaceError **error);

/// 1 where a phone (IPA, ARPABET, `MBP`) closes the lips as p, b and m do, else 0; 0 for NULL.
///
/// `label`: UTF-8.
int32_t anyface_sounds_label_closes_lips(const char *label);

/// Frees sounds; NULL is fine.
void anyface_sounds_free(AnyfaceSounds *sounds);

/// Number of systems that turn speech into motion; number 0 is the default one.
size_t anyface_system_count(void);

/// The word by which a system is chosen, in `AnyfaceEngineOptions`; NULL for a number that is not below
/// the count. Lives as long as the library is loaded.
const char *anyface_system_name(size_t system);

/// Name of a system for people, as `anyface_system_name()`.
const char *anyface_system_label(size_t system);

/// A sentence of help, as `anyface_system_name()`.
const char *anyface_system_help(size_t system);

/// Number of controls that a system understands; 0 for a number that is not below the count.
size_t anyface_system_control_count(size_t system);

/// 1 if a system shows the events of `AnyfaceMotionOptions`, else 0; 0 for a number that is not below the
/// count.
int32_t anyface_system_takes_events(size_t system);

/// 1 if a system hears emotion, in the voice or in `emotion_of` of `AnyfaceMotionOptions`, else 0; 0 for a number
/// that is not below the count.
int32_t anyface_system_hears_emotion(size_t system);

/// 1 if a system goes on from the pose of `starts_from` of `AnyfaceMotionOptions`, else 0; 0 for a number that
/// is not below the count.
int32_t anyface_system_starts_from_pose(size_t system);

/// 1 if takes of a system have an `AnyfaceSlider`, else 0; 0 for a system or slider that is not there.
int32_t anyface_system_has_slider(size_t system,
                                  int32_t slider);

/// Describes a control of a system, in the order in which a panel shows them. `struct_size` is
/// `sizeof *out`.
///
/// Fails with `ANYFACE_STATUS_NULL_POINTER`, or `ANYFACE_STATUS_INVALID_INPUT` for a system or control
/// that is not there or a size that no version had.
AnyfaceStatus anyface_system_control(size_t system,
                                     size_t control,
                                     AnyfaceControl *out,
                                     size_t struct_size);

/// Sets every option to its default. `struct_size` is `sizeof *options`.
///
/// Fails with `ANYFACE_STATUS_NULL_POINTER`, or `ANYFACE_STATUS_INVALID_INPUT` for a size that no
/// version had.
AnyfaceStatus anyface_face_options_init(AnyfaceFaceOptions *options, size_t struct_size);

/// Takes or finds the landmarks of a mesh and computes all that does not depend on time. Long:
/// accepts a progress handle; kept in the engine's cache.
///
/// `options` and `progress` may be NULL. The mesh may be freed afterwards. Free with
/// `anyface_face_free()`.
/// Fails with `ANYFACE_STATUS_FACE_NOT_FOUND`, `ANYFACE_STATUS_MESH` for a mesh that cannot be
/// used, `ANYFACE_STATUS_INVALID_INPUT` for unusable landmarks or options,
/// `ANYFACE_STATUS_CANCELLED`.
AnyfaceStatus anyface_face_new(const AnyfaceEngine *engine,
                               const AnyfaceMesh *mesh,
                               const AnyfaceFaceOptions *options,
                               const AnyfaceProgress *progress,
                               AnyfaceFace **out,
                               AnyfaceError **error);

/// The quick part of `anyface_face_new()`, whose result it shares through the engine's cache: where the
/// face is, without what moving it needs. That is computed when the face is first moved.
///
/// Arguments and failures are those of `anyface_face_new()`.
AnyfaceStatus anyface_face_find(const AnyfaceEngine *engine,
                                const AnyfaceMesh *mesh,
                                const AnyfaceFaceOptions *options,
                                const AnyfaceProgress *progress,
                                AnyfaceFace **out,
                                AnyfaceError **error);

/// How the lips meet, an `AnyfaceMouth`; -1 for NULL.
int32_t anyface_face_mouth(const AnyfaceFace *face);

/// What the lids of an eye can do, an `AnyfaceLids`; -1 for NULL. `side`: 0 the subject's right eye, anything else the
/// left one. Where lids rest, a brow that is lowered stands for a blink.
int32_t anyface_face_lids(const AnyfaceFace *face,
                          int32_t side);

/// Size of the mesh's unit in metres on a head of human size: what makes millimetres of displacements;
/// 0 for NULL.
double anyface_face_metres_per_unit(const AnyfaceFace *face);

/// Copies the way from the mesh's frame to the canonical one, in which head and gaze of a motion are given:
/// metres on a head of human size, +x to the subject's left, +y up, +z out of the face, origin between the
/// jaw's hinges.
///
/// `matrix`: `[3, 4]`, rows: `canonical = matrix * (x, y, z, 1)`, a scaled rotation and a shift. `float_count`
/// must be 12. Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`.
AnyfaceStatus anyface_face_copy_to_canonical(const AnyfaceFace *face,
                                             float *matrix,
                                             size_t float_count,
                                             AnyfaceError **error);

/// Number `V` of vertices of its mesh; 0 for NULL.
size_t anyface_face_vertex_count(const AnyfaceFace *face);

/// Copies the 68 landmarks into the caller's buffers, each of which may be NULL.
///
/// `positions`: `[68, 3]`, mesh units and axes, on the surface. `vertices`: `[68]`, the nearest
/// vertex of each. `confidence`: `[68]`, 0 to 1; 1 for landmarks that the caller gave.
/// Fails with `ANYFACE_STATUS_NULL_POINTER` if `face` is NULL.
AnyfaceStatus anyface_face_copy_landmarks(const AnyfaceFace *face,
                                          float *positions,
                                          uint32_t *vertices,
                                          float *confidence,
                                          AnyfaceError **error);

/// Number of connected parts of its mesh, seams sewn up; 0 for NULL.
size_t anyface_face_part_count(const AnyfaceFace *face);

/// Copies what each part is into the caller's buffers, each of which may be NULL.
///
/// `roles`: one `AnyfacePartRole` for each of `anyface_face_part_count()` parts.
/// `part_of_vertex`: `[V]`, the part of each vertex, `UINT32_MAX` for a vertex in no face.
/// Fails with `ANYFACE_STATUS_NULL_POINTER` if `face` is NULL.
AnyfaceStatus anyface_face_copy_parts(const AnyfaceFace *face,
                                      int32_t *roles,
                                      uint32_t *part_of_vertex,
                                      AnyfaceError **error);

/// Writes the landmarks as a JSON file that `anyface animate --landmarks` reads too.
///
/// `path`: UTF-8. Fails with `ANYFACE_STATUS_IO`; then nothing is left of the file.
AnyfaceStatus anyface_face_write_landmarks(const AnyfaceFace *face,
                                           const char *path,
                                           AnyfaceError **error);

/// Frees a face that no running call uses; nothing happens for NULL.
void anyface_face_free(AnyfaceFace *face);

/// Parts the lips of a face along the valley between them and sews the inside of a mouth behind them. At
/// rest the surface stays the same. The jaw of the result is dropped by 20 mm once, to see that the lips
/// part smoothly and alike on both sides. Long: accepts a progress handle, which may be NULL.
///
/// Whether there is anything to part says `anyface_face_mouth()`: `ANYFACE_MOUTH_WELDED`.
/// Free with `anyface_opened_face_free()`. The new mesh is made ready as any other, with the landmarks of
/// `anyface_opened_face_copy_landmarks()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` if the lips part already or the landmarks name no mouth,
/// `ANYFACE_STATUS_MESH` if no line leads from corner to corner between the lips or they do not part well,
/// `ANYFACE_STATUS_CANCELLED`.
AnyfaceStatus anyface_open_mouth(const AnyfaceEngine *engine,
                                 const AnyfaceFace *face,
                                 const AnyfaceProgress *progress,
                                 AnyfaceOpenedFace **out,
                                 AnyfaceError **error);

/// Cuts free the eyes of a face that are one surface with their lids: the lids get a lining, the eyes become the fronts of
/// balls. At rest the surface stays the same. The result blinks once, to see that lids shut over the whole eye.
/// Long: accepts a progress handle, which may be NULL.
///
/// Whether there is such an eye says `anyface_face_lids()`: `ANYFACE_LIDS_JOINED`.
/// Free with `anyface_opened_face_free()`. The new mesh is made ready as any other, with the landmarks of
/// `anyface_opened_face_copy_landmarks()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` if no eye is one with its lids, `ANYFACE_STATUS_MESH` if no line leads
/// around an eye or its lids do not shut well, `ANYFACE_STATUS_CANCELLED`.
AnyfaceStatus anyface_open_eyes(const AnyfaceEngine *engine,
                                const AnyfaceFace *face,
                                const AnyfaceProgress *progress,
                                AnyfaceOpenedFace **out,
                                AnyfaceError **error);

/// The new mesh, a copy: `V` vertices and `F` triangles. Free with `anyface_mesh_free()`.
AnyfaceStatus anyface_opened_face_mesh(const AnyfaceOpenedFace *opened,
                                       AnyfaceMesh **out,
                                       AnyfaceError **error);

/// Number of the first triangle behind the cut that has the colour of what is before it: the inner sides of lips and lids,
/// and the rest of eyeballs, up to `anyface_opened_face_first_inside_triangle()`; 0 for NULL.
size_t anyface_opened_face_first_lining_triangle(const AnyfaceOpenedFace *opened);

/// Number of the first triangle of the mouth's inside behind the lips, `F` where eyes were opened; 0 for NULL.
size_t anyface_opened_face_first_inside_triangle(const AnyfaceOpenedFace *opened);

/// Copies of which old vertices each vertex is a mixture, for groups and shape keys. Vertices behind
/// the cut take what lies before them at its rim.
///
/// `vertices`: `[V, 3]`, numbers of old vertices. `shares`: `[V, 3]`, sum 1. `count` must be `V * 3`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `count`.
AnyfaceStatus anyface_opened_face_copy_vertex_sources(const AnyfaceOpenedFace *opened,
                                                      uint32_t *vertices,
                                                      float *shares,
                                                      size_t count,
                                                      AnyfaceError **error);

/// Copies which old triangle each triangle was cut from, for materials, and where in it its corners lie,
/// for texture coordinates and normals.
///
/// `triangles`: `[F]`, numbers of old triangles. `shares`: `[F, 3, 3]`, for each corner the shares of the
/// old triangle's corners, sum 1. `triangle_count` must be `F`, `share_count` `F * 9`. Fails with
/// `ANYFACE_STATUS_INVALID_INPUT` for other counts.
AnyfaceStatus anyface_opened_face_copy_triangle_sources(const AnyfaceOpenedFace *opened,
                                                        uint32_t *triangles,
                                                        size_t triangle_count,
                                                        float *shares,
                                                        size_t share_count,
                                                        AnyfaceError **error);

/// Copies the landmarks of the new mesh, those of the inner lips, or of the lids, on their own rim.
///
/// `positions`: `[68, 3]`, mesh units. `vertices`: `[68]`, numbers of the nearest vertices.
AnyfaceStatus anyface_opened_face_copy_landmarks(const AnyfaceOpenedFace *opened,
                                                 float *positions,
                                                 uint32_t *vertices,
                                                 AnyfaceError **error);

/// Frees an opened face that no running call uses; nothing happens for NULL.
void anyface_opened_face_free(AnyfaceOpenedFace *opened);

/// Name of an emotion: "neutral" (0), "happy" (1), ... "drunk" (14); NULL from
/// `ANYFACE_EMOTION_COUNT` on. Lives as long as the library is loaded.
const char *anyface_emotion_name(size_t index);

/// Reads emotions as text, such as "happy:0.7" or "happy:0.4,surprised:0.3".
///
/// `strengths` receives `ANYFACE_EMOTION_COUNT` values, one for each emotion.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for an unknown name, a strength below 0, or strengths
/// whose sum is above 1.5.
AnyfaceStatus anyface_emotion_parse(const char *text, float *strengths, AnyfaceError **error);

/// A word whose units are laid down, such as "smile" or "jaw drop", for a menu; NULL from the last one on. Lives as long
/// as the library is loaded.
const char *anyface_expression_word(size_t index);

/// Reads what an expression asks of a face: units such as "12,6L", a word of `anyface_expression_word()` with a side
/// anywhere, such as "left wink", or English words, such as "winks with the right eye". Behind it ":0.5" may give the
/// strength, and a "!" puts it over the speech.
///
/// `weights_dir`: UTF-8, a folder of models that holds `text_units`, which may read by CLIP, or NULL for the built-in
/// reader; the last one is kept, and loaded at the first text that is neither a unit nor a word of the list.
/// `text`: UTF-8. One that says nothing to a face has no units, and `anyface_expression_hint()` says why. Free with
/// `anyface_expression_free()`. Fails with `ANYFACE_STATUS_INVALID_INPUT` for a text of more than 1,000 letters,
/// `ANYFACE_STATUS_WEIGHTS` or `ANYFACE_STATUS_IO` for a folder that cannot be used.
AnyfaceStatus anyface_expression_new(const char *weights_dir,
                                     const char *text,
                                     AnyfaceExpression **out,
                                     AnyfaceError **error);

/// Number of units; 0 for NULL.
size_t anyface_expression_unit_count(const AnyfaceExpression *expression);

/// A unit as `AnyfaceEvent` takes it: "12", "45L". NULL from the count on, for NULL. Lives as long as the
/// expression.
const char *anyface_expression_unit(const AnyfaceExpression *expression,
                                    size_t index);

/// How strongly the text asks for it, 0 to 2, 1 for a plain word; 0 without units, for NULL.
float anyface_expression_strength(const AnyfaceExpression *expression);

/// 1 where a "!" puts it over the speech, otherwise 0.
int32_t anyface_expression_over_speech(const AnyfaceExpression *expression);

/// The text without strength and "!"; NULL for NULL. Lives as long as the expression.
const char *anyface_expression_said(const AnyfaceExpression *expression);

/// Why there are no units, with the nearest expression that would be understood where one is near, a sentence in English;
/// NULL where there are some, for NULL. Lives as long as the expression.
const char *anyface_expression_hint(const AnyfaceExpression *expression);

/// Frees an expression that no running call uses; nothing happens for NULL.
void anyface_expression_free(AnyfaceExpression *expression);

/// Number of an action unit that events may name, as text: "1", "2", "4" ... "28"; NULL from the last one on.
/// Lives as long as the library is loaded.
const char *anyface_action_unit_name(size_t index);

/// What an action unit does, such as "lip corner puller", as `anyface_action_unit_name()`.
const char *anyface_action_unit_label(size_t index);

/// Events from arrays, which are copied; set them in `AnyfaceMotionOptions`.
///
/// `events`: `[event_count]`, in any order; they may overlap. Free with `anyface_events_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for times that do not rise, an unknown unit or a strength out of
/// range; the message names the event, counted from 1.
AnyfaceStatus anyface_events_new(const AnyfaceEvent *events,
                                 size_t event_count,
                                 AnyfaceEvents **out,
                                 AnyfaceError **error);

/// Events from JSON: a list, or an object with a list `events`, of `{"start_s": 1.2, "end_s": 2.0, "units":
/// ["12", "45L"], "strength": 0.8, "over_speech": false}`; the last two may be left out, and `units` may be one
/// expression, such as "left wink".
///
/// `weights_dir`: as in `anyface_expression_new()`. `json`: UTF-8. Free with `anyface_events_free()`. Fails as
/// `anyface_events_from_text()` does.
AnyfaceStatus anyface_events_parse(const char *weights_dir,
                                   const char *json,
                                   AnyfaceEvents **out,
                                   AnyfaceError **error);

/// Events from lines of text, as the command reads them: seconds, units or words, and strength, as in
/// "1.2-2.0:smile:0.8" or "2.4-2.8:45L"; empty lines are left out. What stands behind the seconds is read as
/// `anyface_expression_new()` reads it.
///
/// `weights_dir`: as in `anyface_expression_new()`. `text`: UTF-8. Free with `anyface_events_free()`. Fails as
/// `anyface_events_new()` does, and for words that say
/// nothing to a face, with the nearest that do.
AnyfaceStatus anyface_events_from_text(const char *weights_dir,
                                       const char *text,
                                       AnyfaceEvents **out,
                                       AnyfaceError **error);

/// The events as JSON that `anyface_events_parse()` reads: a list, each row with a list of units and all its fields. NULL
/// for NULL. Lives as long as the events.
const char *anyface_events_json(const AnyfaceEvents *events);

/// Number of events; 0 for NULL.
size_t anyface_events_count(const AnyfaceEvents *events);

/// Frees events that no running call uses; nothing happens for NULL.
void anyface_events_free(AnyfaceEvents *events);

/// Sets every option to its default. `struct_size` is `sizeof *options`.
///
/// Fails with `ANYFACE_STATUS_NULL_POINTER`, or `ANYFACE_STATUS_INVALID_INPUT` for a size that no
/// version had.
AnyfaceStatus anyface_motion_options_init(AnyfaceMotionOptions *options, size_t struct_size);

/// Speech becomes motion. Long: accepts a progress handle.
///
/// `options` and `progress` may be NULL. Free with `anyface_motion_free()`.
/// Fails with `ANYFACE_STATUS_AUDIO` for a sound too short to use, `ANYFACE_STATUS_INVALID_INPUT`
/// for an option out of range, `ANYFACE_STATUS_CANCELLED`.
AnyfaceStatus anyface_motion_new(const AnyfaceEngine *engine,
                                 const AnyfaceAudio *audio,
                                 const AnyfaceMotionOptions *options,
                                 const AnyfaceProgress *progress,
                                 AnyfaceMotion **out,
                                 AnyfaceError **error);

/// The same speech with other controls, another emotion, or another seed of blinks and accents: nothing is
/// heard or sampled again, which takes milliseconds.
///
/// Style, frame rate and what else the system samples with stay those of `motion`; for weights that
/// learned emotion themselves (the built-in ones did not) so does what they show of it. `options` may be NULL.
/// Free with `anyface_motion_free()`; `motion` may go before.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for a motion that the caller brought, or an option out of
/// range.
AnyfaceStatus anyface_motion_new_again(const AnyfaceEngine *engine,
                                       const AnyfaceMotion *motion,
                                       const AnyfaceMotionOptions *options,
                                       AnyfaceMotion **out,
                                       AnyfaceError **error);

/// What is said in a motion alone, without what is felt: of the same sound, which is not heard again. The clip of `motion`
/// less that of the result, by `anyface_clip_new_difference()`, is what is felt. Long: accepts a progress handle.
///
/// `progress` may be NULL. Free with `anyface_motion_free()`; `motion` may go before.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for a motion that was not spoken, or a system that does not tell both apart:
/// see `anyface_system_hears_emotion()`; `ANYFACE_STATUS_CANCELLED`.
AnyfaceStatus anyface_motion_new_content(const AnyfaceEngine *engine,
                                         const AnyfaceMotion *motion,
                                         const AnyfaceProgress *progress,
                                         AnyfaceMotion **out,
                                         AnyfaceError **error);

/// Motion with a stretch of it as in `again`, which was spoken of the same sound in another way: with another
/// seed, emotion, controls or closures.
///
/// Frames at `start_s` and before, at `end_s` and after stay to the bit; within a tenth of a second, or a
/// quarter of the stretch, the old motion becomes the new one, except at the ends of the sound. Head and eyes
/// go along. Free with `anyface_motion_free()`; both may go before. The result cannot be performed again.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for times that hold no frame, motion of another kind or frame
/// rate or length, or motion that the caller brought.
AnyfaceStatus anyface_motion_new_redone(const AnyfaceMotion *motion,
                                        const AnyfaceMotion *again,
                                        double start_s,
                                        double end_s,
                                        AnyfaceMotion **out,
                                        AnyfaceError **error);

/// Some frames of a motion, with all that they have beside their landmarks. Head and eyes go along.
///
/// Free with `anyface_motion_free()`; `motion` may go before. The result cannot be performed again.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for no frames, or frames that the motion lacks.
AnyfaceStatus anyface_motion_new_frames(const AnyfaceMotion *motion,
                                        size_t first,
                                        size_t count,
                                        AnyfaceMotion **out,
                                        AnyfaceError **error);

/// Motion that the caller brings: from a tracker, or edited. The array is copied.
///
/// `displacements`: `[frame_count, 68, 3]` from the neutral face, canonical metres.
/// `fps`: frames per second, 1 to 240. Free with `anyface_motion_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for no frames, values that are not finite or beyond 10 metres, or a frame
/// rate out of range.
AnyfaceStatus anyface_motion_new_displacements(const float *displacements,
                                               size_t frame_count,
                                               double fps,
                                               AnyfaceMotion **out,
                                               AnyfaceError **error);

/// The pose of a face whose vertices are displaced, as a motion of one frame: what `starts_from` of
/// `AnyfaceMotionOptions` takes. The array is copied.
///
/// `displacements`: `[vertex_count, 3]` from the face at rest, mesh units and axes. Landmarks are kept of it, and what
/// the tongue does beside its jaw, where the face has one that moves by itself. Free with `anyface_motion_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another number of vertices than the face has, or values that are not
/// finite.
AnyfaceStatus anyface_motion_new_pose(const AnyfaceFace *face,
                                      const float *displacements,
                                      size_t vertex_count,
                                      AnyfaceMotion **out,
                                      AnyfaceError **error);

/// Number `T` of frames; 0 for NULL.
size_t anyface_motion_frame_count(const AnyfaceMotion *motion);

/// Frames per second; 0 for NULL.
double anyface_motion_fps(const AnyfaceMotion *motion);

/// The emotion that was heard in the voice, as the JSON object that reports of the command have: `time_s`, seconds, and at
/// each of them the `probability` of every emotion by name, the `intensity` that is shown, and `valence` and `arousal`, -1
/// to 1, which are derived from the probabilities. NULL where the motion does not depend on it, or for NULL. Lives as long
/// as the motion.
const char *anyface_motion_heard_emotion(const AnyfaceMotion *motion);

/// Copies motion of landmarks into the caller's buffer.
///
/// `buffer`: `[T, 68, 3]`, canonical metres; `float_count` must be `T * 68 * 3`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`, or a system that moves no
/// landmarks.
AnyfaceStatus anyface_motion_copy_displacements(const AnyfaceMotion *motion,
                                                float *buffer,
                                                size_t float_count,
                                                AnyfaceError **error);

/// Copies how far emotion is believed beside what is said in one frame, for each vertex of a face: where the face
/// shows the one and where the other.
///
/// `frame`: below `T`. `buffer`: `[V]`, 0 to 1, 0 where nothing of the face is followed; `float_count` must be `V`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`, a frame out of range, a motion that was
/// not spoken, or where the system of the engine or of the motion does not tell both apart: see
/// `anyface_system_hears_emotion()`.
AnyfaceStatus anyface_motion_copy_mask(const AnyfaceMotion *motion,
                                       const AnyfaceEngine *engine,
                                       const AnyfaceFace *face,
                                       size_t frame,
                                       float *buffer,
                                       size_t float_count,
                                       AnyfaceError **error);

/// Copies the rotation of the head into the caller's buffer; 0 throughout where nothing was spoken.
///
/// `buffer`: `[T, 3]`: rotation vectors in radians about canonical axes through the origin between the
/// jaw's hinges; about +x nods down, about +y turns to the subject's left, about +z tilts to the subject's
/// right. `float_count` must be `T * 3`. The displacements do not hold it.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`.
AnyfaceStatus anyface_motion_copy_head(const AnyfaceMotion *motion,
                                       float *buffer,
                                       size_t float_count,
                                       AnyfaceError **error);

/// Copies the rotation of the eyes into the caller's buffer; 0 throughout where nothing was spoken.
///
/// `buffer`: `[T, 2, 2]`: right eye, left eye; yaw to the subject's left and pitch up, radians against the
/// head. `float_count` must be `T * 4`. The displacements of the lids follow it.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`.
AnyfaceStatus anyface_motion_copy_gaze(const AnyfaceMotion *motion,
                                       float *buffer,
                                       size_t float_count,
                                       AnyfaceError **error);

/// Copies what the tongue does into the caller's buffer: `[T, 4]`, shares of the way from rest to contact, 0 to 1: tip
/// to the ridge behind the upper teeth, middle and back to the palate, tip at the upper teeth. `float_count` must be
/// `T * 4`. Clips hold it where the face has a tongue that moves by itself.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`.
AnyfaceStatus anyface_motion_copy_tongue(const AnyfaceMotion *motion,
                                         float *buffer,
                                         size_t float_count,
                                         AnyfaceError **error);

/// Writes the motion as npz for numpy: `landmark_displacements` `[T, 68, 3]`, canonical metres, `fps`,
/// and for motion that was spoken `head` `[T, 3]`, `gaze` `[T, 2, 2]` and `tongue` `[T, 4]` as the functions that copy
/// them give them. Motion of weights has `weights` `[T, S]`, their `names` `[S]` and `together` `[T]`, how far lips have
/// to meet, too; its landmarks are the mean face's.
///
/// `path`: UTF-8, ends in .npz; for motion of weights in .csv or .json as well, as `anyface_weights_write()`
/// writes them. Fails with `ANYFACE_STATUS_INVALID_INPUT` for another ending,
/// `ANYFACE_STATUS_IO` if the file cannot be written; then nothing is left of it.
AnyfaceStatus anyface_motion_write(const AnyfaceMotion *motion,
                                   const char *path,
                                   AnyfaceError **error);

/// Frees a motion that no running call uses; nothing happens for NULL.
void anyface_motion_free(AnyfaceMotion *motion);

/// Number `S` of shapes whose weights the system made, such as the 51 of ARKit that `cafe-talk` moves; 0 for a
/// system that moves something else, for NULL.
size_t anyface_motion_weight_count(const AnyfaceMotion *motion);

/// Name of a shape, ARKit's; NULL from the count on, for NULL. Lives as long as the motion.
const char *anyface_motion_weight_name(const AnyfaceMotion *motion, size_t shape);

/// Copies motion of weights into the caller's buffer: as the system made it, nothing is solved.
///
/// `buffer`: `[T, S]`, 0 to 1, in the order of `anyface_motion_weight_name()`; `float_count` must be `T * S`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`, or a system that moves no weights.
AnyfaceStatus anyface_motion_copy_weights(const AnyfaceMotion *motion,
                                          float *buffer,
                                          size_t float_count,
                                          AnyfaceError **error);

/// Speech and a face become a clip: `anyface_motion_new()` and `anyface_clip_new()` in one. Long:
/// accepts a progress handle.
///
/// `options` and `progress` may be NULL. Free with `anyface_clip_free()`.
/// Fails as those two do.
AnyfaceStatus anyface_engine_animate(const AnyfaceEngine *engine,
                                     const AnyfaceFace *face,
                                     const AnyfaceAudio *audio,
                                     const AnyfaceMotionOptions *options,
                                     const AnyfaceProgress *progress,
                                     AnyfaceClip **out,
                                     AnyfaceError **error);

/// Puts motion on a face. Long: accepts a progress handle.
///
/// `progress` may be NULL. Free with `anyface_clip_free()`; face and motion may go before.
/// Fails with `ANYFACE_STATUS_CANCELLED`, and with `ANYFACE_STATUS_OUT_OF_MEMORY` where all frames at once
/// do not fit: `anyface_clip_stream()` hands them over block by block.
AnyfaceStatus anyface_clip_new(const AnyfaceEngine *engine,
                               const AnyfaceFace *face,
                               const AnyfaceMotion *motion,
                               const AnyfaceProgress *progress,
                               AnyfaceClip **out,
                               AnyfaceError **error);

/// What a clip does beyond another one of the same face, such as how it is felt beyond what is said: `other`
/// and the result add up to `clip`.
///
/// It has no head and no eyes. Free with `anyface_clip_free()`; both may go before.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` where frames, vertices or rates differ.
AnyfaceStatus anyface_clip_new_difference(const AnyfaceClip *clip,
                                          const AnyfaceClip *other,
                                          AnyfaceClip **out,
                                          AnyfaceError **error);

/// Number `T` of frames; 0 for NULL.
size_t anyface_clip_frame_count(const AnyfaceClip *clip);

/// Number `V` of vertices; 0 for NULL.
size_t anyface_clip_vertex_count(const AnyfaceClip *clip);

/// Frames per second; 0 for NULL.
double anyface_clip_fps(const AnyfaceClip *clip);

/// Length of the largest displacement of any vertex in any frame, mesh units; 0 for NULL.
///
float anyface_clip_largest_displacement(const AnyfaceClip *clip);

/// What a viewer sees, an `AnyfaceVisibility`: tell the user where that is not the speech. -1 for NULL.
int32_t anyface_clip_visibility(const AnyfaceClip *clip);

/// Lends all displacements: `[T, V, 3]`, mesh units, added to the neutral positions.
///
/// The pointer is valid until the clip is freed; the values never change. NULL for NULL.
const float *anyface_clip_displacements(const AnyfaceClip *clip);

/// Copies all displacements into the caller's buffer.
///
/// `buffer`: `[T, V, 3]`, mesh units; `float_count` must be `T * V * 3`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`.
AnyfaceStatus anyface_clip_copy_displacements(const AnyfaceClip *clip,
                                              float *buffer,
                                              size_t float_count,
                                              AnyfaceError **error);

/// Copies the displacements of one frame into the caller's buffer.
///
/// `frame`: below `T`. `buffer`: `[V, 3]`, mesh units; `float_count` must be `V * 3`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count` or a frame out of range.
AnyfaceStatus anyface_clip_copy_frame(const AnyfaceClip *clip,
                                      size_t frame,
                                      float *buffer,
                                      size_t float_count,
                                      AnyfaceError **error);

/// Copies the 68 landmarks at rest into the caller's buffer.
///
/// `buffer`: `[68, 3]`, mesh units; `float_count` must be 204.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`.
AnyfaceStatus anyface_clip_copy_landmarks_neutral(const AnyfaceClip *clip,
                                                  float *buffer,
                                                  size_t float_count,
                                                  AnyfaceError **error);

/// Copies the displacements of the 68 landmarks into the caller's buffer.
///
/// `buffer`: `[T, 68, 3]`, mesh units; `float_count` must be `T * 68 * 3`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`.
AnyfaceStatus anyface_clip_copy_landmark_displacements(const AnyfaceClip *clip,
                                                       float *buffer,
                                                       size_t float_count,
                                                       AnyfaceError **error);

/// Writes the clip as a file whose kind follows from the end of its name.
///
/// .npz for numpy: `displacements` `[T, V, 3]`, `landmarks_neutral` `[68, 3]`,
/// `landmark_displacements` `[T, 68, 3]`, mesh units, `fps`, and for motion that was spoken `head` `[T, 3]`
/// and `gaze` `[T, 2, 2]` as `anyface_motion_copy_head()` and `_gaze()` give them, and `tongue` `[T, 4]`, which the
/// displacements hold. .pc2 and .mdd: point caches of
/// positions for Blender, Maya, Houdini and others. .glb: morph targets and their weights over time for browsers and
/// engines, .usda: the same as blend shapes of USD; both of the mesh alone. `anyface_clip_write_shapes()` writes ARKit's shapes
/// instead, and .vrma.
/// `mesh`: the mesh of the clip's face. `path`: UTF-8.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another ending or another mesh,
/// `ANYFACE_STATUS_IO` if the file cannot be written; then nothing is left of it.
AnyfaceStatus anyface_clip_write(const AnyfaceClip *clip,
                                 const AnyfaceMesh *mesh,
                                 const char *path,
                                 AnyfaceError **error);

/// Writes the clip on the shapes of its mesh as a file whose kind follows from the end of its name.
///
/// .glb and .usda: the 52 ARKit shapes of `rig` with weights over time that are solved for the clip. .vrma: a VRM animation, which
/// moves any avatar: expressions of VRM and, under the names of Perfect Sync, ARKit's; the turns of the head, and where the
/// eyes look. Anything else as `anyface_clip_write()` writes it. `rig`: that of the clip's mesh. `path`: UTF-8.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another ending or the rig of another mesh, `ANYFACE_STATUS_IO` if the file
/// cannot be written; then nothing is left of it.
AnyfaceStatus anyface_clip_write_shapes(const AnyfaceClip *clip,
                                        const AnyfaceRig *rig,
                                        const char *path,
                                        AnyfaceError **error);

/// Frees a clip that no running call uses, with everything it lent; nothing happens for NULL.
void anyface_clip_free(AnyfaceClip *clip);

/// Puts motion on a face and hands the frames over as they are made, so that a clip of any length needs
/// no more memory than a few blocks. Long: accepts a progress handle.
///
/// `frames_at_once`: frames of a block, at least 1; the last may have fewer. `take_frames`, with `user`:
/// gets every block. `progress` may be NULL. The frames are those of `anyface_clip_new()` but
/// for the rounding of products of other sizes, a millionth of the largest displacement.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for no frames at once, `ANYFACE_STATUS_CANCELLED` where
/// `take_frames` or the progress handle asks to stop.
AnyfaceStatus anyface_clip_stream(const AnyfaceEngine *engine,
                                  const AnyfaceFace *face,
                                  const AnyfaceMotion *motion,
                                  size_t frames_at_once,
                                  AnyfaceFramesFn take_frames,
                                  void *user,
                                  const AnyfaceProgress *progress,
                                  AnyfaceError **error);

/// Finds what of the events of a motion nobody will see: events behind the end of the sound, and units that
/// this face cannot show, such as brows where it has none. After a clip of this face it is also told where no head of
/// the system's own model is like the face, so that landmarks alone moved it. Where the face has no tongue that moves by
/// itself it is told as well, and what its mouth cannot show of speech: lips that do not meet in p, b, m, a lower lip that
/// does not reach the upper teeth in f and v, lips that something hides. Long for a face that was never asked for its
/// shapes: accepts a progress handle.
///
/// `motion` is that of `anyface_motion_new()`. `progress` may be NULL. Free with `anyface_event_notes_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for motion that was not spoken, `ANYFACE_STATUS_CANCELLED`.
AnyfaceStatus anyface_event_notes_new(const AnyfaceEngine *engine,
                                      const AnyfaceFace *face,
                                      const AnyfaceMotion *motion,
                                      const AnyfaceProgress *progress,
                                      AnyfaceEventNotes **out,
                                      AnyfaceError **error);

/// Number of sentences; 0 for NULL.
size_t anyface_event_notes_count(const AnyfaceEventNotes *notes);

/// A sentence, UTF-8; NULL from the count on, for NULL. Lives as long as the notes.
const char *anyface_event_notes_text(const AnyfaceEventNotes *notes, size_t index);

/// Frees notes that no running call uses; nothing happens for NULL.
void anyface_event_notes_free(AnyfaceEventNotes *notes);

/// Finds the fewest shapes that keep every vertex in every frame within `max_error` of its place.
/// Accepts a progress handle.
///
/// `max_error`: mesh units, 0 or more. `max_shapes`: at least 1; where they do not suffice,
/// `anyface_basis_max_error()` tells the error that is left. `progress` may be NULL. A clip that
/// does not move has no shapes. Where the error allows, no more than 20 of them have a weight other
/// than 0 in the same frame. Free with `anyface_basis_free()`; the clip may go before.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for numbers out of range, `ANYFACE_STATUS_CANCELLED`.
AnyfaceStatus anyface_basis_new(const AnyfaceEngine *engine,
                                const AnyfaceClip *clip,
                                float max_error,
                                size_t max_shapes,
                                const AnyfaceProgress *progress,
                                AnyfaceBasis **out,
                                AnyfaceError **error);

/// Number `K` of shapes; 0 for NULL.
size_t anyface_basis_shape_count(const AnyfaceBasis *basis);

/// Largest distance of any vertex in any frame from where the clip has it, mesh units; 0 for NULL.
float anyface_basis_max_error(const AnyfaceBasis *basis);

/// Copies the shapes into the caller's buffer.
///
/// `buffer`: `[K, V, 3]`, mesh units; `float_count` must be `K * V * 3`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`.
AnyfaceStatus anyface_basis_copy_shapes(const AnyfaceBasis *basis,
                                        float *buffer,
                                        size_t float_count,
                                        AnyfaceError **error);

/// Copies the weights into the caller's buffer.
///
/// `buffer`: `[T, K]`, -1 to 1; `float_count` must be `T * K`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`.
AnyfaceStatus anyface_basis_copy_weights(const AnyfaceBasis *basis,
                                         float *buffer,
                                         size_t float_count,
                                         AnyfaceError **error);

/// Frees a basis that no running call uses, with everything it lent; nothing happens for NULL.
void anyface_basis_free(AnyfaceBasis *basis);

/// Finds what the sliders of a take change. Long: accepts a progress handle.
///
/// `motion` is that of `anyface_motion_new()`, `clip` the same motion on `face`, and `basis` that clip
/// as few shapes. Motion that the caller brought has no sliders. `progress` may be NULL. Free with
/// `anyface_sliders_free()`; everything else may go before.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for a clip or basis of another motion,
/// `ANYFACE_STATUS_CANCELLED`.
AnyfaceStatus anyface_sliders_new(const AnyfaceEngine *engine,
                                  const AnyfaceFace *face,
                                  const AnyfaceMotion *motion,
                                  const AnyfaceClip *clip,
                                  const AnyfaceBasis *basis,
                                  const AnyfaceProgress *progress,
                                  AnyfaceSliders **out,
                                  AnyfaceError **error);

/// Number `N` of knots of an `AnyfaceSlider`; 0 where it moves nothing, for another number, for NULL.
size_t anyface_sliders_knot_count(const AnyfaceSliders *sliders,
                                  int32_t slider);

/// Copies the knots of an `AnyfaceSlider` into the caller's buffer.
///
/// `buffer`: `[N]`; `float_count` must be `N`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count` or slider.
AnyfaceStatus anyface_sliders_copy_knots(const AnyfaceSliders *sliders,
                                         int32_t slider,
                                         float *buffer,
                                         size_t float_count,
                                         AnyfaceError **error);

/// Copies what an `AnyfaceSlider` adds at each of its knots into the caller's buffer.
///
/// `buffer`: `[N, T, K]`, in the weights of the basis; `float_count` must be `N * T * K`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count` or slider.
AnyfaceStatus anyface_sliders_copy_changes(const AnyfaceSliders *sliders,
                                           int32_t slider,
                                           float *buffer,
                                           size_t float_count,
                                           AnyfaceError **error);

/// Frees sliders that no running call uses; nothing happens for NULL.
void anyface_sliders_free(AnyfaceSliders *sliders);

/// Finds few keys for weights of shapes, so that no vertex is farther than `tolerance` from its
/// place in any frame. Accepts a progress handle.
///
/// `weights`: `[frame_count, curve_count]`. `shapes`: `[curve_count, vertex_count, 3]`,
/// displacements at weight 1. `tolerance`: above 0, in the unit of the shapes. `touching`:
/// `[frame_count]`, 1 where lips touch: there a tenth of the tolerance is left, and such a stretch
/// begins and ends with a key on every curve that moves by more than the tolerance; may be NULL.
/// `progress` may be NULL. Free with `anyface_curves_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for values that are not finite, `ANYFACE_STATUS_CANCELLED`.
AnyfaceStatus anyface_curves_new(const float *weights,
                                 size_t frame_count,
                                 size_t curve_count,
                                 const float *shapes,
                                 size_t vertex_count,
                                 float tolerance,
                                 const uint8_t *touching,
                                 const AnyfaceProgress *progress,
                                 AnyfaceCurves **out,
                                 AnyfaceError **error);

/// Finds few keys for values of any kind, each column by itself.
///
/// `values`: `[frame_count, curve_count]`. `limits`: `[curve_count]`, above 0: how far each may be
/// from its values in any frame, in their units. `touching`: `[frame_count]`, 1 for frames in which
/// every curve has a key; may be NULL. Free with `anyface_curves_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for values that are not finite.
AnyfaceStatus anyface_curves_new_each(const float *values,
                                      size_t frame_count,
                                      size_t curve_count,
                                      const float *limits,
                                      const uint8_t *touching,
                                      AnyfaceCurves **out,
                                      AnyfaceError **error);

/// Number of keys of a curve; 0 for NULL and for a curve that there is not.
size_t anyface_curves_key_count(const AnyfaceCurves *curves, size_t curve);

/// Copies the keys of a curve.
///
/// `frames`: the frame of each key, in rising order, the first and the last frame among them.
/// `slopes`: the slope of its handles, per frame. Both have room for `key_count` values, which must
/// be `anyface_curves_key_count()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for a curve that there is not and another `key_count`.
AnyfaceStatus anyface_curves_copy_keys(const AnyfaceCurves *curves,
                                       size_t curve,
                                       uint32_t *frames,
                                       float *slopes,
                                       size_t key_count,
                                       AnyfaceError **error);

/// Frees curves that no running call uses; nothing happens for NULL.
void anyface_curves_free(AnyfaceCurves *curves);

/// Takes or finds the landmarks of a mesh and makes its shapes with the engine's network. Long:
/// accepts a progress handle.
///
/// `options` and `progress` may be NULL; the options' controls have no effect. The mesh may be freed
/// afterwards. Free with `anyface_rig_free()`. Fails as `anyface_face_new()` does.
AnyfaceStatus anyface_rig_new(const AnyfaceEngine *engine,
                              const AnyfaceMesh *mesh,
                              const AnyfaceFaceOptions *options,
                              const AnyfaceProgress *progress,
                              AnyfaceRig **out,
                              AnyfaceError **error);

/// The shapes of `anyface_rig_new()`, with the skin moved by the field of the head of FaceTalk's model that is like the
/// mesh; teeth, tongue, eyeballs and brows stay as they are there. Long: accepts a progress handle.
///
/// `in_betweens`: not 0 for ARKit's shapes at half their weight as well, "NAME_half" behind all others: the face at weight
/// 0.5, which need not lie halfway. The rest as for `anyface_rig_new()`. Fails with
/// `ANYFACE_STATUS_INVALID_INPUT` where no head of the model is like the face.
AnyfaceStatus anyface_rig_new_by_field(const AnyfaceEngine *engine,
                                       const AnyfaceMesh *mesh,
                                       const AnyfaceFaceOptions *options,
                                       int32_t in_betweens,
                                       const AnyfaceProgress *progress,
                                       AnyfaceRig **out,
                                       AnyfaceError **error);

/// Number `S` of shapes, the 52 of ARKit first; 0 for NULL.
size_t anyface_rig_shape_count(const AnyfaceRig *rig);

/// Name of a shape, such as "jawOpen" or "viseme_aa"; lives until the rig is freed. NULL for NULL or
/// a number that is not below the count.
const char *anyface_rig_shape_name(const AnyfaceRig *rig,
                                   size_t shape);

/// Why a shape moves nothing, or what in it does not move, in words; lives until the rig is freed.
/// NULL where there is nothing to say.
const char *anyface_rig_shape_note(const AnyfaceRig *rig, size_t shape);

/// Copies one shape into the caller's buffer.
///
/// `buffer`: `[V, 3]`, displacements at strength 1, mesh units; `float_count` must be `V * 3`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count` or a number that is not below
/// the count.
AnyfaceStatus anyface_rig_copy_shape(const AnyfaceRig *rig,
                                     size_t shape,
                                     float *buffer,
                                     size_t float_count,
                                     AnyfaceError **error);

/// Writes the rig as a file whose kind follows from the end of its name.
///
/// .npz: `names` `[S]`, `deltas` `[S, V, 3]` and `neutral` `[V, 3]`. .vrm: an avatar with VRM's expressions, and the 52 ARKit shapes
/// under the names of Perfect Sync. `source`: the file that the mesh was read from, or NULL; of a VRM (1.0 or 0) all else stays
/// that it has, expressions of the same names become new ones. Other meshes stand on the fewest bones that VRM 1.0 allows.
/// `path` and `source`: UTF-8.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another ending or a source with bones that is no VRM, `ANYFACE_STATUS_IO`
/// if a file cannot be read or written; then nothing is left of it.
AnyfaceStatus anyface_rig_write(const AnyfaceRig *rig,
                                const char *source,
                                const char *path,
                                AnyfaceError **error);

/// Frees a rig that no running call uses, with everything it lent; nothing happens for NULL.
void anyface_rig_free(AnyfaceRig *rig);

/// Finds the weights with which shapes come nearest to a motion: bounded least squares, few and smooth
/// over time, left and right alike where little tells them apart; of shapes that undo each other, by name or by what they
/// move, one at a time. Accepts a progress handle.
///
/// `names`: `[shape_count]`, UTF-8; "…Left" and "…Right" are taken as a pair. `shapes`:
/// `[shape_count, vertex_count, 3]`, displacements at weight 1. `displacements`:
/// `[frame_count, vertex_count, 3]` in the same units, without motion of the whole head. `lips`: `[lip_pairs, 2]`,
/// vertices of the upper and of the lower lip that meet, such as those of the landmarks 61 and 67, 62 and 66, 63 and 65: in
/// frames that bring them together the shapes do so as well as they can; NULL with 0 for none. All are copied. `progress` may be NULL. Free with `anyface_weights_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for values that are not finite or shapes of which none
/// moves, `ANYFACE_STATUS_CANCELLED`.
AnyfaceStatus anyface_weights_new(const char *const *names,
                                  const float *shapes,
                                  size_t shape_count,
                                  const float *displacements,
                                  size_t frame_count,
                                  size_t vertex_count,
                                  const uint32_t *lips,
                                  size_t lip_pairs,
                                  const AnyfaceProgress *progress,
                                  AnyfaceWeights **out,
                                  AnyfaceError **error);

/// The same of a clip, whose displacements stay in the library.
///
/// `shapes`: `[shape_count, vertex_count, 3]`, of the clip's first `vertex_count` vertices; those behind are left out.
/// `to_shapes`: `[3, 3]`, may be NULL; what leads displacements of the clip to the frame of the shapes. The rest as for
/// `anyface_weights_new()`. The clip may go before the weights.
/// Fails as `anyface_weights_new()` does, and with `ANYFACE_STATUS_INVALID_INPUT` for more vertices than the clip has.
AnyfaceStatus anyface_weights_new_of_clip(const AnyfaceClip *clip,
                                          const char *const *names,
                                          const float *shapes,
                                          size_t shape_count,
                                          size_t vertex_count,
                                          const float *to_shapes,
                                          const uint32_t *lips,
                                          size_t lip_pairs,
                                          const AnyfaceProgress *progress,
                                          AnyfaceWeights **out,
                                          AnyfaceError **error);

/// Weights that the caller brings, such as those of `anyface_motion_copy_weights()`, to be written as a file.
///
/// `names`: `[shape_count]`, UTF-8. `weights`: `[frame_count, shape_count]`. Both are copied. Free with
/// `anyface_weights_free()`. Fails with `ANYFACE_STATUS_INVALID_INPUT` for values that are not finite.
AnyfaceStatus anyface_weights_new_from_array(const char *const *names,
                                             const float *weights,
                                             size_t shape_count,
                                             size_t frame_count,
                                             AnyfaceWeights **out,
                                             AnyfaceError **error);

/// Copies the weights into the caller's buffer.
///
/// `buffer`: `[T, S]`, 0 to 1; `float_count` must be `T * S`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`.
AnyfaceStatus anyface_weights_copy(const AnyfaceWeights *weights,
                                   float *buffer,
                                   size_t float_count,
                                   AnyfaceError **error);

/// Share of the motion that the shapes leave out, root mean square over vertices and frames: 0 where
/// they show all of it, 1 where they show none. 0 for NULL and for a motion that does not move.
float anyface_weights_left_out(const AnyfaceWeights *weights);

/// Writes the weights as a file whose kind follows from the end of its name.
///
/// .csv as Live Link Face writes it: the 52 ARKit shapes, those that are not among the names with 0;
/// `fps` must be at least 1. .json: `fps`, `names` `[S]`, `weights` `[T][S]`. `path`: UTF-8.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another ending or frame rate, `ANYFACE_STATUS_IO`
/// if the file cannot be written; then nothing is left of it.
AnyfaceStatus anyface_weights_write(const AnyfaceWeights *weights,
                                    const char *path,
                                    double fps,
                                    AnyfaceError **error);

/// Frees weights that no running call uses; nothing happens for NULL.
void anyface_weights_free(AnyfaceWeights *weights);

/// A head from its numbers, or the random one of a seed.
///
/// `weights_dir`: UTF-8, a folder of models instead of the built-in ones, or NULL. `coefficients`: `[coefficient_count]`,
/// which must be 100, for traits of 0, or `N` as of `anyface_head_coefficient_count()`, or NULL with 0 for the numbers of
/// `seed`. Free with `anyface_head_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another count, numbers that are not finite, and heads far outside what
/// was learned; `ANYFACE_STATUS_WEIGHTS` or `ANYFACE_STATUS_IO` for a folder that cannot be used.
AnyfaceStatus anyface_head_new(const char *weights_dir,
                               const float *coefficients,
                               size_t coefficient_count,
                               uint64_t seed,
                               AnyfaceHead **out,
                               AnyfaceError **error);

/// The head between two others: `share` 0 is `a`, 1 is `b`. Free with `anyface_head_free()`.
///
/// Both must be of the same model. Fails with `ANYFACE_STATUS_INVALID_INPUT` for a share outside 0 to 1.
AnyfaceStatus anyface_head_new_mixed(const AnyfaceHead *a,
                                     const AnyfaceHead *b,
                                     float share,
                                     AnyfaceHead **out,
                                     AnyfaceError **error);

/// The same head with another value along one direction, -4 to 4; 0 is the average. Free with
/// `anyface_head_free()`.
///
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for a value or number out of range.
AnyfaceStatus anyface_head_new_along(const AnyfaceHead *head,
                                     size_t direction,
                                     float value,
                                     AnyfaceHead **out,
                                     AnyfaceError **error);

/// The head that is most like a face at rest: a scan or a model of which the landmarks are known. Long: accepts a
/// progress handle, which may be NULL. Free with `anyface_head_free()`.
///
/// `weights_dir`: as in `anyface_head_new()`. Fails with `ANYFACE_STATUS_INVALID_INPUT` for fewer than 300 vertices on the
/// face, and where it stays more than 3 mm away on average.
AnyfaceStatus anyface_head_fit(const char *weights_dir,
                               const AnyfaceFace *face,
                               const AnyfaceProgress *progress,
                               AnyfaceHead **out,
                               AnyfaceError **error);

/// How far the face lies from the head that was fitted to it, mean, millimetres on a head of human size; 0 for NULL and
/// heads that were not fitted.
float anyface_head_fit_mm(const AnyfaceHead *head);

/// How many numbers a head is, `N`: 100 coefficients and its traits; 0 for NULL.
size_t anyface_head_coefficient_count(const AnyfaceHead *head);

/// Copies the numbers. `buffer`: `[count]`; `count` must be `N`, or 100 for the coefficients alone.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `count`.
AnyfaceStatus anyface_head_copy_coefficients(const AnyfaceHead *head,
                                             float *buffer,
                                             size_t count,
                                             AnyfaceError **error);

/// Number `D` of sliders: traits such as age, then directions in which heads differ, the one that moves the surface
/// furthest first; 0 for NULL.
size_t anyface_head_direction_count(const AnyfaceHead *head);

/// What a slider changes most, such as "age" or "face width"; lives until the head is freed. NULL for NULL or a number
/// that is not below the count.
const char *anyface_head_direction_name(const AnyfaceHead *head,
                                        size_t direction);

/// Copies where each slider stands. `buffer`: `[D]`; `count` must be `D`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `count`.
AnyfaceStatus anyface_head_copy_directions(const AnyfaceHead *head,
                                           float *buffer,
                                           size_t count,
                                           AnyfaceError **error);

/// The head as a mesh at rest, metres. Long where a `resolution` is asked for: accepts a progress handle, which may be
/// NULL. Free with `anyface_mesh_free()`.
///
/// `resolution`: 0 for clean quads, each as two triangles (`anyface_head_copy_faces()` has them whole); else the surface
/// of the field, which knows no traits, with as many cells along the longest side of the grid, such as 128. `parts`: not
/// 0 for eyes, teeth, tongue, lashes and brows beside the skin, whose vertices and triangles come first; the field has
/// none. `skin_vertices`: may be NULL; how many of the vertices are skin. `landmark_vertices`: `[68]`, may be NULL; the
/// vertices on which the landmarks lie.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for a resolution that would take more than 1 GiB, and for one that is not 0
/// with parts.
AnyfaceStatus anyface_head_mesh(const AnyfaceHead *head,
                                size_t resolution,
                                int32_t parts,
                                const AnyfaceProgress *progress,
                                AnyfaceMesh **out,
                                size_t *skin_vertices,
                                uint32_t *landmark_vertices,
                                AnyfaceError **error);

/// Number `F` of faces of the clean quads with their parts, those of the skin first; 0 for NULL.
size_t anyface_head_face_count(const AnyfaceHead *head);

/// Number `S` of faces of the skin; 0 for NULL.
size_t anyface_head_skin_face_count(const AnyfaceHead *head);

/// Copies the faces, four vertices each; the last of a triangle comes twice. `buffer`: `[F, 4]`; `count` must be `4 F`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `count`.
AnyfaceStatus anyface_head_copy_faces(const AnyfaceHead *head,
                                      uint32_t *buffer,
                                      size_t count,
                                      AnyfaceError **error);

/// Copies the texture places of the corners of the skin's faces, (0, 0) to (1, 1) from the lower left. `buffer`:
/// `[S, 4, 2]`; `count` must be `8 S`. Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `count`.
AnyfaceStatus anyface_head_copy_uv(const AnyfaceHead *head,
                                   float *buffer,
                                   size_t count,
                                   AnyfaceError **error);

/// Copies the number of each face's material. `buffer`: `[F]`; `count` must be `F`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `count`.
AnyfaceStatus anyface_head_copy_face_materials(const AnyfaceHead *head,
                                               uint32_t *buffer,
                                               size_t count,
                                               AnyfaceError **error);

/// Number `M` of materials; 0 for NULL.
size_t anyface_head_material_count(const AnyfaceHead *head);

/// What a material is, such as "skin" or "lips"; lives until the head is freed. NULL for NULL or a number that is not
/// below the count.
const char *anyface_head_material_name(const AnyfaceHead *head,
                                       size_t material);

/// Frees a head that no running call uses, with everything it lent; nothing happens for NULL.
void anyface_head_free(AnyfaceHead *head);

/// Starts a performance with a neutral face. Fails with `ANYFACE_STATUS_INVALID_INPUT` for a system that
/// needs the whole sound.
///
/// It may outlive the engine. Free with `anyface_stream_free()`.
AnyfaceStatus anyface_stream_new(const AnyfaceEngine *engine,
                                 AnyfaceStream **out,
                                 AnyfaceError **error);

/// Takes sound and only keeps it: fit for an audio thread that may allocate.
///
/// `samples`: `[S]`, mono at 16 kHz, nominally -1 to 1; any number, also none.
/// Fails with `ANYFACE_STATUS_AUDIO` for samples that are not finite, of which none is then taken,
/// `ANYFACE_STATUS_INVALID_INPUT` after `anyface_stream_finish()`.
AnyfaceStatus anyface_stream_push(AnyfaceStream *stream,
                                  const float *samples,
                                  size_t sample_count,
                                  AnyfaceError **error);

/// Computes the frames that are ready, as many as the buffer has room for.
///
/// `buffer`: `[frame_room, 68, 3]`, displacements from the neutral face in metres; frame `t` of the
/// stream, counted over all pulls, stands at `t / 25` seconds of the sound.
/// `frame_count` receives how many were written; 0 where more sound is needed, or where the
/// performance is over.
AnyfaceStatus anyface_stream_pull(AnyfaceStream *stream,
                                  float *buffer,
                                  size_t frame_room,
                                  size_t *frame_count,
                                  AnyfaceError **error);

/// Ends the sound: silence follows, and every frame that began can be pulled.
///
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` the second time.
AnyfaceStatus anyface_stream_finish(AnyfaceStream *stream, AnyfaceError **error);

/// Emotion from the next frame on, that is the first one of the next pull.
///
/// `strengths`: `[ANYFACE_EMOTION_COUNT]`, 0 or more, at most 1.5 in sum.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for other strengths.
AnyfaceStatus anyface_stream_set_emotion(AnyfaceStream *stream,
                                         const float *strengths,
                                         AnyfaceError **error);

/// Looks ahead by `seconds` at most from the first sound on: the face is sooner, and less sure of what it says. FreeTalk can
/// look 0.19, 0.07 and 0 s ahead; without this a stream looks as far ahead as it can.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` if no look-ahead of the system is so short, or after the first sound.
AnyfaceStatus anyface_stream_look_ahead(AnyfaceStream *stream,
                                        double seconds,
                                        AnyfaceError **error);

/// Lets every sound move the face from the next frame on, singing, music and noise too; before, speech alone does.
AnyfaceStatus anyface_stream_hear_all(AnyfaceStream *stream,
                                      AnyfaceError **error);

/// Seconds of sound after a frame's own instant that it waits for, at most 0.2; 0 for NULL.
double anyface_stream_latency_s(const AnyfaceStream *stream);

/// Frees a stream that no running call uses; nothing happens for NULL.
void anyface_stream_free(AnyfaceStream *stream);

/// Starts a performance with a neutral face. Fails with `ANYFACE_STATUS_INVALID_INPUT` for a system that
/// needs the whole sound.
///
/// It may outlive the engine. Free with `anyface_weight_stream_free()`.
AnyfaceStatus anyface_weight_stream_new(const AnyfaceEngine *engine,
                                        AnyfaceWeightStream **out,
                                        AnyfaceError **error);

/// Name of one of the `ANYFACE_LIVE_SHAPE_COUNT` shapes of a frame, such as "jawOpen", and behind them of its
/// `ANYFACE_LIVE_VISEME_COUNT` visemes, such as "viseme_aa"; NULL from the last one on. Lives as long as the library is loaded.
const char *anyface_weight_stream_name(size_t index);

/// Takes sound and only keeps it: fit for an audio thread that may allocate.
///
/// `samples`: `[S]`, mono at 16 kHz, nominally -1 to 1; any number, also none.
/// Fails with `ANYFACE_STATUS_AUDIO` for samples that are not finite, of which none is then taken,
/// `ANYFACE_STATUS_INVALID_INPUT` after `anyface_weight_stream_finish()`.
AnyfaceStatus anyface_weight_stream_push(AnyfaceWeightStream *stream,
                                         const float *samples,
                                         size_t sample_count,
                                         AnyfaceError **error);

/// Computes the next frame where it is ready; frame `t` stands at `t / 25` seconds of the sound.
///
/// `shapes`: `[ANYFACE_LIVE_SHAPE_COUNT]`, weights of ARKit's shapes, 0 to 1, in the order of `anyface_weight_stream_name()`.
/// `visemes`: `[ANYFACE_LIVE_VISEME_COUNT]`, 0 to 1, in the same order. `head`: `[3]`, rotation vector in
/// radians: x to the subject's left, y up, z to the front.
/// `is_ready` receives 1, or 0 where more sound is needed or the performance is over; then nothing else is written.
AnyfaceStatus anyface_weight_stream_pull(AnyfaceWeightStream *stream,
                                         float *shapes,
                                         float *visemes,
                                         float *head,
                                         int32_t *is_ready,
                                         AnyfaceError **error);

/// Ends the sound: silence follows, and every frame that began can be pulled.
///
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` the second time.
AnyfaceStatus anyface_weight_stream_finish(AnyfaceWeightStream *stream, AnyfaceError **error);

/// Emotion from the next frame on.
///
/// `strengths`: `[ANYFACE_EMOTION_COUNT]`, 0 or more, at most 1.5 in sum.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for other strengths.
AnyfaceStatus anyface_weight_stream_set_emotion(AnyfaceWeightStream *stream,
                                                const float *strengths,
                                                AnyfaceError **error);

/// Shows the emotion that is heard in what is pushed from now on, three times a second anew, until
/// `anyface_weight_stream_set_emotion()` sets one.
AnyfaceStatus anyface_weight_stream_hear_emotion(AnyfaceWeightStream *stream, AnyfaceError **error);

/// Looks ahead by `seconds` at most from the first sound on: the face is sooner, and less sure of what it says. FreeTalk can
/// look 0.19, 0.07 and 0 s ahead; without this a stream looks as far ahead as it can.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` if no look-ahead of the system is so short, or after the first sound.
AnyfaceStatus anyface_weight_stream_look_ahead(AnyfaceWeightStream *stream,
                                               double seconds,
                                               AnyfaceError **error);

/// Lets every sound move the face from the next frame on, singing, music and noise too; before, speech alone does.
AnyfaceStatus anyface_weight_stream_hear_all(AnyfaceWeightStream *stream,
                                             AnyfaceError **error);

/// Seconds of sound after a frame's own instant that it waits for, at most 0.2; 0 for NULL.
double anyface_weight_stream_latency_s(const AnyfaceWeightStream *stream);

/// Frees a stream that no running call uses; nothing happens for NULL.
void anyface_weight_stream_free(AnyfaceWeightStream *stream);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* ANYFACE_H */
