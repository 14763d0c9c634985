//! Expressions of VRM 0, which it calls blend shape groups.

use serde_json::{Value, json};

use super::expressions::{Existing, Expression, perfect_sync};
use crate::{Error, Result, output::glb::Document};

/// VRM 0's preset name for a group that is none of its presets.
const OWN: &str = "unknown";

/// Adds the expressions. `place`: the number of a shape among the targets. Returns the names of the
/// groups that were replaced.
pub(super) fn add(
    avatar: &mut Document,
    (expressions, existing): (&[Expression], Existing),
    place: impl Fn(&str) -> Option<usize>,
) -> Result<Vec<String>> {
    let master = &mut avatar.json["extensions"]["VRM"]["blendShapeMaster"];
    if master.is_null() {
        *master = json!({});
    }
    let wrong = || Error::InvalidInput("VRM: expected a list of blendShapeGroups".into());
    let groups = master.as_object_mut().ok_or_else(wrong)?;
    let groups = groups
        .entry("blendShapeGroups")
        .or_insert_with(|| json!([]));
    let groups = groups.as_array_mut().ok_or_else(wrong)?;
    let mut replaced = Vec::new();
    for expression in expressions {
        let mut binds = Vec::new();
        for (shape, weight) in &expression.parts {
            for bound in &avatar.bound {
                if let Some(index) = place(shape).and_then(|k| bound.targets.get(&k)) {
                    binds.push(
                        json!({"mesh": bound.mesh, "index": index, "weight": 100.0 * weight}),
                    );
                }
            }
        }
        let preset = expression.old_preset.unwrap_or(OWN);
        let new = json!({
            "name": perfect_sync(&expression.name), "presetName": preset, "binds": binds,
            "materialValues": [], "isBinary": false,
        });
        match groups.iter_mut().find(|group| is_same(group, &new)) {
            Some(group) if existing == Existing::Keep => {
                let changes =
                    |list: &&str| group[list].as_array().is_some_and(|all| !all.is_empty());
                if !["binds", "materialValues"].iter().any(changes) {
                    group["binds"] = new["binds"].clone();
                }
            }
            Some(group) => {
                replaced.push(group["name"].as_str().unwrap_or(preset).to_owned());
                *group = new;
            }
            None => groups.push(new),
        }
    }
    Ok(replaced)
}

/// Whether both are the same preset, or have the same name and are no preset.
fn is_same(group: &Value, new: &Value) -> bool {
    let preset = |of: &Value| of["presetName"].as_str().unwrap_or(OWN).to_lowercase();
    let name = |of: &Value| of["name"].as_str().unwrap_or_default().to_lowercase();
    if preset(new) == OWN {
        preset(group) == OWN && name(group) == name(new)
    } else {
        preset(group) == preset(new)
    }
}
