//! CPU twins of shader functions: the same names under the same paths as in `lib/`, in the same `f32`.
//!
//! Tests compare histograms of samplers and results of kernels on small inputs with them. A twin is written for
//! clarity; the program does not use it.

pub mod bsdf;
pub mod core;
pub mod scene;
