//! The ARKit shapes and visemes of a mesh.

use std::{ffi::CString, sync::Arc};

use anyface::{
    Engine, Face,
    face::{FaceOptions, Rig},
    job::ProgressFn,
    mesh::{Landmarks, Mesh, read_mesh_file},
    output::{TakeShapes, write_avatar, write_rig, write_rig_glb},
};
use libc::c_char;

use crate::{
    engine::AnyfaceEngine, error::AnyfaceError, face::of_mesh, guard, mesh::AnyfaceMesh, pointer,
    progress::AnyfaceProgress, request::AnyfaceRequest, status::AnyfaceStatus,
};

/// The 52 ARKit shapes and the 15 Oculus visemes of one mesh. It never changes once it is made: any
/// number of threads may use it at the same time.
pub struct AnyfaceRig {
    rig: Arc<Rig>,
    /// The mesh that the shapes belong to.
    pub(crate) mesh: Arc<Mesh>,
    landmarks: Landmarks,
    names: Vec<CString>,
    notes: Vec<Option<CString>>,
}

const _: () = guard::shared_by_threads::<AnyfaceRig>();

impl AnyfaceRig {
    fn new(rig: Arc<Rig>, mesh: Arc<Mesh>, landmarks: Landmarks) -> Self {
        let text = pointer::c_text;
        AnyfaceRig {
            mesh,
            landmarks,
            names: rig.names.iter().map(|name| text(name)).collect(),
            notes: rig
                .reports
                .iter()
                .map(|report| report.note.as_deref().map(text))
                .collect(),
            rig,
        }
    }

    fn of(face: Face, rig: Arc<Rig>) -> Self {
        AnyfaceRig::new(rig, face.mesh, face.landmarks)
    }

    /// The shapes of a take on this mesh.
    pub(crate) fn shapes_of_take(&self) -> TakeShapes {
        TakeShapes::new(Arc::clone(&self.rig), &self.landmarks.vertices)
    }
}

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
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_rig_new(
    engine: *const AnyfaceEngine,
    mesh: *const AnyfaceMesh,
    request: *const AnyfaceRequest,
    progress: *const AnyfaceProgress,
    out: *mut *mut AnyfaceRig,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let source = unsafe { AnyfaceRequest::shape_source(request) };
        let make = |engine: &Engine, mesh: &Mesh, options: &FaceOptions, watch: ProgressFn<'_>| {
            let face = engine.find(mesh, options, watch)?;
            let rig = engine.rig(&face, source, watch)?;
            Ok(AnyfaceRig::of(face, rig))
        };
        unsafe { of_mesh(engine, mesh, request, progress, make) }
    };
    unsafe { guard::give(out, error, make) }
}

/// Number `S` of shapes. The 52 ARKit shapes come first. 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_rig_shape_count(rig: *const AnyfaceRig) -> usize {
    unsafe { rig.as_ref() }.map_or(0, |rig| rig.names.len())
}

/// Name of a shape, such as "jawOpen" or "viseme_aa". It lives until the rig is freed. NULL for
/// NULL or a number that is not below the count.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_rig_shape_name(
    rig: *const AnyfaceRig,
    shape: usize,
) -> *const c_char {
    pointer::lend(unsafe { rig.as_ref() }.and_then(|rig| rig.names.get(shape)))
}

/// Says in words why a shape moves nothing, or which part of it does not move. The text lives until
/// the rig is freed. NULL if there is nothing to say, for NULL, or for a number that is not below
/// the count.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_rig_shape_note(
    rig: *const AnyfaceRig,
    shape: usize,
) -> *const c_char {
    pointer::lend(unsafe { rig.as_ref() }.and_then(|rig| rig.notes.get(shape)?.as_ref()))
}

/// Copies one shape into the caller's buffer.
///
/// `buffer`: `[V, 3]`, displacements at strength 1, mesh units; `float_count` must be `V * 3`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count` or a number that is not below
/// the count.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_rig_copy_shape(
    rig: *const AnyfaceRig,
    shape: usize,
    buffer: *mut f32,
    float_count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let values = || {
        let rig = &unsafe { pointer::handle("rig", rig) }?.rig;
        let (count, vertices, _) = rig.deltas.dim();
        if shape >= count {
            let message = format!("shape: expected 0 to {}, got {shape}", count - 1);
            return Err(crate::error::Failure::invalid(message));
        }
        let values = rig.deltas.as_slice().unwrap_or_default();
        Ok(&values[shape * vertices * 3..(shape + 1) * vertices * 3])
    };
    unsafe { guard::copy(buffer, float_count, error, values) }
}

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
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_rig_write(
    rig: *const AnyfaceRig,
    source: *const c_char,
    path: *const c_char,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let work = || {
        let rig = unsafe { pointer::handle("rig", rig) }?;
        let path = unsafe { pointer::path("path", path) }?;
        let source = if source.is_null() {
            None
        } else {
            Some(read_mesh_file(unsafe { pointer::path("source", source) }?)?)
        };
        let target = (&*rig.mesh, &rig.landmarks);
        match path.extension().and_then(|e| e.to_str()) {
            Some("npz") => write_rig(path, &rig.rig, &rig.mesh)?,
            Some("glb") => {
                write_rig_glb(path, &rig.rig, target, source.as_deref())?;
            }
            Some("vrm") => {
                write_avatar(path, &rig.rig, target, source.as_deref())?;
            }
            _ => {
                return Err(crate::error::Failure::invalid(format!(
                    "{}: expected a name that ends in .npz, .glb or .vrm",
                    path.display()
                )));
            }
        }
        Ok(())
    };
    unsafe { guard::guard(error, work) }
}

/// Frees a rig that no running call uses, with everything it lent; nothing happens for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_rig_free(rig: *mut AnyfaceRig) {
    unsafe { guard::free(rig) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::{anyface_error_free, anyface_error_status};
    use anyface::face::ShapeReport;
    use ndarray::Array3;
    use std::{ffi::CStr, ptr::null_mut};

    fn example() -> AnyfaceRig {
        let report = |name: &str, note: Option<&str>| ShapeReport {
            name: name.into(),
            largest: 1.0,
            largest_mm: 10.0,
            present: true,
            note: note.map(str::to_owned),
        };
        let rig = Arc::new(Rig {
            names: vec!["jawOpen".into(), "tongueOut".into()],
            deltas: Array3::from_shape_fn((2, 4, 3), |(s, v, i)| (12 * s + 3 * v + i) as f32),
            reports: vec![report("jawOpen", None), report("tongueOut", Some("none"))],
        });
        let (positions, triangles) = (vec![[0.0; 3]; 4], vec![[0, 1, 2], [0, 2, 3]]);
        let landmarks = Landmarks {
            positions: *anyface::mesh::canonical_landmarks(),
            vertices: [0; 68],
            confidence: [1.0; 68],
        };
        let mesh = Mesh {
            positions,
            triangles,
        };
        AnyfaceRig::new(rig, Arc::new(mesh), landmarks)
    }

    #[test]
    fn a_rig_is_written_in_the_format_of_its_ending() {
        let (rig, folder) = (example(), std::env::temp_dir());
        let name = |ending: &str| {
            let path = folder.join(format!("anyface-rig-{}.{ending}", std::process::id()));
            (path.clone(), pointer::c_text(&path.to_string_lossy()))
        };
        for (ending, status) in [
            ("vrm", AnyfaceStatus::Ok),
            ("glb", AnyfaceStatus::Ok),
            ("npz", AnyfaceStatus::Ok),
            ("obj", AnyfaceStatus::InvalidInput),
        ] {
            let ((path, text), mut error) = (name(ending), null_mut());
            let got =
                unsafe { anyface_rig_write(&rig, std::ptr::null(), text.as_ptr(), &mut error) };
            assert_eq!((got, path.exists()), (status, status == AnyfaceStatus::Ok));
            unsafe { anyface_error_free(error) };
            let _ = std::fs::remove_file(path);
        }
    }

    #[test]
    fn shapes_are_named_and_copied() {
        let rig = example();
        unsafe {
            assert_eq!(anyface_rig_shape_count(&rig), 2);
            let name = CStr::from_ptr(anyface_rig_shape_name(&rig, 1));
            assert_eq!(name.to_str(), Ok("tongueOut"));
            assert!(anyface_rig_shape_name(&rig, 2).is_null());
            assert!(anyface_rig_shape_note(&rig, 0).is_null());
            assert!(!anyface_rig_shape_note(&rig, 1).is_null());
            let (mut buffer, mut error) = (vec![0.0f32; 12], null_mut());
            let status = anyface_rig_copy_shape(&rig, 1, buffer.as_mut_ptr(), 12, &mut error);
            assert_eq!(
                (status, buffer[0], buffer[11]),
                (AnyfaceStatus::Ok, 12.0, 23.0)
            );
        }
    }

    #[test]
    fn shapes_that_do_not_exist_and_wrong_sizes_are_refused() {
        let rig = example();
        for (shape, count) in [(2, 12), (0, 11)] {
            let (mut buffer, mut error) = (vec![0.0f32; 12], null_mut());
            unsafe {
                let out = buffer.as_mut_ptr();
                let status = anyface_rig_copy_shape(&rig, shape, out, count, &mut error);
                assert_eq!(status, AnyfaceStatus::InvalidInput);
                assert_eq!(anyface_error_status(error), AnyfaceStatus::InvalidInput);
                anyface_error_free(error);
            }
        }
    }
}
