//! Which head of a file with several is the face.

use std::collections::BTreeMap;

use super::{Face, box3::Box3};

/// The tip of the nose.
const NOSE: usize = 30;
/// An object is as large as the head if each side of their boxes is that much alike. Shoes are as wide as a head, but
/// not as high.
const LEAST_ALIKE: f32 = 0.7;

impl Face {
    /// The name of the object that has the face, if the mesh names its objects.
    pub fn head(&self) -> Option<&str> {
        let names = &self.options.parts.names;
        names.of(self.landmarks.vertices[NOSE] as usize)
    }

    /// Objects that may be heads too: those beside the one with the face that are as large as it.
    pub fn other_heads(&self) -> Vec<&str> {
        let Some(head) = self.head() else {
            return Vec::new();
        };
        let names = &self.options.parts.names;
        let mut places: BTreeMap<&str, Vec<[f32; 3]>> = BTreeMap::new();
        for (v, place) in self.mesh.positions.iter().enumerate() {
            if let Some(name) = names.of(v) {
                places.entry(name).or_default().push(*place);
            }
        }
        let of = |places: Vec<[f32; 3]>| Box3::of(places.into_iter());
        let face = of(places.remove(head).unwrap_or_default());
        let others = places.into_iter().filter(|(_, places)| {
            let other = of(places.clone());
            let mut alike = face.extents().into_iter().zip(other.extents());
            let is_alike = |(a, b): (f32, f32)| a.min(b) >= LEAST_ALIKE * a.max(b);
            alike.all(is_alike) && !face.meets(&other)
        });
        others.map(|(name, _)| name).collect()
    }
}

#[cfg(test)]
mod tests {
    use crate::{
        CachePolicy, Engine, EngineOptions,
        face::FaceOptions,
        job::SILENT,
        mesh::{LandmarkSource, NamedMesh, ObjectNames, PartChoices},
    };

    /// The skin of the default head twice, half a metre apart.
    fn two_heads() -> NamedMesh {
        let path = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../weights/shared/default_head/head.obj"
        );
        let NamedMesh { mut mesh, names } = NamedMesh::read(path).unwrap();
        let count = names.of_vertex.iter().filter(|of| **of == 0).count() as u32;
        assert_eq!(names.names[0], "skin");
        mesh.positions.truncate(count as usize);
        mesh.triangles.retain(|t| t.iter().all(|v| *v < count));
        let second = mesh.positions.clone().into_iter();
        mesh.positions
            .extend(second.map(|[x, y, z]| [x + 0.5, y, z]));
        let second = mesh.triangles.clone().into_iter();
        mesh.triangles.extend(second.map(|t| t.map(|v| v + count)));
        let names = ObjectNames {
            names: vec!["Ann".into(), "Ben".into()],
            of_vertex: (0..2 * count).map(|v| v / count).collect(),
        };
        NamedMesh { mesh, names }
    }

    #[test]
    fn the_head_with_a_name_is_the_face_and_the_other_is_named() {
        let NamedMesh { mesh, names } = two_heads();
        let engine = Engine::new(EngineOptions {
            cache: CachePolicy::Off,
            ..EngineOptions::default()
        })
        .unwrap();
        let find = |head: &str| {
            let options = FaceOptions {
                head: Some(head.to_owned()),
                parts: PartChoices {
                    names: names.clone(),
                    ..PartChoices::default()
                },
                ..FaceOptions::default()
            };
            engine.find(&mesh, &options, SILENT)
        };
        let [ann, ben] = ["Ann", "Ben"].map(|name| find(name).unwrap());
        assert_eq!((ann.head(), ann.other_heads()), (Some("Ann"), vec!["Ben"]));
        assert_eq!((ben.head(), ben.other_heads()), (Some("Ben"), vec!["Ann"]));
        let count = mesh.positions.len() as u32 / 2;
        for n in 0..68 {
            assert_eq!(ann.landmarks.vertices[n] + count, ben.landmarks.vertices[n]);
            let (a, b) = (ann.landmarks.positions[n], ben.landmarks.positions[n]);
            assert!(
                (a[0] + 0.5 - b[0]).abs() < 1e-4,
                "landmark {n}: {a:?} {b:?}"
            );
        }
        let error = find("Cid").err().unwrap().to_string();
        assert!(
            error.contains("expected one of Ann, Ben, got \"Cid\""),
            "{error}"
        );
        let known = FaceOptions {
            landmarks: Some(LandmarkSource::from(&ben.landmarks)),
            ..FaceOptions::default()
        };
        assert_eq!(engine.find(&mesh, &known, SILENT).unwrap().head(), None);
    }
}
