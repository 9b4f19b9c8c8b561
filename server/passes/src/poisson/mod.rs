//! Screened Poisson reconstruction over a picture: from a noisy picture and noisy differences between its pixels to the
//! picture that fits both best.
//!
//! [`PoissonSolver`] minimises `sum_p a_p |u_p - V_p|^2 + sum_pq b_pq |u_q - u_p - D_pq|^2` over the edges to the right
//! and downwards, each colour channel for itself, in `f32` and in a fixed order of sums. In, by pixel:
//!
//! | buffer | element |
//! |---|---|
//! | value | V, `vec4f`, fourth component unused |
//! | weights | a, b of the edge to the right, b of the edge downwards, unused; not negative, edges out of the picture count as 0 |
//! | differences | two `vec4f`: D to the right, D downwards |
//!
//! and out: `solution`, u, `vec4f`. With weights that do not depend on the samples the L2 solution is linear in V and
//! D, hence unbiased if those are; with the same a everywhere it also keeps the picture's mean exactly.

mod settings;
mod solver;

pub use settings::{Norm, PoissonSettings, Preconditioner, Solver, Start};
pub use solver::{PoissonProblem, PoissonReport, PoissonSolver};
