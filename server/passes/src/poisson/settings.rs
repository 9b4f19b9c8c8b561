//! How a Poisson problem is solved.

/// Iteration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Solver {
    /// Jacobi's method; iterations are counted in pairs.
    Jacobi,
    /// Red-black Gauss-Seidel with over-relaxation.
    GaussSeidel {
        /// 1 is plain Gauss-Seidel; in (0, 2).
        relaxation: f32,
    },
    /// Conjugate gradients.
    ConjugateGradients(Preconditioner),
}

/// Preconditioner of conjugate gradients.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preconditioner {
    /// None.
    None,
    /// The matrix' diagonal.
    Diagonal,
    /// A multigrid cycle with one smoothing step before and after each coarser grid.
    VCycle,
}

/// First guess.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Start {
    /// V itself.
    Value,
    /// V plus its differences through a signed Gaussian along each axis (Noack 2022, section 5.10), which assumes that
    /// V is a blurred image.
    SignedGaussian {
        /// Pixels.
        sigma: f32,
    },
    /// V blurred by a Gaussian, each neighbour corrected by the differences between: the same idea for any V.
    Gaussian {
        /// Standard deviation, pixels.
        sigma: f32,
    },
}

/// What is minimised.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Norm {
    /// Squares: linear, hence unbiased.
    L2,
    /// Absolute values, by iteratively reweighted least squares: robust against outliers, with a small bias.
    L1 {
        /// Rounds after the first, unweighted one.
        rounds: u32,
        /// A residual that counts as small: 0.05 times this is added to the residuals in the first round, and half as
        /// much in each that follows.
        scale: f32,
    },
}

/// How to solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoissonSettings {
    /// Iteration.
    pub solver: Solver,
    /// First guess.
    pub start: Start,
    /// What is minimised.
    pub norm: Norm,
    /// Iterations of a round at most.
    pub iterations: u32,
    /// Residual at which a round ends, as a share of the residual of V.
    pub tolerance: f32,
    /// Factor on edges of coarser grids.
    pub coarse_edge: f32,
}

impl Default for PoissonSettings {
    fn default() -> Self {
        Self {
            solver: Solver::ConjugateGradients(Preconditioner::VCycle),
            start: Start::Value,
            norm: Norm::L2,
            iterations: 64,
            tolerance: 1e-4,
            coarse_edge: 0.7,
        }
    }
}
