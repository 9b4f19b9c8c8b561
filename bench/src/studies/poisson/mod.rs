//! `surfelcast-bench poisson`: how image-space solvers of the screened Poisson problem converge.
//!
//! Three studies. *Solvers*: iterations, time and attainable residual of each against picture size and screen weight. *Blur*: a
//! blurred picture and its true differences, with the preparation steps of the first guess (Noack 2022, figures 5.16 and
//! 5.17). *Paths*: gradient-domain path tracing reconstructed by a fixed number of iterations with and without preparation
//! (figures 6.2 to 6.4).

mod problem;

use std::fmt::Write as _;

use crate::report::chart::{Chart, ChartPoint, Series};
use clap::Args;
use serde::Serialize;
use surfelcast_gpu::Gpu;
use surfelcast_passes::poisson::{PoissonSettings, Preconditioner, Solver, Start};
use surfelcast_passes::step::StepBudget;
use surfelcast_scene::{LoadOptions, ViewFile, demo, load_bytes};
use surfelcast_techniques::gradient::{GradientTracer, Reconstruction};
use surfelcast_techniques::technique::{Technique, TechniqueOptions};
use surfelcast_techniques::{
    FrameView, LightBuffers, LightState, MaterialMode, SceneBuffers, SessionState, SurfelSettings, registry,
};

use crate::report::{OutputArgs, device_name, progress_bar, write_file};
use crate::studies::poisson::problem::{OnDevice, Pixels, blurred, differences, logo, read, rmse};
use surfelcast::Failure;
use surfelcast::args::parse_size;

/// Name of the markers and of the record.
const NAME: &str = "poisson";
/// Residual whose cost is told.
const GOAL: f64 = 1e-3;
/// Pixels times iterations that a solver may take, and iterations at least and at most.
const WORK: u32 = 1 << 25;
const ITERATIONS: (u32, u32) = (100, 1500);
/// Iterations without progress by a twentieth after which a residual counts as attained.
const PATIENCE: u32 = 50;
/// Standard deviations of the blur, pixels, as in the thesis.
const BLURS: [f64; 2] = [6.0, 20.0];
/// Iterations at which a picture of the blur study is looked at.
const LOOKS: [u32; 10] = [0, 1, 2, 4, 8, 16, 32, 64, 128, 256];
/// Weight of the values in that study: wavelengths beyond 2 pi / 0.01 pixels are left to the blurred picture, which has them.
const BLUR_SCREEN: f32 = 1e-4;
/// Fixed numbers of iterations of the path study, as in the thesis.
const FIXED: [u32; 2] = [10, 30];
/// Sigma of the preparation there: the thesis' kernel of 21 pixels.
const FIXED_SIGMA: f32 = 5.0;
const SOLVERS: [(&str, Solver); 7] = [
    ("Jacobi", Solver::Jacobi),
    ("Gauss-Seidel", Solver::GaussSeidel { relaxation: 1.0 }),
    ("over-relaxation 1.7", Solver::GaussSeidel { relaxation: 1.7 }),
    ("over-relaxation 1.9", Solver::GaussSeidel { relaxation: 1.9 }),
    ("CG", Solver::ConjugateGradients(Preconditioner::None)),
    ("CG, diagonal", Solver::ConjugateGradients(Preconditioner::Diagonal)),
    ("CG, V-cycle", Solver::ConjugateGradients(Preconditioner::VCycle)),
];

#[derive(Debug, Args)]
pub(crate) struct PoissonArgs {
    /// Picture sizes of the solver study.
    #[arg(long, value_name = "WxH,...", value_delimiter = ',', default_value = "160x120,320x240,640x480,1280x720",
          value_parser = parse_size)]
    sizes: Vec<[u32; 2]>,
    /// Weights of the values against the edges, whose weights are around 1.
    #[arg(long, value_name = "A,...", value_delimiter = ',', default_values_t = [0.04, 0.004, 0.0004],
          value_parser = parse_screen)]
    screens: Vec<f32>,
    /// Picture size of the blur study.
    #[arg(long, value_name = "WxH", default_value = "320x240", value_parser = parse_size)]
    blur_size: [u32; 2],
    /// Picture size of the path study.
    #[arg(long, value_name = "WxH", default_value = "160x120", value_parser = parse_size)]
    path_size: [u32; 2],
    /// Samples a pixel of the path study at most, in powers of two.
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=4096))]
    samples: u32,
    /// Samples a pixel of its truth.
    #[arg(long, value_name = "N", default_value_t = 4096, value_parser = clap::value_parser!(u32).range(16..=65536))]
    truth_samples: u32,
    #[command(flatten)]
    output: OutputArgs,
}

fn parse_screen(text: &str) -> Result<f32, String> {
    let screen = text.parse().ok().filter(|a: &f32| (1e-6..=1e3).contains(a));
    screen.ok_or_else(|| "expected a number in [1e-6, 1e3]".to_owned())
}

/// One solver on one problem.
#[derive(Debug, Serialize)]
struct Solved {
    solver: &'static str,
    size: [u32; 2],
    screen: f32,
    /// Iterations to the goal, milliseconds on the device until then, and the share of the start's error that is left.
    iterations: Option<u32>,
    ms: Option<f64>,
    error_left: Option<f64>,
    ms_an_iteration: f64,
    /// Least residual found: what `f32` attains, unless the iterations ran out.
    attainable: f64,
    /// Residual by iteration.
    residuals: Vec<f64>,
}

/// RMSE of a study's picture.
#[derive(Debug, Serialize)]
struct Seen {
    study: String,
    method: String,
    /// Iterations, or samples a pixel.
    at: u32,
    rmse: f64,
}

#[derive(Debug, Serialize)]
struct Record<'a> {
    device: &'a str,
    version: &'a str,
    solvers: &'a [Solved],
    pictures: &'a [Seen],
}

pub(crate) fn run(args: &PoissonArgs) -> Result<(), Failure> {
    args.output.table.check(NAME)?;
    let gpu = args.output.gpu()?;
    let bar = progress_bar((args.sizes.len() * args.screens.len() * SOLVERS.len() + BLURS.len() + 1) as u64);
    let mut solved = Vec::new();
    for &size in &args.sizes {
        for &screen in &args.screens {
            let problem = OnDevice::noisy(&gpu, size, screen)?;
            let best = best_solution(&gpu, &problem)?;
            for (name, solver) in SOLVERS {
                bar.set_message(format!("{}x{} {screen} {name}", size[0], size[1]));
                solved.push(converge(&gpu, &problem, &best, size, screen, (name, solver))?);
                bar.inc(1);
            }
        }
    }
    let mut pictures = Vec::new();
    for sigma in BLURS {
        bar.set_message(format!("blur of {sigma} pixels"));
        pictures.extend(unblur(&gpu, args.blur_size, sigma)?);
        bar.inc(1);
    }
    bar.set_message("paths");
    pictures.extend(trace_paths(&gpu, args)?);
    bar.finish_and_clear();

    let device = device_name(&gpu);
    let record = Record { device: &device, version: env!("CARGO_PKG_VERSION"), solvers: &solved, pictures: &pictures };
    let json = serde_json::to_vec_pretty(&record).map_err(|error| Failure::runtime(error.to_string()))?;
    let out = &args.output.out;
    write_file(&out.join("poisson.json"), &json)?;
    write_file(&out.join("poisson_solvers.csv"), solver_csv(&solved).as_bytes())?;
    write_file(&out.join("poisson_pictures.csv"), picture_csv(&pictures).as_bytes())?;
    charts(args, &solved, &pictures)?;
    args.output.table.publish(NAME, &markdown(args, &device, &solved, &pictures))
}

/// Solution as exact as `f32` has it.
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
    (name, solver): (&'static str, Solver),
) -> Result<Solved, Failure> {
    let iterations = (WORK / (size[0] * size[1])).clamp(ITERATIONS.0, ITERATIONS.1);
    let settings = PoissonSettings { solver, iterations, ..PoissonSettings::default() };
    let (mut first_error, mut start_ms) = (0.0, 0.0);
    let mut solved = Solved {
        solver: name,
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

/// The thesis' test: a blurred picture with the differences of the sharp one.
fn unblur(gpu: &Gpu, size: [u32; 2], sigma: f64) -> Result<Vec<Seen>, Failure> {
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
    let mut seen = Vec::new();
    for (method, solver, start) in methods {
        // The V-cycle has nothing left to do long before.
        let last = if solver == cycle { 32 } else { LOOKS[LOOKS.len() - 1] };
        let settings = PoissonSettings { solver, start, iterations: last, ..PoissonSettings::default() };
        problem.solve(gpu, settings, |iteration, _, _| {
            if LOOKS.contains(&iteration) {
                seen.push(Seen {
                    study: format!("blur_{sigma}"),
                    method: method.to_owned(),
                    at: iteration,
                    rmse: rmse(&problem.solution(gpu)?, &truth),
                });
            }
            Ok(true)
        })?;
    }
    Ok(seen)
}

/// Gradient-domain path tracing of the Cornell box, reconstructed in several ways.
fn trace_paths(gpu: &Gpu, args: &PoissonArgs) -> Result<Vec<Seen>, Failure> {
    let demo = demo::scenes().into_iter().next().ok_or_else(|| Failure::runtime("there is no demo scene"))?;
    let view = ViewFile::parse(demo.view.as_bytes())?;
    let scene = load_bytes(&demo.glb, demo.name, &LoadOptions { view: Some(view), ..LoadOptions::default() })?;
    let buffers = SceneBuffers::new(gpu, &scene)?;
    let lights = LightBuffers::new(gpu, &scene, &LightState::of_scene(&scene))?;
    let size = args.path_size;
    let camera = scene.cameras.last().ok_or_else(|| Failure::runtime("the demo scene has no camera"))?.camera;
    let frame = FrameView { camera, size, exposure: 1.0 };
    let options = |seed| TechniqueOptions {
        size,
        full_size: size,
        materials: MaterialMode::Pbr,
        is_split: false,
        seed,
        waits_for_kernels: true,
        surfel: SurfelSettings::default(),
    };
    let render = |technique: &mut dyn Technique, samples: u32| -> Result<(), Failure> {
        while technique.samples() < samples {
            let budget = StepBudget { max_paths: 1 << 14, until_samples: samples, max_batch: 64 };
            technique.step(gpu, &buffers, &lights, &frame, budget)?;
        }
        Ok(())
    };
    let path = registry::by_id("path").ok_or_else(|| Failure::runtime("path tracing is missing"))?;
    let mut truth = (path.create)(gpu, &buffers, &lights, &SessionState::default(), options(99))?;
    render(truth.as_mut(), args.truth_samples)?;
    let truth = tone_mapped(&read(gpu, truth.picture())?);

    let plain = Solver::GaussSeidel { relaxation: 1.0 };
    let starts = [
        ("no preparation", Start::Value),
        ("signed Gaussian", Start::SignedGaussian { sigma: FIXED_SIGMA }),
        ("Gaussian", Start::Gaussian { sigma: FIXED_SIGMA }),
    ];
    let mut seen = Vec::new();
    let mut tracer = GradientTracer::new(gpu, &buffers, &lights, options(1), Reconstruction::None)?;
    let mut samples = 1;
    while samples <= args.samples {
        render(&mut tracer, samples)?;
        let value = read(gpu, tracer.values())?;
        let directly = read(gpu, tracer.seen())?;
        let problem =
            OnDevice::new(gpu, size, &value, &read(gpu, tracer.weights())?, &read(gpu, tracer.differences())?)?;
        let mut look = |study: &str, method: &str, picture: &[[f32; 4]]| {
            let whole: Pixels =
                picture.iter().zip(&directly).map(|(a, b)| std::array::from_fn(|i| a[i] + b[i])).collect();
            let rmse = rmse(&tone_mapped(&whole), &truth);
            seen.push(Seen { study: study.to_owned(), method: method.to_owned(), at: samples, rmse });
        };
        let solve = |solver, start, iterations| -> Result<Pixels, Failure> {
            let settings = PoissonSettings { solver, start, iterations, ..PoissonSettings::default() };
            problem.solve(gpu, settings, |_, residual, _| Ok(residual > 1e-5))?;
            problem.solution(gpu)
        };
        let exact = solve(Solver::ConjugateGradients(Preconditioner::VCycle), Start::Value, 40)?;
        for iterations in FIXED {
            let study = format!("paths_{iterations}");
            look(&study, "without reconstruction", &value);
            for (method, start) in starts {
                look(&study, &format!("Gauss-Seidel, {method}"), &solve(plain, start, iterations)?);
            }
            look(&study, "solved to the end", &exact);
        }
        samples *= 2;
    }
    Ok(seen)
}

/// After the tone map of the error metric.
fn tone_mapped(picture: &[[f32; 4]]) -> Pixels {
    let compress = |v: &[f32; 4]| {
        let scale = 1.0 / (1.0 + v[0].max(v[1]).max(v[2]).max(0.0));
        [v[0] * scale, v[1] * scale, v[2] * scale, 0.0]
    };
    picture.iter().map(compress).collect()
}

fn solver_csv(solved: &[Solved]) -> String {
    let mut text =
        "solver,width,height,screen,iterations_to_goal,ms_to_goal,error_left,ms_an_iteration,attainable\n".to_owned();
    for one in solved {
        let known = |value: Option<f64>| value.map_or_else(String::new, |value| format!("{value:.6e}"));
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "\"{}\",{},{},{},{},{},{},{:.6e},{:.6e}",
            one.solver,
            one.size[0],
            one.size[1],
            one.screen,
            one.iterations.map_or_else(String::new, |count| count.to_string()),
            known(one.ms),
            known(one.error_left),
            one.ms_an_iteration,
            one.attainable
        );
    }
    text
}

fn picture_csv(pictures: &[Seen]) -> String {
    let mut text = "study,method,at,rmse\n".to_owned();
    for one in pictures {
        let _ = writeln!(text, "{},\"{}\",{},{:.6e}", one.study, one.method, one.at, one.rmse);
    }
    text
}

/// RMSE curves of a study.
fn curves(pictures: &[Seen], study: &str) -> Vec<Series> {
    let mut series: Vec<Series> = Vec::new();
    for one in pictures.iter().filter(|one| one.study == study) {
        // A logarithmic axis has no place for the start: it stands at a half.
        let point = ChartPoint { x: f64::from(one.at).max(0.5), y: one.rmse, std_error: 0.0 };
        match series.iter_mut().find(|known| known.label == one.method) {
            Some(known) => known.points.push(point),
            None => series.push(Series { label: one.method.clone(), points: vec![point] }),
        }
    }
    series
}

fn charts(args: &PoissonArgs, solved: &[Solved], pictures: &[Seen]) -> Result<(), Failure> {
    let chart = |file: &str, title: String, x_label: &str, y_label: &str, series: Vec<Series>| {
        Chart {
            title,
            x_label: x_label.to_owned(),
            y_label: y_label.to_owned(),
            series,
            level: None,
            shows_front: false,
            shows_agreement: false,
        }
        .write(&args.output.out.join(file))
    };
    for &[width, height] in &args.sizes {
        for &screen in &args.screens {
            let of_problem = solved.iter().filter(|one| one.size == [width, height] && one.screen == screen);
            let series = of_problem
                .map(|one| Series {
                    label: one.solver.to_owned(),
                    points: (one.residuals.iter().enumerate().skip(1))
                        .filter(|(i, _)| *i < 32 || i.is_power_of_two() || i % (i.ilog2() as usize * 4) == 0)
                        .map(|(i, &y)| ChartPoint { x: i as f64, y, std_error: 0.0 })
                        .collect(),
                })
                .collect();
            chart(
                &format!("poisson_residual_{width}x{height}_{screen}.svg"),
                format!("{width} x {height}, screen {screen}"),
                "iterations",
                "residual of V = 1",
                series,
            )?;
        }
    }
    for &screen in &args.screens {
        let series = SOLVERS
            .iter()
            .map(|(name, _)| Series {
                label: (*name).to_owned(),
                points: solved
                    .iter()
                    .filter(|one| one.solver == *name && one.screen == screen)
                    .filter_map(|one| {
                        let pixels = f64::from(one.size[0]) * f64::from(one.size[1]);
                        Some(ChartPoint { x: pixels, y: one.ms?, std_error: 0.0 })
                    })
                    .collect(),
            })
            .collect();
        let title = format!("Time to a residual of {GOAL}, screen {screen}");
        chart(&format!("poisson_time_{screen}.svg"), title, "pixels", "ms", series)?;
    }
    for sigma in BLURS {
        let title = format!("A picture blurred by {sigma} pixels and its true differences");
        let study = format!("blur_{sigma}");
        chart(&format!("poisson_{study}.svg"), title, "iterations", "RMSE", curves(pictures, &study))?;
    }
    for iterations in FIXED {
        let title = format!("Gradient-domain path tracing, {iterations} iterations");
        let study = format!("paths_{iterations}");
        let series = curves(pictures, &study);
        chart(&format!("poisson_{study}.svg"), title, "samples a pixel", "tone-mapped RMSE", series)?;
    }
    Ok(())
}

fn markdown(args: &PoissonArgs, device: &str, solved: &[Solved], pictures: &[Seen]) -> String {
    let mut text = format!(
        "{device}. Iterations to a residual of {GOAL} (that of V is 1), ms until then, the share of the error of V that is left, \
         and the least residual found: where `f32` ends, unless the iterations ran out before (`>`).\n\n\
         | picture | screen | solver | iterations | ms | ms each | error left | least residual |\n|---|---|---|---|---|---|---|---|\n"
    );
    for one in solved {
        let known = |value: Option<f64>, digits: usize| {
            value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
        };
        let _ = writeln!(
            text,
            "| {} x {} | {} | {} | {} | {} | {:.2} | {} | {:.0e} |",
            one.size[0],
            one.size[1],
            one.screen,
            one.solver,
            one.iterations.map_or_else(|| format!("> {}", one.residuals.len() - 1), |count| count.to_string()),
            known(one.ms, 1),
            one.ms_an_iteration,
            known(one.error_left, 3),
            one.attainable
        );
    }
    let mut table = |title: String, study: &str, unit: &str| {
        let series = curves(pictures, study);
        let mut places: Vec<u32> = pictures.iter().filter(|one| one.study == study).map(|one| one.at).collect();
        places.sort_unstable();
        places.dedup();
        let heads: Vec<_> = places.iter().map(u32::to_string).collect();
        let _ = writeln!(text, "\n{title}\n\n| {unit} | {} |\n|---|{}", heads.join(" | "), "---|".repeat(heads.len()));
        for one in series {
            let cells: Vec<_> = places
                .iter()
                .map(|&at| {
                    let found = pictures.iter().find(|p| p.study == study && p.method == one.label && p.at == at);
                    found.map_or_else(|| "-".to_owned(), |found| format!("{:.4}", found.rmse))
                })
                .collect();
            let _ = writeln!(text, "| {} | {} |", one.label, cells.join(" | "));
        }
    };
    for sigma in BLURS {
        let [width, height] = args.blur_size;
        let title =
            format!("RMSE of a {width} x {height} picture blurred by {sigma} pixels, with its true differences:");
        table(title, &format!("blur_{sigma}"), "iterations");
    }
    for iterations in FIXED {
        let [width, height] = args.path_size;
        let title = format!(
            "Tone-mapped RMSE of gradient-domain path tracing, Cornell box from inside, {width} x {height}, {iterations} \
             iterations:"
        );
        table(title, &format!("paths_{iterations}"), "samples a pixel");
    }
    text
}
