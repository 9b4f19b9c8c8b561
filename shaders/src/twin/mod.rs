//! CPU twins of shader functions: the same names under the same paths as in `lib/`, in the same `f32`.
//!
//! They are what a sampler's histogram is compared with, and what a kernel's results are compared with on small inputs.
//! A twin is written for reading; nothing in the product runs it.

pub mod bsdf;
pub mod core;
pub mod scene;
