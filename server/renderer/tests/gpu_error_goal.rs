//! Jobs that stop at an error: how far from it they end, over many seeds, on a real device (software rendering
//! suffices).
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]
#![allow(clippy::print_stdout, reason = "a test says what it measured")]

use std::sync::Arc;
use std::time::Duration;

use surfelcast_renderer::scene::{LoadOptions, Scene, ViewFile, demo, load_bytes};
use surfelcast_renderer::{
    DeviceState, MaterialMode, RenderJob, RenderOutput, RenderSpec, RendererConfig, RendererHandle, Settings,
    StopRules, start,
};

/// Longest wait for anything a test expects.
const PATIENCE: Duration = Duration::from_mins(4);
const GOAL: f64 = 0.01;
/// What 95 % of the jobs must stay within.
const LIMIT: f64 = 0.0115;

fn job(scene: &Arc<Scene>, technique: &str, seed: u64, stop: StopRules) -> RenderJob {
    let spec = RenderSpec {
        scene: scene.id.to_string(),
        camera: scene.cameras[0].camera,
        size: [48, 36],
        technique: technique.to_owned(),
        settings: Settings::default(),
        materials: MaterialMode::Lambert,
        seed,
        stop,
        exposure: 1.0,
        aov: None,
    };
    RenderJob { scene: Arc::clone(scene), lights: None, spec, exports: false }
}

async fn rendered(renderer: &RendererHandle, job: RenderJob) -> RenderOutput {
    let ticket = renderer.render(job).unwrap();
    tokio::time::timeout(PATIENCE, ticket.result).await.unwrap().unwrap().unwrap()
}

fn tone_mapped(output: &RenderOutput) -> Vec<[f64; 3]> {
    let compress = |c: &[f32; 3]| c.map(|v| f64::from(v) / (1.0 + f64::from(c[0].max(c[1]).max(c[2]))));
    output.pixels.iter().map(compress).collect()
}

/// RMSE against the truth, of which two images with independent noise are known: the noise cancels in the product.
fn rmse(output: &RenderOutput, truths: &[Vec<[f64; 3]>; 2]) -> f64 {
    let products = tone_mapped(output)
        .into_iter()
        .zip(truths[0].iter().zip(&truths[1]))
        .map(|(x, (a, b))| (0..3).map(|i| (x[i] - a[i]) * (x[i] - b[i])).sum::<f64>());
    (products.sum::<f64>() / (3.0 * output.pixels.len() as f64)).max(0.0).sqrt()
}

/// Renders jobs with different seeds.
async fn check(technique: &str, jobs: u64) -> Ends {
    let (renderer, thread) = start(RendererConfig::default()).unwrap();
    let mut status = renderer.status();
    tokio::time::timeout(PATIENCE, status.wait_for(|s| s.state == DeviceState::Ready)).await.unwrap().unwrap();
    let demo = demo::scenes().into_iter().find(|demo| demo.name == "cornell_box").unwrap();
    let view = ViewFile::parse(demo.view.as_bytes()).unwrap();
    let options = LoadOptions { view: Some(view), ..LoadOptions::default() };
    let scene = Arc::new(load_bytes(&demo.glb, demo.name, &options).unwrap());
    let converged = StopRules { samples: Some(2048), ..StopRules::default() };
    let truths = [
        tone_mapped(&rendered(&renderer, job(&scene, "path", 1 << 20, converged)).await),
        tone_mapped(&rendered(&renderer, job(&scene, "path", 1 << 21, converged)).await),
    ];

    let (mut ends, mut samples) = (Vec::new(), Vec::new());
    for seed in 0..jobs {
        let stop = StopRules { max_error: Some(GOAL as f32), ..StopRules::default() };
        let output = rendered(&renderer, job(&scene, technique, seed, stop)).await;
        if output.stopped_by == "max_error" {
            ends.push(rmse(&output, &truths));
            samples.push(output.samples);
        } else {
            println!("{technique}, seed {seed}: {} at {} samples", output.stopped_by, output.samples);
        }
    }
    ends.sort_by(f64::total_cmp);
    samples.sort_unstable();
    let count = ends.len();
    assert!(count as u64 == jobs, "{technique}: only {count} of {jobs} jobs reached {GOAL}");
    let share = |share: f64| ends[((count - 1) as f64 * share).round() as usize];
    let mean = ends.iter().sum::<f64>() / count as f64;
    let within = ends.iter().filter(|&&end| end <= LIMIT).count();
    println!(
        "{technique}: {count} jobs end at {:.5}, {:.5}, {:.5}, {:.5}, {:.5} (least, quartiles, largest), {:.3} of the goal on \
         average; {within} within {LIMIT}; samples {} to {}, median {}",
        share(0.0),
        share(0.25),
        share(0.5),
        share(0.75),
        share(1.0),
        mean / GOAL,
        samples[0],
        samples[count - 1],
        samples[count / 2]
    );
    assert!(within * 100 >= count * 95, "{technique}: {within} of {count} end within {LIMIT}");
    renderer.stop().await;
    tokio::task::spawn_blocking(|| thread.join()).await.unwrap().unwrap();
    Ends { mean, median_samples: samples[count / 2] }
}

/// How jobs ended.
struct Ends {
    /// Error on average.
    mean: f64,
    median_samples: u32,
}

#[tokio::test]
async fn path_traced_jobs_end_at_their_error() {
    let ends = check("path", 40).await;
    // Nor much later than needed.
    assert!(ends.mean > 0.8 * GOAL, "{} on average", ends.mean);
}

#[tokio::test]
async fn surfel_jobs_end_at_their_error() {
    let ends = check("surfel", 20).await;
    // Most are below it at their first audit.
    assert!(ends.median_samples <= 32, "{} samples", ends.median_samples);
}
