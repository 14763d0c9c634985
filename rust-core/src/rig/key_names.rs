//! The names of morph targets in the tools that avatars come from, and the shape that each shows.
//!
//! A list for each tool lies in `key_names/*.json`, the same as in the Blender add-on. It maps each
//! of our shapes to the names that stand for it, the best one first. A name stands alone or with
//! the value that its key has at weight 1 of the shape. "a + b" are keys that move together.
//! Twin of `blender-addon/core/key_names.py` and of `match` in `shapes.py` there.

use std::{
    collections::{BTreeMap, BTreeSet, HashMap},
    sync::LazyLock,
};

use serde::Deserialize;

use super::{ARKIT, VISEMES};

/// Names shorter than this match only a whole name, not the end of a longer one.
const SHORT: usize = 4;
/// A list that names fewer keys than this fits by coincidence, unless it says otherwise.
const FEWEST: usize = 3;

/// A shape and a key that shows it: at weight 1 of the shape the key stands at `factor`.
#[derive(Debug, Clone, PartialEq)]
pub struct KeyPair {
    /// One of [`ARKIT`] or [`VISEMES`].
    pub shape: String,
    /// The name of the key.
    pub key: String,
    /// Several pairs of one key add up.
    pub factor: f32,
}

impl KeyPair {
    fn is_of_mouth(&self) -> bool {
        !["eye", "brow"]
            .iter()
            .any(|stem| self.shape.starts_with(stem))
    }
}

/// A list of names as its file holds it.
#[derive(Deserialize)]
struct KeyList {
    label: String,
    #[serde(default = "fewest")]
    fewest: usize,
    keys: BTreeMap<String, Vec<KeyName>>,
}

fn fewest() -> usize {
    FEWEST
}

#[derive(Deserialize)]
#[serde(untagged)]
enum KeyName {
    Full(String),
    Share(String, f32),
}

static LISTS: LazyLock<Vec<KeyList>> = LazyLock::new(|| {
    [
        include_str!("key_names/cc4.json"),
        include_str!("key_names/daz.json"),
        include_str!("key_names/fuse.json"),
        include_str!("key_names/metahuman.json"),
        include_str!("key_names/mmd.json"),
        include_str!("key_names/ready_player_me.json"),
        include_str!("key_names/rhubarb.json"),
        include_str!("key_names/vrm.json"),
    ]
    .map(|text| serde_json::from_str(text).expect("a list of names, which a test reads"))
    .into()
});

/// The pairs of the list that names the most `keys`, and the list's name. `None` if no list fits.
///
/// Where that list shows no shape that opens the jaw, visemes stand in. Where it shows neither eyes
/// nor brows, other lists name them.
pub fn shown_shapes(keys: &[&str]) -> Option<(String, Vec<KeyPair>)> {
    let lists = fitting_lists(keys);
    let count = |pairs: &[KeyPair]| pairs.iter().map(|p| &p.key).collect::<BTreeSet<_>>().len();
    // The first of several equal lists counts.
    let best = (0..lists.len()).rev().max_by_key(|&k| count(&lists[k].1))?;
    let (label, mut pairs) = lists[best].clone();
    let shows = |pairs: &[KeyPair], shape: &str| pairs.iter().any(|pair| pair.shape == shape);
    if label == "ARKit" && !shows(&pairs, "jawOpen") {
        pairs.extend(visemes(keys));
    }
    for (_, others) in &lists {
        let shown: BTreeSet<String> = pairs.iter().map(|pair| pair.shape.clone()).collect();
        let of_eyes = others.iter().filter(|pair| !pair.is_of_mouth());
        pairs.extend(of_eyes.filter(|pair| !shown.contains(&pair.shape)).cloned());
    }
    Some((label, pairs))
}

/// Every list that fits, with its pairs: ARKit, Oculus, then the tools.
fn fitting_lists(keys: &[&str]) -> Vec<(String, Vec<KeyPair>)> {
    let mut lists = vec![
        ("ARKit".to_owned(), arkit(keys)),
        ("Oculus".to_owned(), visemes(keys)),
    ];
    let spellings = spellings(keys);
    for list in LISTS.iter() {
        let pairs = list.pairs(&spellings);
        let named: BTreeSet<&str> = pairs.iter().map(|pair| &*pair.key).collect();
        if named.len() >= list.fewest {
            lists.push((list.label.clone(), pairs));
        }
    }
    lists.retain(|(_, pairs)| !pairs.is_empty());
    lists
}

impl KeyList {
    fn pairs(&self, spellings: &HashMap<String, String>) -> Vec<KeyPair> {
        let of_shape = |(shape, names): (&String, &Vec<KeyName>)| {
            let fitting = names.iter().map(|name| {
                let (text, factor) = match name {
                    KeyName::Full(text) => (text, 1.0),
                    KeyName::Share(text, factor) => (text, *factor),
                };
                let known = text
                    .split(" + ")
                    .filter_map(|part| spellings.get(&plain(part)));
                let pair = |key: &String| KeyPair {
                    shape: shape.clone(),
                    key: key.clone(),
                    factor,
                };
                known.map(pair).collect::<Vec<_>>()
            });
            fitting.into_iter().find(|pairs| !pairs.is_empty())
        };
        self.keys.iter().filter_map(of_shape).flatten().collect()
    }
}

fn arkit(keys: &[&str]) -> Vec<KeyPair> {
    by_shape(keys, &ARKIT)
}

fn visemes(keys: &[&str]) -> Vec<KeyPair> {
    by_shape(keys, &VISEMES)
}

/// A pair for each of `shapes` that a key is named after. The first key counts.
fn by_shape(keys: &[&str], shapes: &[&str]) -> Vec<KeyPair> {
    let pair = |shape: &&str| {
        let key = keys.iter().find(|key| shape_of(key) == Some(*shape))?;
        Some(KeyPair {
            shape: (*shape).to_owned(),
            key: (*key).to_owned(),
            factor: 1.0,
        })
    };
    shapes.iter().filter_map(pair).collect()
}

/// The shape of [`ARKIT`] or [`VISEMES`] that a key is named after.
///
/// Case, separators and anything before the name are ignored. `_L` and `_R` stand for Left and
/// Right, on either end.
pub fn shape_of(key: &str) -> Option<&'static str> {
    ends(key)
        .iter()
        .find_map(|text| SPELLINGS.get(text).copied())
}

static SPELLINGS: LazyLock<HashMap<String, &'static str>> = LazyLock::new(|| {
    let mut known = HashMap::new();
    for name in ARKIT {
        let lower = name.to_lowercase();
        for side in ["left", "right"] {
            if let Some(stem) = lower.strip_suffix(side)
                && !["jaw", "mouth"].contains(&stem)
            {
                let letter = &side[..1];
                known.insert(format!("{stem}{letter}"), name);
                known.insert(format!("{letter}{stem}"), name);
                known.insert(format!("{side}{stem}"), name);
            }
        }
        known.insert(lower, name);
    }
    for name in VISEMES {
        let sound = name.trim_start_matches("viseme_").to_lowercase();
        // VRChat spells three vowels in another way.
        let other = match &*sound {
            "i" => "ih",
            "o" => "oh",
            "u" => "ou",
            same => same,
        };
        for text in [&*sound, other] {
            for stem in ["viseme", "v", "vis"] {
                known.insert(format!("{stem}{text}"), name);
            }
        }
    }
    known
});

/// A name and its ends after each separator, in lower case and without separators.
fn ends(key: &str) -> Vec<String> {
    let tokens = key.split(|c: char| !c.is_ascii_alphanumeric());
    let tokens: Vec<String> = tokens
        .filter(|token| !token.is_empty())
        .map(str::to_ascii_lowercase)
        .collect();
    (0..tokens.len())
        .map(|first| tokens[first..].concat())
        .collect()
}

/// Keys by the texts that stand for them: the whole name, or its end after a separator.
fn spellings(keys: &[&str]) -> HashMap<String, String> {
    let mut known = HashMap::new();
    for key in keys {
        known.entry(plain(key)).or_insert_with(|| (*key).to_owned());
    }
    for key in keys {
        for text in ends(key).into_iter().skip(1) {
            if text.len() >= SHORT {
                known.entry(text).or_insert_with(|| (*key).to_owned());
            }
        }
    }
    known
}

/// A name in lower case and without separators.
fn plain(name: &str) -> String {
    let letters = name.chars().flat_map(char::to_lowercase);
    letters.filter(|c| c.is_alphanumeric()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(keys: &[&str]) -> (String, Vec<(String, String, f32)>) {
        let (label, pairs) = shown_shapes(keys).unwrap();
        let pairs = pairs.into_iter().map(|p| (p.shape, p.key, p.factor));
        (label, pairs.collect())
    }

    #[test]
    fn every_list_names_shapes_that_there_are() {
        for list in LISTS.iter() {
            for shape in list.keys.keys() {
                let known = ARKIT.contains(&&**shape) || VISEMES.contains(&&**shape);
                assert!(known, "{}: {shape}", list.label);
            }
        }
    }

    #[test]
    fn the_lists_are_those_of_the_add_on() {
        let own = concat!(env!("CARGO_MANIFEST_DIR"), "/src/rig/key_names");
        let other = concat!(env!("CARGO_MANIFEST_DIR"), "/../blender-addon/key_names");
        let read = |folder: &str| {
            let files = std::fs::read_dir(folder).unwrap().map(|file| {
                let file = file.unwrap();
                (
                    file.file_name(),
                    std::fs::read_to_string(file.path()).unwrap(),
                )
            });
            files.collect::<BTreeMap<_, _>>()
        };
        assert_eq!(read(own).len(), LISTS.len());
        assert!(read(own) == read(other), "the two folders differ");
    }

    #[test]
    fn names_of_arkit_are_found_in_every_spelling() {
        for (key, shape) in [
            ("jawOpen", Some("jawOpen")),
            ("Head.eye_Blink_L", Some("eyeBlinkLeft")),
            ("MouthSmileRight", Some("mouthSmileRight")),
            ("l_browDown", Some("browDownLeft")),
            ("mouthLeft", Some("mouthLeft")),
            ("mouthL", None),
            ("vrc.v_ou", Some("viseme_U")),
            ("viseme_PP", Some("viseme_PP")),
            ("Smile", None),
        ] {
            assert_eq!(shape_of(key), shape, "{key}");
        }
    }

    #[test]
    fn the_list_that_names_most_counts() {
        let (label, pairs) = shown(&["あ", "い", "う", "え", "お", "まばたき", "照れ"]);
        assert_eq!(label, "MMD");
        let blink = |side: &str| (format!("eyeBlink{side}"), "まばたき".to_owned(), 0.5);
        assert!(pairs.contains(&blink("Left")) && pairs.contains(&blink("Right")));
        assert!(pairs.contains(&("viseme_aa".into(), "あ".into(), 1.0)));
        assert_eq!(shown(&["mouthOpen", "mouthSmile"]).0, "Ready Player Me");
        assert_eq!(shown(&["viseme_aa", "viseme_PP", "mouthOpen"]).0, "Oculus");
        assert!(shown_shapes(&["Key 1", "thin"]).is_none());
    }

    #[test]
    fn visemes_stand_in_for_a_jaw_that_arkit_lacks_and_other_lists_for_eyes() {
        let keys = [
            "mouthPucker",
            "mouthFunnel",
            "browInnerUp",
            "viseme_aa",
            "viseme_O",
        ];
        let (label, pairs) = shown(&keys);
        assert_eq!(label, "ARKit");
        assert!(pairs.contains(&("viseme_aa".into(), "viseme_aa".into(), 1.0)));
        let (label, pairs) = shown(&["viseme_aa", "viseme_O", "viseme_PP", "eyesClosed"]);
        assert_eq!(label, "Oculus");
        assert!(pairs.contains(&("eyeBlinkLeft".into(), "eyesClosed".into(), 0.5)));
    }
}
