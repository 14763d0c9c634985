use std::path::Path;

use base64::{Engine as _, engine::general_purpose::STANDARD};
use gltf::animation::util::ReadOutputs;
use ndarray::Array3;
use serde_json::{Value, json};

use crate::{
    Error, Result,
    job::SILENT,
    mesh::{Mesh, canonical_landmarks},
    motion::Life,
    output::ClipFile,
    rig::EyeLook,
    spread::{ClipStart, FrameBlock, FrameSink},
};

const FRAMES: usize = 6;
const FPS: f64 = 25.0;
/// Largest allowed distance of a vertex from its expected position, metres.
const NEAR: f32 = 1e-5;

/// Four triangles in a row, metres.
fn strip() -> Mesh {
    let positions = (0..6).map(|v| [0.02 * v as f32, 0.02 * (v % 2) as f32, 0.01]);
    let triangles = (0..4).map(|t| [t, t + 1 + t % 2, t + 2 - t % 2]);
    Mesh::from_arrays(positions.collect(), triangles.collect()).unwrap()
}

/// Vertices 1 to 4 swing to and fro by a few millimetres, each in its own way.
fn swing(vertices: usize) -> Array3<f32> {
    Array3::from_shape_fn((FRAMES, vertices, 3), |(t, v, i)| {
        let moves = (1..5).contains(&v);
        let angle = 0.9 * t as f32 + (v * (i + 1)) as f32;
        f32::from(moves) * 0.004 * angle.sin()
    })
}

fn nodding() -> Life {
    let mut life = Life::still(FRAMES);
    for t in 0..FRAMES {
        life.head[[t, 0]] = 0.1 * t as f32;
    }
    life
}

fn write(path: &Path, mesh: &Mesh, source: &[u8], life: Option<&Life>) -> Result<Array3<f32>> {
    write_with(canonical_landmarks(), path, mesh, source, life)
}

fn write_with(
    landmarks: &[[f32; 3]; 68],
    path: &Path,
    mesh: &Mesh,
    source: &[u8],
    life: Option<&Life>,
) -> Result<Array3<f32>> {
    let displacements = swing(mesh.positions.len());
    let mut file = ClipFile::new(path)?.of_file(source).with_sound("hello.wav");
    life.into_iter().for_each(|life| file.add_life(life));
    file.begin(&ClipStart {
        mesh,
        landmarks,
        frames: FRAMES,
        fps: FPS,
    })?;
    file.take(FrameBlock {
        displacements: displacements.clone(),
        landmarks: Array3::zeros((FRAMES, 68, 3)),
    })?;
    file.finish(SILENT)?;
    Ok(displacements)
}

/// Reads a file with another library. Returns the positions of all vertices in every frame, with all
/// nodes at rest.
fn places(path: &Path) -> Vec<Vec<[f32; 3]>> {
    let (document, buffers, _) = gltf::import(path).unwrap();
    let mut frames = vec![Vec::new(); FRAMES];
    let scene = document.default_scene().unwrap();
    let mut worlds = std::collections::BTreeMap::new();
    let mut left: Vec<_> = scene
        .nodes()
        .map(|node| (node, glam::Mat4::IDENTITY))
        .collect();
    while let Some((node, above)) = left.pop() {
        let placed = above * glam::Mat4::from_cols_array_2d(&node.transform().matrix());
        worlds.insert(node.index(), placed);
        left.extend(node.children().map(|child| (child, placed)));
    }
    for node in document.nodes() {
        for primitive in node.mesh().iter().flat_map(gltf::Mesh::primitives) {
            let reader = primitive.reader(|buffer| Some(&buffers[buffer.index()]));
            let rest: Vec<_> = reader.read_positions().unwrap().collect();
            let targets: Vec<Vec<[f32; 3]>> = reader
                .read_morph_targets()
                .map(|(positions, ..)| positions.unwrap().collect())
                .collect();
            let joints: Vec<glam::Mat4> = node.skin().map_or(Vec::new(), |skin| {
                let reader = skin.reader(|buffer| Some(&buffers[buffer.index()]));
                let binds = reader.read_inverse_bind_matrices().unwrap();
                let of = skin.joints().zip(binds);
                of.map(|(joint, bind)| {
                    worlds[&joint.index()] * glam::Mat4::from_cols_array_2d(&bind)
                })
                .collect()
            });
            let placed: Vec<glam::Mat4> = match reader.read_joints(0) {
                None => vec![worlds[&node.index()]; rest.len()],
                Some(numbers) => (numbers.into_u16())
                    .zip(reader.read_weights(0).unwrap().into_f32())
                    .map(|(n, w)| joints[n[0] as usize] * w[0] + joints[n[1] as usize] * w[1])
                    .collect(),
            };
            let weights = weights(&document, &buffers, node.index());
            for (t, frame) in frames.iter_mut().enumerate() {
                frame.extend(rest.iter().enumerate().map(|(v, p)| {
                    let mut place = glam::Vec3::from(*p);
                    for (k, target) in targets.iter().enumerate() {
                        place += weights[t * targets.len() + k] * glam::Vec3::from(target[v]);
                    }
                    placed[v].transform_point3(place).to_array()
                }));
            }
        }
    }
    frames
}

fn weights(document: &gltf::Document, buffers: &[gltf::buffer::Data], node: usize) -> Vec<f32> {
    let channels = document.animations().flat_map(|animation| {
        let channels = animation.channels();
        channels
            .map(|channel| channel.target().node().index())
            .enumerate()
            .collect::<Vec<_>>()
    });
    assert!(channels.count() > 0);
    for animation in document.animations() {
        for channel in animation
            .channels()
            .filter(|c| c.target().node().index() == node)
        {
            let reader = channel.reader(|buffer| Some(&buffers[buffer.index()]));
            let times: Vec<f32> = reader.read_inputs().unwrap().collect();
            assert_eq!(times[1], 1.0 / FPS as f32);
            if let ReadOutputs::MorphTargetWeights(values) = reader.read_outputs().unwrap() {
                return values.into_f32().collect();
            }
        }
    }
    panic!("no weights for node {node}");
}

fn assert_moved(places: &[Vec<[f32; 3]>], mesh: &Mesh, displacements: &Array3<f32>) {
    for (t, frame) in places.iter().enumerate() {
        assert_eq!(frame.len(), mesh.positions.len());
        for (v, place) in frame.iter().enumerate() {
            for i in 0..3 {
                let expected = mesh.positions[v][i] + displacements[[t, v, i]];
                assert!(
                    (place[i] - expected).abs() < NEAR,
                    "frame {t}, vertex {v}: {place:?}"
                );
            }
        }
    }
}

fn json_of(path: &Path) -> Value {
    let bytes = std::fs::read(path).unwrap();
    serde_json::from_slice(crate::mesh::glb_chunks(&bytes).unwrap().0).unwrap()
}

#[test]
fn another_reader_sees_every_vertex_where_it_belongs() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("talk.glb");
    let mesh = strip();
    let displacements = write(&path, &mesh, b"", None).unwrap();
    assert_moved(&places(&path), &mesh, &displacements);
    assert_eq!(Mesh::read(&path).unwrap(), mesh);
    let json = json_of(&path);
    assert_eq!(json["animations"][0]["extras"]["sound"], "hello.wav");
    let names = json["meshes"][0]["extras"]["targetNames"]
        .as_array()
        .unwrap();
    assert_eq!(names[0], "Anyface 1");
    assert_eq!(
        names.len(),
        json["meshes"][0]["weights"].as_array().unwrap().len()
    );
}

#[test]
fn numbers_of_vertices_are_short_and_views_say_what_they_hold() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("talk.glb");
    write(&path, &strip(), b"", None).unwrap();
    let json = json_of(&path);
    let primitive = &json["meshes"][0]["primitives"][0];
    let accessor = |number: &Value| &json["accessors"][number.as_u64().unwrap() as usize];
    let target_of = |number: &Value| {
        let view = accessor(number)["bufferView"].as_u64().unwrap();
        json["bufferViews"][view as usize]["target"].as_u64()
    };
    assert_eq!(accessor(&primitive["indices"])["componentType"], 5123);
    assert_eq!(target_of(&primitive["indices"]), Some(34963));
    assert_eq!(target_of(&primitive["attributes"]["POSITION"]), Some(34962));
    let sampler = &json["animations"][0]["samplers"][0];
    assert_eq!(target_of(&sampler["output"]), None);
}

#[test]
fn a_texture_of_an_obj_stays() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("talk.glb");
    let mesh = strip();
    let mut text: String = (mesh.positions.iter())
        .map(|[x, y, z]| format!("v {x} {y} {z}\nvt {x} {y}\n"))
        .collect();
    text += "vt 0.5 0.5\n";
    for (t, [a, b, c]) in mesh.triangles.iter().enumerate() {
        let [a, b, c] = [a + 1, b + 1, c + 1];
        // One corner of the last triangle has other texture coordinates.
        let at = if t == 3 { 7 } else { a };
        text += &format!("f {a}/{at} {b}/{b} {c}/{c}\n");
    }
    let displacements = write(&path, &mesh, text.as_bytes(), None).unwrap();
    let (document, buffers, _) = gltf::import(&path).unwrap();
    let primitive = document
        .meshes()
        .next()
        .unwrap()
        .primitives()
        .next()
        .unwrap();
    let reader = primitive.reader(|buffer| Some(&buffers[buffer.index()]));
    let places: Vec<[f32; 2]> = reader.read_tex_coords(0).unwrap().into_f32().collect();
    assert_eq!(
        (places.len(), places[1], places[6]),
        (7, [0.02, 0.98], [0.5, 0.5])
    );
    let frames: Vec<Vec<[f32; 3]>> = self::places(&path);
    let seam = mesh.triangles[3][0] as usize;
    for (t, frame) in frames.iter().enumerate() {
        for i in 0..3 {
            let expected = mesh.positions[seam][i] + displacements[[t, seam, i]];
            assert!((frame[6][i] - expected).abs() < NEAR, "frame {t}");
        }
    }
}

#[test]
fn eyes_turn_where_the_take_looks() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("talk.glb");
    let (mesh, mut life) = (strip(), Life::still(FRAMES));
    for t in 0..FRAMES {
        // The left eye looks up, by 25 degrees in the last frame.
        life.gaze[[t, 1, 1]] = (5.0 * t as f32).to_radians();
    }
    let look = |name: &'static str| EyeLook {
        name,
        moved: vec![(0, [0.0, 0.01, 0.0])],
    };
    let eyes = vec![look("eyeLookUpLeft"), look("eyeLookUpRight")];
    let mut file = ClipFile::new(&path).unwrap().with_eyes(eyes);
    file.add_life(&life);
    file.begin(&ClipStart {
        mesh: &mesh,
        landmarks: canonical_landmarks(),
        frames: FRAMES,
        fps: FPS,
    })
    .unwrap();
    file.take(FrameBlock {
        displacements: swing(mesh.positions.len()),
        landmarks: Array3::zeros((FRAMES, 68, 3)),
    })
    .unwrap();
    file.finish(SILENT).unwrap();
    let mut expected = swing(mesh.positions.len());
    for t in 0..FRAMES {
        expected[[t, 0, 1]] += 0.01 * t as f32 / 5.0;
    }
    assert_moved(&places(&path), &mesh, &expected);
    let names = &json_of(&path)["meshes"][0]["extras"]["targetNames"];
    assert!(names.as_array().unwrap().contains(&json!("eyeLookUpLeft")));
    assert!(!names.as_array().unwrap().contains(&json!("eyeLookUpRight")));
}

#[test]
fn weights_stay_within_0_and_1() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("talk.glb");
    write(&path, &strip(), b"", None).unwrap();
    let (document, buffers, _) = gltf::import(&path).unwrap();
    let weights = weights(&document, &buffers, 0);
    assert!(
        weights.iter().all(|w| (0.0..=1.0).contains(w)),
        "{weights:?}"
    );
    assert!(weights.contains(&1.0));
}

#[test]
fn the_head_is_a_node_that_turns() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("talk.glb");
    let mesh = strip();
    let displacements = write(&path, &mesh, b"", Some(&nodding())).unwrap();
    assert_moved(&places(&path), &mesh, &displacements);
    let (document, buffers, _) = gltf::import(&path).unwrap();
    let channels = document
        .animations()
        .flat_map(|animation| animation.channels().collect::<Vec<_>>().into_iter());
    let turns: Vec<[f32; 4]> = channels
        .filter_map(|channel| {
            let reader = channel.reader(|buffer| Some(&buffers[buffer.index()]));
            match reader.read_outputs().unwrap() {
                ReadOutputs::Rotations(turns) => Some(turns.into_f32().collect::<Vec<_>>()),
                _ => None,
            }
        })
        .flatten()
        .collect();
    assert_eq!(turns.len(), FRAMES);
    let last = 2.0 * turns[FRAMES - 1][0].asin();
    assert!((last - 0.5).abs() < 1e-4, "{turns:?}");
}

#[test]
fn a_mesh_whose_way_up_is_z_stands_upright() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("talk.glb");
    let (mesh, turn) = (strip(), |[x, y, z]: [f32; 3]| [x, -z, y]);
    let mut turned = mesh.clone();
    turned.positions.iter_mut().for_each(|p| *p = turn(*p));
    let landmarks = canonical_landmarks().map(turn);
    write_with(&landmarks, &path, &turned, b"", Some(&nodding())).unwrap();
    let displacements = swing(mesh.positions.len());
    let moved = |t: usize, v: usize| {
        let [x, y, z] = [0, 1, 2].map(|i| displacements[[t, v, i]]);
        [x, z, -y]
    };
    for (t, frame) in places(&path).iter().enumerate() {
        for (v, place) in frame.iter().enumerate() {
            let expected = glam::Vec3::from(mesh.positions[v]) + glam::Vec3::from(moved(t, v));
            assert!(
                expected.distance((*place).into()) < NEAR,
                "frame {t}, vertex {v}: {place:?}"
            );
        }
    }
}

/// A GLB of the strip as two primitives of one mesh, with a material and a target. The mesh is ten
/// times as large and turned, and its nodes shrink it and turn it back.
fn source(change: impl FnOnce(&mut Value)) -> Vec<u8> {
    let mesh = strip();
    let turned = mesh
        .positions
        .iter()
        .map(|[x, y, z]| [10.0 * y, -10.0 * x, 10.0 * z]);
    let turned: Vec<[f32; 3]> = turned.collect();
    let mut data: Vec<u8> = turned
        .iter()
        .flatten()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    let corners = [[0u16, 1, 2], [0, 2, 1], [0, 1, 2], [0, 2, 1]];
    data.extend(corners.iter().flatten().flat_map(|v| v.to_le_bytes()));
    let part = |positions: usize, corners: usize| json!({"attributes": {"POSITION": positions}, "indices": corners, "material": 0, "targets": [{"POSITION": 0}]});
    let half = 0.5f32.sqrt();
    let mut document = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"children": [1], "scale": [0.1, 0.1, 0.1]}, {"mesh": 0, "rotation": [0.0, 0.0, half, half]}],
        "materials": [{"name": "Skin"}],
        "meshes": [{"primitives": [part(0, 2), part(1, 3)], "weights": [0.0], "extras": {"targetNames": ["Ear"]}}],
        "buffers": [{"byteLength": data.len()}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 72},
            {"buffer": 0, "byteOffset": 72, "byteLength": 24},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
             "min": [0.0, -1.0, 0.0], "max": [1.0, 0.0, 1.0]},
            {"bufferView": 0, "byteOffset": 36, "componentType": 5126, "count": 3, "type": "VEC3",
             "min": [0.0, -1.0, 0.0], "max": [1.0, 0.0, 1.0]},
            {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
            {"bufferView": 1, "byteOffset": 12, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
    });
    change(&mut document);
    let mut json = document.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut file = b"glTF".to_vec();
    let total = 28 + json.len() + data.len();
    file.extend(
        [2, total as u32, json.len() as u32]
            .iter()
            .flat_map(|x| x.to_le_bytes()),
    );
    file.extend(b"JSON");
    file.extend(json);
    file.extend((data.len() as u32).to_le_bytes());
    file.extend(b"BIN\0");
    file.extend(data);
    file
}

#[test]
fn a_glb_keeps_what_it_has() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("talk.glb");
    let source = source(|_| {});
    let mesh = Mesh::parse(&source).unwrap();
    let displacements = write(&path, &mesh, &source, Some(&nodding())).unwrap();
    assert_moved(&places(&path), &mesh, &displacements);
    let json = json_of(&path);
    assert_eq!(json["materials"][0]["name"], "Skin");
    assert_eq!(json["meshes"][0]["extras"]["targetNames"][0], "Ear");
    assert_eq!(json["meshes"][0]["extras"]["targetNames"][1], "Anyface 1");
    let turning = json["scenes"][0]["nodes"][0].as_u64().unwrap() as usize;
    assert_eq!(json["nodes"][turning]["name"], "Head");
}

/// Each vertex of the strip follows two joints of different scales, one of which mirrors.
#[test]
fn a_skinned_mesh_moves_as_it_should_where_joints_scale() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("talk.glb");
    let source = source(|document| {
        let bytes = STANDARD.encode(skin_bytes());
        let uri = format!("data:application/octet-stream;base64,{bytes}");
        *added(document, "buffers") = json!({"byteLength": 320, "uri": uri});
        *added(document, "bufferViews") = json!({"buffer": 1, "byteLength": 320});
        let accessor = |at: usize, kind: &str, count: usize| json!({"bufferView": 2, "byteOffset": at, "componentType": 5126, "count": count, "type": kind});
        *added(document, "accessors") = accessor(0, "MAT4", 2);
        *added(document, "accessors") = accessor(128, "VEC4", 6);
        *added(document, "accessors") = json!({"bufferView": 2, "byteOffset": 224, "componentType": 5123, "count": 6, "type": "VEC4"});
        document["skins"] = json!([{"joints": [2, 3], "inverseBindMatrices": 4}]);
        document["nodes"][1]["skin"] = json!(0);
        *added(document, "nodes") =
            json!({"scale": [0.01, 0.01, 0.01], "translation": [0.0, 0.1, 0.0]});
        *added(document, "nodes") = json!({"scale": [-0.1, 0.1, 0.1]});
        document["scenes"][0]["nodes"] = json!([0, 2, 3]);
        let part = &mut document["meshes"][0]["primitives"][0];
        part["attributes"] = json!({"POSITION": 7, "JOINTS_0": 6, "WEIGHTS_0": 5});
        part["targets"] = json!([{"POSITION": 7}]);
        document["accessors"][2]["count"] = json!(12);
        document["meshes"][0]["primitives"]
            .as_array_mut()
            .unwrap()
            .truncate(1);
        *added(document, "accessors") = json!({"bufferView": 0, "componentType": 5126, "count": 6, "type": "VEC3", "min": [0.0, -1.0, 0.0], "max": [1.0, 0.0, 1.0]});
    });
    let mesh = Mesh::parse(&source).unwrap();
    let displacements = write(&path, &mesh, &source, None).unwrap();
    assert_moved(&places(&path), &mesh, &displacements);
    assert!(mesh.positions[5][0] < 0.0, "{:?}", mesh.positions);
}

/// A new place at the end of a list of the document.
fn added<'a>(document: &'a mut Value, list: &str) -> &'a mut Value {
    let list = document[list].as_array_mut().unwrap();
    list.push(Value::Null);
    list.last_mut().unwrap()
}

/// Inverse bind matrices of two joints, weights of six vertices, and their joints.
fn skin_bytes() -> Vec<u8> {
    let mut bytes = Vec::new();
    for scale in [20.0, 1.0] {
        let bind = glam::Mat4::from_scale(glam::Vec3::splat(scale));
        bytes.extend(bind.to_cols_array().iter().flat_map(|x| x.to_le_bytes()));
    }
    for v in 0..6 {
        let second = 0.2 * v as f32;
        let weights = [1.0 - second, second, 0.0, 0.0];
        bytes.extend(weights.iter().flat_map(|x| x.to_le_bytes()));
    }
    for _ in 0..6 {
        bytes.extend([0u16, 1, 0, 0].iter().flat_map(|x| x.to_le_bytes()));
    }
    bytes.resize(320, 0);
    bytes
}

#[test]
fn a_head_with_bones_is_not_turned_as_a_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("talk.glb");
    let source = source(|document| document["skins"] = json!([{"joints": [0]}]));
    let mesh = Mesh::parse(&source).unwrap();
    write(&path, &mesh, &source, Some(&nodding())).unwrap();
    assert_eq!(json_of(&path)["scenes"][0]["nodes"], json!([0]));
}

/// The armature is turned and shrunk, the bone has a turn of its own.
#[test]
fn a_head_bone_turns_as_the_head_does_in_the_scene() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("talk.glb");
    let half = 0.5f32.sqrt();
    let (above, rest) = ([half, 0.0, 0.0, half], [0.0, 0.6, 0.0, 0.8]);
    let source = source(|document| {
        *added(document, "nodes") = json!({"name": "Armature", "rotation": above, "scale": [0.01, 0.01, 0.01], "children": [3]});
        *added(document, "nodes") =
            json!({"name": "mixamorig:Head", "rotation": rest, "translation": [0.0, 3.0, 0.0]});
        document["skins"] = json!([{"joints": [3]}]);
        document["scenes"][0]["nodes"] = json!([0, 2]);
        document["nodes"][1]["skin"] = json!(0);
    });
    let mesh = Mesh::parse(&source).unwrap();
    let life = nodding();
    write(&path, &mesh, &source, Some(&life)).unwrap();
    let (document, buffers, _) = gltf::import(&path).unwrap();
    assert_eq!(document.scenes().next().unwrap().nodes().count(), 2);
    let channels = document
        .animations()
        .next()
        .unwrap()
        .channels()
        .collect::<Vec<_>>();
    let channel = channels
        .iter()
        .find(|channel| channel.target().node().index() == 3)
        .unwrap();
    let reader = channel.reader(|buffer| Some(&buffers[buffer.index()]));
    let Some(ReadOutputs::Rotations(turns)) = reader.read_outputs() else {
        panic!("expected rotations of the bone");
    };
    let quat = glam::Quat::from_array;
    for (t, turn) in turns.into_f32().enumerate() {
        let expected = glam::Quat::from_rotation_x(life.head[[t, 0]]) * quat(above) * quat(rest);
        let got = quat(above) * quat(turn);
        assert!(
            got.angle_between(expected) < 1e-3,
            "frame {t}: {got} {expected}"
        );
    }
}

/// The eyes look to the subject's left. Shapes that would turn them too are left out.
#[test]
fn eye_bones_turn_with_the_gaze_and_no_shape_does() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("talk.glb");
    let source = source(|document| {
        *added(document, "nodes") = json!({"name": "eye.R"});
        *added(document, "nodes") =
            json!({"name": "eye.L", "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0.5, 0, 0, 1]});
        document["skins"] = json!([{"joints": [2, 3]}]);
        document["scenes"][0]["nodes"] = json!([0, 2, 3]);
    });
    let mesh = Mesh::parse(&source).unwrap();
    let mut life = Life::still(FRAMES);
    life.gaze[[3, 0, 0]] = 0.2;
    life.gaze[[3, 1, 1]] = 0.1;
    let look = EyeLook {
        name: "eyeLookInRight",
        moved: vec![(0, [0.01, 0.0, 0.0])],
    };
    let mut file = ClipFile::new(&path)
        .unwrap()
        .of_file(&source)
        .with_eyes(vec![look]);
    file.add_life(&life);
    file.begin(&ClipStart {
        mesh: &mesh,
        landmarks: canonical_landmarks(),
        frames: FRAMES,
        fps: FPS,
    })
    .unwrap();
    file.take(FrameBlock {
        displacements: swing(6),
        landmarks: Array3::zeros((FRAMES, 68, 3)),
    })
    .unwrap();
    file.finish(SILENT).unwrap();
    let names = json_of(&path)["meshes"][0]["extras"]["targetNames"].to_string();
    assert!(!names.contains("eyeLook"), "{names}");
    let (document, buffers, _) = gltf::import(&path).unwrap();
    let animation = document.animations().next().unwrap();
    let turn = |node: usize| {
        let mut channels = animation.channels();
        let channel = channels
            .find(|channel| channel.target().node().index() == node)
            .unwrap();
        let reader = channel.reader(|buffer| Some(&buffers[buffer.index()]));
        match reader.read_outputs() {
            Some(ReadOutputs::Rotations(turns)) => {
                glam::Quat::from_array(turns.into_f32().nth(3).unwrap())
            }
            _ => panic!("expected rotations of node {node}"),
        }
    };
    let sight = glam::Vec3::Z;
    assert!((turn(2) * sight).distance(glam::vec3(0.2f32.sin(), 0.0, 0.2f32.cos())) < 1e-3);
    assert!((turn(3) * sight).distance(glam::vec3(0.0, 0.1f32.sin(), 0.1f32.cos())) < 1e-3);
    assert_eq!(
        json_of(&path)["nodes"][3]["translation"],
        json!([0.5, 0.0, 0.0])
    );
}

/// A node far away shows the same mesh, and only the first one speaks.
#[test]
fn a_mesh_that_two_nodes_show_speaks_where_it_moves() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("talk.glb");
    let source = source(|document| {
        let second = json!({"mesh": 0, "translation": [9.0, 0.0, 0.0], "weights": [0.5]});
        document["nodes"].as_array_mut().unwrap().push(second);
        document["scenes"][0]["nodes"] = json!([0, 2]);
    });
    let mesh = Mesh::parse(&source).unwrap();
    write(&path, &mesh, &source, None).unwrap();
    let json = json_of(&path);
    assert_eq!(
        (&json["nodes"][1]["mesh"], &json["nodes"][2]["mesh"]),
        (&json!(1), &json!(0))
    );
    let count = |mesh: usize| {
        json["meshes"][mesh]["primitives"][0]["targets"]
            .as_array()
            .map_or(0, Vec::len)
    };
    assert!(count(1) > count(0), "{} {}", count(1), count(0));
    assert_eq!(json["nodes"][2]["weights"], json!([0.5]));
    assert_eq!(
        json["animations"][0]["channels"].as_array().unwrap().len(),
        1
    );
}

/// Two channels share a sampler, but only one of their meshes gets more targets.
#[test]
fn animations_of_a_grown_mesh_get_a_weight_for_each_new_target() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("talk.glb");
    let source = source(|document| {
        let numbers: Vec<u8> = [0.0f32, 1.0, 0.25, 0.75]
            .iter()
            .flat_map(|x| x.to_le_bytes())
            .collect();
        let uri = format!(
            "data:application/octet-stream;base64,{}",
            STANDARD.encode(&numbers)
        );
        *added(document, "buffers") = json!({"byteLength": 16, "uri": uri});
        *added(document, "bufferViews") = json!({"buffer": 1, "byteLength": 16});
        let floats = |at: usize| json!({"bufferView": 2, "byteOffset": at, "componentType": 5126, "count": 2, "type": "SCALAR"});
        *added(document, "accessors") = floats(0);
        *added(document, "accessors") = floats(8);
        let still = document["meshes"][0].clone();
        *added(document, "meshes") = still;
        *added(document, "nodes") = json!({"mesh": 1, "translation": [9.0, 0.0, 0.0]});
        document["scenes"][0]["nodes"] = json!([0, 2]);
        let channel = |target: Value| json!({"sampler": 0, "target": target});
        let pointer = json!({"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": "/meshes/0/weights"}}});
        document["animations"] = json!([{
            "channels": [
                channel(json!({"node": 2, "path": "weights"})), channel(json!({"node": 1, "path": "weights"})),
                channel(pointer),
            ],
            "samplers": [{"input": 4, "output": 5, "interpolation": "STEP"}],
        }]);
    });
    let mesh = Mesh::parse(&source).unwrap();
    write(&path, &mesh, &source, None).unwrap();
    let json = json_of(&path);
    let old = &json["animations"][0];
    let samplers: Vec<_> = old["channels"]
        .as_array()
        .unwrap()
        .iter()
        .map(|c| c["sampler"].as_u64())
        .collect();
    assert_eq!(samplers, [Some(0), Some(1), Some(1)]);
    assert_eq!(
        old["samplers"][0],
        json!({"input": 4, "output": 5, "interpolation": "STEP"})
    );
    assert_eq!(
        (
            &old["samplers"][1]["input"],
            &old["samplers"][1]["interpolation"]
        ),
        (&json!(4), &json!("STEP"))
    );
    let bytes = std::fs::read(&path).unwrap();
    let output = old["samplers"][1]["output"].as_u64().unwrap() as usize;
    let weights = &crate::mesh::glb_scalars(&bytes, [output]).unwrap()[&output];
    let targets = json["meshes"][0]["primitives"][0]["targets"]
        .as_array()
        .unwrap()
        .len();
    let mut expected = vec![0.0; 2 * targets];
    (expected[0], expected[targets]) = (0.25, 0.75);
    assert!(targets > 1);
    assert_eq!(*weights, expected);
}

#[test]
fn the_file_of_another_mesh_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("talk.glb");
    let mut mesh = strip();
    mesh.positions.push([0.5; 3]);
    let error = write(&path, &mesh, &source(|_| {}), None).unwrap_err();
    assert!(
        matches!(&error, Error::InvalidInput(m) if m.contains("7 vertices")),
        "{error}"
    );
}

/// Twenty minutes, which wait in a file and are compressed in parts.
#[test]
fn a_long_take_is_as_near_as_a_short_one() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("talk.glb");
    let (mesh, frames) = (strip(), 30_000);
    let swing = |range: std::ops::Range<usize>| {
        Array3::from_shape_fn((range.len(), 6, 3), |(t, v, i)| {
            let angle = 0.09 * (range.start + t) as f32 + (v * (i + 1)) as f32;
            0.004 * angle.sin() * (0.0007 * angle).cos()
        })
    };
    let mut file = ClipFile::new(&path).unwrap();
    file.begin(&ClipStart {
        mesh: &mesh,
        landmarks: canonical_landmarks(),
        frames,
        fps: FPS,
    })
    .unwrap();
    for first in (0..frames).step_by(5_000) {
        file.take(FrameBlock {
            displacements: swing(first..first + 5_000),
            landmarks: Array3::zeros((5_000, 68, 3)),
        })
        .unwrap();
    }
    file.finish(SILENT).unwrap();
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    let (document, buffers, _) = gltf::import(&path).unwrap();
    let weights = weights(&document, &buffers, 0);
    let primitive = document
        .meshes()
        .next()
        .unwrap()
        .primitives()
        .next()
        .unwrap();
    let reader = primitive.reader(|buffer| Some(&buffers[buffer.index()]));
    let targets: Vec<Vec<[f32; 3]>> = reader
        .read_morph_targets()
        .map(|(positions, ..)| positions.unwrap().collect())
        .collect();
    assert_eq!(weights.len(), frames * targets.len());
    let expected = swing(0..frames);
    for t in (0..frames).step_by(7) {
        for v in 0..6 {
            for i in 0..3 {
                let weights = &weights[t * targets.len()..][..targets.len()];
                let shown: f32 = weights.iter().zip(&targets).map(|(w, d)| w * d[v][i]).sum();
                assert!(
                    (shown - expected[[t, v, i]]).abs() < NEAR,
                    "frame {t}, vertex {v}"
                );
            }
        }
    }
}

#[test]
fn a_scene_that_is_cancelled_at_any_moment_leaves_nothing() {
    use std::sync::atomic::{AtomicUsize, Ordering};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("talk.glb");
    let mesh = strip();
    let mut asked_before = 0;
    for moment in 0.. {
        let mut file = ClipFile::new(&path).unwrap();
        file.begin(&ClipStart {
            mesh: &mesh,
            landmarks: canonical_landmarks(),
            frames: FRAMES,
            fps: FPS,
        })
        .unwrap();
        file.take(FrameBlock {
            displacements: swing(mesh.positions.len()),
            landmarks: Array3::zeros((FRAMES, 68, 3)),
        })
        .unwrap();
        let asked = AtomicUsize::new(0);
        // The host cancels once, at this moment.
        let ended = file.finish(&|_| asked.fetch_add(1, Ordering::Relaxed) != moment);
        drop(file);
        if asked.load(Ordering::Relaxed) <= moment {
            assert!(ended.is_ok() && path.exists());
            assert!(asked_before > 8, "asked {asked_before} times");
            return;
        }
        asked_before = moment + 1;
        assert!(matches!(ended, Err(Error::Cancelled)), "moment {moment}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
