//! The inputs that a network on the surface needs from a mesh, in the network's unit of length.

use ndarray::{Array1, Array2};

use super::{Csr, Operators, gradient::RIDGE};
use crate::{
    Result,
    cache::Cache,
    job::ProgressFn,
    nn::surface::{Entry, Surface},
};

impl Operators {
    /// Mass, eigenpairs and gradients for DiffusionNet, with the rows of these operators.
    ///
    /// `unit`: length of the network's unit in mesh units (1 if the network sees the mesh's own
    /// positions; 100 if it sees metres and the mesh is in centimetres).
    ///
    /// # Errors
    /// Those of [`Operators::eigenbasis`].
    pub(crate) fn surface(
        &self,
        eigenpairs: usize,
        unit: f64,
        cache: &Cache,
        progress: ProgressFn<'_>,
    ) -> Result<Surface> {
        let basis = self.eigenbasis_cached(eigenpairs, cache, progress)?;
        let gradient = self.tangent_gradient(&self.tangent_frames(), RIDGE * unit * unit);
        let (rows, count) = (self.rows(), basis.values.len());
        // The vectors are orthonormal under the scaled mass, so they grow if the areas shrink.
        let evecs: Vec<f32> = basis.vectors.iter().map(|v| (v * unit) as f32).collect();
        let evecs = Array2::from_shape_vec((rows, count), evecs).expect("rows times eigenpairs");
        Surface::new(
            self.mass
                .iter()
                .map(|m| (m / (unit * unit)) as f32)
                .collect::<Array1<f32>>(),
            basis
                .values
                .iter()
                .map(|v| (v * unit * unit) as f32)
                .collect::<Array1<f32>>(),
            evecs,
            entries(&gradient.x, unit),
            entries(&gradient.y, unit),
        )
    }
}

fn entries(matrix: &Csr, unit: f64) -> impl Iterator<Item = Entry> + '_ {
    (0..matrix.nrows()).flat_map(move |row| {
        matrix
            .row(row)
            .map(move |(column, value)| (row, column, (value * unit) as f32))
    })
}

#[cfg(test)]
mod tests {
    use super::super::{OperatorOptions, fixtures::Golden};
    use super::*;
    use crate::{
        CachePolicy,
        job::SILENT,
        mesh::Mesh,
        nn::diffusion_net::{DiffusionNet, DiffusionNetShape},
    };

    fn surface(mesh: &Mesh, k: usize, unit: f64) -> Surface {
        let ops = Operators::new(mesh, &OperatorOptions::default()).unwrap();
        assert_eq!(ops.rows(), mesh.positions.len());
        ops.surface(k, unit, &Cache::new(&CachePolicy::Off), SILENT)
            .unwrap()
    }

    /// Root mean square of the difference, relative to that of the reference.
    fn relative(got: impl Iterator<Item = f32>, expected: &[f64]) -> f64 {
        let difference: f64 = got
            .zip(expected)
            .map(|(g, e)| (f64::from(g) - e).powi(2))
            .sum();
        (difference / expected.iter().map(|e| e * e).sum::<f64>()).sqrt()
    }

    fn output(
        golden: &crate::nn::golden::Golden,
        shape: DiffusionNetShape,
        mesh: &Mesh,
        surface: &Surface,
    ) -> Vec<f32> {
        let net = DiffusionNet::load(&golden.weights(), shape).unwrap();
        let flat = mesh.positions.iter().flatten().copied().collect();
        let x = ndarray::Array3::from_shape_vec((1, mesh.positions.len(), 3), flat).unwrap();
        net.forward(&x, surface).into_iter().collect()
    }

    #[test]
    #[ignore = "needs ../shared"]
    fn a_trained_network_gives_its_reference_output_on_our_operators() {
        let golden = Golden::shared("parity/diffusion_net.safetensors");
        let mesh = golden.mesh("vertices", "faces");
        let net = crate::nn::golden::Golden::open_shared("diffusion_net");
        let shape = DiffusionNetShape {
            inputs: 3,
            outputs: 8,
            width: 128,
            blocks: 4,
        };
        let y = output(&net, shape, &mesh, &surface(&mesh, 128, 1.0));
        let error = relative(y.into_iter(), &golden.numbers("y"));
        assert!(error < 2e-2, "{error}");
    }

    #[test]
    fn a_scaled_mesh_with_its_unit_looks_the_same_to_a_network() {
        let golden = Golden::open("diffusion_net_random.safetensors");
        let mesh = golden.mesh("vertices", "faces");
        let mut large = mesh.clone();
        large
            .positions
            .iter_mut()
            .flatten()
            .for_each(|x| *x *= 128.0);
        let net = crate::nn::golden::Golden::open("diffusion_net_random");
        let shape = DiffusionNetShape {
            inputs: 3,
            outputs: 5,
            width: 32,
            blocks: 2,
        };
        // A torus has double eigenvalues. This number of pairs splits none of them.
        let k = 49;
        let one = output(&net, shape, &mesh, &surface(&mesh, k, 1.0));
        let other = output(&net, shape, &mesh, &surface(&large, k, 128.0));
        let one: Vec<f64> = one.into_iter().map(f64::from).collect();
        let error = relative(other.into_iter(), &one);
        assert!(error < 1e-3, "{error}");
    }
}
