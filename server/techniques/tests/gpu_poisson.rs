//! The Poisson solver against a direct solution in `f64`.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]
#![allow(clippy::print_stdout, reason = "a test says what it measured")]

use surfelcast_gpu::{Buffer, Gpu, GpuOptions, MemoryKind};
use surfelcast_passes::poisson::{
    Norm, PoissonProblem, PoissonReport, PoissonSettings, PoissonSolver, Preconditioner, Solver, Start,
};
use surfelcast_shaders::layout::bytemuck;

/// A problem on the host: colours and weights as on the device.
struct Problem {
    size: [usize; 2],
    value: Vec<[f32; 4]>,
    weights: Vec<[f32; 4]>,
    differences: Vec<[f32; 4]>,
}

/// Uniform numbers in [0, 1).
fn numbers(seed: u32) -> impl FnMut() -> f32 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 24) as f32
    }
}

/// Random values and weights over two orders of magnitude; some edges have weight 0.
fn random_problem(size: [usize; 2], screen: f32, seed: u32) -> Problem {
    let mut random = numbers(seed);
    let count = size[0] * size[1];
    let mut color = |scale: f32| -> Vec<[f32; 4]> {
        (0..count).map(|_| std::array::from_fn(|i| if i < 3 { (random() - 0.3) * scale } else { 0.0 })).collect()
    };
    let value = color(2.0);
    let (right, down) = (color(0.5), color(0.5));
    let differences = right.into_iter().zip(down).flat_map(|(right, down)| [right, down]).collect();
    let mut weight = |scale: f32| if random() < 0.1 { 0.0 } else { scale * 10f32.powf(2.0 * random() - 1.0) };
    let weights = (0..count).map(|_| [screen * (0.5 + weight(1.0)), weight(1.0), weight(1.0), 0.0]).collect();
    Problem { size, value, weights, differences }
}

impl Problem {
    /// Edges: (p, q, weight, difference).
    fn edges(&self) -> Vec<(usize, usize, f64, [f32; 4])> {
        let [width, height] = self.size;
        let mut edges = Vec::new();
        for p in 0..width * height {
            if p % width + 1 < width {
                edges.push((p, p + 1, f64::from(self.weights[p][1]), self.differences[2 * p]));
            }
            if p / width + 1 < height {
                edges.push((p, p + width, f64::from(self.weights[p][2]), self.differences[2 * p + 1]));
            }
        }
        edges
    }

    /// Minimiser of the squares by Cholesky's method, with a factor on each value's and each edge's weight.
    fn direct(&self, of_values: &[f64], of_edges: &[f64]) -> Vec<[f64; 3]> {
        let count = self.value.len();
        let mut matrix = vec![0.0f64; count * count];
        let mut right = vec![[0.0f64; 3]; count];
        for p in 0..count {
            let a = f64::from(self.weights[p][0]) * of_values[p];
            matrix[p * count + p] += a;
            (0..3).for_each(|i| right[p][i] += a * f64::from(self.value[p][i]));
        }
        for ((p, q, b, d), factor) in self.edges().into_iter().zip(of_edges) {
            let b = b * factor;
            matrix[p * count + p] += b;
            matrix[q * count + q] += b;
            matrix[p * count + q] -= b;
            matrix[q * count + p] -= b;
            for i in 0..3 {
                right[q][i] += b * f64::from(d[i]);
                right[p][i] -= b * f64::from(d[i]);
            }
        }
        // L L^T in place, then both triangles.
        for j in 0..count {
            for k in 0..j {
                let factor = matrix[j * count + k];
                for i in j..count {
                    matrix[i * count + j] -= matrix[i * count + k] * factor;
                }
            }
            let pivot = matrix[j * count + j].sqrt();
            (j..count).for_each(|i| matrix[i * count + j] /= pivot);
        }
        for r in 0..count {
            for c in 0..r {
                (0..3).for_each(|i| right[r][i] -= matrix[r * count + c] * right[c][i]);
            }
            right[r] = right[r].map(|v| v / matrix[r * count + r]);
        }
        for r in (0..count).rev() {
            for c in r + 1..count {
                (0..3).for_each(|i| right[r][i] -= matrix[c * count + r] * right[c][i]);
            }
            right[r] = right[r].map(|v| v / matrix[r * count + r]);
        }
        right
    }

    /// Minimiser of the squares.
    fn least_squares(&self) -> Vec<[f64; 3]> {
        self.direct(&vec![1.0; self.value.len()], &vec![1.0; self.edges().len()])
    }

    /// Minimiser after rounds of reweighting.
    fn reweighted(&self, rounds: u32, scale: f64) -> Vec<[f64; 3]> {
        let norm = |v: [f64; 3]| v.iter().map(|v| v * v).sum::<f64>().sqrt();
        let mut u = self.least_squares();
        for round in 0..rounds {
            let added = 0.05 * scale * 0.5f64.powi(round as i32);
            let factor = |weight: f64, residual: f64| 1.0 / (weight.sqrt() * residual + added);
            let of_values: Vec<f64> = (0..u.len())
                .map(|p| {
                    let v = self.value[p];
                    let residual = norm(std::array::from_fn(|i| u[p][i] - f64::from(v[i])));
                    factor(self.weights[p][0].into(), residual)
                })
                .collect();
            let of_edges: Vec<f64> = self
                .edges()
                .into_iter()
                .map(|(p, q, b, d)| {
                    let residual = norm(std::array::from_fn(|i| u[q][i] - u[p][i] - f64::from(d[i])));
                    factor(b, residual)
                })
                .collect();
            u = self.direct(&of_values, &of_edges);
        }
        u
    }
}

fn gpu() -> Gpu {
    Gpu::open(&GpuOptions::default()).unwrap()
}

fn solve(gpu: &Gpu, problem: &Problem, settings: PoissonSettings) -> (Vec<[f32; 4]>, PoissonReport) {
    let upload = |label, values: &[[f32; 4]]| -> Buffer {
        let buffer = gpu.buffer(label, MemoryKind::View, values.len() as u64 * 16).unwrap();
        gpu.upload(&buffer, 0, bytemuck::cast_slice(values)).unwrap();
        buffer
    };
    let value = upload("value", &problem.value);
    let weights = upload("weights", &problem.weights);
    let differences = upload("differences", &problem.differences);
    let solution = gpu.buffer("solution", MemoryKind::View, problem.value.len() as u64 * 16).unwrap();
    let size = problem.size.map(|side| side as u32);
    let mut solver = PoissonSolver::new(gpu, size, settings).unwrap();
    let on_device = PoissonProblem { value: &value, weights: &weights, differences: &differences, solution: &solution };
    let report = solver.solve(gpu, &on_device).unwrap();
    let mut graph = gpu.graph("read");
    let ticket = graph.read_back(&solution, 0..solution.size_bytes()).unwrap();
    let bytes = graph.submit().unwrap().wait().unwrap().take(ticket).unwrap();
    (bytemuck::pod_collect_to_vec(&bytes), report)
}

/// Largest distance between two solutions.
fn distance(u: &[[f32; 4]], direct: &[[f64; 3]]) -> f64 {
    let pairs = u.iter().zip(direct);
    pairs.flat_map(|(u, d)| (0..3).map(|i| (f64::from(u[i]) - d[i]).abs())).fold(0.0, f64::max)
}

const SOLVERS: [Solver; 6] = [
    Solver::Jacobi,
    Solver::GaussSeidel { relaxation: 1.0 },
    Solver::GaussSeidel { relaxation: 1.7 },
    Solver::ConjugateGradients(Preconditioner::None),
    Solver::ConjugateGradients(Preconditioner::Diagonal),
    Solver::ConjugateGradients(Preconditioner::VCycle),
];

#[test]
fn every_solver_finds_the_direct_solution() {
    let gpu = gpu();
    // Odd sides, one row, one pixel: grids that blocks do not divide.
    for (size, screen) in [([21, 17], 0.1), ([40, 1], 0.1), ([1, 33], 0.5), ([1, 1], 0.1)] {
        let problem = random_problem(size, screen, 7);
        let direct = problem.least_squares();
        for solver in SOLVERS {
            let settings = PoissonSettings { solver, iterations: 4000, tolerance: 1e-6, ..PoissonSettings::default() };
            let (u, report) = solve(&gpu, &problem, settings);
            let off = distance(&u, &direct);
            println!("{size:?} {solver:?}: {} iterations, off by {off:.1e}", report.iterations);
            // A small residual does not exclude smooth errors, which plain iterations remove last.
            assert!(off < 1e-3, "{size:?} {solver:?}: off by {off}, residual {}", report.residual);
        }
    }
}

#[test]
fn every_start_leads_to_the_same_solution() {
    let gpu = gpu();
    let problem = random_problem([21, 17], 0.1, 11);
    let direct = problem.least_squares();
    for start in [Start::Value, Start::SignedGaussian { sigma: 5.0 }, Start::Gaussian { sigma: 3.0 }] {
        let (u, _) = solve(&gpu, &problem, PoissonSettings { start, tolerance: 2e-6, ..PoissonSettings::default() });
        assert!(distance(&u, &direct) < 2e-4, "{start:?}: {}", distance(&u, &direct));
    }
}

/// An image that fits its differences is its own solution; from a blurred one, the Gaussian start restores it where the
/// blur is complete.
#[test]
fn the_gaussian_start_undoes_a_blur_that_it_matches() {
    let gpu = gpu();
    let size = [48usize, 32];
    let mut problem = random_problem(size, 0.1, 3);
    problem.weights.iter_mut().for_each(|weight| *weight = [1e-4, 1.0, 1.0, 0.0]);
    let truth: Vec<[f64; 3]> = (0..size[0] * size[1])
        .map(|p| {
            let (x, y) = (p % size[0], p / size[0]);
            [if x > 20 && y > 10 { 1.0 } else { 0.2 }, (x as f64 * 0.3).sin(), y as f64 * 0.02]
        })
        .collect();
    let difference =
        |p: usize, q: usize| std::array::from_fn(|i| if i < 3 { (truth[q][i] - truth[p][i]) as f32 } else { 0.0 });
    problem.differences = vec![[0.0; 4]; 2 * truth.len()];
    for (p, q, ..) in problem.edges() {
        problem.differences[2 * p + usize::from(q != p + 1)] = difference(p, q);
    }
    // A constant is the strongest blur: only differences can restore the rest.
    let mean: [f64; 3] = std::array::from_fn(|i| truth.iter().map(|v| v[i]).sum::<f64>() / truth.len() as f64);
    problem.value = vec![std::array::from_fn(|i| if i < 3 { mean[i] as f32 } else { 0.0 }); truth.len()];
    let rmse = |start, iterations| {
        let (u, _) = solve(&gpu, &problem, PoissonSettings { start, iterations, ..PoissonSettings::default() });
        let squares: f64 =
            u.iter().zip(&truth).map(|(u, t)| (0..3).map(|i| (f64::from(u[i]) - t[i]).powi(2)).sum::<f64>()).sum();
        (squares / truth.len() as f64).sqrt()
    };
    let (value, gaussian) = (rmse(Start::Value, 0), rmse(Start::Gaussian { sigma: 6.0 }, 0));
    println!("RMSE of the start: value {value:.4}, Gaussian {gaussian:.4}");
    assert!(gaussian < 0.6 * value);
    assert!(rmse(Start::Value, 64) < 0.1 * value);
}

#[test]
fn reweighting_follows_its_twin_and_resists_outliers() {
    let gpu = gpu();
    let mut problem = random_problem([21, 17], 0.1, 5);
    for p in (0..problem.value.len()).step_by(23) {
        problem.value[p] = [40.0, 30.0, 20.0, 0.0];
    }
    let norm = Norm::L1 { rounds: 4, scale: 1.0 };
    let (u, report) = solve(&gpu, &problem, PoissonSettings { norm, tolerance: 1e-6, ..PoissonSettings::default() });
    let off = distance(&u, &problem.reweighted(4, 1.0));
    println!("L1: {} iterations, off by {off:.1e}", report.iterations);
    assert!(off < 2e-3, "{off}");
    let largest = |u: &[[f32; 4]]| u.iter().map(|v| v[0]).fold(0.0, f32::max);
    let (squares, _) = solve(&gpu, &problem, PoissonSettings::default());
    assert!(largest(&u) < 0.5 * largest(&squares), "{} {}", largest(&u), largest(&squares));
}

#[test]
fn equal_problems_give_equal_bytes_and_equal_screens_keep_the_mean() {
    let gpu = gpu();
    let mut problem = random_problem([150, 70], 0.1, 9);
    problem.weights.iter_mut().for_each(|weight| weight[0] = 0.04);
    let settings = PoissonSettings::default();
    let (first, report) = solve(&gpu, &problem, settings);
    let (second, _) = solve(&gpu, &problem, settings);
    assert_eq!(bytemuck::cast_slice::<_, u8>(&first), bytemuck::cast_slice::<_, u8>(&second));
    println!("{} iterations to {:.1e}", report.iterations, report.residual);
    assert!(report.residual <= 1e-4 && report.iterations <= 32, "{report:?}");
    for i in 0..3 {
        let mean = |values: &[[f32; 4]]| values.iter().map(|v| f64::from(v[i])).sum::<f64>() / values.len() as f64;
        assert!((mean(&first) - mean(&problem.value)).abs() < 1e-4, "channel {i}");
    }
}
