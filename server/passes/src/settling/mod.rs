//! Settling: while nothing moves, a biased image converges to the truth by path-traced samples of the same view.
//!
//! The biased image of a technique's frames is good at once and keeps some error; the path-traced image starts with
//! much noise and converges. Both are kept apart, and each pixel shows the blend with the least expected error
//! (`shaders/techniques/common/settling.wesl`): about as good as the better of both, and the truth in the limit.
//!
//! The next samples go where they lower the error more (`ledger.rs`). The error M of the biased image is the mean
//! square by which both differ beyond the noise of the paths. Let v be the variance of the path-traced mean times what
//! its samples cost, C what the frames have cost, and f the share of M that still falls with their number. More paths
//! lower the error of the blend by M^2 v and more frames by f M v^2 / C, both times the same factor; so paths win where
//! M C > f v. Cost is counted in rays, never in seconds, so that the same request gives the same bytes.

mod ledger;

use surfelcast_gpu::{Buffer, Gpu, GpuError, MemoryKind};
use surfelcast_shaders::Features;
use surfelcast_shaders::constants::SETTLE_TILE;
use surfelcast_shaders::layout::bytemuck;
use surfelcast_shaders::records::SettleUniforms;

use self::ledger::{FEWEST_SAMPLES, Ledger, Recipient, compare};
use crate::features::general_features;
use crate::frame::FrameView;
use crate::kernels::KernelSet;
use crate::lights::LightBuffers;
use crate::materials::MaterialMode;
use crate::path_samples::{KERNEL, PathSamples};
use crate::step::{Step, StepBudget};
use crate::upload::SceneBuffers;
use crate::{merge_passes, workgroups_of};

/// Frames before the first path is traced: images of a gesture, and quick previews, pay nothing.
pub const FRAMES_BEFORE: u32 = 8;
/// Factor on the noise of the paths in the weights, and what is added to it times the inverse number of their samples,
/// from which that noise is estimated.
const CAUTION: f32 = 1.3;
const CAUTION_OF_FEW: f32 = 4.0;
/// Keeps the random numbers of the paths apart from those of the frames.
const SEED_SALT: u64 = 0x7c31_9d52_e60b_48af;

/// The image that converges.
#[derive(Clone, Copy, Debug)]
pub struct SettlingOptions {
    /// Size, pixels.
    pub size: [u32; 2],
    /// Materials.
    pub materials: MaterialMode,
    /// Kernel variant of the paths, for the scene.
    pub features: Features,
    /// Seed of the frames; paths have random numbers of their own.
    pub seed: u64,
    /// Whether to wait for that variant. Otherwise no path is traced before it is compiled.
    pub waits_for_kernels: bool,
}

/// What is on the device from the first path on.
#[derive(Debug)]
struct OnDevice {
    paths: PathSamples,
    tile_sums: Buffer,
    blend: Buffer,
}

/// Settling of one image.
#[derive(Debug)]
pub struct Settling {
    options: SettlingOptions,
    on_device: Option<OnDevice>,
    /// There was not enough memory.
    is_refused: bool,
    ledger: Ledger,
    /// Path-traced samples that count as samples of the image: those taken while the budget went to paths.
    counted: u32,
    is_shown: bool,
}

impl Settling {
    /// No path-traced sample yet.
    pub const fn new(options: SettlingOptions) -> Self {
        Self { options, on_device: None, is_refused: false, ledger: Ledger::new(), counted: 0, is_shown: false }
    }

    /// Camera or lights changed: forgets all samples.
    pub fn restart(&mut self) {
        if let Some(on_device) = &mut self.on_device {
            on_device.paths.restart();
        }
        self.ledger = Ledger::new();
        self.counted = 0;
        self.is_shown = false;
    }

    /// Adds the cost of a frame of the biased image, in rays.
    pub fn count_frame(&mut self, cost: f64) {
        self.ledger.frame_cost += cost;
    }

    /// Path-traced samples that count as samples of the image.
    pub const fn counted(&self) -> u32 {
        self.counted
    }

    /// The blend, where there is one.
    pub fn image(&self) -> Option<&Buffer> {
        self.on_device.as_ref().filter(|_| self.is_shown).map(|on_device| &on_device.blend)
    }

    /// Path-traced samples per pixel to reach before the next frame, of which there were `frames`. `left` samples are
    /// still requested of the image.
    pub fn due(&mut self, gpu: &Gpu, frames: u32, left: u32) -> Result<Option<u32>, GpuError> {
        if frames < FRAMES_BEFORE || self.is_refused || !self.allocate(gpu)? {
            return Ok(None);
        }
        let count = self.on_device.as_ref().map_or(0, |on_device| on_device.paths.count());
        let pixel_count = self.options.size[0] * self.options.size[1];
        let goal = match self.ledger.recipient {
            Recipient::Paths => count.saturating_add(left),
            Recipient::Frames => self.ledger.explored(count, pixel_count),
        };
        Ok((goal > count).then_some(goal))
    }

    /// Allocates buffers once the kernel is compiled. Returns whether they exist.
    fn allocate(&mut self, gpu: &Gpu) -> Result<bool, GpuError> {
        if self.on_device.is_some() {
            return Ok(true);
        }
        let SettlingOptions { size, materials, features, seed, waits_for_kernels } = self.options;
        if !waits_for_kernels && gpu.kernel_if_ready(KERNEL, features).is_none() {
            gpu.prepare(KERNEL, features);
            return Ok(false);
        }
        let kernels = KernelSet::new(gpu, vec![KERNEL], features, general_features(materials, false), true)?;
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        let allocated = PathSamples::new(gpu, kernels, size, false, seed ^ SEED_SALT).and_then(|paths| {
            Ok(OnDevice {
                paths,
                tile_sums: gpu.buffer("settle_tile_sums", MemoryKind::View, u64::from(tile_count(size)) * 16)?,
                blend: gpu.buffer("settled", MemoryKind::View, pixels * 16)?,
            })
        });
        match allocated {
            Ok(on_device) => self.on_device = Some(on_device),
            Err(reason @ (GpuError::OutOfMemory { .. } | GpuError::TooLarge { .. })) => {
                tracing::warn!(%reason, "the image keeps its bias");
                self.is_refused = true;
            }
            Err(other) => return Err(other),
        }
        Ok(self.on_device.is_some())
    }

    /// Takes path-traced samples. The step is whole when there are `budget.until_samples` of them per pixel, or after a
    /// batch that counts.
    pub fn trace(
        &mut self,
        gpu: &Gpu,
        scene: &SceneBuffers,
        lights: &LightBuffers,
        view: &FrameView,
        budget: StepBudget,
    ) -> Result<Step, GpuError> {
        let Some(on_device) = &mut self.on_device else { return Ok(Step { is_whole: true, ..Step::default() }) };
        let before = on_device.paths.count();
        let mut step = on_device.paths.step(gpu, scene, lights, view, budget)?;
        self.ledger.path_cost += step.rays.iter().sum::<u64>() as f64;
        let count = on_device.paths.count();
        match self.ledger.recipient {
            Recipient::Paths => self.counted += count - before,
            Recipient::Frames => step.is_whole = count >= budget.until_samples,
        }
        Ok(step)
    }

    /// Whether the budget goes to paths, so that their samples count as samples of the image.
    pub fn budget_goes_to_paths(&self) -> bool {
        self.ledger.recipient == Recipient::Paths
    }

    /// Blends both images after `frames` frames, and decides what the budget goes to next.
    pub fn combine(
        &mut self,
        gpu: &Gpu,
        biased: &Buffer,
        frames: u32,
        exposure: f32,
        step: &mut Step,
    ) -> Result<(), GpuError> {
        let Some(on_device) = &self.on_device else { return Ok(()) };
        let count = on_device.paths.count();
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
        for (name, groups) in [("settle_tiles", tiles * 64), ("settle_combine", width * height)] {
            graph
                .pass(&gpu.kernel(name, Features::NONE)?)
                .uniform("settle", uniforms)
                .bind("accumulation", biased)
                .bind("path_accumulation", on_device.paths.image())
                .bind("settle_tile_sums", &on_device.tile_sums)
                .bind_if_bound("settled", &on_device.blend)
                .dispatch(workgroups_of(groups))?;
        }
        let is_due = self.ledger.is_decision_due(count);
        let ticket = is_due.then(|| graph.read_back(&on_device.tile_sums, 0..u64::from(tiles) * 16)).transpose()?;
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
