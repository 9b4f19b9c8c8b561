//! Measures the three studies.

use std::path::Path;

use indicatif::ProgressBar;
use surfelcast::{Failure, scene_file};
use surfelcast_gpu::Gpu;
use surfelcast_passes::poisson::{PoissonSettings, Preconditioner, Solver, Start};
use surfelcast_render_api::Settings;
use surfelcast_renderer::Throughput;
use surfelcast_renderer::progressive::{MAX_JOB_BATCH, Progressive, SceneOnDevice, Until};
use surfelcast_techniques::gradient::{GradientTracer, Reconstruction};
use surfelcast_techniques::technique::{Technique, TechniqueOptions};
use surfelcast_techniques::{FrameView, LightBuffers, LightState, MaterialMode, SceneBuffers, SessionState, registry};

use crate::stage::read_pixels;
use crate::studies::poisson::problem::{OnDevice, Pixels, blurred, differences, logo, rmse};
use crate::studies::poisson::{Key, Observed, Solved};

/// Residual whose cost is stated.
pub(super) const GOAL: f64 = 1e-3;
/// Pixels times iterations of a solver at most, and the range of its iterations.
const WORK: u32 = 1 << 25;
const ITERATIONS: (u32, u32) = (100, 1500);
/// Iterations without progress by 5 % after which a residual counts as attained.
const PATIENCE: u32 = 50;
/// Standard deviations of the blur, pixels, as in the thesis.
pub(super) const BLURS: [f64; 2] = [6.0, 20.0];
/// Iterations at which an image of the blur study is observed.
const OBSERVED_AT: [u32; 10] = [0, 1, 2, 4, 8, 16, 32, 64, 128, 256];
/// Weight of the values in that study: wavelengths above 2 pi / 0.01 pixels come from the blurred image, which has
/// them.
const BLUR_SCREEN: f32 = 1e-4;
/// Scene of the path study, seen by its last camera.
const SCENE: &str = "demo:interior";
/// Fixed numbers of iterations of the path study, as in the thesis.
pub(super) const FIXED: [u32; 2] = [10, 30];
/// Sigma of the preparation there: the thesis' kernel of 21 pixels.
const FIXED_SIGMA: f32 = 5.0;
pub(super) const SOLVERS: [(&str, Solver); 7] = [
    ("Jacobi", Solver::Jacobi),
    ("Gauss-Seidel", Solver::GaussSeidel { relaxation: 1.0 }),
    ("over-relaxation 1.7", Solver::GaussSeidel { relaxation: 1.7 }),
    ("over-relaxation 1.9", Solver::GaussSeidel { relaxation: 1.9 }),
    ("CG", Solver::ConjugateGradients(Preconditioner::None)),
    ("CG, diagonal", Solver::ConjugateGradients(Preconditioner::Diagonal)),
    ("CG, V-cycle", Solver::ConjugateGradients(Preconditioner::VCycle)),
];

/// Steps of the progress bar.
pub(super) fn step_count(key: &Key) -> u64 {
    (key.sizes.len() * key.screens.len() * SOLVERS.len() + BLURS.len() + 1) as u64
}

pub(super) fn measure(gpu: &Gpu, key: &Key, bar: &ProgressBar) -> Result<(Vec<Solved>, Vec<Observed>), Failure> {
    let mut solved = Vec::new();
    for &size in &key.sizes {
        for &screen in &key.screens {
            let problem = OnDevice::noisy(gpu, size, screen)?;
            let best = best_solution(gpu, &problem)?;
            for (name, solver) in SOLVERS {
                bar.set_message(format!("{}x{} {screen} {name}", size[0], size[1]));
                solved.push(converge(gpu, &problem, &best, size, screen, (name, solver))?);
                bar.inc(1);
            }
        }
    }
    let mut images = Vec::new();
    for sigma in BLURS {
        bar.set_message(format!("blur of {sigma} pixels"));
        images.extend(unblur(gpu, key.blur_size, sigma)?);
        bar.inc(1);
    }
    bar.set_message("paths");
    images.extend(trace_paths(gpu, key)?);
    Ok((solved, images))
}

/// The solution to the precision of `f32`.
fn best_solution(gpu: &Gpu, problem: &OnDevice) -> Result<Pixels, Failure> {
    let settings = PoissonSettings { iterations: 60, ..PoissonSettings::default() };
    problem.solve(gpu, settings, |_, residual, _| Ok(residual > 1e-7))?;
    problem.solution(gpu)
}

fn converge(
    gpu: &Gpu,
    problem: &OnDevice,
    best: &[[f32; 4]],
    size: [u32; 2],
    screen: f32,
    (name, solver): (&str, Solver),
) -> Result<Solved, Failure> {
    let iterations = (WORK / (size[0] * size[1])).clamp(ITERATIONS.0, ITERATIONS.1);
    let settings = PoissonSettings { solver, iterations, ..PoissonSettings::default() };
    let (mut first_error, mut start_ms) = (0.0, 0.0);
    let mut solved = Solved {
        solver: name.to_owned(),
        size,
        screen,
        iterations: None,
        ms: None,
        error_left: None,
        ms_an_iteration: 0.0,
        attainable: 1.0,
        residuals: Vec::new(),
    };
    let mut progress = (0, 1.0);
    problem.solve(gpu, settings, |iteration, residual, ms| {
        if iteration == 0 {
            first_error = rmse(&problem.solution(gpu)?, best);
            start_ms = ms;
        } else {
            solved.ms_an_iteration = (ms - start_ms) / f64::from(iteration);
        }
        // Jacobi's iterations come in pairs.
        solved.residuals.resize(iteration as usize + 1, residual);
        solved.attainable = solved.attainable.min(residual);
        if residual <= GOAL && solved.iterations.is_none() {
            solved.iterations = Some(iteration);
            solved.ms = Some(ms);
            solved.error_left = Some(rmse(&problem.solution(gpu)?, best) / first_error);
        }
        if residual < 0.95 * progress.1 {
            progress = (iteration, residual);
        }
        Ok(iteration - progress.0 < PATIENCE)
    })?;
    Ok(solved)
}

/// The thesis' test: a blurred image with the differences of the sharp one.
fn unblur(gpu: &Gpu, size: [u32; 2], sigma: f64) -> Result<Vec<Observed>, Failure> {
    let truth = logo(size);
    let weights = vec![[BLUR_SCREEN, 1.0, 1.0, 0.0]; truth.len()];
    let problem = OnDevice::new(gpu, size, &blurred(&truth, size, sigma), &weights, &differences(&truth, size))?;
    let plain = Solver::GaussSeidel { relaxation: 1.0 };
    let over = Solver::GaussSeidel { relaxation: 1.9 };
    let cycle = Solver::ConjugateGradients(Preconditioner::VCycle);
    // The thesis' kernel is exp(-(x / s)^2) and its blur exp(-(x / s)^2 / 2).
    let signed = Start::SignedGaussian { sigma: (sigma * std::f64::consts::SQRT_2) as f32 };
    let gaussian = Start::Gaussian { sigma: sigma as f32 };
    let methods = [
        ("Gauss-Seidel", plain, Start::Value),
        ("Gauss-Seidel, signed Gaussian", plain, signed),
        ("Gauss-Seidel, Gaussian", plain, gaussian),
        ("over-relaxation 1.9", over, Start::Value),
        ("over-relaxation 1.9, Gaussian", over, gaussian),
        ("CG, V-cycle", cycle, Start::Value),
        ("CG, V-cycle, Gaussian", cycle, gaussian),
    ];
    let mut observed = Vec::new();
    for (method, solver, start) in methods {
        // The V-cycle has nothing left to do long before.
        let last = if solver == cycle { 32 } else { OBSERVED_AT[OBSERVED_AT.len() - 1] };
        let settings = PoissonSettings { solver, start, iterations: last, ..PoissonSettings::default() };
        problem.solve(gpu, settings, |iteration, _, _| {
            if OBSERVED_AT.contains(&iteration) {
                observed.push(Observed {
                    study: format!("blur_{sigma}"),
                    method: method.to_owned(),
                    at: iteration,
                    rmse: rmse(&problem.solution(gpu)?, &truth),
                });
            }
            Ok(true)
        })?;
    }
    Ok(observed)
}

/// Renders until there are this many samples a pixel.
fn render<T: Technique + ?Sized>(
    progressive: &mut Progressive<T>,
    on: SceneOnDevice<'_>,
    view: &FrameView,
    samples: u32,
) -> Result<(), Failure> {
    while progressive.samples() < samples {
        progressive.advance(on, view, Until { samples, max_batch: MAX_JOB_BATCH })?;
    }
    Ok(())
}

/// Gradient-domain path tracing, reconstructed in several ways.
fn trace_paths(gpu: &Gpu, key: &Key) -> Result<Vec<Observed>, Failure> {
    let scene = scene_file::load(Path::new(SCENE), None, None)?;
    let buffers = SceneBuffers::new(gpu, &scene)?;
    let lights = LightBuffers::new(gpu, &scene, &LightState::of_scene(&scene))?;
    let size = key.path_size;
    let camera = scene.cameras.last().ok_or_else(|| Failure::runtime("the demo scene has no camera"))?.camera;
    let frame = FrameView { camera, size, exposure: 1.0 };
    let options = |seed| TechniqueOptions {
        size,
        full_size: size,
        materials: MaterialMode::Pbr,
        is_split: false,
        seed,
        waits_for_kernels: true,
        settings: Settings::default(),
    };
    let on = SceneOnDevice { gpu, scene: &buffers, lights: &lights };
    let path = registry::by_id("path").ok_or_else(|| Failure::runtime("path tracing is missing"))?;
    let truth = path.start(gpu, &buffers, &lights, &SessionState::default(), options(99))?;
    let mut truth = Progressive::new(truth, Throughput::default());
    render(&mut truth, on, &frame, key.truth_samples)?;
    let truth = tone_mapped(&read_pixels(gpu, truth.technique().picture())?);

    let plain = Solver::GaussSeidel { relaxation: 1.0 };
    let starts = [
        ("no preparation", Start::Value),
        ("signed Gaussian", Start::SignedGaussian { sigma: FIXED_SIGMA }),
        ("Gaussian", Start::Gaussian { sigma: FIXED_SIGMA }),
    ];
    let mut observed = Vec::new();
    let tracer = GradientTracer::new(gpu, &buffers, &lights, options(1), Reconstruction::None)?;
    let mut progressive = Progressive::new(Box::new(tracer), Throughput::default());
    let mut samples = 1;
    while samples <= key.samples {
        render(&mut progressive, on, &frame, samples)?;
        let tracer = progressive.technique();
        let value = read_pixels(gpu, tracer.values())?;
        let directly = read_pixels(gpu, tracer.seen())?;
        let problem = OnDevice::new(
            gpu,
            size,
            &value,
            &read_pixels(gpu, tracer.weights())?,
            &read_pixels(gpu, tracer.differences())?,
        )?;
        let mut observe = |study: &str, method: &str, image: &[[f32; 4]]| {
            let whole: Pixels =
                image.iter().zip(&directly).map(|(a, b)| std::array::from_fn(|i| a[i] + b[i])).collect();
            let rmse = rmse(&tone_mapped(&whole), &truth);
            observed.push(Observed { study: study.to_owned(), method: method.to_owned(), at: samples, rmse });
        };
        let solve = |solver, start, iterations| -> Result<Pixels, Failure> {
            let settings = PoissonSettings { solver, start, iterations, ..PoissonSettings::default() };
            problem.solve(gpu, settings, |_, residual, _| Ok(residual > 1e-5))?;
            problem.solution(gpu)
        };
        let exact = solve(Solver::ConjugateGradients(Preconditioner::VCycle), Start::Value, 40)?;
        for iterations in FIXED {
            let study = format!("paths_{iterations}");
            observe(&study, "without reconstruction", &value);
            for (method, start) in starts {
                observe(&study, &format!("Gauss-Seidel, {method}"), &solve(plain, start, iterations)?);
            }
            observe(&study, "solved to the end", &exact);
        }
        samples *= 2;
    }
    Ok(observed)
}

/// After the tone map of the error metric.
fn tone_mapped(image: &[[f32; 4]]) -> Pixels {
    let compress = |v: &[f32; 4]| {
        let scale = 1.0 / (1.0 + v[0].max(v[1]).max(v[2]).max(0.0));
        [v[0] * scale, v[1] * scale, v[2] * scale, 0.0]
    };
    image.iter().map(compress).collect()
}
