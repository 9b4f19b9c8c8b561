//! Samplers, BSDFs, light choice and ray traversal as the device runs them, against densities, closed forms and the CPU
//! twins. Any device will do; seeds are fixed.

mod bsdfs;
mod device;
mod lights;
mod statistics;
mod surfaces;
mod tracing;
