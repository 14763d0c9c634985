//! Binary glTF (.glb), through the gltf crate.

use gltf::{Gltf, Node, mesh::Mode};

use super::Mesh;
use crate::{Error, Result};

type Matrix = [[f32; 4]; 4];

/// Every mesh of the default scene, one after the other, moved by its node.
///
/// A skinned mesh stays as it was bound: its node moves nothing, as the format says.
pub(super) fn parse_glb(bytes: &[u8]) -> Result<Mesh> {
    let file = Gltf::from_slice(bytes).map_err(|e| Error::Mesh(format!("glTF: {e}")))?;
    let Some(blob) = file.blob.as_deref() else {
        return Err(Error::Mesh(
            "glTF: expected a .glb with its data inside, got none".into(),
        ));
    };
    let scene = file.default_scene().or_else(|| file.scenes().next());
    let mut mesh = Mesh::default();
    for node in scene.iter().flat_map(gltf::Scene::nodes) {
        add_node(&mut mesh, &node, IDENTITY, blob)?;
    }
    Ok(mesh)
}

const IDENTITY: Matrix = [
    [1.0, 0.0, 0.0, 0.0],
    [0.0, 1.0, 0.0, 0.0],
    [0.0, 0.0, 1.0, 0.0],
    [0.0, 0.0, 0.0, 1.0],
];

/// Adds the mesh of a node and of all below it. `above`: columns, of its parent.
fn add_node(mesh: &mut Mesh, node: &Node<'_>, above: Matrix, blob: &[u8]) -> Result<()> {
    let placed = product(above, node.transform().matrix());
    if let Some(own) = node.mesh() {
        let placed = if node.skin().is_some() {
            IDENTITY
        } else {
            placed
        };
        for primitive in own.primitives() {
            add_primitive(mesh, &primitive, placed, blob)?;
        }
    }
    node.children()
        .try_for_each(|child| add_node(mesh, &child, placed, blob))
}

fn add_primitive(
    mesh: &mut Mesh,
    primitive: &gltf::Primitive<'_>,
    placed: Matrix,
    blob: &[u8],
) -> Result<()> {
    if primitive.mode() != Mode::Triangles {
        return Ok(());
    }
    check_ranges(primitive, blob.len())?;
    let reader = primitive.reader(|buffer| (buffer.index() == 0).then_some(blob));
    let first = mesh.positions.len() as u32;
    let positions = reader.read_positions().ok_or_else(|| {
        Error::Mesh("glTF: expected positions in the file itself, got none".into())
    })?;
    mesh.positions.extend(positions.map(|p| apply(placed, p)));
    let corners: Vec<u32> = match reader.read_indices() {
        Some(indices) => indices.into_u32().collect(),
        None => (0..mesh.positions.len() as u32 - first).collect(),
    };
    for triangle in corners.chunks_exact(3) {
        let triangle: Vec<u32> = triangle.iter().map(|v| v.saturating_add(first)).collect();
        mesh.add_polygon(&triangle)?;
    }
    Ok(())
}

/// The crate panics on data that ends before its accessor does.
fn check_ranges(primitive: &gltf::Primitive<'_>, length: usize) -> Result<()> {
    let positions = primitive.get(&gltf::Semantic::Positions);
    for accessor in positions.into_iter().chain(primitive.indices()) {
        let Some(view) = accessor.view() else {
            continue;
        };
        let stride = view.stride().unwrap_or(accessor.size());
        let last = accessor.count().saturating_sub(1).saturating_mul(stride);
        let needed = accessor.offset() + last + accessor.size();
        if needed > view.length() || view.offset() + view.length() > length {
            return Err(Error::Mesh(format!(
                "glTF: expected {} bytes of data, got {length}",
                view.offset() + needed.max(view.length())
            )));
        }
    }
    Ok(())
}

fn apply(m: Matrix, p: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|i| m[0][i] * p[0] + m[1][i] * p[1] + m[2][i] * p[2] + m[3][i])
}

fn product(a: Matrix, b: Matrix) -> Matrix {
    std::array::from_fn(|c| std::array::from_fn(|r| (0..4).map(|k| a[k][r] * b[c][k]).sum()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One triangle under a node that doubles it and lifts it by one.
    fn triangle() -> Vec<u8> {
        let json = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],
            "nodes":[{"translation":[0,1,0],"children":[1]},{"scale":[2,2,2],"mesh":0}],
            "meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1}]}],
            "buffers":[{"byteLength":44}],
            "bufferViews":[{"buffer":0,"byteOffset":0,"byteLength":36},
                           {"buffer":0,"byteOffset":36,"byteLength":6}],
            "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3",
                          "min":[0,0,0],"max":[1,1,0]},
                         {"bufferView":1,"componentType":5123,"count":3,"type":"SCALAR"}]}"#;
        let mut json = json.as_bytes().to_vec();
        json.resize(json.len().next_multiple_of(4), b' ');
        let mut data = Vec::new();
        for x in [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0] {
            data.extend(x.to_le_bytes());
        }
        for v in [0u16, 1, 2, 0] {
            data.extend(v.to_le_bytes());
        }
        let mut file = b"glTF".to_vec();
        let total = 12 + 8 + json.len() + 8 + data.len();
        file.extend([2, total as u32].iter().flat_map(|x| x.to_le_bytes()));
        file.extend((json.len() as u32).to_le_bytes());
        file.extend(b"JSON");
        file.extend(json);
        file.extend((data.len() as u32).to_le_bytes());
        file.extend(b"BIN\0");
        file.extend(data);
        file
    }

    #[test]
    fn a_mesh_stands_where_its_nodes_put_it() {
        let mesh = parse_glb(&triangle()).unwrap();
        assert_eq!(
            mesh.positions,
            [[0.0, 1.0, 0.0], [2.0, 1.0, 0.0], [0.0, 3.0, 0.0]]
        );
        assert_eq!(mesh.triangles, [[0, 1, 2]]);
    }

    #[test]
    fn damaged_files_are_errors() {
        let file = triangle();
        for length in (4..file.len()).step_by(7) {
            assert!(matches!(parse_glb(&file[..length]), Err(Error::Mesh(_))));
        }
        let text = String::from_utf8_lossy(&file).replace(r#""count":3"#, r#""count":9"#);
        let grown = text.into_bytes();
        assert!(matches!(parse_glb(&grown), Err(Error::Mesh(_))));
    }
}
