//! The library `libanyface_microphone`, which is loaded when `anyface live` first needs a microphone or loudspeakers.
//! The command does not link it, because it would then neither build nor start where no sound system is.
//!
//! The functions are those of `include/anyface_microphone.h`.
#![allow(unsafe_code)]

use std::{
    env,
    ffi::{CStr, CString, c_char, c_void},
    path::{Path, PathBuf},
    ptr,
    sync::OnceLock,
    time::Duration,
};

use anyface::{Error, Result, audio::SAMPLE_RATE_HZ};
use libloading::{Library, library_filename};

/// Bytes for a message, or for names that were plugged in after their size was asked for.
const ROOM: usize = 4096;
/// The most samples that are read at a time: four seconds.
const MAX_SAMPLES: usize = 4 * SAMPLE_RATE_HZ as usize;

type Text = unsafe extern "C" fn(*const c_void, *mut c_char, usize) -> usize;
type Close = unsafe extern "C" fn(*mut c_void);

struct Functions {
    devices: unsafe extern "C" fn(*mut c_char, usize) -> usize,
    open: unsafe extern "C" fn(*const c_char, *mut c_char, usize) -> *mut c_void,
    name: Text,
    read: unsafe extern "C" fn(*mut c_void, *mut f32, usize, f64, *mut i32) -> usize,
    close: Close,
    monitor_open: unsafe extern "C" fn(f64, *mut c_char, usize) -> *mut c_void,
    monitor_name: Text,
    monitor_push: unsafe extern "C" fn(*mut c_void, *const f32, usize),
    monitor_is_playing: unsafe extern "C" fn(*const c_void) -> i32,
    monitor_close: Close,
    // The functions live as long as this.
    _library: Library,
}

/// The functions of the library, which is loaded at the first call and stays loaded.
fn functions() -> Result<&'static Functions> {
    static LOADED: OnceLock<Functions> = OnceLock::new();
    if let Some(functions) = LOADED.get() {
        return Ok(functions);
    }
    let path = find()?;
    let functions = load(&path).map_err(|reason| {
        Error::Audio(format!(
            "microphone: {} cannot be loaded: {reason}",
            path.display()
        ))
    })?;
    Ok(LOADED.get_or_init(|| functions))
}

/// The library's path: beside the command, or in `lib` beside the command's folder, as packages have it.
fn find() -> Result<PathBuf> {
    let command = env::current_exe().and_then(|path| path.canonicalize());
    let command = command.map_err(Error::io("the command's own path"))?;
    let folder = command.parent().unwrap_or(Path::new(""));
    let name = library_filename("anyface_microphone");
    let packed = folder.parent().map(|above| above.join("lib").join(&name));
    let places = [Some(folder.join(&name)), packed];
    let mut places = places.into_iter().flatten();
    places.find(|place| place.is_file()).ok_or_else(|| {
        let (name, folder) = (name.display(), folder.display());
        Error::Audio(format!(
            "microphone: expected {name} in {folder} or ../lib of it, found none; in Anyface's sources run \
             cargo build --release -p anyface-microphone (Linux needs libasound2-dev and pkg-config) and copy \
             target/release/{name} to {folder}, or name a sound with --input"
        ))
    })
}

/// Loads the library at `path` and looks its functions up.
fn load(path: &Path) -> std::result::Result<Functions, String> {
    let load = || unsafe {
        let library = Library::new(path)?;
        let version: unsafe extern "C" fn() -> *const c_char =
            *library.get(c"anyface_microphone_version")?;
        let version = CStr::from_ptr(version()).to_string_lossy().into_owned();
        let functions = Functions {
            devices: *library.get(c"anyface_microphone_devices")?,
            open: *library.get(c"anyface_microphone_open")?,
            name: *library.get(c"anyface_microphone_name")?,
            read: *library.get(c"anyface_microphone_read")?,
            close: *library.get(c"anyface_microphone_close")?,
            monitor_open: *library.get(c"anyface_monitor_open")?,
            monitor_name: *library.get(c"anyface_monitor_name")?,
            monitor_push: *library.get(c"anyface_monitor_push")?,
            monitor_is_playing: *library.get(c"anyface_monitor_is_playing")?,
            monitor_close: *library.get(c"anyface_monitor_close")?,
            _library: library,
        };
        Ok((version, functions))
    };
    let (version, functions) = load().map_err(|e: libloading::Error| e.to_string())?;
    let expected = env!("CARGO_PKG_VERSION");
    if version != expected {
        return Err(format!(
            "expected its version to be {expected}, as that of the command, got {version}"
        ));
    }
    Ok(functions)
}

/// The names of the recording devices, the system's default device first.
///
/// # Errors
/// `Audio` if there is no library.
pub fn devices() -> Result<Vec<String>> {
    let functions = functions()?;
    let names = text(|to, size| unsafe { (functions.devices)(to, size) });
    Ok(names.lines().map(str::to_owned).collect())
}

/// The text that `write` writes into a buffer of a size. It returns how many bytes the text needs.
fn text(write: impl Fn(*mut c_char, usize) -> usize) -> String {
    let mut bytes = vec![0u8; write(ptr::null_mut(), 0) + ROOM];
    write(bytes.as_mut_ptr().cast(), bytes.len());
    let text = CStr::from_bytes_until_nul(&bytes).unwrap_or_default();
    text.to_string_lossy().into_owned()
}

/// The handle that `open` returns, or the message that it writes.
fn opened(open: impl Fn(*mut c_char, usize) -> *mut c_void) -> Result<*mut c_void> {
    let mut message = [0u8; ROOM];
    let handle = open(message.as_mut_ptr().cast(), message.len());
    if handle.is_null() {
        let message = CStr::from_bytes_until_nul(&message).unwrap_or_default();
        return Err(Error::Audio(message.to_string_lossy().into_owned()));
    }
    Ok(handle)
}

/// A device that is being recorded.
pub struct Microphone {
    handle: *mut c_void,
    functions: &'static Functions,
    name: String,
    room: Vec<f32>,
}

/// The sound that has arrived since the last read.
pub struct Block {
    /// Mono, 16 kHz, nominally in [−1, 1]. Empty if nothing has arrived yet.
    pub samples: Vec<f32>,
    /// Whether the samples are silence because the device is gone.
    pub is_lost: bool,
}

impl Microphone {
    /// Records the device called `name`, or the system's default device if there is no name.
    ///
    /// # Errors
    /// `Audio` if there is no library, or if the device cannot be recorded now. Once open, a microphone waits for a
    /// lost device to return.
    pub fn open(name: Option<&str>) -> Result<Microphone> {
        let functions = functions()?;
        let name = name.map(CString::new).transpose().map_err(|_| {
            Error::InvalidInput("--microphone: expected a name without NUL, got one with".into())
        })?;
        let device = name.as_ref().map_or(ptr::null(), |name| name.as_ptr());
        let handle = opened(|to, size| unsafe { (functions.open)(device, to, size) })?;
        Ok(Microphone {
            handle,
            functions,
            name: text(|to, size| unsafe { (functions.name)(handle, to, size) }),
            room: vec![0.0; MAX_SAMPLES],
        })
    }

    /// Name of the device.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// All the sound that has arrived, up to four seconds. If there is none, waits for at most `patience`.
    pub fn read(&mut self, patience: Duration) -> Block {
        let (room, mut is_lost) = (&mut self.room, 0);
        let count = unsafe {
            (self.functions.read)(
                self.handle,
                room.as_mut_ptr(),
                room.len(),
                patience.as_secs_f64(),
                &mut is_lost,
            )
        };
        Block {
            samples: room[..count].to_vec(),
            is_lost: is_lost != 0,
        }
    }
}

impl Drop for Microphone {
    fn drop(&mut self) {
        unsafe { (self.functions.close)(self.handle) }
    }
}

/// Plays sound, with a delay, through the system's default loudspeakers.
pub struct Monitor {
    handle: *mut c_void,
    functions: &'static Functions,
    name: String,
}

impl Monitor {
    /// Opens the loudspeakers. Sound is heard `delay_s` seconds after it was pushed.
    ///
    /// # Errors
    /// `Audio` if there is no library, or if nothing can be played.
    pub fn open(delay_s: f64) -> Result<Monitor> {
        let functions = functions()?;
        let handle = opened(|to, size| unsafe { (functions.monitor_open)(delay_s, to, size) })?;
        Ok(Monitor {
            handle,
            functions,
            name: text(|to, size| unsafe { (functions.monitor_name)(handle, to, size) }),
        })
    }

    /// Name of the device.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Queues `samples`, mono, 16 kHz, to be played after those pushed before.
    pub fn push(&mut self, samples: &[f32]) {
        unsafe { (self.functions.monitor_push)(self.handle, samples.as_ptr(), samples.len()) }
    }

    /// Whether sound is playing. False while it waits for the delay, and once all has been played.
    pub fn is_playing(&self) -> bool {
        unsafe { (self.functions.monitor_is_playing)(self.handle) != 0 }
    }
}

impl Drop for Monitor {
    fn drop(&mut self) {
        unsafe { (self.functions.monitor_close)(self.handle) }
    }
}
