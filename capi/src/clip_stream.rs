//! Passes on the frames of a clip as they are made, for clips too large for memory.

use anyface::{
    Error,
    job::ProgressFn,
    spread::{ClipStart, FrameBlock, FrameSink, Movement},
};
use libc::{c_int, c_void};
use ndarray::Axis;

use crate::{
    clip::followed,
    engine::AnyfaceEngine,
    error::{AnyfaceError, Failure},
    face::AnyfaceFace,
    guard,
    motion::AnyfaceMotion,
    pointer::handles,
    progress::{AnyfaceProgress, watched},
    status::AnyfaceStatus,
};

/// Receives frames in order. A result other than 0 ends the job with `ANYFACE_STATUS_CANCELLED`.
///
/// `first_frame`: number of the first frame of the block. `displacements`: `[frame_count, V, 3]`,
/// mesh units, added to the neutral positions; valid only during this call.
/// The library calls it from one of its threads, which may differ from the thread that started the
/// job and from call to call, but never from two at the same time. It must not throw or longjmp.
pub type AnyfaceFramesFn = Option<
    unsafe extern "C" fn(
        user: *mut c_void,
        first_frame: usize,
        frame_count: usize,
        displacements: *const f32,
    ) -> c_int,
>;

/// Hands each block of frames to the host.
struct HostSink {
    take: unsafe extern "C" fn(*mut c_void, usize, usize, *const f32) -> c_int,
    user: *mut c_void,
    frames_at_once: usize,
    /// Number of the next block's first frame.
    next_frame: usize,
}

// The caller makes sure that `user` and the function allow this: the header says that the library
// uses them from its own threads.
unsafe impl Send for HostSink {}

impl FrameSink for HostSink {
    fn begin(&mut self, _start: &ClipStart<'_>) -> anyface::Result<()> {
        Ok(())
    }

    fn frames_at_once(&self, _start: &ClipStart<'_>) -> usize {
        self.frames_at_once
    }

    fn take(&mut self, block: FrameBlock) -> anyface::Result<()> {
        let block = block.displacements.as_standard_layout();
        let frames = block.len_of(Axis(0));
        let first = self.next_frame;
        self.next_frame += frames;
        match unsafe { (self.take)(self.user, first, frames, block.as_ptr()) } {
            0 => Ok(()),
            _ => Err(Error::Cancelled),
        }
    }

    fn finish(&mut self, _progress: ProgressFn<'_>) -> anyface::Result<()> {
        Ok(())
    }
}

/// Puts motion on a face and passes the frames on as they are made, so that a clip of any length
/// needs no more memory than a few blocks. Long: accepts a progress handle.
///
/// `frames_at_once`: frames in a block, at least 1; the last block may have fewer. `take_frames`:
/// called with `user` for every block. `progress` may be NULL. The frames equal those of
/// `anyface_clip_new()` up to a millionth of the largest displacement, because matrix products of
/// another size round differently.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` if `frames_at_once` is 0, and with
/// `ANYFACE_STATUS_CANCELLED` if `take_frames` or the progress handle stops it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_clip_stream(
    engine: *const AnyfaceEngine,
    face: *const AnyfaceFace,
    motion: *const AnyfaceMotion,
    frames_at_once: usize,
    take_frames: AnyfaceFramesFn,
    user: *mut c_void,
    progress: *const AnyfaceProgress,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let (engine, face, motion) = handles!(engine, face, motion);
        let take = take_frames.ok_or(Failure::Null("take_frames"))?;
        if frames_at_once == 0 {
            return Err(Failure::invalid(
                "frames_at_once: expected 1 or more, got 0",
            ));
        }
        let mut sink = HostSink {
            take,
            user,
            frames_at_once,
            next_frame: 0,
        };
        let life = motion.life();
        let spread = |watch: ProgressFn<'_>| {
            let motion = followed(engine, &face.0, motion.motion(), watch)?;
            let movement = Movement::from(&*motion).with_tongue(life);
            engine.0.spread(&face.0, movement, &mut sink, watch)
        };
        unsafe { watched(progress, spread) }?;
        Ok(())
    };
    unsafe { guard::guard(error, work) }
}
