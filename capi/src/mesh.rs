//! Meshes from a file or from the caller's arrays.

use anyface::mesh::Mesh;
use libc::c_char;

use crate::{
    error::{AnyfaceError, Failure},
    guard, pointer,
    status::AnyfaceStatus,
};

/// A triangle mesh in the caller's own units, axes and vertex order. It never changes once it is
/// made: any number of threads may use it at the same time.
pub struct AnyfaceMesh(pub(crate) Mesh);

/// Makes a mesh from triangles; the arrays are copied.
///
/// `positions`: `[vertex_count, 3]`, any units. `triangles`: `[triangle_count, 3]`, vertex
/// numbers. Loose vertices, several parts, holes, duplicate triangles and triangles without area
/// are allowed. Free with `anyface_mesh_free()`.
/// Fails with `ANYFACE_STATUS_MESH` for too few triangles, positions that are not finite or vertex
/// numbers out of range.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_mesh_new(
    positions: *const f32,
    vertex_count: usize,
    triangles: *const u32,
    triangle_count: usize,
    out: *mut *mut AnyfaceMesh,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let positions = unsafe { rows_of_three("positions", positions, vertex_count) }?;
        let triangles = unsafe { rows_of_three("triangles", triangles, triangle_count) }?;
        let mesh = Mesh::from_arrays(positions, triangles)?;
        Ok(AnyfaceMesh(mesh))
    };
    unsafe { guard::give(out, error, make) }
}

/// Makes a mesh from polygons, which are cut into triangles; the arrays are copied.
///
/// `positions`: `[vertex_count, 3]`, any units. `polygon_sizes`: `[polygon_count]`, number of
/// corners of each. `corners`: `[corner_count]`, the vertex numbers of all polygons, one polygon
/// after the other. Free with `anyface_mesh_free()`.
/// Fails like `anyface_mesh_new()`, and with `ANYFACE_STATUS_INVALID_INPUT` if the sizes do not add
/// up to `corner_count`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_mesh_new_polygons(
    positions: *const f32,
    vertex_count: usize,
    polygon_sizes: *const u32,
    polygon_count: usize,
    corners: *const u32,
    corner_count: usize,
    out: *mut *mut AnyfaceMesh,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let positions = unsafe { rows_of_three("positions", positions, vertex_count) }?;
        let sizes = unsafe { pointer::slice("polygon_sizes", polygon_sizes, polygon_count, 1) }?;
        let corners = unsafe { pointer::slice("corners", corners, corner_count, 1) }?;
        let mesh = Mesh::from_polygons(positions, sizes, corners)?;
        Ok(AnyfaceMesh(mesh))
    };
    unsafe { guard::give(out, error, make) }
}

/// Reads a mesh from an OBJ, PLY or GLB file. The vertices keep the order of the file.
///
/// `path`: UTF-8. Free with `anyface_mesh_free()`.
/// Fails with `ANYFACE_STATUS_IO` if the file cannot be read, and with `ANYFACE_STATUS_MESH` if it
/// has none of these formats or the mesh cannot be used.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_mesh_read(
    path: *const c_char,
    out: *mut *mut AnyfaceMesh,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let make = || {
        let mesh = Mesh::read(unsafe { pointer::path("path", path) }?)?;
        Ok(AnyfaceMesh(mesh))
    };
    unsafe { guard::give(out, error, make) }
}

/// # Safety
/// `values` is NULL or valid for reads of `rows * 3` values.
unsafe fn rows_of_three<T: Copy>(
    name: &'static str,
    values: *const T,
    rows: usize,
) -> Result<Vec<[T; 3]>, Failure> {
    let values = unsafe { pointer::slice(name, values, rows, 3) }?;
    Ok(values.as_chunks().0.to_vec())
}

/// Number `V` of vertices; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_mesh_vertex_count(mesh: *const AnyfaceMesh) -> usize {
    unsafe { mesh.as_ref() }.map_or(0, |mesh| mesh.0.positions.len())
}

/// Number `F` of triangles; 0 for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_mesh_triangle_count(mesh: *const AnyfaceMesh) -> usize {
    unsafe { mesh.as_ref() }.map_or(0, |mesh| mesh.0.triangles.len())
}

/// Copies the positions into the caller's buffer.
///
/// `buffer`: `[V, 3]`, mesh units; `float_count` must be `V * 3`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `float_count`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_mesh_copy_positions(
    mesh: *const AnyfaceMesh,
    buffer: *mut f32,
    float_count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let values = || {
        let mesh = &unsafe { pointer::handle("mesh", mesh) }?.0;
        Ok(mesh.positions.as_flattened())
    };
    unsafe { guard::copy(buffer, float_count, error, values) }
}

/// Copies the triangles into the caller's buffer.
///
/// `buffer`: `[F, 3]`, vertex numbers; `index_count` must be `F * 3`.
/// Fails with `ANYFACE_STATUS_INVALID_INPUT` for another `index_count`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_mesh_copy_triangles(
    mesh: *const AnyfaceMesh,
    buffer: *mut u32,
    index_count: usize,
    error: *mut *mut AnyfaceError,
) -> AnyfaceStatus {
    let values = || {
        let mesh = &unsafe { pointer::handle("mesh", mesh) }?.0;
        Ok(mesh.triangles.as_flattened())
    };
    unsafe { guard::copy(buffer, index_count, error, values) }
}

/// Frees a mesh that no running call uses; nothing happens for NULL.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn anyface_mesh_free(mesh: *mut AnyfaceMesh) {
    unsafe { guard::free(mesh) }
}
