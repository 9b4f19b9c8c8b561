//! Synthetic Poisson problems on the device, and a solver that is observed at every iteration.

use surfelcast::Failure;
use surfelcast_gpu::{Buffer, Gpu, MemoryKind};
use surfelcast_passes::poisson::{PoissonProblem, PoissonSettings, PoissonSolver};

use crate::stage::read_pixels;

/// An image on the host, in the layout of the device.
pub(super) type Pixels = Vec<[f32; 4]>;

/// Uniform and normal random numbers from a fixed seed.
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Box and Muller.
    fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

/// An image like a printed logo: a shaded disc, letters with hard edges, a fine grating, on a smooth background.
pub(super) fn logo([width, height]: [u32; 2]) -> Pixels {
    let color = |x: f64, y: f64| {
        let mut color = [0.25 + 0.2 * y, 0.3 + 0.1 * (3.0 * x).sin(), 0.35 + 0.2 * x];
        let (dx, dy) = ((x - 0.25) * 1.33, y - 0.5);
        let distance = (dx * dx + dy * dy).sqrt();
        if distance < 0.3 {
            let shade = (1.0 - (distance / 0.3).powi(2)).sqrt();
            color = [0.9 * shade, 0.6 * shade + 0.1, 0.2 + 0.1 * (40.0 * dx).sin() * shade];
        }
        let (column, row) = ((x - 0.52) * 12.0, (y - 0.25) * 4.0);
        if (0.0..5.0).contains(&column) && (0.0..2.0).contains(&row) {
            let (u, v) = (column.fract(), row.fract());
            let is_ink = u < 0.25 || (v < 0.2 && u < 0.8) || (column as u32 % 2 == 1 && (v - u).abs() < 0.12);
            if is_ink {
                color = [0.02, 0.03, 0.1];
            }
        }
        if y > 0.85 && (x * 60.0).fract() < 0.5 {
            color = [0.95, 0.95, 0.9];
        }
        color
    };
    let pixel = |i: u32| {
        let [r, g, b] =
            color((f64::from(i % width) + 0.5) / f64::from(width), (f64::from(i / width) + 0.5) / f64::from(height));
        [r as f32, g as f32, b as f32, 0.0]
    };
    (0..width * height).map(pixel).collect()
}

/// Differences to the right and downwards, two a pixel.
pub(super) fn differences(image: &[[f32; 4]], [width, height]: [u32; 2]) -> Pixels {
    let [width, height] = [width as usize, height as usize];
    let minus = |q: usize, p: usize| std::array::from_fn(|i| image[q][i] - image[p][i]);
    (0..width * height)
        .flat_map(|p| {
            let right = if p % width + 1 < width { minus(p + 1, p) } else { [0.0; 4] };
            let down = if p / width + 1 < height { minus(p + width, p) } else { [0.0; 4] };
            [right, down]
        })
        .collect()
}

/// Blurred by a Gaussian, the border left out of the mean.
pub(super) fn blurred(image: &[[f32; 4]], [width, height]: [u32; 2], sigma: f64) -> Pixels {
    let radius = (3.0 * sigma).ceil() as i64;
    let axis = |source: &[[f32; 4]], length: i64, stride: i64, place: &dyn Fn(i64) -> i64| -> Pixels {
        (0..source.len() as i64)
            .map(|p| {
                let (mut sum, mut total) = ([0.0; 4], 0.0);
                for k in (-radius).max(-place(p))..=radius.min(length - 1 - place(p)) {
                    let weight = (-0.5 * (k as f64 / sigma).powi(2)).exp();
                    total += weight;
                    (0..4).for_each(|i| sum[i] += weight * f64::from(source[(p + k * stride) as usize][i]));
                }
                sum.map(|v| (v / total) as f32)
            })
            .collect()
    };
    let [width, height] = [i64::from(width), i64::from(height)];
    let rows = axis(image, width, 1, &|p| p % width);
    axis(&rows, height, width, &|p| p / width)
}

/// Root mean square distance of colours.
pub(super) fn rmse(a: &[[f32; 4]], b: &[[f32; 4]]) -> f64 {
    let squares: f64 = a.iter().zip(b).flat_map(|(a, b)| (0..3).map(|i| f64::from(a[i] - b[i]).powi(2))).sum();
    (squares / (3.0 * a.len() as f64)).sqrt()
}

/// Value, weights, differences and solution in device memory.
pub(super) struct OnDevice {
    value: Buffer,
    weights: Buffer,
    differences: Buffer,
    solution: Buffer,
    size: [u32; 2],
}

impl OnDevice {
    pub(super) fn new(
        gpu: &Gpu,
        size: [u32; 2],
        value: &[[f32; 4]],
        weights: &[[f32; 4]],
        differences: &[[f32; 4]],
    ) -> Result<Self, Failure> {
        let upload = |label, values: &[[f32; 4]]| -> Result<Buffer, Failure> {
            let buffer = gpu.buffer(label, MemoryKind::View, values.len() as u64 * 16)?;
            gpu.upload(&buffer, 0, bytemuck::cast_slice(values))?;
            Ok(buffer)
        };
        Ok(Self {
            value: upload("poisson_value", value)?,
            weights: upload("poisson_weights", weights)?,
            differences: upload("poisson_differences", differences)?,
            solution: gpu.buffer("poisson_solution", MemoryKind::View, value.len() as u64 * 16)?,
            size,
        })
    }

    /// The logo with noise, and edges of random weight, nearly zero across vertical bars: what adaptive weights
    /// produce. `screen` is the weight of the values.
    pub(super) fn noisy(gpu: &Gpu, size: [u32; 2], screen: f32) -> Result<Self, Failure> {
        let mut random = Random(7);
        let truth = logo(size);
        let mut noise = |pixels: &[[f32; 4]], sigma: f64| -> Pixels {
            pixels.iter().map(|v| std::array::from_fn(|i| v[i] + (sigma * random.normal()) as f32)).collect()
        };
        let value = noise(&truth, 0.2);
        let differences = noise(&differences(&truth, size), 0.04);
        let weights: Pixels = (0..size[0] * size[1])
            .map(|p| {
                let is_bar = |x: u32| (x / 8).is_multiple_of(2);
                let across = if is_bar(p % size[0]) == is_bar(p % size[0] + 1) { 1.0 } else { 1e-3 };
                [screen, (random.normal().exp() * across) as f32, random.normal().exp() as f32, 0.0]
            })
            .collect();
        Self::new(gpu, size, &value, &weights, &differences)
    }

    pub(super) fn solution(&self, gpu: &Gpu) -> Result<Pixels, Failure> {
        read_pixels(gpu, &self.solution)
    }

    /// Solves, and calls `observe` after each iteration with the number of iterations, the true residual and the
    /// milliseconds on the device so far; it returns whether to continue. The start counts as iteration 0.
    pub(super) fn solve(
        &self,
        gpu: &Gpu,
        settings: PoissonSettings,
        mut observe: impl FnMut(u32, f64, f64) -> Result<bool, Failure>,
    ) -> Result<(), Failure> {
        let problem = PoissonProblem {
            value: &self.value,
            weights: &self.weights,
            differences: &self.differences,
            solution: &self.solution,
        };
        let mut solver = PoissonSolver::new(gpu, self.size, PoissonSettings { tolerance: 0.0, ..settings })?;
        solver.begin(gpu, &problem)?;
        let mut goes_on = observe(0, solver.true_residual(gpu, &problem)?, solver.report().gpu_ms())?;
        while goes_on && solver.report().iterations < settings.iterations {
            let is_solved = solver.advance(gpu, &problem, 1)?;
            let residual = solver.true_residual(gpu, &problem)?;
            let report = solver.report();
            goes_on = observe(report.iterations, residual, report.gpu_ms())? && !is_solved;
        }
        Ok(())
    }
}
