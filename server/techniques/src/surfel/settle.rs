//! Settling to the truth: while nothing moves, path-traced samples of the same view take over from the cache's picture.
//!
//! The cache's picture is good at once and stays a little wrong; path tracing starts bad and gets as exact as one cares to
//! wait. Both are kept apart, and each pixel shows the mixture with the least expected error (`settle/weighing.wesl`), so the
//! picture is about as good as the better of both wherever that is, and the truth in the limit.
//!
//! Which of both gets the next samples is decided by what they buy. The error M of the cache's picture is what the two differ
//! by beyond the paths' noise, summed over the picture. With v the variance of the paths' mean times what its samples cost,
//! more samples of paths lower the mixture's error by M^2 v and more frames of the cache by f M v^2 / C, both times the same
//! factor; C is what those frames have cost and f the share of M that still falls with their number. Paths win where
//! M C > f v. Cost is counted in rays, never in seconds, so that the same request gives the same bytes.

use surfelcast_gpu::{Buffer, Gpu, GpuError, MemoryKind};
use surfelcast_shaders::Features;
use surfelcast_shaders::constants::SETTLE_TILE;
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::records::SettleUniforms;

use crate::technique::TechniqueOptions;
use surfelcast_passes::features::general_features;
use surfelcast_passes::frame::FrameView;
use surfelcast_passes::kernels::KernelSet;
use surfelcast_passes::lights::LightBuffers;
use surfelcast_passes::path_samples::{KERNEL, PathSamples};
use surfelcast_passes::step::{Step, StepBudget};
use surfelcast_passes::upload::SceneBuffers;
use surfelcast_passes::{merge_passes, workgroups_of};

/// Frames before the first path is traced: pictures of a gesture, and quick previews, pay nothing.
pub(super) const FRAMES_BEFORE: u32 = 8;
/// Share of the cost that goes into paths while the cache does better, so that its error is known: a picture without them
/// would have hardly less noise.
const EXPLORED_SHARE: f64 = 1.0 / 16.0;
/// Samples of paths from which their noise is known well enough to weigh them.
const FEWEST_SAMPLES: u32 = 4;
/// Growth of the cost between decisions.
const DECISION_GROWTH: f64 = 1.25;
/// Factor on the noise of paths in the weights, and what is added to it where few samples tell that noise.
const CAUTION: f32 = 1.3;
const CAUTION_OF_FEW: f32 = 4.0;
/// Standard errors between the measured error of the cache and what it is at least and at most.
const CERTAINTY: f64 = 1.5;
/// Least share of the cache's error that is taken to fall with more frames.
const LEAST_FALLING: f64 = 0.02;
/// What the passes over a surfel cost in a frame, in rays.
const SURFEL_COST: f64 = 8.0;
/// Rays of a sample of paths before one was taken.
const GUESSED_RAYS: f64 = 8.0;
/// Keeps the paths' random numbers apart from those of the cache's pictures.
const SEED_SALT: u64 = 0x7c31_9d52_e60b_48af;

/// Sums over a picture, of squares in pixels' mean.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Compared {
    /// Error that the cache's picture has at least, and at most, as far as the paths' noise lets one see. The former is below zero
    /// where one sees none.
    surely: f64,
    perhaps: f64,
    /// Variance of the paths' mean.
    path_noise: f64,
}

/// What takes the next samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Turn {
    Cache,
    Paths,
}

/// What is known of both pictures, and whose turn it is. No device in it.
#[derive(Clone, Debug)]
struct Ledger {
    cache_cost: f64,
    path_cost: f64,
    /// Errors that the cache's picture may well have had, by the number of its frames.
    errors: Vec<(u32, f64)>,
    turn: Turn,
    /// Total cost from which the next decision is due.
    next_decision: f64,
}

impl Ledger {
    const fn new() -> Self {
        Self { cache_cost: 0.0, path_cost: 0.0, errors: Vec::new(), turn: Turn::Cache, next_decision: 0.0 }
    }

    /// Samples of paths that there should be while the cache does better.
    fn explored(&self, samples: u32, pixel_count: u32) -> u32 {
        let guess = GUESSED_RAYS * f64::from(pixel_count.max(1));
        let sample_cost = if samples > 0 { self.path_cost / f64::from(samples) } else { guess };
        (self.cache_cost * EXPLORED_SHARE / sample_cost.max(1.0)) as u32
    }

    fn is_decision_due(&self, samples: u32) -> bool {
        samples >= FEWEST_SAMPLES && self.cache_cost + self.path_cost >= self.next_decision
    }

    /// Takes what was found after so many frames of the cache and decides whose turn it is.
    fn decide(&mut self, frames: u32, found: Compared) {
        self.next_decision = (self.cache_cost + self.path_cost) * DECISION_GROWTH;
        // Chance speaks for the cache: of many looks at a few pixels one would speak against it.
        let falling = self.falling_share(frames, found.surely);
        if self.errors.last().is_none_or(|(last, _)| *last < frames) {
            self.errors.push((frames, found.perhaps));
        }
        let is_paths = found.surely * self.cache_cost > falling * found.path_noise * self.path_cost;
        self.turn = if is_paths { Turn::Paths } else { Turn::Cache };
    }

    /// Share of the cache's error, now so much, that falls as one over its frames, from what it may have been at half of them.
    fn falling_share(&self, frames: u32, now: f64) -> f64 {
        let earlier = self.errors.iter().rev().find(|(then, _)| *then * 2 <= frames);
        let Some(&(then, error)) = earlier.filter(|_| now > 0.0) else { return 1.0 };
        let per_frame = (error - now) / (1.0 / f64::from(then) - 1.0 / f64::from(frames));
        (per_frame / f64::from(frames) / now).clamp(LEAST_FALLING, 1.0)
    }
}

/// What is on the device from the first path on.
struct Made {
    paths: PathSamples,
    tile_sums: Buffer,
    settled: Buffer,
}

/// The settling of one picture.
pub(crate) struct Settle {
    options: TechniqueOptions,
    features: Features,
    made: Option<Made>,
    /// There is no memory for it.
    is_refused: bool,
    ledger: Ledger,
    /// Samples of paths that count as samples of the picture: those taken in turns of their own.
    counted: u32,
    is_shown: bool,
}

impl Settle {
    /// For a picture of a scene with these features, which are not [`surfelcast_shaders::Features::SPLIT`] or
    /// `SPLAT`.
    pub(crate) const fn new(options: TechniqueOptions, features: Features) -> Self {
        Self { options, features, made: None, is_refused: false, ledger: Ledger::new(), counted: 0, is_shown: false }
    }

    /// Camera or lights changed.
    pub(crate) fn restart(&mut self) {
        if let Some(made) = &mut self.made {
            made.paths.restart();
        }
        self.ledger = Ledger::new();
        self.counted = 0;
        self.is_shown = false;
    }

    /// Counts the rays of a frame of the cache, and its surfels.
    pub(crate) fn count_cache(&mut self, rays: u64, surfels: u32) {
        self.ledger.cache_cost += rays as f64 + SURFEL_COST * f64::from(surfels);
    }

    /// Samples that count beside the cache's frames.
    pub(crate) const fn counted(&self) -> u32 {
        self.counted
    }

    /// The mixture, where there is one.
    pub(crate) fn picture(&self) -> Option<&Buffer> {
        self.made.as_ref().filter(|_| self.is_shown).map(|made| &made.settled)
    }

    fn path_count(&self) -> u32 {
        self.made.as_ref().map_or(0, |made| made.paths.count())
    }

    /// Samples of paths to take before the cache's next frame, of which there have been `frames`; `left` are still asked for.
    /// Returns the number of samples that there should be.
    pub(crate) fn due(&mut self, gpu: &Gpu, frames: u32, left: u32) -> Result<Option<u32>, GpuError> {
        if frames < FRAMES_BEFORE || self.is_refused || !self.make(gpu)? {
            return Ok(None);
        }
        let count = self.path_count();
        let pixel_count = self.options.size[0] * self.options.size[1];
        let goal = match self.ledger.turn {
            Turn::Paths => count.saturating_add(left),
            Turn::Cache => self.ledger.explored(count, pixel_count),
        };
        Ok((goal > count).then_some(goal))
    }

    /// Makes what it takes, once the kernels are there. Returns whether it is there.
    fn make(&mut self, gpu: &Gpu) -> Result<bool, GpuError> {
        if self.made.is_some() {
            return Ok(true);
        }
        if !self.options.waits_for_kernels && gpu.kernel_if_ready(KERNEL, self.features).is_none() {
            gpu.prepare(KERNEL, self.features);
            return Ok(false);
        }
        let general = general_features(self.options.materials, false);
        let kernels = KernelSet::new(gpu, vec![KERNEL], self.features, general, true)?;
        let TechniqueOptions { size, seed, .. } = self.options;
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        let made = PathSamples::new(gpu, kernels, size, false, seed ^ SEED_SALT).and_then(|paths| {
            Ok(Made {
                paths,
                tile_sums: gpu.buffer("settle_tile_sums", MemoryKind::View, u64::from(tile_count(size)) * 16)?,
                settled: gpu.buffer("settled", MemoryKind::View, pixels * 16)?,
            })
        });
        match made {
            Ok(made) => self.made = Some(made),
            Err(reason @ (GpuError::OutOfMemory { .. } | GpuError::TooLarge { .. })) => {
                tracing::warn!(%reason, "the picture stays with the cache");
                self.is_refused = true;
            }
            Err(other) => return Err(other),
        }
        Ok(self.made.is_some())
    }

    /// Takes samples of paths. The step is whole when there are `budget.until_samples` of them or a batch ended that counts.
    pub(crate) fn trace(
        &mut self,
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        view: &FrameView,
        budget: StepBudget,
    ) -> Result<Step, GpuError> {
        let Some(made) = &mut self.made else { return Ok(Step { is_whole: true, ..Step::default() }) };
        let before = made.paths.count();
        let mut step = made.paths.step(gpu, scene, lights, view, budget)?;
        self.ledger.path_cost += step.rays.iter().sum::<u64>() as f64;
        let count = made.paths.count();
        match self.ledger.turn {
            Turn::Paths => self.counted += count - before,
            Turn::Cache => step.is_whole = count >= budget.until_samples,
        }
        Ok(step)
    }

    /// Whether the samples in hand count as samples of the picture.
    pub(crate) fn is_turn_of_paths(&self) -> bool {
        self.ledger.turn == Turn::Paths
    }

    /// Weighs the two pictures after `frames` frames of the cache, decides whose turn is next, and makes what is shown.
    pub(crate) fn combine(
        &mut self,
        gpu: &Gpu,
        cache_picture: &Buffer,
        frames: u32,
        exposure: f32,
        step: &mut Step,
    ) -> Result<(), GpuError> {
        let Some(made) = &self.made else { return Ok(()) };
        let count = made.paths.count();
        if count < FEWEST_SAMPLES {
            return Ok(());
        }
        let [width, height] = self.options.size;
        let uniforms = SettleUniforms {
            width,
            height,
            path_samples: count as f32,
            shown_samples: (frames + self.counted) as f32,
            caution: CAUTION + CAUTION_OF_FEW / count as f32,
            exposure,
            padding0: 0,
            padding1: 0,
        };
        let uniforms = bytemuck::bytes_of(&uniforms);
        let tiles = tile_count([width, height]);
        let mut graph = gpu.graph("settle");
        graph
            .pass(&gpu.kernel("settle_tiles", Features::NONE)?)
            .uniform("settle", uniforms)
            .read("accumulation", cache_picture)
            .read("path_accumulation", made.paths.picture())
            .read_write("settle_tile_sums", &made.tile_sums)
            .dispatch(workgroups_of(tiles * 64))?;
        graph
            .pass(&gpu.kernel("settle_combine", Features::NONE)?)
            .uniform("settle", uniforms)
            .read("accumulation", cache_picture)
            .read("path_accumulation", made.paths.picture())
            .read("settle_tile_sums", &made.tile_sums)
            .read_write("settled", &made.settled)
            .dispatch(workgroups_of(width * height))?;
        let is_due = self.ledger.is_decision_due(count);
        let ticket = is_due.then(|| graph.read_back(&made.tile_sums, 0..u64::from(tiles) * 16)).transpose()?;
        let mut report = graph.submit()?.wait()?;
        self.is_shown = true;
        if let Some(ticket) = ticket {
            let sums: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&report.take(ticket)?);
            self.ledger.decide(frames, compare(&sums));
        }
        merge_passes(&mut step.passes, report.passes);
        Ok(())
    }
}

fn tile_count([width, height]: [u32; 2]) -> u32 {
    width.div_ceil(SETTLE_TILE) * height.div_ceil(SETTLE_TILE)
}

/// What sums over tiles say.
///
/// How far chance goes is known in two ways, both of which say too much: by the scatter of tiles, which is also that of the error
/// among them; and since a squared difference, of noise v and an error e beyond it, scatters by 2 v^2 + 4 e v, where v is itself
/// overstated by bright samples. The lesser counts.
fn compare(tiles: &[[f32; 4]]) -> Compared {
    let pixels = tiles.iter().map(|tile| f64::from(tile[2])).sum::<f64>().max(1.0);
    let (mut error, mut squares, mut noise, mut scatter_of_pixels) = (0.0, 0.0, 0.0, 0.0);
    for &[difference, variance, count, variance_squared] in tiles {
        let (variance, beyond) = (f64::from(variance), f64::from(difference) - f64::from(variance));
        error += beyond;
        squares += beyond * beyond;
        noise += variance;
        let error_of_pixels = beyond.max(0.0) / f64::from(count).max(1.0);
        scatter_of_pixels += 2.0 * f64::from(variance_squared) + 4.0 * error_of_pixels * variance;
    }
    let scatter_of_tiles = (squares - error * error / tiles.len().max(1) as f64).max(0.0);
    let doubt = CERTAINTY * scatter_of_pixels.min(scatter_of_tiles).sqrt();
    Compared {
        surely: (error - doubt) / pixels,
        perhaps: (error.max(0.0) + doubt) / pixels,
        path_noise: noise / pixels,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cache whose picture has the error `bias + noise / frames`, and paths with the error `path / samples`.
    fn followed(bias: f64, noise: f64, path: f64, total_cost: f64) -> (Ledger, u32, u32) {
        let (frame_cost, sample_cost) = (10.0, 4.0);
        let mut ledger = Ledger::new();
        let (mut frames, mut samples) = (0u32, 0u32);
        while ledger.cache_cost + ledger.path_cost < total_cost {
            let goal = match ledger.turn {
                Turn::Paths => samples + 1,
                Turn::Cache if frames < FRAMES_BEFORE => samples,
                Turn::Cache => ledger.explored(samples, 0),
            };
            if goal > samples {
                samples += 1;
                ledger.path_cost += sample_cost;
            } else {
                frames += 1;
                ledger.cache_cost += frame_cost;
            }
            if ledger.is_decision_due(samples) {
                let cache_error = bias + noise / f64::from(frames);
                let path_noise = path / f64::from(samples);
                ledger.decide(frames, Compared { surely: cache_error, perhaps: cache_error, path_noise });
            }
        }
        (ledger, frames, samples)
    }

    #[test]
    fn paths_take_over_where_the_cache_stops_getting_better() {
        let (ledger, _, samples) = followed(1e-4, 1e-3, 0.1, 1e5);
        assert_eq!(ledger.turn, Turn::Paths);
        assert!(ledger.path_cost > 0.9 * 1e5, "{samples} samples");
    }

    #[test]
    fn a_cache_that_keeps_getting_better_faster_keeps_its_turn() {
        let (ledger, frames, _) = followed(0.0, 1e-3, 0.1, 1e5);
        assert_eq!(ledger.turn, Turn::Cache);
        assert!(ledger.cache_cost > 0.9 * 1e5, "{frames} frames");
    }

    #[test]
    fn paths_that_are_better_from_the_start_take_over_at_once() {
        let (ledger, frames, _) = followed(0.0, 1.0, 0.1, 1e4);
        assert_eq!(ledger.turn, Turn::Paths);
        assert!(frames < 100, "{frames} frames");
    }

    #[test]
    fn an_error_that_may_be_chance_decides_nothing() {
        let mut ledger = Ledger::new();
        (ledger.cache_cost, ledger.path_cost) = (1000.0, 1.0);
        ledger.decide(16, Compared { surely: -2e-3, perhaps: 4e-3, path_noise: 0.1 });
        assert_eq!(ledger.turn, Turn::Cache);
        ledger.decide(16, Compared { surely: 9.9e-4, perhaps: 1.1e-3, path_noise: 0.1 });
        assert_eq!(ledger.turn, Turn::Paths);
    }

    #[test]
    fn that_an_error_did_not_fall_may_be_chance_too() {
        let mut ledger = Ledger::new();
        (ledger.cache_cost, ledger.path_cost) = (6e5, 3e4);
        ledger.decide(15, Compared { surely: -4e-4, perhaps: 3e-4, path_noise: 1.5e-3 });
        assert_eq!(ledger.turn, Turn::Cache);
        // There is an error, no less than before as far as one can see. It may still have been ten times as large.
        (ledger.cache_cost, ledger.path_cost) = (1.25e6, 7.3e4);
        ledger.decide(33, Compared { surely: 1.5e-5, perhaps: 4.5e-5, path_noise: 2.8e-4 });
        assert_eq!(ledger.turn, Turn::Cache);
    }

    /// A tile of 64 pixels with this error and noise of paths.
    fn tile(error: f32, noise: f32) -> [f32; 4] {
        [(error + noise) * 64.0, noise * 64.0, 64.0, noise * noise * 64.0]
    }

    #[test]
    fn tiles_tell_the_error_and_how_far_chance_goes() {
        let is_near = |value: f64, wanted: f64| (value / wanted - 1.0).abs() < 1e-6;
        // A mean of 20; the scatter of the two sums is 128.
        let found = compare(&[tile(21.0, 100.0), tile(19.0, 100.0)]);
        let doubt = CERTAINTY * 2f64.sqrt() / 2.0;
        assert!(is_near(found.surely, 20.0 - doubt) && is_near(found.perhaps, 20.0 + doubt), "{found:?}");
        assert!(is_near(found.path_noise, 100.0), "{found:?}");
        // Where one tile has all of the error, it is the noise that tells.
        let found = compare(&[tile(40.0, 0.1), tile(0.0, 0.1)]);
        let doubt = CERTAINTY * (64.0 * (4.0 * 0.01 + 4.0 * 40.0 * 0.1f64)).sqrt() / 128.0;
        assert!(is_near(found.surely, 20.0 - doubt), "{found:?}");
    }

    #[test]
    fn a_bright_sample_is_no_error() {
        let bright = [2e6, 1e6, 64.0, 1e12];
        let found = compare(&[tile(0.0, 1.0), tile(0.0, 1.0), bright]);
        assert!(found.surely <= 0.0 && found.perhaps > 1e3, "{found:?}");
    }
}
