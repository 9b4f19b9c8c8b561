//! Measures one curve: every replicate is one long render, observed at each budget, so that all budgets share its work.

use surfelcast::Failure;
use surfelcast_gpu::Gpu;
use surfelcast_measure::{Image, flip, split_error};
use surfelcast_renderer::progressive::Cost;
use surfelcast_techniques::SessionState;

use crate::report::Origin;
use crate::stage::{Stage, camera_aside};
use crate::studies::curves::case::{Case, Truth};
use crate::studies::curves::curve::{Curve, Key, Point};
use crate::studies::curves::variant::Start;

/// Frames that another camera renders before a warm start: enough to converge in all but the noisiest places.
const WARM_FRAMES: u32 = 64;
/// Separates the random numbers of that camera from those of the measured one.
const WARM_SEED: u64 = 1 << 32;
/// Prefix of the names of passes that reconstruct light over the neighbours of surfels.
const RECONSTRUCTION_PASSES: &str = "neighbours_";

/// One replicate at one budget.
struct Observation {
    image: Image,
    cost: Cost,
    /// Tone-mapped mean square, which may be below 0, and its standard error.
    audited: Option<[f64; 2]>,
    surfels: Option<u32>,
}

/// Measures the curve of that key. Reading images back and audits are not timed, and a render of one sample
/// beforehand keeps compilation out of the times.
pub(super) fn measure(
    gpu: &Gpu,
    case: &Case,
    stage: &Stage<'_>,
    truth: &Truth,
    key: Key,
    origin: Origin,
) -> Result<Curve, Failure> {
    let settings = key.variant.resolve()?;
    let technique = &key.variant.technique;
    stage.shot(technique, &settings, case.camera, 0, &SessionState::default())?.render(1, f64::INFINITY)?;

    let mut budgets: Vec<u32> = (0..32).map(|power| 1 << power).take_while(|&budget| budget <= key.samples).collect();
    let mut limit_secs = key.time_limit_ms as f64 * 1e-3;
    let mut replicates: Vec<Vec<Observation>> = Vec::new();
    let mut memory_bytes = [0; 3];
    for replicate in 0..key.replicates {
        let seed = key.seed + u64::from(replicate);
        let session = SessionState::default();
        if key.variant.start == Start::Warm {
            let aside = camera_aside(&case.scene, &case.camera);
            let mut before = stage.shot(technique, &settings, aside, seed + WARM_SEED, &session)?;
            before.render(WARM_FRAMES, f64::INFINITY)?;
        }
        let mut shot = stage.shot(technique, &settings, case.camera, seed, &session)?;
        let mut observations = Vec::new();
        for &budget in &budgets {
            // The first budget is observed in any case.
            let limit = if observations.is_empty() { f64::INFINITY } else { limit_secs };
            if !shot.render(budget, limit)? {
                break;
            }
            let audited = shot.audit()?.map(|audit| [audit.mse, audit.mse_std_error]);
            let (image, cost, surfels) = (shot.image()?, shot.cost().clone(), shot.surfels());
            observations.push(Observation { image, cost, audited, surfels });
        }
        let memory = gpu.memory();
        memory_bytes = [memory.scene_bytes, memory.session_bytes, memory.view_bytes];
        // The first replicate decides how far the others go, so that all have the same budgets.
        budgets.truncate(observations.len());
        limit_secs = f64::INFINITY;
        replicates.push(observations);
    }
    let points = budgets
        .iter()
        .enumerate()
        .map(|(index, &samples)| {
            let observations: Vec<_> = replicates.iter().filter_map(|one| one.get(index)).collect();
            point(samples, &observations, truth, f64::from(case.exposure))
        })
        .collect();
    Ok(Curve { key, origin, truth_noise: truth.noise, memory_bytes, points })
}

/// Combines the replicates of one budget.
fn point(samples: u32, observations: &[&Observation], truth: &Truth, exposure: f64) -> Point {
    let count = observations.len() as f64;
    let mean = |value: &dyn Fn(&Observation) -> f64| observations.iter().map(|one| value(one)).sum::<f64>() / count;
    let known = |value: f64| value.is_finite().then_some(value);
    let images: Vec<_> = observations.iter().map(|one| truth.comparable(&one.image)).collect();
    let compared = truth.compared();
    let split = split_error(&images, &compared, exposure, truth.noise);
    let shown = truth.whole().tone_mapped(exposure);
    let secs = mean(&|one| one.cost.secs);
    let spread = mean(&|one| (one.cost.secs - secs).powi(2));
    let audited = observations.iter().map(|one| one.audited).collect::<Option<Vec<_>>>().map(|all| {
        let square = (all.iter().map(|a| a[0]).sum::<f64>() / count).max(0.0);
        // Independent audits: the standard error of their mean falls with the root of their number.
        let std_error = all.iter().map(|a| a[1].powi(2)).sum::<f64>().sqrt() / count;
        [square.sqrt(), (square + std_error).sqrt() - square.sqrt()]
    });
    let over_images = |value: &dyn Fn(&Image) -> f64| images.iter().map(value).sum::<f64>() / count;
    Point {
        samples,
        secs,
        secs_std_error: known((spread / (count - 1.0)).sqrt()),
        gpu_secs: mean(&|one| one.cost.gpu_secs),
        reconstruction_gpu_secs: mean(&|one| one.cost.gpu_secs_of(RECONSTRUCTION_PASSES)),
        rays_primary: mean(&|one| one.cost.rays[0] as f64),
        rays_secondary: mean(&|one| one.cost.rays[1] as f64),
        rays_shadow: mean(&|one| one.cost.rays[2] as f64),
        rmse: split.rmse.value,
        rmse_std_error: known(split.rmse.std_error),
        error: (split.rmse.value.powi(2) - truth.noise.powi(2)).max(0.0).sqrt(),
        relative_mse: over_images(&|image| image.relative_mse(&compared)),
        // FLIP looks at neighbourhoods, so it gets the masked parts too.
        flip: mean(&|one| flip(&one.image.tone_mapped(exposure), &shown)),
        bias_squared: known(split.bias_squared.value),
        bias_squared_std_error: known(split.bias_squared.std_error),
        variance: known(split.variance.value),
        variance_std_error: known(split.variance.std_error),
        mean_bias: over_images(&Image::mean) / compared.mean().max(1e-30) - 1.0,
        audited_rmse: audited.map(|[rmse, _]| rmse),
        audited_std_error: audited.map(|[_, std_error]| std_error),
        surfels: observations.iter().map(|one| one.surfels.map(f64::from)).sum::<Option<f64>>().map(|sum| sum / count),
        non_finite: observations.iter().map(|one| one.cost.non_finite).sum(),
    }
}
