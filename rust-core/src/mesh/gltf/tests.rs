use std::fmt::Write;

use super::*;
use crate::Error;

fn parse_glb(bytes: &[u8]) -> Result<Mesh> {
    super::parse_glb(bytes).map(|(mesh, _)| mesh)
}

/// Makes a .glb file from its JSON description and its data.
fn glb(json: &str, data: &[u8]) -> Vec<u8> {
    let mut json = json.as_bytes().to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
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

/// The positions of three vertices as floats, then their 16-bit numbers.
fn data() -> Vec<u8> {
    let mut data = Vec::new();
    for x in [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0] {
        data.extend(x.to_le_bytes());
    }
    for v in [0u16, 1, 2, 0] {
        data.extend(v.to_le_bytes());
    }
    data
}

const NODES: &str = r#"[{"translation":[0,1,0],"children":[1]},{"scale":[2,2,2],"mesh":0}]"#;

/// The JSON description of a triangle, with `from` replaced by `to`.
fn description(from: &str, to: &str) -> String {
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],
        "nodes":{NODES},
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}],
        "buffers":[{{"byteLength":44}}],
        "bufferViews":[{{"buffer":0,"byteOffset":0,"byteLength":36}},
                       {{"buffer":0,"byteOffset":36,"byteLength":6}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}},
                     {{"bufferView":1,"componentType":5123,"count":3,"type":"SCALAR"}}]}}"#
    );
    assert!(json.contains(from), "{from}");
    json.replace(from, to)
}

fn triangle() -> Vec<u8> {
    glb(&description("", ""), &data())
}

fn refused(file: &[u8]) -> String {
    match parse_glb(file) {
        Err(Error::Mesh(message)) => message,
        other => panic!("expected a mesh error, got {other:?}"),
    }
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
fn rotations_and_matrices_place_alike() {
    // A quarter turn about z, scaled by 2 and moved by 1 along z.
    let h = std::f32::consts::FRAC_1_SQRT_2;
    let turned =
        format!(r#"[{{"rotation":[0,0,{h},{h}],"scale":[2,2,2],"translation":[0,0,1],"mesh":0}}]"#);
    let by_matrix = r#"[{"matrix":[0,2,0,0, -2,0,0,0, 0,0,2,0, 0,0,1,1],"mesh":0}]"#;
    let [a, b] = [&turned, by_matrix]
        .map(|nodes| parse_glb(&glb(&description(NODES, nodes), &data())).unwrap());
    for (p, q) in a
        .positions
        .iter()
        .flatten()
        .zip(b.positions.iter().flatten())
    {
        assert!((p - q).abs() < 1e-6, "{a:?} {b:?}");
    }
    assert_eq!(b.positions[1], [0.0, 2.0, 1.0]);
}

/// The triangle on a skin of two joints, nodes 1 and 2. `binds`: what the joints' inverse bind
/// matrices scale by and move by. `weights`: share of the first joint for each vertex.
fn skinned(nodes: &str, binds: [(f32, [f32; 3]); 2], weights: [f32; 3]) -> Vec<u8> {
    let mut data = data();
    for (s, [x, y, z]) in binds {
        let matrix = [
            [s, 0.0, 0.0, 0.0],
            [0.0, s, 0.0, 0.0],
            [0.0, 0.0, s, 0.0],
            [x, y, z, 1.0],
        ];
        data.extend(matrix.iter().flatten().flat_map(|x| x.to_le_bytes()));
    }
    data.extend([0, 1, 0, 0].repeat(3));
    let weights = weights.map(|first| [first, 1.0 - first, 0.0, 0.0]);
    data.extend(weights.iter().flatten().flat_map(|x| x.to_le_bytes()));
    let view = |at: usize, length: usize| {
        format!(r#"{{"buffer":0,"byteOffset":{at},"byteLength":{length}}}"#)
    };
    let json = description(NODES, nodes)
        .replace(r#""nodes":[0]"#, r#""nodes":[0,1,3]"#)
        .replace(
            r#"{"POSITION":0}"#,
            r#"{"POSITION":0,"JOINTS_0":3,"WEIGHTS_0":4}"#,
        )
        .replace(
            r#""bufferViews":["#,
            r#""skins":[{"joints":[1,2],"inverseBindMatrices":2}],"bufferViews":["#,
        )
        .replace(
            r#""byteLength":6}"#,
            &format!(
                r#""byteLength":6}},{},{},{}"#,
                view(44, 128),
                view(172, 12),
                view(184, 48)
            ),
        )
        .replace(
            r#""type":"SCALAR"}"#,
            r#""type":"SCALAR"},
               {"bufferView":2,"componentType":5126,"count":2,"type":"MAT4"},
               {"bufferView":3,"componentType":5121,"count":3,"type":"VEC4"},
               {"bufferView":4,"componentType":5126,"count":3,"type":"VEC4"}"#,
        );
    glb(&json, &data)
}

/// The first joint stands under an armature of scale .01 and mirrors x, the second moves up.
const BONES: &str = r#"[{"mesh":0,"skin":0,"translation":[9,9,9]},{"scale":[0.01,0.01,0.01],"children":[2]},
    {"translation":[0,100,0]},{"children":[]}]"#;

#[test]
fn a_skinned_mesh_stands_where_its_joints_put_it() {
    // The inverse bind matrices undo the armature's scale, and lift the first joint's vertices.
    let binds = [(100.0, [0.0, 50.0, 0.0]), (100.0, [0.0, 0.0, 0.0])];
    let file = skinned(BONES, binds, [1.0, 0.0, 0.5]);
    let mesh = parse_glb(&file).unwrap();
    let expected = [[0.0, 0.5, 0.0], [1.0, 1.0, 0.0], [0.0, 1.75, 0.0]];
    for (p, q) in mesh
        .positions
        .iter()
        .flatten()
        .zip(expected.iter().flatten())
    {
        assert!((p - q).abs() < 1e-6, "{:?}", mesh.positions);
    }
    let mirrored = BONES.replace("\"scale\":[0.01", "\"scale\":[-0.01");
    let mesh = parse_glb(&skinned(&mirrored, binds, [1.0; 3])).unwrap();
    assert!(
        (mesh.positions[1][0] + 1.0).abs() < 1e-6,
        "{:?}",
        mesh.positions
    );
}

#[test]
fn what_shows_of_a_stored_displacement_was_meant() {
    let binds = [(50.0, [0.0; 3]), (200.0, [0.0; 3])];
    let mirrored = BONES.replace("\"scale\":[0.01", "\"scale\":[-0.01");
    let part = &glb_parts(&skinned(&mirrored, binds, [1.0, 0.0, 0.5])).unwrap()[0];
    // The joints scale by .5 and by 2, and mirror x.
    for (v, scale) in [(0, 0.5), (1, 2.0), (2, 1.25)] {
        let stored = part.stored_displacement(v, [scale, scale, 0.0]);
        assert!(
            (stored[0] + 1.0).abs() < 1e-6 && (stored[1] - 1.0).abs() < 1e-6,
            "{v}: {stored:?}"
        );
    }
}

#[test]
fn joints_at_rest_leave_positions_to_the_bit() {
    let almost = [
        (100.000_01, [0.0, 0.0, 0.0]),
        (100.0, [0.0, -99.999_99, 0.0]),
    ];
    let mesh = parse_glb(&skinned(BONES, almost, [0.3, 0.7, 0.1])).unwrap();
    assert_eq!(mesh.positions, [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
}

#[test]
fn skins_without_their_joints_are_refused() {
    let binds = [(100.0, [0.0; 3]), (1.0, [0.0; 3])];
    for (from, to) in [
        (r#""skin":0"#, r#""skin":5"#),
        (r#""joints":[1,2]"#, r#""joints":[]"#),
        (r#""joints":[1,2]"#, r#""joints":[1,9]"#),
        (r#""joints":[1,2]"#, r#""joints":[1,2,2]"#),
        ("MAT4", "MAT3"),
    ] {
        let file = skinned(BONES, binds, [0.5; 3]);
        let (json, data) = glb_chunks(&file).unwrap();
        let json = String::from_utf8_lossy(json);
        assert!(json.contains(from), "{from}");
        refused(&glb(&json.replace(from, to), data));
    }
}

#[test]
fn damaged_files_are_errors() {
    let file = triangle();
    for length in (4..file.len()).step_by(7) {
        refused(&file[..length]);
    }
    refused(&glb(&description(r#""count":3"#, r#""count":9"#), &data()));
}

#[test]
fn nodes_that_meet_again_are_refused() {
    for nodes in [
        r#"[{"mesh":0,"children":[0]}]"#,
        r#"[{"children":[1]},{"mesh":0,"children":[0]}]"#,
        r#"[{"children":[1,1]},{"mesh":0}]"#,
    ] {
        let message = refused(&glb(&description(NODES, nodes), &data()));
        assert!(message.contains("below one other"), "{message}");
    }
}

#[test]
fn a_chain_of_a_hundred_thousand_nodes_is_walked() {
    let mut nodes = String::from("[");
    for i in 1..100_000 {
        write!(nodes, r#"{{"children":[{i}]}},"#).unwrap();
    }
    nodes += r#"{"mesh":0}]"#;
    let mesh = parse_glb(&glb(&description(NODES, &nodes), &data())).unwrap();
    assert_eq!(mesh.positions[1], [1.0, 0.0, 0.0]);
}

#[test]
fn what_nodes_show_again_is_bounded() {
    // 20,000 nodes show one mesh. Its 600 triangles all read the same buffer views.
    let primitive = r#"{"attributes":{"POSITION":0},"indices":1}"#;
    let many = vec![primitive; 600].join(",");
    let nodes = vec![r#"{"mesh":0}"#; 20_000].join(",");
    let roots: Vec<String> = (0..20_000).map(|i| i.to_string()).collect();
    let json = description(primitive, &many)
        .replace(NODES, &format!("[{nodes}]"))
        .replace(
            r#""nodes":[0]"#,
            &format!(r#""nodes":[{}]"#, roots.join(",")),
        );
    let message = refused(&glb(&json, &data()));
    assert!(message.contains("the scene is too large"), "{message}");
}

#[test]
fn vertex_numbers_of_every_size_are_read() {
    for (code, length, numbers) in [
        ("5121", "3", vec![0u8, 1, 2]),
        ("5123", "6", vec![0, 0, 1, 0, 2, 0]),
        ("5125", "12", vec![0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0]),
    ] {
        let mut data = data()[..36].to_vec();
        data.extend(numbers);
        let json = description(
            r#""componentType":5123"#,
            &format!(r#""componentType":{code}"#),
        )
        .replace(r#""byteLength":6"#, &format!(r#""byteLength":{length}"#));
        assert_eq!(
            parse_glb(&glb(&json, &data)).unwrap().triangles,
            [[0, 1, 2]]
        );
    }
    for code in ["5120", "5122", "5126"] {
        let json = description(
            r#""componentType":5123"#,
            &format!(r#""componentType":{code}"#),
        );
        let message = refused(&glb(&json, &data()));
        assert!(message.contains("U8, U16 or U32"), "{message}");
    }
}

#[test]
fn quantised_positions_are_read_where_the_file_says_so() {
    let triangle = [[0i32, 0, 0], [100, 0, 0], [0, 100, -100]];
    let used = r#""extensionsRequired":["KHR_mesh_quantization"],"scene":0"#;
    let cases: [(&str, usize, f32); 4] = [
        ("5120", 1, 127.0),
        ("5121", 1, 255.0),
        ("5122", 2, 32767.0),
        ("5123", 2, 65535.0),
    ];
    for (code, bytes, most) in cases {
        let signed = code == "5120" || code == "5122";
        // Elements start at multiples of four bytes, as packers write them.
        let stride = if bytes == 1 { 4 } else { 8 };
        let mut data = Vec::new();
        for corner in triangle {
            let mut element: Vec<u8> = corner
                .iter()
                .map(|&x| if signed { x } else { x.max(0) })
                .flat_map(|x| x.to_le_bytes()[..bytes].to_vec())
                .collect();
            element.resize(stride, 9);
            data.extend(element);
        }
        let view = format!(r#""byteLength":{},"byteStride":{stride}}}"#, data.len());
        data.resize(36, 0);
        data.extend([0, 0, 1, 0, 2, 0]);
        let plain = description(NODES, r#"[{"mesh":0}]"#)
            .replace(r#""byteLength":36}"#, &view)
            .replace(
                r#""componentType":5126"#,
                &format!(r#""componentType":{code}"#),
            );
        let message = refused(&glb(&plain, &data));
        assert!(message.contains("KHR_mesh_quantization"), "{message}");
        let said = plain.replace(r#""scene":0"#, used);
        let mesh = parse_glb(&glb(&said, &data)).unwrap();
        let last = if signed { -100.0 } else { 0.0 };
        assert_eq!(mesh.positions[1..], [[100.0, 0.0, 0.0], [0.0, 100.0, last]]);
        let normalised = said.replace(r#""type":"VEC3""#, r#""type":"VEC3","normalized":true"#);
        let mesh = parse_glb(&glb(&normalised, &data)).unwrap();
        assert_eq!(mesh.positions[1], [100.0 / most, 0.0, 0.0]);
        assert_eq!(mesh.positions[2], [0.0, 100.0 / most, last / most]);
    }
}

#[test]
fn positions_of_another_kind_are_refused() {
    for (from, to) in [
        ("VEC3", "VEC2"),
        ("VEC3", "SCALAR"),
        (r#""componentType":5126"#, r#""componentType":5125"#),
        (r#""byteLength":36"#, r#""byteLength":36,"byteStride":4"#),
        (r#""byteLength":36"#, r#""byteLength":36,"byteStride":0"#),
        (r#""bufferView":0,"#, ""),
        (r#""byteOffset":0"#, r#""byteOffset":18446744073709551615"#),
        (r#""scene":0"#, r#""scene":9"#),
        (r#""mesh":0"#, r#""mesh":9"#),
        (
            r#""scene":0"#,
            r#""extensionsRequired":["EXT_mesh_gpu_instancing"],"scene":0"#,
        ),
        (
            r#""byteLength":36"#,
            r#""byteLength":36,"extensions":{"EXT_meshopt_compression":
               {"buffer":0,"byteLength":36,"byteStride":12,"count":3,"mode":"ATTRIBUTES"}}"#,
        ),
        (
            r#""indices":1"#,
            r#""indices":1,"extensions":{"KHR_draco_mesh_compression":
               {"bufferView":0,"attributes":{"POSITION":0}}}"#,
        ),
    ] {
        refused(&glb(&description(from, to), &data()));
    }
}

#[test]
fn extensions_that_leave_vertices_alone_may_be_required() {
    let names = [
        "EXT_texture_webp",
        "EXT_texture_avif",
        "MSFT_texture_dds",
        "KHR_texture_basisu",
        "KHR_animation_pointer",
        "KHR_xmp_json_ld",
        "KHR_lights_punctual",
        "KHR_materials_unlit",
        "VRMC_vrm",
        "KHR_meshopt_compression",
        "X_of_tomorrow",
    ];
    let required = format!(r#""extensionsRequired":{names:?},"scene":0"#);
    let file = glb(&description(r#""scene":0"#, &required), &data());
    assert_eq!(parse_glb(&file).unwrap().triangles, [[0, 1, 2]]);
}

/// Two squares whose positions and triangles are in a stream of Draco.
fn by_draco() -> Vec<u8> {
    use draco_core::{
        DataType, EncoderBuffer, EncoderOptions, GeometryAttributeType, MeshEncoder, PointAttribute,
    };
    let mut stream = draco_core::Mesh::new();
    stream.set_num_points(6);
    let mut positions = PointAttribute::new();
    positions.init(
        GeometryAttributeType::Position,
        3,
        DataType::Float32,
        false,
        6,
    );
    let places = [0.0, 1.0, 2.0].map(|x| [[x, 0.0, 0.5], [x, 1.0, 0.5]]);
    let bytes: Vec<u8> = places
        .as_flattened()
        .iter()
        .flatten()
        .flat_map(|x: &f32| x.to_le_bytes())
        .collect();
    positions.buffer_mut().write(0, &bytes);
    stream.add_attribute(positions);
    stream.set_num_faces(4);
    stream.set_faces_from_flat_indices(&[0, 2, 1, 1, 2, 3, 2, 4, 3, 3, 4, 5]);
    let mut encoder = MeshEncoder::new();
    encoder.set_mesh(stream);
    let mut out = EncoderBuffer::new();
    encoder.encode(&EncoderOptions::new(), &mut out).unwrap();
    out.data().to_vec()
}

#[test]
fn a_primitive_in_a_stream_of_draco_is_read() {
    let stream = by_draco();
    let json = description(
        r#""indices":1"#,
        r#""indices":1,"extensions":{"KHR_draco_mesh_compression":{"bufferView":0,"attributes":{"POSITION":0}}}"#,
    )
    .replace(
        r#""scene":0"#,
        r#""extensionsRequired":["KHR_draco_mesh_compression"],"scene":0"#,
    )
    .replace(r#""bufferView":0,"componentType":5126,"count":3"#, r#""componentType":5126,"count":6"#)
    .replace(r#""byteLength":36"#, &format!(r#""byteLength":{}"#, stream.len()));
    let mesh = parse_glb(&glb(&json, &stream)).unwrap();
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (6, 4));
    // The nodes lift by 1 and scale by 2.
    let corner = mesh.positions.iter().filter(|p| **p == [4.0, 3.0, 1.0]);
    assert_eq!(corner.count(), 1, "{:?}", mesh.positions);
    let other = json.replace(r#""count":6"#, r#""count":7"#);
    assert!(refused(&glb(&other, &stream)).contains("expected 7 vertices"));
    for length in [0, 5, stream.len() / 2] {
        let cut = json.replace(
            &format!(r#""byteLength":{}"#, stream.len()),
            &format!(r#""byteLength":{length}"#),
        );
        refused(&glb(&cut, &stream));
    }
}

#[test]
fn numbers_in_another_buffer_are_read_from_there() {
    let away = |uri: &str| {
        let json = description(
            r#"{"byteLength":44}"#,
            &format!(r#"{{"byteLength":36}},{{"byteLength":6,"uri":"{uri}"}}"#),
        );
        glb(
            &json.replace(
                r#"{"buffer":0,"byteOffset":36"#,
                r#"{"buffer":1,"byteOffset":0"#,
            ),
            &data()[..36],
        )
    };
    // 2, 1, 0 in 16 bits.
    let file = away("data:application/octet-stream;base64,AgABAAAA");
    assert_eq!(parse_glb(&file).unwrap().triangles, [[2, 1, 0]]);
    let message = refused(&away("x.bin"));
    assert!(message.contains("x.bin"), "{message}");
    refused(&away("data:;base64,??"));
}

#[test]
fn strips_and_fans_turn_as_triangles_do() {
    let of = |mode: &str| {
        let json = description(r#""indices":1"#, &format!(r#""indices":1,"mode":{mode}"#))
            .replace(
                r#""count":3,"type":"SCALAR""#,
                r#""count":5,"type":"SCALAR""#,
            )
            .replace(r#""byteLength":6"#, r#""byteLength":10"#);
        let mut data = data()[..36].to_vec();
        data.extend([0u16, 1, 2, 1, 0].iter().flat_map(|v| v.to_le_bytes()));
        parse_glb(&glb(&json, &data)).unwrap().triangles
    };
    assert_eq!(of("4"), [[0, 1, 2]]);
    assert_eq!(of("5"), [[0, 1, 2], [2, 1, 0]]);
    assert_eq!(of("6"), [[0, 1, 2], [0, 2, 1], [0, 1, 0]]);
}

#[test]
fn sparse_positions_need_bytes_for_what_they_claim() {
    let sparse = r#""sparse":{"count":1,"indices":{"bufferView":1,"byteOffset":4,"componentType":5123},
        "values":{"bufferView":0,"byteOffset":12}},"count":3,"type":"VEC3""#;
    let json = description(r#""count":3,"type":"VEC3""#, sparse);
    let mesh = parse_glb(&glb(&json.replace(NODES, r#"[{"mesh":0}]"#), &data())).unwrap();
    assert_eq!(mesh.positions[2], [1.0, 0.0, 0.0]);
    let claims = json.replace(
        r#""bufferView":0,"componentType":5126"#,
        r#""componentType":5126"#,
    );
    let zero = parse_glb(&glb(&claims.replace(NODES, r#"[{"mesh":0}]"#), &data())).unwrap();
    assert_eq!(zero.positions[1], [0.0; 3]);
    let message = refused(&glb(
        &claims.replace(
            r#""count":3,"type":"VEC3""#,
            r#""count":100000000,"type":"VEC3""#,
        ),
        &data(),
    ));
    assert!(message.contains("100000000 elements"), "{message}");
    refused(&glb(
        &json.replace(r#""byteOffset":12"#, r#""byteOffset":36"#),
        &data(),
    ));
}

#[test]
fn a_description_that_would_fill_memory_is_refused() {
    let nodes = format!(r#"{{"nodes":[{}{{}}]}}"#, "{},".repeat(700_000));
    let mut bytes = b"glTF\x02\0\0\0".to_vec();
    let json = nodes.as_bytes();
    bytes.extend((20 + json.len() as u32).to_le_bytes());
    bytes.extend((json.len() as u32).to_le_bytes());
    bytes.extend(b"JSON");
    bytes.extend(json);
    let message = parse_glb(&bytes).unwrap_err().to_string();
    assert!(message.contains("MiB of memory"), "{message}");
}
