//! Settings of engines, faces, shapes and streams, by name.

use std::path::PathBuf;

use anyface::{CachePolicy, EngineOptions, Result, rig::ShapeSource, systems::NamedValue};

use crate::{face_request::FaceRequest, numbers::whole};

/// What a request sets beside a performance.
#[derive(Default)]
pub(crate) struct Options {
    pub(crate) engine: EngineOptions,
    pub(crate) face: FaceRequest,
    by_field: bool,
    in_betweens: bool,
    pub(crate) look_ahead_s: Option<f64>,
    pub(crate) hears_all: bool,
}

impl Options {
    pub(crate) fn shape_source(&self) -> ShapeSource {
        if self.by_field {
            let in_betweens = self.in_betweens;
            ShapeSource::Field { in_betweens }
        } else {
            ShapeSource::Network
        }
    }
}

/// A setting that is neither a field nor a control of a performance.
pub(crate) struct NamedOption {
    pub(crate) name: &'static str,
    pub(crate) set: fn(&mut Options, &NamedValue<'_>) -> Result<()>,
}

/// The setting of this name.
pub(crate) fn find(name: &str) -> Option<&'static NamedOption> {
    OPTIONS.iter().find(|option| option.name == name)
}

/// All of them, in the order of their functions in the header.
pub(crate) static OPTIONS: &[NamedOption] = &[
    NamedOption {
        name: "system",
        set: |options, value| {
            options.engine.system = value.text()?.map(str::to_owned);
            Ok(())
        },
    },
    NamedOption {
        name: "weights_dir",
        set: |options, value| {
            options.engine.models = value.text()?.map(PathBuf::from);
            Ok(())
        },
    },
    NamedOption {
        name: "speech_dir",
        set: |options, value| {
            options.engine.speech = value.text()?.map(PathBuf::from);
            Ok(())
        },
    },
    NamedOption {
        name: "cache",
        set: |options, value| {
            options.engine.cache = match value.text()? {
                None => CachePolicy::UserFolder,
                Some("off") => CachePolicy::Off,
                Some(folder) => CachePolicy::Folder(folder.into()),
            };
            Ok(())
        },
    },
    NamedOption {
        name: "threads",
        set: |options, value| {
            let threads = whole(value, value.number()?)?;
            options.engine.threads = (threads > 0).then_some(threads as usize);
            Ok(())
        },
    },
    NamedOption {
        name: "forward",
        set: |options, value| options.face.set_forward(value),
    },
    NamedOption {
        name: "up",
        set: |options, value| options.face.set_up(value),
    },
    NamedOption {
        name: "landmarks",
        set: |options, value| options.face.set_landmarks(value),
    },
    NamedOption {
        name: "landmark_vertices",
        set: |options, value| options.face.set_landmark_vertices(value),
    },
    NamedOption {
        name: "fixed_landmarks",
        set: |options, value| options.face.set_fixed_landmarks(value),
    },
    NamedOption {
        name: "part_roles",
        set: |options, value| options.face.set_part_roles(value),
    },
    NamedOption {
        name: "object_of_vertex",
        set: |options, value| options.face.set_object_of_vertex(value),
    },
    NamedOption {
        name: "object_roles",
        set: |options, value| options.face.set_object_roles(value),
    },
    NamedOption {
        name: "by_field",
        set: |options, value| {
            options.by_field = flag(value)?;
            Ok(())
        },
    },
    NamedOption {
        name: "in_betweens",
        set: |options, value| {
            options.in_betweens = flag(value)?;
            Ok(())
        },
    },
    NamedOption {
        name: "look_ahead_s",
        set: |options, value| {
            options.look_ahead_s = Some(value.number()?);
            Ok(())
        },
    },
    NamedOption {
        name: "hear_all",
        set: |options, value| {
            options.hears_all = flag(value)?;
            Ok(())
        },
    },
];

fn flag(value: &NamedValue<'_>) -> Result<bool> {
    match value.number()? {
        0.0 => Ok(false),
        1.0 => Ok(true),
        _ => value.refuse("0 or 1"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyface::systems::{FIELDS, FieldValue, SYSTEMS};

    fn with<'a>(name: &'a str, value: FieldValue<'a>) -> Result<Options> {
        let mut options = Options::default();
        (find(name).unwrap().set)(&mut options, &NamedValue { name, value })?;
        Ok(options)
    }

    #[test]
    fn names_are_unique_among_all_that_a_request_takes() {
        let controls = SYSTEMS.iter().flat_map(|system| system.controls());
        let mut names: Vec<&str> = controls.map(|control| control.name).collect();
        names.sort_unstable();
        names.dedup();
        names.extend(FIELDS.iter().map(|field| field.name));
        names.extend(OPTIONS.iter().map(|option| option.name));
        let count = names.len();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), count);
    }

    #[test]
    fn an_engine_is_set_by_name() {
        let text = |name, text| with(name, FieldValue::Text(text)).unwrap().engine;
        assert_eq!(text("system", "emoface").system.as_deref(), Some("emoface"));
        assert_eq!(text("system", ""), EngineOptions::default());
        assert_eq!(text("cache", "off").cache, CachePolicy::Off);
        assert_eq!(text("cache", "x").cache, CachePolicy::Folder("x".into()));
        assert_eq!(text("cache", "").cache, CachePolicy::UserFolder);
        let threads = |count| with("threads", FieldValue::Number(count));
        assert_eq!(threads(0.0).unwrap().engine.threads, None);
        assert_eq!(threads(3.0).unwrap().engine.threads, Some(3));
        assert!(threads(-1.0).is_err() && threads(0.5).is_err() && threads(f64::NAN).is_err());
    }

    #[test]
    fn shapes_come_from_the_network_or_a_field() {
        let source = |name| with(name, FieldValue::Number(1.0)).unwrap().shape_source();
        assert_eq!(source("in_betweens"), ShapeSource::Network);
        let in_betweens = false;
        assert_eq!(source("by_field"), ShapeSource::Field { in_betweens });
        assert!(with("by_field", FieldValue::Number(2.0)).is_err());
    }
}
