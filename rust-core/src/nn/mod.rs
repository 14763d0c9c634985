//! Layers that systems share: plain `f32` arrays in, plain `f32` arrays out.
//!
//! A sequence is `[T, C]`, row-major. Layers take their weights from [`Weights`](crate::models::Weights) under the names
//! that PyTorch gives them, so a checkpoint loads without a renaming table. Work is cut into
//! pieces whose size depends on the data alone, never on the number of threads, so that a result
//! is the same bit for bit on one thread and on many.
//!
//! Why not candle's layers: on a Xeon with AVX-512, five seconds of speech through an encoder of
//! HuBERT-base's size take 1.1 s of processor time with these and 3.2 s with candle's (0.11), whose
//! GELU and convolutions are plain loops; the results agree within 4e-6. candle reads checkpoints.

pub mod ada_ln;
pub mod attention;
pub mod biased_attention;
pub mod conv;
pub mod conv2d;
pub mod diffusion_net;
pub mod elementwise;
pub mod film;
pub(crate) mod finite;
#[cfg(test)]
pub(crate) mod golden;
pub mod graph_conv;
pub mod linear;
pub mod matrix;
pub mod mlp;
pub mod norm;
pub mod panels;
pub mod rotary;
pub mod spiral_conv;
pub mod surface;
pub mod timestep;
pub mod transformer;
pub mod vectors;
