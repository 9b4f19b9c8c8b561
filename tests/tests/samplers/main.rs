//! Samplers, BSDFs, light sampling and ray traversal on the device, against densities, closed forms and the CPU twins.
//! Any device; seeds are fixed.

mod bsdfs;
mod device;
mod lights;
mod statistics;
mod surfaces;
mod tracing;
