//! USD as text (.usda): a mesh with blend shapes, their weights over time, and a joint that turns
//! the head.
//!
//! This module writes the text itself, because the format's own library is a hundred megabytes of
//! C++ and such a scene is only a few dozen lines around its numbers. Joints and blend shapes
//! follow the schema UsdSkel, which every program that reads USD characters knows.

use std::{
    io::{self, Write},
    path::Path,
};

use glam::Quat;

use super::{
    scene::{Scene, hinges, is_z_up},
    targets::Targets,
};
use crate::{Error, Result};

/// Items in a row of text.
const PER_ROW: usize = 8;

/// Writes the scene at `path`.
///
/// # Errors
/// `Io` of the writer, and `Numerics` for landmarks that all lie in one place.
pub(super) fn write_usd(
    (file, path): (&mut impl Write, &Path),
    scene: &Scene<'_>,
    targets: &Targets,
) -> Result<()> {
    let joint = Joint::of(scene)?;
    write(file, scene, targets, &joint).map_err(Error::io(path))
}

/// The joint that turns the head.
struct Joint {
    /// The point between the jaw's hinges, mesh units.
    place: [f32; 3],
    /// `[T]`
    turns: Vec<Quat>,
    /// `Y` or `Z`.
    up: char,
}

impl Joint {
    fn of(scene: &Scene<'_>) -> Result<Joint> {
        let to_mesh = hinges(scene)?;
        let turn = |turn: ndarray::ArrayView1<'_, f32>| {
            Quat::from_scaled_axis(to_mesh.rotate([turn[0], turn[1], turn[2]]).into())
        };
        let turns = scene
            .life
            .map(|life| life.head.outer_iter().map(turn).collect());
        Ok(Joint {
            place: to_mesh.apply([0.0; 3]),
            turns: turns.unwrap_or_default(),
            up: if is_z_up(scene)? { 'Z' } else { 'Y' },
        })
    }
}

fn write(
    file: &mut impl Write,
    scene: &Scene<'_>,
    targets: &Targets,
    joint: &Joint,
) -> io::Result<()> {
    let names: Vec<String> = targets
        .shapes
        .iter()
        .map(|shape| shape.name.replace(' ', "_"))
        .collect();
    let quoted = listed(names.iter().map(|name| format!("\"{name}\"")));
    header(file, scene, targets, joint)?;
    writeln!(file, "def SkelRoot \"Anyface\"\n{{")?;
    mesh(file, scene, targets, (&names, &quoted))?;
    skeleton(file, joint)?;
    animation(file, targets, joint, &quoted)?;
    writeln!(file, "}}")
}

/// Writes units, axes and times of the file, and the name of its sound file.
fn header(
    file: &mut impl Write,
    scene: &Scene<'_>,
    targets: &Targets,
    joint: &Joint,
) -> io::Result<()> {
    writeln!(
        file,
        "#usda 1.0\n(\n    defaultPrim = \"Anyface\"\n    metersPerUnit = 1\n    upAxis = \"{}\"\n    \
         startTimeCode = 0\n    endTimeCode = {}\n    timeCodesPerSecond = {fps}\n    framesPerSecond = {fps}",
        joint.up,
        targets.weights.nrows().saturating_sub(1),
        fps = targets.fps,
    )?;
    if let Some(sound) = scene.sound {
        writeln!(
            file,
            "    customLayerData = {{\n        string sound = {}\n    }}",
            text(sound)
        )?;
    }
    writeln!(file, ")\n")
}

/// Writes the joint at rest.
fn skeleton(file: &mut impl Write, joint: &Joint) -> io::Result<()> {
    let [x, y, z] = joint.place;
    let placed = format!("[((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), ({x}, {y}, {z}, 1))]");
    writeln!(
        file,
        "    def Skeleton \"Skeleton\" (\n        prepend apiSchemas = [\"SkelBindingAPI\"]\n    )\n    {{\n        \
         uniform token[] joints = [\"Head\"]\n        uniform matrix4d[] bindTransforms = {placed}\n        \
         uniform matrix4d[] restTransforms = {placed}\n        rel skel:animationSource = </Anyface/Animation>\n    }}\n"
    )
}

/// Writes the weights of the blend shapes and the turns of the joint over time.
fn animation(
    file: &mut impl Write,
    targets: &Targets,
    joint: &Joint,
    quoted: &str,
) -> io::Result<()> {
    writeln!(
        file,
        "    def SkelAnimation \"Animation\"\n    {{\n        uniform token[] blendShapes = {quoted}"
    )?;
    writeln!(file, "        float[] blendShapeWeights.timeSamples = {{")?;
    for (t, row) in targets.weights.outer_iter().enumerate() {
        writeln!(
            file,
            "            {t}: {},",
            listed(row.iter().map(f32::to_string))
        )?;
    }
    let [x, y, z] = joint.place;
    writeln!(
        file,
        "        }}\n        uniform token[] joints = [\"Head\"]\n        half3[] scales = [(1, 1, 1)]\n        \
         float3[] translations = [({x}, {y}, {z})]"
    )?;
    if joint.turns.is_empty() {
        writeln!(file, "        quatf[] rotations = [(1, 0, 0, 0)]")?
    } else {
        writeln!(file, "        quatf[] rotations.timeSamples = {{")?;
        for (t, q) in joint.turns.iter().enumerate() {
            writeln!(
                file,
                "            {t}: [({}, {}, {}, {})],",
                q.w, q.x, q.y, q.z
            )?;
        }
        writeln!(file, "        }}")?;
    }
    writeln!(file, "    }}")
}

/// Writes the mesh with its blend shapes.
fn mesh(
    file: &mut impl Write,
    scene: &Scene<'_>,
    targets: &Targets,
    (names, quoted): (&[String], &str),
) -> io::Result<()> {
    let mesh = scene.mesh;
    writeln!(
        file,
        "    def Mesh \"Face\" (\n        prepend apiSchemas = [\"SkelBindingAPI\"]\n    )\n    {{\n        \
         uniform token subdivisionScheme = \"none\""
    )?;
    let counts = mesh.triangles.iter().map(|_| "3".to_owned());
    rows(file, "int[] faceVertexCounts", counts)?;
    let corners = mesh.triangles.as_flattened().iter();
    rows(file, "int[] faceVertexIndices", corners.map(u32::to_string))?;
    rows(file, "point3f[] points", mesh.positions.iter().map(point))?;
    rows(
        file,
        "normal3f[] normals",
        mesh.vertex_normals().iter().map(point),
    )?;
    let paths = listed(names.iter().map(|name| format!("</Anyface/Face/{name}>")));
    writeln!(
        file,
        "        int[] primvars:skel:jointIndices = [0] (\n            elementSize = 1\n            interpolation = \
         \"constant\"\n        )\n        float[] primvars:skel:jointWeights = [1] (\n            elementSize = 1\n            \
         interpolation = \"constant\"\n        )\n        matrix4d primvars:skel:geomBindTransform = ((1, 0, 0, 0), (0, 1, 0, 0), \
         (0, 0, 1, 0), (0, 0, 0, 1))\n        rel skel:skeleton = </Anyface/Skeleton>\n        \
         uniform token[] skel:blendShapes = {quoted}\n        rel skel:blendShapeTargets = {paths}"
    )?;
    for (shape, name) in targets.shapes.iter().zip(names) {
        writeln!(file, "\n        def BlendShape \"{name}\"\n        {{")?;
        rows(
            file,
            "uniform vector3f[] offsets",
            shape.moved.iter().map(|(_, d)| point(d)),
        )?;
        rows(
            file,
            "uniform int[] pointIndices",
            shape.moved.iter().map(|(v, _)| v.to_string()),
        )?;
        writeln!(file, "        }}")?;
    }
    writeln!(file, "    }}\n")
}

fn point([x, y, z]: &[f32; 3]) -> String {
    format!("({x}, {y}, {z})")
}

fn listed(items: impl Iterator<Item = String>) -> String {
    format!("[{}]", items.collect::<Vec<_>>().join(", "))
}

/// Writes a list over several rows.
fn rows(file: &mut impl Write, name: &str, items: impl Iterator<Item = String>) -> io::Result<()> {
    write!(file, "        {name} = [")?;
    for (n, item) in items.enumerate() {
        let between = match n {
            0 => "",
            _ if n % PER_ROW == 0 => ",\n            ",
            _ => ", ",
        };
        write!(file, "{between}{item}")?;
    }
    writeln!(file, "]")
}

/// A text in quotes.
fn text(plain: &str) -> String {
    let escaped = plain.replace('\\', "\\\\").replace('"', "\\\"");
    format!("\"{}\"", escaped.replace(['\n', '\r'], " "))
}
