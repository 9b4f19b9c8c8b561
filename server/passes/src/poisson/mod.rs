//! Screened Poisson reconstruction of an image: from noisy values and noisy differences between pixels to the image
//! that fits both best.
//!
//! [`PoissonSolver`] minimises `sum_p a_p |u_p - V_p|^2 + sum_pq b_pq |u_q - u_p - D_pq|^2` over the edges to the right
//! and downwards, separately for each colour channel, in `f32` and in a fixed order of sums. Input, by pixel:
//!
//! | buffer | element |
//! |---|---|
//! | value | V, `vec4f`, fourth component unused |
//! | weights | a, b of the edge to the right, b of the edge downwards, unused; not negative, edges out of the image count as 0 |
//! | differences | two `vec4f`: D to the right, D downwards |
//!
//! Output: `solution`, u, `vec4f`. With weights that do not depend on the samples the L2 solution is linear in V and
//! D, hence unbiased if those are; with the same a everywhere it also preserves the image's mean exactly.

mod settings;
mod solver;

pub use settings::{Norm, PoissonSettings, Preconditioner, Solver, Start};
pub use solver::{PoissonProblem, PoissonReport, PoissonSolver};
