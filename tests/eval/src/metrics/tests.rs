use ndarray::Array3;
use safetensors::SafeTensors;

use super::*;

struct Reference {
    prediction: Array3<f64>,
    truth: Array3<f64>,
    lips: Vec<usize>,
    upper: Vec<usize>,
    values: serde_json::Value,
}

fn reference() -> Reference {
    let path = format!(
        "{}/../goldens/metrics.safetensors",
        env!("CARGO_MANIFEST_DIR")
    );
    let bytes = std::fs::read(path).unwrap();
    let file = SafeTensors::deserialize(&bytes).unwrap();
    let (_, metadata) = SafeTensors::read_metadata(&bytes).unwrap();
    let values = &metadata.metadata().as_ref().unwrap()["values"];
    let words = |name: &str| -> Vec<[u8; 8]> {
        let view = file.tensor(name).unwrap();
        view.data()
            .chunks_exact(8)
            .map(|b| b.try_into().unwrap())
            .collect()
    };
    let clip = |name: &str| {
        let shape = file.tensor(name).unwrap().shape().to_vec();
        let values = words(name).into_iter().map(f64::from_le_bytes).collect();
        Array3::from_shape_vec((shape[0], shape[1], shape[2]), values).unwrap()
    };
    let region = |name: &str| {
        let words = words(name).into_iter();
        words.map(|b| i64::from_le_bytes(b) as usize).collect()
    };
    Reference {
        prediction: clip("prediction"),
        truth: clip("truth"),
        lips: region("lips"),
        upper: region("upper"),
        values: serde_json::from_str(values).unwrap(),
    }
}

#[test]
fn all_match_public_implementations() {
    let r = reference();
    let (p, g) = (r.prediction.view(), r.truth.view());
    let near = |name: &str, got: f64| {
        let expected = r.values[name].as_f64().unwrap();
        assert!(
            (got - expected).abs() < 1e-6 * expected.abs(),
            "{name}: {got}, expected {expected}"
        );
    };
    near("LVE", lip_vertex_error(p, g, &r.lips).unwrap());
    near("MVE", mean_vertex_error(p, g).unwrap());
    near(
        "FDD_signed",
        face_dynamics_deviation(p, g, &r.upper).unwrap(),
    );
    near("delta_Cd", delta_cd(p, g).unwrap());
}

#[test]
fn a_perfect_prediction_has_no_error() {
    let r = reference();
    let g = r.truth.view();
    assert_eq!(lip_vertex_error(g, g, &r.lips).unwrap(), 0.0);
    assert_eq!(mean_vertex_error(g, g).unwrap(), 0.0);
    assert_eq!(face_dynamics_deviation(g, g, &r.upper).unwrap(), 0.0);
    assert!(delta_cd(g, g).unwrap().abs() < 1e-12);
}

#[test]
fn a_still_face_is_at_right_angles_to_motion() {
    let r = reference();
    let still = Array3::zeros(r.truth.dim());
    assert_eq!(delta_cd(still.view(), r.truth.view()).unwrap(), 1.0);
}

#[test]
fn lip_error_sees_only_its_region() {
    let truth = Array3::<f64>::zeros((2, 4, 3));
    let mut prediction = truth.clone();
    prediction[[0, 1, 2]] = 3.0;
    prediction[[1, 3, 0]] = 9.0;
    let (p, g) = (prediction.view(), truth.view());
    assert_eq!(lip_vertex_error(p, g, &[0, 1]).unwrap(), 4.5);
    assert_eq!(lip_vertex_error(p, g, &[3]).unwrap(), 40.5);
}

#[test]
fn shapes_and_regions_are_checked() {
    let (a, b) = (Array3::zeros((3, 4, 3)), Array3::zeros((3, 5, 3)));
    assert!(mean_vertex_error(a.view(), b.view()).is_err());
    assert!(lip_vertex_error(a.view(), a.view(), &[4]).is_err());
    assert!(
        delta_cd(
            a.slice_axis(ndarray::Axis(0), (..1).into()),
            a.slice_axis(ndarray::Axis(0), (..1).into())
        )
        .is_err()
    );
    assert!(lip_gap(a.view()).is_err());
}

#[test]
fn the_gap_is_the_distance_of_the_inner_lips() {
    let mut clip = Array3::zeros((2, 68, 3));
    clip[[1, 66, 1]] = -0.03;
    clip[[1, 62, 2]] = 0.04;
    assert_eq!(lip_gap(clip.view()).unwrap(), [0.0, 0.05]);
}

#[test]
fn the_width_is_the_distance_of_the_corners() {
    let mut clip = Array3::zeros((2, 68, 3));
    clip[[1, 48, 0]] = -0.03;
    clip[[1, 54, 2]] = 0.04;
    assert_eq!(mouth_width(clip.view()).unwrap(), [0.0, 0.05]);
}
