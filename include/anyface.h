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
 * A text that it writes to a `char **` belongs to the caller too: anyface_text_free(). What it lends
 * says how long it lives. Never free() anything that came from here.
 *
 * Requests
 * --------
 *
 * A request says by name how an engine, a face and a performance shall be. anyface_describe() lists
 * what can be asked of a performance, the functions say what else they read:
 *
 *     AnyfaceRequest *request = NULL;
 *     anyface_request_new(&request, &error);
 *     anyface_request_set_text(request, "emotion", "happy:0.7", &error);
 *     anyface_request_set_number(request, "fps", 25.0, &error);
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
 * object must not be freed while another thread uses it. An AnyfaceError, an AnyfaceStream
 * and an AnyfaceRequest that is being changed belong to one thread at a time.
 */


#ifndef ANYFACE_H
#define ANYFACE_H

#include <stddef.h>
#include <stdint.h>

/// Version of this interface, for comparison with `anyface_abi_version()`.
#define ANYFACE_ABI_VERSION 1

/// Number `N` of face landmarks, in the order of iBUG 300-W.
#define ANYFACE_LANDMARK_COUNT 68

/// Number of emotion categories; `emotions` of `anyface_describe()` are their names.
#define ANYFACE_EMOTION_COUNT 15

/// Number of ARKit's shapes in a frame of `anyface_weight_stream_pull()`.
#define ANYFACE_LIVE_SHAPE_COUNT 52

/// Number of Oculus's visemes in a frame of `anyface_weight_stream_pull()`.
#define ANYFACE_LIVE_VISEME_COUNT 15

/// How a call ended. The codes from 3 on are also the exit codes of the `anyface` command.
typedef enum {
    /// The call succeeded.
    ANYFACE_STATUS_OK = 0,
    /// A pointer that must not be NULL was NULL.
    ANYFACE_STATUS_NULL_POINTER = 1,
    /// A defect in the library, which was caught. The call's handles stay valid and can be freed.
    ANYFACE_STATUS_PANIC = 2,
    /// A value outside its stated range, NaN, an unknown name, text that is not UTF-8, or an array
    /// of the wrong length.
    ANYFACE_STATUS_INVALID_INPUT = 3,
    /// A sound that cannot be decoded or used.
    ANYFACE_STATUS_AUDIO = 4,
    /// A mesh that cannot be read or used.
    ANYFACE_STATUS_MESH = 5,
    /// No face was found on the mesh. The message says why and what would help.
    ANYFACE_STATUS_FACE_NOT_FOUND = 6,
    /// Model weights that are missing or truncated, or that do not fit their config.
    ANYFACE_STATUS_WEIGHTS = 7,
    /// A file that could not be read or written.
    ANYFACE_STATUS_IO = 8,
    /// The caller asked to stop.
    ANYFACE_STATUS_CANCELLED = 9,
    /// A numerical method that did not converge, or a defect in the library.
    ANYFACE_STATUS_INTERNAL = 10,
    /// A result that does not fit into memory. Take it block by block from `anyface_clip_stream()`.
    ANYFACE_STATUS_OUT_OF_MEMORY = 13,
} AnyfaceStatus;

/// What a connected part of the mesh is, and what it follows; for `anyface_face_new()` and
/// `anyface_face_copy_parts()`.
typedef enum {
    /// The face itself.
    ANYFACE_PART_ROLE_SKIN = 0,
    /// Follows the lower jaw as a rigid body: lower teeth, lower gums, tongue.
    ANYFACE_PART_ROLE_JAW = 1,
    /// Follows the skull: upper teeth, upper gums, glasses, hair.
    ANYFACE_PART_ROLE_SKULL = 2,
    /// Belongs to both jaws: gums with a tongue, the lining of the mouth.
    ANYFACE_PART_ROLE_MOUTH = 3,
    /// Follows the skin next to its roots: lashes, brows, beards.
    ANYFACE_PART_ROLE_NEAREST = 4,
    /// An eyeball; stays at rest and never deforms.
    ANYFACE_PART_ROLE_GAZE = 5,
    /// Not part of the face; stays at rest.
    ANYFACE_PART_ROLE_STILL = 6,
} AnyfacePartRole;

/// How the lips of a mesh meet.
typedef enum {
    /// They are apart, with nothing or the inside of the mouth between them.
    ANYFACE_MOUTH_OPEN = 0,
    /// They are closed but not joined, so they can part.
    ANYFACE_MOUTH_SLIT = 1,
    /// They are one surface and cannot part.
    ANYFACE_MOUTH_WELDED = 2,
} AnyfaceMouth;

/// What the lids of an eye can do.
typedef enum {
    /// They close.
    ANYFACE_LIDS_CLOSE = 0,
    /// They are sculpted shut and do not move.
    ANYFACE_LIDS_SHUT = 1,
    /// They form one surface with the eye, without a slit between, and do not move.
    ANYFACE_LIDS_JOINED = 2,
} AnyfaceLids;

/// An aspect of a take that can be scaled. At 1 the take stays as it was made.
typedef enum {
    /// How far speech moves the mouth and the jaw: 0 to 2.
    ANYFACE_SLIDER_ARTICULATION = 0,
    /// How strongly the emotion shows: 0 to 1.5. Blinks stay where they are.
    ANYFACE_SLIDER_EMOTION = 1,
    /// How far the eyes close in blinks: 0 to 1.
    ANYFACE_SLIDER_BLINKS = 2,
    /// The change that emotion and blinks make together, beyond what each makes alone. Do not offer
    /// it to users: with emotion at e and blinks at b, set it to 1 - (1 - e) * (1 - b).
    ANYFACE_SLIDER_EMOTION_AND_BLINKS = 3,
} AnyfaceSlider;

/// How much of a clip a viewer can see.
typedef enum {
    /// The mouth speaks, or the options told it to rest.
    ANYFACE_VISIBILITY_SPEAKS = 0,
    /// Lids and brows move but the lips do not: the sound probably contains no speech.
    ANYFACE_VISIBILITY_LIPS_REST = 1,
    /// Nothing moves.
    ANYFACE_VISIBILITY_NOTHING = 2,
} AnyfaceVisibility;

/// The kinds of intervals that sounds have.
typedef enum {
    /// Phones.
    ANYFACE_TIER_PHONES = 0,
    /// Words.
    ANYFACE_TIER_WORDS = 1,
    /// Mouths of a mouth chart.
    ANYFACE_TIER_MOUTHS = 2,
    /// When the lips are together; they have no labels.
    ANYFACE_TIER_CLOSURES = 3,
} AnyfaceTier;

/// The set of mouths that a chart is drawn with.
typedef enum {
    /// Rhubarb's nine, A to H and X.
    ANYFACE_MOUTHS_RHUBARB = 0,
    /// Preston Blair's ten, as Papagayo names them: AI, E, O, U, L, WQ, MBP, FV, etc, rest.
    ANYFACE_MOUTHS_PRESTON_BLAIR = 1,
} AnyfaceMouths;

/// A sound, stored as mono at 16 kHz. It never changes once it is made: any number of threads may
/// use it at the same time.
typedef struct AnyfaceAudio AnyfaceAudio;

/// `K` shapes and their weights in every frame: `displacement[t] = sum over k of weight[t][k] *
/// shape[k]`. Weights lie within -1 and 1. The basis never changes once it is made: any number
/// of threads may use it at the same time.
typedef struct AnyfaceBasis AnyfaceBasis;

/// Displacements of every vertex over time, in the mesh's own units, axes and vertex order. They
/// never change once they are made: any number of threads may read them at the same time.
typedef struct AnyfaceClip AnyfaceClip;

/// `K` curves with few keys each. They never change once they are made: any number of threads may
/// use them at the same time.
///
/// A curve passes through the values at its keys. Between two keys `n` frames apart it is a Bézier
/// segment. Each of its handles lies `0.39 * n` frames from its key, along that key's slope.
typedef struct AnyfaceCurves AnyfaceCurves;

/// Loaded weights and settings. Any number of threads may use one engine at the same time.
typedef struct AnyfaceEngine AnyfaceEngine;

/// Why a call failed: a status and a message in English. Owned by the caller.
typedef struct AnyfaceError AnyfaceError;

/// Everything known about one mesh: its landmarks, how its lips meet, what its parts are, and the
/// data needed to move it. It never changes once it is made: any number of threads may use it at
/// the same time.
typedef struct AnyfaceFace AnyfaceFace;

/// One head of FaceTalk's parametric model. It never changes once it is made: any number of threads
/// may use it at the same time.
///
/// `N` numbers describe it: 100 coefficients, each from a normal distribution, then the value of
/// each trait (age, sex, weight …), -4 to 4. The mean head has only zeros. The frame is in metres,
/// +x to the subject's left, +y up, +z out of the face.
typedef struct AnyfaceHead AnyfaceHead;

/// A triangle mesh in the caller's own units, axes and vertex order. It never changes once it is
/// made: any number of threads may use it at the same time.
typedef struct AnyfaceMesh AnyfaceMesh;

/// Motion before any mesh is known: of landmarks, or of whatever else the system moves. It fits
/// every face and never changes once it is made.
typedef struct AnyfaceMotion AnyfaceMotion;

/// A mesh whose lips or lids were one surface and can part now, and the source of each of its
/// pieces. It never changes once it is made: any number of threads may use it at the same time.
///
/// Old vertices keep their numbers and positions; new ones follow. Old triangles keep their order,
/// and pieces replace those that were cut. The surface that was sewn behind the cut follows.
typedef struct AnyfaceOpenedFace AnyfaceOpenedFace;

/// Watches and stops jobs.
///
/// Pass the handle to a long call. Any other thread can then read and cancel it while the call
/// runs. One handle may serve several calls one after the other. Once cancelled, it stays
/// cancelled.
typedef struct AnyfaceProgress AnyfaceProgress;

/// How an engine, a face and a performance shall be. `anyface_describe()` lists the names of fields
/// and controls that a system obeys; `anyface_engine_new()`, `anyface_face_new()`,
/// `anyface_rig_new()` and `anyface_stream_obey()` say what else they read. Whatever is not set has
/// its default. One request may serve any number of engines, faces, performances and streams: each
/// reads only what concerns it. No other call may use it while it is changed.
typedef struct AnyfaceRequest AnyfaceRequest;

/// The 52 ARKit shapes and the 15 Oculus visemes of one mesh. It never changes once it is made: any
/// number of threads may use it at the same time.
typedef struct AnyfaceRig AnyfaceRig;

/// The change that each slider adds to the weights of a basis: `weight[t][k] + change[t][k]`.
///
/// A slider has `N` knots in rising order. 1 is never among them, because nothing is added there.
/// The change is linear from knot to knot, where 1 counts as a knot without change, and constant
/// beyond the outermost. The changes of several sliders add up. The object never changes once it is
/// made: any number of threads may read it at the same time.
typedef struct AnyfaceSliders AnyfaceSliders;

/// Sounds of speech and their times: heard in a sound, read from a file, or drawn as a mouth chart.
/// It never changes once it is made.
typedef struct AnyfaceSounds AnyfaceSounds;

/// A performance in progress: push sound, pull frames of the 68 landmarks in the canonical frame.
///
/// The frames are the same bit for bit, however the sound is split into pushes. Only one thread at
/// a time may use a stream.
typedef struct AnyfaceStream AnyfaceStream;

/// A performance in progress for characters with their own shapes: push sound, pull weights of
/// ARKit's shapes and of visemes, with blinks, moving eyes and a drifting head.
///
/// The frames are the same bit for bit, however the sound is split into pushes. Only one thread at
/// a time may use a stream.
typedef struct AnyfaceWeightStream AnyfaceWeightStream;

/// Weights of `S` shapes in `T` frames, 0 to 1. They never change once they are made: any number of
/// threads may use them at the same time.
typedef struct AnyfaceWeights AnyfaceWeights;

/// Receives progress. Any result other than 0 asks the job to stop.
///
/// `stage`: "speech", "motion", "landmarks", "operators", "weights", "deform", "compress" or
/// another name. It lives as long as the progress handle. `fraction`: how much of that stage is
/// done, 0 to 1. The library calls it from a thread that may differ from the one that started the
/// job, and from call to call. Calls for one handle never overlap. It must not throw or longjmp,
/// and must not start a job with the same handle.
typedef int (*AnyfaceProgressFn)(void *user, const char *stage, float fraction);

/// Receives frames in order. A result other than 0 ends the job with `ANYFACE_STATUS_CANCELLED`.
///
/// `first_frame`: number of the first frame of the block. `displacements`: `[frame_count, V, 3]`,
/// mesh units, added to the neutral positions; valid only during this call.
/// The library calls it from one of its threads, which may differ from the thread that started the
/// job and from call to call, but never from two at the same time. It must not throw or longjmp.
typedef int (*AnyfaceFramesFn)(void *user,
                               size_t first_frame,
                               size_t frame_count,
                               const float *displacements);

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/// Version of the loaded library's interface.
///
/// It is raised when an existing part of the interface changes its meaning or goes away. A program
/// that loads the library at run time should stop if this differs from its own
/// `ANYFACE_ABI_VERSION`. New functions and new names of a request do not raise it. It counts from the first release on. Until 0.1.0 is out it stays 1 whatever changes,
/// and a program has to be rebuilt with each library.
uint32_t anyface_abi_version(void);

/// Version of the library, such as "0.1.0". It lives as long as the library is loaded.
const char *anyface_version(void);

/// A short name of a status, such as "face not found". "unknown" for a number that is no status.
///
/// The text lives as long as the library is loaded.
const char *anyface_status_name(int32_t status);

/// The message, UTF-8; lives until the error is freed. "" for NULL.
const char *anyface_error_message(const AnyfaceError *error);

/// The status that the failed call returned; `ANYFACE_STATUS_OK` for NULL.
AnyfaceStatus anyface_error_status(const AnyfaceError *error);

/// Frees an error; nothing happens for NULL.
void anyface_error_free(AnyfaceError *error);

/// Makes a handle that watches and stops jobs. The result is never NULL. Free with
/// `anyface_progress_free()`.
///
/// `callback` may be NULL if the program calls `anyface_progress_read()` instead. `user` is passed
/// to the callback unchanged.
AnyfaceProgress *anyface_progress_new(AnyfaceProgressFn callback, void *user);

/// Reads how far the job is. May be called from any thread at any time.
///
/// `stage` receives the name of the stage ("" before the first), which lives until the handle is
/// freed. `fraction` receives how much of that stage is done, 0 to 1. Either may be NULL.
/// Fails with `ANYFACE_STATUS_NULL_POINTER` if `progress` is NULL.
AnyfaceStatus anyface_progress_read(const AnyfaceProgress *progress,
                                    const char **stage,
                                    float *fraction);

/// Asks the job to stop. May be called from any thread. The running call returns
/// `ANYFACE_STATUS_CANCELLED` as soon as it can. Nothing happens for NULL.
void anyface_progress_cancel(const AnyfaceProgress *progress);

/// Frees a progress handle that no running call uses; nothing happens for NULL.
void anyface_progress_free(AnyfaceProgress *progress);

/// Loads the weights. This takes some tenths of a second, so keep the engine.
///
/// `request` may be NULL. An engine reads of it:
/// - "system", a text: the name of the system that turns speech into motion; without it the first
///   of `anyface_describe()`.
/// - "weights_dir", a text: a folder of model files that replace the built-in ones.
/// - "speech_dir", a text: a folder of a HuBERT or wav2vec2 model (`config.json` and
///   `model.safetensors`) that replaces the built-in speech encoder. "weights_dir" must then hold
///   weights that were trained with it.
/// - "cache", a text: a folder for results that depend only on a mesh, or "off". Without it they
///   are kept in the user's cache folder, bounded in size.
/// - "threads", a number: worker threads; 0, the default, for one per core. The result does not
///   depend on it.
///
/// Free with `anyface_engine_free()`.
/// Fails with `ANYFACE_STATUS_WEIGHTS` if a model file is missing, truncated or does not fit its
/// config, and with `ANYFACE_STATUS_INVALID_INPUT` for an unknown system.
AnyfaceStatus anyface_engine_new(const AnyfaceRequest *request,
                                 AnyfaceEngine **out,
                                 AnyfaceError **error);

/// Estimates the peak memory that motion on a mesh needs, bytes, before the work starts. The
/// estimate is within 40 % of the measured values. 0 for NULL.
///
/// `frames_at_once`: frames in memory at once: all of them for `anyface_clip_new()`, two blocks for
/// `anyface_clip_stream()`. `sound_s`: length of the sound for `anyface_motion_new()`, seconds.
/// `anyface_face_new()` and `anyface_clip_new()` fail with `ANYFACE_STATUS_OUT_OF_MEMORY` if the
/// work certainly does not fit into memory.
uint64_t anyface_engine_memory_needed(const AnyfaceEngine *engine,
                                      size_t vertex_count,
                                      size_t frames_at_once,
                                      double sound_s);

/// Memory that this process may still take, bytes; `UINT64_MAX` if the operating system does not
/// say.
uint64_t anyface_memory_left(void);

/// Frees an engine that no running call uses; nothing happens for NULL.
///
/// Faces, motions and clips that were made with it stay valid.
void anyface_engine_free(AnyfaceEngine *engine);

/// Makes a mesh from triangles; the arrays are copied.
///
/// `positions`: `[vertex_count, 3]`, any units. `triangles`: `[triangle_count, 3]`, vertex
/// numbers. Loose vertices, several parts, holes, duplicate triangles and triangles without area
/// are allowed. Free with `anyface_mesh_free()`.
/// Fails with `ANYFACE_STATUS_MESH` for too few triangles, positions that are not finite or vertex
/// numbers out of range.
AnyfaceStatus anyface_mesh_new(const float *positions,
                               size_t vertex_count,
                               const uint32_t *triangles,
                               size_t triangle_count,
                               AnyfaceMesh **out,
                               AnyfaceError **error);

/// Makes a mesh from polygons, which are cut into triangles; the arrays are copied.
///
/// `positions`: `[vertex_count, 3]`, any units. `polygon_sizes`: `[polygon_count]`, number of
/// corners of each. `corners`: `[corner_count]`, the vertex numbers of all polygons, one polygon
/// after the other. Free with `anyface_mesh_free()`.
/// Fails like `anyface_mesh_new()`, and with `ANYFACE_STATUS_INVALID_INPUT` if the sizes do not add
/// up to `corner_count`.
AnyfaceStatus anyface_mesh_new_polygons(const float *positions,
                                        size_t vertex_count,
                                        const uint32_t *polygon_sizes,
                                        size_t polygon_count,
                                        const uint32_t *corners,
                                        size_t corner_count,
                                        AnyfaceMesh **out,
                                        AnyfaceError **error);

/// Reads a mesh from an OBJ, PLY or GLB file. The vertices keep the order of the file.
///
/// `path`: UTF-8. Free with `anyface_mesh_free()`.
/// Fails with `ANYFACE_STATUS_IO` if the file cannot be read, and with `ANYFACE_STATUS_MESH` if it
/// has none of these formats or the mesh cannot be used.
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

/// Makes a sound from samples in memory, which are copied.
///
/// `samples`: `[frame_count, channels]`, interleaved, nominally -1 to 1; the channels are
/// averaged.
/// `sample_rate_hz`: 4000 to 384000. Free with `anyface_audio_free()`.
/// Fails with `ANYFACE_STATUS_AUDIO` if there are no samples or no channels, a sample is not finite
/// or the rate is out of range.
AnyfaceStatus anyface_audio_new(const float *samples,
                                size_t frame_count,
                                uint32_t channels,
                                uint32_t sample_rate_hz,
                                AnyfaceAudio **out,
                                AnyfaceError **error);

/// Reads a sound from a file: WAV, MP3, FLAC, Ogg, WebM, M4A, AAC, CAF or AIFF.
///
/// `path`: UTF-8. Free with `anyface_audio_free()`. If the file is damaged,
/// `anyface_audio_warning()` says how much of the sound is missing.
/// Fails with `ANYFACE_STATUS_IO` if the file cannot be read, and with `ANYFACE_STATUS_AUDIO` if it
/// cannot be decoded, holds no sound, or is so damaged that more than a fifth of the sound is
/// missing. `anyface_audio_read_damaged()` reads such a file anyway.
AnyfaceStatus anyface_audio_read(const char *path, AnyfaceAudio **out, AnyfaceError **error);

/// Like `anyface_audio_read()`, but accepts a damaged file however much of its sound is missing.
AnyfaceStatus anyface_audio_read_damaged(const char *path,
                                         AnyfaceAudio **out,
                                         AnyfaceError **error);

/// A sentence in English that says how much of a sound is missing because its file is damaged, and which
/// audio track of a file with several it is. NULL if there is nothing to say, and for NULL.
///
/// The text lives as long as the sound. A sound from `anyface_audio_trim()` has no warning.
const char *anyface_audio_warning(const AnyfaceAudio *audio);

/// Copies a part of a sound into a new one.
///
/// `start_s`, `duration_s`: seconds, not negative. The part ends at the end of the sound at the
/// latest.
/// Free with `anyface_audio_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for times that are negative or not finite, and with
/// `ANYFACE_STATUS_AUDIO` if the part has no samples.
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

/// Largest magnitude of any sample; 0 for NULL. A sound whose peak is below 0.001 counts as
/// silence.
float anyface_audio_peak(const AnyfaceAudio *audio);

/// Frees a sound that no running call uses; nothing happens for NULL.
void anyface_audio_free(AnyfaceAudio *audio);

/// Draws a mouth chart: it selects one of a few drawn mouths for each frame of a clip.
///
/// The choice depends on how far the lips are apart, how wide the mouth is, and what is said.
/// `said`: when the lips close and which phones are said, from `anyface_sounds_new_with_text()` or
/// a file; may be NULL. `mouths`: an `AnyfaceMouths`. `on`: mouths change only at every `on`-th
/// frame, 1 to 240. `hold`: the fewest frames for which a mouth stays, 1 to 240. `closure_hold` and
/// `vowel_hold`: the same for lips that close for p, b and m, and for the mouths of vowels; 0 takes
/// `hold`. The chart is the tier `ANYFACE_TIER_MOUTHS`; `anyface_sounds_write()` writes it. Free
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

/// Listens to a sound and finds the times at which the lips are together, for p, b, m and similar
/// sounds.
///
/// Free with `anyface_sounds_free()`. Fails with `ANYFACE_STATUS_AUDIO` for a sound too short to use.
AnyfaceStatus anyface_sounds_new(const AnyfaceEngine *engine,
                                 const AnyfaceAudio *audio,
                                 AnyfaceSounds **out,
                                 AnyfaceError **error);

/// Listens to a sound and finds its closures, its phones and, if `text` is given, the times of its
/// words. Without a text the closures are those of `anyface_sounds_new()`, with one those of its p, b
/// and m. They alone decide when the lips close.
///
/// `text`: UTF-8, the words that are said in the sound; NULL if they are not known. Free with
/// `anyface_sounds_free()`. Fails with `ANYFACE_STATUS_AUDIO` for a sound too short to use, with
/// `ANYFACE_STATUS_INVALID_INPUT` for a text without a letter or too long for the sound, and with
/// `ANYFACE_STATUS_WEIGHTS` for an engine with the user's own speech encoder.
AnyfaceStatus anyface_sounds_new_with_text(const AnyfaceEngine *engine,
                                           const AnyfaceAudio *audio,
                                           const char *text,
                                           AnyfaceSounds **out,
                                           AnyfaceError **error);

/// Reads sounds from a file that another tool or an artist has made: .TextGrid (Praat), .tsv or
/// .json (Rhubarb), .pgo (Papagayo), .dat (Moho), .txt (lines of start, end and label).
///
/// `path`: UTF-8. `fps`: the frames per second of the frame numbers in .dat, 1 to 240. Free with
/// `anyface_sounds_free()`. Fails with `ANYFACE_STATUS_IO` if the file cannot be read, and with
/// `ANYFACE_STATUS_INVALID_INPUT` for another ending, a line that cannot be read, or a file that
/// has only words.
AnyfaceStatus anyface_sounds_read(const char *path,
                                  double fps,
                                  AnyfaceSounds **out,
                                  AnyfaceError **error);

/// Writes sounds as a file. Its ending sets the kind; `anyface_sounds_read()` lists the kinds.
///
/// `path`: UTF-8. `fps`: the frames per second of the frame numbers in .pgo and .dat, 1 to 240.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another ending, or with `ANYFACE_STATUS_IO` if the
/// file cannot be written; in that case no file is left behind.
AnyfaceStatus anyface_sounds_write(const AnyfaceSounds *sounds,
                                   const char *path,
                                   double fps,
                                   AnyfaceError **error);

/// Number `n` of intervals of an `AnyfaceTier`. 0 if the sounds have no such intervals, for an
/// unknown tier, or for NULL.
size_t anyface_sounds_interval_count(const AnyfaceSounds *sounds, int32_t tier);

/// Label of an interval of an `AnyfaceTier` but closures: a phone (IPA, or as a file spells it), a word or a
/// mouth. It lives until the sounds are freed. NULL for NULL, an unknown tier, or a number that is
/// not below the count.
const char *anyface_sounds_label(const AnyfaceSounds *sounds,
                                 int32_t tier,
                                 size_t interval);

/// Copies the times of the intervals of an `AnyfaceTier` into the caller's buffer, in the form that
/// `anyface_request_set_rows()` takes for "closures".
///
/// `buffer`: `[n, 2]`, start and end in seconds, in rising order; `double_count` must be `n * 2`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `double_count` or tier.
AnyfaceStatus anyface_sounds_copy_intervals(const AnyfaceSounds *sounds,
                                            int32_t tier,
                                            double *buffer,
                                            size_t double_count,
                                            AnyfaceError **error);

/// 1 if a phone (IPA, ARPABET, `MBP`) closes the lips as p, b and m do, else 0. 0 for NULL.
///
/// `label`: UTF-8.
int32_t anyface_sounds_label_closes_lips(const char *label);

/// Frees sounds that no running call uses; nothing happens for NULL.
void anyface_sounds_free(AnyfaceSounds *sounds);

/// Describes the systems and what each of them obeys as a JSON list, the default system first. Each
/// is an object: `name`, by which "system" of a request selects it, `label` and `help`;
/// `abilities` ("events", "words", "emotion", "first_pose", "head"); `sliders`; `fields`, each with
/// `name`, `label`, `help` and `kind` ("number", "text", "emotion", "intervals", "events", "sound",
/// "pose"), numbers also with `low`, `high`, `default` and `is_whole`; `controls`, each with `name`, `label`, `help`, `unit`, `values` ("real", "whole",
/// "choice"), `choices`, `stage` ("face", "motion"), `low`, `high`, `default`, `neutral` and
/// `animatable`; `emotions` in the order of their strengths; `units` with `name` and `label`, and
/// `words`, both for events.
///
/// Lives as long as the library is loaded.
const char *anyface_describe(void);

/// Makes a request that asks for nothing. Free with `anyface_request_free()`.
AnyfaceStatus anyface_request_new(AnyfaceRequest **out, AnyfaceError **error);

/// Asks for a text: fields of the kinds "text", "emotion" ("happy:0.7", "auto", "auto-arousal",
/// "off") and "events" (`anyface_events_read()`), the seed, controls that are a choice, and what else
/// is said to be a text, such as "system" of `anyface_engine_new()`. An empty text asks for nothing.
///
/// `name` and `text`: UTF-8. Fails with `ANYFACE_STATUS_INVALID_INPUT` for an unknown name, for a
/// field that takes something else, or for a text that it cannot read. The request is then as it was.
AnyfaceStatus anyface_request_set_text(AnyfaceRequest *request,
                                       const char *name,
                                       const char *text,
                                       AnyfaceError **error);

/// Asks for a number: fields of the kind "number", controls, and what else is said to be a number,
/// such as "threads" of `anyface_engine_new()`. For a control that is a choice, the number of the
/// chosen name.
///
/// Fails like `anyface_request_set_text()`. The range of a control is checked when it is used.
AnyfaceStatus anyface_request_set_number(AnyfaceRequest *request,
                                         const char *name,
                                         double number,
                                         AnyfaceError **error);

/// Asks for rows of numbers: fields of the kinds "emotion" (`column_count` is
/// `ANYFACE_EMOTION_COUNT`, strengths of 0 or more, each row with a sum of at most 1.5) and
/// "intervals" (2 columns: start and end, seconds, no times), controls that change over time (1
/// column), and what else is said to be rows (no times), such as "landmarks" of `anyface_face_new()`.
///
/// `times_s`: `[row_count]`, seconds, rising: values are linear between the rows, and constant before
/// the first and after the last. NULL for rows without times and for a single row of an emotion.
/// `values`: `[row_count, column_count]`. Both are copied.
/// Fails like `anyface_request_set_text()`.
AnyfaceStatus anyface_request_set_rows(AnyfaceRequest *request,
                                       const char *name,
                                       const double *times_s,
                                       const double *values,
                                       size_t row_count,
                                       size_t column_count,
                                       AnyfaceError **error);

/// Asks for a field of the kind "sound". The sound is copied.
///
/// Fails like `anyface_request_set_text()`, and with `ANYFACE_STATUS_AUDIO` for a sound that is silent
/// or too short.
AnyfaceStatus anyface_request_set_sound(AnyfaceRequest *request,
                                        const char *name,
                                        const AnyfaceAudio *sound,
                                        AnyfaceError **error);

/// Frees a request that no running call uses; nothing happens for NULL.
void anyface_request_free(AnyfaceRequest *request);

/// Learns how a person speaks from sounds and the motion of that person's face, fifteen seconds or more in
/// all, and writes a file for the field "performer" of a request. Long: accepts a progress handle.
///
/// `takes`: UTF-8, a JSON list of pairs of files, `[["a.wav", "a.csv"]]`: sounds and motions that begin with
/// them, each a .csv of Live Link Face, or an .npz of landmarks or weights. `path`: UTF-8, the file to write. It is
/// a safetensors file with a card in its metadata: how well the performer follows the person, with and
/// without. `progress` may be NULL.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for a system without performers, for takes that are too short,
/// whose face is still, says something else or drifts against its sound, and if the result would follow the
/// person no better than the system does; with `ANYFACE_STATUS_AUDIO` for a sound that cannot be used, and with
/// `ANYFACE_STATUS_IO` if a file cannot be read or written. Then no file is left behind.
AnyfaceStatus anyface_performer_learn(const AnyfaceEngine *engine,
                                      const char *takes,
                                      const AnyfaceProgress *progress,
                                      const char *path,
                                      AnyfaceError **error);

/// Takes or finds the landmarks of a mesh and computes everything that does not depend on time.
/// Long: accepts a progress handle. The engine's cache keeps the result.
///
/// `request` and `progress` may be NULL. A face reads of a request its controls of the stage "face",
/// such as "learned", and:
/// - "forward" and "up", texts: the axis out of the face and the axis to the top of the head, "+x"
///   to "-z"; without them "+z" and "+y", as in OBJ and glTF. Blender has "-y" and "+z".
/// - "landmarks", 68 rows of x, y, z in mesh units and axes, in the order of iBUG 300-W; or the text
///   of a landmark file as `anyface_face_write_landmarks()` writes it. Each landmark moves to the
///   nearest suitable place on the surface, unless it lies at its vertex in "landmark_vertices".
/// - "landmark_vertices", 68 rows of a vertex number. Together with positions, a point that lies
///   exactly at its vertex stays on that vertex. Points of `anyface_opened_face_copy_landmarks()`
///   need this where rims touch. Without these and "landmarks" the library finds the face.
/// - "fixed_landmarks", rows of a landmark's number, 0 to 67, and x, y, z: it stays there, while the
///   others adapt; it moves onto the surface.
/// - "part_roles", rows of the number of a part, as in `anyface_face_copy_parts()`, and its
///   `AnyfacePartRole`. The library recognises all other parts by their shape and place.
/// - "object_of_vertex", `V` rows of a number: which object each vertex belongs to, for a mesh that
///   was joined from several objects (a face, its teeth, its lashes); -1 for none.
/// - "object_roles", a row for each object: the `AnyfacePartRole` of all its parts, or -1 if the
///   library shall recognise them. "part_roles" take precedence.
///
/// The mesh may be freed afterwards. Free with `anyface_face_free()`.
/// Fails with `ANYFACE_STATUS_FACE_NOT_FOUND`, `ANYFACE_STATUS_MESH` for a mesh that cannot be
/// used, `ANYFACE_STATUS_INVALID_INPUT` for unusable landmarks or parts,
/// `ANYFACE_STATUS_CANCELLED`.
AnyfaceStatus anyface_face_new(const AnyfaceEngine *engine,
                               const AnyfaceMesh *mesh,
                               const AnyfaceRequest *request,
                               const AnyfaceProgress *progress,
                               AnyfaceFace **out,
                               AnyfaceError **error);

/// The quick part of `anyface_face_new()`: finds the face but does not compute the data needed to
/// move it. That happens when the face is first moved. Both functions share results through the
/// engine's cache.
///
/// Arguments and failures are those of `anyface_face_new()`.
AnyfaceStatus anyface_face_find(const AnyfaceEngine *engine,
                                const AnyfaceMesh *mesh,
                                const AnyfaceRequest *request,
                                const AnyfaceProgress *progress,
                                AnyfaceFace **out,
                                AnyfaceError **error);

/// How the lips meet, an `AnyfaceMouth`; -1 for NULL.
int32_t anyface_face_mouth(const AnyfaceFace *face);

/// What the lids of an eye can do, an `AnyfaceLids`; -1 for NULL. `side`: 0 for the subject's right
/// eye, anything else for the left one. If the lids cannot move, a blink lowers the brow instead.
int32_t anyface_face_lids(const AnyfaceFace *face, int32_t side);

/// Length of the mesh's unit in metres if the head had human size; converts displacements to
/// millimetres. 0 for NULL.
double anyface_face_metres_per_unit(const AnyfaceFace *face);

/// Copies the transform from the mesh's frame to the canonical one, in which head and gaze of a
/// motion are given: metres on a head of human size, +x to the subject's left, +y up, +z out of the
/// face, origin between the jaw's hinges.
///
/// `matrix`: `[3, 4]`, row by row: `canonical = matrix * (x, y, z, 1)`, a scaled rotation and a
/// translation. `float_count` must be 12.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`.
AnyfaceStatus anyface_face_copy_to_canonical(const AnyfaceFace *face,
                                             float *matrix,
                                             size_t float_count,
                                             AnyfaceError **error);

/// Number `V` of vertices of the face's mesh; 0 for NULL.
size_t anyface_face_vertex_count(const AnyfaceFace *face);

/// Copies the 68 landmarks into the caller's buffers, each of which may be NULL.
///
/// `positions`: `[68, 3]`, mesh units and axes, on the surface. `vertices`: `[68]`, the nearest
/// vertex of each. `confidence`: `[68]`, 0 to 1; 1 for landmarks from the caller.
/// Fails with `ANYFACE_STATUS_NULL_POINTER` if `face` is NULL.
AnyfaceStatus anyface_face_copy_landmarks(const AnyfaceFace *face,
                                          float *positions,
                                          uint32_t *vertices,
                                          float *confidence,
                                          AnyfaceError **error);

/// Number of connected parts of the face's mesh, after seams are joined; 0 for NULL.
size_t anyface_face_part_count(const AnyfaceFace *face);

/// Copies the role of each part into the caller's buffers, each of which may be NULL.
///
/// `roles`: one `AnyfacePartRole` for each of `anyface_face_part_count()` parts.
/// `part_of_vertex`: `[V]`, the part of each vertex, `UINT32_MAX` for a vertex in no triangle.
/// Fails with `ANYFACE_STATUS_NULL_POINTER` if `face` is NULL.
AnyfaceStatus anyface_face_copy_parts(const AnyfaceFace *face,
                                      int32_t *roles,
                                      uint32_t *part_of_vertex,
                                      AnyfaceError **error);

/// Writes the landmarks to a JSON file, which `anyface animate --landmarks` can read too.
///
/// `path`: UTF-8. Fails with `ANYFACE_STATUS_IO`; no unfinished file is left.
AnyfaceStatus anyface_face_write_landmarks(const AnyfaceFace *face,
                                           const char *path,
                                           AnyfaceError **error);

/// Frees a face that no running call uses; nothing happens for NULL.
void anyface_face_free(AnyfaceFace *face);

/// Parts the lips of a face along the valley between them and sews the inside of a mouth behind
/// them. At rest the surface stays the same. As a trial, the jaw of the result drops once by 20 mm:
/// the lips have to part smoothly and equally on both sides. Long: accepts a progress handle,
/// which may be NULL.
///
/// Call it if `anyface_face_mouth()` gives `ANYFACE_MOUTH_WELDED`.
/// Free with `anyface_opened_face_free()`. Prepare the new mesh like any other, with the landmarks
/// of `anyface_opened_face_copy_landmarks()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` if the lips part already or the landmarks name no mouth,
/// with `ANYFACE_STATUS_MESH` if no line leads from corner to corner between the lips or if they do
/// not part well, and with `ANYFACE_STATUS_CANCELLED`.
AnyfaceStatus anyface_open_mouth(const AnyfaceEngine *engine,
                                 const AnyfaceFace *face,
                                 const AnyfaceProgress *progress,
                                 AnyfaceOpenedFace **out,
                                 AnyfaceError **error);

/// Cuts free the eyes of a face that are one surface with their lids. The lids get a lining, and
/// the eyes become the fronts of balls. At rest the surface stays the same. As a trial, the result
/// blinks once: the lids have to cover the whole eye. Long: accepts a progress handle, which
/// may be NULL.
///
/// Call it if `anyface_face_lids()` gives `ANYFACE_LIDS_JOINED`.
/// Free with `anyface_opened_face_free()`. Prepare the new mesh like any other, with the landmarks
/// of `anyface_opened_face_copy_landmarks()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` if no eye is one surface with its lids, with
/// `ANYFACE_STATUS_MESH` if no line leads around an eye or if its lids do not shut well, and with
/// `ANYFACE_STATUS_CANCELLED`.
AnyfaceStatus anyface_open_eyes(const AnyfaceEngine *engine,
                                const AnyfaceFace *face,
                                const AnyfaceProgress *progress,
                                AnyfaceOpenedFace **out,
                                AnyfaceError **error);

/// Copies the new mesh: `V` vertices and `F` triangles. Free the copy with `anyface_mesh_free()`.
AnyfaceStatus anyface_opened_face_mesh(const AnyfaceOpenedFace *opened,
                                       AnyfaceMesh **out,
                                       AnyfaceError **error);

/// Number of the first lining triangle; 0 for NULL.
///
/// Triangles from this one up to `anyface_opened_face_first_inside_triangle()` lie behind the cut
/// and have the colour of the surface in front of them: inner sides of lips and lids, and the rest
/// of eyeballs.
size_t anyface_opened_face_first_lining_triangle(const AnyfaceOpenedFace *opened);

/// Number of the first triangle of the inside of the mouth behind the lips. `F` if eyes were
/// opened; 0 for NULL.
size_t anyface_opened_face_first_inside_triangle(const AnyfaceOpenedFace *opened);

/// Copies the old vertices that each vertex is a mixture of, for vertex groups and shape keys.
/// Vertices behind the cut take the mixture of the rim in front of them.
///
/// `vertices`: `[V, 3]`, numbers of old vertices. `shares`: `[V, 3]`, their shares, sum 1. `count`
/// must be `V * 3`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `count`.
AnyfaceStatus anyface_opened_face_copy_vertex_sources(const AnyfaceOpenedFace *opened,
                                                      uint32_t *vertices,
                                                      float *shares,
                                                      size_t count,
                                                      AnyfaceError **error);

/// Copies the old triangle that each triangle was cut from, for materials, and where its corners
/// lie in that old triangle, for texture coordinates and normals.
///
/// `triangles`: `[F]`, numbers of old triangles. `shares`: `[F, 3, 3]`, for each corner the shares
/// of the old triangle's three corners, sum 1. `triangle_count` must be `F`, and `share_count` must
/// be `F * 9`. Fails with `ANYFACE_STATUS_INVALID_INPUT` for other counts.
AnyfaceStatus anyface_opened_face_copy_triangle_sources(const AnyfaceOpenedFace *opened,
                                                        uint32_t *triangles,
                                                        size_t triangle_count,
                                                        float *shares,
                                                        size_t share_count,
                                                        AnyfaceError **error);

/// Copies the landmarks of the new mesh. Those of the inner lips, or of the lids, lie on their own
/// rim.
///
/// `positions`: `[68, 3]`, mesh units. `vertices`: `[68]`, numbers of the nearest vertices.
AnyfaceStatus anyface_opened_face_copy_landmarks(const AnyfaceOpenedFace *opened,
                                                 float *positions,
                                                 uint32_t *vertices,
                                                 AnyfaceError **error);

/// Frees an opened face that no running call uses; nothing happens for NULL.
void anyface_opened_face_free(AnyfaceOpenedFace *opened);

/// Frees a text that a function wrote to a `char **`; nothing happens for NULL.
void anyface_text_free(char *text);

/// Reads an expression: units such as "12,6L", one of the `words` of `anyface_describe()` with a side
/// anywhere in it, such as "left wink", or English words, such as "winks with the right eye". It
/// may end in a strength, ":0.5". A "!" lets it override the speech.
///
/// `weights_dir`: UTF-8, a folder of models that holds `text_units`, which may use CLIP, or NULL
/// for the built-in reader. The library keeps the reader of the last call. It loads the model at
/// the first text that is neither a unit nor a word of the list.
/// `text`: UTF-8. `json` receives an object: `said`, the text without strength and "!"; `units`, such
/// as "45L"; `strength`, 0 to 2, 1 for a plain word; `over_speech`; and `hint`, "" or, if the text
/// describes no expression and there are no units, a sentence that says why and suggests the nearest
/// one. Free it with `anyface_text_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for a text of more than 1,000 letters, and with
/// `ANYFACE_STATUS_WEIGHTS` or `ANYFACE_STATUS_IO` for a folder that cannot be used.
AnyfaceStatus anyface_expression_read(const char *weights_dir,
                                      const char *text,
                                      char **json,
                                      AnyfaceError **error);

/// Reads events, what a face does for a while, and writes them with all fields. The field "events"
/// of a request takes the same texts; it reads words with the built-in reader.
///
/// `text`: UTF-8, lines or JSON. A line holds seconds, an expression as `anyface_expression_read()`
/// takes it, and a strength: "1.2-2.0:smile:0.8" or "2.4-2.8:45L". JSON is a list, or an object with a
/// list `events`, of `{"start_s": 1.2, "end_s": 2.0, "units": ["12", "45L"], "strength": 0.8,
/// "over_speech": false}`. The last two may be left out. `units` may also be one expression, such
/// as "left wink". A final L or R restricts a unit to the subject's left or right side; a strength is
/// 0 to 2, 1 as strong as the model itself; events may overlap.
/// `weights_dir`: as in `anyface_expression_read()`. `json` receives a list with the units as lists;
/// free it with `anyface_text_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for times that do not rise, an unknown unit, a strength
/// out of range, and words that describe no expression; the message names the event, counted from 1.
AnyfaceStatus anyface_events_read(const char *weights_dir,
                                  const char *text,
                                  char **json,
                                  AnyfaceError **error);

/// Turns speech into motion. Long: accepts a progress handle.
///
/// `request` and `progress` may be NULL. Free with `anyface_motion_free()`.
/// Fails with `ANYFACE_STATUS_AUDIO` for a sound too short to use, `ANYFACE_STATUS_INVALID_INPUT`
/// for a control out of range or something that the system does not obey,
/// `ANYFACE_STATUS_CANCELLED`.
AnyfaceStatus anyface_motion_new(const AnyfaceEngine *engine,
                                 const AnyfaceAudio *audio,
                                 const AnyfaceRequest *request,
                                 const AnyfaceProgress *progress,
                                 AnyfaceMotion **out,
                                 AnyfaceError **error);

/// Performs the same speech with other controls, another emotion, or another seed of blinks and
/// accents. It takes only milliseconds, because nothing is heard or sampled again. Another `onset`
/// takes longer in systems whose models have learned emotion, because they sample again.
///
/// Style, frame rate and everything else that the system samples with stay those of `motion`. If
/// the models have learned emotion themselves (the built-in ones have not), the emotion that they
/// show stays too. `request` may be NULL. Free with `anyface_motion_free()`; `motion` may be freed
/// first.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for a motion that the caller brought or that was
/// redone or cut from another one, or for a control out of range.
AnyfaceStatus anyface_motion_new_again(const AnyfaceEngine *engine,
                                       const AnyfaceMotion *motion,
                                       const AnyfaceRequest *request,
                                       AnyfaceMotion **out,
                                       AnyfaceError **error);

/// Performs only the speech of a motion, without the emotion. The sound is the same and is not
/// heard again. The clip of `motion` minus the clip of the result, by
/// `anyface_clip_new_difference()`, is the emotion. Long: accepts a progress handle.
///
/// `progress` may be NULL. Free with `anyface_motion_free()`; `motion` may be freed first.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for a motion that the caller brought or that was
/// redone or cut from another one, or for a system that does not separate emotion from speech (the
/// ability "emotion" of `anyface_describe()`), and with `ANYFACE_STATUS_CANCELLED`.
AnyfaceStatus anyface_motion_new_content(const AnyfaceEngine *engine,
                                         const AnyfaceMotion *motion,
                                         const AnyfaceProgress *progress,
                                         AnyfaceMotion **out,
                                         AnyfaceError **error);

/// Copies `motion` with one stretch replaced by that of `again`, which was made from the same sound
/// in another way: with another seed, emotion, controls or closures.
///
/// Frames at or before `start_s` and at or after `end_s` stay the same bit for bit. At both ends of
/// the stretch the old and the new motion are blended within a tenth of a second, or within a
/// quarter of the stretch if that is less. An end at the start or end of the sound is not blended.
/// Head, eyes and tongue are replaced too. Free with `anyface_motion_free()`; both motions may be
/// freed first. The result cannot be performed again.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for times that hold no frame, for motion of another
/// kind, frame rate or length, or for motion that the caller brought.
AnyfaceStatus anyface_motion_new_redone(const AnyfaceMotion *motion,
                                        const AnyfaceMotion *again,
                                        double start_s,
                                        double end_s,
                                        AnyfaceMotion **out,
                                        AnyfaceError **error);

/// Copies `count` frames of a motion from frame `first` on, including head, eyes and tongue.
///
/// Free with `anyface_motion_free()`; `motion` may be freed first. The result cannot be performed
/// again. Fails with `ANYFACE_STATUS_INVALID_INPUT` for a count of 0, or for frames that the motion
/// does not have.
AnyfaceStatus anyface_motion_new_frames(const AnyfaceMotion *motion,
                                        size_t first,
                                        size_t count,
                                        AnyfaceMotion **out,
                                        AnyfaceError **error);

/// Makes a motion from the caller's own displacements: from a tracker, or edited. The array is
/// copied.
///
/// `displacements`: `[frame_count, 68, 3]` from the neutral face, canonical metres.
/// `fps`: frames per second, 1 to 240. Free with `anyface_motion_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` if there are no frames, if a value is not finite or
/// beyond 10 metres, or if the frame rate is out of range.
AnyfaceStatus anyface_motion_new_displacements(const float *displacements,
                                               size_t frame_count,
                                               double fps,
                                               AnyfaceMotion **out,
                                               AnyfaceError **error);

/// Makes a motion of one frame from the pose of a face whose vertices are displaced. Pass it to
/// `anyface_request_set_motion()` as "starts_from". The array is copied.
///
/// `displacements`: `[vertex_count, 3]` from the face at rest, mesh units and axes. The pose keeps
/// the landmarks. If the face has a tongue that moves by itself, it also keeps the tongue's motion
/// relative to the jaw. Free with `anyface_motion_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` if `vertex_count` is not the face's number of
/// vertices, or if a value is not finite.
AnyfaceStatus anyface_motion_new_pose(const AnyfaceFace *face,
                                      const float *displacements,
                                      size_t vertex_count,
                                      AnyfaceMotion **out,
                                      AnyfaceError **error);

/// Asks for a field of the kind "pose": the last frame of a motion of landmarks, which is copied, with
/// its tongue.
///
/// Fails like `anyface_request_set_text()`, also for a motion without frames or of another kind.
AnyfaceStatus anyface_request_set_motion(AnyfaceRequest *request,
                                         const char *name,
                                         const AnyfaceMotion *motion,
                                         AnyfaceError **error);

/// Number `T` of frames; 0 for NULL.
size_t anyface_motion_frame_count(const AnyfaceMotion *motion);

/// Frames per second; 0 for NULL.
double anyface_motion_fps(const AnyfaceMotion *motion);

/// The emotion that was heard in the voice, as JSON: the same object as in the command's reports.
///
/// `time_s` lists instants in seconds. For each instant there are the `probability` of every
/// emotion by name, the `intensity` that is shown, and `valence` and `arousal`, -1 to 1, which are
/// derived from the probabilities. NULL if the motion does not depend on the heard emotion, or for
/// NULL. Lives as long as the motion.
const char *anyface_motion_heard_emotion(const AnyfaceMotion *motion);

/// Copies the displacements of landmarks into the caller's buffer.
///
/// `buffer`: `[T, 68, 3]`, canonical metres; `float_count` must be `T * 68 * 3`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`, or for motion of a system
/// that moves no landmarks.
AnyfaceStatus anyface_motion_copy_displacements(const AnyfaceMotion *motion,
                                                float *buffer,
                                                size_t float_count,
                                                AnyfaceError **error);

/// Copies how much emotion counts compared with speech in one frame, for each vertex of a face. It
/// shows where the face expresses emotion and where it speaks.
///
/// `frame`: below `T`. `buffer`: `[V]`, 0 to 1, and 0 at vertices that do not follow the skin;
/// `float_count` must be `V`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`, for a frame out of range,
/// for a motion that the caller brought or that was redone or cut from another one, or if the
/// system of the engine or of the motion does not separate emotion from speech: see
/// `anyface_describe()`.
AnyfaceStatus anyface_motion_copy_mask(const AnyfaceMotion *motion,
                                       const AnyfaceEngine *engine,
                                       const AnyfaceFace *face,
                                       size_t frame,
                                       float *buffer,
                                       size_t float_count,
                                       AnyfaceError **error);

/// Copies the rotation of the head into the caller's buffer. It is 0 throughout if the caller
/// brought the motion.
///
/// `buffer`: `[T, 3]`, rotation vectors in radians about canonical axes. Their origin lies between
/// the jaw's hinges. A rotation about +x nods down, one about +y turns to the subject's left, and
/// one about +z tilts to the subject's right. `float_count` must be `T * 3`. The displacements do
/// not include this rotation.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`.
AnyfaceStatus anyface_motion_copy_head(const AnyfaceMotion *motion,
                                       float *buffer,
                                       size_t float_count,
                                       AnyfaceError **error);

/// Copies the rotation of the eyes into the caller's buffer. It is 0 throughout if the caller
/// brought the motion.
///
/// `buffer`: `[T, 2, 2]`, right eye, then left eye. Each has yaw to the subject's left and pitch
/// up, in radians relative to the head. `float_count` must be `T * 4`. The displacements of the
/// lids already follow the eyes.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`.
AnyfaceStatus anyface_motion_copy_gaze(const AnyfaceMotion *motion,
                                       float *buffer,
                                       size_t float_count,
                                       AnyfaceError **error);

/// Copies the motion of the tongue into the caller's buffer.
///
/// `buffer`: `[T, 4]`, how far the tongue is from rest (0) to contact (1) at four places: tip to
/// the ridge behind the upper teeth, middle to the palate, back to the palate, tip to the upper
/// teeth. `float_count` must be `T * 4`. Clips include it if the face has a tongue that moves by
/// itself.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`.
AnyfaceStatus anyface_motion_copy_tongue(const AnyfaceMotion *motion,
                                         float *buffer,
                                         size_t float_count,
                                         AnyfaceError **error);

/// Writes the motion as npz for numpy.
///
/// The file has `landmark_displacements` `[T, 68, 3]`, canonical metres, and `fps`. Motion that was
/// made from speech also has `head` `[T, 3]`, `gaze` `[T, 2, 2]` and `tongue` `[T, 4]`, with the
/// same values as the functions that copy them. Motion of weights also has `weights` `[T, S]`,
/// their `names` `[S]` and `together` `[T]`, how far the lips have to meet. Its landmarks are those
/// of the mean face.
///
/// `path`: UTF-8, ends in .npz. For motion of weights it may also end in .csv or .json, as
/// `anyface_weights_write()` writes them. Fails with `ANYFACE_STATUS_INVALID_INPUT` for another
/// ending, or with `ANYFACE_STATUS_IO` if the file cannot be written; in that case no file is left
/// behind.
AnyfaceStatus anyface_motion_write(const AnyfaceMotion *motion,
                                   const char *path,
                                   AnyfaceError **error);

/// Frees a motion that no running call uses; nothing happens for NULL.
void anyface_motion_free(AnyfaceMotion *motion);

/// Number `S` of shapes whose weights the system made, such as the 51 ARKit shapes that `cafe-talk`
/// moves. 0 if the system moves something else, or for NULL.
size_t anyface_motion_weight_count(const AnyfaceMotion *motion);

/// ARKit's name of a shape. NULL for NULL, or for a number that is not below the count. Lives as
/// long as the motion.
const char *anyface_motion_weight_name(const AnyfaceMotion *motion, size_t shape);

/// Copies motion of weights into the caller's buffer, exactly as the system made it. Nothing is
/// solved.
///
/// `buffer`: `[T, S]`, 0 to 1, in the order of `anyface_motion_weight_name()`; `float_count` must
/// be `T * S`. Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`, or for motion
/// of a system that moves no weights.
AnyfaceStatus anyface_motion_copy_weights(const AnyfaceMotion *motion,
                                          float *buffer,
                                          size_t float_count,
                                          AnyfaceError **error);

/// Makes a clip from speech and a face: `anyface_motion_new()` and `anyface_clip_new()` in one
/// call. Long: accepts a progress handle.
///
/// `request` and `progress` may be NULL. Free with `anyface_clip_free()`.
/// Fails like those two functions.
AnyfaceStatus anyface_engine_animate(const AnyfaceEngine *engine,
                                     const AnyfaceFace *face,
                                     const AnyfaceAudio *audio,
                                     const AnyfaceRequest *request,
                                     const AnyfaceProgress *progress,
                                     AnyfaceClip **out,
                                     AnyfaceError **error);

/// Puts motion on a face. Long: accepts a progress handle.
///
/// `progress` may be NULL. Free with `anyface_clip_free()`; face and motion may be freed before.
/// Fails with `ANYFACE_STATUS_CANCELLED`, and with `ANYFACE_STATUS_OUT_OF_MEMORY` if memory cannot
/// hold all frames at once. In that case use `anyface_clip_stream()`, which passes them on block by
/// block.
AnyfaceStatus anyface_clip_new(const AnyfaceEngine *engine,
                               const AnyfaceFace *face,
                               const AnyfaceMotion *motion,
                               const AnyfaceProgress *progress,
                               AnyfaceClip **out,
                               AnyfaceError **error);

/// Subtracts another clip of the same face, for example to separate the emotion from the speech:
/// `other` and the result add up to `clip`.
///
/// The result has no tracks for head, gaze and tongue. Free with `anyface_clip_free()`; both clips
/// may be freed before.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` if frame counts, vertex counts or frame rates differ.
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
float anyface_clip_largest_displacement(const AnyfaceClip *clip);

/// How much of the clip a viewer can see, an `AnyfaceVisibility`; -1 for NULL. Warn the user if it
/// is not `ANYFACE_VISIBILITY_SPEAKS`.
int32_t anyface_clip_visibility(const AnyfaceClip *clip);

/// Lends all displacements: `[T, V, 3]`, mesh units, added to the neutral positions.
///
/// The pointer is valid until the clip is freed; the values never change. NULL for NULL.
const float *anyface_clip_displacements(const AnyfaceClip *clip);

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

/// Writes the clip to a file in the format that the extension of `path` names.
///
/// .npz for numpy: `displacements` `[T, V, 3]`, `landmarks_neutral` `[68, 3]`,
/// `landmark_displacements` `[T, 68, 3]`, mesh units, and `fps`. If the motion was made from
/// speech, also `head` `[T, 3]` and `gaze` `[T, 2, 2]` as `anyface_motion_copy_head()` and
/// `_gaze()` return them, and `tongue` `[T, 4]`, whose motion the displacements already contain.
/// .pc2 and .mdd: point caches of positions for Blender, Maya, Houdini and others.
/// .glb: morph targets and their weights over time for browsers and engines. .usda: the same as USD
/// blend shapes. Both hold the mesh without materials and, if the motion was made from speech, the
/// turns of the head. `anyface_clip_write_shapes()` writes ARKit's shapes instead, and .vrma.
/// `mesh`: the mesh of the clip's face. `path`: UTF-8.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another extension or another mesh, and with
/// `ANYFACE_STATUS_IO` if the file cannot be written. On failure no unfinished file is left.
AnyfaceStatus anyface_clip_write(const AnyfaceClip *clip,
                                 const AnyfaceMesh *mesh,
                                 const char *path,
                                 AnyfaceError **error);

/// Writes the clip as weights of the shapes of its mesh, in the format that the extension of `path`
/// names.
///
/// .glb and .usda: the 52 ARKit shapes of `rig` and their weights over time, solved for the clip.
/// .vrma: a VRM animation for any avatar, with the expressions of VRM, those of ARKit under the
/// names of Perfect Sync, the turns of the head and the gaze. Other formats are as in
/// `anyface_clip_write()`. `rig`: the rig of the clip's mesh. `path`: UTF-8.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another extension or the rig of another mesh, and
/// with `ANYFACE_STATUS_IO` if the file cannot be written. On failure no unfinished file is left.
AnyfaceStatus anyface_clip_write_shapes(const AnyfaceClip *clip,
                                        const AnyfaceRig *rig,
                                        const char *path,
                                        AnyfaceError **error);

/// Frees a clip that no running call uses, with everything it lent; nothing happens for NULL.
void anyface_clip_free(AnyfaceClip *clip);

/// Puts motion on a face and passes the frames on as they are made, so that a clip of any length
/// needs no more memory than a few blocks. Long: accepts a progress handle.
///
/// `frames_at_once`: frames in a block, at least 1; the last block may have fewer. `take_frames`:
/// called with `user` for every block. `progress` may be NULL. The frames equal those of
/// `anyface_clip_new()` up to a millionth of the largest displacement, because matrix products of
/// another size round differently.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` if `frames_at_once` is 0, and with
/// `ANYFACE_STATUS_CANCELLED` if `take_frames` or the progress handle stops it.
AnyfaceStatus anyface_clip_stream(const AnyfaceEngine *engine,
                                  const AnyfaceFace *face,
                                  const AnyfaceMotion *motion,
                                  size_t frames_at_once,
                                  AnyfaceFramesFn take_frames,
                                  void *user,
                                  const AnyfaceProgress *progress,
                                  AnyfaceError **error);

/// Finds the parts of a motion and its events that nobody will see on this face. Long if the shapes
/// of the face have not been made yet: accepts a progress handle.
///
/// There are sentences about:
/// - events that start after the end of the sound;
/// - units that this face cannot show, such as brows if it has none;
/// - a mouth that cannot show all of speech: lips that hardly part, lips that do not meet in p, b
///   and m, a lower lip that does not reach the upper teeth in f and v, lips that something hides;
/// - a face without a tongue that can move by itself, if the motion moves the tongue;
/// - a face that no head of the system's own model resembles, so that landmarks alone moved it.
///   This is known only once a clip of this face was made.
///
/// `motion`: from `anyface_motion_new()`. `progress` may be NULL. `json` receives a list of sentences
/// in English; free it with `anyface_text_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for motion that was not made from speech,
/// `ANYFACE_STATUS_CANCELLED`.
AnyfaceStatus anyface_motion_notes(const AnyfaceEngine *engine,
                                   const AnyfaceFace *face,
                                   const AnyfaceMotion *motion,
                                   const AnyfaceProgress *progress,
                                   char **json,
                                   AnyfaceError **error);

/// Finds the fewest shapes that keep every vertex in every frame within `max_error` of its place.
/// Accepts a progress handle.
///
/// `max_error`: mesh units, 0 or more. `max_shapes`: at least 1. If this many shapes are too few,
/// the error exceeds `max_error`; `anyface_basis_max_error()` returns it. `progress` may be NULL. A
/// clip that does not move has no shapes. If the error allows it, at most 20 shapes have a weight
/// other than 0 in any one frame. Free with `anyface_basis_free()`; the clip may be freed before.
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

/// Largest distance of any vertex in any frame from its place in the clip, mesh units; 0 for NULL.
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

/// Frees a basis that no running call uses; nothing happens for NULL.
void anyface_basis_free(AnyfaceBasis *basis);

/// Computes the changes that the sliders of a take make. Long: accepts a progress handle.
///
/// `motion` comes from `anyface_motion_new()`, `clip` is the same motion on `face`, and `basis` is
/// that clip reduced to a few shapes. Motion that the caller brought, or that was redone or cut,
/// has no sliders. `progress` may be NULL. Free with `anyface_sliders_free()`; everything else may
/// be freed first.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for a clip or basis of another motion or for a face
/// with another number of vertices, and with `ANYFACE_STATUS_CANCELLED`.
AnyfaceStatus anyface_sliders_new(const AnyfaceEngine *engine,
                                  const AnyfaceFace *face,
                                  const AnyfaceMotion *motion,
                                  const AnyfaceClip *clip,
                                  const AnyfaceBasis *basis,
                                  const AnyfaceProgress *progress,
                                  AnyfaceSliders **out,
                                  AnyfaceError **error);

/// Number `N` of knots of an `AnyfaceSlider`. 0 if it moves nothing, for an unknown slider, or for
/// NULL.
size_t anyface_sliders_knot_count(const AnyfaceSliders *sliders, int32_t slider);

/// Copies the knots of an `AnyfaceSlider` into the caller's buffer.
///
/// `buffer`: `[N]`; `float_count` must be `N`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count` or slider.
AnyfaceStatus anyface_sliders_copy_knots(const AnyfaceSliders *sliders,
                                         int32_t slider,
                                         float *buffer,
                                         size_t float_count,
                                         AnyfaceError **error);

/// Copies the changes that an `AnyfaceSlider` adds at each of its knots into the caller's buffer.
///
/// `buffer`: `[N, T, K]`, changes of the basis's weights; `float_count` must be `N * T * K`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count` or slider.
AnyfaceStatus anyface_sliders_copy_changes(const AnyfaceSliders *sliders,
                                           int32_t slider,
                                           float *buffer,
                                           size_t float_count,
                                           AnyfaceError **error);

/// Frees sliders that no running call uses; nothing happens for NULL.
void anyface_sliders_free(AnyfaceSliders *sliders);

/// Fits few keys to the weights of shapes, so that no vertex is farther than `tolerance` from its
/// place in any frame. Accepts a progress handle.
///
/// `weights`: `[frame_count, curve_count]`. `shapes`: `[curve_count, vertex_count, 3]`,
/// displacements at weight 1. `tolerance`: above 0, in the unit of the shapes. `touching`:
/// `[frame_count]`, 1 in frames where the lips touch; may be NULL. In these frames a tenth of the
/// tolerance applies, and a run of them starts and ends with a key on every curve that moves the
/// face by more than the tolerance. `progress` may be NULL. Free with `anyface_curves_free()`.
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

/// Fits few keys to values of any kind, each column by itself.
///
/// `values`: `[frame_count, curve_count]`. `limits`: `[curve_count]`, above 0: how far each curve
/// may be from its values in any frame, in their unit. `touching`: `[frame_count]`, 1 for frames in
/// which every curve has a key; may be NULL. Free with `anyface_curves_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for values that are not finite.
AnyfaceStatus anyface_curves_new_each(const float *values,
                                      size_t frame_count,
                                      size_t curve_count,
                                      const float *limits,
                                      const uint8_t *touching,
                                      AnyfaceCurves **out,
                                      AnyfaceError **error);

/// Number of keys of a curve; 0 for NULL and for a curve that does not exist.
size_t anyface_curves_key_count(const AnyfaceCurves *curves, size_t curve);

/// Copies the keys of a curve.
///
/// `frames`: the frame of each key, in rising order, including the first and the last frame.
/// `slopes`: the slope of each key's handles, per frame. Both buffers hold `key_count` values;
/// `key_count` must be `anyface_curves_key_count()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for a curve that does not exist and another
/// `key_count`.
AnyfaceStatus anyface_curves_copy_keys(const AnyfaceCurves *curves,
                                       size_t curve,
                                       uint32_t *frames,
                                       float *slopes,
                                       size_t key_count,
                                       AnyfaceError **error);

/// Frees curves that no running call uses; nothing happens for NULL.
void anyface_curves_free(AnyfaceCurves *curves);

/// Makes the shapes of a mesh with the engine's network. Long: accepts a progress handle.
///
/// `request` and `progress` may be NULL. Landmarks, axes and parts of the request are those of
/// `anyface_face_new()`; its controls have no effect. Numbers of it that are 0, the default, or 1:
/// - "by_field": the skin is moved by a field, that of the head in FaceTalk's model that is most
///   like the mesh. Teeth, tongue, eyeballs and the shape "tongueOut" stay as the network makes them.
/// - "in_betweens", with "by_field": one more shape "NAME_half" for each of ARKit's shapes follows
///   at the end: the face at weight 0.5, which need not lie halfway.
///
/// The mesh may be freed afterwards. Free with `anyface_rig_free()`. Fails as `anyface_face_new()`
/// does, and with `ANYFACE_STATUS_INVALID_INPUT` if no head of the model is like the face.
AnyfaceStatus anyface_rig_new(const AnyfaceEngine *engine,
                              const AnyfaceMesh *mesh,
                              const AnyfaceRequest *request,
                              const AnyfaceProgress *progress,
                              AnyfaceRig **out,
                              AnyfaceError **error);

/// Number `S` of shapes. The 52 ARKit shapes come first. 0 for NULL.
size_t anyface_rig_shape_count(const AnyfaceRig *rig);

/// Name of a shape, such as "jawOpen" or "viseme_aa". It lives until the rig is freed. NULL for
/// NULL or a number that is not below the count.
const char *anyface_rig_shape_name(const AnyfaceRig *rig, size_t shape);

/// Says in words why a shape moves nothing, or which part of it does not move. The text lives until
/// the rig is freed. NULL if there is nothing to say, for NULL, or for a number that is not below
/// the count.
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

/// Writes the rig as a file. The ending of its name sets the kind.
///
/// .npz: `names` `[S]`, `deltas` `[S, V, 3]` and `neutral` `[V, 3]`. .glb: the mesh with its shapes as
/// morph targets. .vrm: an avatar with VRM's expressions, and the 52 ARKit shapes under the names of
/// Perfect Sync.
/// `source`: the file that the mesh was read from, or NULL. `path` and `source`: UTF-8.
/// A .glb keeps all else of a GLB or VRM, such as bones, materials, animations and the shapes and
/// expressions that it has. A .vrm keeps all else of a VRM (1.0 or 0), and new expressions replace
/// those of the same name; any other mesh gets the smallest skeleton that VRM 1.0 allows.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another ending, or for a .vrm whose source has bones
/// but is no VRM. Fails with `ANYFACE_STATUS_IO` if a file cannot be read or written; in that case no
/// file is left behind.
AnyfaceStatus anyface_rig_write(const AnyfaceRig *rig,
                                const char *source,
                                const char *path,
                                AnyfaceError **error);

/// Frees a rig that no running call uses, with everything it lent; nothing happens for NULL.
void anyface_rig_free(AnyfaceRig *rig);

/// Finds the weights with which shapes come nearest to a motion, by bounded least squares.
///
/// It uses few shapes at a time and keeps their weights smooth over time. Left and right weights are
/// alike where the motion hardly tells them apart. Of shapes that undo each other, by name or by the
/// motion they make, only one is used at a time. Accepts a progress handle.
///
/// `names`: `[shape_count]`, UTF-8; "…Left" and "…Right" are taken as a pair. `shapes`:
/// `[shape_count, vertex_count, 3]`, displacements at weight 1. `displacements`:
/// `[frame_count, vertex_count, 3]` in the same units, without motion of the whole head. `lips`:
/// `[lip_pairs, 2]`, an upper and a lower lip vertex that meet, such as those of the landmarks 61
/// and 67, 62 and 66, 63 and 65. In frames whose motion brings them together, the shapes do so too,
/// as well as they can. NULL with 0 for none. All arrays are copied. `progress` may be NULL. Free
/// with `anyface_weights_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for values that are not finite, for a lip vertex out
/// of range, or if none of the shapes moves anything, and with `ANYFACE_STATUS_CANCELLED`.
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

/// Finds weights as `anyface_weights_new()` does, but for the motion of a clip, whose displacements
/// stay in the library.
///
/// `shapes`: `[shape_count, vertex_count, 3]`, for the clip's first `vertex_count` vertices; later
/// ones are left out. `to_shapes`: `[3, 3]`, row by row, the matrix that takes displacements of the
/// clip to the axes and units of the shapes. NULL leaves them as they are. All else is as for
/// `anyface_weights_new()`. The clip may be freed before the weights.
/// Fails as `anyface_weights_new()` does, and with `ANYFACE_STATUS_INVALID_INPUT` for more vertices
/// than the clip has.
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

/// Takes the caller's own weights, such as those of `anyface_motion_copy_weights()`, so that they
/// can be written as a file.
///
/// `names`: `[shape_count]`, UTF-8. `weights`: `[frame_count, shape_count]`. Both are copied. Free
/// with `anyface_weights_free()`. Fails with `ANYFACE_STATUS_INVALID_INPUT` for values that are not
/// finite.
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

/// Share of the motion that the shapes leave out, root mean square over vertices and frames: 0 if
/// they show all of it, 1 if they show none. 0 for NULL and for a motion that does not move.
float anyface_weights_left_out(const AnyfaceWeights *weights);

/// Writes the weights as a file. The ending of its name sets the kind.
///
/// .csv, in the form of Live Link Face: the 52 ARKit shapes, with 0 for those that are not among
/// the names. .json: `fps`, `names` `[S]`, `weights` `[T][S]`. `path`: UTF-8. `fps`: 1 to 240.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another ending or frame rate, or with
/// `ANYFACE_STATUS_IO` if the file cannot be written; in that case no file is left behind.
AnyfaceStatus anyface_weights_write(const AnyfaceWeights *weights,
                                    const char *path,
                                    double fps,
                                    AnyfaceError **error);

/// Frees weights that no running call uses; nothing happens for NULL.
void anyface_weights_free(AnyfaceWeights *weights);

/// Makes a head from its numbers, or a random head from a seed.
///
/// `weights_dir`: UTF-8, a folder of models that replace the built-in ones, or NULL.
/// `coefficients`: `[coefficient_count]`; NULL with a count of 0 for a random head.
/// `coefficient_count` is 100, which sets all traits to 0, or `N` from
/// `anyface_head_coefficient_count()`. `seed`: of the random head; ignored if there are
/// coefficients. Free with `anyface_head_free()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another count, numbers that are not finite, and
/// heads far outside those that were learned, and with `ANYFACE_STATUS_WEIGHTS` or
/// `ANYFACE_STATUS_IO` for a folder that cannot be used.
AnyfaceStatus anyface_head_new(const char *weights_dir,
                               const float *coefficients,
                               size_t coefficient_count,
                               uint64_t seed,
                               AnyfaceHead **out,
                               AnyfaceError **error);

/// Mixes two heads: a `share` of 0 gives `a`, 1 gives `b`. Free with `anyface_head_free()`.
///
/// Both must belong to the same model. Fails with `ANYFACE_STATUS_INVALID_INPUT` for a share
/// outside 0 to 1.
AnyfaceStatus anyface_head_new_mixed(const AnyfaceHead *a,
                                     const AnyfaceHead *b,
                                     float share,
                                     AnyfaceHead **out,
                                     AnyfaceError **error);

/// Copies a head and sets one of its sliders, `direction`, to `value`, -4 to 4; 0 is the average.
/// Free with `anyface_head_free()`.
///
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for a value or direction out of range.
AnyfaceStatus anyface_head_new_along(const AnyfaceHead *head,
                                     size_t direction,
                                     float value,
                                     AnyfaceHead **out,
                                     AnyfaceError **error);

/// Fits a head to a face at rest, such as a scan or a model. Long: accepts a progress handle, which
/// may be NULL. Free with `anyface_head_free()`.
///
/// `weights_dir`: as in `anyface_head_new()`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` if the face has fewer than 300 vertices or stays more
/// than 3 mm away from the head on average.
AnyfaceStatus anyface_head_fit(const char *weights_dir,
                               const AnyfaceFace *face,
                               const AnyfaceProgress *progress,
                               AnyfaceHead **out,
                               AnyfaceError **error);

/// Mean distance between a face and the head that was fitted to it, millimetres on a head of human
/// size; 0 for NULL and heads that were not fitted.
float anyface_head_fit_mm(const AnyfaceHead *head);

/// Number `N` of the numbers that describe a head: 100 coefficients and the traits; 0 for NULL.
size_t anyface_head_coefficient_count(const AnyfaceHead *head);

/// Copies the numbers of a head. `buffer`: `[count]`; `count` must be `N`, or 100 for the
/// coefficients alone.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `count`.
AnyfaceStatus anyface_head_copy_coefficients(const AnyfaceHead *head,
                                             float *buffer,
                                             size_t count,
                                             AnyfaceError **error);

/// Number `D` of sliders; 0 for NULL. Traits such as age come first, then the directions in which
/// heads differ, starting with the one that moves the surface furthest.
size_t anyface_head_direction_count(const AnyfaceHead *head);

/// What a slider changes most, such as "age" or "face width". Lives until the head is freed. NULL
/// for NULL or if `direction` is not below the count.
const char *anyface_head_direction_name(const AnyfaceHead *head, size_t direction);

/// Copies the value of each slider. `buffer`: `[D]`; `count` must be `D`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `count`.
AnyfaceStatus anyface_head_copy_directions(const AnyfaceHead *head,
                                           float *buffer,
                                           size_t count,
                                           AnyfaceError **error);

/// Makes the mesh of a head at rest, metres. Long if `resolution` is not 0: accepts a progress
/// handle, which may be NULL. Free with `anyface_mesh_free()`.
///
/// `resolution`: 0 for clean quads, each cut into two triangles (`anyface_head_copy_faces()` has
/// the quads). Otherwise the number of cells along the longest side of the grid for the surface of
/// the field, such as 128; traits do not change that surface. `parts`: 0 for the skin alone,
/// otherwise also eyes, teeth, tongue, lashes and brows, whose vertices and triangles follow those
/// of the skin. The field has no such parts. `skin_vertices`: receives the number of vertices that
/// are skin; may be NULL. `landmark_vertices`: `[68]`, receives the vertices on which the landmarks
/// lie; may be NULL.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for a resolution from 1 to 31 or one that would take
/// more than 1 GiB, and if both `resolution` and `parts` are not 0.
AnyfaceStatus anyface_head_mesh(const AnyfaceHead *head,
                                size_t resolution,
                                int32_t parts,
                                const AnyfaceProgress *progress,
                                AnyfaceMesh **out,
                                size_t *skin_vertices,
                                uint32_t *landmark_vertices,
                                AnyfaceError **error);

/// Number `F` of faces of the clean quads, including the parts; 0 for NULL. The faces of the skin
/// come first.
size_t anyface_head_face_count(const AnyfaceHead *head);

/// Number `S` of faces of the skin; 0 for NULL.
size_t anyface_head_skin_face_count(const AnyfaceHead *head);

/// Copies the faces, four vertices each. A triangle has its last vertex twice. `buffer`: `[F, 4]`;
/// `count` must be `4 F`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `count`.
AnyfaceStatus anyface_head_copy_faces(const AnyfaceHead *head,
                                      uint32_t *buffer,
                                      size_t count,
                                      AnyfaceError **error);

/// Copies the texture coordinates at the corners of the skin's faces: (0, 0) at the lower left to
/// (1, 1). `buffer`: `[S, 4, 2]`; `count` must be `8 S`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `count`.
AnyfaceStatus anyface_head_copy_uv(const AnyfaceHead *head,
                                   float *buffer,
                                   size_t count,
                                   AnyfaceError **error);

/// Copies the material number of each face. `buffer`: `[F]`; `count` must be `F`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `count`.
AnyfaceStatus anyface_head_copy_face_materials(const AnyfaceHead *head,
                                               uint32_t *buffer,
                                               size_t count,
                                               AnyfaceError **error);

/// Number `M` of materials; 0 for NULL.
size_t anyface_head_material_count(const AnyfaceHead *head);

/// Name of a material, such as "skin" or "lips". Lives until the head is freed. NULL for NULL or if
/// `material` is not below the count.
const char *anyface_head_material_name(const AnyfaceHead *head, size_t material);

/// Frees a head that no running call uses, with everything it lent; nothing happens for NULL.
void anyface_head_free(AnyfaceHead *head);

/// Starts a performance with a neutral face. Fails with `ANYFACE_STATUS_INVALID_INPUT` for a system
/// that needs the whole sound.
///
/// The stream may outlive the engine. Free with `anyface_stream_free()`.
AnyfaceStatus anyface_stream_new(const AnyfaceEngine *engine,
                                 AnyfaceStream **out,
                                 AnyfaceError **error);

/// Takes sound and only stores it. An audio thread that may allocate can call it.
///
/// `samples`: `[S]`, mono at 16 kHz, nominally -1 to 1; any number, including 0.
/// Fails with `ANYFACE_STATUS_AUDIO` for samples that are not finite, in which case none of them is
/// taken, and with `ANYFACE_STATUS_INVALID_INPUT` after `anyface_stream_finish()`.
AnyfaceStatus anyface_stream_push(AnyfaceStream *stream,
                                  const float *samples,
                                  size_t sample_count,
                                  AnyfaceError **error);

/// Computes the frames that are ready, at most as many as the buffer has room for.
///
/// `buffer`: `[frame_room, 68, 3]`, displacements from the neutral face in metres. Frame `t` of the
/// stream, counted over all pulls, is at `t / 25` seconds of the sound.
/// `frame_count` receives the number of frames written. It is 0 if more sound is needed or the
/// performance is over.
AnyfaceStatus anyface_stream_pull(AnyfaceStream *stream,
                                  float *buffer,
                                  size_t frame_room,
                                  size_t *frame_count,
                                  AnyfaceError **error);

/// Ends the sound. Silence follows, so that every frame that has begun can be pulled.
///
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` the second time.
AnyfaceStatus anyface_stream_finish(AnyfaceStream *stream, AnyfaceError **error);

/// Obeys a request from the next frame on, which is the first one of the next pull. It reads:
/// - "emotion": names and strengths that do not change over time; neutral if it is not set.
/// - "performer", a file that was learned with FreeTalk, and "performer_strength".
/// - "hear_all", a number: 1 lets every sound move the face, including singing, music and noise. It
///   stays so. Otherwise only speech does.
/// - "look_ahead_s", a number, before the first sound: limits the look-ahead to these seconds. The
///   face then moves sooner but follows the speech less surely. FreeTalk can look 0.19, 0.07 and 0 s
///   ahead. Without it a stream looks as far ahead as it can.
///
/// The request may be changed or freed afterwards.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another emotion, if the system has no look-ahead
/// that short, or for another look-ahead after the first sound.
AnyfaceStatus anyface_stream_obey(AnyfaceStream *stream,
                                  const AnyfaceRequest *request,
                                  AnyfaceError **error);

/// How many seconds of sound after its own time a frame waits for, at most 0.2. 0 for NULL.
double anyface_stream_latency_s(const AnyfaceStream *stream);

/// Frees a stream that no running call uses; nothing happens for NULL.
void anyface_stream_free(AnyfaceStream *stream);

/// Starts a performance with a neutral face. Fails with `ANYFACE_STATUS_INVALID_INPUT` for a system
/// that needs the whole sound.
///
/// The stream may outlive the engine. Free with `anyface_weight_stream_free()`.
AnyfaceStatus anyface_weight_stream_new(const AnyfaceEngine *engine,
                                        AnyfaceWeightStream **out,
                                        AnyfaceError **error);

/// Name of a shape or viseme of a frame. It lives as long as the library is loaded.
///
/// The `ANYFACE_LIVE_SHAPE_COUNT` shapes, such as "jawOpen", come first. The
/// `ANYFACE_LIVE_VISEME_COUNT` visemes, such as "viseme_aa", follow. NULL beyond the last viseme.
const char *anyface_weight_stream_name(size_t index);

/// Takes sound and only stores it. An audio thread that may allocate can call it.
///
/// `samples`: `[S]`, mono at 16 kHz, nominally -1 to 1; any number, including 0.
/// Fails with `ANYFACE_STATUS_AUDIO` for samples that are not finite, in which case none of them is
/// taken, and with `ANYFACE_STATUS_INVALID_INPUT` after `anyface_weight_stream_finish()`.
AnyfaceStatus anyface_weight_stream_push(AnyfaceWeightStream *stream,
                                         const float *samples,
                                         size_t sample_count,
                                         AnyfaceError **error);

/// Computes the next frame if it is ready. Frame `t` is at `t / 25` seconds of the sound.
///
/// `shapes`: `[ANYFACE_LIVE_SHAPE_COUNT]`, weights of ARKit's shapes, 0 to 1, in the order of
/// `anyface_weight_stream_name()`. `visemes`: `[ANYFACE_LIVE_VISEME_COUNT]`, their weights, 0 to 1,
/// in the same order. `head`: `[3]`, rotation vector in radians: x to the subject's left, y up, z
/// to the front. `is_ready` receives 1 for a frame. It receives 0 if more sound is needed or the
/// performance is over; then nothing else is written.
AnyfaceStatus anyface_weight_stream_pull(AnyfaceWeightStream *stream,
                                         float *shapes,
                                         float *visemes,
                                         float *head,
                                         int32_t *is_ready,
                                         AnyfaceError **error);

/// Ends the sound. Silence follows, so that every frame that has begun can be pulled.
///
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` the second time.
AnyfaceStatus anyface_weight_stream_finish(AnyfaceWeightStream *stream, AnyfaceError **error);

/// Obeys a request from the next frame on, which is the first one of the next pull. It reads:
/// - "emotion": names and strengths that do not change over time; neutral if it is not set. "auto"
///   shows the emotion that is heard in the sound from now on, updated three times a second.
/// - "performer", a file that was learned with FreeTalk, and "performer_strength".
/// - "hear_all", a number: 1 lets every sound move the face, including singing, music and noise. It
///   stays so. Otherwise only speech does.
/// - "look_ahead_s", a number, before the first sound: limits the look-ahead to these seconds. The
///   face then moves sooner but follows the speech less surely. FreeTalk can look 0.19, 0.07 and 0 s
///   ahead. Without it a stream looks as far ahead as it can.
///
/// The request may be changed or freed afterwards.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another emotion, if the system has no look-ahead
/// that short, or for another look-ahead after the first sound.
AnyfaceStatus anyface_weight_stream_obey(AnyfaceWeightStream *stream,
                                         const AnyfaceRequest *request,
                                         AnyfaceError **error);

/// How many seconds of sound after its own time a frame waits for, at most 0.2. 0 for NULL.
double anyface_weight_stream_latency_s(const AnyfaceWeightStream *stream);

/// Frees a stream that no running call uses; nothing happens for NULL.
void anyface_weight_stream_free(AnyfaceWeightStream *stream);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* ANYFACE_H */
