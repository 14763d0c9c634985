use ndarray::{Array3, s};
use serde_json::{Value, json};

use super::{VrmNames, avatar::avatar};
use crate::{
    Error, Result,
    face::Rig,
    job::SILENT,
    mesh::{Landmarks, Mesh, canonical_landmarks, glb_chunks},
    motion::Life,
    output::{ClipFile, TakeShapes, glb::Document, rig_glb::with_shapes, scene::Scene},
    rig::{ARKIT, VISEMES},
    spread::{ClipStart, FrameBlock, FrameSink},
};

/// A face with one triangle of ten centimetres for each shape, which moves it by a millimetre.
fn face() -> (Mesh, Rig) {
    let names: Vec<String> = ARKIT
        .iter()
        .chain(&VISEMES)
        .map(|name| (*name).to_owned())
        .collect();
    let positions = (0..3 * names.len()).map(|v| match v % 3 {
        0 => [0.0; 3],
        1 => [0.1, 0.0, 0.0],
        _ => [0.0, 0.1, 0.0],
    });
    let triangles = (0..names.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
    let mesh = Mesh::from_arrays(positions.collect(), triangles.collect()).unwrap();
    let mut deltas = Array3::zeros((names.len(), mesh.positions.len(), 3));
    for shape in 0..names.len() {
        deltas
            .slice_mut(s![shape, 3 * shape..3 * shape + 3, 2])
            .fill(0.001);
    }
    let rig = Rig {
        names,
        deltas,
        reports: Vec::new(),
    };
    (mesh, rig)
}

fn written(
    mesh: &Mesh,
    rig: &Rig,
    landmarks: &[[f32; 3]; 68],
    source: Option<&[u8]>,
) -> Result<(Document, Vec<String>)> {
    let scene = Scene {
        mesh,
        landmarks,
        life: None,
        source,
        sound: None,
    };
    avatar(rig, &scene, "Ann")
}

/// A GLB of the mesh as one primitive that already has a target. `change` edits its JSON.
fn glb(mesh: &Mesh, change: impl FnOnce(&mut Value)) -> Vec<u8> {
    let mut data: Vec<u8> = mesh
        .positions
        .as_flattened()
        .iter()
        .flat_map(|x| x.to_le_bytes())
        .collect();
    let points = data.len();
    data.extend(
        mesh.triangles
            .as_flattened()
            .iter()
            .flat_map(|v| v.to_le_bytes()),
    );
    let count = mesh.positions.len();
    let points_accessor = json!({"bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3",
        "min": [0.0, 0.0, 0.0], "max": [0.1, 0.1, 0.0]});
    let mut json = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "Body", "mesh": 0}],
        "materials": [{"name": "Skin", "extras": 0.1}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0, "targets": [{"POSITION": 0}]}],
            "extras": "by hand"}],
        "buffers": [{"byteLength": data.len()}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": points},
            {"buffer": 0, "byteOffset": points, "byteLength": data.len() - points},
        ],
        "accessors": [points_accessor,
            {"bufferView": 1, "componentType": 5125, "count": 3 * mesh.triangles.len(), "type": "SCALAR"}],
    });
    change(&mut json);
    let mut json = json.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut file = b"glTF".to_vec();
    for number in [2, 28 + json.len() + data.len(), json.len()] {
        file.extend((number as u32).to_le_bytes());
    }
    file.extend(b"JSON");
    file.extend(json);
    file.extend((data.len() as u32).to_le_bytes());
    file.extend(b"BIN\0");
    file.extend(data);
    file
}

/// Names of the targets that an expression moves.
fn moved<'a>(json: &'a Value, expression: &Value) -> Vec<(&'a str, f64)> {
    let binds = expression["morphTargetBinds"]
        .as_array()
        .into_iter()
        .flatten();
    let names = binds.map(|bind| {
        let mesh = json["nodes"][bind["node"].as_u64().unwrap() as usize]["mesh"].as_u64();
        let names = &json["meshes"][mesh.unwrap() as usize]["extras"]["targetNames"];
        let name = names[bind["index"].as_u64().unwrap() as usize].as_str();
        (name.unwrap(), bind["weight"].as_f64().unwrap())
    });
    names.collect()
}

#[test]
fn a_head_alone_gets_bones_and_expressions() {
    let (mesh, rig) = face();
    let (document, replaced) = written(&mesh, &rig, canonical_landmarks(), None).unwrap();
    assert!(replaced.is_empty());
    let json = &document.json;
    let vrm = &json["extensions"]["VRMC_vrm"];
    assert_eq!(
        (&vrm["specVersion"], &vrm["meta"]["name"]),
        (&json!("1.0"), &json!("Ann"))
    );
    assert_eq!(vrm["humanoid"]["humanBones"].as_object().unwrap().len(), 15);
    let expressions = &vrm["expressions"];
    assert_eq!(expressions["custom"].as_object().unwrap().len(), 52);
    assert_eq!(expressions["preset"].as_object().unwrap().len(), 17);
    assert_eq!(
        moved(json, &expressions["preset"]["ou"]),
        [("viseme_U", 1.0)]
    );
    assert_eq!(
        moved(json, &expressions["custom"]["JawOpen"]),
        [("jawOpen", 1.0)]
    );
    let left = [("eyeLookOutLeft", 1.0), ("eyeLookInRight", 1.0)];
    assert_eq!(moved(json, &expressions["preset"]["lookLeft"]), left);
    assert_eq!(expressions["custom"]["JawOpen"]["overrideMouth"], "block");
    assert_eq!(vrm["lookAt"]["type"], "expression");
    let animations = json.get("animations");
    assert!(animations.is_none());
}

#[test]
fn a_head_in_centimetres_with_z_up_stands_in_the_axes_of_vrm() {
    let (mut mesh, rig) = face();
    let turn = |[x, y, z]: [f32; 3]| [100.0 * x + 3.0, -100.0 * z, 100.0 * y];
    mesh.positions.iter_mut().for_each(|p| *p = turn(*p));
    let landmarks = canonical_landmarks().map(turn);
    let (document, _) = written(&mesh, &rig, &landmarks, None).unwrap();
    let nodes = document.json["nodes"].as_array().unwrap();
    let face = nodes.iter().find(|node| node["name"] == "Face").unwrap();
    let numbers = |name: &str| -> Vec<f32> {
        let numbers = face[name].as_array().unwrap().iter();
        numbers.map(|x| x.as_f64().unwrap() as f32).collect()
    };
    let matrix = glam::Mat4::from_scale_rotation_translation(
        glam::Vec3::from_slice(&numbers("scale")),
        glam::Quat::from_slice(&numbers("rotation")),
        glam::Vec3::from_slice(&numbers("translation")),
    );
    for (placed, expected) in landmarks.iter().zip(canonical_landmarks()) {
        let placed = matrix.transform_point3((*placed).into());
        assert!(
            placed.distance((*expected).into()) < 1e-5,
            "{placed} {expected:?}"
        );
    }
}

#[test]
fn a_vrm_keeps_all_that_is_not_a_new_expression() {
    let (mesh, rig) = face();
    let source = glb(&mesh, |json| {
        json["skins"] = json!([{"joints": [0]}]);
        json["extensionsUsed"] = json!(["VRMC_vrm", "VRMC_springBone"]);
        json["extensions"] = json!({
            "VRMC_springBone": {"specVersion": "1.0", "springs": [{"name": "hair"}]},
            "VRMC_vrm": {
                "specVersion": "1.0", "meta": {"name": "Mine"}, "lookAt": {"type": "bone"},
                "expressions": {
                    "preset": {"aa": {"morphTargetBinds": [{"node": 0, "index": 0, "weight": 1.0}]}},
                    "custom": {"Ears": {"morphTargetBinds": [{"node": 0, "index": 0, "weight": 1.0}]}},
                },
            },
        });
    });
    let (document, replaced) = written(&mesh, &rig, canonical_landmarks(), Some(&source)).unwrap();
    assert_eq!(replaced, ["aa"]);
    let (before, bytes) = glb_chunks(&source).unwrap();
    let mut before: Value = serde_json::from_slice(before).unwrap();
    let mut after = document.json.clone();
    assert!(document.binary.into_vec().starts_with(bytes));
    assert_eq!(after["meshes"][0]["extras"]["extras"], "by hand");
    let vrm = &after["extensions"]["VRMC_vrm"];
    assert_eq!(
        moved(&after, &vrm["expressions"]["preset"]["aa"]),
        [("viseme_aa", 1.0)]
    );
    let ears = &before["extensions"]["VRMC_vrm"]["expressions"]["custom"]["Ears"];
    assert_eq!(&vrm["expressions"]["custom"]["Ears"], ears);
    for list in ["accessors", "bufferViews"] {
        let length = before[list].as_array().unwrap().len();
        let after = after[list].as_array_mut().unwrap();
        assert_eq!(before[list].as_array().unwrap()[..], after[..length]);
    }
    // Everything that did not have to change is the same.
    for json in [&mut before, &mut after] {
        json["extensions"]["VRMC_vrm"]["expressions"].take();
        for list in ["accessors", "bufferViews", "buffers", "meshes"] {
            json[list].take();
        }
    }
    assert_eq!(before, after);
}

/// The GLB with all shapes of the rig.
fn shaped(mesh: &Mesh, rig: &Rig, source: &[u8]) -> Document {
    let landmarks = Landmarks {
        positions: *canonical_landmarks(),
        vertices: [0; 68],
        confidence: [1.0; 68],
    };
    let scene = Scene {
        mesh,
        landmarks: &landmarks.positions,
        life: None,
        source: Some(source),
        sound: None,
    };
    with_shapes(rig, &scene, &landmarks).unwrap()
}

#[test]
fn an_avatar_that_gets_shapes_keeps_the_expressions_that_it_has() {
    let (mesh, rig) = face();
    let own = json!([{"node": 0, "index": 0, "weight": 1.0}]);
    let red = json!([{"material": 0, "type": "color", "targetValue": [1.0, 0.0, 0.0, 1.0]}]);
    let source = glb(&mesh, |json| {
        json["skins"] = json!([{"joints": [0]}]);
        json["extensions"] = json!({"VRMC_vrm": {"expressions": {
            "preset": {
                "aa": {"morphTargetBinds": own}, "ih": {"morphTargetBinds": [], "isBinary": true},
                "ou": {"materialColorBinds": red},
            },
            "custom": {"JawOpen": {"morphTargetBinds": own}},
        }}});
    });
    let json = shaped(&mesh, &rig, &source).json;
    let expressions = &json["extensions"]["VRMC_vrm"]["expressions"];
    let preset = &expressions["preset"];
    assert_eq!(preset["aa"], json!({"morphTargetBinds": own}));
    assert_eq!(moved(&json, &preset["ih"]), [("viseme_I", 1.0)]);
    assert_eq!(preset["ih"]["isBinary"], true);
    assert_eq!(preset["ou"], json!({"materialColorBinds": red}));
    assert_eq!(moved(&json, &preset["oh"]), [("viseme_O", 1.0)]);
    assert_eq!(
        expressions["custom"]["JawOpen"],
        json!({"morphTargetBinds": own})
    );
    let smile = &expressions["custom"]["MouthSmileLeft"];
    assert_eq!(moved(&json, smile), [("mouthSmileLeft", 1.0)]);

    let source = glb(&mesh, |json| {
        let group = |preset: &str, binds: Value| json!({"name": preset, "presetName": preset, "binds": binds});
        let own = json!([{"mesh": 0, "index": 0, "weight": 100.0}]);
        let groups = [group("a", own), group("i", json!([]))];
        json["extensions"] = json!({"VRM": {"blendShapeMaster": {"blendShapeGroups": groups}}});
    });
    let json = shaped(&mesh, &rig, &source).json;
    let groups = &json["extensions"]["VRM"]["blendShapeMaster"]["blendShapeGroups"];
    assert_eq!(groups.as_array().unwrap().len(), 17 + 52);
    assert_eq!(
        groups[0]["binds"],
        json!([{"mesh": 0, "index": 0, "weight": 100.0}])
    );
    let vowel = groups[1]["binds"][0]["index"].as_u64().unwrap() as usize;
    assert_eq!(
        json["meshes"][0]["extras"]["targetNames"][vowel],
        "viseme_I"
    );
}

#[test]
fn groups_of_vrm_0_are_written_too() {
    let (mesh, rig) = face();
    let source = glb(&mesh, |json| {
        let group =
            |name: &str, preset: &str| json!({"name": name, "presetName": preset, "binds": []});
        let groups = [
            group("Mund A", "a"),
            group("jawopen", "unknown"),
            group("Ears", "unknown"),
        ];
        json["extensions"] = json!({"VRM": {"blendShapeMaster": {"blendShapeGroups": groups}}});
    });
    let (document, replaced) = written(&mesh, &rig, canonical_landmarks(), Some(&source)).unwrap();
    assert_eq!(replaced, ["Mund A", "jawopen"]);
    let groups = &document.json["extensions"]["VRM"]["blendShapeMaster"]["blendShapeGroups"];
    let groups = groups.as_array().unwrap();
    assert_eq!(groups.len(), 17 + 52 + 1);
    let of = |name: &str| groups.iter().find(|group| group["name"] == name).unwrap();
    assert_eq!(of("Ears")["binds"], json!([]));
    assert_eq!(of("LookUp")["presetName"], "lookup");
    let blink = of("Blink")["binds"].as_array().unwrap();
    assert_eq!((blink.len(), &blink[0]["weight"]), (2, &json!(100.0)));
    // It follows the target that the mesh already had.
    assert_eq!(of("EyeBlinkLeft")["binds"][0]["index"], 1);
}

#[test]
fn a_glb_with_bones_that_is_no_avatar_is_refused() {
    let (mesh, rig) = face();
    let source = glb(&mesh, |json| json["skins"] = json!([{"joints": [0]}]));
    let refused = written(&mesh, &rig, canonical_landmarks(), Some(&source));
    let Err(Error::InvalidInput(message)) = refused.map(|_| ()) else {
        panic!("expected a refusal");
    };
    assert!(message.contains("which bone is which"), "{message}");
    let plain = glb(&mesh, |_| {});
    let (document, _) = written(&mesh, &rig, canonical_landmarks(), Some(&plain)).unwrap();
    assert_eq!(document.json["materials"][0]["name"], "Skin");
}

/// Two frames. In the second the jaw is half open, the left eye is shut and the viseme aa shows.
fn take(path: &std::path::Path, names: VrmNames) -> Result<()> {
    let (mesh, rig) = face();
    let mut displacements = Array3::zeros((2, mesh.positions.len(), 3));
    for (name, weight) in [("jawOpen", 0.5), ("eyeBlinkLeft", 1.0), ("viseme_aa", 0.75)] {
        let shape = rig.names.iter().position(|known| known == name).unwrap();
        let moved = &rig.deltas.index_axis(ndarray::Axis(0), shape) * weight;
        let mut frame = displacements.index_axis_mut(ndarray::Axis(0), 1);
        frame += &moved;
    }
    let mut life = Life::still(2);
    life.head[[1, 1]] = 0.25;
    life.gaze[[1, 0, 0]] = 0.2;
    life.gaze[[1, 1, 0]] = 0.4;
    let shapes = TakeShapes::new(std::sync::Arc::new(rig), &[0; 68]);
    let mut file = ClipFile::new(path)?
        .with_shapes(shapes)
        .with_vrm_names(names);
    file.add_life(&life);
    file.begin(&ClipStart {
        mesh: &mesh,
        landmarks: canonical_landmarks(),
        frames: 2,
        fps: 25.0,
    })?;
    file.take(FrameBlock {
        displacements,
        landmarks: Array3::zeros((2, 68, 3)),
    })?;
    file.finish(SILENT)
}

/// The values with which the animation moves a node.
fn values(path: &std::path::Path, node: &Value) -> Vec<f32> {
    let bytes = std::fs::read(path).unwrap();
    let (json, binary) = glb_chunks(&bytes).unwrap();
    let json: Value = serde_json::from_slice(json).unwrap();
    let animation = &json["animations"][0];
    let mut channels = animation["channels"].as_array().unwrap().iter();
    let channel = channels
        .find(|channel| &channel["target"]["node"] == node)
        .unwrap();
    let sampler = &animation["samplers"][channel["sampler"].as_u64().unwrap() as usize];
    let accessor = &json["accessors"][sampler["output"].as_u64().unwrap() as usize];
    let view = &json["bufferViews"][accessor["bufferView"].as_u64().unwrap() as usize];
    let at = |name: &str| view[name].as_u64().unwrap() as usize;
    let bytes = &binary[at("byteOffset")..][..at("byteLength")];
    bytes
        .as_chunks()
        .0
        .iter()
        .map(|four| f32::from_le_bytes(*four))
        .collect()
}

#[test]
fn a_take_has_expressions_the_head_and_the_eyes_over_time() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("talk.vrma");
    take(&path, VrmNames::All).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let json: Value = serde_json::from_slice(glb_chunks(&bytes).unwrap().0).unwrap();
    let vrma = &json["extensions"]["VRMC_vrm_animation"];
    let weight = |kind: &str, name: &str| {
        let node = &vrma["expressions"][kind][name]["node"];
        values(&path, node)[3]
    };
    assert!((weight("custom", "JawOpen") - 0.5).abs() < 0.02);
    assert!((weight("preset", "aa") - 0.75).abs() < 0.02);
    assert!(weight("preset", "blinkLeft") > 0.9 && weight("preset", "blink") < 0.02);
    assert!(
        vrma["expressions"]["custom"]
            .get("EyeLookInRight")
            .is_none()
    );
    let head = values(&path, &vrma["humanoid"]["humanBones"]["head"]["node"]);
    assert!((2.0 * head[5].asin() - 0.25).abs() < 1e-5, "{head:?}");
    let eyes = values(&path, &vrma["lookAt"]["node"]);
    assert!((2.0 * eyes[5].asin() - 0.3).abs() < 1e-5, "{eyes:?}");
}

#[test]
fn an_avatar_that_would_move_twice_is_sent_one_kind() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("talk.vrma");
    for (names, has, lacks) in [
        (VrmNames::Vrm, "preset", "custom"),
        (VrmNames::PerfectSync, "custom", "preset"),
    ] {
        take(&path, names).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let json: Value = serde_json::from_slice(glb_chunks(&bytes).unwrap().0).unwrap();
        let expressions = &json["extensions"]["VRMC_vrm_animation"]["expressions"];
        assert!(expressions.get(has).is_some() && expressions.get(lacks).is_none());
    }
}

#[test]
fn a_take_without_shapes_is_refused_before_its_frames() {
    let folder = tempfile::tempdir().unwrap();
    let (mesh, _) = face();
    let mut file = ClipFile::new(&folder.path().join("talk.vrma")).unwrap();
    let error = file.begin(&ClipStart {
        mesh: &mesh,
        landmarks: canonical_landmarks(),
        frames: 2,
        fps: 25.0,
    });
    let error = error.unwrap_err().to_string();
    assert!(error.contains("the shapes of the mesh"), "{error}");
}
