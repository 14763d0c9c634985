//! The template whose vertices the branches move.

use super::EmoFaceConfig;
use crate::{Error, Result, mesh::Mesh, models::Weights, motion::Template};

/// The template of a model; `None` if the model has no triangles.
///
/// # Errors
/// `Weights` if an array is missing, has another shape, or names vertices that do not exist, or if
/// two landmarks lie at the same place.
pub fn read_template(weights: &Weights, config: &EmoFaceConfig) -> Result<Option<Template>> {
    let EmoFaceConfig {
        vertices,
        triangles,
        ..
    } = *config;
    if triangles == 0 {
        return Ok(None);
    }
    let corner = |x: f32| {
        if (0.0..vertices as f32).contains(&x) {
            Ok(x as u32)
        } else {
            Err(Error::Weights(format!(
                "emoface: template: expected corners below {vertices}, got {x}"
            )))
        }
    };
    let corners = weights.values("triangles", &[triangles, 3])?.into_iter();
    let corners = corners.map(corner).collect::<Result<Vec<u32>>>()?;
    let positions = weights.values("vertices", &[vertices, 3])?;
    let template = Template {
        mesh: Mesh {
            positions: positions.as_chunks::<3>().0.to_vec(),
            triangles: corners.as_chunks::<3>().0.to_vec(),
        },
        landmarks: std::array::from_fn(|n| config.landmarks[n]),
    };
    let places = template.landmark_positions();
    let mut pairs = (0..places.len()).flat_map(|n| (0..n).map(move |other| (other, n)));
    match pairs.find(|&(one, other)| places[one] == places[other]) {
        Some((one, other)) => Err(Error::Weights(format!(
            "emoface: template: expected landmarks at 68 places, {one} is {other}"
        ))),
        None => Ok(Some(template)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::systems::emoface::MODEL;

    #[test]
    fn the_built_in_template_is_a_face_and_others_are_refused() {
        let files = MODEL.open(None).unwrap();
        let weights = Weights::from_bytes(&files.weights).unwrap();
        let mut config = EmoFaceConfig::from_json(&files.config).unwrap();
        let template = read_template(&weights, &config).unwrap().unwrap();
        assert_eq!(template.mesh.positions.len(), config.vertices);
        // The chin lies below and behind the tip of the nose.
        let places = template.landmark_positions();
        assert!(places[8][1] < places[30][1] - 0.03 && places[30][2] > places[8][2]);
        let triangles = std::mem::replace(&mut config.triangles, 0);
        assert_eq!(read_template(&weights, &config).unwrap(), None);
        config.triangles = triangles;
        config.landmarks[40] = config.landmarks[3];
        let refused = read_template(&weights, &config).unwrap_err().to_string();
        assert!(refused.contains("68 places, 3 is 40"), "{refused}");
    }
}
