//! The roles of the parts of a mesh: skin, teeth, eyes, lashes, hair, and a caller's choices.

use std::{
    collections::{BTreeMap, HashMap},
    fmt,
    str::FromStr,
};

use serde::{Deserialize, Serialize};

use super::{GlbPart, Mesh, Parts, glb_chunks, parts::NO_PART};
use crate::{Error, Result};

/// How a part behaves when the face moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PartRole {
    /// The face itself: landmark motion is solved on it.
    Skin,
    /// Follows the lower jaw as a rigid body: lower teeth, lower gums, tongue.
    Jaw,
    /// Follows the skull: upper teeth, upper gums, glasses, hair.
    Skull,
    /// Spans both jaws, such as gums with a tongue or the mouth's lining: follows the skull at the
    /// top, the lower jaw at the bottom, and blends in between.
    Mouth,
    /// Follows the skin nearest to its roots: lashes, brows, beards.
    Nearest,
    /// An eyeball: rests and never deforms, so that its owner can turn it.
    Gaze,
    /// Not part of the face: rests.
    Still,
}

impl PartRole {
    /// Every role, in the order of their numbers in the C interface.
    pub const ALL: [PartRole; 7] = [
        PartRole::Skin,
        PartRole::Jaw,
        PartRole::Skull,
        PartRole::Mouth,
        PartRole::Nearest,
        PartRole::Gaze,
        PartRole::Still,
    ];

    /// Its name on the command line and in JSON.
    pub fn name(self) -> &'static str {
        match self {
            PartRole::Skin => "skin",
            PartRole::Jaw => "jaw",
            PartRole::Skull => "skull",
            PartRole::Mouth => "mouth",
            PartRole::Nearest => "nearest",
            PartRole::Gaze => "gaze",
            PartRole::Still => "still",
        }
    }
}

impl fmt::Display for PartRole {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for PartRole {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let named = PartRole::ALL.into_iter().find(|role| role.name() == text);
        named.ok_or_else(|| {
            let known = PartRole::ALL.map(PartRole::name).join(", ");
            Error::InvalidInput(format!("part: expected one of {known}, got {text:?}"))
        })
    }
}

/// Who chose a part's role.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RoleSource {
    /// Its shape and its place relative to the landmarks.
    Shape,
    /// The caller.
    Caller,
}

/// One connected part of a mesh.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Part {
    /// Counted from 0 in the order of the parts' first vertices, with seams sewn up.
    pub number: u32,
    /// The object of the file that has the most of its vertices; `None` if no object has any.
    pub name: Option<String>,
    /// How it behaves.
    pub role: PartRole,
    /// Who chose the role.
    pub source: RoleSource,
    /// Number of its vertices.
    pub vertices: usize,
    /// Lowest coordinates of its bounding box, in the mesh's units and axes.
    pub low: [f32; 3],
    /// Highest coordinates of its bounding box.
    pub high: [f32; 3],
}

/// The parts that a caller selects.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PartSelector {
    /// The part with this number.
    Number(u32),
    /// Every part that has most of its vertices in the object with this name.
    Name(String),
}

/// A caller's roles for parts. Where several apply to one part, the last one counts.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PartChoices {
    /// Selected parts and their roles.
    pub roles: Vec<(PartSelector, PartRole)>,
    /// The objects of the file that the mesh was read from.
    pub names: ObjectNames,
}

/// The object (`o`) of each vertex in a file, or its group (`g`) if the file has no objects.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ObjectNames {
    /// In the order of the file.
    pub names: Vec<String>,
    /// `[V]`, index into `names`; [`NO_PART`] for vertices of no object. May be empty.
    pub of_vertex: Vec<u32>,
}

impl ObjectNames {
    /// The names in a GLB: those of its nodes, or of their meshes where a node has none. `parts`: its primitives.
    ///
    /// # Errors
    /// `Mesh` for a GLB that cannot be read.
    pub(super) fn of_glb(bytes: &[u8], parts: Vec<GlbPart>) -> Result<ObjectNames> {
        let document: serde_json::Value = serde_json::from_slice(glb_chunks(bytes)?.0)
            .map_err(|e| Error::Mesh(format!("glTF: its description: {e}")))?;
        let mut out = ObjectNames {
            names: Vec::new(),
            of_vertex: vec![NO_PART; parts.last().map_or(0, |part| part.vertices.end)],
        };
        for part in parts {
            let of = |list: &str, number: usize| document[list][number]["name"].as_str();
            let Some(name) = of("nodes", part.node).or_else(|| of("meshes", part.mesh)) else {
                continue;
            };
            let known = out.names.iter().position(|known| known == name);
            let number = known.unwrap_or_else(|| {
                out.names.push(name.to_owned());
                out.names.len() - 1
            });
            out.of_vertex[part.vertices].fill(number as u32);
        }
        Ok(out)
    }

    /// Reads the names from the text of an OBJ file.
    ///
    /// A vertex belongs to the first object with a face that uses it. If a file has both objects
    /// and groups, the objects count.
    pub fn of_obj(text: &str) -> ObjectNames {
        let keyword = if text.lines().any(|line| line.starts_with("o ")) {
            "o"
        } else {
            "g"
        };
        let is_vertex = |line: &&str| line.split_whitespace().next() == Some("v");
        let mut out = ObjectNames {
            names: Vec::new(),
            of_vertex: vec![NO_PART; text.lines().filter(is_vertex).count()],
        };
        let mut known: HashMap<&str, u32> = HashMap::new();
        let (mut current, mut count) = (NO_PART, 0usize);
        for line in text.lines() {
            let (word, rest) = line
                .trim()
                .split_once(char::is_whitespace)
                .unwrap_or((line, ""));
            match word {
                "v" => count += 1,
                "f" => out.claim(rest, current, count),
                _ if word == keyword => {
                    let name = rest.trim();
                    current = *known.entry(name).or_insert_with(|| {
                        out.names.push(name.to_owned());
                        out.names.len() as u32 - 1
                    });
                }
                _ => {}
            }
        }
        out
    }

    /// Assigns the corners of a face, `1/1/1 2/2/2 …`, to an object.
    fn claim(&mut self, corners: &str, object: u32, count: usize) {
        for corner in corners.split_whitespace() {
            let number = corner.split('/').next().and_then(|n| n.parse::<i64>().ok());
            let vertex = match number {
                Some(n) if n > 0 => n as usize - 1,
                Some(n) if n < 0 && n >= -(count as i64) => (count as i64 + n) as usize,
                _ => continue,
            };
            // Skip a number beyond the vertices: reading the mesh refuses it.
            if let Some(of_vertex) = self.of_vertex.get_mut(vertex)
                && *of_vertex == NO_PART
            {
                *of_vertex = object;
            }
        }
    }

    /// The object of a vertex.
    pub(crate) fn of(&self, vertex: usize) -> Option<&str> {
        let object = self.of_vertex.get(vertex)?;
        self.names.get(*object as usize).map(String::as_str)
    }

    /// The triangles of an object as a mesh, and the numbers of its vertices in the whole one.
    ///
    /// # Errors
    /// `InvalidInput` for a name that no object has.
    pub(crate) fn object(&self, mesh: &Mesh, name: &str) -> Result<(Mesh, Vec<u32>)> {
        let number = self.names.iter().position(|known| known == name);
        let Some(number) = number.map(|number| number as u32) else {
            let expected = if self.names.is_empty() {
                "a mesh that names its objects".to_owned()
            } else {
                format!("one of {}", self.names.join(", "))
            };
            return Err(Error::InvalidInput(format!(
                "head: expected {expected}, got {name:?}"
            )));
        };
        let mut object = Mesh::default();
        let mut vertices = Vec::new();
        let mut places = vec![NO_PART; mesh.positions.len()];
        for (v, _) in (0u32..)
            .zip(&self.of_vertex)
            .filter(|(_, of)| **of == number)
        {
            if let (Some(place), Some(position)) =
                (places.get_mut(v as usize), mesh.positions.get(v as usize))
            {
                *place = vertices.len() as u32;
                vertices.push(v);
                object.positions.push(*position);
            }
        }
        let triangles = mesh.triangles.iter().map(|t| t.map(|v| places[v as usize]));
        object.triangles = triangles.filter(|t| !t.contains(&NO_PART)).collect();
        object.check()?;
        Ok((object, vertices))
    }

    /// For each part, the name of the object that has the most of its vertices.
    pub(crate) fn of_parts(&self, parts: &[Vec<u32>]) -> Vec<Option<&str>> {
        let object = |v: &u32| self.of_vertex.get(*v as usize).copied();
        parts
            .iter()
            .map(|vertices| {
                let mut counts: BTreeMap<u32, usize> = BTreeMap::new();
                for object in vertices.iter().filter_map(object) {
                    *counts.entry(object).or_default() += 1;
                }
                counts.remove(&NO_PART);
                let most = counts.values().copied().max()?;
                let (first, _) = counts.iter().find(|(_, n)| **n == most)?;
                self.names.get(*first as usize).map(String::as_str)
            })
            .collect()
    }
}

impl PartChoices {
    /// `[parts]`: the caller's role of each part.
    ///
    /// # Errors
    /// `InvalidInput` for a number or a name that no part has.
    pub(crate) fn of_parts(&self, parts: &Parts) -> Result<Vec<Option<PartRole>>> {
        let mut roles = vec![None; parts.count];
        if self.roles.is_empty() {
            return Ok(roles);
        }
        let names = self.names.of_parts(&parts.vertices());
        for (selector, role) in &self.roles {
            let chosen: Vec<usize> = match selector {
                PartSelector::Number(n) => {
                    (0..parts.count).filter(|p| p == &(*n as usize)).collect()
                }
                PartSelector::Name(name) => (0..parts.count)
                    .filter(|&p| names[p] == Some(name.as_str()))
                    .collect(),
            };
            if chosen.is_empty() {
                return Err(self.unknown(selector, parts.count));
            }
            chosen
                .into_iter()
                .for_each(|part| roles[part] = Some(*role));
        }
        Ok(roles)
    }

    fn unknown(&self, selector: &PartSelector, count: usize) -> Error {
        Error::InvalidInput(match selector {
            PartSelector::Number(n) => format!("part: expected a number below {count}, got {n}"),
            PartSelector::Name(name) if self.names.names.is_empty() => {
                format!(
                    "part: expected a number, got the name {name:?}; this mesh names no objects"
                )
            }
            PartSelector::Name(name) => {
                let known = self.names.names.join(", ");
                format!("part: expected a number or one of {known}, got {name:?}")
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TWO: &str = "o head\nv 0 0 0\nv 1 0 0\nv 0 1 0\ng inner\nf 1 2 3\no teeth low\nv 5 0 0\n\
                       v 6 0 0\nv 5 1 0\nf -3/1/1 -2 -1\nv 9 9 9\n";

    #[test]
    fn vertices_know_their_object() {
        let names = ObjectNames::of_obj(TWO);
        assert_eq!(names.names, ["head", "teeth low"]);
        assert_eq!(names.of_vertex, [0, 0, 0, 1, 1, 1, NO_PART]);
        let groups = ObjectNames::of_obj(&TWO.replace("o ", "# "));
        assert_eq!(groups.names, ["inner"]);
    }

    #[test]
    fn vertices_that_are_not_there_cost_nothing() {
        let names = ObjectNames::of_obj("v 0 0 0\no a\nf 9223372036854775807 4294967297 1\n");
        assert_eq!(
            (names.of_vertex, names.names),
            (vec![0], vec!["a".to_owned()])
        );
    }

    #[test]
    fn choices_by_name_and_number_meet_their_parts_and_the_last_one_counts() {
        let parts = Parts::of(7, &[[0, 1, 2], [3, 4, 5]]);
        let choose = |roles| PartChoices {
            roles,
            names: ObjectNames::of_obj(TWO),
        };
        let named = PartSelector::Name("teeth low".into());
        let both = vec![
            (PartSelector::Number(1), PartRole::Skull),
            (named, PartRole::Jaw),
        ];
        let roles = choose(both).of_parts(&parts).unwrap();
        assert_eq!(roles, [None, Some(PartRole::Jaw)]);
        let message = |selector| {
            let wrong = choose(vec![(selector, PartRole::Jaw)]);
            wrong.of_parts(&parts).unwrap_err().to_string()
        };
        assert!(message(PartSelector::Number(2)).contains("below 2, got 2"));
        assert!(message(PartSelector::Name("hat".into())).contains("head, teeth low, got \"hat\""));
    }

    #[test]
    fn every_role_is_read_by_its_own_name() {
        for role in PartRole::ALL {
            assert_eq!(role.name().parse::<PartRole>().unwrap(), role);
        }
        let error = "jaws".parse::<PartRole>().unwrap_err().to_string();
        assert!(error.contains("skin, jaw, skull"), "{error}");
    }
}
