//! The morph targets that the file of a mesh has, and the weights that show a take on them.
//!
//! A target shows a shape by its name ([`shown_shapes`]) or as part of a VRM expression. The take
//! is solved for weights of those shapes, and the shapes set the values of their targets.

use std::{
    borrow::Cow,
    sync::{Arc, OnceLock},
};

use ndarray::{Array2, Array3, ArrayView3, Axis, aview1, s};
use serde::Serialize;
use serde_json::Value;

use super::{
    moved::Moved,
    take_shapes::TakeShapes,
    targets::{FileTarget, Targets, least_displacement},
};
use crate::{
    Error, Result,
    face::{Face, Rig},
    job::ProgressFn,
    mesh::{GlbTarget, glb_chunks, glb_parts, glb_targets},
    motion::Life,
    rig::{KeyPair, shape_of, shown_shapes},
};

/// Skin within this share of the mouth's width of a lip landmark is the mouth, whose motion the
/// report compares.
const MOUTH_IN_WIDTHS: f32 = 0.4;

/// Morph targets that move together: those of one name on all meshes, or those of an expression.
#[derive(Debug, Clone, PartialEq)]
struct Key {
    name: String,
    /// Numbers of the targets with their weights at value 1 of the key.
    binds: Vec<(usize, f32)>,
}

/// The morph targets of a file that show shapes of the face.
pub struct MeshTargets {
    /// `[N]`, all targets of the file.
    targets: Vec<GlbTarget>,
    /// `[K]`.
    keys: Vec<Key>,
    /// The shapes of the keys `[S]`, each with its displacements.
    shapes: TakeShapes,
    names: Vec<String>,
    /// `[S, K]`, the values of the keys at weight 1 of each shape.
    factors: Array2<f32>,
    mouth: Vec<usize>,
    /// `[N, M, 3]`, the displacements of the mouth's vertices.
    at_mouth: Array3<f32>,
    notes: Vec<String>,
    empty: Vec<String>,
    list: String,
    shares: OnceLock<f32>,
}

/// The targets that a take has driven.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TargetReport {
    /// The tool whose names the targets have.
    pub tool: String,
    /// Names of the targets or expressions that were driven.
    pub names: Vec<String>,
    /// Names of targets that move nothing and count as none.
    pub empty: Vec<String>,
    /// Share of the energy of the mouth's motion that they show, over its vertices and all frames: 1
    /// less the mean square of what is missing over that of the motion.
    pub share_of_mouth: f32,
}

/// Which shapes the morph targets of a file show, by their names and by the expressions of a VRM.
#[derive(Debug, Clone)]
pub struct TargetNames {
    tool: String,
    keys: Vec<Key>,
    pairs: Vec<KeyPair>,
    notes: Vec<String>,
    empty: Vec<String>,
}

impl TargetNames {
    /// The names in a GLB or VRM, of which no face needs to be known.
    ///
    /// # Errors
    /// As [`MeshTargets::read`].
    pub fn read(source: &[u8]) -> Result<TargetNames> {
        TargetNames::of(source, &targets_in(source)?)
    }

    fn of(source: &[u8], targets: &[GlbTarget]) -> Result<TargetNames> {
        let document: Value = serde_json::from_slice(glb_chunks(source)?.0)
            .map_err(|e| Error::Mesh(format!("glTF: its description: {e}")))?;
        let (by_name, expressions) = (keys_by_name(targets), expressions(&document, targets));
        let choices = [&expressions.keys, &by_name].map(|keys| {
            let names: Vec<&str> = keys.iter().map(|key| &*key.name).collect();
            shown_shapes(&names)
        });
        let count = |choice: &Option<(String, Vec<KeyPair>)>| {
            choice.as_ref().map_or(0, |(_, pairs)| pairs.len())
        };
        let is_by_name = count(&choices[1]) > count(&choices[0]);
        let [of_expressions, of_names] = choices;
        let (keys, choice, notes) = if is_by_name {
            (by_name, of_names, Vec::new())
        } else {
            (expressions.keys, of_expressions, expressions.notes)
        };
        let empty = empty_names(targets);
        let Some((tool, pairs)) = choice else {
            return Err(nothing_to_drive(targets, &empty));
        };
        Ok(TargetNames {
            tool,
            keys,
            pairs,
            notes,
            empty,
        })
    }

    /// The tool whose names these are.
    pub fn tool(&self) -> &str {
        &self.tool
    }

    /// Values, 0 to 1, of the targets or expressions that show shapes, each with its name. `weight`: that of a
    /// shape of ARKit or of a viseme; `counts`: whether it counts.
    pub fn values(
        &self,
        weight: impl Fn(&str) -> f32,
        counts: impl Fn(&str) -> bool,
    ) -> Vec<(&str, f32)> {
        let keys = self.keys.iter().map(|key| key.name.as_str());
        let shown = keys.filter_map(|name| {
            let pairs = self.pairs.iter();
            let pairs = pairs.filter(|pair| pair.key == name && counts(&pair.shape));
            let parts = pairs.map(|pair| pair.factor * weight(&pair.shape));
            let value = parts.reduce(|sum, part| sum + part)?;
            Some((name, value.clamp(0.0, 1.0)))
        });
        shown.collect()
    }
}

impl MeshTargets {
    /// The targets of a GLB or VRM that show shapes of its face.
    ///
    /// # Errors
    /// `Mesh` for a file that is no readable GLB, `InvalidInput` if it has no target that can be
    /// driven.
    pub fn read(source: &[u8], face: &Face) -> Result<Arc<MeshTargets>> {
        let mut targets = targets_in(source)?;
        let least = least_displacement(&face.landmarks.positions);
        for target in &mut targets {
            target
                .moved
                .retain(|(_, moved)| moved.iter().any(|x| x.abs() > least));
        }
        let TargetNames {
            tool,
            keys,
            pairs,
            notes,
            empty,
        } = TargetNames::of(source, &targets)?;
        Ok(Arc::new(MeshTargets {
            list: tool,
            notes,
            empty,
            ..MeshTargets::of_pairs(targets, keys, &pairs, face)
        }))
    }

    fn of_pairs(
        targets: Vec<GlbTarget>,
        keys: Vec<Key>,
        pairs: &[KeyPair],
        face: &Face,
    ) -> MeshTargets {
        let mut names: Vec<String> = Vec::new();
        for pair in pairs {
            if !names.contains(&pair.shape) {
                names.push(pair.shape.clone());
            }
        }
        let mut factors = Array2::zeros((names.len(), keys.len()));
        for pair in pairs {
            let shape = names.iter().position(|name| *name == pair.shape);
            let key = keys.iter().position(|key| key.name == pair.key);
            if let Some(place) = shape.zip(key) {
                factors[place] += pair.factor;
            }
        }
        let mut deltas = Array3::zeros((names.len(), face.mesh.positions.len(), 3));
        for ((shape, key), factor) in factors.indexed_iter().filter(|(_, factor)| **factor != 0.0) {
            for (target, weight) in &keys[key].binds {
                for (v, moved) in &targets[*target].moved {
                    for axis in 0..3 {
                        deltas[[shape, *v as usize, axis]] += factor * weight * moved[axis];
                    }
                }
            }
        }
        let mouth = mouth_vertices(face);
        let mut at_mouth = Array3::zeros((targets.len(), mouth.len(), 3));
        for (n, target) in targets.iter().enumerate() {
            for (v, moved) in &target.moved {
                if let Ok(place) = mouth.binary_search(&(*v as usize)) {
                    (0..3).for_each(|axis| at_mouth[[n, place, axis]] = moved[axis]);
                }
            }
        }
        let rig = Rig {
            names: names.clone(),
            deltas,
            reports: Vec::new(),
        };
        MeshTargets {
            shapes: TakeShapes::new(Arc::new(rig), &face.landmarks.vertices),
            targets,
            keys,
            names,
            factors,
            mouth,
            at_mouth,
            notes: Vec::new(),
            empty: Vec::new(),
            list: String::new(),
            shares: OnceLock::new(),
        }
    }

    /// Weights of the targets that show a take.
    ///
    /// # Errors
    /// Those of [`crate::rig::solve`], and `Io` of the file in which a long take waits.
    pub(super) fn playing(
        &self,
        moved: &mut Moved,
        life: Option<&Life>,
        progress: ProgressFn<'_>,
    ) -> Result<Targets> {
        let (mut left, mut all) = (0.0, 0.0);
        let weights = moved.solve(self.targets.len(), |range, part| {
            let life = life.map(|life| life.frames_of(range));
            let weights = self.weights(part, life.as_ref(), progress)?;
            let (part_left, part_all) = self.energies(&weights, part);
            left += part_left;
            all += part_all;
            Ok(weights)
        })?;
        let left_out = if all > 0.0 { left / all } else { 0.0 };
        // The first take of the targets is the one that is reported.
        self.shares.get_or_init(|| (1.0 - left_out) as f32);
        let places = self.targets.iter().enumerate();
        let show = self.show_shapes();
        let in_file = places.filter(|(n, _)| show[*n]);
        let in_file = in_file.map(|(n, target)| ((target.mesh, target.number), n));
        let turn_eyes = self.names.iter().any(|name| name.starts_with("eyeLook"));
        let time = (moved.fps(), turn_eyes);
        Ok(Targets::of_file(in_file.collect(), weights, time))
    }

    /// All targets of the file `[N]`, in its order.
    pub fn targets(&self) -> &[GlbTarget] {
        &self.targets
    }

    /// Weights `[T, N]` of the targets that show displacements of the mesh `[T, V, 3]`, mesh units. Gaze
    /// comes from `life`, because displacements do not turn the eyes.
    ///
    /// # Errors
    /// Those of [`crate::rig::solve`].
    pub fn weights(
        &self,
        displacements: ArrayView3<'_, f32>,
        life: Option<&Life>,
        progress: ProgressFn<'_>,
    ) -> Result<Array2<f32>> {
        let names: Vec<&str> = self.names.iter().map(String::as_str).collect();
        let shapes = self
            .shapes
            .weights_of(&names, displacements, life, progress)?;
        Ok(self.of_targets(&shapes))
    }

    /// Weights of the targets `[T, N]` at weights of the shapes `[T, S]`.
    fn of_targets(&self, shapes: &Array2<f32>) -> Array2<f32> {
        let keys = shapes.dot(&self.factors).mapv(|w| w.clamp(0.0, 1.0));
        let mut weights = Array2::zeros((shapes.nrows(), self.targets.len()));
        for (key, values) in self.keys.iter().zip(keys.columns()) {
            for (target, weight) in &key.binds {
                weights.column_mut(*target).scaled_add(*weight, &values);
            }
        }
        weights.mapv(|w| w.clamp(0.0, 1.0))
    }

    /// The energy of the mouth's motion that `weights` `[T, N]` leave out, and of all its motion.
    fn energies(&self, weights: &Array2<f32>, moved: ArrayView3<'_, f32>) -> (f64, f64) {
        let size = 3 * self.mouth.len();
        let wanted = moved.select(Axis(1), &self.mouth);
        let wanted = wanted.to_shape((weights.nrows(), size));
        let wanted = wanted.expect("row-major array");
        let shapes = self.at_mouth.to_shape((self.targets.len(), size));
        let left = &wanted - &weights.dot(&shapes.expect("row-major array"));
        let energy = |x: f32| f64::from(x).powi(2);
        (
            left.iter().map(|x| energy(*x)).sum(),
            wanted.iter().map(|x| energy(*x)).sum(),
        )
    }

    /// `[N]`, whether a key that shows a shape moves the target.
    fn show_shapes(&self) -> Vec<bool> {
        let mut shown = vec![false; self.targets.len()];
        for (key, factors) in self.keys.iter().zip(self.factors.columns()) {
            if factors.iter().any(|factor| *factor != 0.0) {
                key.binds
                    .iter()
                    .for_each(|(target, _)| shown[*target] = true);
            }
        }
        shown
    }

    /// What was driven. `None` before a take was written.
    pub fn report(&self) -> Option<TargetReport> {
        let share_of_mouth = *self.shares.get()?;
        let keys = self.keys.iter().zip(self.factors.columns());
        let shown = keys.filter(|(_, factors)| factors.iter().any(|factor| *factor != 0.0));
        Some(TargetReport {
            tool: self.list.clone(),
            names: shown.map(|(key, _)| key.name.clone()).collect(),
            empty: self.empty.clone(),
            share_of_mouth,
        })
    }

    /// Sentences about what the targets cannot show.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }
}

/// The rig with the displacements of the targets of its shapes' names that the file of its mesh has already, each
/// on its own meshes, and those targets. `source`: the bytes of the file. Only a GLB has targets.
///
/// # Errors
/// `Mesh` for a GLB that cannot be read.
pub(super) fn with_file_targets<'a>(
    rig: &'a Rig,
    source: Option<&[u8]>,
) -> Result<(Cow<'a, Rig>, Vec<FileTarget>)> {
    let Some(source) = source.filter(|bytes| bytes.starts_with(b"glTF")) else {
        return Ok((Cow::Borrowed(rig), Vec::new()));
    };
    let targets = glb_targets(source)?;
    let file_targets = targets_of_shapes(&targets);
    if file_targets.is_empty() {
        return Ok((Cow::Borrowed(rig), file_targets));
    }
    let (parts, mut rig) = (glb_parts(source)?, rig.clone());
    for FileTarget {
        mesh,
        number,
        shape,
        ..
    } in file_targets.iter().filter(|target| !target.is_empty)
    {
        let Some(row) = rig.names.iter().position(|name| name == shape) else {
            continue;
        };
        let mut deltas = rig.deltas.index_axis_mut(Axis(0), row);
        for part in parts.iter().filter(|part| part.mesh == *mesh) {
            deltas.slice_mut(s![part.vertices.clone(), ..]).fill(0.0);
        }
        let target = targets
            .iter()
            .find(|target| (target.mesh, target.number) == (*mesh, *number));
        for (v, moved) in target.into_iter().flat_map(|target| &target.moved) {
            deltas.row_mut(*v as usize).assign(&aview1(moved));
        }
    }
    Ok((Cow::Owned(rig), file_targets))
}

/// The targets that have the names of our shapes, one a shape on each mesh. One that moves something
/// comes before one that does not.
fn targets_of_shapes(targets: &[GlbTarget]) -> Vec<FileTarget> {
    let mut file_targets: Vec<FileTarget> = Vec::new();
    let (empty, moving): (Vec<_>, Vec<_>) = targets
        .iter()
        .partition(|target: &&GlbTarget| target.moved.is_empty());
    for target in moving.into_iter().chain(empty) {
        let shape = shape_of(&target.name);
        let is_new = |shape: &&str| {
            !file_targets
                .iter()
                .any(|known| (known.mesh, known.shape) == (target.mesh, *shape))
        };
        file_targets.extend(shape.filter(is_new).map(|shape| FileTarget {
            mesh: target.mesh,
            number: target.number,
            shape,
            is_empty: target.moved.is_empty(),
        }));
    }
    file_targets
}

/// The targets of a GLB or VRM.
///
/// # Errors
/// `Mesh` for a file that is no readable GLB, `InvalidInput` for another format.
fn targets_in(source: &[u8]) -> Result<Vec<GlbTarget>> {
    if !source.starts_with(b"glTF") {
        return Err(Error::InvalidInput(
            "targets of the mesh: expected a GLB or VRM, which has morph targets, got another format; \
             --targets arkit makes the ARKit shapes for any mesh"
                .into(),
        ));
    }
    glb_targets(source)
}

/// Targets that move something, by name.
fn keys_by_name(targets: &[GlbTarget]) -> Vec<Key> {
    let mut keys: Vec<Key> = Vec::new();
    for (n, target) in targets.iter().enumerate() {
        if target.moved.is_empty() {
            continue;
        }
        match keys.iter_mut().find(|key| key.name == target.name) {
            Some(key) => key.binds.push((n, 1.0)),
            None => keys.push(Key {
                name: target.name.clone(),
                binds: vec![(n, 1.0)],
            }),
        }
    }
    keys
}

/// Names of targets that move nothing on any mesh.
fn empty_names(targets: &[GlbTarget]) -> Vec<String> {
    let moves = |name: &str| {
        targets
            .iter()
            .any(|target| target.name == name && !target.moved.is_empty())
    };
    let mut names: Vec<String> = Vec::new();
    for target in targets {
        if !moves(&target.name) && !names.contains(&target.name) {
            names.push(target.name.clone());
        }
    }
    names
}

/// The expressions of a VRM.
#[derive(Default)]
struct Expressions {
    keys: Vec<Key>,
    notes: Vec<String>,
}

/// The expressions of a VRM 1 or VRM 0 that move targets.
fn expressions(document: &Value, targets: &[GlbTarget]) -> Expressions {
    let extensions = &document["extensions"];
    let number = |value: &Value| value.as_u64().map(|n| n as usize);
    let place = |mesh: Option<usize>, bind: &Value| {
        let wanted = (mesh?, number(&bind["index"])?);
        targets
            .iter()
            .position(|t| (t.mesh, t.number) == wanted && !t.moved.is_empty())
    };
    let mut found = Expressions::default();
    let mut of_materials = Vec::new();
    let mut add = |name: &str, binds: Vec<(usize, f32)>, has_materials: bool| {
        if has_materials {
            of_materials.push(name.to_owned());
        }
        if !binds.is_empty() {
            let name = name.to_owned();
            found.keys.push(Key { name, binds });
        }
    };
    let list = |value: &Value| value.as_array().cloned().unwrap_or_default();
    for kind in ["preset", "custom"] {
        let expressions = extensions["VRMC_vrm"]["expressions"][kind].as_object();
        for (name, expression) in expressions.into_iter().flatten() {
            let bind = |bind: &Value| {
                let node = number(&bind["node"])?;
                let target = place(number(&document["nodes"][node]["mesh"]), bind)?;
                Some((target, bind["weight"].as_f64()? as f32))
            };
            let binds = list(&expression["morphTargetBinds"]);
            let has_materials = ["materialColorBinds", "textureTransformBinds"]
                .iter()
                .any(|kind| !list(&expression[kind]).is_empty());
            add(name, binds.iter().filter_map(bind).collect(), has_materials);
        }
    }
    for group in list(&extensions["VRM"]["blendShapeMaster"]["blendShapeGroups"]) {
        let text = |field: &str| group[field].as_str().unwrap_or_default().to_owned();
        let preset = text("presetName");
        let name = if ["", "unknown"].contains(&&*preset.to_lowercase()) {
            text("name")
        } else {
            preset
        };
        let bind = |bind: &Value| {
            let target = place(number(&bind["mesh"]), bind)?;
            Some((target, bind["weight"].as_f64()? as f32 / 100.0))
        };
        let binds = list(&group["binds"]);
        let has_materials = !list(&group["materialValues"]).is_empty();
        add(
            &name,
            binds.iter().filter_map(bind).collect(),
            has_materials,
        );
    }
    if !of_materials.is_empty() {
        found.notes.push(format!(
            "the expressions {} also change materials, which an animation of morph targets cannot",
            of_materials.join(", ")
        ));
    }
    found
}

fn nothing_to_drive(targets: &[GlbTarget], empty: &[String]) -> Error {
    let got = match (targets.len(), empty.len()) {
        (0, _) => "none".to_owned(),
        (_, 0) => {
            let names: Vec<&str> = targets.iter().take(3).map(|t| &*t.name).collect();
            format!(
                "{} with other names, such as {}",
                targets.len(),
                names.join(", ")
            )
        }
        _ => format!("{} of which {} move nothing", targets.len(), empty.len()),
    };
    Error::InvalidInput(format!(
        "targets of the mesh: expected morph targets with the names of ARKit, Oculus, VRM, MMD, Character Creator, \
         Daz or Ready Player Me, got {got}; --targets arkit makes the ARKit shapes beside them"
    ))
}

/// Vertices of the skin near the lips, ordered.
fn mouth_vertices(face: &Face) -> Vec<usize> {
    let at = |n: usize| glam::Vec3::from(face.landmarks.positions[n]);
    let reach = MOUTH_IN_WIDTHS * at(48).distance(at(54));
    let is_near = |p: [f32; 3]| (48..68).any(|n| at(n).distance(p.into()) < reach);
    let positions = face.mesh.positions.iter().enumerate();
    let near =
        positions.filter(|(v, p)| face.parts.is(*v, crate::mesh::PartRole::Skin) && is_near(**p));
    near.map(|(v, _)| v).collect()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn targets() -> Vec<GlbTarget> {
        let target = |mesh, number, name: &str, moves: bool| GlbTarget {
            mesh,
            number,
            name: name.to_owned(),
            moved: moves.then_some((0, [0.0, 0.01, 0.0])).into_iter().collect(),
        };
        vec![
            target(0, 0, "jawOpen", true),
            target(0, 1, "mouthFunnel", false),
            target(0, 2, "Fcl_A", true),
            target(1, 0, "jaw_open", true),
            target(1, 1, "jawOpen", true),
        ]
    }

    #[test]
    fn targets_of_one_name_move_together_and_empty_ones_are_none() {
        let targets = targets();
        let keys = keys_by_name(&targets);
        assert_eq!(keys[0].name, "jawOpen");
        assert_eq!(keys[0].binds, [(0, 1.0), (4, 1.0)]);
        assert_eq!(empty_names(&targets), ["mouthFunnel"]);
        assert!(keys.iter().all(|key| key.name != "mouthFunnel"));
    }

    #[test]
    fn a_shape_that_a_mesh_has_is_found_once_on_it() {
        let file_targets = targets_of_shapes(&targets());
        let places: Vec<_> = file_targets
            .iter()
            .map(|t| (t.mesh, t.number, t.shape, t.is_empty))
            .collect();
        let expected = [
            (0, 0, "jawOpen", false),
            (1, 0, "jawOpen", false),
            (0, 1, "mouthFunnel", true),
        ];
        assert_eq!(places, expected);
    }

    #[test]
    fn expressions_of_both_vrms_bind_targets_and_tell_of_materials() {
        let one = json!({
            "nodes": [{}, {"mesh": 0}],
            "extensions": {"VRMC_vrm": {"expressions": {
                "preset": {
                    "aa": {"morphTargetBinds": [
                        {"node": 1, "index": 2, "weight": 0.5}, {"node": 1, "index": 1, "weight": 1.0},
                    ]},
                    "blink": {"morphTargetBinds": [], "materialColorBinds": [{}]},
                },
                "custom": {"JawOpen": {"morphTargetBinds": [{"node": 1, "index": 0, "weight": 1.0}]}},
            }}},
        });
        let found = expressions(&one, &targets());
        let binds: Vec<_> = found
            .keys
            .iter()
            .map(|key| (&*key.name, &key.binds[..]))
            .collect();
        assert_eq!(
            binds,
            [("aa", &[(2, 0.5)][..]), ("JawOpen", &[(0, 1.0)][..])]
        );
        assert!(
            found.notes[0].contains("blink also change materials"),
            "{:?}",
            found.notes
        );
        let zero = json!({"extensions": {"VRM": {"blendShapeMaster": {"blendShapeGroups": [
            {"name": "Aah", "presetName": "a", "binds": [{"mesh": 0, "index": 2, "weight": 80.0}]},
            {"name": "JawOpen", "presetName": "unknown", "binds": [{"mesh": 0, "index": 0, "weight": 100.0}]},
        ]}}}});
        let found = expressions(&zero, &targets());
        let binds: Vec<_> = found
            .keys
            .iter()
            .map(|key| (&*key.name, &key.binds[..]))
            .collect();
        assert_eq!(
            binds,
            [("a", &[(2, 0.8)][..]), ("JawOpen", &[(0, 1.0)][..])]
        );
    }
}
