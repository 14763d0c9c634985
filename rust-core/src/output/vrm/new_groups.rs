//! Expressions of VRM 1.0.

use serde_json::{Map, Value, json};

use super::{
    expressions::{Existing, Expression},
    skeleton::eyes_from_head,
};
use crate::{
    Error, Result,
    output::glb::{Bound, Document},
    rig::parts::GAZE_DEGREES,
};

/// The lists of an expression that say what it changes.
const BINDS: [&str; 3] = [
    "morphTargetBinds",
    "materialColorBinds",
    "textureTransformBinds",
];

/// Adds the expressions. `place`: the number of a shape among the targets. Returns the names of the
/// expressions that were replaced.
pub(super) fn add(
    avatar: &mut Document,
    (expressions, existing): (&[Expression], Existing),
    place: impl Fn(&str) -> Option<usize>,
) -> Result<Vec<String>> {
    let vrm = &mut avatar.json["extensions"]["VRMC_vrm"];
    let mut replaced = Vec::new();
    for expression in expressions {
        let kind = if expression.is_preset {
            "preset"
        } else {
            "custom"
        };
        let mut new = json!({"morphTargetBinds": binds(&avatar.bound, expression, &place)});
        if let Some(other) = expression.takes_over {
            new[other] = json!("block");
        }
        let group = object(object(vrm, "expressions")?, kind)?;
        let Some(group) = group.as_object_mut() else {
            continue;
        };
        match group.get_mut(&expression.name) {
            Some(old) if existing == Existing::Keep && old.is_object() => {
                let changes = |list: &&str| old[list].as_array().is_some_and(|all| !all.is_empty());
                if !BINDS.iter().any(changes) {
                    old[BINDS[0]] = new[BINDS[0]].take();
                }
            }
            Some(old) => {
                *old = new;
                replaced.push(expression.name.clone());
            }
            None => {
                group.insert(expression.name.clone(), new);
            }
        }
    }
    if vrm["lookAt"].is_null() && expressions.iter().any(|known| known.name == "lookUp") {
        let [up, down, inward, outward] = GAZE_DEGREES;
        let range = |most: f32| json!({"inputMaxValue": most, "outputScale": 1.0});
        vrm["lookAt"] = json!({
            "type": "expression", "offsetFromHeadBone": eyes_from_head(),
            "rangeMapHorizontalInner": range(inward), "rangeMapHorizontalOuter": range(outward),
            "rangeMapVerticalUp": range(up), "rangeMapVerticalDown": range(down),
        });
    }
    Ok(replaced)
}

/// Binds an expression to its targets on all meshes.
fn binds(
    bounds: &[Bound],
    expression: &Expression,
    place: impl Fn(&str) -> Option<usize>,
) -> Vec<Value> {
    let mut binds = Vec::new();
    for (shape, weight) in &expression.parts {
        for bound in bounds {
            if let Some(index) = place(shape).and_then(|k| bound.targets.get(&k)) {
                binds.push(json!({"node": bound.node, "index": index, "weight": weight}));
            }
        }
    }
    binds
}

/// The object `name` within another one. Creates it if it is missing.
fn object<'a>(of: &'a mut Value, name: &str) -> Result<&'a mut Value> {
    let wrong = || Error::InvalidInput(format!("VRMC_vrm: expected an object of {name}"));
    let inner = of.as_object_mut().ok_or_else(wrong)?;
    let inner = inner
        .entry(name)
        .or_insert_with(|| Value::Object(Map::new()));
    if inner.is_object() {
        Ok(inner)
    } else {
        Err(wrong())
    }
}
